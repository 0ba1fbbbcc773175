//! Alignment at a standstill, from the first sample to the last: a coarse window, then the filter with a zero-velocity
//! update at every interval, except while the vehicle turns to another position.

use super::coarse::{CoarseAlignment, CoarseSolution};
use super::heading_source::{choose, earth_rate_sigma, HeadingSource, OutsideHeading};
use super::levelling::{Level, Levelling};
use crate::attitude::Euler;
use crate::earth::{Geodetic, Local};
use crate::error::Error;
use crate::filter::{Filter, Prior, Settings, UpdateReport};
use crate::imu::ImuIncrement;
use crate::measurement::{ZeroRotation, ZeroVelocity};
use crate::nav::NavState;
use nalgebra::Vector3;

/// No mean rate is taken for better than this, 0.01 °/h [rad/s]: settings without gyro noise are possible.
const MIN_RATE_SIGMA: f32 = 5e-8;

/// How a standing vehicle is aligned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Length of the coarse window [s], 9 to 3600.
    pub coarse_duration: f32,
    /// The zero-velocity update: residual motion and interval.
    pub zero_velocity: ZeroVelocity,
    /// Mean rotation over an interval above which the vehicle is turning, not standing, and no update is made
    /// \[rad/s\]; about 1 °/s tells a turn from people and wind.
    pub turning: f32,
}

impl Plan {
    fn check(&self) -> Result<(), Error> {
        if !(self.coarse_duration.is_finite() && self.turning.is_finite()) {
            return Err(Error::NonFinite);
        }
        let window = (9.0..=3600.0).contains(&self.coarse_duration);
        // An update needs an interval to wait for.
        if window && self.turning > 0.0 && self.zero_velocity.interval() > 0.0 {
            Ok(())
        } else {
            Err(Error::OutOfRange)
        }
    }
}

/// What a sample led to.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // there is no heap to put the report on, and it lives for a look
pub enum Progress {
    /// The coarse window is still open.
    Coarse,
    /// The coarse window has just closed and the filter runs from here.
    Started(CoarseSolution),
    /// Between two updates.
    Between,
    /// An update was due and left out: the vehicle was turning.
    Turning,
    /// A zero-velocity update was made.
    Updated(UpdateReport<3>),
}

/// The alignment of a standing vehicle.
#[derive(Clone, Debug)]
pub struct StandingAlignment {
    position: Geodetic,
    plan: Plan,
    prior: Prior,
    settings: Settings,
    outside: Option<OutsideHeading>,
    source: HeadingSource,
    /// σ of a heading from the earth rate by the criterion [rad].
    earth_rate_sigma: f32,
    /// The last level while nobody knows the heading.
    level: Option<Level>,
    stage: Stage,
    /// ∫ω_ib^b dt since the last update was due [rad].
    turned: Vector3<f32>,
    /// Seconds since then.
    waited: f32,
}

#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)] // there is no heap to put the larger one on
enum Stage {
    Coarse(CoarseAlignment),
    Level(Levelling),
    Fine(Filter),
}

impl StandingAlignment {
    /// Starts at a known position. `prior` says how well position, velocity, attitude (after the coarse window) and
    /// biases are known; where the scatter of the coarse window is larger than its attitude, the scatter is used.
    ///
    /// Errors: [`Error::NonFinite`], [`Error::OutOfRange`], [`Error::Polar`] for what cannot be.
    pub fn new(
        position: Geodetic,
        plan: Plan,
        prior: Prior,
        settings: Settings,
    ) -> Result<Self, Error> {
        plan.check()?;
        prior.sigma0()?;
        settings.check()?;
        let stage = Stage::Coarse(CoarseAlignment::new(&position, settings.limits)?);
        Ok(Self {
            position,
            plan,
            prior,
            settings,
            outside: None,
            source: HeadingSource::EarthRate,
            earth_rate_sigma: 0.0,
            level: None,
            stage,
            turned: Vector3::zeros(),
            waited: 0.0,
        })
    }

