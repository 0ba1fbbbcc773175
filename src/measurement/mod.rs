//! What a sensor says about the navigator: measurements, each linearised at the current estimate.
//!
//! | measurement | rows | z, unit | Jacobian | file |
//! |---|---|---|---|---|
//! | [`ZeroVelocity`] | 3 | 0 = v_n [m/s] | −1 on δv | `zero_velocity.rs` |
//! | [`Velocity`] | 3 or 2 | v_n, east-north-up [m/s] | −1 on δv; with a lever arm ψ and b_g | `velocity.rs` |
//! | [`Position`] | 3 or 2 | latitude, longitude [rad], height [m]; innovation in metres east-north-up | −1 on δr; with a lever arm ψ | `position.rs` |
//! | [`PositionVelocity`] | 6 | both of one epoch | as the two | `position_velocity.rs` |
//! | [`Height`] | 1 | ellipsoidal height [m] | −1 on δr_U | `height.rs` |
//! | [`Heading`] | 1 | azimuth of a body axis, clockwise from true north [rad] | −1 on ψ_U; tilt where the axis is steep | `heading.rs` |
//! | [`ZeroRotation`] | 3 | mean gyro output at rest, body axes [rad/s] | 1 on b_g, earth rate on ψ | `zero_rotation.rs` |
//! | [`Barometer`] | | pressure to [`Height`] | | `barometer.rs` |
//! | [`Course`] | 1 | direction of motion, clockwise from north [rad] | ψ | `course.rs` |
//! | [`Odometer`] | 3 | speed along the vehicle, none across [m/s] | δv, ψ, b_g | `odometer.rs` |
//! | [`NonHolonomic`] | 2 | no speed across the vehicle [m/s] | δv, ψ, b_g | `odometer.rs` |
//!
//! How good the three components of a fix are is an [`Accuracy`]: per axis, by the figures of a receiver, or a full
//! covariance. Where the sensor sits is an [`Antenna`]; how the vehicle's axes stand in those of the IMU a
//! [`Boresight`].
//!
//! A measurement is a plain value that holds no filter state: made by `new`, which refuses what is not finite or
//! impossible, and turned by `linearize` into a [`Linearized`], which the filter takes. It can be read, tested and
//! plotted alone.
//!
//! # Adding one
//!
//! Nothing outside this room has to change, and it can live in your own crate as well:
//!
//! 1. One file with a struct (z, the variances of its rows, its interval) and a `new` that checks them with
//!    [`variance`] and [`check_interval`].
//! 2. `linearize(&self, &NavState) -> Linearized<M>`: ν = z − h(x̂), the rows ∂ν/∂δx, the variances. With errors that are
//!    estimate minus truth, a row that measures a state directly is **−1** on it: [`Direct`] when all rows are of that
//!    kind on neighbouring states, else a matrix. Rows must be uncorrelated; correlated ones are multiplied by the inverse
//!    Cholesky factor of their R first.
//! 3. A line in the table above, and the test of `host-tests/tests/measurement.rs` at a tilted, moving, biased state:
//!    `(ν(x̂) − ν(x̂ corrected by δx))/|δx|` must be the column of the Jacobian. Identity attitude hides sign errors.
//!
//! ```
//! use nalgebra::{SMatrix, SVector};
//! use navsight::error::Error;
//! use navsight::error_model::{N, VEL};
//! use navsight::measurement::{check_interval, variance, Linearized};
//! use navsight::nav::NavState;
//!
//! /// Speed along one horizontal direction, as a Doppler sensor on the shore sees it.
//! pub struct RadialSpeed {
//!     z: f32,
//!     /// sine and cosine of the direction, clockwise from north
//!     direction: (f32, f32),
//!     r: f32,
//!     interval: f32,
//! }
//!
//! impl RadialSpeed {
//!     /// Speed [m/s] towards `azimuth` [rad], its 1σ [m/s], and the interval of these measurements [s].
//!     pub fn new(z: f32, azimuth: f32, sigma: f32, interval: f32) -> Result<Self, Error> {
//!         if !(z.is_finite() && azimuth.is_finite()) {
//!             return Err(Error::NonFinite);
//!         }
//!         let direction = (libm::sinf(azimuth), libm::cosf(azimuth));
//!         Ok(Self { z, direction, r: variance(sigma)?, interval: check_interval(interval)? })
//!     }
//!
//!     pub fn linearize(&self, nav: &NavState) -> Linearized<1, SMatrix<f32, 1, N>> {
//!         let ((sin, cos), v) = (self.direction, nav.v_n());
//!         let mut h = SMatrix::<f32, 1, N>::zeros();
//!         h[(0, VEL)] = -sin;
//!         h[(0, VEL + 1)] = -cos;
//!         Linearized {
//!             nu: SVector::from([self.z - (sin * v.x + cos * v.y)]),
//!             h,
//!             r: SVector::from([self.r]),
//!             interval: self.interval,
//!         }
//!     }
//! }
//! ```

