//! Supervisor: is alignment finished, and if not, why not and how long will it take?
//!
//! Aligned means: every required σ is reached **and** ξ2 of those states has come to rest (rises by less than a fifth per
//! minute), none of them inconsistent. Required σ alone would call a filter done in the middle of a steep fall, where σ is
//! least to be trusted; rest alone would call it done at any σ. What was reached is latched until [`Supervisor::reset`].
//!
//! It knows nothing of sensor grades and axes: a navigation-grade sensor ends here with its heading, and a MEMS sensor
//! that cannot feel the earth turn is told that nothing teaches it the heading, by the same rules
//! (`host-tests/tests/supervisor.rs`).
//!
//! # Time to go
//!
//! Variances that are averaged down follow p ~ t⁻ⁿ with n = −ρ t (1 for a constant, up to 5 for a heading behind a gyro
//! bias), so the requirement is met at t (p/p_required)^(1/n). t counts from the start of the filter or the last
//! [`Supervisor::manoeuvred`]. Towards a ceiling this is too short; the verdict says so when it gets there.

use core::fmt;

use crate::error::Error;
use crate::error_model::N;
use crate::filter::UpdateReport;
use crate::observability::verdict::{Limits, Reason, Verdict, Verdicts};

/// ξ2 of a required state is at rest when its variance changes more slowly than this [1/s]: a fifth per minute.
pub const REST: f32 = 1.0 / 300.0;

/// Why alignment is not finished, or that it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Status {
    /// Required σ reached, ξ at rest.
    Aligned,
    /// It was aligned before, and is no longer so: this state went back.
    Lost {
        /// State, from 0.
        state: u8,
    },
    /// The filter has not run for a block of updates yet.
    Starting,
    /// Time helps: this state has furthest to go.
    Learning {
        /// State, from 0.
        state: u8,
    },
    /// The required σ is reached and ξ still rises: a moment.
    Settling {
        /// State, from 0.
        state: u8,
    },
    /// Time does not help: no measurement teaches this state.
    Unseen {
        /// State, from 0.
        state: u8,
    },
    /// Time hardly helps: too little is measured of this state.
    Weak {
        /// State, from 0.
        state: u8,
    },
    /// Time does not help: this state has got as far as it can this way.
    Limited {
        /// State, from 0.
        state: u8,
    },
    /// Measurements and filter contradict each other in this state.
    Inconsistent {
        /// State, from 0.
        state: u8,
    },
}

impl Status {
    /// The state it is about.
    pub const fn state(self) -> Option<usize> {
        match self {
            Status::Aligned | Status::Starting => None,
            Status::Lost { state }
            | Status::Learning { state }
            | Status::Settling { state }
            | Status::Unseen { state }
            | Status::Weak { state }
            | Status::Limited { state }
            | Status::Inconsistent { state } => Some(state as usize),
        }
    }

    /// How much it stands in the way: the worst is what is reported.
    const fn weight(self) -> u8 {
        match self {
            Status::Aligned => 0,
            Status::Settling { .. } => 1,
            Status::Learning { .. } => 2,
            Status::Starting => 3,
            Status::Weak { .. } => 4,
            Status::Limited { .. } => 5,
            Status::Unseen { .. } => 6,
            Status::Lost { .. } => 7,
            Status::Inconsistent { .. } => 8,
        }
    }
}

/// What was reached when alignment was finished.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Alignment {
    /// Filter time [s].
    pub time: f64,
    /// Standard deviations then, SI.
    pub sigma: [f32; N],
}

/// Watches an alignment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Supervisor {
    verdicts: Verdicts,
    sigma0: [f32; N],
    /// Required variance, σ0 units; infinite where nothing is required.
    wanted: [f32; N],
    /// Excess of each state's variance at the start, for the progress.
    first: [f32; N],
    began: Option<f64>,
    since: f64,
    time: f64,
    status: Status,
    latched: Option<Alignment>,
}