    /// As [`StandingAlignment::new`] for a sensor that may not feel the earth turn, and a heading from outside where there
    /// is one.
    ///
    /// The criterion of [`super::heading_source`] decides, from the gyro bias of the prior, the noise of the settings and
    /// the length of the window. With the earth rate the window is the inertial-frame one, and the outside heading is
    /// still taken where the scatter of the window turns out larger. Without it the window levels by plain means, the mean
    /// rate is used as a zero-rotation update, the heading is the one from outside, and [`Progress::Started`] has an
    /// earth rate ratio of 0. Where nobody knows the heading well enough, one window of levelling follows the other
    /// ([`StandingAlignment::level`]) until [`StandingAlignment::set_heading`] helps: a linear filter that starts with an
    /// unknown heading soon believes in a wrong one.
    ///
    /// Errors: as [`StandingAlignment::new`]; a direction that is upright when the window closes has no azimuth:
    /// [`Error::OutOfRange`] from [`StandingAlignment::take`].
    pub fn with_heading(
        position: Geodetic,
        plan: Plan,
        prior: Prior,
        settings: Settings,
        outside: Option<OutsideHeading>,
    ) -> Result<Self, Error> {
        let mut alignment = Self::new(position, plan, prior, settings)?;
        let [x, y, z] = prior.gyro_bias;
        alignment.earth_rate_sigma = earth_rate_sigma(
            position.lat as f32,
            x.max(y).max(z),
            libm::sqrtf(settings.noise.attitude),
            plan.coarse_duration,
        );
        alignment.source = choose(alignment.earth_rate_sigma, outside.as_ref());
        alignment.outside = outside;
        alignment.stage = alignment.window()?;
        Ok(alignment)
    }

    /// Where the heading comes from.
    pub fn heading_source(&self) -> HeadingSource {
        self.source
    }

    /// The last level, while nobody knows the heading.
    pub fn level(&self) -> Option<&Level> {
        self.level.as_ref()
    }

    /// A heading from outside that comes later; used when the window closes, no longer once the filter runs.
    pub fn set_heading(&mut self, outside: OutsideHeading) {
        self.outside = Some(outside);
        if matches!(self.stage, Stage::Level(_)) {
            // A window of plain means is open: without a better heading it goes on as it is.
            self.source = match choose(self.earth_rate_sigma, Some(&outside)) {
                HeadingSource::Outside => HeadingSource::Outside,
                _ => HeadingSource::Nobody,
            };
        }
    }

    /// An empty window of the kind that is needed.
    fn window(&self) -> Result<Stage, Error> {
        let limits = self.settings.limits;
        Ok(match self.source {
            HeadingSource::EarthRate => {
                Stage::Coarse(CoarseAlignment::new(&self.position, limits)?)
            }
            HeadingSource::Outside | HeadingSource::Nobody => Stage::Level(Levelling::new(limits)),
        })
    }

    /// Starts with an attitude from elsewhere: no coarse window, the filter runs at once.
    ///
    /// Errors: as [`StandingAlignment::new`].
    pub fn from_filter(filter: Filter, plan: Plan, prior: Prior) -> Result<Self, Error> {
        plan.check()?;
        let (position, settings) = (filter.nav().position(), *filter.settings());
        Ok(Self {
            position,
            plan,
            prior,
            settings,
            outside: None,
            source: HeadingSource::Outside,
            earth_rate_sigma: 0.0,
            level: None,
            stage: Stage::Fine(filter),
            turned: Vector3::zeros(),
            waited: 0.0,
        })
    }

    /// The filter, once it runs.
    pub fn filter(&self) -> Option<&Filter> {
        match &self.stage {
            Stage::Coarse(_) | Stage::Level(_) => None,
            Stage::Fine(filter) => Some(filter),
        }
    }

    /// Takes one sample.
    ///
    /// Errors: those of [`Filter::propagate`] and [`Filter::update`]; a sample that is refused at the door has changed
    /// nothing. [`Error::OutOfRange`] at the end of the coarse window: what it saw was not a standing vehicle; the
    /// window then begins anew.
    pub fn take(&mut self, imu: &ImuIncrement) -> Result<Progress, Error> {
        match &mut self.stage {
            Stage::Coarse(coarse) => {
                coarse.take(imu)?;
                if coarse.time() < self.plan.coarse_duration {
                    return Ok(Progress::Coarse);
                }
                self.close_window()
            }
            Stage::Level(level) => {
                level.take(imu)?;
                if level.time() < self.plan.coarse_duration {
                    return Ok(Progress::Coarse);
                }
                self.close_window()
            }
            Stage::Fine(filter) => {
                filter.propagate(imu)?;
                self.turned += imu.delta_theta_b;
                self.waited += imu.dt;
                // Half a sample early rather than half a sample late, whatever the rounding of the sum.
                if self.waited + 0.5 * imu.dt < self.plan.zero_velocity.interval() {
                    return Ok(Progress::Between);
                }
                let turning = self.turned.norm() > self.plan.turning * self.waited;
                self.turned = Vector3::zeros();
                self.waited = 0.0;
                if turning {
                    return Ok(Progress::Turning);
                }
                let measurement = self.plan.zero_velocity.linearize(filter.nav());
                filter.update(&measurement).map(Progress::Updated)
            }
        }
    }

