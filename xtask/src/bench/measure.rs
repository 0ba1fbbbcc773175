//! Counting: the bench firmware in QEMU with a plugin that sees every instruction and every store.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail, Context, Result};
use serde::Serialize;

use super::cross;
use crate::packages::{self, GCC, QEMU, QEMU_USER};
use crate::qemu::{self, Build, Machine};
use crate::shell;
use crate::toolchain::{target_dir, Toolchain};

/// One build of a firmware that counts.
#[derive(Clone, Copy)]
pub struct Firmware {
    pub machine: Machine,
    pub example: &'static str,
    pub profile: &'static str,
    pub opt: &'static str,
    /// Value of `-C target-cpu`, or empty.
    pub cpu: &'static str,
}

/// What a user gets who sets nothing.
pub const PLAIN: Firmware = Firmware {
    machine: qemu::M4F,
    example: "bench",
    profile: "firmware",
    opt: "3",
    cpu: "",
};

/// The same for users who choose size.
pub const SMALL: Firmware = Firmware {
    profile: "firmware-s",
    opt: "s",
    ..PLAIN
};

/// And as small as can be.
pub const SMALLEST: Firmware = Firmware {
    profile: "firmware-z",
    opt: "z",
    ..PLAIN
};

/// Every build that has budgets.
pub const FIRMWARES: [Firmware; 4] = [
    PLAIN,
    Firmware {
        cpu: "cortex-m4",
        ..PLAIN
    },
    SMALL,
    Firmware {
        cpu: "cortex-m4",
        ..SMALL
    },
];

/// What one piece of work costs in one build.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub work: String,
    pub core: &'static str,
    pub opt: &'static str,
    pub cpu_flag: String,
    pub scalar: String,
    pub instructions: u64,
    pub stack_bytes: u64,
}

/// What one run of a firmware says.
pub struct Counted {
    pub rows: Vec<Row>,
    /// Every marked piece of work, in order.
    pub regions: Vec<Region>,
    /// Name and bytes of the states.
    pub states: Vec<(String, u64)>,
}

/// One marked piece of work: what the plugin counted, and what the firmware itself saw.
pub struct Region {
    pub work: String,
    pub scalar: String,
    pub instructions: u64,
    pub stack_bytes: u64,
    /// How far down the painted stack was written [bytes].
    pub painted: u64,
}

impl Firmware {
    /// Builds and runs it with the counting plugin.
    pub fn count(&self, toolchain: &Toolchain, plugin: &Path) -> Result<Counted> {
        let elf = self.elf(toolchain)?;
        let name = format!(
            "counts-{}-{}-{}{}.txt",
            self.example, self.machine.name, self.profile, self.cpu
        );
        let counts = target_dir().join(name);
        let plugin = format!("{},out={}", plugin.display(), counts.display());
        let printed = qemu::run_on(self.machine, &elf, &["-plugin", &plugin])?;
        let counted = self.pair(&printed, &fs::read_to_string(counts)?)?;
        cross::painted(&counted.regions)?;
        Ok(counted)
    }

    /// Counts it on the host, where there is a plugin but neither timer nor paint; nothing on other hosts than x86-64.
    pub fn count_on_pc(&self, toolchain: &Toolchain, plugin: &Path) -> Result<Vec<Row>> {
        if !cfg!(target_arch = "x86_64") {
            eprintln!("no counts on the host: it is no x86-64");
            return Ok(Vec::new());
        }
        packages::ready(&[QEMU_USER])?;
        let out = target_dir().join("host");
        let mut cargo = toolchain.cargo("build");
        cargo.env("CARGO_TARGET_DIR", &out).args([
            "--package",
            "navsight",
            "--example",
            self.example,
            "--profile",
            self.profile,
        ]);
        shell::run(&mut cargo)?;
        let program = out.join(self.profile).join("examples").join(self.example);
        let counts = target_dir().join("counts-host.txt");
        let plugin = format!("{},out={}", plugin.display(), counts.display());
        // The processor that everybody has: a copy of memory takes the same way on every machine.
        let mut qemu = shell::command(QEMU_USER.program);
        qemu.args(["-cpu", "qemu64", "-plugin", &plugin])
            .arg(program);
        let printed = shell::run(&mut qemu)?;
        Ok(self.pair(&printed, &fs::read_to_string(counts)?)?.rows)
    }

