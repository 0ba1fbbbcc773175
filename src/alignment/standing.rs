//! Alignment at a standstill, from the first sample to the last: a coarse window, then the filter with a zero-velocity
//! update at every interval, except while the vehicle turns to another position.

use super::coarse::{CoarseAlignment, CoarseSolution};
use crate::earth::Geodetic;
use crate::error::Error;
use crate::filter::{Filter, Prior, Settings, UpdateReport};
use crate::imu::ImuIncrement;
use crate::measurement::ZeroVelocity;
use crate::nav::NavState;
use nalgebra::Vector3;

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
            stage,
            turned: Vector3::zeros(),
            waited: 0.0,
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
            stage: Stage::Fine(filter),
            turned: Vector3::zeros(),
            waited: 0.0,
        })
    }

    /// The filter, once it runs.
    pub fn filter(&self) -> Option<&Filter> {
        match &self.stage {
            Stage::Coarse(_) => None,
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

    /// Solves the coarse window and starts the filter, or begins a new window.
    fn close_window(&mut self) -> Result<Progress, Error> {
        let Stage::Coarse(coarse) = &self.stage else {
            return Ok(Progress::Between);
        };
        let started = coarse.solve().and_then(|solution| {
            let mut prior = self.prior;
            let scatter = [
                solution.sigma_level,
                solution.sigma_level,
                solution.sigma_heading,
            ];
            for (sigma, scatter) in prior.attitude.iter_mut().zip(scatter) {
                *sigma = sigma.max(scatter);
            }
            let nav = NavState::new(self.position, Vector3::zeros(), solution.euler())?;
            Ok((solution, Filter::new(nav, &prior, self.settings)?))
        });
        match started {
            Ok((solution, filter)) => {
                self.stage = Stage::Fine(filter);
                Ok(Progress::Started(solution))
            }
            Err(error) => {
                self.stage =
                    Stage::Coarse(CoarseAlignment::new(&self.position, self.settings.limits)?);
                Err(error)
            }
        }
    }
}
