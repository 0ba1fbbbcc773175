//! What the updates themselves say about a state, in f64 and from their reports alone: what a reason has to stand on.

use navsight::error_model::N;
use navsight::filter::UpdateReport;

/// Length of a block of the verdict [s]: it is closed by the first update after that.
const BLOCK: f64 = 10.0;
/// A block leaves this part of the sums to the next.
const MEMORY: f64 = 0.9;
/// One row counts for no more than this.
const MOST: f64 = 25.0;

/// One update, as one state sees it: p⁻, p⁺, p⁻ − p⁺, δx in σ0 units.
#[derive(Clone, Copy)]
struct Seen {
    before: f64,
    after: f64,
    decrease: f64,
    correction: f64,
}

/// All updates since the start, and looks where there was none.
#[derive(Default)]
pub(super) struct History {
    /// Number of the block, mean ν²/s, and what each state sees.
    updates: Vec<(i32, f64, [Seen; N])>,
    /// When the open block began.
    began: Option<f64>,
    open: i32,
    /// Length of the block that the last update has closed, if it has.
    closed: Option<f64>,
}

/// About one state, now.
#[derive(Clone, Copy)]
pub(super) struct Evidence {
    pub xi2: f64,
    /// What the measurements of the block took, and what became of the variance in it [1/s].
    pub learnt: f64,
    pub net: f64,
    /// Variance over the smallest so far.
    pub grown: f64,
    /// Mean ν²/s of what taught it, with forgetting.
    pub innovations: f64,
    /// (Σ δx)² over Σ (p⁻ − p⁺), with forgetting.
    pub moved: f64,
}

impl History {
    pub(super) fn take<const M: usize>(&mut self, time: f64, report: &UpdateReport<M>) {
        let nis: f64 = report
            .row_nis
            .iter()
            .map(|nis| f64::from(*nis).min(MOST))
            .sum();
        let seen = std::array::from_fn(|i| Seen {
            before: report.p_before[i].into(),
            after: report.p_after[i].into(),
            decrease: report.decrease[i].into(),
            correction: report.correction[i].into(),
        });
        self.add(time, nis / M as f64, seen);
    }

    /// Time has passed without an update: the variances now, σ0 units.
    pub(super) fn pass(&mut self, time: f64, p: &[f32; N]) {
        let seen = p.map(|p| Seen {
            before: p.into(),
            after: p.into(),
            decrease: 0.0,
            correction: 0.0,
        });
        self.add(time, 0.0, seen);
    }

    fn add(&mut self, time: f64, nis: f64, seen: [Seen; N]) {
        self.updates.push((self.open, nis, seen));
        let length = time - *self.began.get_or_insert(time);
        // in f32, as the verdict has it
        self.closed = (length as f32 >= BLOCK as f32).then_some(length);
        if self.closed.is_some() {
            self.began = Some(time);
            self.open += 1;
        }
    }

    /// About state `i`, at the end of a block.
    pub(super) fn of(&self, i: usize) -> Evidence {
        let (Some((block, _, last)), Some(length)) = (self.updates.last(), self.closed) else {
            panic!("a verdict changes at the update that closes a block");
        };
        let p = last[i].after;
        let (mut learnt, mut begin, mut best) = (0.0, None, f64::INFINITY);
        let [mut weight, mut nis, mut moved, mut expected] = [0.0; 4];
        for (at, surprise, seen) in &self.updates {
            let s = seen[i];
            let share = if s.before > 0.0 {
                s.decrease / s.before
            } else {
                0.0
            };
            // A block begins where the one before ended, the first one before its first update.
            if at == block {
                learnt += share;
                begin.get_or_insert(s.before);
            } else if at + 1 == *block {
                begin = Some(s.after);
            }
            best = s.after.min(best);
            let memory = MEMORY.powi(block - at);
            weight += memory * share;
            nis += memory * share * surprise;
            moved += memory * s.correction;
            expected += memory * memory * s.decrease;
        }
        Evidence {
            xi2: p.recip(),
            learnt: learnt / length,
            net: (p / begin.unwrap_or(p)).ln() / length,
            grown: p / best,
            innovations: nis / weight,
            moved: moved * moved / expected,
        }
    }
}
