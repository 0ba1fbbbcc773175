//! The rows of the bench: each is a piece of work that a program on the vehicle would call, on a filter that has run
//! for a while.

use core::fmt::Write;

use nalgebra::{SMatrix, Vector3};

use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{block_rates, BiasModel, NoiseDensity};
use navsight::filter::{Filter, Prior, Settings, UpdateReport};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::{
    Antenna, Height, Linearized, MeasurementRows, Position, PositionVelocity, Velocity,
    ZeroVelocity,
};
use navsight::nav::NavState;
use navsight::observability::diagonal::{xi1_riccati_blocks, Xi};
use navsight::observability::extreme::Extremes15;
use navsight::observability::riccati::{DecreaseRate15, Information};
use navsight::observability::spectrum::{self, Directions, Spectrum15, ValuesOnly};

use crate::probe::{calibration, empty, region};

/// Where the rows are printed.
pub struct Table<'a>(pub &'a mut dyn Write);

impl Table<'_> {
    /// Counts one piece of work: a row of the table is one call of this. Work that is refused is no work.
    pub fn row<S, R>(
        &mut self,
        work: &str,
        scalar: &str,
        mut state: S,
        f: fn(&mut S) -> Result<R, Error>,
    ) -> core::fmt::Result {
        self.slice(work, scalar, &mut state, f).map(drop)
    }

    /// Counts one slice of a longer work: of rows with one name the table shows the dearest.
    pub fn slice<S, R>(
        &mut self,
        work: &str,
        scalar: &str,
        state: &mut S,
        f: fn(&mut S) -> Result<R, Error>,
    ) -> Result<R, core::fmt::Error> {
        let (result, second) = region(state, f);
        writeln!(self.0, "row\t{work}\t{scalar}\t{second}")?;
        result.map_err(refused)
    }
}

/// Work that is refused ends the bench.
pub fn refused(_: Error) -> core::fmt::Error {
    core::fmt::Error
}

/// The rows of a navigator, in the order of the table; the filter they were made with, and a next sample. The first two
/// say what the markers cost and that the counting is right.
pub fn usual(table: &mut Table) -> Result<(Filter, ImuIncrement), core::fmt::Error> {
    table.row("empty", "", (), empty)?;
    table.row("calibration", "", (), calibration)?;
    let (filter, imu) = aligning(100).map_err(refused)?;
    navigator(table, &filter, imu)?;
    observability(table, &filter)?;
    Ok((filter, imu))
}

/// What a program calls all the time.
fn navigator(table: &mut Table, filter: &Filter, imu: ImuIncrement) -> core::fmt::Result {
    table.row(
        "mechanization step",
        "f32",
        (*filter.nav(), imu),
        |(nav, imu)| nav.advance(imu),
    )?;
    table.row(
        "IMU sample through the filter",
        "f32",
        (filter.clone(), imu),
        |(filter, imu)| filter.propagate(imu),
    )?;
    table.row(
        "covariance propagation",
        "f32",
        gathered(filter, imu),
        |filter| {
            filter.synchronize();
            Ok(())
        },
    )?;
    let standing = ZeroVelocity::new(0.01, 0.1).map_err(refused)?;
    let measurement = standing.linearize(filter.nav());
    table.row(
        "three-row zero-velocity update",
        "f32",
        (settled(filter, &measurement)?, standing),
        |(filter, standing)| filter.update(&standing.linearize(filter.nav())),
    )?;
    table.row(
        "three-row velocity update with ξ1 and ξ2",
        "f32",
        (
            settled(filter, &measurement)?,
            standing,
            UpdateReport::empty(),
        ),
        |(filter, standing, report)| {
            filter.update_into(&standing.linearize(filter.nav()), report)?;
            Xi::of(report)
        },
    )?;
    table.row(
        "three-row velocity update with ξ1 and ξ2, the first: the variances of velocity collapse",
        "f32",
        (fresh()?, standing, UpdateReport::empty()),
        |(filter, standing, report)| {
            filter.update_into(&standing.linearize(filter.nav()), report)?;
            Xi::of(report)
        },
    )?;
    let height = Height::new(401.0, 1.0, 0.1).map_err(refused)?;
    let measurement = height.linearize(filter.nav());
    table.row(
        "one-row update",
        "f32",
        (settled(filter, &measurement)?, height),
        |(filter, height)| filter.update(&height.linearize(filter.nav())),
    )?;
    table.row(
        "one-row update with ξ1 and ξ2",
        "f32",
        (
            settled(filter, &measurement)?,
            height,
            UpdateReport::empty(),
        ),
        |(filter, height, report)| {
            filter.update_into(&height.linearize(filter.nav()), report)?;
            Xi::of(report)
        },
    )?;
    table.row(
        "one-row update, the first: a variance collapses",
        "f32",
        (filter.clone(), height),
        |(filter, height)| filter.update(&height.linearize(filter.nav())),
    )?;
    let fix = fix(filter.nav()).map_err(refused)?;
    let measurement = fix.linearize(filter.nav());
    table.row(
        "six-row fix on a lever arm, rows formed, with ξ1 and ξ2",
        "f32",
        (settled(filter, &measurement)?, fix, UpdateReport::empty()),
        |(filter, fix, report)| {
            filter.update_into(&fix.linearize(filter.nav()), report)?;
            Xi::of(report)
        },
    )?;
    table.row(
        "rows of a six-row fix",
        "f32",
        (filter.clone(), fix),
        |(filter, fix)| Ok(fix.linearize(filter.nav())),
    )?;
    table.row(
        "three dense rows",
        "f32",
        (settled(filter, &dense())?, dense()),
        |(filter, rows)| filter.update(rows),
    )
}

