//! Where a sensor sits on the vehicle: the lever arm from the IMU, and what it does to position and velocity.

use nalgebra::{Matrix3, SMatrix, Vector3};

use crate::attitude::Rfu;
use crate::error::Error;
use crate::error_model::{ATT, BG, N, POS, VEL};
use crate::linalg::skew;
use crate::nav::NavState;

/// Longest lever arm that is accepted [m].
pub const MAX_LEVER: f32 = 200.0;

/// A point that is fixed to the vehicle, such as the phase centre of an antenna.
///
/// ```text
/// r_A = r + C l,                      v_A = v + C (ω × l)
/// ν_r: −I on δr, −[(C l)×] on ψ
/// ν_v: −I on δv, −[(C (ω × l))×] on ψ, C [l×] on b_g
/// ```
/// ω is [`NavState::omega_ib_b`]. Left out: the earth rate in ω, 7e-5 m/s per metre of lever arm; and the turn of C l by
/// a position correction, |l|/R.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Antenna {
    l: Vector3<f32>,
}

impl Antenna {
    /// At the IMU itself.
    pub const AT_IMU: Self = Self {
        l: Vector3::new(0.0, 0.0, 0.0),
    };

    /// From the IMU to the antenna, body axes [m]: right-forward-up, or [`crate::attitude::Frd`].
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] beyond [`MAX_LEVER`].
    pub fn new(lever_arm: impl Into<Rfu>) -> Result<Self, Error> {
        let l = lever_arm.into().0;
        if !l.iter().all(|x| x.is_finite()) {
            return Err(Error::NonFinite);
        }
        if l.amax() > MAX_LEVER {
            return Err(Error::OutOfRange);
        }
        Ok(Self { l })
    }

    /// From the IMU to the antenna, right-forward-up [m].
    pub fn lever_arm(&self) -> Vector3<f32> {
        self.l
    }

    /// Whether there is no lever arm.
    pub fn is_at_imu(&self) -> bool {
        self.l.x == 0.0 && self.l.y == 0.0 && self.l.z == 0.0
    }

    /// C l: from the IMU to the antenna, east-north-up [m].
    pub fn offset(&self, c_b_n: &Matrix3<f32>) -> Vector3<f32> {
        c_b_n * self.l
    }

    /// C (ω × l): velocity of the antenna against the IMU, east-north-up [m/s].
    pub fn motion(&self, nav: &NavState, c_b_n: &Matrix3<f32>) -> Vector3<f32> {
        c_b_n * nav.omega_ib_b().cross(&self.l)
    }

    /// Rows of the position of the antenna from `ROW` on.
    pub(super) fn position_rows<const M: usize, const ROW: usize>(
        offset: &Vector3<f32>,
        h: &mut SMatrix<f32, M, N>,
    ) {
        h.fixed_view_mut::<3, 3>(ROW, POS).fill_diagonal(-1.0);
        h.fixed_view_mut::<3, 3>(ROW, ATT).copy_from(&-skew(offset));
    }

    /// Rows of the velocity of the antenna from `ROW` on.
    pub(super) fn velocity_rows<const M: usize, const ROW: usize>(
        &self,
        motion: &Vector3<f32>,
        c_b_n: &Matrix3<f32>,
        h: &mut SMatrix<f32, M, N>,
    ) {
        h.fixed_view_mut::<3, 3>(ROW, VEL).fill_diagonal(-1.0);
        h.fixed_view_mut::<3, 3>(ROW, ATT).copy_from(&-skew(motion));
        h.fixed_view_mut::<3, 3>(ROW, BG)
            .copy_from(&(c_b_n * skew(&self.l)));
    }
}
