//! `cargo xtask bench --histogram`: where the executed instructions of a piece of work lie, by function and by kind.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{bail, Context, Result};

use super::is_recorded;
use super::measure::{self, PLAIN};
use super::table::{grouped, record_in};
use crate::places::{self, Frame};
use crate::toolchain::{self, target_dir};
use crate::{qemu, shell};

/// What docs/performance.md shows.
const WORKS: [&str; 4] = [
    "covariance propagation",
    "one-row update with ξ1 and ξ2",
    "three-row velocity update with ξ1 and ξ2",
    "six-row fix on a lever arm, rows formed, with ξ1 and ξ2",
];

/// A function with less than this part of the work goes into the last line.
const SMALL_PART: f64 = 0.02;

const KINDS: [&str; 5] = [
    "loads, stores",
    "float arithmetic",
    "float moves, compares",
    "integer",
    "branches",
];

/// Times an address was executed.
type Times = BTreeMap<u64, u64>;
/// Instructions per kind.
type Counts = [u64; KINDS.len()];

/// Prints the histogram of one piece of work; without a name those of the page, and records them there.
pub fn run(work: &str) -> Result<()> {
    let toolchain = toolchain::ready()?;
    let elf = PLAIN.elf(&toolchain)?;
    let (counts, lines) = (
        target_dir().join("counts-histogram.txt"),
        target_dir().join("histogram.txt"),
    );
    let plugin = format!(
        "{},out={},where={}",
        measure::plugin()?.display(),
        counts.display(),
        lines.display()
    );
    let printed = qemu::run_on(PLAIN.machine, &elf, &["-plugin", &plugin])?;
    let executed = fs::read_to_string(lines)?;
    let kinds = kinds(&elf)?;
    let page = work.is_empty();
    let works = if page { WORKS.to_vec() } else { vec![work] };
    let mut text = format!(
        "rustc {}, Cortex-M4F, opt-level 3, no CPU flag; the few instructions of the call are among them.",
        toolchain.release
    );
    for work in works {
        let times = times_of(work, &printed, &executed)?;
        let mut functions: BTreeMap<String, Counts> = BTreeMap::new();
        for (address, frames) in places::of(&elf, times.keys().copied())? {
            let kind = kinds.get(&address).context("an address without code")?;
            let counts = functions.entry(function(&frames)).or_default();
            counts[*kind] += times.get(&address).copied().unwrap_or(0);
        }
        text += &format!("\n\n{}", table(work, functions));
    }
    println!("{text}");
    if page && is_recorded(&toolchain)? {
        record_in("docs/performance.md", "bench --histogram", &text)?;
    }
    Ok(())
}

/// What the plugin saw of the first piece of work with this name.
fn times_of(work: &str, printed: &str, executed: &str) -> Result<Times> {
    let mut rows = printed
        .lines()
        .filter_map(|line| line.strip_prefix("row\t"));
    let Some(region) = rows.position(|row| row.split('\t').next() == Some(work)) else {
        bail!("no work `{work}` in the bench; BENCHMARKS.md has the names");
    };
    let region = region.to_string();
    let mut times = Times::new();
    for line in executed.lines() {
        let mut fields = line.split(' ');
        if fields.next() == Some(&region) {
            let mut number = || -> Result<u64> { Ok(fields.next().context("a number")?.parse()?) };
            times.insert(number()?, number()?);
        }
    }
    Ok(times)
}

/// Kind of every instruction in a firmware, by address.
fn kinds(elf: &Path) -> Result<BTreeMap<u64, usize>> {
    let mut objdump = shell::command("arm-none-eabi-objdump");
    let listing = shell::run(objdump.args(["-d", "--no-show-raw-insn"]).arg(elf))?;
    Ok(listing.lines().filter_map(instruction).collect())
}

/// Address and kind, from a line of `objdump -d`.
fn instruction(line: &str) -> Option<(u64, usize)> {
    let (address, instruction) = line.split_once(":\t")?;
    let address = u64::from_str_radix(address.trim(), 16).ok()?;
    Some((address, kind(instruction.split_whitespace().next()?)))
}

/// Index into [`KINDS`].
fn kind(mnemonic: &str) -> usize {
    let base = mnemonic.split('.').next().unwrap_or_default();
    let begins = |starts: &[&str]| starts.iter().any(|start| base.starts_with(start));
    let conditions = [
        "", "eq", "ne", "cs", "cc", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le",
    ];
    let branch = |name: &str| {
        base.strip_prefix(name)
            .is_some_and(|rest| conditions.contains(&rest))
    };
    if begins(&["vldr", "vstr", "vldm", "vstm", "vpush", "vpop"]) {
        0
    } else if begins(&["vmov", "vmrs", "vmsr", "vcmp", "vcvt"]) {
        2
    } else if base.starts_with('v') {
        1
    } else if begins(&["ldr", "str", "ldm", "stm", "push", "pop"]) {
        0
    } else if begins(&["cbz", "cbnz", "tbb", "tbh"])
        || ["b", "bl", "bx", "blx"].iter().any(|name| branch(name))
    {
        4
    } else {
        3
    }
}

/// Function of the library that an instruction belongs to, or the package it comes from.
fn function(frames: &[Frame]) -> String {
    match places::owner(frames) {
        Some(frame) => format!("`{}`", short(&frame.function)),
        None => {
            let place = frames.first().map_or("", |frame| frame.place.as_str());
            places::package(place).unwrap_or("the bench").to_owned()
        }
    }
}

