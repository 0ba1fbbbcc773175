//! How the axes of the vehicle stand in the axes of the IMU.

use nalgebra::{Matrix3, Vector3};

use crate::attitude::Euler;
use crate::error::Error;

/// Attitude of the vehicle's own axes (right, forward along its straight motion, up) in the body axes of the IMU.
///
/// An IMU is never mounted straight. Left at zero, every degree of the mounting's yaw is a degree of heading error that
/// course and non-holonomic aids teach the filter with a small σ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Boresight {
    /// Vehicle axes to body axes.
    c_m_b: Matrix3<f32>,
}

impl Boresight {
    /// The vehicle moves along the forward axis of the IMU.
    pub const NONE: Self = Self {
        c_m_b: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    };

    /// Heading, pitch and roll of the vehicle as the IMU sees them: `heading` is the angle by which the forward axis of
    /// the vehicle stands clockwise (seen from above) of the forward axis of the IMU, `pitch` by how much it points
    /// above it [rad].
    ///
    /// # Errors
    /// [`Error::NonFinite`].
    pub fn new(angles: Euler) -> Result<Self, Error> {
        if !(angles.heading.is_finite() && angles.pitch.is_finite() && angles.roll.is_finite()) {
            return Err(Error::NonFinite);
        }
        Ok(Self {
            c_m_b: angles.c_b_n(),
        })
    }

    /// Takes vehicle axes to body axes.
    pub fn c_m_b(&self) -> &Matrix3<f32> {
        &self.c_m_b
    }

    /// Forward axis of the vehicle in body axes, a unit vector.
    pub fn forward_b(&self) -> Vector3<f32> {
        Vector3::new(self.c_m_b.m12, self.c_m_b.m22, self.c_m_b.m32)
    }
}