/// A filter just before its first update, a tenth of a second after its start.
fn fresh() -> Result<Filter, core::fmt::Error> {
    let (mut filter, imu) = aligning(0).map_err(refused)?;
    for _ in 0..10 {
        filter.propagate(&imu).map_err(refused)?;
    }
    filter.synchronize();
    Ok(filter)
}

/// The filter after ten of these updates, all rows of which it used: a gated row would be cheaper, and a variance that
/// collapses dearer.
pub fn settled<const M: usize, H: MeasurementRows<M>>(
    filter: &Filter,
    measurement: &Linearized<M, H>,
) -> Result<Filter, core::fmt::Error> {
    let mut filter = filter.clone();
    for _ in 0..10 {
        let report = filter.update(measurement).map_err(refused)?;
        if report.rows_accepted() != M {
            return Err(core::fmt::Error);
        }
    }
    Ok(filter)
}

/// What the filter can tell about itself, after one more zero-velocity update.
fn observability(table: &mut Table, filter: &Filter) -> core::fmt::Result {
    let mut filter = filter.clone();
    let measurement = ZeroVelocity::new(0.01, 0.1)
        .map_err(refused)?
        .linearize(filter.nav());
    let report = filter.update(&measurement).map_err(refused)?;
    let information = Information::of(&measurement, filter.sigma0());
    let nav = filter.nav();
    let rates = block_rates(
        &filter.environment(),
        &nav.c_b_n(),
        &Vector3::new(0.0, 0.0, nav.local().gravity),
        filter.scaling(),
    );
    let p = *filter.covariance();
    table.row("ξ set: ξ1 and ξ2 of 15 states", "f32", report, |report| {
        Xi::of(report)
    })?;
    table.row(
        "Riccati ξ1 of 15 states",
        "f32",
        (p, rates, information),
        |(p, rates, information)| Ok(xi1_riccati_blocks(p, rates, information.as_ref(), u32::MAX)),
    )?;
    let independent = spectrum::Prior::Independent;
    table.row(
        "full η2 spectrum, values",
        "f32",
        (p, Spectrum15::<f32, ValuesOnly>::new()),
        |(p, eta)| {
            eta.start_accuracy(p, spectrum::Prior::Independent, u32::MAX)?;
            eta.step(u32::MAX)
        },
    )?;
    table.row(
        "full η2 spectrum, values and directions",
        "f32",
        (p, Spectrum15::<f32, Directions<f32, 15>>::new()),
        |(p, eta)| {
            eta.start_accuracy(p, spectrum::Prior::Independent, u32::MAX)?;
            eta.step(u32::MAX)
        },
    )?;
    let mut slice = Spectrum15::<f32, ValuesOnly>::new();
    slice
        .start_accuracy(&p, independent, u32::MAX)
        .map_err(refused)?;
    table.row("one slice of an η spectrum", "f32", slice, |eta| {
        eta.step(spectrum::SLICE)
    })?;
    let room = Extremes15::<f32>::new();
    table.row(
        "largest η2 alone, with its direction",
        "f32",
        (p, room.clone()),
        |(p, room)| room.most(p, u32::MAX),
    )?;
    table.row(
        "smallest η2 alone, with its direction",
        "f32",
        (p, room),
        |(p, room)| room.least(p, u32::MAX),
    )?;
    let Some(information) = information else {
        return Err(core::fmt::Error);
    };
    let rate = DecreaseRate15::blocks(&p, &rates, &information);
    table.row(
        "−Ṗ for η1",
        "f32",
        (p, rates, information),
        |(p, rates, information)| Ok(DecreaseRate15::blocks(p, rates, information)),
    )?;
    table.row(
        "full η1 spectrum, values",
        "f32",
        (rate, Spectrum15::<f32, ValuesOnly>::new()),
        |(rate, eta)| {
            eta.start_speed(rate, spectrum::Prior::Independent, u32::MAX)?;
            eta.step(u32::MAX)
        },
    )
}

