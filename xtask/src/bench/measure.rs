//! Counting: the bench firmware in QEMU with a plugin that sees every instruction and every store.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{bail, Context, Result};
use serde::Serialize;

use crate::packages::{self, GCC, QEMU};
use crate::qemu::{self, Build};
use crate::shell;
use crate::toolchain::{target_dir, Toolchain};

/// One build of the bench firmware.
pub struct Firmware {
    pub profile: &'static str,
    pub opt: &'static str,
    /// Value of `-C target-cpu`, or empty.
    pub cpu: &'static str,
}

/// What a user gets who sets nothing.
pub const PLAIN: Firmware = Firmware {
    profile: "firmware",
    opt: "3",
    cpu: "",
};

/// Every build that is measured.
pub const FIRMWARES: [Firmware; 4] = [
    PLAIN,
    Firmware {
        profile: "firmware",
        opt: "3",
        cpu: "cortex-m4",
    },
    Firmware {
        profile: "firmware-s",
        opt: "s",
        cpu: "",
    },
    Firmware {
        profile: "firmware-s",
        opt: "s",
        cpu: "cortex-m4",
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

/// The core of the emulated machine.
pub const CORE: &str = "Cortex-M4F";

impl Firmware {
    /// Builds and runs it with the counting plugin.
    pub fn rows(&self, toolchain: &Toolchain, plugin: &Path) -> Result<Vec<Row>> {
        self.rows_of("bench", qemu::MACHINE, toolchain, plugin)
    }

    /// The same of another example and another machine.
    pub fn rows_of(
        &self,
        example: &str,
        machine: &str,
        toolchain: &Toolchain,
        plugin: &Path,
    ) -> Result<Vec<Row>> {
        let elf = self.elf(example, toolchain)?;
        let counts =
            target_dir().join(format!("counts-{example}-{}{}.txt", self.profile, self.cpu));
        let printed = qemu::run_on(
            machine,
            &elf,
            Some(&format!("{},out={}", plugin.display(), counts.display())),
        )?;
        self.pair(&printed, &fs::read_to_string(counts)?)
    }

    /// Name and bytes of the states, as the firmware prints them.
    pub fn ram(&self, toolchain: &Toolchain) -> Result<Vec<(String, u64)>> {
        let printed = qemu::run(&self.elf("bench", toolchain)?, None)?;
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

    /// Builds it.
    pub fn elf(&self, example: &str, toolchain: &Toolchain) -> Result<PathBuf> {
        packages::ready(&[QEMU])?;
        Build {
            profile: self.profile,
            cpu: self.cpu,
            ..Build::plain(example)
        }
        .elf(toolchain)
    }

    /// Joins the names that the firmware printed with the regions that the plugin counted, both in order.
    fn pair(&self, printed: &str, counts: &str) -> Result<Vec<Row>> {
        let names: Vec<&str> = printed
            .lines()
            .filter_map(|line| line.strip_prefix("row\t"))
            .collect();
        let counts: Vec<(u64, u64)> = counts.lines().map(count).collect::<Result<_>>()?;
        if names.len() != counts.len() {
            bail!("{} rows printed, {} counted", names.len(), counts.len());
        }
        let [empty, calibration, ..] = counts[..] else {
            bail!("no calibration in {printed}");
        };
        if calibration != (empty.0 + 103, empty.1 + 64) {
            bail!("103 instructions and 64 bytes were counted as {calibration:?} less {empty:?}");
        }
        let mut rows: Vec<Row> = Vec::new();
        for (name, (instructions, stack_bytes)) in names.iter().zip(&counts).skip(2) {
            let (work, scalar) = name.split_once('\t').context("a line `row`")?;
            if let Some(slice) = rows
                .iter_mut()
                .find(|row| row.work == work && row.scalar == scalar)
            {
                // slices of one work: the dearest counts
                slice.instructions = slice.instructions.max(instructions - empty.0);
                slice.stack_bytes = slice.stack_bytes.max(*stack_bytes);
                continue;
            }
            rows.push(Row {
                work: work.to_owned(),
                core: CORE,
                opt: self.opt,
                cpu_flag: if self.cpu.is_empty() {
                    String::new()
                } else {
                    format!("-C target-cpu={}", self.cpu)
                },
                scalar: scalar.to_owned(),
                instructions: instructions - empty.0,
                stack_bytes: *stack_bytes,
            });
        }
        Ok(rows)
    }
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

    const PRINTED: &str = "row\tempty\t\nrow\tcalibration\t\nrow\tstep\tf32\nram\tFilter\t100\n";

    #[test]
    fn names_and_counts_are_joined_and_the_frame_is_taken_off() {
        let rows = PLAIN.pair(PRINTED, "5 0\n108 64\n1005 320\n").unwrap();
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
        let printed = format!("{PRINTED}row\tstep\tf32\nrow\tstep\tf64\n");
        let rows = PLAIN
            .pair(&printed, "5 0\n108 64\n1005 320\n2005 64\n7 0\n")
            .unwrap();
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
