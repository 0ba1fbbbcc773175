//! The lab program as a caller sees it.

use std::ffi::OsStr;
use std::process::{Command, Output};

use serde_json::Value;

/// Runs the lab with these arguments.
pub fn lab<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lab"))
        .args(arguments)
        .output()
        .unwrap()
}

/// Runs it, and reads the one object that it prints: nothing else is there, and nothing on standard error either where
/// that is no terminal.
pub fn lab_json<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Value {
    let output = lab(arguments);
    assert!(output.status.success(), "{output:?}");
    assert!(
        output.stderr.is_empty(),
        "no progress without a terminal: {output:?}"
    );
    serde_json::from_slice(&output.stdout).expect("one JSON object and nothing else")
}
