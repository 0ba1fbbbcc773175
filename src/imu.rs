//! What an inertial sensor delivers: increments of angle and velocity over a sample, their checks at the door, and
//! the coning and sculling corrections.

use nalgebra::Vector3;

use crate::attitude::Rfu;
use crate::error::Error;
use crate::linalg::{all_finite, divided};

/// Increments over one sample, body axes right-forward-up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuIncrement {
    /// ∫ω_ib^b dt [rad].
    pub delta_theta_b: Vector3<f32>,
    /// ∫f^b dt, specific force: +9.8 m/s times the seconds on the up axis at rest [m/s].
    pub delta_v_b: Vector3<f32>,
    /// Length of the sample [s].
    pub dt: f32,
}

/// What is accepted from a sensor. The defaults are what no vehicle with people or goods in it reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ImuLimits {
    /// Largest length of the angular rate vector, 70 [rad/s] (4000 °/s).
    pub rate: f32,
    /// Largest length of the specific force vector, 1000 [m/s²].
    pub specific_force: f32,
    /// Shortest sample, 1e-5 [s].
    pub dt_min: f32,
    /// Longest sample; a longer gap is an interruption, 0.5 [s].
    pub dt_max: f32,
}

impl ImuLimits {
    /// The defaults, for constants.
    pub const DEFAULT: Self = Self {
        rate: 70.0,
        specific_force: 1000.0,
        dt_min: 1e-5,
        dt_max: 0.5,
    };
}

impl Default for ImuLimits {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Largest rotation of one sample, whatever the limits say [rad]: the series of the mechanization end there.
pub const MAX_ROTATION: f32 = 1.0;

impl ImuIncrement {
    /// From increments, in the library's frame or typed ([`Rfu`], [`crate::attitude::Frd`]).
    pub fn new(delta_theta_b: impl Into<Rfu>, delta_v_b: impl Into<Rfu>, dt: f32) -> Self {
        Self {
            delta_theta_b: delta_theta_b.into().0,
            delta_v_b: delta_v_b.into().0,
            dt,
        }
    }

    /// From mean rates over the sample: angular rate ω_ib^b [rad/s] and specific force [m/s²].
    pub fn from_rates(omega_ib_b: impl Into<Rfu>, f_b: impl Into<Rfu>, dt: f32) -> Self {
        Self {
            delta_theta_b: omega_ib_b.into().0 * dt,
            delta_v_b: f_b.into().0 * dt,
            dt,
        }
    }

    /// Checks a sample at the door.
    ///
    /// # Errors
    /// [`Error::NonFinite`] for NaN or ±∞ anywhere; [`Error::Time`] for a length outside `dt_min..=dt_max` (zero and
    /// negative ones included); [`Error::OutOfRange`] for a rate or force beyond the limits, or a rotation beyond
    /// [`MAX_ROTATION`].
    #[inline(always)]
    pub fn check(&self, limits: &ImuLimits) -> Result<(), Error> {
        let (t, v) = (&self.delta_theta_b, &self.delta_v_b);
        let theta2 = t.x * t.x + t.y * t.y + t.z * t.z;
        let v2 = v.x * v.x + v.y * v.y + v.z * v.z;
        let (theta_max, v_max) = (limits.rate * self.dt, limits.specific_force * self.dt);
        // A NaN fails every comparison; the squares of the absurd are ∞ and fail too.
        let good = theta2 <= theta_max * theta_max
            && theta2 <= MAX_ROTATION * MAX_ROTATION
            && v2 <= v_max * v_max
            && self.dt >= limits.dt_min
            && self.dt > 0.0
            && self.dt <= limits.dt_max;
        if good {
            Ok(())
        } else {
            Err(self.fault(limits))
        }
    }

    #[cold]
    #[inline(never)]
    fn fault(&self, limits: &ImuLimits) -> Error {
        let (t, v) = (&self.delta_theta_b, &self.delta_v_b);
        if !all_finite(&[t.x, t.y, t.z, v.x, v.y, v.z, self.dt]) {
            Error::NonFinite
        } else if !(self.dt > 0.0 && self.dt >= limits.dt_min && self.dt <= limits.dt_max) {
            Error::Time
        } else {
            Error::OutOfRange
        }
    }
}

/// A sample with coning and sculling taken into account.
///
/// The rotation is kept as what was measured and the small correction that belongs to it, down to the sums of the
/// mechanization: added here, the correction would be rounded to the last place of the increment, always the same way,
/// and a swing of 5° would drift by 0.2″ an hour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Increment of angle as measured [rad].
    pub delta_theta_b: Vector3<f32>,
    /// What makes it the rotation vector of the sample: coning, less the bias [rad].
    pub theta_correction_b: Vector3<f32>,
    /// ∫f dt resolved in the body axes at the *middle* of the sample [m/s].
    pub delta_v_mid: Vector3<f32>,
    /// Length of the sample [s].
    pub dt: f32,
}

impl Motion {
    /// Rotation vector of the body over the sample [rad].
    pub fn phi_b(&self) -> Vector3<f32> {
        self.delta_theta_b + self.theta_correction_b
    }

    /// Takes biases off, gyro [rad/s] and accelerometer [m/s²]. Rounding of the velocity increment costs at most
    /// 0.04 µg at 1 g and any rate.
    #[inline(always)]
    pub fn less_biases(&self, b_g: &Vector3<f32>, b_a: &Vector3<f32>) -> Self {
        let (t, u, dt) = (&self.theta_correction_b, &self.delta_v_mid, self.dt);
        Self {
            theta_correction_b: Vector3::new(t.x - b_g.x * dt, t.y - b_g.y * dt, t.z - b_g.z * dt),
            delta_v_mid: Vector3::new(u.x - b_a.x * dt, u.y - b_a.y * dt, u.z - b_a.z * dt),
            ..*self
        }
    }
}

