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
use super::levelling::{learn, Level, Levelling};
use super::window::Window;
use crate::attitude::Euler;
use crate::earth::{Geodetic, Local};
use crate::error::Error;
use crate::filter::{Filter, Prior, Settings, Start, UpdateReport};
use crate::imu::{ImuIncrement, ImuLimits};
use crate::measurement::{ZeroRotation, ZeroVelocity};
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
        let place = check(&position, &plan, &prior, &settings)?;
        let [x, y, z] = prior.gyro_bias;
        let sigma = earth_rate_sigma(
            position.lat as f32,
            x.max(y).max(z),
            libm::sqrtf(settings.noise.attitude),
            plan.coarse_duration,
        );
        let given = Given {
            source: choose(sigma, outside.as_ref()),
            earth_rate_sigma: sigma,
            outside,
        };
        let stage = match given.source {
            HeadingSource::EarthRate => Stage::coarse(place, settings.limits),
            _ => Stage::Level(Levelling::new(settings.limits)),
        };
        Ok(Self::at(position, plan, prior, settings, given, stage))
    }

    /// Starts with an attitude from elsewhere: no coarse window, the filter runs at once.
    ///
    /// Errors: as [`StandingAlignment::new`].
    pub fn from_filter(filter: Filter, plan: Plan, prior: Prior) -> Result<Self, Error> {
        let (position, settings) = (filter.nav().position(), *filter.settings());
        check(&position, &plan, &prior, &settings)?;
        let given = Given {
            source: HeadingSource::Outside,
            earth_rate_sigma: 0.0,
            outside: None,
        };
        let stage = Stage::Fine(filter);
        Ok(Self::at(position, plan, prior, settings, given, stage))
    }
}

/// What is known of the heading before the first sample.
struct Given {
    source: HeadingSource,
    earth_rate_sigma: f32,
    outside: Option<OutsideHeading>,
}

/// Refuses what cannot be; latitude and gravity of the place.
#[inline(never)]
fn check(
    position: &Geodetic,
    plan: &Plan,
    prior: &Prior,
    settings: &Settings,
) -> Result<(f32, f32), Error> {
    plan.check()?;
    Start::new().fill(prior, settings)?;
    CoarseAlignment::place(position)
}

impl Stage {
    /// An inertial-frame window at a place that can be.
    #[inline(always)]
    fn coarse((lat, gravity): (f32, f32), limits: ImuLimits) -> Self {
        Stage::Coarse(CoarseAlignment::at(lat, gravity, limits))
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
        let place = check(&position, &plan, &prior, &settings)?;
        let given = Given {
            source: HeadingSource::EarthRate,
            earth_rate_sigma: 0.0,
            outside: None,
        };
        let stage = Stage::coarse(place, settings.limits);
        Ok(Self::at(position, plan, prior, settings, given, stage))
    }

