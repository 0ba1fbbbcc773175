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

use nalgebra::{SMatrix, SVector};

use super::history::{History, Place};
use super::past::Back;
use super::source::{Aided, Source, States};
use super::{unwatched, Filter, UpdateReport};
use crate::covariance::Covariance15;
use crate::error::Error;
use crate::error_model::{NoiseDensity, N};
use crate::imu::ImuIncrement;
use crate::linalg::each_state;
use crate::measurement::{Jacobian, Linearized, MeasurementRows};
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
            () => {
                let place = self.history.find(now, time)?;
                let mut then = *self.filter.nav();
                self.history.rewind(&mut then, &place)?;
                Ok(then)
            }
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
    #[inline(always)]
    pub fn update<const M: usize, H: MeasurementRows<M>>(
        &mut self,
        source: &mut Source,
        time: f64,
        linearize: impl FnOnce(&NavState) -> Linearized<M, H>,
    ) -> Result<Aided<M>, Error> {
        let mut aided = Aided::empty();
        self.update_into(source, time, linearize, &mut aided)?;
        Ok(aided)
    }

    /// As [`LateFilter::update`], with the outcome written where the caller has room for it: copies and their stack less.
    /// After an error it may hold anything.
    ///
    /// # Errors
    /// Those of [`LateFilter::update`].
    pub fn update_into<const M: usize, H: MeasurementRows<M>>(
        &mut self,
        source: &mut Source,
        time: f64,
        linearize: impl FnOnce(&NavState) -> Linearized<M, H>,
        aided: &mut Aided<M>,
    ) -> Result<(), Error> {
        let now = self.filter.time();
        if !time.is_finite() {
            return Err(Error::NonFinite);
        }
        if time > now + AHEAD {
            return Err(Error::Time);
        }
        aided.age = (now - time).max(0.0) as f32;
        // q of each row has its place in the report, where the update writes over it
        let q = &mut aided.report.s;
        self.linearize(now, time, linearize, &mut aided.measurement, q)?;
        self.widen(&mut aided.measurement, q);
        let limit = source.gate().limit;
        self.apply(&aided.measurement, limit, &mut aided.report)?;
        let due = source.due(time);
        let reset = match due {
            Some(states) if aided.report.rows_accepted() < M => {
                self.open(states, aided)?;
                self.apply(&aided.measurement, None, &mut aided.report)?;
                true
            }
            _ => false,
        };
        aided.handling = source.record(time, &aided.report, reset);
        Ok(())
    }

    /// The measurement as rows on the present; q: the noise since then in each.
    #[inline(never)]
    fn linearize<const M: usize, H: MeasurementRows<M>>(
        &self,
        now: f64,
        time: f64,
        linearize: impl FnOnce(&NavState) -> Linearized<M, H>,
        measurement: &mut Linearized<M>,
        q: &mut [f32; M],
    ) -> Result<(), Error> {
        let nav = self.filter.nav();
        if time >= now {
            *q = [0.0; M];
            linearized(linearize, nav, measurement);
            return Ok(());
        }
        let place = self.history.find(now, time)?;
        let mut then = *nav;
        self.history.rewind(&mut then, &place)?;
        linearized(linearize, &then, measurement);
        self.carry(&place, &mut measurement.h, q);
        Ok(())
    }

    /// Rows of then become rows of now.
    #[inline(never)]
    fn carry<const M: usize>(&self, place: &Place, rows: &mut Jacobian<M>, q: &mut [f32; M]) {
        let antenna = match rows {
            Jacobian::Antenna(rows) if M == 6 => Some(*rows),
            _ => None,
        };
        match antenna {
            Some(_) => clear(rows),
            None => write_out(rows),
        }
        let Jacobian::Dense(h) = rows else { return };
        let mut back = Back::NONE;
        self.history.way_back(place, &mut back);
        let noise = &self.filter.settings().noise;
        match antenna {
            Some(rows) => *q = back.antenna(&rows, noise, &mut h.data.0),
            None => carry_each(&back, noise, &mut h.data.0, q),
        }
    }

    /// The noise that the rows are given for q.
    #[inline(never)]
    fn widen<const M: usize>(&mut self, measurement: &mut Linearized<M>, q: &[f32; M]) {
        let Jacobian::Dense(h) = &measurement.h else {
            return; // of the present
        };
        for ((m, r), q) in measurement.r.iter_mut().enumerate().zip(q) {
            if *q > 1e-4 * *r {
                self.filter.synchronize();
                let mut row = row_of(&h.data.0, m);
                in_units(&mut row, self.filter.sigma0());
                *r = widened(*r, *q, along(self.filter.covariance(), &row));
            }
        }
    }

    /// What the accepted rows said stays said; the refused ones are in this measurement again, and now they win.
    #[cold]
    #[inline(never)]
    fn open<const M: usize>(&mut self, states: States, aided: &mut Aided<M>) -> Result<(), Error> {
        let (report, measurement) = (&aided.report, &mut aided.measurement);
        let (mut nu, mut r) = (0.0f32, 0.0f32);
        for (&x, &v) in measurement.nu.iter().zip(measurement.r.iter()) {
            (nu, r) = (nu.max(x.abs()), r.max(v));
        }
        self.filter.open(states, 10.0 * (nu + libm::sqrtf(r)))?;
        // The innovation has been moved by the rows that were used.
        let mut dx = report.correction;
        in_units(&mut dx, self.filter.sigma0());
        let moved = measurement.dense() * SVector::from(dx);
        measurement.nu -= moved;
        Ok(())
    }

    /// An update, and the memory of what it corrected.
    #[inline(never)]
    fn apply<const M: usize>(
        &mut self,
        measurement: &Linearized<M>,
        gate: Option<f32>,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        self.filter.update_gated(measurement, gate, report)?;
        self.remember(&report.correction);
        Ok(())
    }

    #[inline(never)]
    fn remember(&mut self, correction: &[f32; N]) {
        let mut dx = *correction;
        in_units(&mut dx, self.filter.sigma0());
        self.history.corrected(&mut dx);
    }
}

