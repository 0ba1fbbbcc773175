//! Vectors and attitudes that carry their frame in the type, for the edge of the library.
//!
//! Inside, every `_n` is east-north-up and every `_b` right-forward-up, and a bare vector handed in is taken for one
//! of these. A sensor or an autopilot that speaks north-east-down and front-right-down wraps its vectors in [`Ned`]
//! and [`Frd`]; they are converted on the way in, and a vector of the wrong kind does not compile:
//!
//! ```
//! use nalgebra::Vector3;
//! use navsight::attitude::{Frd, Ned};
//! use navsight::imu::ImuIncrement;
//!
//! let gyro = Frd(Vector3::new(0.1, 0.0, 0.0)); // rolling to the right: about the forward axis
//! let accel = Frd(Vector3::new(0.0, 0.0, -9.8));
//! let imu = ImuIncrement::from_rates(gyro, accel, 0.01);
//! assert!(imu.delta_theta_b.y > 0.0 && imu.delta_v_b.z > 0.0);
//! ```
//! ```compile_fail,E0277
//! use nalgebra::Vector3;
//! use navsight::attitude::{Frd, Ned};
//! use navsight::imu::ImuIncrement;
//!
//! let gyro = Frd(Vector3::new(0.1, 0.0, 0.0));
//! let accel = Ned(Vector3::new(0.0, 0.0, -9.8)); // a vector of the local level frame is not one of the body
//! let imu = ImuIncrement::from_rates(gyro, accel, 0.01);
//! ```

use nalgebra::Vector3;

use super::Euler;

/// A vector in the local level frame of this library, east-north-up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Enu(pub Vector3<f32>);

/// A vector in the local level frame north-east-down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ned(pub Vector3<f32>);

/// A vector in the body frame of this library, right-forward-up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rfu(pub Vector3<f32>);

/// A vector in the body frame front-right-down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frd(pub Vector3<f32>);

/// A unit quaternion (w, x, y, z) that takes right-forward-up to east-north-up, this library's attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RfuToEnu(pub [f32; 4]);

/// A unit quaternion (w, x, y, z) that takes front-right-down to north-east-down, as autopilots use it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrdToNed(pub [f32; 4]);

/// (a, b, c) → (b, a, −c): the two conventions of either frame differ by half a turn about the diagonal of the
/// horizontal plane, which is its own inverse.
fn half_turn(v: Vector3<f32>) -> Vector3<f32> {
    Vector3::new(v.y, v.x, -v.z)
}

/// t∘q∘t* of the same half turn t = (0, 1, 1, 0)/√2.
fn half_turn_of_quaternion([w, x, y, z]: [f32; 4]) -> [f32; 4] {
    [w, y, x, -z]
}

macro_rules! both_ways {
    ($ours:ident, $theirs:ident, $turn:ident) => {
        impl From<$theirs> for $ours {
            fn from(v: $theirs) -> Self {
                $ours($turn(v.0))
            }
        }
        impl From<$ours> for $theirs {
            fn from(v: $ours) -> Self {
                $theirs($turn(v.0))
            }
        }
    };
}

both_ways!(Enu, Ned, half_turn);
both_ways!(Rfu, Frd, half_turn);
both_ways!(RfuToEnu, FrdToNed, half_turn_of_quaternion);

/// A bare vector is in the library's own frame.
impl From<Vector3<f32>> for Enu {
    fn from(v: Vector3<f32>) -> Self {
        Self(v)
    }
}

/// A bare vector is in the library's own frame.
impl From<Vector3<f32>> for Rfu {
    fn from(v: Vector3<f32>) -> Self {
        Self(v)
    }
}

impl From<Euler> for RfuToEnu {
    fn from(euler: Euler) -> Self {
        Self(euler.quaternion())
    }
}