use nalgebra::{SMatrix, SVector};

use crate::error::Error;
use crate::error_model::N;

mod accuracy;
mod antenna;
mod barometer;
mod boresight;
mod course;
mod heading;
mod height;
mod odometer;
mod position;
mod position_velocity;
mod rows;
mod velocity;
mod zero_rotation;
mod zero_velocity;

pub use accuracy::Accuracy;
pub use antenna::{Antenna, AntennaRows, MAX_LEVER};
pub use barometer::Barometer;
pub use boresight::Boresight;
pub use course::Course;
pub use heading::Heading;
pub use height::Height;
pub(crate) use height::UP;
pub use odometer::{NonHolonomic, Odometer};
pub use position::Position;
pub use position_velocity::PositionVelocity;
pub use rows::{Direct, Jacobian, Kind, MeasurementRows};
pub use velocity::Velocity;
pub use zero_rotation::ZeroRotation;
pub use zero_velocity::ZeroVelocity;

/// One measurement, linearised at the current estimate: M uncorrelated rows.
///
/// `H` is the form in which it keeps them ([`MeasurementRows`]): a form of its own takes less room than [`Jacobian`], which
/// can be any, and of the kernels of other forms nothing is linked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linearized<const M: usize, H = Jacobian<M>> {
    /// Innovation ν = z − h(x̂), M × 1, unit of z
    pub nu: SVector<f32, M>,
    /// ∂ν/∂δx in the filter's own error state, M × N
    pub h: H,
    /// Noise variance per row, M × 1, unit of z squared
    pub r: SVector<f32, M>,
    /// Nominal interval of this measurement, the T of ξ1 [s]; zero or below: unknown, and ξ1 is not available
    pub interval: f32,
}

impl<const M: usize, H: MeasurementRows<M>> Linearized<M, H> {
    /// All elements of its rows, M × N.
    pub fn dense(&self) -> SMatrix<f32, M, N> {
        self.h.kind().dense()
    }
}

impl Linearized<3> {
    /// Its first two rows.
    fn horizontal(&self) -> Linearized<2> {
        Linearized {
            nu: SVector::from([self.nu.x, self.nu.y]),
            h: match &self.h {
                Jacobian::Direct { first } => Jacobian::Direct { first: *first },
                h => Jacobian::Dense(h.kind().dense().fixed_view::<2, N>(0, 0).into_owned()),
            },
            r: SVector::from([self.r.x, self.r.y]),
            interval: self.interval,
        }
    }
}

/// Smallest standard deviation of a row that is accepted: far below any sensor, and its square is still a normal f32
/// after division by a prior variance.
pub const MIN_SIGMA: f32 = 1e-12;
/// Largest standard deviation of a row that is accepted.
pub const MAX_SIGMA: f32 = 1e9;

/// Variance of a standard deviation, checked.
///
/// # Errors
/// [`Error::NonFinite`]; [`Error::OutOfRange`] outside [`MIN_SIGMA`]..=[`MAX_SIGMA`], zero and below included.
pub fn variance(sigma: f32) -> Result<f32, Error> {
    match sigma {
        s if !s.is_finite() => Err(Error::NonFinite),
        s if (MIN_SIGMA..=MAX_SIGMA).contains(&s) => Ok(s * s),
        _ => Err(Error::OutOfRange),
    }
}

/// Nominal interval of a measurement [s], checked: zero and below mean unknown.
///
/// # Errors
/// [`Error::NonFinite`].
pub fn check_interval(interval: f32) -> Result<f32, Error> {
    match interval.is_finite() {
        true => Ok(interval),
        false => Err(Error::NonFinite),
    }
}

/// Three variances.
fn variances(sigma: &nalgebra::Vector3<f32>) -> Result<SVector<f32, 3>, Error> {
    Ok(SVector::from([
        variance(sigma.x)?,
        variance(sigma.y)?,
        variance(sigma.z)?,
    ]))
}
