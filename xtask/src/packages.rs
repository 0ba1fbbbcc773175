//! Programs that come as Debian packages.

use anyhow::{bail, Context, Result};

use crate::shell;

/// A program and the Debian package that brings it.
pub struct Tool {
    pub program: &'static str,
    pub package: &'static str,
}

/// Runs the firmware.
pub const QEMU: Tool = Tool {
    program: "qemu-system-arm",
    package: "qemu-system-arm",
};
/// Runs programs of the host for their counts; only `cargo xtask bench --all` does that.
pub const QEMU_USER: Tool = Tool {
    program: "qemu-x86_64",
    package: "qemu-user",
};
/// Lists the symbols of a firmware.
pub const NM: Tool = Tool {
    program: "arm-none-eabi-nm",
    package: "binutils-arm-none-eabi",
};
/// Builds the counting plugin, and links host programs.
pub const GCC: Tool = Tool {
    program: "gcc",
    package: "gcc",
};

/// Everything that `cargo xtask test` uses, beside the Rust toolchain.
pub const ALL: [Tool; 3] = [QEMU, NM, GCC];

/// Makes sure that these programs are there.
pub fn ready(tools: &[Tool]) -> Result<()> {
    let missing: Vec<&str> = tools
        .iter()
        .filter(|tool| shell::find(tool.program).is_none())
        .map(|tool| tool.package)
        .collect();
    install(&missing)
}

/// Installs Debian packages, as root or through sudo.
pub fn install(packages: &[&str]) -> Result<()> {
    if packages.is_empty() {
        return Ok(());
    }
    let names = packages.join(" ");
    if shell::find("apt-get").is_none() {
        bail!("please install the programs of these Debian packages by hand: {names}");
    }
    eprintln!("installing Debian packages: {names}");
    let apt = |arguments: &[&str]| -> Result<String> {
        let root = shell::run(shell::command("id").arg("-u"))?.trim() == "0";
        let mut command = shell::command(if root { "apt-get" } else { "sudo" });
        if !root {
            command
                .args(["DEBIAN_FRONTEND=noninteractive", "apt-get"])
                .stdin(std::process::Stdio::inherit());
        }
        command.env("DEBIAN_FRONTEND", "noninteractive");
        // Another installation on the machine is waited for.
        shell::run(
            command
                .args(["-qq", "-o", "DPkg::Lock::Timeout=300"])
                .args(arguments),
        )
    };
    apt(&["update"]).context("the list of Debian packages")?;
    apt(&[&["install", "-y", "--no-install-recommends"], packages].concat())
        .with_context(|| format!("Debian packages {names}"))?;
    Ok(())
}