    /// Spelled out, and no reference to the whole of it taken: so that it is written where it is wanted, and not somewhere
    /// else and moved.
    #[inline(always)]
    fn at(
        position: Geodetic,
        plan: Plan,
        prior: Prior,
        settings: Settings,
        given: Given,
        stage: Stage,
    ) -> Self {
        Self {
            position,
            plan,
            prior,
            settings,
            outside: given.outside,
            source: given.source,
            earth_rate_sigma: given.earth_rate_sigma,
            level: None,
            stage,
            turned: Vector3::new(0.0, 0.0, 0.0),
            waited: 0.0,
            window: Window::new(plan.zero_velocity.interval()),
            behind: None,
            shaken: 0.0,
            of_window: 0,
        }
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
    #[inline]
    pub fn take(&mut self, imu: &ImuIncrement) -> Result<Progress, Error> {
        let mut progress = Progress::Between;
        self.take_into(imu, &mut progress)?;
        Ok(progress)
    }

    /// As [`StandingAlignment::take`], with what the sample led to written where the caller has room for it: a report and
    /// its stack less. After an error it may say anything.
    ///
    /// Errors: those of [`StandingAlignment::take`].
    pub fn take_into(&mut self, imu: &ImuIncrement, progress: &mut Progress) -> Result<(), Error> {
        let time = match &mut self.stage {
            Stage::Coarse(coarse) => {
                coarse.take(imu)?;
                self.window.add(imu);
                coarse.time()
            }
            Stage::Level(level) => {
                level.take(imu)?;
                level.time()
            }
            Stage::Fine(filter) if K == 0 || self.behind.is_none() => {
                filter.propagate(imu)?;
                return self.stand(imu, imu.dt, progress);
            }
            Stage::Fine(_) => {
                imu.check(&self.settings.limits)?;
                self.window.add(imu);
                return self.catch_up(4.0 * imu.dt, progress);
            }
        };
        if time < self.plan.coarse_duration {
            *progress = Progress::Coarse;
            return Ok(());
        }
        self.close_window(progress)
    }

    /// Whether the filter is still in the past, with the samples of the coarse window before it.
    pub fn is_behind(&self) -> bool {
        self.behind.is_some()
    }

    /// The filter has moved by this: an update where one is due. `sample`: length of a step [s].
    #[inline(never)]
    fn stand(
        &mut self,
        moved: &ImuIncrement,
        sample: f32,
        progress: &mut Progress,
    ) -> Result<(), Error> {
        *progress = Progress::Between;
        let Stage::Fine(filter) = &mut self.stage else {
            return Ok(());
        };
        self.turned += moved.delta_theta_b;
        self.waited += moved.dt;
        // Half a sample early rather than half a sample late, whatever the rounding of the sum.
        if self.waited + 0.5 * sample < self.plan.zero_velocity.interval() {
            return Ok(());
        }
        let turning = self.turned.norm() > self.plan.turning * self.waited;
        self.turned = Vector3::new(0.0, 0.0, 0.0);
        self.waited = 0.0;
        if turning {
            *progress = Progress::Turning;
            return Ok(());
        }
        let mut measurement = self.plan.zero_velocity.linearize(filter.nav());
        if self.of_window > 0 {
            for r in &mut measurement.r.data.0[0] {
                *r = r.max(self.shaken);
            }
        }
        *progress = Progress::Updated(UpdateReport::empty());
        match progress {
            Progress::Updated(report) => filter.update_into(&measurement, report),
            _ => Ok(()),
        }
    }

    /// Takes the filter through the window for this time [s], and at least one step; no further than to the next update.
    #[inline(never)]
    fn catch_up(&mut self, time: f32, progress: &mut Progress) -> Result<(), Error> {
        *progress = Progress::Between;
        let mut done = 0.0;
        while done < time {
            let (Some(part), Stage::Fine(filter)) = (&mut self.behind, &mut self.stage) else {
                break;
            };
            filter.propagate(&part.step)?;
            done += part.step.dt;
            part.left = part.left.saturating_sub(1);
            if part.left > 0 {
                continue;
            }
            // The sums were closed within half a sample of the interval.
            let (whole, sample) = (part.whole, part.step.dt);
            self.next_part();
            let stood = self.stand(&whole, sample, progress);
            self.of_window = self.of_window.saturating_sub(1);
            stood?;
            if !matches!(progress, Progress::Between) {
                break;
            }
        }
        Ok(())
    }

    /// Goes on to the next sum of the window, or what is open.
    #[inline(never)]
    fn next_part(&mut self) {
        let Some(whole) = self.window.pop().or_else(|| self.window.pop_open()) else {
            self.behind = None;
            return;
        };
        let step = self.settings.propagation_interval.clamp(0.01, 0.1);
        let steps = libm::ceilf(whole.dt / step.min(self.settings.limits.dt_max) - 0.01).max(1.0);
        let share = 1.0 / steps;
        let step = ImuIncrement {
            delta_theta_b: whole.delta_theta_b * share,
            delta_v_b: whole.delta_v_b * share,
            dt: whole.dt * share,
        };
        self.behind = Some(Part {
            whole,
            step,
            left: steps as u16,
        });
    }

    /// Solves the window and starts the filter, or begins a new window.
    #[inline(never)] // so that a sample has none of its stack
    fn close_window(&mut self, progress: &mut Progress) -> Result<(), Error> {
        let started = match &self.stage {
            Stage::Coarse(_) => self.gyrocompass(progress),
            Stage::Level(_) if self.source == HeadingSource::Nobody => {
                return self.level_again(progress);
            }
            Stage::Level(_) => self.begin_levelled(progress),
            Stage::Fine(_) => return Ok(()),
        };
        if let Err(error) = started {
            self.anew()?;
            self.window.clear(self.plan.zero_velocity.interval());
            return Err(error);
        }
        if let Progress::Started(solution) = progress {
            self.shaken = solution.motion * solution.motion;
        }
        if K > 0 {
            // the open one is the last
            self.of_window = self.window.len() + 1;
            self.next_part();
        }
        Ok(())
    }

    /// Nobody knows the heading: keeps the level, and another window begins.
    #[inline(never)]
    fn level_again(&mut self, progress: &mut Progress) -> Result<(), Error> {
        let Stage::Level(window) = &self.stage else {
            return Ok(());
        };
        let local = Local::at(self.position.lat as f32, self.position.height as f32);
        let level = window.solve(local.gravity);
        self.anew()?;
        self.level = Some(level?);
        *progress = Progress::Coarse;
        Ok(())
    }

    /// Begins another window, of the kind that is needed.
    #[inline(never)]
    fn anew(&mut self) -> Result<(), Error> {
        let limits = self.settings.limits;
        match self.source {
            HeadingSource::EarthRate => {
                let place = CoarseAlignment::place(&self.position)?;
                self.stage = Stage::coarse(place, limits);
            }
            HeadingSource::Outside | HeadingSource::Nobody => {
                self.stage = Stage::Level(Levelling::new(limits));
            }
        }
        Ok(())
    }

    /// Starts the filter after an inertial-frame window.
    #[inline(never)]
    fn gyrocompass(&mut self, progress: &mut Progress) -> Result<(), Error> {
        let (euler, attitude, source) = self.compass(progress)?;
        self.run(euler, attitude)?;
        self.source = source;
        Ok(())
    }

    /// The filter takes the place of the window. `attitude`: its σ.
    #[inline(never)]
    fn run(&mut self, euler: Euler, attitude: [f32; 3]) -> Result<(), Error> {
        match &NavState::new(self.position, Vector3::zeros(), euler) {
            Ok(nav) => self.run_from(nav, attitude),
            Err(error) => Err(*error),
        }
    }

    #[inline(never)] // the pose is formed without what is known of it on the stack
    fn run_from(&mut self, nav: &NavState, attitude: [f32; 3]) -> Result<(), Error> {
        let mut start = Start::new();
        self.known(attitude, &mut start)?;
        begin(&mut self.stage, nav, &start, &self.settings);
        Ok(())
    }

    /// What is known at the start, with this σ of the attitude.
    #[inline(never)]
    fn known(&self, attitude: [f32; 3], start: &mut Start) -> Result<(), Error> {
        let prior = Prior {
            attitude,
            ..self.prior
        };
        start.fill(&prior, &self.settings)
    }

    /// What the inertial-frame window says: the attitude that the filter starts with, its σ, and whose heading it is.
    #[inline(never)]
    fn compass(&self, progress: &mut Progress) -> Result<(Euler, [f32; 3], HeadingSource), Error> {
        let Stage::Coarse(window) = &self.stage else {
            return Err(Error::OutOfRange);
        };
        let mut solution = window.solve()?;
        let mut attitude = self.prior.attitude;
        let mut source = self.source;
        let mut euler = solution.euler();
        if let Some(outside) = &self.outside {
            if outside.sigma() < solution.sigma_heading {
                let angle = outside.heading(euler.pitch, euler.roll);
                euler.heading = angle.ok_or(Error::OutOfRange)?;
                solution.c_b_n = euler.c_b_n();
                solution.sigma_heading = outside.sigma();
                attitude[2] = outside.sigma();
                source = HeadingSource::Outside;
            }
        }
        let wider = if K > 0 { WIDER } else { 1.0 };
        let level = wider * solution.sigma_level;
        let heading = match source {
            HeadingSource::Outside => solution.sigma_heading,
            _ => (wider * solution.sigma_heading).min(UNKNOWN_HEADING),
        };
        for (sigma, least) in attitude.iter_mut().zip([level, level, heading]) {
            *sigma = sigma.max(least);
        }
        if K > 0 {
            euler = Euler::from_c_b_n(&window.at_start(&solution.c_b_n));
        }
        *progress = Progress::Started(solution);
        Ok((euler, attitude, source))
    }

    /// Starts the filter after a window of plain means.
    #[inline(never)]
    fn begin_levelled(&mut self, progress: &mut Progress) -> Result<(), Error> {
        let started = self.start_levelled();
        let (sigma, force, still) = match &started {
            Ok(ready) => ready, // where it is: a copy would lie below the update
            Err(error) => return Err(*error),
        };
        let Stage::Fine(filter) = &mut self.stage else {
            return Err(Error::OutOfRange); // never: it has just been started
        };
        // the room of a report that nobody sees
        *progress = Progress::Updated(UpdateReport::empty());
        if let Progress::Updated(report) = progress {
            learn(filter, still, report)?;
        }
        self.started_levelled(*sigma, *force, progress)
    }

    /// What the filter started with: σ of pitch and roll, and the mean specific force.
    #[inline(never)]
    fn started_levelled(
        &self,
        sigma: f32,
        force: f32,
        progress: &mut Progress,
    ) -> Result<(), Error> {
        let (Stage::Fine(filter), Some(outside)) = (&self.stage, &self.outside) else {
            return Err(Error::OutOfRange); // never: it has just been started
        };
        let local = Local::at(self.position.lat as f32, self.position.height as f32);
        *progress = Progress::Started(CoarseSolution {
            c_b_n: filter.nav().c_b_n(),
            sigma_heading: outside.sigma(),
            sigma_level: sigma,
            motion: 0.0,
            gravity_ratio: force / local.gravity,
            earth_rate_ratio: 0.0,
        });
        Ok(())
    }

    /// The filter takes the place of the window, whose σ of the level and mean specific force are returned, and the mean
    /// rate that is still to be learnt.
    #[inline(never)]
    fn start_levelled(&mut self) -> Result<(f32, f32, ZeroRotation), Error> {
        let (Stage::Level(window), Some(outside)) = (&self.stage, &self.outside) else {
            return Err(Error::OutOfRange);
        };
        match &window.ready(self.position, Some(outside), &self.prior, &self.settings) {
            Ok(ready) => {
                self.run(ready.euler, ready.attitude)?;
                Ok((ready.level.sigma, ready.level.force, ready.still))
            }
            Err(error) => Err(*error),
        }
    }
}

/// The filter takes the place of the window.
#[inline(never)]
fn begin(stage: &mut Stage, nav: &NavState, start: &Start, settings: &Settings) {
    *stage = Stage::Fine(Filter::blank(nav, start, settings));
    if let Stage::Fine(filter) = stage {
        filter.begin();
    }
}
