//! The vehicle is known not to turn: the gyros then measure their own bias and the earth rate.

use nalgebra::{SMatrix, Vector3};

use super::rows::set;
use super::{check_interval, variance, Linearized};
use crate::error::Error;
use crate::error_model::{ATT, BG, N};
use crate::linalg::{columns, cross, dot};
use crate::nav::NavState;

/// Zero-rotation update: z = mean gyro output over a rest, h(x) = C_n^b ω_ie^n + b_g.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZeroRotation {
    omega_ib_b: Vector3<f32>,
    r: f32,
    interval: f32,
}

/// Largest mean rate that can still be a bias plus the earth rate [rad/s].
const MAX_RATE: f32 = 2.0 * crate::nav::MAX_GYRO_BIAS;

impl ZeroRotation {
    /// Mean output of the gyros over the rest, as measured, no bias taken off, body axes [rad/s]; the 1σ of that mean per
    /// axis [rad/s]; and the nominal interval between two such updates [s] (zero: unknown).
    ///
    /// White noise alone gives the mean over T seconds a σ of ARW/√T. The filter has integrated the same samples into its
    /// attitude, so the noise of this mean is also in the attitude error; the update ignores that. It matters where the
    /// gyro noise decides the result, with sensors that feel the earth turn: those learn their bias from the level,
    /// and better. This update is for sensors whose bias is far above the earth rate.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for a rate of more than 2 rad/s; and those of [`variance`].
    pub fn new(omega_ib_b: Vector3<f32>, sigma: f32, interval: f32) -> Result<Self, Error> {
        if !omega_ib_b.iter().all(|x| x.is_finite()) {
            return Err(Error::NonFinite);
        }
        if omega_ib_b.amax() > MAX_RATE {
            return Err(Error::OutOfRange);
        }
        Ok(Self {
            omega_ib_b,
            r: variance(sigma)?,
            interval: check_interval(interval)?,
        })
    }

    /// Nominal interval between two such updates [s], zero or below when unknown.
    pub fn interval(&self) -> f32 {
        self.interval
    }

    /// ν = z − b̂_g − Ĉ_n^b ω_ie^n(L̂).
    ///
    /// ```text
    /// Ĉ ← (I + [(ψ+δθ)×]) Ĉ under a correction, so Ĉᵀω_ie moves by Ĉᵀ[ω_ie×](ψ + δθ)
    /// h on b_g = I,   h on ψ = Ĉᵀ[ω_ie×],   h on δr = 0
    /// ```
    /// A position correction turns n and moves the latitude, and both cancel exactly: the body keeps its place against the
    /// earth, and so does the earth rate in it.
    ///
    /// Derived here. Against finite differences: `host-tests/tests/measurement.rs`.
    pub fn linearize(&self, nav: &NavState) -> Linearized<3, SMatrix<f32, 3, N>> {
        let [x, y, z] = columns(&nav.c_b_n()); // rows of Ĉ_n^b
        let w = nav.local().omega_ie_n();
        let expected = nav.b_g() + Vector3::new(dot(&x, &w), dot(&y, &w), dot(&z, &w));
        let mut measurement = Linearized {
            nu: self.omega_ib_b - expected,
            h: SMatrix::zeros(),
            r: Vector3::new(self.r, self.r, self.r),
            interval: self.interval,
        };
        let h = &mut measurement.h;
        set::<0, ATT, 3>(h, &cross(&x, &w));
        set::<1, ATT, 3>(h, &cross(&y, &w));
        set::<2, ATT, 3>(h, &cross(&z, &w));
        set::<0, BG, 3>(h, &Vector3::x());
        set::<1, BG, 3>(h, &Vector3::y());
        set::<2, BG, 3>(h, &Vector3::z());
        measurement
    }
}
