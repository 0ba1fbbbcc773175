//! Verdict: what can be said about each state right now, in one word and one sentence.
//!
//! | verdict | means | what helps |
//! |---|---|---|
//! | unseen | no better known than at the start, nothing comes in | another measurement or manoeuvre |
//! | weak | something is known of it, and too little comes in: slow, or σ grows again | a manoeuvre |
//! | learning | σ is falling | time |
//! | settled | the required σ is reached and holds (without requirement: σ has come to rest) | nothing |
//! | limited | σ has come to rest above the requirement, or at its ceiling | not time: a manoeuvre or a better sensor |
//! | inconsistent | the innovations contradict it, it moves without information, or it stands above its ceiling | look at sensors and settings |
//!
//! No axis is treated differently from any other: a verdict rests on what the updates report of that state, so that it
//! follows the vehicle. Heading is seen in an acceleration and not in a hover, and the verdict says so by itself.
//!
//! # What it looks at
//!
//! Time is cut into blocks of [`Limits::block`] seconds. Over a block, with p the variance of a state in σ0 units:
//!
//! ```text
//! λ = Σ (p⁻ − p⁺)/p⁻ / T          what measurements take                  (ξ1 ξ2, Lu 2009 (22), (23))
//! ρ = ln(p_end/p_begin) / T       what is left of that after noise and motion: below 0, σ falls
//! ξ2 = 1/p_end
//! ```
//!
//! and over about ten blocks, with forgetting, two tests of consistency, both relative to what a correct filter shows:
//!
//! ```text
//! ν̄ = Σ w ν²/s / Σ w              w = (p⁻ − p⁺)/p⁻: innovations of the measurements that teach this state; 1
//! μ = (Σ δx)² / Σ (p⁻ − p⁺)       corrections are white with just this variance; 1, χ² with one degree
//! ```
//!
//! μ finds what ν̄ cannot: an innovation that always points the same way and is small each time carries a state away
//! that the measurements say nothing about. It counts only where that is so: where the state moved by more than half its
//! σ, and the measurements of these blocks took less than its variance.
//!
//! A verdict changes when [`Limits::confirm`] blocks in a row ask for the same new one; it leaves `settled` at the first
//! (a false "done" costs more than a false "not yet"). Thresholds for leaving are easier to hold than those for entering.

mod evidence;
mod limits;

pub use evidence::Trend;
pub use limits::Limits;

use evidence::Evidence;

use crate::error::Error;
use crate::error_model::N;
use crate::filter::UpdateReport;

/// One word about a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Verdict {
    /// No better known than at the start, and nothing comes in.
    Unseen,
    /// Too little comes in.
    Weak,
    /// σ is falling.
    Learning,
    /// The required σ is reached and holds.
    Settled,
    /// More time is useless.
    Limited,
    /// Do not believe its σ.
    Inconsistent,
}

impl Verdict {
    /// `unseen`, `weak`, `learning`, `settled`, `limited`, `inconsistent`.
    pub const fn name(self) -> &'static str {
        match self {
            Verdict::Unseen => "unseen",
            Verdict::Weak => "weak",
            Verdict::Learning => "learning",
            Verdict::Settled => "settled",
            Verdict::Limited => "limited",
            Verdict::Inconsistent => "inconsistent",
        }
    }
}

/// Why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Reason {
    /// The first block of updates is not over.
    NotYet,
    /// Unseen: no measurement tells anything about it.
    NothingSeen,
    /// Unseen: known worse than at the start.
    Drifts,
    /// Weak: measurements give something, noise takes as much, and it stays as well known as at the start.
    NoiseWins,
    /// Weak: it is taught too slowly.
    Slow,
    /// Weak: it was known better, and too little comes in to hold that.
    Fading,
    /// Learning: σ is falling.
    Falling,
    /// Settled: the required σ is reached and holds.
    Required,
    /// Settled: the start was better than the requirement.
    PriorSuffices,
    /// Settled: σ has come to rest; there is no requirement.
    AtRest,
    /// Limited: at the ceiling of what this motion can teach.
    AtCeiling,
    /// Limited: noise gives back what the measurements take.
    Balance,
    /// Limited: nothing more comes in.
    Exhausted,
    /// Inconsistent: innovations larger than the filter believes possible.
    InnovationsLarge,
    /// Inconsistent: no innovation at all.
    InnovationsSilent,
    /// Inconsistent: it moves without information.
    MovesAlone,
    /// Inconsistent: above its ceiling.
    AboveCeiling,
}

