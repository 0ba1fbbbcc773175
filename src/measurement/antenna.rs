//! Where a sensor sits on the vehicle: the lever arm from the IMU, and what it does to position and velocity.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::accuracy::decorrelate_rows;
use crate::attitude::Rfu;
use crate::covariance::Six;
use crate::error::Error;
use crate::error_model::{ATT, BG, N, POS, VEL};
use crate::linalg::{cross, rows, skew, transformed};
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
        transformed(c_b_n, &self.l)
    }

    /// C (ω × l): velocity of the antenna against the IMU, east-north-up [m/s].
    pub fn motion(&self, nav: &NavState, c_b_n: &Matrix3<f32>) -> Vector3<f32> {
        transformed(c_b_n, &cross(&nav.omega_ib_b(), &self.l))
    }

    /// The rows of position and velocity together. `lower`: of the correlations of each, as [`AntennaRows`] has them.
    pub(super) fn rows(
        &self,
        offset: &Vector3<f32>,
        motion: &Vector3<f32>,
        c_b_n: &Matrix3<f32>,
        lower: [[f32; 3]; 2],
    ) -> AntennaRows {
        AntennaRows {
            offset: *offset,
            motion: *motion,
            turned: self.turned(c_b_n),
            lower,
        }
    }

    /// Rows of the position of the antenna from `ROW` on.
    pub(super) fn position_rows<const M: usize, const ROW: usize>(
        offset: &Vector3<f32>,
        h: &mut SMatrix<f32, M, N>,
    ) {
        h.fixed_view_mut::<3, 3>(ROW, POS).fill_diagonal(-1.0);
        h.fixed_view_mut::<3, 3>(ROW, ATT).copy_from(&-skew(offset));
    }

    /// Rows of the velocity of the antenna from `ROW` on; `turned`: [`Antenna::turned`].
    pub(super) fn velocity_rows<const M: usize, const ROW: usize>(
        motion: &Vector3<f32>,
        turned: &Matrix3<f32>,
        h: &mut SMatrix<f32, M, N>,
    ) {
        h.fixed_view_mut::<3, 3>(ROW, VEL).fill_diagonal(-1.0);
        h.fixed_view_mut::<3, 3>(ROW, ATT).copy_from(&-skew(motion));
        h.fixed_view_mut::<3, 3>(ROW, BG).copy_from(turned);
    }

    /// C [l×]
    pub(super) fn turned(&self, c_b_n: &Matrix3<f32>) -> Matrix3<f32> {
        let [e, n, u] = rows(c_b_n);
        let (e, n, u) = (cross(&e, &self.l), cross(&n, &self.l), cross(&u, &self.l));
        Matrix3::new(e.x, e.y, e.z, n.x, n.y, n.z, u.x, u.y, u.z)
    }
}

/// The six rows of position and velocity of an antenna: what is in them that is neither 0 nor −1.
///
/// ```text
///        δr    δv      ψ          b_g
/// L_r⁻¹ [−I     0   −[(C l)×]      0     ]
/// L_v⁻¹ [ 0    −I   −[(C(ω×l))×]  C [l×] ]
/// ```
/// L_r and L_v are the unit lower factors of what correlates the errors of a fix, I where nothing does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AntennaRows {
    /// C l
    pub(crate) offset: Vector3<f32>,
    /// C (ω × l)
    pub(crate) motion: Vector3<f32>,
    /// C [l×]
    pub(crate) turned: Matrix3<f32>,
    /// Elements (1, 0), (2, 0), (2, 1) of L_r and of L_v
    pub(crate) lower: [[f32; 3]; 2],
}

impl AntennaRows {
    /// All elements of the first M rows; further rows, which there are not, are zero.
    pub(crate) fn elements<const M: usize>(&self) -> SMatrix<f32, M, N> {
        let mut h = SMatrix::<f32, 6, N>::zeros();
        Antenna::position_rows::<6, 0>(&self.offset, &mut h);
        Antenna::velocity_rows::<6, 3>(&self.motion, &self.turned, &mut h);
        let [r, v] = &self.lower;
        decorrelate_rows::<6, 0>(r, &mut h);
        decorrelate_rows::<6, 3>(v, &mut h);
        SMatrix::from_fn(|i, j| h.get((i, j)).copied().unwrap_or(0.0))
    }

    /// As the covariance takes them: states in these units, and each row in that of the state it is −1 on.
    #[inline(never)] // so that its numbers are off the stack when the update works with them
    pub(crate) fn in_units(&self, unit: &[f32; N]) -> Six<f32> {
        let (o, m, t, [r, v]) = (&self.offset, &self.motion, &self.turned, &self.lower);
        let [e, n, u, ve, vn, vu, pe, pn, pu, gx, gy, gz, ..] = *unit;
        let own = [1.0 / e, 1.0 / n, 1.0 / u, 1.0 / ve, 1.0 / vn, 1.0 / vu];
        // [x×], all signs turned twice
        let pair = |own: f32, first: f32, second: f32| [first * own, second * own];
        let gyro = |own: f32, x: f32, y: f32, z: f32| [-x * gx * own, -y * gy * own, -z * gz * own];
        Six {
            on_6: [
                pair(own[0], -o.z * pn, o.y * pu),
                pair(own[1], -o.x * pu, o.z * pe),
                pair(own[2], -o.y * pe, o.x * pn),
                pair(own[3], -m.z * pn, m.y * pu),
                pair(own[4], -m.x * pu, m.z * pe),
                pair(own[5], -m.y * pe, m.x * pn),
            ],
            on_9: [
                gyro(own[3], t.m11, t.m12, t.m13),
                gyro(own[4], t.m21, t.m22, t.m23),
                gyro(own[5], t.m31, t.m32, t.m33),
            ],
            lower: [
                [r[0] * e * own[1], r[1] * e * own[2], r[2] * n * own[2]],
                [v[0] * ve * own[4], v[1] * ve * own[5], v[2] * vn * own[5]],
            ],
            correlated: r[0] != 0.0
                || r[1] != 0.0
                || r[2] != 0.0
                || v[0] != 0.0
                || v[1] != 0.0
                || v[2] != 0.0,
        }
    }

    /// Whether all are finite and below this.
    pub(crate) fn within(&self, limit: f32) -> bool {
        // written as what is good: a NaN fails
        let three = |x: f32, y: f32, z: f32| x.abs() + y.abs() + z.abs();
        let (o, m, t, [r, v]) = (&self.offset, &self.motion, &self.turned, &self.lower);
        three(o.x, o.y, o.z)
            + three(m.x, m.y, m.z)
            + three(t.m11, t.m12, t.m13)
            + three(t.m21, t.m22, t.m23)
            + three(t.m31, t.m32, t.m33)
            + three(r[0], r[1], r[2])
            + three(v[0], v[1], v[2])
            <= limit
    }
}
