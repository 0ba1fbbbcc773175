//! Is the sensor at rest? A likelihood-ratio test on less than half a second, and the updates that a rest allows.
//!
//! At rest the gyros show a constant and the accelerometers show a constant; which constants is not known at the start.
//! The window is cut into five blocks, whose means w_k, f_k are compared with the means of the window:
//!
//! ```text
//! scatter = 1/24 · Σ_k ( |w_k − w̄|²/s_g² + |f_k − f̄|²/s_a² ),     s² = N²/T_block + residual²         χ²₂₄/24 at rest
//! offset  = |w̄ − b̂|²/(p_b + e s_g²/5 + Ω²) + (|f̄| − g)²/(σ_ba² + e s_a²/5),   e = max(1, scatter)     χ²₄ at rest
//! ```
//! N is the noise density of the sensor. `scatter` is the generalised likelihood ratio of "both constant" against "anything",
//! the constants being replaced by their most likely values; `offset` is the same for the constants, given what is
//! known of the biases. Still: both below their limits.
//!
//! Blocks in place of samples, because the motion of hands and vehicles is slow: the mean over a tenth of a second keeps
//! all of it and loses the noise of 28 samples at 286 Hz. The limit follows from the noise alone: the 0.9999 quantile of
//! χ²₂₄/24, 2.45, times an allowance, 25: a carrier at rest may shake by five times what the sensor's own noise makes of
//! a tenth of a second. What has just been put down rings for a second by that much (measured: rates of 1.4 °/s from
//! sample to sample at first, 0.3 °/s after a second, where the noise is 0.1 °/s), and a test for the noise alone finds it
//! when that is over. What a shaking window says counts for less: e times the variance, in the offset, in the learnt bias and in
//! the zero-rotation update.
//!
//! The gyro bias is learnt at rests and forgotten in ten minutes (p_b), so that a slow even turn, which looks like a
//! bias at first, is not taken for rest later on. What no such test can see is an even motion without rotation.
//!
//! Source: Skog, Händel et al. 2010, "Zero-velocity detection: an algorithm evaluation" (the likelihood ratio with known
//! bias); unknown constants, blocks and the bias memory derived here. Both errors counted on recordings:
//! `host-tests/tests/stationary.rs`.

use nalgebra::Vector3;

use crate::earth::OMEGA_IE;
use crate::error::Error;
use crate::imu::{ImuIncrement, ImuLimits};
use crate::linalg::{divided, dot, minus, plus, scaled};
use crate::measurement::{ZeroRotation, ZeroVelocity};

/// Blocks in a window.
const BLOCKS: usize = 5;

/// Calls `$m!(0)` … `$m!(4)`: what is spelled out costs the same at opt-level "s" and 3.
macro_rules! each_block {
    ($m:ident) => {
        const { assert!(BLOCKS == 5) };
        $m!(0);
        $m!(1);
        $m!(2);
        $m!(3);
        $m!(4);
    };
}

/// Degrees of freedom of the scatter.
const SCATTER_FREEDOM: f32 = 6.0 * (BLOCKS as f32 - 1.0);
/// 0.9999 quantile of χ²₂₄ over 24: one false refusal in 10 000 windows of a sensor as good as its data sheet.
pub const SCATTER_LIMIT: f32 = 2.45;
/// 0.9999 quantile of χ²₄.
pub const OFFSET_LIMIT: f32 = 23.5;
/// After this time without rest nothing of the learnt gyro bias is left [s].
const BIAS_MEMORY: f32 = 600.0;

/// What the test has to know of the sensor and of its carrier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StationarySettings {
    /// Angle random walk of the gyros [rad/√s].
    pub angle_walk: f32,
    /// Velocity random walk of the accelerometers [m/s/√s].
    pub velocity_walk: f32,
    /// Gyro bias before anything is known, 1σ per axis [rad/s].
    pub gyro_bias: f32,
    /// Bias and scale error of the accelerometers along gravity, 1σ [m/s²].
    pub accel_bias: f32,
    /// Gravity here [m/s²].
    pub gravity: f32,
    /// What a carrier at rest still turns by, 1σ per axis over a tenth of a second [rad/s]: 0 for a sensor on a table, whose
    /// shaking is in `allowance`; with a residual set `allowance` to about 2.
    pub residual_rate: f32,
    /// What it still accelerates by, likewise [m/s²].
    pub residual_accel: f32,
    /// What it still moves by, 1σ per axis [m/s]: the σ of the zero-velocity update.
    pub residual_velocity: f32,
    /// Variance of the means of a tenth of a second over that which the noise of the data sheet gives them, at most; 1 to
    /// 100. 25 is five times the noise; anything from 10 to 50 meets the figures of `host-tests/tests/stationary.rs`.
    pub allowance: f32,
    /// Length of the window [s], 0.1 to 10. A rest is seen this long after it began, and up to a fifth of it later where it
    /// begins within a block.
    pub window: f32,
    /// What an IMU sample may hold at most.
    pub limits: ImuLimits,
}

