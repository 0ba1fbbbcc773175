//! A measured velocity over the ground, as satellite receivers give it.

use nalgebra::{SVector, Vector3};

use super::{check_interval, variances, Jacobian, Linearized};
use crate::attitude::Enu;
use crate::error::Error;
use crate::error_model::VEL;
use crate::mechanization::MAX_SPEED;
use crate::nav::NavState;

/// Velocity over the ground in the level frame: z = v_n + noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Velocity {
    z: Vector3<f32>,
    r: SVector<f32, 3>,
    interval: f32,
}

impl Velocity {
    /// Velocity [m/s] (a bare vector is east-north-up; [`crate::attitude::Ned`] is converted), 1σ per axis
    /// east-north-up [m/s], and the nominal interval between two such updates [s] (zero: unknown).
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for a component beyond [`MAX_SPEED`]; and those of
    /// [`variance`](super::variance).
    pub fn new(z: impl Into<Enu>, sigma_n: Vector3<f32>, interval: f32) -> Result<Self, Error> {
        let z = z.into().0;
        if !z.iter().all(|x| x.is_finite()) {
            return Err(Error::NonFinite);
        }
        if z.amax() > MAX_SPEED {
            return Err(Error::OutOfRange);
        }
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

    /// ν = z − v̂_n, rows −1 on δv.
    ///
    /// Left out: δv compares velocities in the frame at the estimated position, z comes in the frame at the true one.
    /// The turn between them, δθ, moves ν by at most |v̂|·|δr|/(R cos L): 5e-4 m/s for 10 m at 300 m/s on the
    /// equator.
    pub fn linearize(&self, nav: &NavState) -> Linearized<3> {
        let [e, n, u] = nav.strapdown().v_n;
        let lo = Vector3::new(e.lo, n.lo, u.lo);
        Linearized {
            nu: (self.z - nav.v_n()) - lo,
            h: Jacobian::Direct { first: VEL }, // δv is estimate minus truth
            r: self.r,
            interval: self.interval,
        }
    }
}