/// Position and velocity of an antenna a metre and a half away, near where the filter is.
pub fn fix(nav: &NavState) -> Result<PositionVelocity, Error> {
    let antenna = Antenna::new(Vector3::new(0.5, -1.0, 1.2))?;
    let sigma = Vector3::new(0.5, 0.5, 1.0);
    let position = Position::new(nav.position(), sigma, 0.1)?;
    let velocity = Velocity::new(nav.v_n(), sigma * 0.1, 0.1)?;
    Ok(PositionVelocity::new(position, velocity, antenna))
}

/// Three rows that measure everything a little.
fn dense() -> Linearized<3, SMatrix<f32, 3, 15>> {
    Linearized {
        nu: Vector3::new(1e-3, -2e-3, 1e-3),
        h: SMatrix::from_fn(|i, j| 0.1 + (i as f32) * 0.3 - (j as f32) * 0.01),
        r: Vector3::repeat(1e-4),
        interval: 0.1,
    }
}

/// A filter one sample before its covariance moves.
fn gathered(filter: &Filter, imu: ImuIncrement) -> Filter {
    let mut filter = filter.clone();
    for _ in 0..9 {
        let _ = filter.propagate(&imu);
    }
    filter
}

/// A filter some tenths of a second into its alignment, tilted, with zero-velocity updates ten times a second; and a next
/// sample.
fn aligning(updates: u8) -> Result<(Filter, ImuIncrement), Error> {
    let position = Geodetic::from_degrees(34.0, 108.0, 400.0);
    let nav = NavState::new(
        position,
        Vector3::zeros(),
        Euler::from_degrees(30.0, 2.0, -5.0),
    )?;
    let prior = Prior {
        position: [10.0; 3],
        velocity: [0.1; 3],
        attitude: [5e-3, 5e-3, 0.05],
        gyro_bias: [1e-7; 3],
        accel_bias: [1e-3; 3],
    };
    let settings = Settings {
        limits: ImuLimits::DEFAULT,
        noise: NoiseDensity::from_random_walks(1e-4, 1e-6),
        bias: BiasModel::from_correlation_times(3600.0, 3600.0)?,
        propagation_interval: 0.1,
        gate: Some(10.8),
    };
    let f_b = nav.c_b_n().transpose() * Vector3::new(0.0, 0.0, nav.local().gravity);
    let omega_b = nav.c_b_n().transpose() * nav.local().omega_ie_n();
    let mut filter = Filter::new(nav, &prior, settings)?;
    let standing = ZeroVelocity::new(0.01, 0.1)?;
    let imu = |k: u8| {
        let sway = Vector3::new(0.02, -0.01, 0.03) * (f32::from(k % 16) / 8.0 - 1.0);
        ImuIncrement::from_rates(omega_b + sway * 0.1, f_b + sway, 0.01)
    };
    for k in 0..updates {
        for i in 0..10u8 {
            filter.propagate(&imu(k.wrapping_mul(10).wrapping_add(i)))?;
        }
        filter.update(&standing.linearize(filter.nav()))?;
    }
    Ok((filter, imu(3)))
}
