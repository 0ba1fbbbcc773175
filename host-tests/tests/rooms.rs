//! Data flows one way: a room of the library uses only rooms to its left.
//!
//! Read from the source: every path that starts at `crate::`, alone or in a `use` with braces.

use std::fs;
use std::path::{Path, PathBuf};

/// The rooms from left to right.
const ROOMS: [&str; 15] = [
    "error",
    "linalg",
    "earth",
    "attitude",
    "imu",
    "mechanization",
    "nav",
    "error_model",
    "covariance",
    "measurement",
    "filter",
    "observability",
    "alignment",
    "tracking",
    "sensor",
];

fn place(room: &str) -> Option<usize> {
    ROOMS.iter().position(|name| *name == room)
}

/// First names after `crate::` in a source text, with the line each stands on.
fn used_rooms(source: &str) -> Vec<(usize, String)> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let mut found = Vec::new();
    // Comments and documentation may name any room.
    let code: String = source
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default().to_owned() + "\n")
        .collect();
    for (at, path) in code.match_indices("crate::") {
        // `$crate::` is a path of this crate, too; `navsight_crate::` would not be.
        if code[..at].chars().next_back().is_some_and(is_name) {
            continue;
        }
        let line = code[..at].matches('\n').count() + 1;
        let rest = &code[at + path.len()..];
        if let Some(group) = rest.strip_prefix('{') {
            let mut depth = 0;
            let mut word = String::new();
            let mut words = Vec::new();
            for c in group.chars() {
                match c {
                    '{' => depth += 1,
                    '}' if depth == 0 => break,
                    '}' => depth -= 1,
                    ',' if depth == 0 => words.push(std::mem::take(&mut word)),
                    c if depth == 0 => word.push(c),
                    _ => {}
                }
            }
            words.push(word);
            for word in words {
                let name: String = word.trim().chars().take_while(|&c| is_name(c)).collect();
                if !name.is_empty() {
                    found.push((line, name));
                }
            }
        } else {
            found.push((line, rest.chars().take_while(|&c| is_name(c)).collect()));
        }
    }
    found
}

/// What is wrong with one file of a room.
fn violations(room: &str, file: &str, source: &str) -> Vec<String> {
    let Some(own) = place(room) else {
        return vec![format!(
            "{file}: room `{room}` has no place in the order of rooms"
        )];
    };
    let mut wrong = Vec::new();
    for (line, used) in used_rooms(source) {
        match place(&used) {
            _ if used == room => {}
            Some(other) if other < own => {}
            Some(_) => wrong.push(format!(
                "{file}:{line}: `{room}` uses `{used}`, which is not to its left"
            )),
            None => wrong.push(format!(
                "{file}:{line}: `{room}` uses `crate::{used}`, which is no room"
            )),
        }
    }
    wrong
}

fn rust_files(dir: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

#[test]
fn every_room_uses_only_rooms_to_its_left() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("../src");
    let mut wrong = Vec::new();
    for file in rust_files(&src) {
        let inside = file.strip_prefix(&src).unwrap();
        let room = inside
            .components()
            .next()
            .unwrap()
            .as_os_str()
            .to_str()
            .unwrap();
        let room = room.strip_suffix(".rs").unwrap_or(room);
        // The root names them all, and uses none.
        if room != "lib" {
            wrong.extend(violations(
                room,
                &inside.display().to_string(),
                &fs::read_to_string(&file).unwrap(),
            ));
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn every_room_of_the_library_has_a_place() {
    let root =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../src/lib.rs")).unwrap();
    for line in root.lines() {
        let line = line.trim();
        let module = line
            .strip_prefix("pub mod ")
            .or_else(|| line.strip_prefix("mod "));
        if let Some(room) = module.and_then(|rest| rest.strip_suffix(';')) {
            assert!(
                place(room).is_some(),
                "`{room}` is not in the order of rooms"
            );
        }
    }
}

#[test]
fn a_violation_is_found_however_it_is_written() {
    for source in [
        "use crate::filter::Filter;",
        "pub use crate::filter;",
        "use crate::{error::Error, filter::{Filter, Settings}, linalg};",
        "use crate::{\n    error::Error,\n    filter,\n};",
        "fn f(x: &crate::filter::Filter) {}",
        "macro_rules! m { () => { $crate::filter::new() } }",
    ] {
        assert_eq!(
            violations("covariance", "covariance/mod.rs", source).len(),
            1,
            "{source}"
        );
    }
    assert_eq!(
        violations("earth", "earth.rs", "use crate::attitude::Euler;").len(),
        1
    );
    assert_eq!(violations("cellar", "cellar.rs", "").len(), 1);
}

#[test]
fn what_is_allowed_is_not_reported() {
    for source in [
        "use crate::error::Error;",
        "use crate::{error::Error, linalg::{skew, Real}};",
        "use crate::covariance::packed::index;",
        "// crate::filter calls this\n/// as [`crate::filter::Filter`] does",
        "use navsight_crate::filter;",
        "use super::packed;",
    ] {
        assert!(
            violations("covariance", "covariance/mod.rs", source).is_empty(),
            "{source}"
        );
    }
}
