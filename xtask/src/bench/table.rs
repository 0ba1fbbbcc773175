//! The counts as a table: on the terminal, and in BENCHMARKS.md between two marks.

use std::fmt::Write as _;
use std::fs;

use anyhow::{Context, Result};

use super::measure::{Firmware, Row, FIRMWARES, PLAIN};
use super::Measured;
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
        for build in &FIRMWARES {
            text += &column(rows, build, first);
        }
    }
    text
}

/// The cell of one build in the line of this work.
pub fn column(rows: &[Row], build: &Firmware, of: &Row) -> String {
    let cell = rows.iter().find(|row| {
        let same_build = row.core == build.machine.core
            && row.opt == build.opt
            && row.cpu_flag.ends_with(build.cpu)
            && row.cpu_flag.is_empty() == build.cpu.is_empty();
        same_build && row.work == of.work && row.scalar == of.scalar
    });
    cell.map_or_else(
        || " |".to_owned(),
        |cell| {
            let (instructions, stack) = (grouped(cell.instructions), grouped(cell.stack_bytes));
            format!(" {instructions} / {stack} |")
        },
    )
}

/// The states as a table.
pub fn ram(states: &[(String, u64)]) -> String {
    let mut text = String::from("| state | bytes |\n|---|---|");
    for (name, bytes) in states {
        write!(text, "\n| `{name}` | {} |", grouped(*bytes)).unwrap_or_default();
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
pub fn write(toolchain: &Toolchain, measured: &Measured) -> Result<()> {
    let set_up = format!(
        "rustc {}, LLVM {}, profile `firmware` (fat LTO, one codegen unit); {}, QEMU {} `{}`.\n\
         Each cell: instructions / bytes of stack.",
        toolchain.release,
        toolchain.llvm,
        qemu::M4F.core,
        qemu::version()?,
        qemu::M4F.name
    );
    let (rows, states) = (text(&measured.rows), ram(&measured.states));
    let heading = "RAM of each state, and of what is handed over [bytes]:";
    record(
        "bench",
        &format!("{set_up}\n\n{rows}\n\n{heading}\n\n{states}"),
    )
}

/// Replaces the part of BENCHMARKS.md that a command measures.
pub fn record(command: &str, measured: &str) -> Result<()> {
    record_in("BENCHMARKS.md", command, measured)
}

/// The same in another page.
pub fn record_in(page: &str, command: &str, measured: &str) -> Result<()> {
    let file = shell::root().join(page);
    let old = fs::read_to_string(&file)?;
    let (before, _, after) = section(&old, command).with_context(|| page.to_owned())?;
    let new = format!("{before}\n{measured}\n\n{after}");
    if new != old {
        fs::write(file, new)?;
    }
    Ok(())
}

/// A page before, between and after the marks of a command; the marks stand in the first and the last part.
pub fn section<'a>(page: &'a str, command: &str) -> Result<(&'a str, &'a str, &'a str)> {
    let mark = |place| format!("<!-- written by `cargo xtask {command}`: {place} -->\n");
    let (begin, end) = (mark("begin"), mark("end"));
    let first = page.find(&begin).context("the first mark")? + begin.len();
    let (before, rest) = page.split_at(first);
    let last = rest.find(&end).context("the last mark")?;
    let (between, after) = rest.split_at(last);
    Ok((before, between.trim(), after))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_section_of_a_command_lies_between_its_marks() {
        let page = "a\n<!-- written by `cargo xtask x`: begin -->\n\nb\n\n<!-- written by `cargo xtask x`: end -->\nc\n";
        let (before, between, after) = section(page, "x").unwrap();
        assert!(before.starts_with("a\n<!--") && before.ends_with("begin -->\n"));
        assert_eq!(between, "b");
        assert!(after.starts_with("<!--") && after.ends_with("-->\nc\n"));
        assert!(section(page, "y").is_err());
    }

    #[test]
    fn thousands_are_grouped() {
        assert_eq!(
            [grouped(7), grouped(999), grouped(1000), grouped(1_234_567)],
            ["7", "999", "1,000", "1,234,567"]
        );
    }
}
