//! A firmware in QEMU: a Cortex-M4F (machine `mps2-an386`) whose output comes by semihosting.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{bail, Context, Result};

use crate::packages;
use crate::shell;
use crate::toolchain::{target_dir, Toolchain, THUMBV7EM};

/// The emulated machine, and the core it has.
pub const MACHINE: &str = "mps2-an386";
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
            profile: "firmware",
            cpu: "",
            features: "",
            rustc: &[],
        }
    }

    /// Builds it for the Cortex-M4F and returns the ELF file.
    pub fn elf(&self, toolchain: &Toolchain) -> Result<PathBuf> {
        let mut cargo = toolchain.cargo("rustc");
        // A directory for each kind of build: they do not wait for each other, and a change of flag rebuilds nothing.
        let out = target_dir().join(format!("{}{}", self.profile, self.cpu));
        cargo.env("CARGO_TARGET_DIR", &out);
        if !self.cpu.is_empty() {
            let flag = format!("target.{THUMBV7EM}.rustflags=['-Ctarget-cpu={}']", self.cpu);
            cargo.args(["--config", &flag]);
        }
        cargo.args([
            "--package",
            "navsight",
            "--example",
            self.example,
            "--features",
            self.features,
        ]);
        cargo
            .args(["--target", THUMBV7EM, "--profile", self.profile, "--"])
            .args(self.rustc);
        shell::run(&mut cargo)
            .with_context(|| format!("firmware `{}`, profile {}", self.example, self.profile))?;
        Ok(out
            .join(THUMBV7EM)
            .join(self.profile)
            .join("examples")
            .join(self.example))
    }
}

/// Runs a firmware to its end and returns what it printed.
pub fn run(elf: &Path, plugin: Option<&str>) -> Result<String> {
    run_on(MACHINE, elf, plugin)
}

/// The same on another machine with flash at 0 and RAM at 0x2000_0000.
pub fn run_on(machine: &str, elf: &Path, plugin: Option<&str>) -> Result<String> {
    let mut qemu = shell::command(packages::QEMU.program);
    qemu.args([
        "-machine", machine, "-display", "none", "-monitor", "none", "-serial", "none",
    ]);
    qemu.args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(elf);
    if let Some(plugin) = plugin {
        qemu.args(["-plugin", plugin]);
    }
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
