//! What a run looked like over time, for pictures: thinned as it grows, so that any recording fits.

use navsight::error_model::N;

/// One instant.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot {
    /// Time [s].
    pub t: f64,
    /// Heading, pitch, roll [°].
    pub angles_deg: [f64; 3],
    /// Standard deviations of the states, SI.
    pub sigma: [f64; N],
    /// ξ1 [1/s]; NaN: not available.
    pub xi1: [f64; N],
    /// ξ2; NaN: not available.
    pub xi2: [f64; N],
    /// Normalised innovation squared of the update, per row.
    pub nis: f64,
}

/// Snapshots at even distances in time, never more than [`History::MOST`].
#[derive(Clone, Debug)]
pub struct History<S> {
    kept: Vec<S>,
    /// One in 2^halvings is kept.
    halvings: u32,
    seen: u64,
}

impl<S> Default for History<S> {
    fn default() -> Self {
        Self {
            kept: Vec::new(),
            halvings: 0,
            seen: 0,
        }
    }
}

impl<S> History<S> {
    /// More than a picture can show.
    pub const MOST: usize = 4096;

    /// Takes one snapshot, or leaves it out.
    pub fn push(&mut self, snapshot: S) {
        if self.seen.is_multiple_of(1 << self.halvings) {
            self.kept.push(snapshot);
        }
        self.seen += 1;
        if self.kept.len() > Self::MOST {
            let mut keep = false;
            self.kept.retain(|_| {
                keep = !keep;
                keep
            });
            self.halvings += 1;
        }
    }

    /// In order of time.
    pub fn snapshots(&self) -> &[S] {
        &self.kept
    }

    /// A line for a chart.
    pub fn line(&self, point: impl Fn(&S) -> (f64, f64)) -> Vec<(f64, f64)> {
        self.kept.iter().map(point).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_run_is_thinned_evenly() {
        let mut history = History::default();
        for k in 0..20_000 {
            history.push(f64::from(k));
        }
        let times = history.snapshots();
        assert!(times.len() <= History::<f64>::MOST && times.len() >= History::<f64>::MOST / 2);
        assert!(times.windows(2).all(|w| w[1] - w[0] == 8.0) && times[0] == 0.0);
    }
}