/// `navsight::covariance::swift::sweep<f32,3_usize>::{{closure}}` without parameters and closures:
/// `covariance::swift::sweep`.
fn short(function: &str) -> String {
    let mut depth = 0;
    let plain: String = function
        .chars()
        .filter(|c| {
            depth += i32::from(*c == '<');
            let outside = depth == 0;
            depth -= i32::from(*c == '>');
            outside
        })
        .collect();
    let path = plain.trim_start_matches("navsight::");
    let parts = path
        .split("::")
        .filter(|part| !part.is_empty() && !part.starts_with('{'));
    let path = parts.collect::<Vec<_>>().join("::");
    // A function of a trait stands wholly in brackets but for its name.
    match path.contains("::") || !function.starts_with('<') {
        true => path,
        false => {
            let subject = function[1..]
                .split([' ', '<', '>'])
                .next()
                .unwrap_or_default();
            format!("{}::{path}", subject.trim_start_matches("navsight::"))
        }
    }
}

fn table(work: &str, functions: BTreeMap<String, Counts>) -> String {
    let all = |counts: &Counts| counts.iter().sum::<u64>();
    let mut whole = Counts::default();
    for counts in functions.values() {
        add(&mut whole, counts);
    }
    let (mut large, small): (Vec<_>, Vec<_>) = functions
        .into_iter()
        .partition(|(_, counts)| all(counts) as f64 >= SMALL_PART * all(&whole) as f64);
    large.sort_by_key(|(_, counts)| std::cmp::Reverse(all(counts)));
    let mut rest = Counts::default();
    for (_, counts) in &small {
        add(&mut rest, counts);
    }
    large.push((format!("{} more", small.len()), rest));
    large.push(("**all**".to_owned(), whole));
    let mut text = format!(
        "| {work} | all | {} |\n|---|{}",
        KINDS.join(" | "),
        "---|".repeat(6)
    );
    for (name, counts) in large {
        let cells = counts.map(grouped).join(" | ");
        text += &format!("\n| {name} | {} | {cells} |", grouped(all(&counts)));
    }
    text
}

fn add(sum: &mut Counts, counts: &Counts) {
    for (sum, count) in sum.iter_mut().zip(counts) {
        *sum += count;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instructions_have_kinds() {
        let kinds = |names: &[&str]| names.iter().map(|name| kind(name)).collect::<Vec<_>>();
        assert_eq!(
            kinds(&["vldr", "vstmia", "ldrd", "str.w", "push", "vldrls"]),
            [0; 6]
        );
        assert_eq!(
            kinds(&["vadd.f32", "vmla.f32", "vdiv.f32", "vneg.f32", "vabs.f32"]),
            [1; 5]
        );
        assert_eq!(
            kinds(&["vmov.f32", "vcmp.f32", "vmrs", "vmovgt.f32"]),
            [2; 4]
        );
        assert_eq!(
            kinds(&["mov", "bic.w", "bfi", "it", "lsls", "subs", "adds"]),
            [3; 7]
        );
        assert_eq!(
            kinds(&["b.n", "bl", "bx", "bls.n", "blt.w", "cbz", "beq.w", "tbb"]),
            [4; 8]
        );
        assert_eq!(instruction("     400:\tvldr\ts0, [r0]"), Some((0x400, 0)));
        assert_eq!(instruction("00000400 <Reset>:"), None);
    }

    #[test]
    fn times_are_those_of_the_named_work() {
        let printed = "row\tempty\t\t0\t4\nrow\tstep\tf32\t0\t4\nrow\tstep\tf64\t0\t4\n";
        let executed = "0 1024 1\n1 1024 2\n1 1026 3\n2 1024 4\n";
        let times = times_of("step", printed, executed).unwrap();
        assert_eq!(
            times.into_iter().collect::<Vec<_>>(),
            [(1024, 2), (1026, 3)]
        );
        assert!(times_of("stop", printed, executed).is_err());
    }

    #[test]
    fn functions_are_named_without_their_parameters() {
        assert_eq!(
            short("navsight::covariance::swift::sweep<f32,3_usize>::{{closure}}"),
            "covariance::swift::sweep"
        );
        assert_eq!(
            short("navsight::observability::diagonal::Xi<f32,15_usize>::of"),
            "observability::diagonal::Xi::of"
        );
        assert_eq!(
            short("<navsight::attitude::frames::RfuToEnu as core::convert::From<navsight::attitude::Euler>>::from"),
            "attitude::frames::RfuToEnu::from"
        );
    }

    #[test]
    fn small_parts_are_summed_and_nothing_is_lost() {
        let counts = |n: u64| [n, 0, 0, 0, n];
        let functions =
            [("`a`", 490), ("`b`", 9), ("`c`", 1)].map(|(name, n)| (name.to_owned(), counts(n)));
        let text = table("step", functions.into());
        let lines: Vec<&str> = text.lines().skip(2).collect();
        assert_eq!(
            lines,
            [
                "| `a` | 980 | 490 | 0 | 0 | 0 | 490 |",
                "| 2 more | 20 | 10 | 0 | 0 | 0 | 10 |",
                "| **all** | 1,000 | 500 | 0 | 0 | 0 | 500 |"
            ]
        );
    }
}
