//! `cargo xtask size`: flash per group of functions and per room of the library, in two firmwares.
//!
//! Link-time optimisation melts functions together, so the bytes are attributed by the debug information: each pair of
//! bytes belongs to the innermost source line of the library (`linalg` aside) that led to it, whatever function it ended up in.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{bail, Context, Result};

use crate::bench::{self, grouped, is_recorded, record, PLAIN, SMALL, SMALLEST};
use crate::packages::{self, NM};
use crate::places::{self, Frame};
use crate::qemu::Build;
use crate::report::Report;
use crate::shell;
use crate::toolchain::{self, Toolchain};

/// The least that knows what it has learnt.
const LEAST: &str = "minimal";
/// A whole navigator that aligns itself and prints its ξ and η.
const WHOLE: &str = "two_position";
/// Opt-levels, by profile.
const OPTS: [(&str, &str); 3] = [
    (PLAIN.opt, PLAIN.profile),
    (SMALL.opt, SMALL.profile),
    (SMALLEST.opt, SMALLEST.profile),
];

/// What is no code.
const REST: &str = "constants and the table of vectors";

/// Bytes per name, at each opt-level.
type Bytes = BTreeMap<String, [u64; OPTS.len()]>;

/// Measures, prints and records in BENCHMARKS.md.
pub fn run() -> Result<ExitCode> {
    let toolchain = toolchain::ready()?;
    let mut text = String::new();
    for program in [LEAST, WHOLE] {
        let (mut groups, mut files) = (Bytes::new(), Bytes::new());
        for (column, (_, profile)) in OPTS.iter().enumerate() {
            let build = Build {
                profile,
                ..Build::plain(program)
            };
            let elf = build.elf(&toolchain)?;
            let mut rest = flash(&sections(&elf)?);
            for (frames, bytes) in attribute(&elf)? {
                let add =
                    |to: &mut Bytes, name: String| to.entry(name).or_default()[column] += bytes;
                add(&mut groups, group(&frames).to_owned());
                add(&mut files, file(&frames));
                rest -= bytes;
            }
            groups.entry(REST.to_owned()).or_default()[column] = rest;
        }
        text += &format!(
            "Flash of `examples/{program}.rs` [bytes]:\n\n{}\n\n",
            by_group(program, groups)
        );
        text += &format!("The same by source:\n\n{}\n\n", by_file(files));
    }
    let text = text.trim_end();
    println!("{text}");
    if is_recorded(&toolchain)? {
        record("size", text)?;
        bench::write_figures()?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Groups of functions, in the order of the table. A stack of inlined functions belongs to the first group that any of
/// them is of: `[parts of the paths]`.
const GROUPS: [(&str, &[&str]); 13] = [
    // What a program calls once, wherever the arithmetic comes from.
    (
        "start-up",
        &[
            "NavState::new",
            "Filter::new",
            "Scaling::new",
            "Settings::",
            "Prior::",
            "Geodetic::from_degrees",
            "Euler::from",
            "Euler::quaternion",
            "BiasModel::",
            "NoiseDensity::from",
            "ZeroVelocity::new",
            "::diagonal_of",
            "StandingAlignment::new",
        ],
    ),
    (
        "correction",
        &["NavState::correct", "nav::correct", "Filter::correct"],
    ),
    ("ξ", &["observability::diagonal"]),
    ("η", &["observability::"]),
    ("alignment", &["navsight::alignment::"]),
    (
        "mechanization",
        &[
            "navsight::mechanization",
            "navsight::imu",
            "NavState::",
            "navsight::earth",
            "navsight::nav",
        ],
    ),
    (
        "propagation",
        &[
            "covariance::structured",
            "error_model::",
            "Filter::synchronize",
            "Filter::propagate",
        ],
    ),
    (
        "update",
        &["covariance::", "navsight::measurement", "navsight::filter"],
    ),
    ("rest of the library", &["navsight::"]),
    ("nalgebra", &["nalgebra::", "simba::"]),
    ("libm", &["libm::"]),
    ("formatting of core", &["core::fmt", "core::num::"]),
    ("rest of core", &["core::", "compiler_builtins::"]),
];
/// Start-up of the core, semihosting and the program itself.
const PROGRAM: &str = "program and runtime";

fn group(frames: &[Frame]) -> &'static str {
    let library: Vec<&Frame> = frames
        .iter()
        .filter(|frame| places::own(frame).is_some())
        .collect();
    // What the library calls, as libm, keeps its own group unless it was inlined.
    let seen: Vec<&Frame> = if library.is_empty() {
        frames.iter().take(1).collect()
    } else {
        library
    };
    let is_of = |parts: &[&str]| {
        seen.iter()
            .any(|frame| parts.iter().any(|part| frame.function.contains(part)))
    };
    GROUPS
        .iter()
        .find(|(_, parts)| is_of(parts))
        .map_or(PROGRAM, |(name, _)| name)
}

fn by_group(program: &str, mut groups: Bytes) -> String {
    let names = GROUPS.iter().map(|(name, _)| *name);
    let names = names.chain([PROGRAM, REST]);
    let rows = names.filter_map(|name| groups.remove_entry(name));
    let mut rows: Vec<_> = rows.collect();
    let whole = sum(&rows);
    rows.push((format!("**`{program}`**"), whole));
    table("functions", rows)
}

fn by_file(files: Bytes) -> String {
    let (mut rows, mut foreign): (Vec<_>, Vec<_>) = files
        .into_iter()
        .partition(|(name, _)| name.starts_with("src/"));
    foreign.sort_by_key(|(_, bytes)| std::cmp::Reverse(bytes[0]));
    rows.push(("**the library**".to_owned(), sum(&rows)));
    rows.append(&mut foreign);
    table("source", rows)
}

fn sum(rows: &[(String, [u64; OPTS.len()])]) -> [u64; OPTS.len()] {
    let mut sum = [0; OPTS.len()];
    for (_, bytes) in rows {
        for (sum, bytes) in sum.iter_mut().zip(bytes) {
            *sum += bytes;
        }
    }
    sum
}

fn table(what: &str, rows: Vec<(String, [u64; OPTS.len()])>) -> String {
    let mut text = format!("| {what} |");
    for (opt, _) in OPTS {
        text += &format!(" opt {opt} |");
    }
    text += &format!("\n|---|{}", "---|".repeat(OPTS.len()));
    for (name, bytes) in rows {
        text += &format!("\n| {name} | {} |", bytes.map(grouped).join(" | "));
    }
    text
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
        let stacks = attribute(&Build::plain(program).elf(toolchain)?)?;
        let own = stacks
            .iter()
            .filter(|(frames, _)| OPTIONAL.iter().any(|room| file(frames).starts_with(room)));
        Ok(own.map(|(_, bytes)| bytes).sum())
    };
    report.check("flash: what is not used is not there", || {
        packages::ready(&[NM])?;
        let (without, with) = (optional(WHOLE)?, optional(USER)?);
        if without > 0 {
            bail!("{WHOLE} holds {without} bytes of ways of looking that it does not use");
        }
        if with < 1000 {
            bail!("{USER} uses them, and only {with} bytes were found");
        }
        Ok(())
    });
}

