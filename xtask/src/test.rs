//! `cargo xtask test`: everything, cheapest first, with one count at the end.

use std::io::{BufRead, BufReader};
use std::process::{ExitCode, Stdio};

use anyhow::{bail, Context, Result};

use crate::report::Report;
use crate::{bench, builds, mutants, packages, pairs, panics, shell, size, toolchain};

/// Runs tier 1, or tier 2 with the long runs as well.
pub fn run(full: bool) -> Result<ExitCode> {
    let mut report = Report::default();
    builds::host(&mut report);
    host_tests(&mut report, full)?;
    if full {
        mutants::run(&mut report, "")?;
    }

    let mut found = None;
    report.check("bare-metal toolchain, QEMU and tools", || {
        found = Some(toolchain::ready()?);
        packages::ready(&packages::ALL)
    });
    if let Some(toolchain) = found {
        builds::bare(&mut report, &toolchain)?;
        panics::prove(&mut report, &toolchain)?;
        pairs::compare(&mut report, &toolchain)?;
        size::unused_is_absent(&mut report, &toolchain);
        size::least_fits(&mut report, &toolchain);
        bench::check(&mut report, &toolchain);
    }
    Ok(report.finish())
}

/// The host's tests. Numeric tests need an optimised build; the profile is in the workspace's manifest.
fn host_tests(report: &mut Report, full: bool) -> Result<()> {
    // The tools are already built without optimisation and have nothing to compute.
    cargo_test(report, &["--profile", "dev", "--package", "xtask"])?;
    cargo_test(
        report,
        &["--workspace", "--exclude", "xtask", "--no-fail-fast"],
    )?;
    if full {
        cargo_test(
            report,
            &[
                "--release",
                "--workspace",
                "--exclude",
                "xtask",
                "--no-fail-fast",
                "--",
                "--ignored",
            ],
        )?;
    }
    Ok(())
}

/// Runs `cargo test`, passes its output on and counts the summaries in it.
fn cargo_test(report: &mut Report, arguments: &[&str]) -> Result<()> {
    let shown = format!("cargo test {}", arguments.join(" "));
    eprintln!("{shown}");
    let mut child = shell::command("cargo")
        .arg("test")
        .args(arguments)
        .stdout(Stdio::piped())
        .spawn()?;
    let mut passed = 0;
    let mut failed = 0;
    for line in BufReader::new(child.stdout.take().context("standard output of cargo")?).lines() {
        let line = line?;
        if let Some((p, f)) = summary(&line) {
            passed += p;
            failed += f;
        }
        println!("{line}");
    }
    let success = child.wait()?.success();
    report.add(&shown, passed, failed);
    if !success && failed == 0 {
        // Nothing was counted: it did not build.
        report.check(&shown, || bail!("cargo test failed before it could count"));
    }
    Ok(())
}

/// Passed and failed of a line such as `test result: ok. 12 passed; 0 failed; 3 ignored; …`.
fn summary(line: &str) -> Option<(usize, usize)> {
    let counts = line.strip_prefix("test result: ")?.split_once(". ")?.1;
    let count = |word: &str| {
        let (number, _) = counts
            .split("; ")
            .find_map(|part| part.split_once(' ').filter(|(_, unit)| *unit == word))?;
        number.parse().ok()
    };
    Some((count("passed")?, count("failed")?))
}

#[cfg(test)]
mod tests {
    use super::summary;

    #[test]
    fn summaries_are_counted() {
        let ok = "test result: ok. 12 passed; 0 failed; 3 ignored; 0 measured; 0 filtered out; finished in 0.00s";
        assert_eq!(summary(ok), Some((12, 0)));
        let bad = "test result: FAILED. 7 passed; 2 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.01s";
        assert_eq!(summary(bad), Some((7, 2)));
        assert_eq!(summary("test linalg::tests::skew ... ok"), None);
    }
}