impl Reason {
    /// The verdict that this reason stands for.
    pub const fn verdict(self) -> Verdict {
        match self {
            Reason::NotYet | Reason::NothingSeen | Reason::Drifts => Verdict::Unseen,
            Reason::NoiseWins | Reason::Slow | Reason::Fading => Verdict::Weak,
            Reason::Falling => Verdict::Learning,
            Reason::Required | Reason::PriorSuffices | Reason::AtRest => Verdict::Settled,
            Reason::AtCeiling | Reason::Balance | Reason::Exhausted => Verdict::Limited,
            Reason::InnovationsLarge
            | Reason::InnovationsSilent
            | Reason::MovesAlone
            | Reason::AboveCeiling => Verdict::Inconsistent,
        }
    }

    /// One plain sentence.
    pub const fn sentence(self) -> &'static str {
        match self {
            Reason::NotYet => "There have not been enough updates yet.",
            Reason::NothingSeen => {
                "No measurement tells anything about it: what is known is what was assumed at the start."
            }
            Reason::Drifts => "Nothing holds it: it is known worse than at the start.",
            Reason::NoiseWins => {
                "Noise takes what the measurements give: it stays as well known as at the start."
            }
            Reason::Slow => "The measurements teach it too slowly to wait for it: a manoeuvre is needed.",
            Reason::Fading => {
                "It was known better: too little is measured of it now to hold that, and its σ has grown."
            }
            Reason::Falling => "Its σ is falling: time helps.",
            Reason::Required => "The required σ is reached and holds.",
            Reason::PriorSuffices => "It was known well enough from the start.",
            Reason::AtRest => "Its σ has come to rest.",
            Reason::AtCeiling => {
                "All that this motion can teach has been learnt: more time is useless, another position or manoeuvre is needed."
            }
            Reason::Balance => {
                "Noise gives back what the measurements take: more time is useless with these sensors."
            }
            Reason::Exhausted => {
                "Its σ has come to rest above the requirement: more time in this motion is useless."
            }
            Reason::InnovationsLarge => {
                "The measurements that teach it are further off than the filter believes possible: look at their noise, lever arm and sensors."
            }
            Reason::InnovationsSilent => {
                "The measurements that teach it agree better than noise allows: a sensor may be frozen."
            }
            Reason::MovesAlone => {
                "It moves much further than the measurements can justify: something unmodelled drives it."
            }
            Reason::AboveCeiling => {
                "The filter claims more than this motion can teach: it learns from its own linearisation."
            }
        }
    }
}

/// What stands about one state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Judgement {
    /// The word.
    pub verdict: Verdict,
    /// Why.
    pub reason: Reason,
}

impl Judgement {
    const fn of(reason: Reason) -> Self {
        Self {
            verdict: reason.verdict(),
            reason,
        }
    }
}

/// One state.
#[derive(Clone, Copy, Debug, PartialEq)]
struct State {
    evidence: Evidence,
    /// Required variance, σ0 units; None: no requirement.
    required: Option<f32>,
    ceiling: Option<f32>,
    judgement: Judgement,
    /// A verdict asked for by the last blocks, and how many of them.
    asked: Verdict,
    blocks: u8,
}

/// Verdicts about the 15 states: an observer beside the filter, fed with its reports.
///
/// ```
/// use navsight::error_model::{ATT, N};
/// use navsight::observability::verdict::{Limits, Verdict, Verdicts};
/// # use navsight::error::Error;
/// # fn main() -> Result<(), Error> {
/// let sigma0 = [1.0; N]; // Filter::sigma0
/// let mut required = [None; N];
/// required[ATT + 2] = Some(2e-3); // heading [rad]
/// let mut verdicts = Verdicts::new(&sigma0, &required, Limits::default())?;
/// // After each update: let changed = verdicts.take(filter.time(), &report);
/// assert_eq!(verdicts.of(ATT + 2).map(|j| j.verdict), Some(Verdict::Unseen));
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdicts {
    limits: Limits,
    states: [State; N],
    /// When this block began; None before the first report.
    began: Option<f64>,
    normalised: u16,
}