    /// Solves the window and starts the filter, or begins a new window.
    fn close_window(&mut self) -> Result<Progress, Error> {
        let started = match &self.stage {
            Stage::Level(level) if self.source == HeadingSource::Nobody => {
                let local = Local::at(self.position.lat as f32, self.position.height as f32);
                let level = level.solve(local.gravity);
                self.stage = self.window()?;
                self.level = Some(level?);
                return Ok(Progress::Coarse);
            }
            Stage::Coarse(coarse) => coarse.solve().and_then(|found| self.gyrocompass(found)),
            Stage::Level(level) => self.levelled(level).map(|(s, f)| (s, f, self.source)),
            Stage::Fine(_) => return Ok(Progress::Between),
        };
        match started {
            Ok((solution, filter, source)) => {
                self.source = source;
                self.stage = Stage::Fine(filter);
                Ok(Progress::Started(solution))
            }
            Err(error) => {
                self.stage = self.window()?;
                Err(error)
            }
        }
    }

    /// The filter of an inertial-frame window.
    fn gyrocompass(
        &self,
        mut solution: CoarseSolution,
    ) -> Result<(CoarseSolution, Filter, HeadingSource), Error> {
        let mut prior = self.prior;
        let mut source = self.source;
        let mut euler = solution.euler();
        if let Some(outside) = &self.outside {
            if outside.sigma() < solution.sigma_heading {
                let angle = outside.heading(euler.pitch, euler.roll);
                euler.heading = angle.ok_or(Error::OutOfRange)?;
                solution.c_b_n = euler.c_b_n();
                solution.sigma_heading = outside.sigma();
                prior.attitude[2] = outside.sigma();
                source = HeadingSource::Outside;
            }
        }
        let scatter = [
            solution.sigma_level,
            solution.sigma_level,
            solution.sigma_heading,
        ];
        for (sigma, scatter) in prior.attitude.iter_mut().zip(scatter) {
            *sigma = sigma.max(scatter);
        }
        let nav = NavState::new(self.position, Vector3::zeros(), euler)?;
        Ok((solution, Filter::new(nav, &prior, self.settings)?, source))
    }

    /// The filter of a window of plain means.
    fn levelled(&self, window: &Levelling) -> Result<(CoarseSolution, Filter), Error> {
        let local = Local::at(self.position.lat as f32, self.position.height as f32);
        let level = window.solve(local.gravity)?;
        let (pitch, roll) = (level.pitch, level.roll);
        let outside = self.outside.as_ref().ok_or(Error::OutOfRange)?;
        let heading = outside.heading(pitch, roll).ok_or(Error::OutOfRange)?;
        let sigma_heading = outside.sigma();
        let euler = Euler {
            heading,
            pitch,
            roll,
        };
        let c_b_n = euler.c_b_n();
        let mut prior = self.prior;
        let [east, north, _] = prior.attitude;
        prior.attitude = [east.max(level.sigma), north.max(level.sigma), sigma_heading];
        let nav = NavState::new(self.position, Vector3::zeros(), euler)?;
        let mut filter = Filter::new(nav, &prior, self.settings)?;
        // The mean rate is the gyro bias and the earth rate. As a measurement, and not as a better prior: what the heading is
        // wrong by is in the bias then, and the two cancel in all that follows.
        let noise = libm::sqrtf(self.settings.noise.attitude / window.time());
        let still = ZeroRotation::new(level.rate, noise.max(MIN_RATE_SIGMA), 0.0)?;
        filter.update(&still.linearize(filter.nav()))?;
        let solution = CoarseSolution {
            c_b_n,
            sigma_heading,
            sigma_level: level.sigma,
            gravity_ratio: level.force / local.gravity,
            earth_rate_ratio: 0.0,
        };
        Ok((solution, filter))
    }
}
