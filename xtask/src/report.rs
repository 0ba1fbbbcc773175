//! One line per check while it runs, and the count of them all at the end.

use std::io::{stderr, IsTerminal};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{anyhow, Result};
use indicatif::{ProgressBar, ProgressStyle};

/// What passed and what failed so far.
#[derive(Default)]
pub struct Report {
    passed: usize,
    failed: Vec<String>,
}

impl Report {
    /// Runs one check. A failure is shown and counted, and the others still run.
    pub fn check(&mut self, name: &str, work: impl FnOnce() -> Result<()>) {
        let spinner = spinner(name);
        let start = Instant::now();
        let outcome = work();
        spinner.finish_and_clear();
        self.note(name, outcome, start.elapsed());
    }

    /// Runs checks at the same time, each in a thread; they are shown in the order given.
    pub fn check_together(&mut self, checks: Vec<Check<'_>>) {
        let names: Vec<String> = checks.iter().map(|check| check.name.clone()).collect();
        let spinner = spinner(&names.join("; "));
        let outcomes: Vec<_> = std::thread::scope(|scope| {
            let mut threads = Vec::new();
            for check in checks {
                threads.push(scope.spawn(move || {
                    let start = Instant::now();
                    ((check.work)(), start.elapsed())
                }));
            }
            threads.into_iter().map(|thread| thread.join()).collect()
        });
        spinner.finish_and_clear();
        for (name, outcome) in names.iter().zip(outcomes) {
            let ended_early = |_| (Err(anyhow!("the check itself panicked")), Duration::ZERO);
            let (outcome, time) = outcome.unwrap_or_else(ended_early);
            self.note(name, outcome, time);
        }
    }

    fn note(&mut self, name: &str, outcome: Result<()>, time: Duration) {
        let seconds = time.as_secs_f32();
        match outcome {
            Ok(()) => {
                self.passed += 1;
                eprintln!("ok      {name} ({seconds:.1} s)");
            }
            Err(error) => {
                eprintln!("FAILED  {name} ({seconds:.1} s)\n{error:#}");
                self.failed.push(name.to_owned());
            }
        }
    }

    /// Adds what another runner counted.
    pub fn add(&mut self, name: &str, passed: usize, failed: usize) {
        self.passed += passed;
        self.failed.extend((0..failed).map(|_| name.to_owned()));
    }

    /// Prints the summary, `N passed, N failed` alone on the last line.
    pub fn finish(mut self) -> ExitCode {
        let failed = self.failed.len();
        self.failed.dedup();
        if failed > 0 {
            println!("failed: {}", self.failed.join(", "));
        }
        println!("{} passed, {failed} failed", self.passed);
        if failed > 0 {
            ExitCode::FAILURE
        } else {
            ExitCode::SUCCESS
        }
    }
}

/// A check that may run beside others.
pub struct Check<'a> {
    name: String,
    work: Work<'a>,
}

type Work<'a> = Box<dyn FnOnce() -> Result<()> + Send + 'a>;

impl<'a> Check<'a> {
    pub fn new(name: String, work: impl FnOnce() -> Result<()> + Send + 'a) -> Self {
        Self {
            name,
            work: Box::new(work),
        }
    }
}

/// Runs some checks as a command of their own.
pub fn standalone(work: impl FnOnce(&mut Report) -> Result<()>) -> Result<ExitCode> {
    let mut report = Report::default();
    work(&mut report)?;
    Ok(report.finish())
}

fn spinner(name: &str) -> ProgressBar {
    if !stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{spinner}       {msg} ({elapsed})");
    let bar = ProgressBar::new_spinner().with_message(name.to_owned());
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()));
    bar.enable_steady_tick(Duration::from_millis(120));
    bar
}
