//! Rows of the bench: is alignment finished, and what would help?

use navsight::alignment::planner::{Manoeuvre, Planner, Rules};
use navsight::alignment::supervisor::Supervisor;
use navsight::error::Error;
use navsight::error_model::N;
use navsight::filter::Filter;
use navsight::measurement::ZeroVelocity;
use navsight::observability::verdict::{Limits, Verdicts};

use crate::rows::Table;

/// Verdicts, supervisor and planner beside a filter that has run for a while.
pub fn run(table: &mut Table, filter: &Filter) -> core::fmt::Result {
    let refused = |_: Error| core::fmt::Error;
    let mut filter = filter.clone();
    let standing = ZeroVelocity::new(0.01, 1.0).map_err(refused)?;
    let measurement = standing.linearize(filter.nav());
    let report = filter.update(&measurement).map_err(refused)?;
    let required = [Some(1e-3); N];
    let limits = Limits::DEFAULT;
    let mut verdicts = Verdicts::new(filter.sigma0(), &required, limits).map_err(refused)?;
    verdicts.take(0.0, &report);
    table.row(
        "verdict: one update",
        "f32",
        (verdicts, report),
        |(v, r)| Ok(v.take(1.0, r)),
    )?;
    table.row(
        "verdict: an update that closes a block",
        "f32",
        (verdicts, report),
        |(v, r)| Ok(v.take(20.0, r)),
    )?;
    let mut supervisor = Supervisor::new(filter.sigma0(), &required, limits).map_err(refused)?;
    supervisor.take(0.0, &report);
    table.row(
        "supervisor: an update that closes a block",
        "f32",
        (supervisor, report),
        |(s, r)| Ok(s.take(20.0, r)),
    )?;
    let rules = Rules::usual(standing);
    let planner = Planner::new(&filter, Manoeuvre::USUAL, rules).map_err(refused)?;
    table.row(
        "planner: ten steps of a candidate",
        "f32",
        planner.clone(),
        |planner| planner.step(10),
    )?;
    table.row(
        "planner: ranking of six manoeuvres over 300 s",
        "f32",
        planner,
        |planner| planner.step(u16::MAX),
    )
}
