//! What the reports of the updates say about one state, block by block.

/// Rates of one state over a block [1/s].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Trend {
    /// λ: share of the variance that measurements take, per second.
    pub learnt: f32,
    /// ρ: relative change of the variance per second, all in all; below 0, σ falls.
    pub net: f32,
}

/// Sums about one state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Evidence {
    /// Variance when the block began and now, σ0 units.
    pub begin: f32,
    pub p: f32,
    /// The smallest variance at the end of a block.
    pub best: f32,
    /// Σ (p⁻ − p⁺)/p⁻ of this block.
    learnt: f32,
    /// Σ w, Σ w² and Σ w ν²/s, with forgetting.
    weight: f32,
    weight2: f32,
    nis: f32,
    /// Σ δx and Σ (p⁻ − p⁺), with forgetting.
    moved: f32,
    expected: f32,
    /// Of the last block.
    pub trend: Option<Trend>,
}

impl Evidence {
    pub const fn new() -> Self {
        Self {
            begin: 1.0,
            p: 1.0,
            best: f32::MAX,
            learnt: 0.0,
            weight: 0.0,
            weight2: 0.0,
            nis: 0.0,
            moved: 0.0,
            expected: 0.0,
            trend: None,
        }
    }

    /// The first block begins with this variance.
    pub fn begin(&mut self, p: f32) {
        (self.begin, self.p) = (p, p);
    }

    /// One update; `surprise` is its mean ν²/s.
    #[inline(always)]
    pub fn add(&mut self, before: f32, after: f32, decrease: f32, correction: f32, surprise: f32) {
        // A state that is known exactly learns nothing.
        let share = if before > 0.0 { decrease / before } else { 0.0 };
        self.p = after;
        self.learnt += share;
        self.weight += share;
        self.weight2 += share * share;
        self.nis += share * surprise;
        self.moved += correction;
        self.expected += decrease;
    }

    /// The block is over: its rates.
    pub fn close(&mut self, length: f32) {
        let sum = self.p + self.begin;
        // ln(p/begin) by its Padé form, which stays within ±2 where a variance collapses; no variance, no change.
        let change = if sum > 0.0 {
            2.0 * (self.p - self.begin) / sum
        } else {
            0.0
        };
        self.trend = Some(Trend {
            learnt: self.learnt / length,
            net: change / length,
        });
        self.best = self.best.min(self.p);
    }

    /// The next block begins here, and what is older than a few blocks fades.
    pub fn reopen(&mut self, memory: f32) {
        self.begin = self.p;
        self.learnt = 0.0;
        self.weight *= memory;
        self.nis *= memory;
        self.moved *= memory;
        // weights of squares, variances
        self.weight2 *= memory * memory;
        self.expected *= memory * memory;
    }

    /// ν̄ and the number of equal updates it is worth; None where nothing was learnt.
    pub fn innovations(&self) -> Option<(f32, f32)> {
        (self.weight2 > 0.0).then(|| {
            (
                self.nis / self.weight,
                self.weight * self.weight / self.weight2,
            )
        })
    }

    /// μ, or 0 where it moved by less than `share` of its variance or the measurements had their reason: they took more
    /// than its variance.
    pub fn moved(&self, share: f32) -> f32 {
        let square = self.moved * self.moved;
        if square > share * self.p && self.expected > 0.0 && self.expected < self.p {
            square / self.expected
        } else {
            0.0
        }
    }
}
