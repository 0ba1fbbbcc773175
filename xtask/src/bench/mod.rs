//! `cargo xtask bench`: exact instruction counts and stack depth on the Cortex-M4F, recorded in BENCHMARKS.md and held
//! by budgets; with `--all` on other cores and against rows and rates, too.

mod budgets;
mod cores;
mod cross;
mod figures;
mod growth;
mod histogram;
mod measure;
mod table;

use std::process::ExitCode;

use anyhow::{anyhow, bail, Result};

pub use figures::write as write_figures;
pub use histogram::run as histogram;
pub use measure::{count, plugin, PLAIN, SMALL, SMALLEST};
use measure::{Counted, Row};
pub use table::{grouped, record};

use crate::report::Report;
use crate::toolchain::{self, Toolchain};

/// What has budgets.
pub struct Measured {
    pub rows: Vec<Row>,
    /// Name and bytes of the states.
    pub states: Vec<(String, u64)>,
}

/// Measures everything, writes BENCHMARKS.md, compares with the budgets or replaces them.
pub fn run(json: bool, accept: bool, everything: bool) -> Result<ExitCode> {
    let toolchain = toolchain::ready()?;
    let measured = all(&toolchain)?;
    if !json {
        let (rows, states) = (table::text(&measured.rows), table::ram(&measured.states));
        println!("{rows}\n\n{states}");
    }
    if accept {
        budgets::write(&toolchain, &measured)?;
    }
    // Another compiler's numbers are only printed.
    let recorded = is_recorded(&toolchain)?;
    if recorded {
        table::write(&toolchain, &measured)?;
        figures::write()?;
    }
    let mut listed = measured.rows.clone();
    if everything {
        let others = cores::rows(&toolchain)?;
        if recorded {
            cores::write(&toolchain, &measured.rows, &others)?;
        }
        listed.extend(others);
        growth::run(&toolchain, json)?;
    }
    if json {
        println!("{}", serde_json::to_string_pretty(&listed)?);
    }
    Ok(match exceeded(&toolchain, &measured) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error:#}");
            ExitCode::FAILURE
        }
    })
}

/// Whether BENCHMARKS.md holds what this compiler makes.
pub fn is_recorded(toolchain: &Toolchain) -> Result<bool> {
    Ok(budgets::read()?.compiler == toolchain.release)
}

/// The budgets as a check of `cargo xtask test`, and the ways of counting against each other.
pub fn check(report: &mut Report, toolchain: &Toolchain) {
    report.check(
        "instruction, stack and RAM budgets; plugin, timer and paint agree",
        || exceeded(toolchain, &all(toolchain)?),
    );
}

/// Every build, two builds at a time: each is one long run of the linker's optimiser.
fn all(toolchain: &Toolchain) -> Result<Measured> {
    let plugin = measure::plugin()?;
    let measure = |builds: &[measure::Firmware]| -> Result<Vec<Counted>> {
        let counted = builds.iter().map(|build| build.count(toolchain, &plugin));
        counted.collect()
    };
    let (first, second) = measure::FIRMWARES.split_at(measure::FIRMWARES.len() / 2);
    let (first, second) = std::thread::scope(|scope| {
        let first = scope.spawn(|| measure(first));
        let second = measure(second);
        (first.join(), second)
    });
    let mut counted = first.map_err(|_| anyhow!("a measuring thread ended early"))??;
    counted.extend(second?);
    let mut measured = Measured {
        rows: Vec::new(),
        states: Vec::new(),
    };
    if let Some(plain) = counted.first_mut() {
        cross::timed(toolchain, &plain.regions)?;
        measured.states = std::mem::take(&mut plain.states);
    }
    measured.rows = counted.into_iter().flat_map(|build| build.rows).collect();
    Ok(measured)
}

fn exceeded(toolchain: &Toolchain, measured: &Measured) -> Result<()> {
    let budgets = budgets::read()?;
    if budgets.compiler != toolchain.release {
        eprintln!(
            "budgets hold for rustc {}; with rustc {} they are not compared",
            budgets.compiler, toolchain.release
        );
        return Ok(());
    }
    let wrong = budgets.compare(measured);
    if !wrong.is_empty() {
        bail!(
            "{}\nIf this is meant: `cargo xtask bench --accept`, and say why in the commit",
            wrong.join("\n")
        );
    }
    Ok(())
}