/// What the least program may take at opt-level 3: code, constants and the table of vectors.
const LEAST_FLASH: u64 = 40 * 1024;

/// The least program keeps within its flash.
pub fn least_fits(report: &mut Report, toolchain: &Toolchain) {
    report.check("flash: the least program fits into 40 KiB", || {
        packages::ready(&[NM])?;
        let flash = flash(&sections(&Build::plain(LEAST).elf(toolchain)?)?);
        if flash > LEAST_FLASH {
            bail!("{LEAST} takes {flash} bytes of flash, {LEAST_FLASH} are allowed");
        }
        Ok(())
    });
}

/// Bytes of the sections that lie in flash, from the lines of `size -A`.
fn flash(sections: &str) -> u64 {
    const STORED: [&str; 4] = [".vector_table", ".text", ".rodata", ".data"];
    let bytes = sections.lines().filter_map(|line| {
        let mut fields = line.split_whitespace();
        let stored = STORED.contains(&fields.next()?);
        let length: u64 = fields.next()?.parse().ok()?;
        stored.then_some(length)
    });
    bytes.sum()
}

/// What `size -A` prints of a firmware.
fn sections(elf: &Path) -> Result<String> {
    shell::run(shell::command("arm-none-eabi-size").arg("-A").arg(elf))
}

