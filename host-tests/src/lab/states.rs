//! The 15 states in the words and units of people, and ξ of an update.

use navsight::error::Error;
use navsight::error_model::N;
use navsight::filter::UpdateReport;
use navsight::observability::diagonal::Xi;

use crate::config::{DEG_PER_H, MICRO_G};

/// One state for people.
#[derive(Clone, Copy, Debug)]
pub struct State {
    /// What it is called.
    pub name: &'static str,
    /// Unit it is shown in.
    pub unit: &'static str,
    /// That unit in SI.
    pub in_si: f64,
}

const ARCSEC: f64 = core::f64::consts::PI / 180.0 / 3600.0;
const DEG: f64 = core::f64::consts::PI / 180.0;

const fn state(name: &'static str, unit: &'static str, in_si: f64) -> State {
    State { name, unit, in_si }
}

/// In the order of the filter.
pub const STATES: [State; N] = [
    state("position east", "m", 1.0),
    state("position north", "m", 1.0),
    state("height", "m", 1.0),
    state("velocity east", "mm/s", 1e-3),
    state("velocity north", "mm/s", 1e-3),
    state("velocity up", "mm/s", 1e-3),
    state("tilt about east", "″", ARCSEC),
    state("tilt about north", "″", ARCSEC),
    state("heading", "°", DEG),
    state("gyro bias right", "°/h", DEG_PER_H),
    state("gyro bias forward", "°/h", DEG_PER_H),
    state("gyro bias up", "°/h", DEG_PER_H),
    state("accelerometer bias right", "µg", MICRO_G),
    state("accelerometer bias forward", "µg", MICRO_G),
    state("accelerometer bias up", "µg", MICRO_G),
];

/// ξ1 [1/s] and ξ2 of the updates of one instant; NaN where one is not available. Their rows share one ξ1.
///
/// # Errors
/// [`Error::Variance`] when the filter is broken.
pub fn xi<const M: usize>(reports: &[UpdateReport<M>]) -> Result<([f64; N], [f64; N]), Error> {
    let (mut xi1, mut xi2) = ([0.0; N], [f64::NAN; N]);
    for report in reports {
        let xi = Xi::of(report)?;
        for (to, x) in xi1.iter_mut().zip(xi.xi1.all()) {
            *to += x.map_or(f64::NAN, f64::from);
        }
        xi2 = xi.xi2.all().map(|x| x.map_or(f64::NAN, f64::from));
    }
    Ok((xi1, xi2))
}
