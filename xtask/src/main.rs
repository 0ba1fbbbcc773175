//! `cargo xtask COMMAND`: the one way to run things in navsight, for people and for CI.
//!
//! Every command does its own set-up: on a machine with Rust (by rustup), git and Debian packages nothing has to be
//! prepared.

use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};

mod bench;
mod builds;
mod debian;
mod golden;
mod mutants;
mod packages;
mod pairs;
mod panics;
mod peers;
mod places;
mod qemu;
mod report;
mod shell;
mod size;
mod test;
mod toolchain;

#[derive(Parser)]
#[command(
    name = "cargo xtask",
    bin_name = "cargo xtask",
    about = "Builds, checks and measures navsight"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Bring the bare-metal Rust targets, QEMU and the small tools; does nothing where they are
    Setup,
    /// Run every check: format, clippy, host tests, bare-metal builds, panic proof, QEMU comparison, budgets
    Test {
        /// The long runs too (the ignored tests, in release)
        #[arg(long)]
        full: bool,
    },
    /// Build the library for the four bare targets, each feature alone and all together; clippy and docs
    Thumb,
    /// Run every example on the host and on a Cortex-M4F in QEMU, and compare what they print, byte for byte
    Qemu,
    /// Count instructions and stack on the Cortex-M4F, write BENCHMARKS.md, compare with the budgets
    Bench {
        /// Print one JSON list and nothing else on standard output
        #[arg(long)]
        json: bool,
        /// On other cores and at opt-level "z" too, and growth: rows 1 … 6, covariance rates 1 … 100 Hz
        #[arg(long)]
        all: bool,
        /// Instead, where the instructions of one piece of work lie; of those on docs/performance.md, if none is named
        #[arg(long, value_name = "WORK", num_args = 0..=1, default_missing_value = "", conflicts_with_all = ["json", "all", "accept"])]
        histogram: Option<String>,
        /// Take what was measured as the new budgets
        #[arg(long)]
        accept: bool,
    },
    /// Count other filters beside ours on the same work, write their table into BENCHMARKS.md
    Peers,
    /// Flash per group of functions and per room, at opt-level 3, "s" and "z"
    Size,
    /// Prove at link time that no panic path survives, at opt-level 3 and "s"
    PanicFree,
    /// Put sign errors into a copy of the sources, one at a time: a test must find each
    Mutants {
        /// Only those whose file, description or test contains this
        #[arg(default_value = "")]
        only: String,
    },
    /// Compare the golden traces
    Golden {
        /// Rewrite them
        #[arg(long)]
        accept: bool,
    },
}

fn main() -> ExitCode {
    match run(Cli::parse().command) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("{error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> Result<ExitCode> {
    match command {
        Command::Setup => {
            let toolchain = toolchain::ready()?;
            packages::ready(&packages::ALL)?;
            eprintln!("bare-metal targets: {toolchain}; QEMU {}", qemu::version()?);
            Ok(ExitCode::SUCCESS)
        }
        Command::Test { full } => test::run(full),
        Command::Thumb => report::standalone(|report| builds::bare(report, &toolchain::ready()?)),
        Command::Qemu => report::standalone(|report| pairs::compare(report, &toolchain::ready()?)),
        Command::Bench {
            histogram: Some(work),
            ..
        } => bench::histogram(&work).map(|()| ExitCode::SUCCESS),
        Command::Bench {
            json, all, accept, ..
        } => bench::run(json, accept, all),
        Command::Peers => peers::run(),
        Command::Size => size::run(),
        Command::PanicFree => {
            report::standalone(|report| panics::prove(report, &toolchain::ready()?))
        }
        Command::Mutants { only } => report::standalone(|report| mutants::run(report, &only)),
        Command::Golden { accept } => golden::run(accept),
    }
}
