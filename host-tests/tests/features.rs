//! Features add and never replace, the library stays free of std, and nothing of its build reaches the user's.

use std::fs;
use std::path::Path;

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

fn manifest() -> String {
    fs::read_to_string(root().join("Cargo.toml")).unwrap()
}

/// Lines of one table of the manifest, comments aside.
fn table<'a>(manifest: &'a str, name: &str) -> Vec<&'a str> {
    let head = format!("[{name}]");
    let lines = manifest
        .lines()
        .skip_while(move |line| *line != head)
        .skip(1);
    lines
        .take_while(|line| !line.starts_with('['))
        .filter(|line| line.contains('=') && !line.starts_with('#'))
        .collect()
}

fn library_sources() -> Vec<(String, String)> {
    fn collect(dir: &Path, into: &mut Vec<(String, String)>) {
        for entry in fs::read_dir(dir).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                collect(&path, into);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                into.push((
                    path.display().to_string(),
                    fs::read_to_string(&path).unwrap(),
                ));
            }
        }
    }
    let mut sources = Vec::new();
    collect(&root().join("src"), &mut sources);
    assert!(!sources.is_empty());
    sources
}

#[test]
fn nothing_is_on_by_default() {
    let manifest = manifest();
    let features = table(&manifest, "features");
    assert!(features.contains(&"default = []"), "{features:?}");
    for line in &features {
        assert!(
            !line.starts_with("std"),
            "the library has no std feature: {line}"
        );
    }
}

#[test]
fn no_feature_replaces_what_is_there_without_it() {
    for (file, source) in library_sources() {
        for (number, line) in source.lines().enumerate() {
            let replaces = line.contains("not(feature") || line.contains("cfg!(feature");
            assert!(!replaces, "{file}:{}: {line}", number + 1);
        }
    }
}

#[test]
fn dependencies_bring_no_std() {
    let manifest = manifest();
    // libm, defmt and embedded-hal have no default features.
    const WITHOUT_STD: [&str; 3] = ["libm", "defmt", "embedded-hal"];
    let dependencies = table(&manifest, "dependencies");
    assert!(!dependencies.is_empty());
    for line in dependencies {
        let name = line.split(['=', '.', ' ']).next().unwrap();
        assert!(
            line.contains("default-features = false") || WITHOUT_STD.contains(&name),
            "{line}"
        );
        assert!(!line.contains("\"std\""), "{line}");
    }
}

#[test]
fn the_library_is_no_std_and_forbids_unsafe() {
    let lib = fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let has = |attribute: &str| lib.lines().any(|line| line == attribute);
    assert!(has("#![no_std]"));
    assert!(has("#![forbid(unsafe_code)]"));
    assert!(has("#![warn(missing_docs)]"));
}

#[test]
fn the_library_has_no_build_script_that_could_reach_a_users_link() {
    assert!(!root().join("build.rs").exists());
    assert!(!manifest()
        .lines()
        .any(|line| line.starts_with("build =") || line.starts_with("links =")));
}

/// sin, cos and their like come from libm by name, so that host and target give the same bits: a method call on a
/// float would be the host's own function on the host.
#[test]
fn elementary_functions_come_from_libm_by_name() {
    const NAMES: [&str; 16] = [
        "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sin_cos", "exp", "ln",
        "powf", "powi", "hypot", "cbrt", "mul_add",
    ];
    for (file, source) in library_sources() {
        let library = source.split("#[cfg(test)]\nmod ").next().unwrap();
        for (number, line) in library.lines().enumerate() {
            let code = line.split("//").next().unwrap();
            for name in NAMES {
                let called = code.contains(&format!(".{name}("));
                assert!(!called, "{file}:{}: {}", number + 1, line.trim());
            }
        }
    }
}