impl Verdicts {
    /// * `sigma0`: units of the filter's states ([`crate::filter::Filter::sigma0`])
    /// * `required`: σ that the user wants of each state, SI; None: no requirement
    ///
    /// # Errors
    /// [`Error::NonFinite`], [`Error::OutOfRange`] for a σ0 or a requirement that is not positive, or limits that cannot
    /// be ([`Limits::check`]).
    pub fn new(
        sigma0: &[f32; N],
        required: &[Option<f32>; N],
        limits: Limits,
    ) -> Result<Self, Error> {
        limits.check()?;
        let blank = State {
            evidence: Evidence::new(),
            required: None,
            ceiling: None,
            judgement: Judgement::of(Reason::NotYet),
            asked: Verdict::Unseen,
            blocks: 0,
        };
        let mut states = [blank; N];
        for ((state, &sigma0), required) in states.iter_mut().zip(sigma0).zip(required) {
            state.required = match *required {
                None => None,
                Some(sigma) if !(sigma.is_finite() && sigma0.is_finite()) => {
                    return Err(Error::NonFinite)
                }
                Some(sigma) if sigma > 0.0 && sigma0 > 0.0 => {
                    let ratio = sigma / sigma0;
                    Some(ratio * ratio)
                }
                Some(_) => return Err(Error::OutOfRange),
            };
        }
        Ok(Self {
            limits,
            states,
            began: None,
            normalised: 0,
        })
    }

    /// Ceilings of ξ2 for what has been driven so far ([`super::ceiling`]); None: no ceiling, or not known. Those of one
    /// position end with a turn, and those of tilts and accelerometers with a tilt of the vehicle
    /// ([`super::ceiling::tilt_excess`]).
    pub fn set_ceilings(&mut self, ceilings: &[Option<f32>; N]) {
        for (state, ceiling) in self.states.iter_mut().zip(ceilings) {
            state.ceiling = ceiling.filter(|c| c.is_finite());
        }
    }

    /// Looks at one update, at the filter's time [s]. Updates of several sensors go in one after the other. Bit i of the
    /// answer is set when the verdict about state i has changed.
    pub fn take<const M: usize>(&mut self, time: f64, report: &UpdateReport<M>) -> u16 {
        self.normalised = report.normalised;
        let surprise = self.limits.surprise(&report.row_nis);
        let first = self.began.is_none();
        for ((((state, before), after), decrease), correction) in self
            .states
            .iter_mut()
            .zip(&report.p_before)
            .zip(&report.p_after)
            .zip(&report.decrease)
            .zip(&report.correction)
        {
            let evidence = &mut state.evidence;
            if first {
                evidence.begin(*before);
            }
            evidence.add(*before, *after, *decrease, *correction, surprise);
        }
        self.pass_time(time)
    }

    /// Says that time has passed without a measurement, as in an outage: variances as the filter has them now, in σ0
    /// units ([`crate::covariance::Covariance::diagonal`]). Where updates keep coming nobody has to call this.
    pub fn pass(&mut self, time: f64, p: &[f32; N]) -> u16 {
        let first = self.began.is_none();
        for (state, p) in self.states.iter_mut().zip(p) {
            if first {
                state.evidence.begin(*p);
            }
            state.evidence.p = *p;
        }
        self.pass_time(time)
    }

    fn pass_time(&mut self, time: f64) -> u16 {
        let Some(began) = self.began else {
            self.began = Some(time);
            return 0;
        };
        let length = (time - began) as f32;
        // A clock that went back begins a new block.
        if (0.0..self.limits.block).contains(&length) {
            return 0;
        }
        self.began = Some(time);
        let mut changed = 0;
        for (i, state) in self.states.iter_mut().enumerate() {
            if length > 0.0 && self.normalised >> i & 1 != 0 {
                state.evidence.close(length);
                if state.judge(&self.limits) {
                    changed |= 1 << i;
                }
            }
            state.evidence.reopen(self.limits.memory);
        }
        changed
    }

    /// What stands about state `i`; None beyond the last one. A state that was started without variance has nothing to
    /// learn and stays `unseen`, not yet.
    pub fn of(&self, i: usize) -> Option<Judgement> {
        self.states.get(i).map(|state| state.judgement)
    }

    /// What stands about every state.
    pub fn all(&self) -> [Judgement; N] {
        self.states.map(|state| state.judgement)
    }

    /// Rates of state `i` over the last block; None beyond the last state or before the first block is over.
    pub fn trend(&self, i: usize) -> Option<Trend> {
        self.states.get(i).and_then(|state| state.evidence.trend)
    }

    /// Whether the required σ of state `i` is reached; true where there is no requirement or no such state.
    pub fn reached(&self, i: usize) -> bool {
        self.states.get(i).is_none_or(|state| {
            let p = state.evidence.p;
            state.required.is_none_or(|required| p <= required)
        })
    }

