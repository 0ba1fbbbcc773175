//! Rows of the bench for alignment: rest, coarse window and its second use, gate, planner, attitude in motion.

use nalgebra::Vector3;

use navsight::alignment::coarse::CoarseAlignment;
use navsight::alignment::gate::{self, Gate};
use navsight::alignment::in_motion::InMotion;
use navsight::alignment::planner::{Manoeuvre, Planner, Progress, Rules};
use navsight::alignment::standing::{Plan, StandingAlignment};
use navsight::alignment::stationary::{StationaryDetector, StationarySettings};
use navsight::filter::{Filter, Prior, UpdateReport};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::ZeroVelocity;

use crate::rows::{refused, settled, Table};

/// All rows of this page.
pub fn run(table: &mut Table, filter: &Filter, imu: ImuIncrement) -> core::fmt::Result {
    rest(table, imu)?;
    coarse(table, filter, imu)?;
    again(table, filter, imu)?;
    planning(table, filter)?;
    in_motion(table, imu)
}

/// The detector of rest: a sample, and one that closes a block.
fn rest(table: &mut Table, imu: ImuIncrement) -> core::fmt::Result {
    let sheet = StationarySettings::from_noise(1e-4, 1e-3, 0.01, 0.1);
    let mut detector = StationaryDetector::new(sheet).map_err(refused)?;
    for _ in 0..100 {
        detector.take(&imu).map_err(refused)?;
    }
    let mut state = (detector, imu);
    for _ in 0..10 {
        table.slice(
            "rest detector, dearest sample",
            "f32",
            &mut state,
            |(d, imu)| d.take(imu),
        )?;
    }
    Ok(())
}

/// The coarse window, and the gate before an update.
fn coarse(table: &mut Table, filter: &Filter, imu: ImuIncrement) -> core::fmt::Result {
    let position = filter.nav().position();
    let mut window = CoarseAlignment::new(&position, ImuLimits::DEFAULT).map_err(refused)?;
    for _ in 0..3100 {
        window.take(&imu).map_err(refused)?; // 124 points
    }
    table.row(
        "coarse window: one sample",
        "f32",
        (window.clone(), imu),
        |(window, imu)| window.take(imu),
    )?;
    table.row("coarse window: solution", "f32", window, |window| {
        window.solve()
    })?;
    let standing = ZeroVelocity::new(0.01, 0.1).map_err(refused)?;
    let measurement = standing.linearize(filter.nav());
    let mut gate = Gate::new(gate::Plan::BIASES).map_err(refused)?;
    gate.update(&mut filter.clone(), &measurement)
        .map_err(refused)?;
    let filter = settled(filter, &measurement)?;
    table.row(
        "gate and a three-row update",
        "f32",
        (gate, filter, measurement, UpdateReport::empty()),
        |(gate, filter, measurement, report)| gate.update_into(filter, measurement, report),
    )
}

/// The filter goes through the coarse window: the dearest call until it has caught up.
fn again(table: &mut Table, filter: &Filter, imu: ImuIncrement) -> core::fmt::Result {
    let plan = Plan {
        coarse_duration: 9.0,
        zero_velocity: ZeroVelocity::new(0.01, 1.0).map_err(refused)?,
        turning: 1.0,
    };
    let prior = Prior {
        position: [1.0; 3],
        velocity: [0.1; 3],
        attitude: [0.01, 0.01, 0.1],
        gyro_bias: [1e-7; 3],
        accel_bias: [1e-3; 3],
    };
    let (position, settings) = (filter.nav().position(), *filter.settings());
    let mut alignment =
        StandingAlignment::<16>::reusing(position, plan, prior, settings).map_err(refused)?;
    while alignment.filter().is_none() {
        alignment.take(&imu).map_err(refused)?;
    }
    let mut state = (alignment, imu);
    while state.0.is_behind() {
        table.slice(
            "coarse window used again, dearest sample",
            "f32",
            &mut state,
            |(alignment, imu)| alignment.take(imu),
        )?;
    }
    Ok(())
}

/// The planner, part by part.
fn planning(table: &mut Table, filter: &Filter) -> core::fmt::Result {
    let standing = ZeroVelocity::new(0.01, 1.0).map_err(refused)?;
    let rules = Rules {
        horizon: 12.0,
        ..Rules::usual(standing)
    };
    let both = [Manoeuvre::Along(1.0), Manoeuvre::USUAL[2]];
    let mut planner = Planner::new(filter, both, rules).map_err(refused)?;
    loop {
        let progress = table.slice("planner, dearest slice", "f32", &mut planner, |planner| {
            planner.slice()
        })?;
        if progress == Progress::Done {
            return Ok(());
        }
    }
}

/// Attitude of a moving vehicle: a sample, a velocity, the solution.
fn in_motion(table: &mut Table, imu: ImuIncrement) -> core::fmt::Result {
    let mut finder = InMotion::<16>::new(9.8, 1.0, ImuLimits::DEFAULT).map_err(refused)?;
    let mut v = Vector3::zeros();
    for k in 0..1200u16 {
        finder.take(&imu).map_err(refused)?;
        if k % 100 == 99 {
            v += Vector3::new(0.3, f32::from(k % 300) * 2e-3, 0.0);
            finder.velocity(finder.time(), v).map_err(refused)?;
        }
    }
    table.row(
        "attitude in motion: one sample",
        "f32",
        (finder.clone(), imu),
        |(finder, imu)| finder.take(imu),
    )?;
    let mut later = finder.clone();
    for _ in 0..100 {
        later.take(&imu).map_err(refused)?;
    }
    table.row(
        "attitude in motion: one velocity",
        "f32",
        (later, v),
        |(finder, v)| finder.velocity(finder.time(), *v),
    )?;
    table.row("attitude in motion: solution", "f32", finder, |finder| {
        // an even motion tells no heading; the work is the same
        let _ = finder.solve(0.1);
        Ok(())
    })
}
