//! `cargo xtask size`: flash per room of the library in the bench firmware, and RAM per state.

use std::collections::BTreeMap;
use std::process::ExitCode;

use anyhow::Result;

use crate::bench::{Firmware, FIRMWARES};
use crate::packages::{self, NM};
use crate::shell;
use crate::toolchain;

/// Measures and prints both tables.
pub fn run() -> Result<ExitCode> {
    packages::ready(&[NM])?;
    let toolchain = toolchain::ready()?;
    let plain: Vec<&Firmware> = FIRMWARES
        .iter()
        .filter(|build| build.cpu.is_empty())
        .collect();
    let mut flash: BTreeMap<String, Vec<u64>> = BTreeMap::new();
    for (column, build) in plain.iter().enumerate() {
        let elf = build.elf(&toolchain)?;
        let symbols = shell::run(
            shell::command(NM.program)
                .args(["-S", "-C", "--size-sort"])
                .arg(elf),
        )?;
        for (bytes, name) in symbols.lines().filter_map(function) {
            flash
                .entry(group(name))
                .or_insert_with(|| vec![0; plain.len()])[column] += bytes;
        }
    }
    let columns: Vec<String> = plain
        .iter()
        .map(|build| format!("opt {}", build.opt))
        .collect();
    println!("Flash of the bench firmware [bytes]; what was inlined counts where it went.\n");
    println!("| functions of | {} |", columns.join(" | "));
    println!("|---|{}", "---|".repeat(plain.len()));
    let mut rows: Vec<_> = flash.into_iter().collect();
    rows.sort_by_key(|(_, bytes)| std::cmp::Reverse(bytes[0]));
    for (name, bytes) in rows {
        let cells: Vec<String> = bytes.iter().map(u64::to_string).collect();
        println!("| {name} | {} |", cells.join(" | "));
    }
    println!("\nRAM of each state [bytes]\n\n| state | bytes |\n|---|---|");
    for (name, bytes) in plain[0].ram(&toolchain)? {
        println!("| {name} | {bytes} |");
    }
    Ok(ExitCode::SUCCESS)
}

/// Size and name of a line of `nm -S` that is a function.
fn function(line: &str) -> Option<(u64, &str)> {
    let mut fields = line.splitn(4, ' ');
    let (_, size, kind, name) = (
        fields.next()?,
        fields.next()?,
        fields.next()?,
        fields.next()?,
    );
    let code = ["t", "T", "w", "W"].contains(&kind);
    Some((u64::from_str_radix(size, 16).ok()?, name)).filter(|_| code)
}

/// Room of the library, or crate, that a function belongs to.
fn group(name: &str) -> String {
    let path = name.trim_start_matches(['<', '&', '_']);
    let mut parts = path.split("::");
    match (parts.next(), parts.next()) {
        (Some("navsight"), Some(room)) => format!("navsight::{room}"),
        (Some(krate), Some(_)) => krate.to_owned(),
        _ => "compiler support and assembly".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_fall_into_rooms() {
        assert_eq!(
            function("00000400 00000102 t navsight::nav::NavState::advance"),
            Some((258, "navsight::nav::NavState::advance"))
        );
        assert_eq!(function("20000000 00000004 b SOMETHING"), None);
        assert_eq!(group("navsight::nav::NavState::advance"), "navsight::nav");
        assert_eq!(
            group("<navsight::filter::Filter>::update"),
            "navsight::filter"
        );
        assert_eq!(group("libm::math::sinf::sinf"), "libm");
        assert_eq!(group("__aeabi_dmul"), "compiler support and assembly");
    }
}
