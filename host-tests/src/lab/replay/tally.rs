//! What a run of `lab replay` adds up, sample by sample.

use navsight::error_model::N;
use navsight::filter::UpdateReport;

use super::super::history::{History, Snapshot};
use super::manoeuvres::Manoeuvres;
use super::verdicts::Watch;

/// What a run adds up, sample by sample.
#[derive(Default)]
pub(super) struct Tally {
    pub(super) last: Option<Last>,
    pub(super) nis: Nis,
    pub(super) rejected: u64,
    pub(super) compared: Compared,
    pub(super) events: Vec<(f64, String)>,
    pub(super) history: History<Snapshot>,
    /// Time; east and north of the first fix [m], speed [m/s].
    pub(super) track: History<(f64, [f64; 3])>,
    /// Time; innovation and its 1σ of position and velocity, east, north, up.
    pub(super) fixes: History<(f64, [[f64; 2]; 6])>,
    pub(super) manoeuvres: Manoeuvres,
    /// Once the filter runs.
    pub(super) watch: Option<Watch>,
    pub(super) time: f64,
    pub(super) samples: u64,
}

impl Tally {
    /// Something that people want to know.
    pub(super) fn event(&mut self, what: &str) {
        const MOST: usize = 1000; // enough to see what is wrong with a recording
        if self.events.len() < MOST {
            self.events.push((self.time, what.to_owned()));
        }
    }

    /// Both halves of a fix; some have no velocity.
    pub(super) fn fix(&mut self, position: &UpdateReport<3>, velocity: Option<&UpdateReport<3>>) {
        let row = |i: usize| {
            let report = if i < 3 { Some(position) } else { velocity };
            let k = i % 3;
            report.map_or([f64::NAN; 2], |report| {
                [f64::from(report.nu[k]), f64::from(report.s[k].sqrt())]
            })
        };
        const PAUSE: f64 = 3.0; // longer ones leave a gap in the line
        match self.fixes.snapshots().last() {
            Some((before, _)) if self.time - before > PAUSE => {
                self.fixes.push((self.time, [[f64::NAN; 2]; 6]));
            }
            _ => {}
        }
        self.fixes.push((self.time, std::array::from_fn(row)));
    }

    /// Where the vehicle is now.
    pub(super) fn moved(&mut self, place: [f64; 3]) {
        self.track.push((self.time, place));
    }

    /// Innovations of the updates of one instant, of which there is at least one.
    pub(super) fn innovations<const M: usize>(&mut self, reports: &[UpdateReport<M>]) {
        let (mut nis, mut rows) = (0.0, 0);
        for report in reports {
            nis += f64::from(report.nis);
            rows += report.rows_accepted();
            let refused = M - report.rows_accepted();
            if refused > 0 {
                self.rejected += refused as u64;
                self.event(&format!("{refused} of {M} rows beyond the gate"));
            }
        }
        self.nis.sum += nis;
        self.nis.rows += rows as u64;
        self.nis.updates += reports.len() as u64;
        self.nis.last = nis / rows as f64;
    }
}

/// The last update.
pub(super) struct Last {
    pub(super) xi1: [f64; N],
    pub(super) xi2: [f64; N],
}

/// Normalised innovations of all updates.
#[derive(Default)]
pub(super) struct Nis {
    pub(super) sum: f64,
    pub(super) rows: u64,
    pub(super) updates: u64,
    pub(super) last: f64,
}

impl Nis {
    /// Mean per row; NaN, null in JSON, where there was none.
    pub(super) fn per_row(&self) -> f64 {
        self.sum / self.rows as f64
    }
}

/// Differences to the reference.
#[derive(Default)]
pub(super) struct Compared {
    pub(super) count: u64,
    pub(super) sum: [f64; 3],
    pub(super) square: [f64; 3],
}
