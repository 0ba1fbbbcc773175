//! The lab program as a caller sees it.
// every test is a crate of its own, and none uses all of this
#![allow(dead_code)]

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
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
    json_of(&lab(arguments))
}

/// The one object that the lab printed.
pub fn json_of(output: &Output) -> Value {
    assert!(output.status.success(), "{output:?}");
    assert!(
        output.stderr.is_empty(),
        "no progress without a terminal: {output:?}"
    );
    serde_json::from_slice(&output.stdout).expect("one JSON object and nothing else")
}

/// Runs a command of the lab on a file with this text, and takes the file away again.
pub fn lab_on(command: &[&str], name: &str, text: &str, more: &[&str]) -> Output {
    let path = std::env::temp_dir().join(format!("{}-{name}.json", std::process::id()));
    std::fs::write(&path, text).unwrap();
    let path_text = path.to_str().unwrap().to_owned();
    let all = command.iter().copied().chain([path_text.as_str()]);
    let output = lab(all.chain(more.iter().copied()));
    std::fs::remove_file(path).unwrap();
    output
}

/// A file of this name in a folder of its own for each test file.
pub fn scratch(folder: &str, name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder.join(name)
}

/// The path of a file of this name and text in that folder.
pub fn written(folder: &str, name: &str, text: &str) -> String {
    let path = scratch(folder, name);
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// What a replay told about, one event a line.
pub fn events(o: &Value) -> String {
    let all = o["events"].as_array().unwrap().iter();
    all.map(|e| e["event"].as_str().unwrap().to_owned() + "\n")
        .collect()
}

/// The one line with which the lab refuses these arguments.
pub fn refused(arguments: &[&str]) -> String {
    let output = lab(arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(output.stdout.is_empty(), "{arguments:?}");
    assert_eq!(message.lines().count(), 1, "{arguments:?}: {message:?}");
    message
}

/// Asserts that bad input ended with 2 and one line that names the line and the field.
pub fn assert_refused(output: &Output, name: &str, line: u32, field: &str) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{name}: {message}");
    assert!(output.stdout.is_empty(), "{name}");
    assert_eq!(message.lines().count(), 1, "{name}: {message}");
    let place = format!(".json:{line}: ");
    assert!(
        message.contains(&place) && message.contains(field),
        "{name}: {message} does not name {place} and {field}"
    );
}
