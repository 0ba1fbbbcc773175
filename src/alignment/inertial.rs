//! The body frame of the first sample as an inertial frame: the gyros carry it along, and the specific force is resolved
//! in it.

use nalgebra::{Matrix3, Vector3};

use crate::attitude::{c_b_n_scaled, product, rotation_minus_one};
use crate::imu::{ConingSculling, ImuIncrement};
use crate::linalg::{dot, plus, scaled, transformed, Two};

/// Body to the frame b₀ that it had before the first sample.
#[derive(Clone, Debug)]
pub(super) struct InertialFrame {
    corrections: ConingSculling,
    q: [Two; 4],
}

impl InertialFrame {
    /// Begins with the next sample.
    #[inline(always)]
    pub fn new() -> Self {
        let zero = Two { hi: 0.0, lo: 0.0 };
        Self {
            corrections: ConingSculling::NEW,
            q: [Two { hi: 1.0, lo: 0.0 }, zero, zero, zero],
        }
    }

    /// Turns with a sample; ∫ f dt over it, coning and sculling corrected, in b₀ [m/s].
    pub fn take(&mut self, imu: &ImuIncrement) -> Vector3<f32> {
        let motion = self.corrections.correct(imu);
        self.corrections.remember(imu);
        let [qw, qx, qy, qz] = &mut self.q;
        let q = [qw.hi, qx.hi, qy.hi, qz.hi];
        let phi_b = plus(&motion.delta_theta_b, &motion.theta_correction_b);
        let [dw, dx, dy, dz] = product(&q, &rotation_minus_one(&phi_b));
        let middle = [
            q[0] + 0.5 * dw,
            q[1] + 0.5 * dx,
            q[2] + 0.5 * dy,
            q[3] + 0.5 * dz,
        ];
        qw.add(dw);
        qx.add(dx);
        qy.add(dy);
        qz.add(dz);
        transformed(&rotation(middle), &motion.delta_v_mid)
    }

    /// b₀ is the body frame of now; what coning and sculling need of the last sample stays.
    pub fn restart(&mut self) {
        self.q = Self::new().q;
    }

    /// Rotation vector from b₀ to the body frame of the last sample [rad], up to half a turn.
    pub fn turned(&self) -> Vector3<f32> {
        let [w, x, y, z] = self.q;
        let v = Vector3::new(x.hi, y.hi, z.hi);
        let sin = libm::sqrtf(dot(&v, &v));
        // below it, the angle is its sine to 1e-9 of itself
        let scale = if sin > 1e-4 {
            2.0 * libm::atan2f(sin, w.hi) / sin
        } else {
            2.0
        };
        scaled(&v, scale)
    }

    /// C from the body frame of the last sample to b₀.
    pub fn c_b_b0(&self) -> Matrix3<f32> {
        let [w, x, y, z] = self.q;
        rotation([w.hi, x.hi, y.hi, z.hi])
    }
}

/// Rotation matrix of a quaternion of nearly unit length.
#[inline(always)]
fn rotation(q: [f32; 4]) -> Matrix3<f32> {
    let norm2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    c_b_n_scaled(q, 2.0 / norm2)
}

/// exp([φ×])
pub(super) fn rotation_by(phi: &Vector3<f32>) -> Matrix3<f32> {
    let [w, x, y, z] = rotation_minus_one(phi);
    rotation([1.0 + w, x, y, z])
}
