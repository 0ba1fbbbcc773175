//! A measured height: a barometer, a known place, a water surface.

use nalgebra::SVector;

use super::{check_interval, variance, Direct, Linearized};
use crate::earth::{MAX_HEIGHT, MIN_HEIGHT};
use crate::error::Error;
use crate::error_model::POS;
use crate::linalg::Two;
use crate::nav::NavState;

/// The state that a height measures.
pub(crate) const UP: usize = POS + 2;

/// Ellipsoidal height: z = h + noise.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Height {
    z: Two,
    r: f32,
    interval: f32,
}

impl Height {
    /// Height above the ellipsoid [m], its 1σ [m], and the nominal interval between two such updates [s] (zero:
    /// unknown).
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] outside [`MIN_HEIGHT`]..[`MAX_HEIGHT`]; and those of [`variance`].
    pub fn new(z: f64, sigma: f32, interval: f32) -> Result<Self, Error> {
        if !z.is_finite() {
            return Err(Error::NonFinite);
        }
        if !(f64::from(MIN_HEIGHT)..=f64::from(MAX_HEIGHT)).contains(&z) {
            return Err(Error::OutOfRange);
        }
        Ok(Self {
            z: Two::of(z),
            r: variance(sigma)?,
            interval: check_interval(interval)?,
        })
    }

    /// Nominal interval between two such updates [s], zero or below when unknown.
    pub fn interval(&self) -> f32 {
        self.interval
    }

    /// ν = h_z − ĥ, a row −1 on δr_U.
    #[inline(always)]
    pub fn linearize(&self, nav: &NavState) -> Linearized<1, Direct<UP>> {
        let height = nav.strapdown().height;
        Linearized {
            nu: SVector::from([(self.z.hi - height.hi) + (self.z.lo - height.lo)]),
            h: Direct, // δr is estimate minus truth
            r: SVector::from([self.r]),
            interval: self.interval,
        }
    }
}
