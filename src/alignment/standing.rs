//! Alignment at a standstill, from the first sample to the last: a coarse window, then the filter with a zero-velocity
//! update at every interval, except while the vehicle turns to another position.
//!
//! # Using the coarse window again
//!
//! The coarse window has an attitude to give and the filter has more to learn from the same samples: the level is
//! known to the velocity noise of a minute, and the rate at which it turns is heading. [`StandingAlignment::reusing`]
//! keeps the window as K sums of one interval each (28 bytes a sum: 1.7 KiB for a minute of 1 s) and starts the filter at
//! the *first* sample of the window. It then lives through the window faster than time passes, in steps of
//! [`Settings::propagation_interval`], four times the length of a sample in each call and at least one step; after a third of
//! the window's length or less it has caught up. No call costs more than a propagation and an update, the first updates of an
//! alignment being the dear ones (double words, [`crate::covariance`]).
//!
//! What the samples say must not count twice. So the filter starts from the attitude of the window, which only says where
//! to linearise, and not with its σ: the standard deviations are those of the prior and at least [`WIDER`] times the scatter.
//! What is counted twice is then at most 1/[`WIDER`]² of what the window said, 4 % of a variance, and nothing once more is
//! learnt. And the window knows how much it was shaken ([`CoarseSolution::motion`]): where that is more than the plan
//! says, its updates say so. Checked by the normalised errors over seeds: `host-tests/tests/coarse_reuse.rs`.

use super::coarse::{CoarseAlignment, CoarseSolution, UNKNOWN_HEADING};
use super::heading_source::{choose, earth_rate_sigma, HeadingSource, OutsideHeading};
use super::levelling::{Level, Levelling};
use super::window::Window;
use crate::attitude::Euler;
use crate::earth::{Geodetic, Local};
use crate::error::Error;
use crate::filter::{Filter, Prior, Settings, UpdateReport};
use crate::imu::ImuIncrement;
use crate::measurement::ZeroVelocity;
use crate::nav::NavState;
use nalgebra::Vector3;

/// Where the samples of the coarse window are used again, the filter starts with at least so many times its scatter.
pub const WIDER: f32 = 5.0;

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

/// What a filter starts with.
struct Start {
    solution: CoarseSolution,
    euler: Euler,
    prior: Prior,
    source: HeadingSource,
}

/// The alignment of a standing vehicle; K sums of the coarse window are kept for the filter.
#[derive(Clone, Debug)]
pub struct StandingAlignment<const K: usize = 0> {
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
    /// What the filter has not seen yet.
    window: Window<K>,
    /// The sum at work, a step of it and how many are left; None: the filter has caught up.
    behind: Option<Part>,
    /// What the window was shaken by, squared, (m/s)², and how many sums of it are left.
    shaken: f32,
    of_window: usize,
}

/// A sum of the window, cut into equal steps.
#[derive(Clone, Copy, Debug)]
struct Part {
    whole: ImuIncrement,
    step: ImuIncrement,
    left: u16,
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
        Self::reusing(position, plan, prior, settings)
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
    /// unknown heading soon believes in a wrong one. [`Levelling::start`] has a filter that holds the heading meanwhile.
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

    /// Starts with an attitude from elsewhere: no coarse window, the filter runs at once.
    ///
    /// Errors: as [`StandingAlignment::new`].
    pub fn from_filter(filter: Filter, plan: Plan, prior: Prior) -> Result<Self, Error> {
        let (position, settings) = (filter.nav().position(), *filter.settings());
        let mut alignment = Self::new(position, plan, prior, settings)?;
        alignment.source = HeadingSource::Outside;
        alignment.stage = Stage::Fine(filter);
        Ok(alignment)
    }
}