impl Supervisor {
    /// * `sigma0`: units of the filter's states ([`crate::filter::Filter::sigma0`])
    /// * `required`: σ that the user wants of each state, SI; None: no requirement
    ///
    /// # Errors
    /// Those of [`Verdicts::new`]; [`Error::Size`] where nothing is required: such an alignment has no end.
    pub fn new(
        sigma0: &[f32; N],
        required: &[Option<f32>; N],
        limits: Limits,
    ) -> Result<Self, Error> {
        let verdicts = Verdicts::new(sigma0, required, limits)?;
        if required.iter().all(|sigma| sigma.is_none()) {
            return Err(Error::Size);
        }
        let mut wanted = [f32::INFINITY; N];
        for ((wanted, sigma), sigma0) in wanted.iter_mut().zip(required).zip(sigma0) {
            if let Some(sigma) = sigma {
                let ratio = *sigma / *sigma0;
                *wanted = ratio * ratio;
            }
        }
        Ok(Self {
            verdicts,
            sigma0: *sigma0,
            wanted,
            first: [1.0; N],
            began: None,
            since: 0.0,
            time: 0.0,
            status: Status::Starting,
            latched: None,
        })
    }

    /// Looks at one update, at the filter's time [s], and says how things stand.
    pub fn take<const M: usize>(&mut self, time: f64, report: &UpdateReport<M>) -> Status {
        self.time = time;
        if self.began.is_none() {
            self.began = Some(time);
            self.since = time;
            for ((first, p), required) in self
                .first
                .iter_mut()
                .zip(&report.p_before)
                .zip(&self.wanted)
            {
                *first = *p / *required;
            }
        }
        self.verdicts.take(time, report);
        let mut worst = Status::Aligned;
        let mut furthest = 0.0;
        for (i, wanted) in self.wanted.iter().enumerate() {
            if !wanted.is_finite() {
                continue;
            }
            let status = self.of(i);
            let excess = self.verdicts.excess(i).unwrap_or(0.0);
            if status.weight() > worst.weight()
                || status.weight() == worst.weight() && excess > furthest
            {
                (worst, furthest) = (status, excess);
            }
        }
        self.status = match (worst, self.latched) {
            (Status::Aligned, None) => {
                let mut sigma = [0.0; N];
                for ((sigma, p), sigma0) in sigma.iter_mut().zip(&report.p_after).zip(&self.sigma0)
                {
                    *sigma = libm::sqrtf(*p) * *sigma0;
                }
                self.latched = Some(Alignment { time, sigma });
                Status::Aligned
            }
            // Rest is not asked for a second time.
            (Status::Aligned | Status::Settling { .. } | Status::Starting, Some(_)) => {
                Status::Aligned
            }
            (Status::Inconsistent { .. }, _) | (_, None) => worst,
            (other, Some(_)) => Status::Lost {
                state: other.state().unwrap_or(0) as u8,
            },
        };
        self.status
    }

    /// How one required state stands.
    fn of(&self, i: usize) -> Status {
        let state = i as u8;
        let Some(judgement) = self.verdicts.of(i) else {
            return Status::Starting;
        };
        match judgement.verdict {
            Verdict::Inconsistent => Status::Inconsistent { state },
            _ if judgement.reason == Reason::NotYet => Status::Starting,
            _ if self.verdicts.reached(i) => {
                let rising = self.verdicts.trend(i).is_none_or(|trend| trend.net < -REST);
                match rising {
                    true => Status::Settling { state },
                    false => Status::Aligned,
                }
            }
            Verdict::Unseen => Status::Unseen { state },
            Verdict::Weak => Status::Weak { state },
            Verdict::Limited => Status::Limited { state },
            Verdict::Learning | Verdict::Settled => Status::Learning { state },
        }
    }

    /// How things stood after the last update.
    pub fn status(&self) -> Status {
        self.status
    }

    /// What was reached when it was aligned for the first time; stays until [`Supervisor::reset`].
    pub fn latched(&self) -> Option<&Alignment> {
        self.latched.as_ref()
    }

