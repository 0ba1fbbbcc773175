//! What the user tells the filter once: sensor noise, bias models, limits, and how much is known at the start.

use crate::error::Error;
use crate::error_model::{BiasModel, NoiseDensity, ATT, BA, BG, N, POS, VEL};
use crate::imu::ImuLimits;
use crate::linalg::{looped, rolled, Real};

/// How the filter runs. Fixed at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// What an IMU sample may hold at most; everything beyond is refused.
    pub limits: ImuLimits,
    /// Process noise as densities, per axis.
    pub noise: NoiseDensity<f32>,
    /// Correlation of the bias states.
    pub bias: BiasModel<f32>,
    /// The covariance moves when this much time has gathered or when a measurement arrives [s], 0.001 to 10.
    ///
    /// Longer intervals cost less and lose ∫∫-terms of first order in the transition; beyond [`MAX_STEP`] they are
    /// divided into equal parts.
    pub propagation_interval: f32,
    /// A row is refused when ν²/s exceeds this (χ², one degree of freedom; 10.8 is one false alarm in 1000).
    /// None: every row is used.
    pub gate: Option<f32>,
}

/// Longest interval over which the covariance is moved in one first-order step [s].
///
/// The first-order error in ξ2 is 6e-5 at this length for constant biases (`host-tests/tests/covariance.rs`).
pub const MAX_STEP: f32 = 0.1;

impl Settings {
    /// Refuses settings that no sensor has.
    pub fn check(&self) -> Result<(), Error> {
        self.noise.check()?;
        self.bias.check()?;
        let gate = self.gate.unwrap_or(1.0);
        if !self.propagation_interval.finite() || !gate.finite() {
            return Err(Error::NonFinite);
        }
        if !(0.001..=10.0).contains(&self.propagation_interval) || gate <= 0.0 {
            return Err(Error::OutOfRange);
        }
        Ok(())
    }
}

/// How much is known at the start: one standard deviation per state, uncorrelated. It is the p0 of ξ1 and ξ2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Position, east, north, up [m].
    pub position: [f32; 3],
    /// Velocity, east, north, up [m/s].
    pub velocity: [f32; 3],
    /// Attitude ψ about east, north, up [rad].
    pub attitude: [f32; 3],
    /// Gyro bias, body axes [rad/s].
    pub gyro_bias: [f32; 3],
    /// Accelerometer bias, body axes [m/s²].
    pub accel_bias: [f32; 3],
}

impl Prior {
    /// The standard deviations in state order; refuses negative and non-finite ones.
    pub fn sigma0(&self) -> Result<[f32; N], Error> {
        let mut sigma0 = [0.0; N];
        self.sigma0_into(&mut sigma0)?;
        Ok(sigma0)
    }

    /// [`Prior::sigma0`] where there is room for it.
    #[inline]
    pub(super) fn sigma0_into(&self, sigma0: &mut [f32; N]) -> Result<(), Error> {
        let groups = [
            self.position,
            self.velocity,
            self.attitude,
            self.gyro_bias,
            self.accel_bias,
        ];
        const { assert!(POS + 3 == VEL && VEL + 3 == ATT && ATT + 3 == BG && BG + 3 == BA) };
        let given = looped(groups.as_flattened()).iter();
        for (to, &sigma) in sigma0.iter_mut().zip(given) {
            rolled();
            if !sigma.finite() {
                return Err(Error::NonFinite);
            }
            // The square is what the filter holds: it must be a number, and not vanish by underflow.
            let var = sigma * sigma;
            if sigma < 0.0 || !var.finite() || (sigma > 0.0 && var < f32::MIN_POSITIVE) {
                return Err(Error::OutOfRange);
            }
            *to = sigma;
        }
        Ok(())
    }
}
