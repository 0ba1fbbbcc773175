//! Golden traces in `host-tests/golden/`: compared, or rewritten together with the code that changed them.

use std::process::ExitCode;

use anyhow::{bail, Result};

use crate::shell;

/// Runs the test that compares the traces; with `accept` it rewrites them instead.
pub fn run(accept: bool) -> Result<ExitCode> {
    let mut cargo = shell::command("cargo");
    cargo.args([
        "test",
        "--release",
        "--package",
        "host-tests",
        "--test",
        "golden",
    ]);
    if accept {
        cargo.env("NAVSIGHT_GOLDEN", "accept");
    }
    if !cargo.status()?.success() {
        bail!("the golden traces differ: if the change is meant, `cargo xtask golden --accept` and say why in CHANGELOG.md");
    }
    Ok(ExitCode::SUCCESS)
}
