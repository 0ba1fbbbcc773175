//! The direction in which a vehicle moves, taken for the direction in which it points.

use nalgebra::SMatrix;

use super::{variance, Boresight, Heading, Linearized};
use crate::attitude::Enu;
use crate::error::Error;
use crate::error_model::N;
use crate::nav::NavState;

/// Course over the ground of a vehicle that moves along its own forward axis: z = heading of that axis + noise.
///
/// For cars, boats without drift, and aeroplanes in still air; never for a multicopter. Where the same velocity is used
/// as a measurement too, its noise is in both: the course then deserves a larger σ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    heading: Heading,
}

impl Course {
    /// Course clockwise from north [rad], how the vehicle stands to the IMU, 1σ [rad] with side slip in it, and the
    /// nominal interval between two such updates [s] (zero: unknown).
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] beyond ±2π; and those of [`variance`].
    pub fn new(z: f32, boresight: Boresight, sigma: f32, interval: f32) -> Result<Self, Error> {
        Ok(Self {
            heading: Heading::of_axis(boresight.forward_b(), z, sigma, interval)?,
        })
    }

    /// From a velocity over the ground [m/s] with 1σ `sigma_v` per axis: the course's own σ is σ_v/speed, and `slip`
    /// [rad] is added to it as a variance.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] when the horizontal speed is below 5 σ_v: there is no course; and those of [`Course::new`].
    pub fn of_velocity(
        v_n: impl Into<Enu>,
        sigma_v: f32,
        slip: f32,
        boresight: Boresight,
        interval: f32,
    ) -> Result<Self, Error> {
        let v = v_n.into().0;
        variance(sigma_v)?;
        if !(v.x.is_finite() && v.y.is_finite() && slip.is_finite()) {
            return Err(Error::NonFinite);
        }
        let speed = libm::sqrtf(v.x * v.x + v.y * v.y);
        if speed < 5.0 * sigma_v {
            return Err(Error::OutOfRange);
        }
        let own = sigma_v / speed;
        let sigma = libm::sqrtf(own * own + slip * slip);
        Self::new(libm::atan2f(v.x, v.y), boresight, sigma, interval)
    }

    /// Nominal interval between two such updates [s], zero or below when unknown.
    pub fn interval(&self) -> f32 {
        self.heading.interval()
    }

    /// As [`Heading::linearize`] of the vehicle's forward axis.
    pub fn linearize(&self, nav: &NavState) -> Linearized<1, SMatrix<f32, 1, N>> {
        self.heading.linearize(nav)
    }
}
