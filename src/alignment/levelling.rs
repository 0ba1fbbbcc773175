//! Level from the plain mean of the accelerometers: for sensors that cannot feel the earth turn.
//!
//! The inertial-frame window of [`super::coarse`] lets the gyros carry the body along. A gyro bias of 0.5 °/s turns it by
//! half a degree every second then, and the level with it. A sensor of this kind levels from the mean specific force in
//! the body itself, which stands still, and learns its gyro bias from the mean rate; heading has to come from outside
//! ([`super::heading_source`]).
//!
//! ```text
//! up_b = f̄/|f̄|,   pitch = atan2(up_y, √(up_x² + up_z²)),   roll = atan2(−up_x, up_z)
//! ```

use nalgebra::Vector3;

use super::coarse::UNKNOWN_HEADING;
use super::heading_source::OutsideHeading;
use crate::attitude::Euler;
use crate::earth::{Geodetic, Local};
use crate::error::Error;
use crate::error_model::ATT;
use crate::filter::{Filter, Prior, Settings, UpdateReport};
use crate::imu::{ImuIncrement, ImuLimits};
use crate::linalg::Two;
use crate::measurement::ZeroRotation;
use crate::nav::NavState;

/// No mean rate is taken for better than this, 0.01 °/h [rad/s]: settings without gyro noise are possible.
const MIN_RATE_SIGMA: f32 = 5e-8;
/// The heading, as a bit.
pub const HEADING: u16 = 1 << (ATT + 2);

/// Length of a block, whose means scatter as the level does [s].
const BLOCK: f32 = 1.0;
/// Fewest blocks that a level is made from.
pub const MIN_BLOCKS: u32 = 4;

/// What the window said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Nose up positive [rad].
    pub pitch: f32,
    /// Right side down positive [rad].
    pub roll: f32,
    /// Standard deviation of both from the scatter of the window [rad], without the accelerometer bias.
    pub sigma: f32,
    /// Mean gyro output, body axes [rad/s]: bias and earth rate.
    pub rate: Vector3<f32>,
    /// Mean length of the specific force [m/s²].
    pub force: f32,
}

/// Gathers samples of a sensor at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Levelling {
    limits: ImuLimits,
    delta_theta: [Two; 3],
    delta_v: [Two; 3],
    time: Two,
    /// Of the open block.
    block_v: Vector3<f32>,
    block_dt: f32,
    blocks: u32,
    /// Mean specific force of the closed blocks, and Σ of the squared distances from it (Welford).
    mean: Vector3<f32>,
    square: Vector3<f32>,
}

impl Levelling {
    /// A window that begins with the next sample.
    #[inline(always)]
    pub fn new(limits: ImuLimits) -> Self {
        let zero = Two { hi: 0.0, lo: 0.0 };
        let none = Vector3::new(0.0, 0.0, 0.0);
        Self {
            limits,
            delta_theta: [zero; 3],
            delta_v: [zero; 3],
            time: zero,
            block_v: none,
            block_dt: 0.0,
            blocks: 0,
            mean: none,
            square: none,
        }
    }

    /// Seconds gathered.
    pub fn time(&self) -> f32 {
        self.time.hi
    }

    /// Takes one sample.
    ///
    /// # Errors
    /// Those of [`ImuIncrement::check`]; the window is then as it was.
    pub fn take(&mut self, imu: &ImuIncrement) -> Result<(), Error> {
        imu.check(&self.limits)?;
        for (to, &x) in self.delta_theta.iter_mut().zip(imu.delta_theta_b.iter()) {
            to.add(x);
        }
        for (to, &x) in self.delta_v.iter_mut().zip(imu.delta_v_b.iter()) {
            to.add(x);
        }
        self.time.add(imu.dt);
        self.block_v += imu.delta_v_b;
        self.block_dt += imu.dt;
        if self.block_dt + 0.5 * imu.dt >= BLOCK {
            self.blocks = self.blocks.saturating_add(1);
            let force = self.block_v / self.block_dt;
            let off = force - self.mean;
            self.mean += off / self.blocks as f32;
            self.square += off.component_mul(&(force - self.mean));
            self.block_v = Vector3::zeros();
            self.block_dt = 0.0;
        }
        Ok(())
    }

