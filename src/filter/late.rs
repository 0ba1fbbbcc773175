//! The filter with a memory: measurements that arrive after the time they belong to, each from a source with a gate of
//! its own.
//!
//! A receiver says where the antenna was 0.1 to 0.4 s ago. The innovation is formed with the nominal state of that time,
//! corrected by what was learnt since, and the row is carried to the present by the transition in between, the other
//! way round:
//!
//! ```text
//! ν = z − h(x̂ then),   δx then = Φ⁻¹ (δx now − w)   so   ν = h Φ⁻¹ δx now − h Φ⁻¹ w + noise
//! ```
//!
//! What w, the process noise since then, does to the row is known to the present covariance as well: the row looks
//! better than it is. Where p = h P hᵀ then and q that noise in the row, the update would take (p + q)²/(p + q + R) and
//! may take p²/(p + R); the row is given the noise R' at which it takes that. Exact for a single row; left out is what
//! other measurements since then have already said of w. Where q is below 1e-4 R nothing is changed.
//!
//! Accuracy against an undelayed filter, and the cost of ignoring the delay: `host-tests/tests/late.rs`.

use nalgebra::SVector;

use super::history::History;
use super::source::{Aided, Source};
use super::{unwatched, Filter, UpdateReport};
use crate::error::Error;
use crate::error_model::N;
use crate::imu::ImuIncrement;
use crate::measurement::{Jacobian, Linearized};
use crate::nav::NavState;

/// Longest spacing of the history [s].
pub const MAX_SPACING: f32 = 0.5;
/// A measurement this much younger than the last sample is taken as one of its time [s].
const AHEAD: f64 = 0.05;

/// A filter that remembers its last K states. K times the spacing must cover the oldest measurement; 0 remembers
/// nothing, and every measurement has to be of the present.
#[derive(Clone, Debug)]
pub struct LateFilter<const K: usize> {
    filter: Filter,
    history: History<K>,
}

impl<const K: usize> LateFilter<K> {
    /// From a filter, remembering a state every `spacing` seconds (0: at every sample).
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for a spacing outside 0 … [`MAX_SPACING`].
    pub fn new(filter: Filter, spacing: f32) -> Result<Self, Error> {
        if !spacing.is_finite() {
            return Err(Error::NonFinite);
        }
        if !(0.0..=MAX_SPACING).contains(&spacing) {
            return Err(Error::OutOfRange);
        }
        let history = History::new(filter.nav(), filter.time(), spacing);
        Ok(Self { filter, history })
    }

    /// As [`Filter::propagate`].
    ///
    /// # Errors
    /// As [`Filter::propagate`].
    pub fn propagate(&mut self, imu: &ImuIncrement) -> Result<(), Error> {
        let step = self.filter.advance(imu, unwatched)?;
        let (nav, time) = (self.filter.nav(), self.filter.time());
        self.history.take(&step, nav, time);
        Ok(())
    }

    /// As [`Filter::synchronize`].
    pub fn synchronize(&mut self) {
        self.filter.synchronize();
    }

    /// The filter, at the time of the last sample.
    pub fn filter(&self) -> &Filter {
        &self.filter
    }

    /// The state at a time in the past [s of [`Filter::time`]] as it is known now.
    ///
    /// # Errors
    /// [`Error::Late`] beyond the history, [`Error::Time`] for a time to come.
    pub fn state_at(&self, time: f64) -> Result<NavState, Error> {
        let now = self.filter.time();
        match () {
            () if !time.is_finite() => Err(Error::NonFinite),
            () if time > now + AHEAD => Err(Error::Time),
            () if time >= now => Ok(*self.filter.nav()),
            () => self
                .history
                .past(self.filter.nav(), now, time)
                .map(|(nav, _)| nav),
        }
    }

