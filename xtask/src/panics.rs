//! Proof at link time that no panic path survives in firmware that calls every public function.
//!
//! The panic handler of `examples/panic_free.rs` calls a function that nobody defines: the firmware links only if the
//! linker could drop the handler. The proof holds for this compiler and opt-level, so it is made at 3 and at "s"; a
//! control with one index that can panic shows that it is able to fail.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use anyhow::{bail, Result};

use crate::packages;
use crate::qemu::Build;
use crate::report::Report;
use crate::shell;
use crate::toolchain::Toolchain;

const EXAMPLE: &str = "panic_free";
/// Its calls.
const CALLS: &str = "examples/firmware/every_function.rs";
/// The function that nobody defines.
const MISSING: &str = "navsight_panic_path_survived";

/// Checks that every public function is called, links the proof, and links the control that has to fail.
pub fn prove(report: &mut Report, toolchain: &Toolchain) -> Result<()> {
    report.check(
        "panic proof: calls every public function",
        every_function_is_called,
    );
    for (profile, opt) in [("firmware", "3"), ("firmware-s", "s")] {
        let build = Build {
            profile,
            ..Build::plain(EXAMPLE)
        };
        report.check(
            &format!("panic proof: links at opt-level {opt}"),
            || match build.elf(toolchain) {
                Ok(_) => Ok(()),
                Err(error) if is_proof(&error) => bail!("{}", culprits(&build, toolchain)?),
                Err(error) => Err(error),
            },
        );
        report.check(
            &format!("panic proof: control fails at opt-level {opt}"),
            || {
                let control = Build {
                    rustc: &["--cfg", "panic_control"],
                    ..build
                };
                match control.elf(toolchain) {
                    Ok(_) => bail!("an index that can panic was linked: the proof proves nothing"),
                    Err(error) if is_proof(&error) => Ok(()),
                    Err(error) => Err(error),
                }
            },
        );
    }
    Ok(())
}

/// Whether a link failed by the proof and not for another reason.
fn is_proof(error: &anyhow::Error) -> bool {
    format!("{error:#}").contains(&format!("undefined symbol: {MISSING}"))
}

/// Links with the missing function defined, and lists who calls into core's panic code, with source lines.
fn culprits(build: &Build, toolchain: &Toolchain) -> Result<String> {
    packages::ready(&[packages::NM])?;
    let defined = format!("-Clink-arg=--defsym={MISSING}=0");
    let elf = Build {
        rustc: &[&defined],
        ..*build
    }
    .elf(toolchain)?;
    let listing = shell::run(
        shell::command("arm-none-eabi-objdump")
            .args(["-d", "-C", "--no-show-raw-insn"])
            .arg(&elf),
    )?;
    let mut addresses = Vec::new();
    for line in listing.lines() {
        let call = line.contains("core::panicking::")
            || line.contains("core::slice::index::")
            || line.contains("_fail>");
        if let Some((address, _)) = line
            .trim()
            .split_once(':')
            .filter(|(address, _)| call && is_hex(address))
        {
            addresses.push(address.to_owned());
        }
    }
    let mut sources = BTreeSet::new();
    for address in addresses {
        let mut addr2line = shell::command("arm-none-eabi-addr2line");
        let frames = shell::run(
            addr2line
                .args(["-C", "-f", "-i", "-p", "-e"])
                .arg(&elf)
                .arg(&address),
        )?;
        // The innermost frames are core's; the first one of ours says where to look.
        let ours = frames.lines().find(|frame| {
            frame.contains("/src/") && !frame.contains("/library/") && !frame.contains("registry")
        });
        sources.insert(
            ours.unwrap_or_else(|| frames.lines().last().unwrap_or_default())
                .trim()
                .to_owned(),
        );
    }
    Ok(format!(
        "panic paths survive:\n  {}",
        sources.into_iter().collect::<Vec<_>>().join("\n  ")
    ))
}

fn is_hex(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}

/// A name that several types give to a function has to be called as often.
fn every_function_is_called() -> Result<()> {
    let proof = fs::read_to_string(shell::root().join(CALLS))?;
    let mut defined: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in sources(&shell::root().join("src"))? {
        let shown = file.strip_prefix(shell::root())?.display().to_string();
        for name in public_functions(&fs::read_to_string(&file)?) {
            defined.entry(name).or_default().push(shown.clone());
        }
    }
    let mut missing = Vec::new();
    for (name, places) in defined {
        let calls = calls(&proof, &name);
        if calls < places.len() {
            missing.push(format!(
                "{name}: {calls} of {} ({})",
                places.len(),
                places.join(", ")
            ));
        }
    }
    if !missing.is_empty() {
        bail!("{CALLS} does not call\n  {}", missing.join("\n  "));
    }
    Ok(())
}

/// Every Rust file below a directory.
fn sources(dir: &std::path::Path) -> Result<Vec<std::path::PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(dir)? {
        let path = entry?.path();
        if path.is_dir() {
            files.extend(sources(&path)?);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Names of the public functions of a file, its tests aside.
fn public_functions(source: &str) -> Vec<String> {
    let library = source
        .split("#[cfg(test)]\nmod ")
        .next()
        .unwrap_or_default();
    let mut names = Vec::new();
    for line in library.lines() {
        let line = line.trim_start();
        if let Some(rest) = line
            .strip_prefix("pub fn ")
            .or_else(|| line.strip_prefix("pub const fn "))
        {
            names.push(
                rest.chars()
                    .take_while(|c| c.is_alphanumeric() || *c == '_')
                    .collect(),
            );
        }
    }
    names
}

/// How often the proof calls a function of this name.
fn calls(proof: &str, name: &str) -> usize {
    let called = |at: &usize| {
        let before = proof[..*at].chars().next_back();
        let before = before.is_some_and(|c| matches!(c, '.' | ':' | ' ' | '('));
        let after = &proof[at + name.len()..];
        let own = proof[..*at].ends_with("fn ");
        !own && before && (after.starts_with('(') || after.starts_with("::<"))
    };
    proof
        .match_indices(name)
        .map(|(at, _)| at)
        .filter(called)
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn public_functions_are_found_and_tests_are_not() {
        let source = "pub fn radii<T>(x: T) {}\nfn own() {}\nimpl A {\n    pub const fn new() -> A {}\n}\n#[cfg(test)]\nmod tests {\n    pub fn helper() {}\n}\n";
        assert_eq!(public_functions(source), ["radii", "new"]);
    }

    #[test]
    fn a_longer_name_is_not_a_call() {
        assert_eq!(calls("let x = earth::radii(1.0);", "radii"), 1);
        assert_eq!(calls("q.update::<3>(&rows); q.update(&rows)", "update"), 2);
        assert_eq!(calls("let x = other_radii(1.0);", "radii"), 0);
        assert_eq!(calls("let x = radii_of(1.0);", "radii"), 0);
        assert_eq!(calls("fn radii(x: f32) {}", "radii"), 0);
    }
}
