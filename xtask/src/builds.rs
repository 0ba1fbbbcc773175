//! The library on its bare targets, clippy and the documentation.

use anyhow::{bail, Context, Result};

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
                // A feature adds types and no kernel: code is generated with all of them, the others are checked.
                let mut cargo = toolchain.cargo(if features == all { "build" } else { "check" });
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
///
/// Units stand in square brackets, and rustdoc takes `[m]` for a link that leads nowhere; so the library allows such
/// links, and here those that are no unit are found.
fn docs(report: &mut Report) {
    report.check("documentation without warnings", || {
        let mut cargo = shell::command("cargo");
        cargo.args([
            "doc",
            "--no-deps",
            "--package",
            "navsight",
            "--package",
            "host-tests",
            "--all-features",
        ]);
        cargo.env(
            "RUSTDOCFLAGS",
            "-D warnings --force-warn rustdoc::broken_intra_doc_links",
        );
        let output = shell::output(&mut cargo, None)?;
        if !output.status.success() {
            let errors = output
                .stderr
                .split("\n\n")
                .filter(|block| block.starts_with("error"));
            bail!("{}", errors.collect::<Vec<_>>().join("\n\n"));
        }
        let broken: Vec<&str> = broken_links(&output.stderr).collect();
        if !broken.is_empty() {
            bail!("links that lead nowhere:\n  {}", broken.join("\n  "));
        }
        Ok(())
    });
}

/// Targets of broken links that are no units, from rustdoc's messages.
fn broken_links(messages: &str) -> impl Iterator<Item = &str> {
    let targets = messages
        .lines()
        .filter_map(|line| line.split_once("unresolved link to `")?.1.strip_suffix('`'));
    targets.filter(|target| target.len() > 3 || target.contains(':'))
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
    fn a_unit_is_no_broken_link() {
        let messages = "warning: unresolved link to `rad`\n  --> src/lib.rs:13:40\nwarning: unresolved link to `Filter::nav`\n";
        assert_eq!(
            super::broken_links(messages).collect::<Vec<_>>(),
            ["Filter::nav"]
        );
    }

    #[test]
    fn features_are_read_from_the_manifest() {
        let features = super::features().unwrap();
        assert!(features.iter().any(|name| name == "defmt"));
        assert!(!features.iter().any(|name| name == "default"));
    }
}
