//! A firmware in QEMU: a Cortex-M4F (machine `mps2-an386`), and other cores for counts; the output comes by semihosting.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{bail, Context, Result};

use crate::packages;
use crate::shell;
use crate::toolchain::{target_dir, Toolchain, THUMBV6M, THUMBV7EM, THUMBV8M};

/// An emulated machine.
#[derive(Clone, Copy, PartialEq)]
pub struct Machine {
    /// Its core.
    pub core: &'static str,
    /// QEMU's name of it.
    pub name: &'static str,
    target: &'static str,
    /// Where flash and RAM begin and how long they are, where `memory.x` does not say it.
    map: Option<[u32; 4]>,
}

/// Where the examples run.
pub const M4F: Machine = Machine {
    core: "Cortex-M4F",
    name: "mps2-an386",
    target: THUMBV7EM,
    map: None,
};
/// Runs the same bytes.
pub const M7: Machine = Machine {
    core: "Cortex-M7",
    name: "mps2-an500",
    ..M4F
};
/// It starts in the secure state, whose memory lies higher.
pub const M33: Machine = Machine {
    core: "Cortex-M33",
    name: "mps2-an505",
    target: THUMBV8M,
    map: Some([0x1000_0000, 0x40_0000, 0x3800_0000, 0x40_0000]),
};
/// Without a floating-point unit. QEMU's only machine with this core has 16 KiB of RAM, too little for several filters
/// side by side; a larger core executes the same bytes, so as many instructions.
pub const M0: Machine = Machine {
    core: "Cortex-M0",
    target: THUMBV6M,
    ..M4F
};

/// A 64-bit PC, emulated as a process.
pub const PC: Machine = Machine {
    core: "x86-64",
    name: "qemu-x86_64",
    target: "",
    map: None,
};

/// The longest run takes seconds; whatever needs more than this hangs.
const LIMIT: Duration = Duration::from_secs(120);

/// First line of `qemu-system-arm --version`, reduced to the version.
pub fn version() -> Result<String> {
    let text = shell::run(shell::command(packages::QEMU.program).arg("--version"))?;
    let version = text
        .split_whitespace()
        .skip_while(|word| *word != "version")
        .nth(1);
    Ok(version
        .context("version of QEMU")?
        .trim_end_matches(',')
        .to_owned())
}

/// How one example is built as firmware.
#[derive(Clone, Copy)]
pub struct Build<'a> {
    pub example: &'a str,
    pub machine: Machine,
    /// Profile: `firmware` for opt-level 3, `firmware-s` for "s".
    pub profile: &'a str,
    /// Value of `-C target-cpu`, or empty.
    pub cpu: &'a str,
    /// Features of the library, separated by commas.
    pub features: &'a str,
    /// Arguments of rustc for this crate alone.
    pub rustc: &'a [&'a str],
}

impl<'a> Build<'a> {
    /// Opt-level 3, no flags: what a user gets who sets nothing.
    pub fn plain(example: &'a str) -> Self {
        Self {
            example,
            machine: M4F,
            profile: "firmware",
            cpu: "",
            features: "",
            rustc: &[],
        }
    }

    /// Builds it for the Cortex-M4F and returns the ELF file.
    pub fn elf(&self, toolchain: &Toolchain) -> Result<PathBuf> {
        self.build(&[self.example], toolchain)?;
        Ok(self
            .out()
            .join(self.machine.target)
            .join(self.profile)
            .join("examples")
            .join(self.example))
    }

    /// Builds several examples in one call of cargo, which keeps all cores busy: the end of each build is one long run of
    /// the linker's optimiser.
    pub fn build(&self, examples: &[&str], toolchain: &Toolchain) -> Result<()> {
        let mut cargo = toolchain.cargo(if self.rustc.is_empty() {
            "build"
        } else {
            "rustc"
        });
        cargo.env("CARGO_TARGET_DIR", self.out());
        let target = self.machine.target;
        let flags = self.flags();
        if !flags.is_empty() {
            cargo.args(["--config", &format!("target.{target}.rustflags={flags:?}")]);
        }
        cargo.args(["--package", "navsight", "--features", self.features]);
        cargo.args(["--target", target, "--profile", self.profile]);
        cargo.args(examples.iter().flat_map(|example| ["--example", example]));
        if !self.rustc.is_empty() {
            cargo.arg("--").args(self.rustc);
        }
        shell::run(&mut cargo).map(drop).with_context(|| {
            let examples = examples.join("`, `");
            format!("firmware `{examples}`, profile {}", self.profile)
        })
    }

    /// What `.cargo/config.toml` does not say.
    fn flags(&self) -> Vec<String> {
        let mut flags = Vec::new();
        if !self.cpu.is_empty() {
            flags.push(format!("-Ctarget-cpu={}", self.cpu));
        }
        if self.machine.target != THUMBV7EM {
            flags.push("-Clink-arg=-Tlink.x".to_owned());
        }
        if let Some(map) = self.machine.map {
            let symbols = ["_flash", "_flash_size", "_ram", "_ram_size"];
            let places = symbols.iter().zip(map);
            flags.extend(places.map(|(name, at)| format!("-Clink-arg=--defsym={name}={at:#x}")));
        }
        flags
    }

    /// A directory for each kind of build: they do not wait for each other, and a change of flag rebuilds nothing.
    fn out(&self) -> PathBuf {
        target_dir().join(format!("{}{}", self.profile, self.cpu))
    }
}

/// Runs a firmware on the Cortex-M4F to its end and returns what it printed.
pub fn run(elf: &Path) -> Result<String> {
    run_on(M4F, elf, &[])
}

/// The same on any machine, with further arguments of QEMU.
pub fn run_on(machine: Machine, elf: &Path, arguments: &[&str]) -> Result<String> {
    let mut qemu = shell::command(packages::QEMU.program);
    qemu.args(["-machine", machine.name, "-display", "none"]);
    qemu.args(["-monitor", "none", "-serial", "none"]);
    qemu.args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(elf)
        .args(arguments);
    let output = shell::output(&mut qemu, Some(LIMIT))?;
    if !output.status.success() {
        bail!(
            "{} in QEMU: {}\n{}{}",
            elf.display(),
            output.status,
            output.stdout,
            output.stderr
        );
    }
    Ok(output.stdout)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_with_another_map_tells_the_linker() {
        assert!(Build::plain("bench").flags().is_empty());
        let build = Build {
            machine: M33,
            ..Build::plain("bench")
        };
        let flags = build.flags().join(" ");
        assert!(flags.contains("-Tlink.x"), "{flags}");
        assert!(flags.contains("--defsym=_flash=0x10000000"), "{flags}");
        assert!(flags.contains("--defsym=_ram_size=0x400000"), "{flags}");
        let build = Build {
            machine: M0,
            ..Build::plain("bench")
        };
        assert_eq!(build.flags(), ["-Clink-arg=-Tlink.x"]);
    }
}
