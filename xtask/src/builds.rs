//! The library on its bare targets, clippy and the documentation.

use anyhow::{bail, Context, Result};

use crate::report::Report;
use crate::shell;
use crate::toolchain::{Toolchain, TARGETS, THUMBV7EM};

/// Library builds for every bare target, clippy there, documentation.
///
/// A feature adds types and no kernel, and nothing in the library asks which target it is built for: code is generated with
/// all features for every target; none and each alone are checked for one. Several targets in one call of cargo share the
/// cores, where a call for each would wait for one crate at a time.
pub fn bare(report: &mut Report, toolchain: &Toolchain) -> Result<()> {
    let features = features()?;
    let all = features.join(",");
    let mut library = |name: String, subcommand: &str, features: &str, targets: &[&str]| {
        report.check(&name, || {
            let mut cargo = toolchain.cargo(subcommand);
            cargo.args(["--quiet", "--package", "navsight", "--lib"]);
            cargo.args(["--features", features]);
            cargo.args(targets.iter().flat_map(|target| ["--target", target]));
            shell::run(&mut cargo).map(drop)
        });
    };
    let four = TARGETS.join(", ");
    library(
        format!("library for {four}, all features"),
        "build",
        &all,
        &TARGETS,
    );
    library(
        format!("library for {THUMBV7EM}, no feature"),
        "check",
        "",
        &[THUMBV7EM],
    );
    for alone in &features {
        let name = format!("library for {THUMBV7EM}, {alone} alone");
        library(name, "check", alone, &[THUMBV7EM]);
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
    // Only the library has features: with none it is the whole difference.
    let whole = ["--workspace", "--all-features"];
    for (shown, what) in [
        ("all features", &whole[..]),
        ("no feature", &["--package", "navsight"]),
    ] {
        report.check(&format!("clippy on the host, {shown}"), || {
            let mut cargo = shell::command("cargo");
            cargo
                .args(["clippy", "--quiet", "--all-targets"])
                .args(what);
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