    /// Runs it with the timer counting instructions, without the plugin.
    pub fn timed(&self, toolchain: &Toolchain) -> Result<Vec<u64>> {
        let printed = qemu::run_on(self.machine, &self.elf(toolchain)?, &cross::ICOUNT)?;
        let lines = printed.lines().filter_map(Line::read);
        lines.map(|line| Ok(line?.ticks)).collect()
    }

    /// Builds it.
    pub fn elf(&self, toolchain: &Toolchain) -> Result<PathBuf> {
        packages::ready(&[QEMU])?;
        Build {
            machine: self.machine,
            profile: self.profile,
            cpu: self.cpu,
            ..Build::plain(self.example)
        }
        .elf(toolchain)
    }

    /// Joins the names that the firmware printed with the regions that the plugin counted, both in order.
    fn pair(&self, printed: &str, counts: &str) -> Result<Counted> {
        let lines: Vec<Line> = printed
            .lines()
            .filter_map(Line::read)
            .collect::<Result<_>>()?;
        let counts: Vec<(u64, u64)> = counts.lines().map(count).collect::<Result<_>>()?;
        if lines.len() != counts.len() {
            bail!("{} rows printed, {} counted", lines.len(), counts.len());
        }
        let [empty, calibration, ..] = counts[..] else {
            bail!("no calibration in {printed}");
        };
        if calibration != (empty.0 + 103, empty.1 + 64) {
            bail!("103 instructions and 64 bytes were counted as {calibration:?} less {empty:?}");
        }
        let regions = lines.iter().zip(&counts).map(|(line, counts)| Region {
            work: line.work.to_owned(),
            scalar: line.scalar.to_owned(),
            instructions: counts.0.saturating_sub(empty.0),
            stack_bytes: counts.1,
            painted: line.painted,
        });
        let regions: Vec<Region> = regions.collect();
        let mut rows: Vec<Row> = Vec::new();
        for region in regions.iter().skip(2) {
            if let Some(slice) = rows
                .iter_mut()
                .find(|row| row.work == region.work && row.scalar == region.scalar)
            {
                // slices of one work: the dearest counts
                slice.instructions = slice.instructions.max(region.instructions);
                slice.stack_bytes = slice.stack_bytes.max(region.stack_bytes);
                continue;
            }
            rows.push(Row {
                work: region.work.clone(),
                core: self.machine.core,
                opt: self.opt,
                cpu_flag: if self.cpu.is_empty() {
                    String::new()
                } else {
                    format!("-C target-cpu={}", self.cpu)
                },
                scalar: region.scalar.clone(),
                instructions: region.instructions,
                stack_bytes: region.stack_bytes,
            });
        }
        Ok(Counted {
            rows,
            regions,
            states: states(printed)?,
        })
    }
}

/// A line `row` of a firmware.
struct Line<'a> {
    work: &'a str,
    scalar: &'a str,
    /// How far SysTick went on, modulo 2²⁴.
    ticks: u64,
    painted: u64,
}

impl<'a> Line<'a> {
    fn read(line: &'a str) -> Option<Result<Self>> {
        let fields: Vec<&str> = line.strip_prefix("row\t")?.split('\t').collect();
        let [work, scalar, ticks, painted] = fields[..] else {
            return Some(Err(anyhow!("the line `{line}`")));
        };
        let numbers = || Ok((ticks.parse()?, painted.parse()?));
        Some(numbers().map(|(ticks, painted)| Self {
            work,
            scalar,
            ticks,
            painted,
        }))
    }
}

