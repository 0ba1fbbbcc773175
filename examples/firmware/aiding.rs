//! Rows of the bench for aiding: course, two antennas, barometer, wheels, rest, fixes that come late, and the tracker.

use nalgebra::Vector3;

use navsight::attitude::Euler;
use navsight::filter::{Aided, Filter, Gate, LateFilter, Source, UpdateReport};
use navsight::imu::ImuIncrement;
use navsight::measurement::{
    Antenna, Barometer, Boresight, Course, Heading, NonHolonomic, Odometer, PositionVelocity,
    ZeroRotation,
};
use navsight::observability::diagonal::Xi;
use navsight::tracking::{
    CurrentModel, Fix, Kinematics, Limits, LocalTracker, Reading, Report, Settings,
};

use crate::rows::{fix, refused, settled, Table};

/// Half a second of samples at 100 Hz.
const REMEMBERED: usize = 64;

/// All rows of this page.
pub fn run(table: &mut Table, filter: &Filter, imu: ImuIncrement) -> core::fmt::Result {
    vehicle(table, filter)?;
    late(table, filter, imu)?;
    tracker(table)
}

/// One measurement, linearised and used, to ξ: a row of the table.
macro_rules! aid {
    ($table:ident, $work:literal, $filter:ident, $model:expr) => {{
        let model = $model.map_err(refused)?;
        let measurement = model.linearize($filter.nav());
        let state = (
            settled($filter, &measurement)?,
            model,
            UpdateReport::empty(),
        );
        $table.row($work, "f32", state, |(filter, model, report)| {
            filter.update_into(&model.linearize(filter.nav()), report)?;
            Xi::of(report)
        })
    }};
}

/// Updates of a vehicle, each near what the filter expects.
fn vehicle(table: &mut Table, filter: &Filter) -> core::fmt::Result {
    let nav = filter.nav();
    let heading = nav.euler().heading;
    let mounting = Boresight::new(Euler {
        heading: 0.02,
        pitch: 0.01,
        roll: 0.0,
    })
    .map_err(refused)?;
    let wheel = Antenna::new(Vector3::new(0.8, -1.1, -0.4)).map_err(refused)?;
    let sigma = Vector3::new(0.1, 0.05, 0.2);
    aid!(
        table,
        "course with a boresight, ξ1 and ξ2",
        filter,
        Course::new(heading + 0.02, mounting, 0.02, 1.0)
    )?;
    aid!(
        table,
        "heading of two antennas, ξ1 and ξ2",
        filter,
        Heading::of_axis(Vector3::new(0.1, 0.9, 0.05), heading, 0.2, 1.0)
    )?;
    let barometer = Barometer::calibrate(95_000.0, 288.15, nav.position().height);
    let barometer = barometer.map_err(refused)?;
    let height = barometer.measure(94_999.0, 1.0, 0.1).map_err(refused)?;
    let filtered = settled(filter, &height.linearize(nav))?;
    table.row(
        "height of a pressure, ξ1 and ξ2",
        "f32",
        (filtered, barometer, UpdateReport::empty()),
        |(filter, barometer, report)| {
            let height = barometer.measure(94_999.0, 1.0, 0.1)?;
            filter.update_into(&height.linearize(filter.nav()), report)?;
            Xi::of(report)
        },
    )?;
    aid!(
        table,
        "odometer with non-holonomic constraint, three rows, ξ1 and ξ2",
        filter,
        Odometer::new(0.0, wheel, mounting, sigma, 0.1)
    )?;
    aid!(
        table,
        "non-holonomic constraint alone, two rows, ξ1 and ξ2",
        filter,
        NonHolonomic::new(wheel, mounting, 0.1, 0.2, 0.1)
    )?;
    let rate = nav.c_b_n().transpose() * nav.local().omega_ie_n() + nav.b_g();
    aid!(
        table,
        "zero-rotation update, three rows, ξ1 and ξ2",
        filter,
        ZeroRotation::new(rate, 1e-3, 1.0)
    )
}

/// A fix of 0.2 s ago, between two remembered states; every sample is remembered.
fn late(table: &mut Table, filter: &Filter, imu: ImuIncrement) -> core::fmt::Result {
    let gate = Gate {
        limit: Some(25.0),
        lock_out: None,
    };
    let mut source = Source::new(gate).map_err(refused)?;
    let mut late = LateFilter::<REMEMBERED>::new(filter.clone(), 0.0).map_err(refused)?;
    let fix = fix(filter.nav()).map_err(refused)?;
    for _ in 0..10 {
        for _ in 0..30 {
            late.propagate(&imu).map_err(refused)?;
        }
        let age = late.filter().time() - 0.205;
        let aided = late.update(&mut source, age, |nav| fix.linearize(nav));
        if aided.map_err(refused)?.report.rows_accepted() != 6 {
            return Err(core::fmt::Error);
        }
    }
    for _ in 0..25 {
        late.propagate(&imu).map_err(refused)?;
    }
    late.synchronize();
    table.row(
        "IMU sample through the filter, remembered",
        "f32",
        (late.clone(), imu),
        |(late, imu)| late.propagate(imu),
    )?;
    type Late = (LateFilter<REMEMBERED>, Source, PositionVelocity, Aided<6>);
    let state: Late = (late, source, fix, Aided::empty());
    table.row(
        "six-row fix 0.2 s late, with its rows",
        "f32",
        state,
        |(late, source, fix, aided)| {
            let time = late.filter().time() - 0.205;
            late.update_into(source, time, |nav| fix.linearize(nav), aided)
        },
    )
}

/// Three axes, position and velocity, ten fixes old.
fn tracker(table: &mut Table) -> core::fmt::Result {
    let settings = Settings::new(CurrentModel::current(100.0, Limits::new(2.0, -2.0)));
    let at = |position, velocity, acceleration| Kinematics {
        position: [position; 3],
        velocity: [velocity; 3],
        acceleration: [acceleration; 3],
    };
    let mut tracker: LocalTracker<f32> =
        LocalTracker::new(&at(0.0, 0.0, 0.0), &at(100.0, 10.0, 1.0), settings).map_err(refused)?;
    let fix = Fix {
        position: Some(Reading::new([1.0, -2.0, 0.5], 100.0)),
        velocity: Some(Reading::new([0.1, -0.2, 0.05], 0.1)),
    };
    for _ in 0..10 {
        tracker.predict(1.0).map_err(refused)?;
        tracker.update(&fix).map_err(refused)?;
    }
    table.row("tracker: prediction, three axes", "f32", tracker, |t| {
        t.predict(1.0)
    })?;
    table.row(
        "tracker: fix of six channels, three axes",
        "f32",
        (tracker, fix, Report::empty()),
        |(t, fix, report)| t.update_into(fix, report),
    )
}
