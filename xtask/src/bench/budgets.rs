//! Budgets: what a piece of work may cost. They live in `xtask/budgets.toml` and hold for one compiler.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::measure::Row;
use super::Measured;
use crate::shell;
use crate::toolchain::Toolchain;

/// A count may be this much above its budget: moves of a register here and there are no regression.
const SLACK: f64 = 1.03;

const HEAD: &str = "# What each state may take and each piece of work may cost on the Cortex-M4F, with the compiler named below; checked by `cargo xtask test`.\n\
                    # Rewritten by `cargo xtask bench --accept`; the commit says why.\n\n";

#[derive(Default, Serialize, Deserialize)]
pub struct Budgets {
    /// Release of rustc.
    pub compiler: String,
    #[serde(default)]
    ram: Vec<Ram>,
    #[serde(default)]
    row: Vec<Budget>,
}

/// What a state may take.
#[derive(Serialize, Deserialize)]
struct Ram {
    state: String,
    bytes: u64,
}

#[derive(Serialize, Deserialize)]
struct Budget {
    work: String,
    scalar: String,
    opt: String,
    cpu_flag: String,
    instructions: u64,
    stack_bytes: u64,
}

impl Budget {
    fn is_of(&self, row: &Row) -> bool {
        self.work == row.work
            && self.scalar == row.scalar
            && self.opt == row.opt
            && self.cpu_flag == row.cpu_flag
    }
}

impl Budgets {
    /// What costs more than it may, what has no budget, and what is no longer measured.
    pub fn compare(&self, measured: &Measured) -> Vec<String> {
        let mut wrong = self.compare_rows(&measured.rows);
        for (state, is) in &measured.states {
            match self.ram.iter().find(|budget| budget.state == *state) {
                None => wrong.push(format!("{state}: has no budget")),
                Some(budget) if is_above(*is, budget.bytes) => wrong.push(format!(
                    "{state}: {is} bytes of RAM, the budget is {}",
                    budget.bytes
                )),
                Some(_) => {}
            }
        }
        for budget in &self.ram {
            let state = &budget.state;
            if !measured.states.iter().any(|(name, _)| name == state) {
                wrong.push(format!("{state}: has a budget and is not measured"));
            }
        }
        wrong
    }

    fn compare_rows(&self, rows: &[Row]) -> Vec<String> {
        let mut wrong = Vec::new();
        for row in rows {
            let name = format!(
                "{} ({}, opt {} {})",
                row.work, row.scalar, row.opt, row.cpu_flag
            );
            let Some(budget) = self.row.iter().find(|budget| budget.is_of(row)) else {
                wrong.push(format!("{name}: has no budget"));
                continue;
            };
            for (what, is, may) in [
                ("instructions", row.instructions, budget.instructions),
                ("bytes of stack", row.stack_bytes, budget.stack_bytes),
            ] {
                if is_above(is, may) {
                    wrong.push(format!("{name}: {is} {what}, the budget is {may}"));
                }
            }
        }
        for budget in &self.row {
            if !rows.iter().any(|row| budget.is_of(row)) {
                wrong.push(format!(
                    "{} ({}, opt {}): has a budget and is not measured",
                    budget.work, budget.scalar, budget.opt
                ));
            }
        }
        wrong
    }
}

fn is_above(is: u64, may: u64) -> bool {
    is as f64 > may as f64 * SLACK
}

fn file() -> PathBuf {
    shell::root().join("xtask/budgets.toml")
}

pub fn read() -> Result<Budgets> {
    toml::from_str(&fs::read_to_string(file())?).context("xtask/budgets.toml")
}

/// Takes what was measured as the new budgets.
pub fn write(toolchain: &Toolchain, measured: &Measured) -> Result<()> {
    let row = measured.rows.iter().map(|row| Budget {
        work: row.work.clone(),
        scalar: row.scalar.clone(),
        opt: row.opt.to_owned(),
        cpu_flag: row.cpu_flag.clone(),
        instructions: row.instructions,
        stack_bytes: row.stack_bytes,
    });
    let ram = measured.states.iter().map(|(state, bytes)| Ram {
        state: state.clone(),
        bytes: *bytes,
    });
    let budgets = Budgets {
        compiler: toolchain.release.clone(),
        ram: ram.collect(),
        row: row.collect(),
    };
    fs::write(file(), format!("{HEAD}{}", toml::to_string(&budgets)?))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(work: &str, instructions: u64, stack_bytes: u64) -> Row {
        Row {
            work: work.to_owned(),
            core: "Cortex-M4F",
            opt: "3",
            cpu_flag: String::new(),
            scalar: "f32".to_owned(),
            instructions,
            stack_bytes,
        }
    }

    fn budgets() -> Budgets {
        let text = "compiler = \"1\"\n[[ram]]\nstate = \"Filter\"\nbytes = 1000\n[[row]]\nwork = \"step\"\nscalar = \"f32\"\nopt = \"3\"\ncpu_flag = \"\"\ninstructions = 1000\nstack_bytes = 200\n";
        toml::from_str(text).unwrap()
    }

    fn wrong(rows: &[Row], states: &[(&str, u64)]) -> usize {
        let states = states.iter().map(|&(name, bytes)| (name.to_owned(), bytes));
        let measured = Measured {
            rows: rows.to_vec(),
            states: states.collect(),
        };
        budgets().compare(&measured).len()
    }

    const FILTER: [(&str, u64); 1] = [("Filter", 1000)];

    #[test]
    fn three_percent_pass_and_more_does_not() {
        assert_eq!(wrong(&[row("step", 1030, 206)], &FILTER), 0);
        assert_eq!(wrong(&[row("step", 10, 2)], &FILTER), 0);
        assert_eq!(wrong(&[row("step", 1031, 200)], &FILTER), 1);
        assert_eq!(wrong(&[row("step", 1000, 207)], &FILTER), 1);
        let step = [row("step", 1000, 200)];
        assert_eq!(wrong(&step, &[("Filter", 1030)]), 0);
        assert_eq!(wrong(&step, &[("Filter", 1031)]), 1);
    }

    #[test]
    fn a_row_without_a_budget_and_a_budget_without_a_row_are_reported() {
        let step = row("step", 1000, 200);
        assert_eq!(wrong(&[step.clone(), row("other", 1, 1)], &FILTER), 1);
        assert_eq!(wrong(&[], &FILTER), 1);
        let step = [step];
        assert_eq!(wrong(&step, &[("Filter", 1000), ("Other", 1)]), 1);
        assert_eq!(wrong(&step, &[]), 1);
    }
}
