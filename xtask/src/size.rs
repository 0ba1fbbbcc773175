//! `cargo xtask size`: flash per room of the library in a firmware, and RAM per state.
//!
//! Link-time optimisation melts functions together, so the bytes are attributed by the debug information: each pair of
//! bytes belongs to the innermost source line of the library (`linalg` aside) that led to it, whatever function it ended up in.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{ExitCode, Stdio};

use anyhow::{bail, Context, Result};

use crate::bench::{grouped, is_recorded, record, Firmware, FIRMWARES};
use crate::packages::{self, NM};
use crate::qemu::Build;
use crate::report::Report;
use crate::shell;
use crate::toolchain::{self, target_dir, Toolchain};

/// The program whose flash is looked at: a whole navigator that aligns itself and prints its ξ and η.
const PROGRAM: &str = "two_position";

/// Measures both tables, prints them and records them in BENCHMARKS.md.
pub fn run() -> Result<ExitCode> {
    packages::ready(&[NM])?;
    let toolchain = toolchain::ready()?;
    let plain: Vec<&Firmware> = FIRMWARES
        .iter()
        .filter(|build| build.cpu.is_empty())
        .collect();
    let mut flash: BTreeMap<String, Vec<u64>> = BTreeMap::new();
    for (column, build) in plain.iter().enumerate() {
        let program = Build {
            profile: build.profile,
            ..Build::plain(PROGRAM)
        };
        for (group, bytes) in attribute(&program.elf(&toolchain)?)? {
            flash.entry(group).or_insert_with(|| vec![0; plain.len()])[column] += bytes;
        }
    }
    let (mut rows, mut foreign): (Vec<_>, Vec<_>) = flash
        .into_iter()
        .partition(|(name, _)| name.starts_with("src/"));
    foreign.sort_by_key(|(_, bytes)| std::cmp::Reverse(bytes[0]));
    let sum = |rows: &[(String, Vec<u64>)]| -> Vec<u64> {
        let column = |column: usize| rows.iter().map(|(_, bytes)| bytes[column]).sum();
        (0..plain.len()).map(column).collect()
    };
    let library = sum(&rows);
    rows.push(("**the library**".to_owned(), library));
    rows.append(&mut foreign);

    let mut text = format!("Flash of `examples/{PROGRAM}.rs` by source [bytes]:\n\n| source |");
    for build in &plain {
        text += &format!(" opt {} |", build.opt);
    }
    text += &format!("\n|---|{}", "---|".repeat(plain.len()));
    for (name, bytes) in rows {
        let cells: Vec<String> = bytes.into_iter().map(grouped).collect();
        text += &format!("\n| {name} | {} |", cells.join(" | "));
    }
    text += "\n\nRAM of each state [bytes]:\n\n| state | bytes |\n|---|---|";
    for (name, bytes) in plain[0].ram(&toolchain)? {
        text += &format!("\n| `{name}` | {} |", grouped(bytes));
    }
    println!("{text}");
    if is_recorded(&toolchain)? {
        record("size", &text)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Ways of looking that a navigator may do without, and a program that uses them.
const OPTIONAL: [&str; 6] = [
    "src/observability/structural/",
    "src/observability/pwcs/",
    "src/observability/comprehensive.rs",
    "src/observability/eigen_degree/",
    "src/observability/ceiling.rs",
    "src/observability/agreement.rs",
];
const USER: &str = "why_no_heading";

/// A firmware that uses none of the optional ways of looking holds no byte of them; one that does shows that such bytes
/// would be found.
pub fn unused_is_absent(report: &mut Report, toolchain: &Toolchain) {
    let optional = |program: &'static str| -> Result<u64> {
        let groups = attribute(&Build::plain(program).elf(toolchain)?)?;
        let own = groups
            .iter()
            .filter(|(name, _)| OPTIONAL.iter().any(|room| name.starts_with(room)));
        Ok(own.map(|(_, bytes)| bytes).sum())
    };
    report.check("flash: what is not used is not there", || {
        packages::ready(&[NM])?;
        let (without, with) = (optional(PROGRAM)?, optional(USER)?);
        if without > 0 {
            bail!("{PROGRAM} holds {without} bytes of ways of looking that it does not use");
        }
        if with < 1000 {
            bail!("{USER} uses them, and only {with} bytes were found");
        }
        Ok(())
    });
}

/// Bytes of code per source group.
fn attribute(elf: &Path) -> Result<BTreeMap<String, u64>> {
    let sections = shell::run(shell::command("arm-none-eabi-size").arg("-A").arg(elf))?;
    let (start, length) = sections
        .lines()
        .find_map(code)
        .context("the section .text")?;
    let addresses = target_dir().join("addresses.txt");
    let list: String = (start..start + length)
        .step_by(2)
        .map(|address| format!("{address:#x}\n"))
        .collect();
    fs::write(&addresses, list)?;
    let mut addr2line = shell::command("arm-none-eabi-addr2line");
    addr2line
        .args(["-a", "-i", "-e"])
        .arg(elf)
        .stdin(Stdio::from(fs::File::open(&addresses)?));
    let mut bytes = BTreeMap::new();
    let answer = shell::run(&mut addr2line)?;
    for frames in answer.split("0x").skip(1) {
        *bytes.entry(group(frames.lines().skip(1))).or_default() += 2;
    }
    Ok(bytes)
}

/// Start and length of the code, from a line of `size -A`.
fn code(line: &str) -> Option<(u64, u64)> {
    let mut fields = line.split_whitespace();
    (fields.next()? == ".text").then_some(())?;
    let length = fields.next()?.parse().ok()?;
    Some((fields.next()?.parse().ok()?, length))
}

/// Source file of the library, or package, that a stack of inlined lines belongs to; the innermost stands first.
fn group<'a>(frames: impl Iterator<Item = &'a str>) -> String {
    let root = format!("{}/", shell::root().display());
    let frames: Vec<&str> = frames.collect();
    let own = || {
        frames.iter().filter_map(|frame| {
            let inside = frame.strip_prefix(&root).unwrap_or(frame);
            inside.starts_with("src/").then_some(inside)
        })
    };
    // Scalars and two-word sums are everybody's: the bytes belong to who adds.
    let user = own().find(|frame| !frame.starts_with("src/linalg/"));
    let example = || frames.iter().find_map(|frame| frame.strip_prefix(&root));
    if let Some(file) = user.or_else(|| own().next()).or_else(example) {
        return file.split(':').next().unwrap_or(file).to_owned();
    }
    let innermost = frames.first().copied().unwrap_or_default();
    if let Some((_, path)) = innermost.split_once("/library/") {
        return path.split('/').next().unwrap_or(path).to_owned();
    }
    // A package lies in a directory `name-version` of the registry.
    let package = innermost.split('/').find(|part| {
        part.rsplit_once('-')
            .is_some_and(|(_, version)| version.starts_with(|c: char| c.is_ascii_digit()))
            && part.contains('.')
            && !part.contains("index")
    });
    match package.and_then(|part| part.rsplit_once('-')) {
        Some((name, _)) => name.to_owned(),
        None => "assembly and unknown".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inlined_code_belongs_to_the_line_of_the_library_that_led_to_it() {
        let root = shell::root().display();
        let frames = format!("/usr/lib/rustlib/src/rust/library/core/src/ops/arith.rs:9\n{root}/src/nav.rs:70\n{root}/examples/bench.rs:1");
        assert_eq!(group(frames.lines()), "src/nav.rs");
        let frames = format!("{root}/src/linalg/two.rs:9\n{root}/src/covariance/structured.rs:70");
        assert_eq!(group(frames.lines()), "src/covariance/structured.rs");
        assert_eq!(
            group("/usr/lib/rustlib/src/rust/library/core/src/fmt/num.rs:9".lines()),
            "core"
        );
        assert_eq!(
            group("/home/a/registry/src/x/libm-0.2.16/src/math/sinf.rs:3".lines()),
            "libm"
        );
        assert_eq!(group("??:0".lines()), "assembly and unknown");
        assert_eq!(
            code(".text              104076        1024"),
            Some((1024, 104_076))
        );
    }
}
