//! A measured geodetic position, as satellite receivers give it.

use nalgebra::{SVector, Vector3};

use super::{check_interval, variances, Jacobian, Linearized};
use crate::earth::Geodetic;
use crate::error::Error;
use crate::error_model::POS;
use crate::nav::NavState;

/// Geodetic position: z = (L, λ, h) + noise, compared in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    z: Geodetic,
    r: SVector<f32, 3>,
    interval: f32,
}

impl Position {
    /// Position on WGS-84, 1σ east, north, up [m], and the nominal interval between two such updates [s] (zero:
    /// unknown).
    ///
    /// # Errors
    /// Those of [`Geodetic::check`] and [`variance`](super::variance).
    pub fn new(z: Geodetic, sigma_n: Vector3<f32>, interval: f32) -> Result<Self, Error> {
        z.check()?;
        Ok(Self {
            z,
            r: variances(&sigma_n)?,
            interval: check_interval(interval)?,
        })
    }

    /// Nominal interval between two such updates [s], zero or below when unknown.
    pub fn interval(&self) -> f32 {
        self.interval
    }

    /// ν = ((λ_z − λ̂)(R_N+h) cos L, (L_z − L̂)(R_M+h), h_z − ĥ) [m], rows −1 on δr.
    ///
    /// The differences are taken before anything is rounded to f32 ([`NavState::displacement_to`]). Left out: second
    /// order, |ν|² tan L/R (1e-3 m for 80 m at 45°).
    pub fn linearize(&self, nav: &NavState) -> Linearized<3> {
        // `new` has checked z, so there always is a displacement; a NaN would be refused at the filter's door.
        let nu = nav.displacement_to(&self.z);
        Linearized {
            nu: nu.unwrap_or(Vector3::repeat(f32::NAN)),
            h: Jacobian::Direct { first: POS }, // δr is estimate minus truth
            r: self.r,
            interval: self.interval,
        }
    }
}
