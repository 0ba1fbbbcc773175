//! A heading from outside: two satellite antennas, a magnetic compass, a value stored when the vehicle was parked.

use nalgebra::{SMatrix, SVector, Vector3};

use super::rows::set;
use super::{check_interval, variance, Linearized};
use crate::attitude::Rfu;
use crate::error::Error;
use crate::error_model::{ATT, N, POS};
use crate::linalg::{sin_cos, transformed};
use crate::nav::NavState;

/// Smallest level part of a unit axis that has an azimuth: the sine of 1°.
const MIN_LEVEL: f32 = 0.017_452_406;

/// Azimuth of a direction that is known in the body: z = atan2(l_E, l_N) + noise, l = C_b^n · axis.
///
/// | sensor | axis | azimuth |
/// |---|---|---|
/// | heading of the vehicle, stored or from a compass that levels itself | forward, [`Heading::new`] | the heading |
/// | two antennas | the baseline in body axes | what the receiver gives, true north |
/// | three-axis magnetometer | the field as measured, hard and soft iron taken off | the declination of the place |
///
/// Clockwise from true north [rad].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heading {
    axis_b: Vector3<f32>,
    /// sine and cosine of the azimuth
    direction: (f32, f32),
    r: f32,
    interval: f32,
}

impl Heading {
    /// Heading of the vehicle, clockwise from true north [rad], its 1σ [rad], and the nominal interval between two such
    /// updates [s] (zero: unknown).
    ///
    /// # Errors
    /// As [`Heading::of_axis`].
    pub fn new(heading: f32, sigma: f32, interval: f32) -> Result<Self, Error> {
        Self::of_axis(Vector3::new(0.0, 1.0, 0.0), heading, sigma, interval)
    }

    /// Azimuth of a direction in the body, clockwise from true north [rad]. The axis need not have unit length (a
    /// baseline in metres, a field in microtesla); the rest is as in [`Heading::new`].
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for an azimuth of more than one turn (degrees, most likely) or an
    /// axis whose length is not within 1e-6 … 1e6; and those of [`variance`].
    pub fn of_axis(
        axis_b: impl Into<Rfu>,
        azimuth: f32,
        sigma: f32,
        interval: f32,
    ) -> Result<Self, Error> {
        let axis_b = axis_b.into().0;
        if !(azimuth.is_finite() && axis_b.iter().all(|x| x.is_finite())) {
            return Err(Error::NonFinite);
        }
        let length = axis_b.norm();
        if azimuth.abs() > core::f32::consts::TAU || !(1e-6..=1e6).contains(&length) {
            return Err(Error::OutOfRange);
        }
        Ok(Self {
            axis_b: axis_b / length,
            direction: sin_cos(azimuth),
            r: variance(sigma)?,
            interval: check_interval(interval)?,
        })
    }

    /// Nominal interval between two such updates [s], zero or below when unknown.
    pub fn interval(&self) -> f32 {
        self.interval
    }

    /// ν = z − atan2(l_E, l_N) in −π … π, one row.
    ///
    /// ```text
    /// l ← l + (ψ + δθ) × l  under a correction, so
    /// h on ψ   = ( l_U l_E/ρ², l_U l_N/ρ², −1 ),          ρ² = l_E² + l_N²
    /// h on δr  = ( (h_ψN − tan L)/(R_N+h), −h_ψE/(R_M+h), 0 )
    /// ```
    /// An axis within 1° of the vertical has no azimuth: ν is then NaN, and the filter refuses it with
    /// [`Error::NonFinite`]. The noise is that of the azimuth; a magnetometer's own, σ_m over the level field ρ|m|, is the
    /// caller's to work out. Second order left out: ν² where the axis is steep, l_U/ρ times the tilt squared.
    ///
    /// Derived here. Against finite differences: `host-tests/tests/measurement.rs`.
    pub fn linearize(&self, nav: &NavState) -> Linearized<1, SMatrix<f32, 1, N>> {
        let l = transformed(&nav.c_b_n(), &self.axis_b);
        let rho2 = l.x * l.x + l.y * l.y;
        let (sin, cos) = self.direction;
        let mut measurement = Linearized {
            nu: SVector::from([f32::NAN]),
            h: SMatrix::zeros(),
            r: SVector::from([self.r]),
            interval: self.interval,
        };
        if rho2 > MIN_LEVEL * MIN_LEVEL {
            // The angle between both directions, wrapped and with all its digits.
            measurement.nu.x = libm::atan2f(sin * l.y - cos * l.x, cos * l.y + sin * l.x);
            let steep = l.z / rho2;
            let (east, north) = (steep * l.x, steep * l.y);
            let local = nav.local();
            let on_r = Vector3::new(
                (north - local.tan_lat) * local.inv_r_n,
                -east * local.inv_r_m,
                0.0,
            );
            let h = &mut measurement.h;
            set::<0, POS, 1>(h, &on_r);
            set::<0, ATT, 1>(h, &Vector3::new(east, north, -1.0));
        }
        measurement
    }
}
