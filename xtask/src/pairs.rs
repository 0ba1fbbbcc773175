//! Every example runs on the host and in QEMU from one file, and both have to print the same bytes.

use std::fs;

use anyhow::{bail, Context, Result};

use crate::qemu::{self, Build};
use crate::report::Report;
use crate::toolchain::Toolchain;
use crate::{packages, shell};

/// Names of the examples that run on both machines: those with a function `run`.
pub fn names() -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(shell::root().join("examples"))? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "rs")
            && is_paired(&fs::read_to_string(&path)?)
        {
            names.extend(
                path.file_stem()
                    .map(|stem| stem.to_string_lossy().into_owned()),
            );
        }
    }
    names.sort();
    Ok(names)
}

fn is_paired(source: &str) -> bool {
    source.contains("\nfn run(out: &mut impl ")
}

/// Builds and runs every pair.
pub fn compare(report: &mut Report, toolchain: &Toolchain) -> Result<()> {
    packages::ready(&[packages::QEMU])?;
    let names = names()?;
    report.check("examples: build on the host and as firmware", || {
        on_the_host()?;
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        Build::plain("").build(&names, toolchain)
    });
    for name in names {
        report.check(
            &format!("example `{name}`: QEMU prints what the host prints"),
            || {
                let host = shell::run(&mut shell::command(
                    shell::target_dir().join("debug/examples").join(&name),
                ))?;
                let target = qemu::run(&Build::plain(&name).elf(toolchain)?)?;
                same(&host, &target)
            },
        );
    }
    Ok(())
}

/// Builds the examples as `cargo test` does, so that after it nothing is left to build.
fn on_the_host() -> Result<()> {
    let mut cargo = shell::command("cargo");
    cargo.args(["build", "--quiet", "--profile", "test", "--workspace"]);
    shell::run(cargo.args(["--exclude", "xtask", "--examples"])).map(drop)
}

fn same(host: &str, target: &str) -> Result<()> {
    if host.is_empty() {
        bail!("the host printed nothing");
    }
    if host == target {
        return Ok(());
    }
    let differs = host
        .lines()
        .zip(target.lines())
        .enumerate()
        .find(|(_, (h, t))| h != t);
    match differs {
        Some((line, (h, t))) => bail!("line {} differs\n  host: {h}\n  QEMU: {t}", line + 1),
        None => {
            let (h, t) = (host.lines().count(), target.lines().count());
            Err(anyhow::anyhow!("the host printed {h} lines, QEMU {t}"))
                .context("one output ends early")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bit_is_a_difference() {
        assert!(same("3f800000\n3f800001\n", "3f800000\n3f800001\n").is_ok());
        let error = same("3f800000\n3f800001\n", "3f800000\n3f800002\n").unwrap_err();
        assert!(format!("{error:#}").contains("line 2"));
        assert!(same("3f800000\n", "").is_err());
        assert!(same("", "").is_err());
    }

    #[test]
    fn a_firmware_without_a_host_side_is_no_pair() {
        assert!(is_paired(
            "use x;\nfn run(out: &mut impl core::fmt::Write) -> core::fmt::Result {"
        ));
        assert!(!is_paired("use x;\n#[entry]\nfn main() -> ! {}"));
    }
}
