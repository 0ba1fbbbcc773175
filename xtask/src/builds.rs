//! The library on its bare targets, clippy and the documentation.

use anyhow::{Context, Result};

use crate::report::Report;
use crate::shell;
use crate::toolchain::{Toolchain, TARGETS, THUMBV7EM};

/// Library builds for every bare target, clippy there, documentation.
pub fn bare(report: &mut Report, toolchain: &Toolchain) -> Result<()> {
    let features = features()?;
    let all = features.join(",");
    for target in TARGETS {
        let alone = features.iter().map(String::as_str);
        for features in std::iter::once("").chain(alone).chain([all.as_str()]) {
            let shown = if features.is_empty() {
                "no feature"
            } else {
                features
            };
            report.check(&format!("library for {target}, {shown}"), || {
                let mut cargo = toolchain.cargo("build");
                cargo.args([
                    "--quiet",
                    "--package",
                    "navsight",
                    "--lib",
                    "--target",
                    target,
                    "--features",
                    features,
                ]);
                shell::run(&mut cargo).map(drop)
            });
        }
    }
    report.check(&format!("clippy for {THUMBV7EM}"), || {
        let mut cargo = toolchain.cargo("clippy");
        cargo.args([
            "--quiet",
            "--package",
            "navsight",
            "--lib",
            "--examples",
            "--all-features",
        ]);
        shell::run(cargo.args(["--target", THUMBV7EM, "--", "-D", "warnings"])).map(drop)
    });
    docs(report);
    Ok(())
}

/// Documentation without a warning.
fn docs(report: &mut Report) {
    report.check("documentation without warnings", || {
        let mut cargo = shell::command("cargo");
        cargo.args([
            "doc",
            "--quiet",
            "--no-deps",
            "--package",
            "navsight",
            "--package",
            "host-tests",
            "--all-features",
        ]);
        shell::run(cargo.env("RUSTDOCFLAGS", "-D warnings")).map(drop)
    });
}

/// Format and clippy on the host.
pub fn host(report: &mut Report) {
    report.check("format", || {
        shell::run(shell::command("cargo").args(["fmt", "--all", "--check"])).map(drop)
    });
    for features in [&[][..], &["--all-features"]] {
        let shown = if features.is_empty() {
            "no feature"
        } else {
            "all features"
        };
        report.check(&format!("clippy on the host, {shown}"), || {
            let mut cargo = shell::command("cargo");
            cargo
                .args(["clippy", "--quiet", "--workspace", "--all-targets"])
                .args(features);
            shell::run(cargo.args(["--", "-D", "warnings"])).map(drop)
        });
    }
}

/// Features of the library, `default` aside.
fn features() -> Result<Vec<String>> {
    let manifest: toml::Table =
        std::fs::read_to_string(shell::root().join("Cargo.toml"))?.parse()?;
    let features = manifest
        .get("features")
        .and_then(toml::Value::as_table)
        .context("[features] in Cargo.toml")?;
    Ok(features
        .keys()
        .filter(|name| *name != "default")
        .cloned()
        .collect())
}

#[cfg(test)]
mod tests {
    #[test]
    fn features_are_read_from_the_manifest() {
        let features = super::features().unwrap();
        assert!(features.iter().any(|name| name == "defmt"));
        assert!(!features.iter().any(|name| name == "default"));
    }
}