/// Name and bytes of the states, as the firmware prints them.
fn states(printed: &str) -> Result<Vec<(String, u64)>> {
    let mut states = Vec::new();
    for line in printed
        .lines()
        .filter_map(|line| line.strip_prefix("ram\t"))
    {
        let (name, bytes) = line.split_once('\t').context("a line `ram`")?;
        states.push((name.to_owned(), bytes.parse()?));
    }
    Ok(states)
}

/// `<instructions> <stack bytes>`, as the plugin writes a region.
pub fn count(line: &str) -> Result<(u64, u64)> {
    let (instructions, stack) = line.split_once(' ').context("a line of the plugin")?;
    Ok((instructions.parse()?, stack.parse()?))
}

/// Builds the plugin.
pub fn plugin() -> Result<PathBuf> {
    packages::ready(&[QEMU, GCC])?;
    let api = api(&qemu::version()?);
    let plugin = target_dir().join(format!("insnprobe-{api}.so"));
    fs::create_dir_all(target_dir())?;
    let mut gcc = shell::command(GCC.program);
    gcc.args([
        "-O2",
        "-shared",
        "-fPIC",
        &format!("-DQEMU_API={api}"),
        "-o",
    ])
    .arg(&plugin);
    shell::run(gcc.arg(shell::root().join("xtask/probe/insnprobe.c")))?;
    Ok(plugin)
}

/// Version of the plugin interface that a QEMU accepts.
fn api(version: &str) -> u32 {
    let mut numbers = version.split('.').map(|number| number.parse().unwrap_or(0));
    match (
        numbers.next().unwrap_or(0u32),
        numbers.next().unwrap_or(0u32),
    ) {
        (..=8, _) => 1,
        (9, 0) => 2,
        _ => 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRINTED: &str =
        "row\tempty\t\t0\t4\nrow\tcalibration\t\t0\t64\nrow\tstep\tf32\t7\t320\nram\tFilter\t100\n";

    #[test]
    fn names_and_counts_are_joined_and_the_frame_is_taken_off() {
        let counted = PLAIN.pair(PRINTED, "5 0\n108 64\n1005 320\n").unwrap();
        assert_eq!(counted.states, [("Filter".to_owned(), 100)]);
        assert_eq!(counted.regions[2].painted, 320);
        let rows = counted.rows;
        assert_eq!(rows.len(), 1);
        assert_eq!(
            (
                rows[0].work.as_str(),
                rows[0].instructions,
                rows[0].stack_bytes
            ),
            ("step", 1000, 320)
        );
    }

    #[test]
    fn of_the_slices_of_one_work_the_dearest_is_shown() {
        let printed = format!("{PRINTED}row\tstep\tf32\t0\t64\nrow\tstep\tf64\t0\t4\n");
        let rows = PLAIN
            .pair(&printed, "5 0\n108 64\n1005 320\n2005 64\n7 0\n")
            .unwrap()
            .rows;
        let counts: Vec<_> = rows
            .iter()
            .map(|r| (r.instructions, r.stack_bytes))
            .collect();
        assert_eq!(counts, [(2000, 320), (2, 0)]);
    }

    #[test]
    fn a_probe_that_counts_wrongly_is_not_believed() {
        assert!(PLAIN.pair(PRINTED, "5 0\n107 64\n1005 320\n").is_err());
        assert!(PLAIN.pair(PRINTED, "5 0\n108 60\n1005 320\n").is_err());
        assert!(PLAIN.pair(PRINTED, "5 0\n108 64\n").is_err());
        let unseen = PRINTED.replace("\t7\t320", "");
        assert!(PLAIN.pair(&unseen, "5 0\n108 64\n1005 320\n").is_err());
    }

    #[test]
    fn each_qemu_gets_its_plugin_interface() {
        assert_eq!(
            [
                api("7.2.22"),
                api("8.2.2"),
                api("9.0.1"),
                api("9.1.0"),
                api("10.0.2")
            ],
            [1, 1, 2, 3, 3]
        );
    }
}