impl<const K: usize> StandingAlignment<K> {
    /// As [`StandingAlignment::new`], and the filter uses the samples of the coarse window again, kept as K sums of one
    /// interval each; a longer window is kept in longer sums. `prior` is what is known *without* the window. The filter runs
    /// behind time at first ([`StandingAlignment::is_behind`]).
    ///
    /// Errors: as [`StandingAlignment::new`].
    pub fn reusing(
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
            window: Window::new(plan.zero_velocity.interval()),
            behind: None,
            shaken: 0.0,
            of_window: 0,
        })
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
                self.window.add(imu);
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
            Stage::Fine(_) if self.behind.is_some() => {
                imu.check(&self.settings.limits)?;
                self.window.add(imu);
                self.catch_up(4.0 * imu.dt)
            }
            Stage::Fine(filter) => {
                filter.propagate(imu)?;
                self.stand(imu, imu.dt)
            }
        }
    }

    /// Whether the filter is still in the past, with the samples of the coarse window before it.
    pub fn is_behind(&self) -> bool {
        self.behind.is_some()
    }

    /// The filter has moved by this: an update where one is due. `sample`: length of a step [s].
    fn stand(&mut self, moved: &ImuIncrement, sample: f32) -> Result<Progress, Error> {
        let Stage::Fine(filter) = &mut self.stage else {
            return Ok(Progress::Between);
        };
        self.turned += moved.delta_theta_b;
        self.waited += moved.dt;
        // Half a sample early rather than half a sample late, whatever the rounding of the sum.
        if self.waited + 0.5 * sample < self.plan.zero_velocity.interval() {
            return Ok(Progress::Between);
        }
        let turning = self.turned.norm() > self.plan.turning * self.waited;
        self.turned = Vector3::zeros();
        self.waited = 0.0;
        if turning {
            return Ok(Progress::Turning);
        }
        let mut measurement = self.plan.zero_velocity.linearize(filter.nav());
        if self.of_window > 0 {
            measurement.r.apply(|r| *r = r.max(self.shaken));
        }
        let mut progress = Progress::Updated(UpdateReport::empty());
        if let Progress::Updated(report) = &mut progress {
            filter.update_into(&measurement, report)?;
        }
        Ok(progress)
    }

    /// Takes the filter through the window for this time [s], and at least one step; no further than to the next update.
    fn catch_up(&mut self, time: f32) -> Result<Progress, Error> {
        let mut done = 0.0;
        while done < time {
            let Some(mut part) = self.behind else {
                return Ok(Progress::Between);
            };
            if let Stage::Fine(filter) = &mut self.stage {
                filter.propagate(&part.step)?;
            }
            done += part.step.dt;
            part.left = part.left.saturating_sub(1);
            if part.left > 0 {
                self.behind = Some(part);
                continue;
            }
            // The sums were closed within half a sample of the interval.
            self.behind = self.next_part();
            let progress = self.stand(&part.whole, part.step.dt);
            self.of_window = self.of_window.saturating_sub(1);
            let progress = progress?;
            if progress != Progress::Between {
                return Ok(progress);
            }
        }
        Ok(Progress::Between)
    }

    /// The next sum of the window, or what is open.
    fn next_part(&mut self) -> Option<Part> {
        let whole = self.window.pop().or_else(|| self.window.pop_open())?;
        let step = self.settings.propagation_interval.clamp(0.01, 0.1);
        let steps = libm::ceilf(whole.dt / step.min(self.settings.limits.dt_max) - 0.01).max(1.0);
        let share = 1.0 / steps;
        let step = ImuIncrement {
            delta_theta_b: whole.delta_theta_b * share,
            delta_v_b: whole.delta_v_b * share,
            dt: whole.dt * share,
        };
        Some(Part {
            whole,
            step,
            left: steps as u16,
        })
    }

    /// Solves the window and starts the filter, or begins a new window.
    #[inline(never)] // so that a sample has none of its stack
    fn close_window(&mut self) -> Result<Progress, Error> {
        let started = match &self.stage {
            Stage::Level(level) if self.source == HeadingSource::Nobody => {
                let local = Local::at(self.position.lat as f32, self.position.height as f32);
                let level = level.solve(local.gravity);
                self.anew()?;
                self.level = Some(level?);
                return Ok(Progress::Coarse);
            }
            Stage::Coarse(coarse) => coarse
                .solve()
                .and_then(|found| self.gyrocompass(coarse, found))
                .and_then(|start| self.begin(start)),
            Stage::Level(_) => self.begin_levelled(),
            Stage::Fine(_) => return Ok(Progress::Between),
        };
        match started {
            Ok(solution) => {
                self.shaken = solution.motion * solution.motion;
                // the open one is the last
                self.of_window = if K > 0 { self.window.len() + 1 } else { 0 };
                self.behind = self.next_part();
                Ok(Progress::Started(solution))
            }
            Err(error) => {
                self.anew()?;
                self.window = Window::new(self.plan.zero_velocity.interval());
                Err(error)
            }
        }
    }

    /// Begins another window.
    #[inline(never)]
    fn anew(&mut self) -> Result<(), Error> {
        self.stage = self.window()?;
        Ok(())
    }

    /// Starts the filter after an inertial-frame window.
    #[inline(never)]
    fn begin(&mut self, start: Start) -> Result<CoarseSolution, Error> {
        let nav = NavState::new(self.position, Vector3::zeros(), start.euler)?;
        self.stage = Stage::Fine(Filter::new(nav, &start.prior, self.settings)?);
        self.source = start.source;
        Ok(start.solution)
    }

    /// How the filter starts after an inertial-frame window.
    #[inline(never)]
    fn gyrocompass(
        &self,
        window: &CoarseAlignment,
        mut solution: CoarseSolution,
    ) -> Result<Start, Error> {
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
        let wider = if K > 0 { WIDER } else { 1.0 };
        let level = wider * solution.sigma_level;
        let heading = match source {
            HeadingSource::Outside => solution.sigma_heading,
            _ => (wider * solution.sigma_heading).min(UNKNOWN_HEADING),
        };
        for (sigma, least) in prior.attitude.iter_mut().zip([level, level, heading]) {
            *sigma = sigma.max(least);
        }
        if K > 0 {
            euler = Euler::from_c_b_n(&window.at_start(&solution.c_b_n));
        }
        Ok(Start {
            solution,
            euler,
            prior,
            source,
        })
    }

    /// Starts the filter after a window of plain means.
    #[inline(never)]
    fn begin_levelled(&mut self) -> Result<CoarseSolution, Error> {
        let (Stage::Level(window), Some(outside)) = (&self.stage, &self.outside) else {
            return Err(Error::OutOfRange);
        };
        let (level, filter) =
            window.start(self.position, Some(outside), &self.prior, self.settings)?;
        let local = Local::at(self.position.lat as f32, self.position.height as f32);
        let solution = CoarseSolution {
            c_b_n: filter.nav().c_b_n(),
            sigma_heading: outside.sigma(),
            sigma_level: level.sigma,
            motion: 0.0,
            gravity_ratio: level.force / local.gravity,
            earth_rate_ratio: 0.0,
        };
        self.stage = Stage::Fine(filter);
        Ok(solution)
    }
}
