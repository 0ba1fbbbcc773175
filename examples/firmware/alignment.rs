//! Rows of the bench for alignment: rest, coarse window and its second use, start of a filter, gate, planner, attitude in
//! motion.

use core::hint::black_box;

use nalgebra::{SMatrix, SVector, Vector3};

use navsight::alignment::coarse::CoarseAlignment;
use navsight::alignment::gate::{self, Gate};
use navsight::alignment::heading_source::OutsideHeading;
use navsight::alignment::in_motion::InMotion;
use navsight::alignment::planner::{Manoeuvre, Planner, Progress, Rules};
use navsight::alignment::standing::{self, Plan, StandingAlignment};
use navsight::alignment::stationary::{StationaryDetector, StationarySettings};
use navsight::error::Error;
use navsight::filter::{Filter, Prior, UpdateReport};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::ZeroVelocity;

use crate::rows::{refused, settled, Table};

/// All rows of this page.
pub fn run(table: &mut Table, filter: &Filter, imu: ImuIncrement) -> core::fmt::Result {
    rest(table, imu)?;
    coarse(table, filter, imu)?;
    starts(table, filter)?;
    beginnings(table, filter, imu)?;
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

/// What a standing vehicle starts with.
const PRIOR: Prior = Prior {
    position: [1.0; 3],
    velocity: [0.1; 3],
    attitude: [0.01, 0.01, 0.1],
    gyro_bias: [1e-7; 3],
    accel_bias: [1e-3; 3],
};

/// The shortest window.
fn plan() -> Result<Plan, Error> {
    Ok(Plan {
        coarse_duration: 9.0,
        zero_velocity: ZeroVelocity::new(0.01, 1.0)?,
        turning: 1.0,
    })
}

/// A filter starts.
fn starts(table: &mut Table, filter: &Filter) -> core::fmt::Result {
    let (nav, settings) = (*filter.nav(), *filter.settings());
    table.row(
        "filter: start",
        "f32",
        (nav, PRIOR, settings),
        |(nav, prior, settings)| Filter::new(*nav, prior, *settings),
    )?;
    let sigma0 = PRIOR.sigma0().map_err(refused)?;
    let p0 = SMatrix::from_diagonal(&SVector::from(sigma0.map(|sigma| sigma * sigma)));
    table.row(
        "filter: start with a full covariance",
        "f32",
        (nav, p0, settings),
        |(nav, p0, settings)| Filter::with_covariance(*nav, p0, *settings),
    )
}

/// A standing alignment begins, and starts its filter when the window closes: by the earth rate, and levelled with a
/// heading from outside.
fn beginnings(table: &mut Table, filter: &Filter, imu: ImuIncrement) -> core::fmt::Result {
    let given = (
        filter.nav().position(),
        plan().map_err(refused)?,
        PRIOR,
        *filter.settings(),
    );
    let (position, plan, prior, settings) = given;
    table.row(
        "standing alignment: beginning",
        "f32",
        given,
        |(position, plan, prior, settings)| {
            StandingAlignment::<16>::reusing(*position, *plan, *prior, *settings)
        },
    )?;
    let outside = OutsideHeading::new(0.5, 0.01).map_err(refused)?;
    let of_mems = Prior {
        gyro_bias: [5e-3; 3],
        ..prior
    };
    table.row(
        "standing alignment: beginning",
        "f32",
        (given, outside),
        |((position, plan, prior, settings), outside)| {
            StandingAlignment::with_heading(*position, *plan, *prior, *settings, Some(*outside))
        },
    )?;
    let name = "standing alignment: start of the filter";
    let alignment = StandingAlignment::new(position, plan, prior, settings);
    start(table, name, alignment.map_err(refused)?, imu)?;
    let alignment = StandingAlignment::<16>::reusing(position, plan, prior, settings);
    start(table, name, alignment.map_err(refused)?, imu)?;
    let alignment =
        StandingAlignment::with_heading(position, plan, of_mems, settings, Some(outside));
    start(
        table,
        "standing alignment: start of the filter, levelled",
        alignment.map_err(refused)?,
        imu,
    )
}

/// The last samples of the window, the dearest of which starts the filter.
fn start<const K: usize>(
    table: &mut Table,
    name: &str,
    mut alignment: StandingAlignment<K>,
    imu: ImuIncrement,
) -> core::fmt::Result {
    for _ in 0..895 {
        alignment.take(&imu).map_err(refused)?;
    }
    let mut state = (alignment, imu, standing::Progress::Coarse);
    while state.0.filter().is_none() {
        table.slice(name, "f32", &mut state, |(alignment, imu, progress)| {
            alignment.take_into(imu, progress)
        })?;
    }
    Ok(())
}

/// The filter goes through the coarse window: the dearest call until it has caught up.
fn again(table: &mut Table, filter: &Filter, imu: ImuIncrement) -> core::fmt::Result {
    let (position, settings) = (filter.nav().position(), *filter.settings());
    let plan = plan().map_err(refused)?;
    let mut alignment =
        StandingAlignment::<16>::reusing(position, plan, PRIOR, settings).map_err(refused)?;
    while alignment.filter().is_none() {
        alignment.take(&imu).map_err(refused)?;
    }
    let mut state = (alignment, imu, standing::Progress::Coarse);
    while state.0.is_behind() {
        table.slice(
            "coarse window used again, dearest sample",
            "f32",
            &mut state,
            |(alignment, imu, progress)| alignment.take_into(imu, progress),
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
        let _ = black_box(finder.solve(0.1));
        Ok(())
    })
}
