//! The rows of the growth tables: a filter at rest, so that nothing but the number of rows or the rate changes.

use core::fmt::{Display, Write};

use cortex_m_semihosting::hio::HostStream;
use nalgebra::{SVector, Vector3};

use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{BiasModel, NoiseDensity, VEL};
use navsight::filter::{Filter, Prior, Settings, UpdateReport};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::{Jacobian, Linearized};
use navsight::nav::NavState;
use navsight::observability::diagonal::Xi;

use crate::probe::{calibration, empty, region};

fn refused(_: Error) -> core::fmt::Error {
    core::fmt::Error
}

pub fn run(out: &mut HostStream) -> core::fmt::Result {
    row(out, "empty\t", &mut (), empty)?;
    row(out, "calibration\t", &mut (), calibration)?;

    rows::<1>(out)?;
    rows::<2>(out)?;
    rows::<3>(out)?;
    rows::<4>(out)?;
    rows::<5>(out)?;
    rows::<6>(out)?;
    for rate in [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0] {
        second(out, rate)?;
    }
    Ok(())
}

/// An update of M rows on neighbouring states from the velocity on, with ξ, the fourth of its kind.
fn rows<const M: usize>(out: &mut HostStream) -> core::fmt::Result {
    let (mut filter, imu) = standing(10.0).map_err(refused)?;
    let rows = Linearized::<M> {
        nu: SVector::repeat(1e-4),
        h: Jacobian::Direct { first: VEL },
        r: SVector::repeat(1e-2),
        interval: 0.1,
    };
    let mut report = UpdateReport::empty();
    for _ in 0..3 {
        for _ in 0..10 {
            filter.propagate(&imu).map_err(refused)?;
        }
        filter.update_into(&rows, &mut report).map_err(refused)?;
    }
    let mut state = (filter, rows, report);
    row(
        out,
        format_args!("rows {M}\tf32"),
        &mut state,
        |(filter, rows, report)| {
            filter.update_into(rows, report)?;
            Xi::of(report)
        },
    )
}

/// One second of 100 Hz samples with this covariance rate [1/s].
fn second(out: &mut HostStream, rate: f32) -> core::fmt::Result {
    let mut state = standing(rate).map_err(refused)?;
    row(
        out,
        format_args!("rate {rate}\tf32"),
        &mut state,
        |(filter, imu)| {
            for _ in 0..100 {
                filter.propagate(imu)?;
            }
            Ok(())
        },
    )
}

/// Counts one piece of work. Work that is refused is no work.
fn row<S, R>(
    out: &mut HostStream,
    name: impl Display,
    state: &mut S,
    work: fn(&mut S) -> Result<R, Error>,
) -> core::fmt::Result {
    let (result, second) = region(state, work);
    writeln!(out, "row\t{name}\t{second}")?;
    result.map(drop).map_err(refused)
}

/// A filter at rest whose covariance moves at this rate, and its samples.
fn standing(rate: f32) -> Result<(Filter, ImuIncrement), Error> {
    let position = Geodetic::from_degrees(34.0, 108.0, 400.0);
    let attitude = Euler::from_degrees(30.0, 2.0, -5.0);
    let nav = NavState::new(position, Vector3::zeros(), attitude)?;
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
        bias: BiasModel::constant(),
        propagation_interval: 1.0 / rate,
        gate: Some(10.8),
    };
    let c_n_b = nav.c_b_n().transpose();
    let f_b = c_n_b * Vector3::new(0.0, 0.0, nav.local().gravity);
    let imu = ImuIncrement::from_rates(c_n_b * nav.local().omega_ie_n(), f_b, 0.01);
    Ok((Filter::new(nav, &prior, settings)?, imu))
}