impl StationarySettings {
    /// From the data sheet: angle and velocity random walk [rad/√s], [m/s/√s], turn-on biases 1σ [rad/s], [m/s²]. A
    /// window of 0.4 s, so that no rest is seen later than half a second, and a sensor on something solid that may shake by up to five times the stated noise.
    pub fn from_noise(
        angle_walk: f32,
        velocity_walk: f32,
        gyro_bias: f32,
        accel_bias: f32,
    ) -> Self {
        Self {
            angle_walk,
            velocity_walk,
            gyro_bias,
            accel_bias,
            gravity: 9.806_65,
            residual_rate: 0.0,
            residual_accel: 0.0,
            residual_velocity: 0.01,
            allowance: 25.0,
            window: 0.4,
            limits: ImuLimits::DEFAULT,
        }
    }

    /// Refuses settings that no sensor has.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for a noise, a bias or a residual velocity that is not above zero, a
    /// residual below it, and what is outside its limits.
    pub fn check(&self) -> Result<(), Error> {
        let positive = [
            self.angle_walk,
            self.velocity_walk,
            self.gyro_bias,
            self.accel_bias,
            self.gravity,
            self.residual_velocity,
        ];
        let residuals = [self.residual_rate, self.residual_accel];
        let all = positive.iter().chain(&residuals);
        if !all
            .chain(&[self.allowance, self.window])
            .all(|x| x.is_finite())
        {
            return Err(Error::NonFinite);
        }
        // 1e-9: squares and their quotients stay normal numbers.
        let good = positive.iter().all(|x| (1e-9..=1e3).contains(x))
            && residuals.iter().all(|x| (0.0..=1e3).contains(x))
            && (1.0..=100.0).contains(&self.allowance)
            && (0.1..=10.0).contains(&self.window);
        if good {
            Ok(())
        } else {
            Err(Error::OutOfRange)
        }
    }
}

/// The window as it stands at the end of a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// At rest during the whole window.
    pub still: bool,
    /// Scatter of the blocks over its expectation: about 1 at rest.
    pub scatter: f32,
    /// Distance of the means from what biases can be: about 4 at rest.
    pub offset: f32,
    /// Mean gyro output of the window, body axes [rad/s].
    pub rate: Vector3<f32>,
    /// The two updates, once in every window's length of rest: their noise is then independent.
    pub updates: Option<(ZeroVelocity, ZeroRotation)>,
}

/// Sums over a block.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Block {
    delta_theta: Vector3<f32>,
    delta_v: Vector3<f32>,
    dt: f32,
}

impl Block {
    const EMPTY: Self = Self {
        delta_theta: Vector3::new(0.0, 0.0, 0.0),
        delta_v: Vector3::new(0.0, 0.0, 0.0),
        dt: 0.0,
    };

    #[inline(always)]
    fn with(&self, delta_theta: &Vector3<f32>, delta_v: &Vector3<f32>, dt: f32) -> Self {
        Self {
            delta_theta: plus(&self.delta_theta, delta_theta),
            delta_v: plus(&self.delta_v, delta_v),
            dt: self.dt + dt,
        }
    }
}

/// Gathers samples and looks at the window at the end of every block, a fifth of the window.
#[derive(Clone, Debug, PartialEq)]
pub struct StationaryDetector {
    settings: StationarySettings,
    zero_velocity: ZeroVelocity,
    blocks: [Block; BLOCKS],
    /// Place of the next block; the order in the store does not matter.
    next: usize,
    filled: usize,
    open: Block,
    /// Gyro bias learnt at rests and its variance per axis.
    bias: Vector3<f32>,
    bias_variance: f32,
    /// Blocks of rest since the last updates.
    rested: usize,
}

impl StationaryDetector {
    /// Nothing gathered, biases unknown.
    ///
    /// # Errors
    /// Those of [`StationarySettings::check`].
    pub fn new(settings: StationarySettings) -> Result<Self, Error> {
        settings.check()?;
        Ok(Self {
            settings,
            zero_velocity: ZeroVelocity::new(settings.residual_velocity, settings.window)?,
            blocks: [Block::EMPTY; BLOCKS],
            next: 0,
            filled: 0,
            open: Block::EMPTY,
            bias: Vector3::zeros(),
            bias_variance: settings.gyro_bias * settings.gyro_bias,
            rested: 0,
        })
    }

