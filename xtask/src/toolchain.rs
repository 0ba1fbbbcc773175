//! Which Rust toolchain builds for the bare targets.
//!
//! Two routes lead there. Where rustup offers the targets, they are added to the active toolchain. Where it does not, `core`
//! is built once from Debian's Rust packages and linked into rustup as toolchain `thumb` (see [`crate::debian`]).
//! They are tried in this order: targets already in the active toolchain; toolchain `thumb` already linked and
//! complete; `rustup target add`, unless `NAVSIGHT_TOOLCHAIN=debian` is set or it does not finish in 20 s; Debian.

use std::fmt;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use anyhow::{Context, Result};

use crate::{debian, shell};

/// Cortex-M0 and M0+.
pub const THUMBV6M: &str = "thumbv6m-none-eabi";
/// Cortex-M4F and M7F: the firmware examples run here.
pub const THUMBV7EM: &str = "thumbv7em-none-eabihf";
/// Cortex-M33 and M55.
pub const THUMBV8M: &str = "thumbv8m.main-none-eabihf";
/// A 32-bit RISC-V microcontroller.
pub const RISCV32: &str = "riscv32imac-unknown-none-elf";

/// Every bare target that the library has to build for.
pub const TARGETS: [&str; 4] = [THUMBV6M, THUMBV7EM, THUMBV8M, RISCV32];

/// A toolchain that has all of [`TARGETS`].
pub struct Toolchain {
    /// Name in rustup; `None` for the active one.
    name: Option<&'static str>,
    /// `release` of `rustc -vV`, such as 1.96.0: what an instruction budget holds for.
    pub release: String,
    /// LLVM version of `rustc -vV`.
    pub llvm: String,
}

impl fmt::Display for Toolchain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.name.unwrap_or("active");
        write!(
            f,
            "toolchain `{name}`, rustc {}, LLVM {}",
            self.release, self.llvm
        )
    }
}

impl Toolchain {
    fn open(name: Option<&'static str>) -> Result<Self> {
        let verbose = shell::run(rust(name, "rustc").arg("-vV"))?;
        let field = |key: &str| {
            let line = verbose.lines().find_map(|line| line.strip_prefix(key));
            line.map(|value| value.trim().to_owned())
                .with_context(|| format!("`rustc -vV` has no `{key}`"))
        };
        Ok(Self {
            name,
            release: field("release:")?,
            llvm: field("LLVM version:")?,
        })
    }

    /// `cargo SUBCOMMAND` of this toolchain, with its own target directory.
    pub fn cargo(&self, subcommand: &str) -> Command {
        let mut command = rust(self.name, "cargo");
        command
            .arg(subcommand)
            .env("CARGO_TARGET_DIR", target_dir());
        command
    }
}

/// Where firmware and bare builds go. Apart from the host's, so that it can be dropped when the toolchain was rebuilt.
pub fn target_dir() -> std::path::PathBuf {
    shell::root().join("target").join("bare")
}

/// Finds a toolchain with all bare targets, or makes one.
pub fn ready() -> Result<Toolchain> {
    if has_targets(None) {
        return Toolchain::open(None);
    }
    if has_targets(Some(debian::NAME)) && debian::current() {
        drop_stale_builds()?;
        return Toolchain::open(Some(debian::NAME));
    }
    let debian_wanted = std::env::var("NAVSIGHT_TOOLCHAIN").is_ok_and(|route| route == "debian");
    if !debian_wanted && rustup_adds_targets() {
        return Toolchain::open(None);
    }
    debian::build(&TARGETS).context("bare-metal toolchain from Debian packages")?;
    drop_stale_builds()?;
    Toolchain::open(Some(debian::NAME))
}

/// A Rust program of a toolchain.
fn rust(name: Option<&str>, program: &str) -> Command {
    match name {
        None => shell::command(program),
        Some(name) => {
            let mut command = shell::command("rustup");
            command.args(["run", name, program]);
            command
        }
    }
}

fn has_targets(name: Option<&str>) -> bool {
    let Ok(sysroot) = shell::run(rust(name, "rustc").args(["--print", "sysroot"])) else {
        return false;
    };
    TARGETS
        .iter()
        .all(|target| has_core(Path::new(sysroot.trim()), target))
}

/// Whether a sysroot holds `core` for a target.
pub fn has_core(sysroot: &Path, target: &str) -> bool {
    let lib = sysroot.join("lib/rustlib").join(target).join("lib");
    lib.read_dir().is_ok_and(|mut files| {
        files.any(|file| {
            file.is_ok_and(|file| file.file_name().to_string_lossy().starts_with("libcore-"))
        })
    })
}

fn rustup_adds_targets() -> bool {
    eprintln!("asking rustup for the bare-metal targets");
    let mut command = shell::command("rustup");
    command.args(["target", "add"]).args(TARGETS);
    shell::output(&mut command, Some(Duration::from_secs(20)))
        .is_ok_and(|output| output.status.success())
        && has_targets(None)
}

/// Cargo does not notice that `core` was built anew, and would link the old one.
fn drop_stale_builds() -> Result<()> {
    let stamp = target_dir().join("sysroot-stamp");
    let now = debian::stamp()?;
    if std::fs::read_to_string(&stamp).is_ok_and(|then| then == now) {
        return Ok(());
    }
    if target_dir().exists() {
        std::fs::remove_dir_all(target_dir())?;
    }
    std::fs::create_dir_all(target_dir())?;
    std::fs::write(stamp, now)?;
    Ok(())
}
