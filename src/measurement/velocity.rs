//! A measured velocity over the ground, as satellite receivers give it.

use nalgebra::{SMatrix, Vector3};

use super::accuracy::decorrelate_rows;
use super::{check_interval, Accuracy, Antenna, Jacobian, Linearized};
use crate::attitude::Enu;
use crate::error::Error;
use crate::error_model::{N, VEL};
use crate::linalg::minus;
use crate::mechanization::MAX_SPEED;
use crate::nav::NavState;

/// Velocity over the ground in the level frame, of the IMU or of an antenna: z = v_n + noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Velocity {
    z: Vector3<f32>,
    accuracy: Accuracy,
    antenna: Antenna,
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
        Self::with_accuracy(z, Accuracy::per_axis(sigma_n)?, interval)
    }

    /// As [`Velocity::new`] with the accuracy that came with this fix [m/s].
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for a component beyond [`MAX_SPEED`].
    pub fn with_accuracy(
        z: impl Into<Enu>,
        accuracy: Accuracy,
        interval: f32,
    ) -> Result<Self, Error> {
        let z = z.into().0;
        if !z.iter().all(|x| x.is_finite()) {
            return Err(Error::NonFinite);
        }
        if z.amax() > MAX_SPEED {
            return Err(Error::OutOfRange);
        }
        Ok(Self {
            z,
            accuracy,
            antenna: Antenna::AT_IMU,
            interval: check_interval(interval)?,
        })
    }

    /// The same as the velocity of this antenna.
    #[must_use]
    pub fn of(self, antenna: Antenna) -> Self {
        Self { antenna, ..self }
    }

    /// Nominal interval between two such updates [s], zero or below when unknown.
    pub fn interval(&self) -> f32 {
        self.interval
    }

    /// How good it is.
    pub fn accuracy(&self) -> &Accuracy {
        &self.accuracy
    }

    /// ν = z − v̂_n − Ĉ (ω̂ × l), rows −1 on δv and [`Antenna`]'s on ψ and b_g.
    ///
    /// Left out: δv compares velocities in the frame at the estimated position, z comes in the frame at the true one.
    /// The turn between them, δθ, moves ν by at most |v̂|·|δr|/(R cos L): 5e-4 m/s for 10 m at 300 m/s on the
    /// equator.
    pub fn linearize(&self, nav: &NavState) -> Linearized<3> {
        let r = self.accuracy.variances();
        if self.antenna.is_at_imu() && self.accuracy.is_diagonal() {
            return Linearized {
                nu: self.difference(nav),
                h: Jacobian::Direct { first: VEL }, // δv is estimate minus truth
                r,
                interval: self.interval,
            };
        }
        let c_b_n = nav.c_b_n();
        let motion = self.antenna.motion(nav, &c_b_n);
        let mut h = SMatrix::<f32, 3, N>::zeros();
        Antenna::velocity_rows::<3, 0>(&motion, &self.antenna.turned(&c_b_n), &mut h);
        decorrelate_rows::<3, 0>(&self.accuracy.lower(), &mut h);
        Linearized {
            nu: self.innovation_at(nav, &motion),
            h: Jacobian::Dense(h),
            r,
            interval: self.interval,
        }
    }

    /// The first two rows: a velocity whose vertical component is not used.
    pub fn linearize_horizontal(&self, nav: &NavState) -> Linearized<2> {
        self.linearize(nav).horizontal()
    }

    /// The innovation with the antenna moving at `motion` against the IMU, the correlations taken out.
    #[inline(always)]
    pub(super) fn innovation_at(&self, nav: &NavState, motion: &Vector3<f32>) -> Vector3<f32> {
        self.accuracy
            .decorrelated(&minus(&self.difference(nav), motion))
    }

    fn difference(&self, nav: &NavState) -> Vector3<f32> {
        let [e, n, u] = nav.strapdown().v_n;
        let (e, n, u) = (
            (self.z.x - e.hi) - e.lo,
            (self.z.y - n.hi) - n.lo,
            (self.z.z - u.hi) - u.lo,
        );
        Vector3::new(e, n, u)
    }
}
