//! Attitude of the body (right-forward-up) against the local level frame (east-north-up): Euler angles, unit
//! quaternion, direction cosine matrix, and typed edges to the north-east-down world.

pub mod frames;

use nalgebra::{Matrix3, Vector3};

use crate::error::Error;
use crate::linalg::{looped, rolled, sin_cos, Real};
pub use frames::{Enu, Frd, FrdToNed, Ned, Rfu, RfuToEnu};

/// Heading, pitch and roll [rad].
///
/// ```text
/// C_b^n = R_z(−heading) · R_x(pitch) · R_y(roll)
/// ```
/// These are the navigator's yaw, pitch and roll of FRD against NED as well.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Euler {
    /// Heading, clockwise from north [rad].
    pub heading: f32,
    /// Pitch, nose up positive [rad].
    pub pitch: f32,
    /// Roll, right side down positive [rad].
    pub roll: f32,
}

impl Euler {
    /// From degrees.
    pub fn from_degrees(heading_deg: f32, pitch_deg: f32, roll_deg: f32) -> Self {
        const RAD: f32 = core::f32::consts::PI / 180.0;
        Self {
            heading: heading_deg * RAD,
            pitch: pitch_deg * RAD,
            roll: roll_deg * RAD,
        }
    }

    /// Heading in [0°, 360°), pitch and roll in degrees.
    pub fn to_degrees(&self) -> (f32, f32, f32) {
        const DEG: f32 = 180.0 / core::f32::consts::PI;
        let heading_deg = self.heading * DEG;
        let heading_deg = if heading_deg < 0.0 {
            heading_deg + 360.0
        } else {
            heading_deg
        };
        (heading_deg, self.pitch * DEG, self.roll * DEG)
    }

    /// From a direction cosine matrix; heading and roll in (−π, π], pitch in [−π/2, π/2].
    ///
    /// At ±90° pitch only the sum or difference of heading and roll is defined. Roll is therefore measured in the
    /// frame that has the heading taken out, so that the two together reproduce `c_b_n` at every pitch; exactly at
    /// the vertical the heading is 0 and roll takes everything.
    pub fn from_c_b_n(c_b_n: &Matrix3<f32>) -> Self {
        let c = c_b_n;
        let cos_pitch = libm::sqrtf(c.m12 * c.m12 + c.m22 * c.m22);
        let (sin_h, cos_h) = if cos_pitch > 0.0 {
            (c.m12 / cos_pitch, c.m22 / cos_pitch)
        } else {
            (0.0, 1.0)
        };
        // First row of R_z(heading)·C = R_x(pitch)·R_y(roll): (cos roll, 0, sin roll).
        let cos_roll = cos_h * c.m11 - sin_h * c.m21;
        let sin_roll = cos_h * c.m13 - sin_h * c.m23;
        Self {
            heading: libm::atan2f(sin_h, cos_h),
            pitch: libm::atan2f(c.m32, cos_pitch),
            roll: libm::atan2f(sin_roll, cos_roll),
        }
    }

    /// The direction cosine matrix C_b^n.
    pub fn c_b_n(&self) -> Matrix3<f32> {
        let (sh, ch) = sin_cos(self.heading);
        let (sp, cp) = sin_cos(self.pitch);
        let (sr, cr) = sin_cos(self.roll);
        Matrix3::new(
            ch * cr + sh * sp * sr,
            sh * cp,
            ch * sr - sh * sp * cr,
            ch * sp * sr - sh * cr,
            ch * cp,
            -(sh * sr + ch * sp * cr),
            -(cp * sr),
            sp,
            cp * cr,
        )
    }

    /// The unit quaternion of C_b^n, order (w, x, y, z).
    pub fn quaternion(&self) -> [f32; 4] {
        let (sh, ch) = sin_cos(-0.5 * self.heading);
        let (sp, cp) = sin_cos(0.5 * self.pitch);
        let (sr, cr) = sin_cos(0.5 * self.roll);
        product(
            &product(&[ch, 0.0, 0.0, sh], &[cp, sp, 0.0, 0.0]),
            &[cr, 0.0, sr, 0.0],
        )
    }
}

/// Hamilton product a∘b, order (w, x, y, z): C(a∘b) = C(a)·C(b).
#[inline(always)]
pub fn product<T: Real>(a: &[T; 4], b: &[T; 4]) -> [T; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3],
        a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1],
    ]
}

/// Direction cosine matrix of a unit quaternion (w, x, y, z) that takes b to n.
#[inline(always)]
pub fn c_b_n<T: Real>(q: [T; 4]) -> Matrix3<T> {
    c_b_n_scaled(q, T::of(2.0))
}