/// For itself, so that nothing but the measurement lies below it.
#[inline(never)]
fn linearized<const M: usize, H: MeasurementRows<M>>(
    linearize: impl FnOnce(&NavState) -> Linearized<M, H>,
    nav: &NavState,
    measurement: &mut Linearized<M>,
) {
    let given = linearize(nav);
    measurement.nu = given.nu;
    measurement.h = given.h.kind().into();
    measurement.r = given.r;
    measurement.interval = given.interval;
}

/// Room for any rows, zeros. As [`write_out`] for itself: its stack does not lie below what follows.
#[inline(never)]
fn clear<const M: usize>(rows: &mut Jacobian<M>) {
    *rows = Jacobian::Dense(SMatrix::zeros());
}

/// The same rows with all their elements.
#[inline(never)]
fn write_out<const M: usize>(rows: &mut Jacobian<M>) {
    if !matches!(rows, Jacobian::Dense(_)) {
        *rows = Jacobian::Dense(rows.kind().dense());
    }
}

/// Rows of any kind, one by one; q: [`Back::carry`].
fn carry_each<const M: usize>(
    back: &Back,
    noise: &NoiseDensity<f32>,
    h: &mut [[f32; M]; N],
    q: &mut [f32; M],
) {
    for (m, q) in q.iter_mut().enumerate() {
        let mut row = row_of(h, m);
        *q = back.carry(&mut row, noise);
        macro_rules! one {
            ($j:literal) => {
                if let Some(x) = h[$j].get_mut(m) {
                    *x = row[$j];
                }
            };
        }
        each_state!(one);
    }
}

/// Row m < M.
#[inline(always)]
fn row_of<const M: usize>(h: &[[f32; M]; N], m: usize) -> [f32; N] {
    let mut row = [0.0; N];
    macro_rules! one {
        ($j:literal) => {
            row[$j] = h[$j].get(m).copied().unwrap_or(0.0);
        };
    }
    each_state!(one);
    row
}

/// x times `unit`, element by element.
#[inline(always)]
fn in_units(x: &mut [f32; N], unit: &[f32; N]) {
    macro_rules! one {
        ($i:literal) => {
            x[$i] *= unit[$i];
        };
    }
    each_state!(one);
}

/// h P hᵀ
#[inline(never)]
fn along(p: &Covariance15<f32>, h: &[f32; N]) -> f32 {
    let (p, _) = p.words();
    let mut sum = 0.0;
    macro_rules! column {
        ($j:literal) => {
            let mut x = 0.0;
            macro_rules! one {
                ($i:literal) => {
                    if $i < $j {
                        x += p[$j * ($j + 1) / 2 + $i] * h[$i];
                    }
                };
            }
            each_state!(one);
            sum += h[$j] * (x + x + p[$j * ($j + 1) / 2 + $j] * h[$j]);
        };
    }
    each_state!(column);
    sum
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