/// Two-sample coning and sculling: the previous sample tells how rate and force change.
///
/// ```text
/// φ   = α + k (α₋ × α)
/// u_m = u + k (α₋ × u + u₋ × α),     k = T²/(6 T₋ (T + T₋)),  1/12 for equal samples
/// ```
/// with α, u the increments of angle and velocity of this sample of length T, and α₋, u₋, T₋ those of the previous
/// one. u_m is resolved in the body axes at the middle of the sample, so the term ½ α×u of the forms that refer to
/// its beginning does not appear. Exact for a rate and a force that change linearly over both samples, to second order
/// in the angle. A sample of over 1.5 times the length of the previous one (something was lost in between), and the
/// first one, are taken as they are.
///
/// Increments are remembered as measured: what a constant bias adds to the products cancels from sample to sample, and
/// a new bias estimate does not look like an angular acceleration.
///
/// Source: Savage 1998, Strapdown inertial navigation integration algorithm design, parts 1 and 2 (coning and sculling
/// with the previous increment), extended to unequal samples by integrating the same linear model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConingSculling {
    delta_theta_b: Vector3<f32>,
    delta_v_b: Vector3<f32>,
    dt: f32,
}

impl ConingSculling {
    /// Before the first sample.
    pub const NEW: Self = Self {
        delta_theta_b: Vector3::new(0.0, 0.0, 0.0),
        delta_v_b: Vector3::new(0.0, 0.0, 0.0),
        dt: 1.0,
    };

    /// Mean angular rate of the sample remembered, as measured, body axes [rad/s]; None before the first.
    #[inline(always)]
    pub fn rate(&self) -> Option<Vector3<f32>> {
        // A sample of a second without any rate and force is not told from none; its rate is zero as well.
        let blank = *self == Self::NEW;
        (!blank).then(|| divided(&self.delta_theta_b, self.dt))
    }

    /// This sample with coning and sculling taken into account. `imu` has been checked; it is not yet remembered.
    #[inline(always)]
    pub fn correct(&self, imu: &ImuIncrement) -> Motion {
        let (a0, u0) = (&self.delta_theta_b, &self.delta_v_b);
        let (a, u, dt) = (&imu.delta_theta_b, &imu.delta_v_b, imu.dt);
        let k = if dt <= 1.5 * self.dt {
            dt * dt / (6.0 * self.dt * (dt + self.dt))
        } else {
            0.0
        };
        Motion {
            delta_theta_b: *a,
            theta_correction_b: Vector3::new(
                k * (a0.y * a.z - a0.z * a.y),
                k * (a0.z * a.x - a0.x * a.z),
                k * (a0.x * a.y - a0.y * a.x),
            ),
            delta_v_mid: Vector3::new(
                u.x + k * ((a0.y * u.z - a0.z * u.y) + (u0.y * a.z - u0.z * a.y)),
                u.y + k * ((a0.z * u.x - a0.x * u.z) + (u0.z * a.x - u0.x * a.z)),
                u.z + k * ((a0.x * u.y - a0.y * u.x) + (u0.x * a.y - u0.y * a.x)),
            ),
            dt,
        }
    }

    /// Remembers this sample for the next one.
    #[inline(always)]
    pub fn remember(&mut self, imu: &ImuIncrement) {
        (self.delta_theta_b, self.delta_v_b, self.dt) = (imu.delta_theta_b, imu.delta_v_b, imu.dt);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn door() {
        let l = ImuLimits::DEFAULT;
        let ok = ImuIncrement::from_rates(
            Vector3::new(0.1, 0.2, 0.3),
            Vector3::new(0.0, 0.0, 9.8),
            0.01,
        );
        assert_eq!(ok.check(&l), Ok(()));
        for (i, bad) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY]
            .into_iter()
            .enumerate()
        {
            let mut s = ok;
            s.delta_theta_b[i] = bad;
            assert_eq!(s.check(&l), Err(Error::NonFinite));
            let mut s = ok;
            s.delta_v_b[i] = bad;
            assert_eq!(s.check(&l), Err(Error::NonFinite));
            assert_eq!(
                ImuIncrement { dt: bad, ..ok }.check(&l),
                Err(Error::NonFinite)
            );
        }
        for dt in [0.0, -0.01, 0.6, 1e-7] {
            assert_eq!(ImuIncrement { dt, ..ok }.check(&l), Err(Error::Time));
        }
        for (rate, force) in [(71.0, 0.0), (0.0, 1001.0), (f32::MAX, 0.0), (0.0, f32::MAX)] {
            let s = ImuIncrement::new(
                Vector3::new(0.0, rate * 0.01, 0.0),
                Vector3::new(force * 0.01, 0.0, 0.0),
                0.01,
            );
            assert_eq!(s.check(&l), Err(Error::OutOfRange));
        }
        // A long sample may not turn beyond the series, even at a permitted rate.
        let s = ImuIncrement::new(Vector3::new(0.0, 1.1, 0.0), Vector3::zeros(), 0.1);
        assert_eq!(s.check(&l), Err(Error::OutOfRange));
        // A limit that is not a number refuses everything.
        assert!(ok
            .check(&ImuLimits {
                rate: f32::NAN,
                ..l
            })
            .is_err());
        assert!(ok
            .check(&ImuLimits {
                dt_max: f32::NAN,
                ..l
            })
            .is_err());
    }
}