/// The code of a firmware, two bytes at a time, with the stack of inlined functions that they come from.
fn attribute(elf: &Path) -> Result<Vec<(Vec<Frame>, u64)>> {
    packages::ready(&[NM])?;
    let (start, length) = sections(elf)?
        .lines()
        .find_map(code)
        .context("the section .text")?;
    let stacks = places::of(elf, (start..start + length).step_by(2))?;
    Ok(stacks.into_iter().map(|(_, frames)| (frames, 2)).collect())
}

/// Start and length of the code, from a line of `size -A`.
fn code(line: &str) -> Option<(u64, u64)> {
    let mut fields = line.split_whitespace();
    (fields.next()? == ".text").then_some(())?;
    let length = fields.next()?.parse().ok()?;
    Some((fields.next()?.parse().ok()?, length))
}

/// Source file of the library or of the program, or package, that a stack of inlined functions belongs to.
fn file(frames: &[Frame]) -> String {
    if let Some(file) = places::owner(frames).and_then(places::own) {
        return file.to_owned();
    }
    let root = format!("{}/", shell::root().display());
    let program = frames
        .iter()
        .find_map(|frame| frame.place.strip_prefix(&root));
    if let Some(place) = program {
        return place.split(':').next().unwrap_or(place).to_owned();
    }
    let innermost = frames.first().map_or("", |frame| frame.place.as_str());
    places::package(innermost)
        .unwrap_or("assembly and unknown")
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stack(frames: &[(&str, &str)]) -> Vec<Frame> {
        let frame = |&(function, place): &(&str, &str)| Frame {
            function: function.to_owned(),
            place: place.replace('~', &shell::root().display().to_string()),
        };
        frames.iter().map(frame).collect()
    }

    #[test]
    fn code_belongs_to_a_group_and_a_file() {
        let sub = (
            "<f32 as core::ops::arith::Sub>::sub",
            "/x/library/core/src/ops/arith.rs:216",
        );
        let main = ("minimal::run", "~/examples/minimal.rs:19");
        let start = stack(&[
            sub,
            ("navsight::attitude::product", "~/src/attitude.rs:110"),
            ("navsight::nav::NavState::new", "~/src/nav.rs:60"),
            main,
        ]);
        assert_eq!(
            (group(&start), file(&start).as_str()),
            ("start-up", "src/attitude.rs")
        );
        let sweep = stack(&[
            ("navsight::linalg::two::add", "~/src/linalg/two.rs:9"),
            (
                "navsight::covariance::structured::rows",
                "~/src/covariance/structured.rs:70",
            ),
            (
                "navsight::filter::Filter::synchronize",
                "~/src/filter/mod.rs:7",
            ),
        ]);
        assert_eq!(
            (group(&sweep), file(&sweep).as_str()),
            ("propagation", "src/covariance/structured.rs")
        );
        let sine = stack(&[
            (
                "libm::math::k_sinf::k_sinf",
                "/r/registry/src/libm-0.2.16/src/k.rs:2",
            ),
            main,
        ]);
        assert_eq!(group(&sine), "libm");
        assert_eq!(group(&stack(&[sub])), "rest of core");
        let printed = stack(&[main]);
        assert_eq!(
            (group(&printed), file(&printed).as_str()),
            (PROGRAM, "examples/minimal.rs")
        );
        let unknown = stack(&[("Reset", "??:?")]);
        assert_eq!(
            (group(&unknown), file(&unknown).as_str()),
            (PROGRAM, "assembly and unknown")
        );
    }

    #[test]
    fn the_whole_of_a_table_is_its_sum() {
        let groups = [("libm", [1, 2, 3]), ("ξ", [1000, 0, 1])]
            .map(|(name, bytes)| (name.to_owned(), bytes));
        let text = by_group("minimal", groups.into());
        let lines: Vec<&str> = text.lines().skip(2).collect();
        assert_eq!(
            lines,
            [
                "| ξ | 1,000 | 0 | 1 |",
                "| libm | 1 | 2 | 3 |",
                "| **`minimal`** | 1,001 | 2 | 4 |"
            ]
        );
    }

    #[test]
    fn what_is_stored_is_summed() {
        let sections = "section  size  addr\n.vector_table  1024  0\n.text  39000  1024\n.rodata  700  40024\n\
                        .data  4  536870912\n.bss  900  536870916\n.debug_info  9000  0\nTotal  50628";
        assert_eq!(flash(sections), 40_728);
    }

    #[test]
    fn the_section_of_code_is_found() {
        assert_eq!(
            code(".text              104076        1024"),
            Some((1024, 104_076))
        );
    }
}
