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
use crate::report::{Check, Report};
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
    let builds = [("firmware", "3"), ("firmware-s", "s")].map(|(profile, opt)| {
        let build = Build {
            profile,
            features: "embedded-hal",
            ..Build::plain(EXAMPLE)
        };
        (build, opt)
    });
    let links = builds.map(|(build, opt)| {
        Check::new(
            format!("panic proof: links at opt-level {opt}"),
            move || match build.elf(toolchain) {
                Ok(_) => Ok(()),
                Err(error) if is_proof(&error) => bail!("{}", culprits(&build, toolchain)?),
                Err(error) => Err(error),
            },
        )
    });
    report.check_together(links.into());
    let controls = builds.map(|(build, opt)| {
        Check::new(
            format!("panic proof: control fails at opt-level {opt}"),
            move || {
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
        )
    });
    report.check_together(controls.into());
    Ok(())
}

/// Whether a link failed by the proof and not for another reason.
fn is_proof(error: &anyhow::Error) -> bool {
    format!("{error:#}").contains(&format!("undefined symbol: {MISSING}"))
}

/// Links with the missing function defined, and lists what leads into core's panic code, with source lines.
fn culprits(build: &Build, toolchain: &Toolchain) -> Result<String> {
    packages::ready(&[packages::NM])?;
    let defined = format!("-Clink-arg=--defsym={MISSING}=0");
    let rustc = [build.rustc, &[&defined]].concat();
    let elf = Build {
        rustc: &rustc,
        ..*build
    }
    .elf(toolchain)?;
    let mut objdump = shell::command("arm-none-eabi-objdump");
    let listing = shell::run(objdump.args(["-d", "-C", "--no-show-raw-insn"]).arg(&elf))?;
    let mut sources = BTreeSet::new();
    for address in panicking(&listing) {
        let mut addr2line = shell::command("arm-none-eabi-addr2line");
        addr2line
            .args(["-C", "-f", "-i", "-p", "-e"])
            .arg(&elf)
            .arg(format!("{address:x}"));
        let frames = shell::run(&mut addr2line)?;
        // The innermost frames are core's; the first one of ours says where to look.
        let root = format!("{}/", shell::root().display());
        let ours = frames
            .lines()
            .find(|frame| frame.contains(&root) && !frame.ends_with('?'));
        sources
            .extend(ours.map(|frame| frame.replace(&root, "").trim().replace("(inlined by) ", "")));
    }
    Ok(format!(
        "panic paths survive:\n  {}",
        sources.into_iter().collect::<Vec<_>>().join("\n  ")
    ))
}

/// Addresses of calls into core's panic code, and of the branches to the cold block that such a call stands in.
fn panicking(listing: &str) -> BTreeSet<u64> {
    let hex = |text: &str| u64::from_str_radix(text, 16).ok();
    let mut calls = BTreeSet::new();
    let mut cold = BTreeSet::new();
    let mut block = Vec::new();
    let mut branches = Vec::new();
    for line in listing.lines() {
        let Some((address, instruction)) = line.split_once(":\t") else {
            block.clear();
            continue;
        };
        let Some(address) = hex(address.trim()) else {
            continue;
        };
        block.push(address);
        let mnemonic = instruction.split_whitespace().next().unwrap_or_default();
        let branches_off = mnemonic.starts_with('b') || mnemonic.starts_with("cb");
        if !branches_off && !instruction.contains("pc}") {
            continue;
        }
        let operands = instruction.split(" <").next().unwrap_or_default();
        if let Some(target) = operands.split_whitespace().last().and_then(hex) {
            branches.push((address, target));
        }
        if instruction.contains("<core::panicking::") || instruction.contains("_fail>") {
            calls.insert(address);
            cold.extend(block.iter().copied());
        }
        block.clear();
    }
    let leading = branches.iter().filter(|(_, target)| cold.contains(target));
    leading
        .map(|(address, _)| *address)
        .chain(calls.iter().copied())
        .collect()
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

/// Names of the public functions of a file, its tests and the functions of types that are not public aside.
fn public_functions(source: &str) -> Vec<String> {
    let library = source
        .split("#[cfg(test)]\nmod ")
        .next()
        .unwrap_or_default();
    let is_name = |c: &char| c.is_alphanumeric() || *c == '_';
    let mut names = Vec::new();
    let mut of_private_type = false;
    for line in library.lines() {
        if line.starts_with("impl") {
            let subject = line
                .rsplit_once(" for ")
                .map_or(line, |(_, subject)| subject);
            let subject = subject.trim_start_matches("impl").trim_start();
            // The parameters of the impl, which may hold `>` of their own only in nested brackets.
            let mut depth = 0;
            let subject = subject.trim_start_matches(|c| {
                depth += i32::from(c == '<') - i32::from(c == '>');
                depth > 0 || c == '>' || c == ' '
            });
            let name: String = subject.chars().take_while(is_name).collect();
            of_private_type = ["pub(super) struct ", "pub(crate) struct ", "\nstruct "]
                .iter()
                .any(|declaration| {
                    library
                        .match_indices(&format!("{declaration}{name}"))
                        .any(|(at, found)| {
                            !library[at + found.len()..].starts_with(|c| is_name(&c))
                        })
                });
        } else if !line.is_empty() && !line.starts_with([' ', '}', ')']) {
            of_private_type = false;
        }
        let line = line.trim_start();
        let function = line
            .strip_prefix("pub fn ")
            .or_else(|| line.strip_prefix("pub const fn "));
        if let Some(rest) = function.filter(|_| !of_private_type) {
            names.push(rest.chars().take_while(is_name).collect());
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
    fn functions_of_private_types_are_not_public() {
        let source = "pub(super) struct Pair<T>(T);\npub struct PairOf;\nimpl<T: Into<f32>> Pair<T> {\n    fn own() {}\n\n    pub fn turn(&self) {}\n}\nimpl PairOf {\n    pub fn of() {}\n}\npub fn free() {}\n";
        assert_eq!(public_functions(source), ["of", "free"]);
    }

    #[test]
    fn branches_into_a_panic_are_found() {
        let listing = "   2ba30:\tbeq.n\t2ba44 <f+0x10>\n   2ba40:\tbcs.w\t300b8 <f+0x4ae0>\n   2ba44:\tmuls\tr0, r6\n   2ba46:\tpop\t{r4, pc}\n   300b8:\tldr\tr0, [pc, #8]\t@ (400 <x>)\n   300ba:\tbl\t757a0 <core::panicking::panic_fmt>\n   300be:\tbl\t400 <g>\n";
        assert_eq!(
            panicking(listing).into_iter().collect::<Vec<_>>(),
            [0x2ba40, 0x300ba]
        );
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
