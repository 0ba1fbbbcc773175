//! The lab: one program on the PC, one file per command.
//!
//! What every command keeps to: `--json` prints one JSON object on standard output and nothing else there; progress
//! and messages go to standard error; exit 0 for done, 2 for bad input, with one line that says which file, line and
//! field.

pub mod align;
pub mod analyze;
pub mod covariance;
mod error;
pub mod history;
mod json;
pub mod montecarlo;
pub mod replay;
pub mod rest;
pub mod scenario;
pub mod solution;
pub mod states;
pub mod structural;
pub mod track;

pub use error::LabError;

use std::process::ExitCode;

use clap::{error::ErrorKind, Parser, Subcommand};

/// What navsight can see, worked out on a PC.
#[derive(Parser)]
#[command(name = "lab", bin_name = "cargo lab", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Simulates one- and two-position alignment: σ, ξ, η over time, and the tables of Lu 2009
    Align(Box<align::Args>),
    /// Every way of looking at one model, and whether they agree
    Analyze(analyze::Args),
    /// Covariance analysis of one configuration: P, ξ1, ξ2 and η at chosen times
    Covariance(covariance::Args),
    /// Is the filter as good as it says? Errors and innovations over many seeds
    Montecarlo(montecarlo::Args),
    /// The filter on recorded data: attitude, biases and what was observable
    Replay(Box<replay::Args>),
    /// When did the sensor stand still? The detector on recorded data, and both of its errors
    Rest(rest::Args),
    /// Tracking by satellite positions and velocities: estimates, gains and what was observable
    Track(track::Args),
    /// Graph analysis of zero patterns: what can be seen at all
    Structural(structural::Args),
}

/// Parses the command line, runs the command, and turns a failure into one line and exit code 2.
pub fn main() -> ExitCode {
    let done = match Cli::try_parse() {
        Ok(cli) => match cli.command {
            Command::Align(args) => align::run(&args),
            Command::Analyze(args) => analyze::run(&args),
            Command::Covariance(args) => covariance::run(&args),
            Command::Montecarlo(args) => montecarlo::run(&args),
            Command::Replay(args) => replay::run(&args),
            Command::Rest(args) => rest::run(&args),
            Command::Track(args) => track::run(&args),
            Command::Structural(args) => structural::run(&args),
        },
        Err(help)
            if matches!(
                help.kind(),
                ErrorKind::DisplayHelp | ErrorKind::DisplayVersion
            ) =>
        {
            print!("{help}");
            return ExitCode::SUCCESS;
        }
        Err(wrong) => Err(LabError::command_line(&wrong)),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("lab: {error}");
            ExitCode::from(2)
        }
    }
}

/// Pairs of `--outage FROM TO`.
pub fn outages(times: &[f64]) -> Result<Vec<(f64, f64)>, LabError> {
    let pair = |pair: &[f64]| match *pair {
        [from, to] if from < to => Ok((from, to)),
        [from, to] => Err(LabError::plain(format!(
            "it has to end after it begins, not from {from} to {to}"
        ))
        .field("--outage")),
        _ => Err(LabError::plain("two times are needed").field("--outage")),
    };
    times.chunks(2).map(pair).collect()
}

/// A progress bar on standard error, drawn only on a terminal.
pub fn progress(steps: u64, what: &'static str) -> indicatif::ProgressBar {
    let style = indicatif::ProgressStyle::with_template("{msg} {wide_bar} {percent}% {eta}")
        .unwrap_or_else(|_| indicatif::ProgressStyle::default_bar());
    indicatif::ProgressBar::new(steps)
        .with_style(style)
        .with_message(what)
}

/// Prints one JSON object on standard output.
pub fn print_json(value: &serde_json::Value) -> Result<(), LabError> {
    print_text(&format!("{value}\n"))
}

/// Prints on standard output. A reader that closed the pipe is no failure.
pub fn print_text(text: &str) -> Result<(), LabError> {
    use std::io::Write;
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(LabError::plain(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}
