//! `cargo xtask bench`: exact instruction counts and stack depth on the Cortex-M4F, recorded in BENCHMARKS.md and held
//! by budgets.

mod budgets;
mod growth;
mod measure;
mod table;

use std::process::ExitCode;

use anyhow::{anyhow, bail, Result};

use measure::Row;
pub use measure::{count, plugin, Firmware, FIRMWARES};
pub use table::{grouped, record};

use crate::qemu;
use crate::report::Report;
use crate::toolchain::{self, Toolchain};

/// Measures everything, writes BENCHMARKS.md, compares with the budgets or replaces them.
pub fn run(json: bool, accept: bool, growing: bool) -> Result<ExitCode> {
    let toolchain = toolchain::ready()?;
    if growing {
        growth::run(&toolchain)?;
    }
    let rows = all(&toolchain)?;
    if json {
        println!("{}", serde_json::to_string_pretty(&rows)?);
    } else {
        println!("{}", table::text(&rows));
    }
    if accept {
        budgets::write(&toolchain, &rows)?;
    }
    // Another compiler's numbers are only printed.
    if is_recorded(&toolchain)? {
        table::write(&toolchain, &rows)?;
    }
    Ok(match exceeded(&toolchain, &rows) {
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

/// The budgets as a check of `cargo xtask test`.
pub fn check(report: &mut Report, toolchain: &Toolchain) {
    report.check("instruction and stack budgets", || {
        exceeded(toolchain, &all(toolchain)?)
    });
}

/// Rows of every build, two builds at a time: each is one long run of the linker's optimiser.
fn all(toolchain: &Toolchain) -> Result<Vec<Row>> {
    let plugin = measure::plugin()?;
    let measure = |builds: &[Firmware]| -> Result<Vec<Row>> {
        let rows = builds.iter().map(|build| build.rows(toolchain, &plugin));
        Ok(rows.collect::<Result<Vec<_>>>()?.concat())
    };
    let (first, second) = FIRMWARES.split_at(FIRMWARES.len() / 2);
    let (first, second) = std::thread::scope(|scope| {
        let first = scope.spawn(|| measure(first));
        let second = measure(second);
        (first.join(), second)
    });
    let mut rows = first.map_err(|_| anyhow!("a measuring thread ended early"))??;
    rows.extend(second?);
    Ok(rows)
}

fn exceeded(toolchain: &Toolchain, rows: &[Row]) -> Result<()> {
    let budgets = budgets::read()?;
    if budgets.compiler != toolchain.release {
        eprintln!(
            "budgets hold for rustc {}; with rustc {} they are not compared",
            budgets.compiler, toolchain.release
        );
        return Ok(());
    }
    let wrong = budgets.compare(rows);
    if !wrong.is_empty() {
        bail!(
            "{}\nIf this is meant: `cargo xtask bench --accept`, and say why in the commit",
            wrong.join("\n")
        );
    }
    Ok(())
}