    /// Variance of state `i` over the required one; None without requirement.
    pub fn excess(&self, i: usize) -> Option<f32> {
        let state = self.states.get(i)?;
        state.required.map(|required| state.evidence.p / required)
    }

    /// Limits that it was made with.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }
}

impl State {
    /// Judges the block just closed; true when the verdict has changed.
    fn judge(&mut self, limits: &Limits) -> bool {
        let (was, wanted) = (self.judgement, self.reason(limits));
        let verdict = wanted.verdict();
        if verdict == was.verdict && was.reason != Reason::NotYet {
            self.judgement.reason = wanted;
            self.blocks = 0;
            return false;
        }
        self.blocks = match self.asked == verdict {
            true => self.blocks.saturating_add(1),
            false => 1,
        };
        self.asked = verdict;
        let at_once = was.reason == Reason::NotYet
            || was.verdict == Verdict::Settled && verdict != Verdict::Limited;
        if !(at_once || self.blocks >= limits.confirm) {
            return false;
        }
        self.judgement = Judgement::of(wanted);
        self.blocks = 0;
        verdict != was.verdict
    }

    /// What the evidence asks for, with the thresholds of what stands.
    fn reason(&self, limits: &Limits) -> Reason {
        let (e, was) = (&self.evidence, self.judgement.verdict);
        let trend = e.trend.unwrap_or_default();
        let xi2 = 1.0 / e.p;
        // A threshold that has been passed is easier to hold.
        let ease = |holds: bool| if holds { 1.0 - limits.hysteresis } else { 1.0 };
        let known = matches!(
            was,
            Verdict::Settled | Verdict::Limited | Verdict::Inconsistent
        );

        if let Some(reason) = self.contradiction(limits, xi2) {
            return reason;
        }
        let learnt = xi2 >= limits.learnt * ease(known);
        let falling = trend.net < -limits.rest * ease(was == Verdict::Learning);
        let fading = trend.net > limits.rest.max(trend.learnt);
        let at_ceiling = self.ceiling.is_some_and(|ceiling| {
            let near = limits.near_ceiling * ease(was == Verdict::Limited);
            ceiling >= limits.seen && xi2 >= near * ceiling
        });
        let reached = self
            .required
            .map(|required| e.p * ease(was == Verdict::Settled) <= required);

        match reached {
            Some(true) if fading => Reason::Fading,
            Some(true) if learnt => Reason::Required,
            Some(true) => Reason::PriorSuffices,
            _ if at_ceiling && !fading => Reason::AtCeiling,
            _ if falling => Reason::Falling,
            _ if !learnt && xi2 < limits.seen => match trend {
                t if t.learnt >= limits.rest => Reason::NoiseWins,
                _ if xi2 < 1.0 - limits.hysteresis => Reason::Drifts,
                _ => Reason::NothingSeen,
            },
            _ if fading || e.p > limits.regress * e.best => Reason::Fading,
            _ if !learnt => Reason::Slow,
            None => Reason::AtRest,
            _ if trend.learnt >= limits.rest => Reason::Balance,
            _ => Reason::Exhausted,
        }
    }

    /// Whether something contradicts this state.
    fn contradiction(&self, limits: &Limits, xi2: f32) -> Option<Reason> {
        let e = &self.evidence;
        let stands = |reason| self.judgement.reason == reason;
        // Off again at three quarters of the threshold.
        let hold = |reason, limit: f32| if stands(reason) { 0.75 * limit } else { limit };
        let above = hold(Reason::AboveCeiling, limits.margin);
        if self
            .ceiling
            .is_some_and(|ceiling| xi2 > ceiling * (1.0 + above))
        {
            return Some(Reason::AboveCeiling);
        }
        if e.moved(limits.share) > hold(Reason::MovesAlone, limits.moves) {
            return Some(Reason::MovesAlone);
        }
        // What was never learnt from these measurements cannot be contradicted by them.
        if xi2 < limits.learnt {
            return None;
        }
        let (nis, updates) = e.innovations()?;
        // The mean of n scatters by √(2/n) where all is well; squared on both sides, to do without the root.
        let beyond = nis - 1.0;
        let scatter = beyond > 0.0 && beyond * beyond * updates > 2.0 * 25.0;
        if nis > hold(Reason::InnovationsLarge, limits.nis) && scatter {
            return Some(Reason::InnovationsLarge);
        }
        (nis < limits.silent && updates >= 10.0).then_some(Reason::InnovationsSilent)
    }
}
