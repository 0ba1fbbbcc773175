//! Where the first heading comes from: the earth rate, or somebody who knows it.
//!
//! The criterion is the heading σ that each can give, before a sample has been taken:
//!
//! ```text
//! σ_earth = √(σ_b² + N²/T) / (Ω cos L)         gyro bias σ_b, angle random walk N, window T, latitude L
//! ```
//! The smaller of σ_earth and the σ of the outside heading decides. Where neither is below [`LARGEST_HEADING`] the vehicle
//! is only levelled: a filter that is linear in the heading error settles on a wrong one, and the honest answer is
//! that heading is not known yet ([`super::in_motion`] finds it from motion).
//!
//! | sensor | σ_b | σ_earth at 45° |
//! |---|---|---|
//! | navigation grade | 0.02 °/h | 0.11° |
//! | tactical | 1 °/h | 5.4° |
//! | MEMS | 30 °/h and more | above 57°, unusable |

use nalgebra::Vector3;

use super::coarse::UNKNOWN_HEADING;
use crate::attitude::{Euler, Rfu};
use crate::earth::OMEGA_IE;
use crate::error::Error;

/// Largest standard deviation of a heading that a filter is started with, 15° [rad]: 1 − cos of three times as much is 0.3,
/// which is what a linear filter leaves out.
pub const LARGEST_HEADING: f32 = 0.261_799_4;

/// Where the heading of a start comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum HeadingSource {
    /// The gyros feel the earth turn.
    EarthRate,
    /// Magnetic, two antennas, stored.
    Outside,
    /// Nobody knows it well enough: level only.
    Nobody,
}

/// Azimuth of a direction in the body, known from outside: see [`crate::measurement::Heading`] for which.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutsideHeading {
    axis_b: Vector3<f32>,
    azimuth: f32,
    sigma: f32,
}

impl OutsideHeading {
    /// Heading of the vehicle, clockwise from true north, and its 1σ [rad].
    ///
    /// # Errors
    /// As [`OutsideHeading::of_axis`].
    pub fn new(heading: f32, sigma: f32) -> Result<Self, Error> {
        Self::of_axis(Vector3::new(0.0, 1.0, 0.0), heading, sigma)
    }

    /// Azimuth of a direction in the body, clockwise from true north, and its 1σ [rad]: a baseline and what the receiver
    /// gives, a magnetic field and the declination of the place.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for more than one turn, an axis whose length is not within 1e-6 … 1e6
    /// or a σ that is not within 1e-6 … π.
    pub fn of_axis(axis_b: impl Into<Rfu>, azimuth: f32, sigma: f32) -> Result<Self, Error> {
        let axis_b = axis_b.into().0;
        let all = axis_b.iter().chain([&azimuth, &sigma]);
        if !all.into_iter().all(|x| x.is_finite()) {
            return Err(Error::NonFinite);
        }
        let good = azimuth.abs() <= core::f32::consts::TAU
            && (1e-6..=1e6).contains(&axis_b.norm())
            && (1e-6..=core::f32::consts::PI).contains(&sigma);
        if good {
            Ok(Self {
                axis_b,
                azimuth,
                sigma,
            })
        } else {
            Err(Error::OutOfRange)
        }
    }

    /// 1σ [rad].
    pub fn sigma(&self) -> f32 {
        self.sigma
    }

    /// Heading of a vehicle with this pitch and roll [rad]; None when the axis is within 1° of the vertical.
    pub fn heading(&self, pitch: f32, roll: f32) -> Option<f32> {
        let level = Euler {
            heading: 0.0,
            pitch,
            roll,
        };
        let l = level.c_b_n() * self.axis_b;
        let rho2 = l.x * l.x + l.y * l.y;
        // sin² 1°
        (rho2 > 3.046e-4 * self.axis_b.norm_squared())
            .then(|| self.azimuth - libm::atan2f(l.x, l.y))
    }
}

/// σ of a heading from the earth rate [rad], at most [`UNKNOWN_HEADING`].
///
/// * `lat` [rad], `gyro_bias` 1σ [rad/s], `angle_walk` [rad/√s], `seconds` of the window
pub fn earth_rate_sigma(lat: f32, gyro_bias: f32, angle_walk: f32, seconds: f32) -> f32 {
    let rate = libm::sqrtf(gyro_bias * gyro_bias + angle_walk * angle_walk / seconds);
    let sigma = rate / (OMEGA_IE as f32 * libm::cosf(lat));
    // min also makes a number of what is none
    sigma.min(UNKNOWN_HEADING)
}

/// The better of the two, if it is good enough.
pub fn choose(earth_rate_sigma: f32, outside: Option<&OutsideHeading>) -> HeadingSource {
    match outside {
        Some(outside) if outside.sigma < earth_rate_sigma => {
            if outside.sigma <= LARGEST_HEADING {
                HeadingSource::Outside
            } else {
                HeadingSource::Nobody
            }
        }
        _ if earth_rate_sigma <= LARGEST_HEADING => HeadingSource::EarthRate,
        _ => HeadingSource::Nobody,
    }
}