    /// Forgets what was latched.
    pub fn reset(&mut self) {
        self.latched = None;
    }

    /// The vehicle has changed its position: what is learnt from here on begins anew, for the time to go.
    pub fn manoeuvred(&mut self, time: f64) {
        self.since = time;
    }

    /// The verdicts that it rests on.
    pub fn verdicts(&self) -> &Verdicts {
        &self.verdicts
    }

    /// For ceilings, and times without measurements.
    pub fn verdicts_mut(&mut self) -> &mut Verdicts {
        &mut self.verdicts
    }

    /// How far it has got, 0 … 1: of each required variance the part of the way on a logarithmic scale, and of those the
    /// least.
    pub fn progress(&self) -> f32 {
        let mut least = 1.0f32;
        for (i, first) in self.first.iter().enumerate() {
            if let Some(excess) = self.verdicts.excess(i) {
                if excess > 1.0 && *first > 1.0 {
                    let left = libm::logf(excess) / libm::logf(*first);
                    least = least.min((1.0 - left).clamp(0.0, 1.0));
                } else if excess > 1.0 {
                    least = 0.0; // further away than at the start
                }
            }
        }
        least
    }

    /// Seconds until every required σ is reached, if things go on as they do; 0 once they are. None where that is never,
    /// or cannot be told: a state that is not being learnt.
    pub fn time_to_go(&self) -> Option<f32> {
        let age = (self.time - self.since) as f32;
        let mut longest = 0.0f32;
        for i in 0..N {
            let Some(excess) = self.verdicts.excess(i).filter(|excess| *excess > 1.0) else {
                continue;
            };
            let judgement = self.verdicts.of(i)?;
            let order = -self.verdicts.trend(i)?.net * age;
            if judgement.verdict != Verdict::Learning || order <= 0.0 {
                return None;
            }
            let seconds = age * (libm::powf(excess, 1.0 / order) - 1.0);
            longest = longest.max(seconds);
        }
        longest.is_finite().then_some(longest)
    }

    /// The state of things as a sentence.
    pub fn sentence(&self) -> Sentence {
        let reason = self
            .status
            .state()
            .and_then(|state| self.verdicts.of(state))
            .map(|judgement| judgement.reason);
        Sentence {
            status: self.status,
            reason,
        }
    }
}

/// One plain sentence; written with `Display`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sentence {
    /// How things stand.
    pub status: Status,
    /// What the verdict about the state says.
    pub reason: Option<Reason>,
}

/// Names of the states.
pub const NAMES: [&str; N] = [
    "position east",
    "position north",
    "height",
    "velocity east",
    "velocity north",
    "velocity up",
    "tilt about east",
    "tilt about north",
    "heading",
    "gyro bias right",
    "gyro bias forward",
    "gyro bias up",
    "accelerometer bias right",
    "accelerometer bias forward",
    "accelerometer bias up",
];

impl fmt::Display for Sentence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = self.status.state().and_then(|state| NAMES.get(state));
        let name = state.copied().unwrap_or("it");
        let reason = self.reason.map_or("", Reason::sentence);
        match self.status {
            Status::Aligned => f.write_str("Aligned: every required σ is reached and holds."),
            Status::Starting => f.write_str("Not aligned: it has only just begun."),
            Status::Lost { .. } => write!(f, "No longer aligned, {name}: {reason}"),
            Status::Learning { .. } => write!(f, "Not aligned yet, {name}: {reason}"),
            Status::Settling { .. } => write!(
                f,
                "Not aligned yet, {name}: the required σ is reached and it still improves fast."
            ),
            Status::Unseen { .. } | Status::Weak { .. } | Status::Limited { .. } => {
                write!(f, "Not aligned, and time does not help, {name}: {reason}")
            }
            Status::Inconsistent { .. } => write!(f, "Do not trust it, {name}: {reason}"),
        }
    }
}