    /// Forgets the window, after a gap in the samples; keeps the learnt bias.
    pub fn restart(&mut self) {
        self.next = 0;
        self.filled = 0;
        self.rested = 0;
        self.open = Block::EMPTY;
    }

    /// Gyro bias learnt at rests, the earth rate included, body axes [rad/s], and its 1σ per axis.
    pub fn bias(&self) -> (Vector3<f32>, f32) {
        (self.bias, libm::sqrtf(self.bias_variance))
    }

    /// Takes one sample; `Some` at the end of a block, once a whole window is there.
    ///
    /// # Errors
    /// Those of [`ImuIncrement::check`]; nothing has changed then.
    pub fn take(&mut self, imu: &ImuIncrement) -> Result<Option<Look>, Error> {
        imu.check(&self.settings.limits)?;
        let open = self.open.with(&imu.delta_theta_b, &imu.delta_v_b, imu.dt);
        let block = self.settings.window / BLOCKS as f32;
        // Rather short than long, whatever the rounding of the sum: the window is what a decision is late by.
        if open.dt + imu.dt < 1.001 * block {
            self.open = open;
            return Ok(None);
        }
        if let Some(place) = self.blocks.get_mut(self.next) {
            *place = open;
        }
        self.open = Block::EMPTY;
        self.next = if self.next + 1 < BLOCKS {
            self.next + 1
        } else {
            0
        };
        if self.filled < BLOCKS {
            self.filled += 1;
        }
        Ok((self.filled == BLOCKS).then(|| self.look()))
    }

    fn look(&mut self) -> Look {
        let s = &self.settings;
        let mut sum = Block::EMPTY;
        macro_rules! add {
            ($i:literal) => {
                let block = &self.blocks[$i];
                sum = sum.with(&block.delta_theta, &block.delta_v, block.dt);
            };
        }
        each_block!(add);
        let rate = divided(&sum.delta_theta, sum.dt);
        let force = divided(&sum.delta_v, sum.dt);
        let (rate_walk, force_walk) = (
            s.angle_walk * s.angle_walk,
            s.velocity_walk * s.velocity_walk,
        );
        let (rate_floor, force_floor) = (
            s.residual_rate * s.residual_rate,
            s.residual_accel * s.residual_accel,
        );
        let mut scatter = 0.0;
        macro_rules! add {
            ($i:literal) => {
                let block = &self.blocks[$i];
                let w = minus(&divided(&block.delta_theta, block.dt), &rate);
                let f = minus(&divided(&block.delta_v, block.dt), &force);
                scatter += dot(&w, &w) / (rate_walk / block.dt + rate_floor)
                    + dot(&f, &f) / (force_walk / block.dt + force_floor);
            };
        }
        each_block!(add);
        scatter /= SCATTER_FREEDOM;
        let fifth = 1.0 / BLOCKS as f32;
        let block = sum.dt * fifth;
        let var_rate = (rate_walk / block + rate_floor) * fifth;
        let var_force = (force_walk / block + force_floor) * fifth;
        let earth2 = (OMEGA_IE * OMEGA_IE) as f32;
        let heavier = libm::sqrtf(dot(&force, &force)) - s.gravity;
        // A window that shakes says less of its means.
        let shaken = scatter.max(1.0);
        let (var_rate, var_force) = (var_rate * shaken, var_force * shaken);
        let off = minus(&rate, &self.bias);
        let offset = dot(&off, &off) / (self.bias_variance + var_rate + earth2)
            + heavier * heavier / (s.accel_bias * s.accel_bias + var_force);
        // Anything that is no number is no rest.
        let still = scatter <= SCATTER_LIMIT * s.allowance && offset <= OFFSET_LIMIT;
        let p0 = s.gyro_bias * s.gyro_bias;
        self.bias_variance = (self.bias_variance + p0 * (block / BIAS_MEMORY)).min(p0);
        let mut updates = None;
        if !still {
            self.rested = 0;
        } else if self.rested == 0 {
            let gain = self.bias_variance / (self.bias_variance + var_rate);
            self.bias = plus(&self.bias, &scaled(&off, gain));
            self.bias_variance *= 1.0 - gain;
            let sigma = libm::sqrtf(var_rate);
            if let Ok(zero_rotation) = ZeroRotation::new(rate, sigma, s.window) {
                updates = Some((self.zero_velocity, zero_rotation));
            }
            self.rested = 1;
        } else if self.rested + 1 < BLOCKS {
            self.rested += 1;
        } else {
            self.rested = 0;
        }
        Look {
            still,
            scatter,
            offset,
            rate,
            updates,
        }
    }
}
