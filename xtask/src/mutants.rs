//! `cargo xtask mutants`: do the tests see a wrong sign? Every line of `xtask/mutants.toml` is put into a copy of the
//! sources, one at a time, and the test that it names has to fail.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{bail, Context, Result};
use serde::Deserialize;

use crate::report::Report;
use crate::shell;
use crate::toolchain::target_dir;

#[derive(Deserialize)]
struct Table {
    mutant: Vec<Mutant>,
}

/// A change that must not go unseen.
#[derive(Deserialize)]
struct Mutant {
    /// What is wrong then.
    what: String,
    file: String,
    /// Stands exactly once in the file.
    from: String,
    to: String,
    /// `lib` or a test file of host-tests, and part of the name of a test.
    test: String,
}

/// Runs those whose file, description or test contains `only`.
pub fn run(report: &mut Report, only: &str) -> Result<()> {
    let mut table = table()?;
    table
        .mutant
        .retain(|m| [&m.what, &m.file, &m.test].iter().any(|s| s.contains(only)));
    let copy = Copy::new()?;
    let tests: BTreeSet<&str> = table.mutant.iter().map(|m| m.test.as_str()).collect();
    report.check("the tests pass without a mutation", || {
        for test in &tests {
            let (passed, said) = copy.passes(test)?;
            if !passed {
                bail!("{test}\n{said}");
            }
        }
        Ok(())
    });
    for mutant in &table.mutant {
        let name = format!("mutant `{}` of {}", mutant.what, mutant.file);
        report.check(&name, || copy.finds(mutant));
    }
    Ok(())
}

fn table() -> Result<Table> {
    let text = fs::read_to_string(shell::root().join("xtask/mutants.toml"))?;
    toml::from_str(&text).context("xtask/mutants.toml")
}

/// The sources beside the sources, with a target directory of their own.
struct Copy {
    sources: PathBuf,
}

impl Copy {
    fn new() -> Result<Self> {
        let sources = target_dir().join("mutants/sources");
        let listed = shell::run(shell::command("git").args([
            "ls-files",
            "--cached",
            "--others",
            "--exclude-standard",
        ]))?;
        for name in listed.lines() {
            let from = shell::root().join(name);
            // deleted, but not yet committed
            if from.exists() {
                put(&sources.join(name), &fs::read(from)?)?;
            }
        }
        Ok(Self { sources })
    }

    /// Whether the test finds this mutation.
    fn finds(&self, mutant: &Mutant) -> Result<()> {
        let file = self.sources.join(&mutant.file);
        let text = fs::read_to_string(&file)?;
        let found = text.matches(&mutant.from).count();
        if found != 1 {
            bail!("`{}` stands {found} times in it", mutant.from);
        }
        put(&file, text.replace(&mutant.from, &mutant.to).as_bytes())?;
        let outcome = self.passes(&mutant.test);
        put(&file, text.as_bytes())?;
        match outcome? {
            (true, _) => bail!("`{}` still passes with `{}`", mutant.test, mutant.to),
            (false, _) => Ok(()),
        }
    }

    /// Builds a test, which has to succeed, and runs it; what it said.
    fn passes(&self, test: &str) -> Result<(bool, String)> {
        let (target, name) = test
            .split_once(' ')
            .with_context(|| format!("`{test}` names no test"))?;
        let target: &[&str] = match target {
            "lib" => &["--package", "navsight", "--lib"],
            file => &["--package", "host-tests", "--test", file],
        };
        let cargo = |last: &[&str]| {
            let mut cargo = shell::command("cargo");
            cargo.current_dir(&self.sources);
            cargo.env("CARGO_TARGET_DIR", target_dir().join("mutants/build"));
            // a build for every mutation: what counts is how long the compiler takes
            cargo.env("CARGO_PROFILE_TEST_OPT_LEVEL", "0");
            cargo.env("CARGO_PROFILE_TEST_DEBUG", "false");
            cargo.args(["test", "--quiet"]).args(target).args(last);
            cargo
        };
        shell::run(&mut cargo(&["--no-run"]))?;
        let output = shell::output(&mut cargo(&["--", name]), None)?;
        let ran = output
            .stdout
            .lines()
            .any(|line| line.starts_with("running ") && line != "running 0 tests");
        if !ran {
            bail!("no test `{test}`");
        }
        Ok((output.status.success(), output.stdout))
    }
}

/// Writes a file that differs; one that does not keeps its time, and is not built again.
fn put(path: &Path, bytes: &[u8]) -> Result<()> {
    if fs::read(path).is_ok_and(|old| old == bytes) {
        return Ok(());
    }
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    fs::write(path, bytes).with_context(|| path.display().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_mutated_stands_once_in_its_file() {
        for mutant in table().unwrap().mutant {
            let text = fs::read_to_string(shell::root().join(&mutant.file)).unwrap();
            let found = text.matches(&mutant.from).count();
            assert_eq!(found, 1, "`{}` in {}", mutant.from, mutant.file);
        }
    }
}