    /// The level, once enough is there.
    ///
    /// # Errors
    /// [`Error::Time`] before [`MIN_BLOCKS`] seconds; [`Error::OutOfRange`] when the mean specific force is not within
    /// a tenth of `gravity` [m/s²]: not at rest.
    pub fn solve(&self, gravity: f32) -> Result<Level, Error> {
        if self.blocks < MIN_BLOCKS {
            return Err(Error::Time);
        }
        let [tx, ty, tz] = &self.delta_theta;
        let [vx, vy, vz] = &self.delta_v;
        let time = self.time.hi;
        let up = Vector3::new(vx.hi, vy.hi, vz.hi) / time;
        let force = up.norm();
        if !(0.9..=1.1).contains(&(force / gravity)) {
            return Err(Error::OutOfRange);
        }
        let n = self.blocks as f32;
        // The larger two of three axes are the level ones, or worse than them.
        let total = self.square.x + self.square.y + self.square.z;
        let level = total - self.square.min();
        let variance = 0.5 * level / (n * (n - 1.0));
        Ok(Level {
            pitch: libm::atan2f(up.y, libm::sqrtf(up.x * up.x + up.z * up.z)),
            roll: libm::atan2f(-up.x, up.z),
            sigma: libm::sqrtf(variance) / force,
            rate: Vector3::new(tx.hi, ty.hi, tz.hi) / time,
            force,
        })
    }

    /// Starts a filter from the window: level, with a heading from outside, and the mean rate as a zero-rotation update.
    /// The level is known as `prior` says, or as the window scatters where that is more.
    ///
    /// Without a heading any is assumed, nothing is known of it, and the filter holds it ([`Filter::consider`]): levels and
    /// biases are learnt as far as they can be, and the verdict about the heading is *unseen*. Left free, a linear
    /// filter would teach itself a heading from its own noise. With a [`super::gate::Gate`], which decides what is held,
    /// put [`HEADING`] into its `always`. Start anew when somebody knows the heading.
    ///
    /// # Errors
    /// Those of [`Levelling::solve`], [`NavState::new`] and [`Filter::new`]; [`Error::OutOfRange`] for a direction from
    /// outside that is upright.
    pub fn start(
        &self,
        position: Geodetic,
        outside: Option<&OutsideHeading>,
        prior: &Prior,
        settings: Settings,
    ) -> Result<(Level, Filter), Error> {
        let ready = self.ready(position, outside, prior, &settings)?;
        let nav = NavState::new(position, Vector3::zeros(), ready.euler)?;
        let prior = Prior {
            attitude: ready.attitude,
            ..*prior
        };
        let mut filter = Filter::new(nav, &prior, settings)?;
        if outside.is_none() {
            filter.consider(HEADING);
        }
        learn(&mut filter, &ready.still, &mut UpdateReport::empty())?;
        Ok((ready.level, filter))
    }

    /// What a filter starts with after the window.
    #[inline(never)]
    pub(super) fn ready(
        &self,
        position: Geodetic,
        outside: Option<&OutsideHeading>,
        prior: &Prior,
        settings: &Settings,
    ) -> Result<Ready, Error> {
        let local = Local::at(position.lat as f32, position.height as f32);
        let level = self.solve(local.gravity)?;
        let (pitch, roll) = (level.pitch, level.roll);
        let (heading, sigma) = match outside {
            Some(outside) => {
                let heading = outside.heading(pitch, roll).ok_or(Error::OutOfRange)?;
                (heading, outside.sigma())
            }
            None => (0.0, UNKNOWN_HEADING),
        };
        let [east, north, _] = prior.attitude;
        // The mean rate is the gyro bias and the earth rate. As a measurement, and not as a better prior: what the heading is
        // wrong by is in the bias then, and the two cancel in all that follows.
        let noise = libm::sqrtf(settings.noise.attitude / self.time());
        Ok(Ready {
            euler: Euler {
                heading,
                pitch,
                roll,
            },
            attitude: [east.max(level.sigma), north.max(level.sigma), sigma],
            still: ZeroRotation::new(level.rate, noise.max(MIN_RATE_SIGMA), 0.0)?,
            level,
        })
    }
}

/// What a filter starts with after a window.
pub(super) struct Ready {
    pub level: Level,
    pub euler: Euler,
    /// σ of the attitude.
    pub attitude: [f32; 3],
    /// What it is to learn first.
    pub still: ZeroRotation,
}

/// Teaches a filter that has just started the mean rate of the window.
#[inline(never)]
pub(super) fn learn(
    filter: &mut Filter,
    still: &ZeroRotation,
    report: &mut UpdateReport<3>,
) -> Result<(), Error> {
    filter.update_into(&still.linearize(filter.nav()), report)
}
