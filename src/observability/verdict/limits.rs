//! Thresholds of the verdict, each with where it comes from.

use super::super::ceiling::MARGIN;
use crate::error::Error;

/// Where one verdict ends and the next begins.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits {
    /// Length of a block [s]. Default 10: longer than the interval of any aiding that aligns, shorter than a manoeuvre
    /// that changes what is seen. A block is closed by the first update after it.
    pub block: f32,
    /// Blocks in a row that must ask for a new verdict. Default 2: one block that is half manoeuvre decides nothing.
    pub confirm: u8,
    /// A relative change of the variance slower than this is rest [1/s]. Default 1/1200: white noise is averaged as
    /// p ~ 1/t, which changes by 1/t per second, so rest begins after 20 minutes of averaging, when another 20 minutes
    /// would take σ down by no more than √2. The same figure measures what comes in: below it, nothing does.
    pub rest: f32,
    /// From this ξ2 on a state rests on measurements rather than on what was assumed. Default 2: half the variance is
    /// gone, prior and measurements weigh the same ([`super::super::agreement::Limits::learnt`]).
    pub learnt: f32,
    /// Below this ξ2 nothing has been learnt. Default 1.1: σ is down by 5 %, less than anybody knows a prior to; a
    /// one-position alignment leaves its east gyro at 1.02.
    pub seen: f32,
    /// A state is at its ceiling from this part of it on. Default 0.9: the rest is worth 5 % of σ.
    pub near_ceiling: f32,
    /// How far ξ2 may stand above the ceiling, relatively. Default [`MARGIN`], 0.1, with its derivation there: what
    /// re-linearisation and Markov biases explain. A vehicle that tilts has no ceiling of one position any more
    /// ([`super::super::ceiling::tilt_excess`]).
    pub margin: f32,
    /// σ that has grown again: variance over the best reached. Default 2.25, σ by one half.
    pub regress: f32,
    /// Largest mean ν²/s, its rows limited to 25. Default 4: true errors of the measurement twice what the filter
    /// believes. A sound filter on real data reaches 2.6; noise alone is excluded by 5 standard deviations of the mean.
    pub nis: f32,
    /// Smallest mean ν²/s. Default 1e-4: nobody overstates a noise a hundred-fold in σ, a frozen sensor does.
    pub silent: f32,
    /// Largest μ. Default 25: 5 σ of a χ² with one degree, 6e-7 per independent look; 15 states looked at every 100 s are
    /// wrongly accused once in 130 days.
    pub moves: f32,
    /// Movement smaller than this part of the variance is never held against a state. Default 0.25: half a σ is what
    /// its σ tells the user anyway.
    pub share: f32,
    /// How much of ν̄ and μ a block leaves to the next. Default 0.9: they remember ten blocks.
    pub memory: f32,
    /// How much easier it is to hold a verdict than to get it. Default 0.1.
    pub hysteresis: f32,
}

impl Limits {
    /// What [`Default`] gives.
    pub const DEFAULT: Self = Self {
        block: 10.0,
        confirm: 2,
        rest: 1.0 / 1200.0,
        learnt: 2.0,
        seen: 1.1,
        near_ceiling: 0.9,
        margin: MARGIN as f32,
        regress: 2.25,
        nis: 4.0,
        silent: 1e-4,
        moves: 25.0,
        share: 0.25,
        memory: 0.9,
        hysteresis: 0.1,
    };

    /// Refuses limits with which no verdict makes sense.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for one that is not positive, a `memory` or `hysteresis` not below
    /// 1, or `learnt` ≤ 1.
    pub fn check(&self) -> Result<(), Error> {
        let positive = [
            self.block,
            self.rest,
            self.learnt - 1.0,
            self.seen,
            self.near_ceiling,
            self.margin,
            self.regress,
            self.nis,
            self.silent,
            self.moves,
            self.share,
            self.memory,
            self.hysteresis,
        ];
        if positive.iter().any(|x| !x.is_finite()) {
            return Err(Error::NonFinite);
        }
        let fine = positive.iter().all(|x| *x > 0.0);
        if fine && self.memory < 1.0 && self.hysteresis < 1.0 {
            Ok(())
        } else {
            Err(Error::OutOfRange)
        }
    }

    /// Mean ν²/s of the rows of an update, none counting for more than 25: one outlier is for the gate to judge.
    pub(super) fn surprise<const M: usize>(&self, row_nis: &[f32; M]) -> f32 {
        const MOST: f32 = 25.0;
        let sum = row_nis.iter().fold(0.0, |sum, nis| sum + nis.min(MOST));
        sum / M.max(1) as f32
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self::DEFAULT
    }
}
