//! The vehicle is known to stand still.

use nalgebra::SVector;

use super::{check_interval, variance, Direct, Linearized};
use crate::error::Error;
use crate::error_model::VEL;
use crate::nav::NavState;

/// Zero-velocity update: z = 0, h(x) = v_n.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ZeroVelocity {
    r: f32,
    interval: f32,
}

impl ZeroVelocity {
    /// Residual motion, 1σ per axis [m/s], and the nominal interval between two such updates [s] (zero: unknown).
    ///
    /// # Errors
    /// Those of [`variance`] and [`check_interval`].
    pub fn new(sigma: f32, interval: f32) -> Result<Self, Error> {
        Ok(Self {
            r: variance(sigma)?,
            interval: check_interval(interval)?,
        })
    }

    /// Nominal interval between two such updates [s], zero or below when unknown.
    pub fn interval(&self) -> f32 {
        self.interval
    }

    /// ν = −v̂_n, rows −1 on δv.
    ///
    /// Left out: a position correction re-levels v̂ by δθ, which moves ν by at most |v̂|·|δr|/(R cos L), nothing at a
    /// standstill.
    #[inline(always)]
    pub fn linearize(&self, nav: &NavState) -> Linearized<3, Direct<VEL>> {
        let v = nav.v_n();
        Linearized {
            nu: SVector::from([-v.x, -v.y, -v.z]),
            h: Direct, // δv is estimate minus truth
            r: SVector::from([self.r, self.r, self.r]),
            interval: self.interval,
        }
    }
}