/// As [`c_b_n`] for a quaternion that is not quite of unit length, with `scale` = 2/|q|².
#[inline(always)]
pub fn c_b_n_scaled<T: Real>([w, x, y, z]: [T; 4], scale: T) -> Matrix3<T> {
    let one = T::one();
    let (sx, sy, sz) = (scale * x, scale * y, scale * z);
    let (wx, wy, wz) = (w * sx, w * sy, w * sz);
    let (xx, xy, xz) = (x * sx, x * sy, x * sz);
    let (yy, yz, zz) = (y * sy, y * sz, z * sz);
    Matrix3::new(
        one - (yy + zz),
        xy - wz,
        xz + wy,
        xy + wz,
        one - (xx + zz),
        yz - wx,
        xz - wy,
        yz + wx,
        one - (xx + yy),
    )
}

/// Unit quaternion (w, x, y, z), w ≥ 0, of a rotation matrix. Well conditioned at every attitude: the largest of the
/// four is found first (Shepperd).
///
/// # Errors
/// [`Error::NonFinite`]; [`Error::OutOfRange`] if `c` is not a rotation: its columns must be orthonormal and
/// right-handed within 1e-3.
pub fn quaternion_of<T: Real>(c: &Matrix3<T>) -> Result<[T; 4], Error> {
    if !c.iter().all(|x| x.finite()) {
        return Err(Error::NonFinite);
    }
    // Every element is finite, so the comparisons are decided.
    let off = (c.tr_mul(c) - Matrix3::identity()).amax();
    if off >= T::of(1e-3) || c.column(0).cross(&c.column(1)).dot(&c.column(2)) < T::zero() {
        return Err(Error::OutOfRange);
    }
    let one = T::one();
    let (ww, xx) = (one + c.m11 + c.m22 + c.m33, one + c.m11 - c.m22 - c.m33);
    let (yy, zz) = (one - c.m11 + c.m22 - c.m33, one - c.m11 - c.m22 + c.m33);
    let (wx, wy, wz) = (c.m32 - c.m23, c.m13 - c.m31, c.m21 - c.m12);
    let (xy, xz, yz) = (c.m12 + c.m21, c.m13 + c.m31, c.m23 + c.m32);
    let q = if ww >= xx && ww >= yy && ww >= zz {
        [ww, wx, wy, wz]
    } else if xx >= yy && xx >= zz {
        [wx, xx, xy, xz]
    } else if yy >= zz {
        [wy, xy, yy, yz]
    } else {
        [wz, xz, yz, zz]
    };
    normalized(if q[0] < T::zero() {
        [-q[0], -q[1], -q[2], -q[3]]
    } else {
        q
    })
}

/// A quaternion divided by its length.
///
/// # Errors
/// [`Error::NonFinite`]; [`Error::OutOfRange`] for a length outside 1e-3..1e3.
pub fn normalized<T: Real>(q: [T; 4]) -> Result<[T; 4], Error> {
    if !q.iter().all(|x| x.finite()) {
        return Err(Error::NonFinite);
    }
    let norm = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).root();
    if !(norm > T::of(1e-3) && norm < T::of(1e3)) {
        return Err(Error::OutOfRange);
    }
    Ok([q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm])
}

/// Rotation vector φ [rad] to the quaternion *minus one*: (cos(|φ|/2) − 1, sin(|φ|/2)·φ/|φ|).
///
/// Without the 1, small rotations keep all their digits. The series is good to f32 rounding up to |φ| = 2π, one turn.
/// For corrections and tests; the mechanization has a shorter one.
#[inline]
pub fn rotation_minus_one(phi: &Vector3<f32>) -> [f32; 4] {
    // (|φ|/2)²
    let p = 0.25 * (phi.x * phi.x + phi.y * phi.y + phi.z * phi.z);
    // sin y/y and 2(1 − cos y)/y² of y² = p: 2·3, 4·5, … and 3·4, 5·6, …
    // Below 0.06 rad the terms after these two are less than a hundredth of the last place.
    let (sine, cosine) = if p < 1e-3 {
        (nested(p, &SINE[7..]), nested(p, &COSINE[6..]))
    } else {
        (nested(p, looped(&SINE)), nested(p, looped(&COSINE)))
    };
    [
        -0.5 * p * cosine,
        0.5 * sine * phi.x,
        0.5 * sine * phi.y,
        0.5 * sine * phi.z,
    ]
}

/// 1 − p·c_last (… (1 − p·c_first)).
#[inline(always)]
fn nested(p: f32, c: &[f32]) -> f32 {
    c.iter().fold(1.0, |series, c| {
        rolled();
        1.0 - series * (p * c)
    })
}

/// 1/(18·19) … 1/(2·3).
const SINE: [f32; 9] = [
    1.0 / 342.0,
    1.0 / 272.0,
    1.0 / 210.0,
    1.0 / 156.0,
    1.0 / 110.0,
    1.0 / 72.0,
    1.0 / 42.0,
    1.0 / 20.0,
    1.0 / 6.0,
];
/// 1/(17·18) … 1/(3·4).
const COSINE: [f32; 8] = [
    1.0 / 306.0,
    1.0 / 240.0,
    1.0 / 182.0,
    1.0 / 132.0,
    1.0 / 90.0,
    1.0 / 56.0,
    1.0 / 30.0,
    1.0 / 12.0,
];
