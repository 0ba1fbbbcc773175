//! The counts as a table: on the terminal, and in BENCHMARKS.md between two marks.

use std::fmt::Write as _;
use std::fs;

use anyhow::{Context, Result};

use super::measure::{Row, CORE, FIRMWARES, PLAIN};
use crate::toolchain::Toolchain;
use crate::{qemu, shell};

/// The table as Markdown: a row per piece of work, a column per build.
pub fn text(rows: &[Row]) -> String {
    let mut text = String::from("| work | scalar |");
    for build in FIRMWARES {
        let flag = if build.cpu.is_empty() {
            String::new()
        } else {
            format!(", {}", build.cpu)
        };
        write!(text, " opt {}{flag} |", build.opt).unwrap_or_default();
    }
    text += "\n|---|---|";
    text += &"---|".repeat(FIRMWARES.len());
    for first in rows
        .iter()
        .filter(|row| row.opt == PLAIN.opt && row.cpu_flag.is_empty())
    {
        write!(text, "\n| {} | {} |", first.work, first.scalar).unwrap_or_default();
        for build in FIRMWARES {
            let cell = rows.iter().find(|row| {
                let same_build = row.opt == build.opt
                    && row.cpu_flag.ends_with(build.cpu)
                    && row.cpu_flag.is_empty() == build.cpu.is_empty();
                same_build && row.work == first.work && row.scalar == first.scalar
            });
            match cell {
                Some(cell) => write!(
                    text,
                    " {} / {} |",
                    grouped(cell.instructions),
                    grouped(cell.stack_bytes)
                ),
                None => write!(text, " |"),
            }
            .unwrap_or_default();
        }
    }
    text
}

/// 1234567 as 1,234,567.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Records the counts in BENCHMARKS.md.
pub fn write(toolchain: &Toolchain, rows: &[Row]) -> Result<()> {
    let set_up = format!(
        "rustc {}, LLVM {}, profile `firmware` (fat LTO, one codegen unit); {CORE}, QEMU {} `{}`.\n\
         Each cell: instructions / bytes of stack.",
        toolchain.release,
        toolchain.llvm,
        qemu::version()?,
        qemu::MACHINE
    );
    record("bench", &format!("{set_up}\n\n{}", text(rows)))
}

/// Replaces the part of BENCHMARKS.md that a command measures.
pub fn record(command: &str, measured: &str) -> Result<()> {
    record_in("BENCHMARKS.md", command, measured)
}

/// The same in another page.
pub fn record_in(page: &str, command: &str, measured: &str) -> Result<()> {
    let mark = |place| format!("<!-- written by `cargo xtask {command}`: {place} -->\n");
    let (begin, end) = (mark("begin"), mark("end"));
    let file = shell::root().join(page);
    let old = fs::read_to_string(&file)?;
    let (before, rest) = old
        .split_once(&begin)
        .with_context(|| format!("the first mark in {page}"))?;
    let (_, after) = rest
        .split_once(&end)
        .with_context(|| format!("the last mark in {page}"))?;
    let new = format!("{before}{begin}\n{measured}\n\n{end}{after}");
    if new != old {
        fs::write(file, new)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::grouped;

    #[test]
    fn thousands_are_grouped() {
        assert_eq!(
            [grouped(7), grouped(999), grouped(1000), grouped(1_234_567)],
            ["7", "999", "1,000", "1,234,567"]
        );
    }
}