    /// Uses a measurement of the time `time` [s of [`Filter::time`]], by the gate of its source. `linearize` is handed
    /// the state of that time.
    ///
    /// When the source has been refused for longer than its lock-out, the states it names are opened, and set by this
    /// measurement; the outcome says so.
    ///
    /// # Errors
    /// [`Error::Late`] when the time is further back than the history reaches, [`Error::Time`] when it is to come, and
    /// those of [`Filter::update`]. The record of the source is then as it was.
    pub fn update<const M: usize>(
        &mut self,
        source: &mut Source,
        time: f64,
        linearize: impl FnOnce(&NavState) -> Linearized<M>,
    ) -> Result<Aided<M>, Error> {
        let now = self.filter.time();
        if !time.is_finite() {
            return Err(Error::NonFinite);
        }
        if time > now + AHEAD {
            return Err(Error::Time);
        }
        let age = (now - time).max(0.0) as f32;
        let measurement = if time < now {
            let (then, back) = self.history.past(self.filter.nav(), now, time)?;
            let of_then = linearize(&then);
            let h = of_then.h.dense();
            let noise = back.noise(&h, &self.filter.settings().noise);
            let rows = back.rows(&h);
            let mut r = of_then.r;
            if noise.iter().zip(r.iter()).any(|(q, r)| *q > 1e-4 * *r) {
                self.filter.synchronize();
                let each = &rows.transpose().data.0;
                for ((r, &q), h) in r.iter_mut().zip(noise.iter()).zip(each) {
                    *r = widened(*r, q, self.variance(h));
                }
            }
            Linearized {
                h: Jacobian::Dense(rows),
                r,
                ..of_then
            }
        } else {
            linearize(self.filter.nav())
        };
        let (report, reset) = self.through_gate(source, time, &measurement)?;
        let handling = source.record(time, &report, reset);
        Ok(Aided {
            report,
            handling,
            age,
        })
    }

    fn through_gate<const M: usize>(
        &mut self,
        source: &Source,
        time: f64,
        measurement: &Linearized<M>,
    ) -> Result<(UpdateReport<M>, bool), Error> {
        let mut report = UpdateReport::empty();
        self.apply(measurement, source.gate().limit, &mut report)?;
        let open = match source.due(time) {
            Some(states) if report.rows_accepted() < M => states,
            _ => return Ok((report, false)),
        };
        // What the accepted rows said stays said; the refused ones are in this measurement again, and now they win.
        let (mut nu, mut r) = (0.0f32, 0.0f32);
        for (&x, &v) in measurement.nu.iter().zip(measurement.r.iter()) {
            (nu, r) = (nu.max(x.abs()), r.max(v));
        }
        self.filter.open(open, 10.0 * (nu + libm::sqrtf(r)))?;
        // The innovation has been moved by the rows that were used.
        let moved = measurement.h.dense() * self.correction(&report);
        let again = Linearized {
            nu: measurement.nu - moved,
            ..*measurement
        };
        self.apply(&again, None, &mut report)?;
        Ok((report, true))
    }

    /// An update, and the memory of what it corrected.
    fn apply<const M: usize>(
        &mut self,
        measurement: &Linearized<M>,
        gate: Option<f32>,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        self.filter.update_gated(measurement, gate, report)?;
        self.history.corrected(&self.correction(report));
        Ok(())
    }

    /// δx of an update, SI.
    fn correction<const M: usize>(&self, report: &UpdateReport<M>) -> SVector<f32, N> {
        SVector::from(report.correction).component_mul(&SVector::from(*self.filter.sigma0()))
    }

    /// h P hᵀ at present.
    fn variance(&self, h: &[f32; N]) -> f32 {
        let (p, sigma0) = (self.filter.covariance(), self.filter.sigma0());
        let mut sum = 0.0;
        for (i, (a, si)) in h.iter().zip(sigma0).enumerate() {
            let scaled = a * si;
            if scaled == 0.0 {
                continue;
            }
            for (j, (b, sj)) in h.iter().zip(sigma0).enumerate() {
                if *b != 0.0 {
                    sum += scaled * p.element(i, j) * (b * sj);
                }
            }
        }
        sum
    }
}

/// The noise R' at which a row of present variance `s` takes what it may, p²/(p + R) with p = s − q.
///
/// p is at least a quarter of s: so much of a state cannot be noise of the last tenths of a second unless it was measured
/// in between, and then the noise was seen.
fn widened(r: f32, q: f32, s: f32) -> f32 {
    let p = (s - q).max(0.25 * s);
    if p > 0.0 {
        (s * s * (p + r) / (p * p) - s).max(r)
    } else {
        r // nothing is known to be wrong along this row: it moves nothing
    }
}
