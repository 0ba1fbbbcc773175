//! Gate: which states the updates may move. Off unless somebody uses it.
//!
//! A state that the measurements of the moment cannot see is moved all the same where its estimate is correlated with
//! what they see, and wrong aiding then carries it away. The gate holds such states by the Schmidt update
//! ([`Filter::consider`]) and releases them when they are seen again. A variance is never set to anything.
//!
//! Seen or not is decided by what an update would take from the variance of the state if it were free:
//!
//! ```text
//! λ = Σ c²/(s p) / T,     c = P hᵀ, s = h P hᵀ + r, p of the state        [1/s]
//! ```
//!
//! with rows of one update counted as if each were alone. A state is held after a whole block of [`Plan::dwell`] seconds
//! with too little, and released at once, before the update that would teach it: while a state is held the update spends
//! such information on the others, and it does not come back (5 s of delay at the beginning of a turn left a bias with
//! seven times the σ). In a hover λ of a level
//! accelerometer bias falls to nothing as soon as the tilt has taken up the specific force, held or not, because its
//! correlation with the velocity goes; a turn brings it back at once.

use crate::error::Error;
use crate::error_model::N;
use crate::filter::{Filter, UpdateReport};
use crate::linalg::each_state;
use crate::measurement::{Kind, Linearized, MeasurementRows};
use nalgebra::SMatrix;

/// When a state is held and when it is free.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Plan {
    /// States that may be held, bit i for state i.
    pub eligible: u16,
    /// States that are held throughout, as the heading of a sensor that cannot feel the earth turn: where a heading is
    /// not known at all, the noise of the specific force passes for an acceleration and teaches one.
    pub always: u16,
    /// A state is held when λ stays below this over a block [1/s]. 1/2400 leaves 12 % of σ per ten minutes to be learnt.
    pub hold: f32,
    /// It is released when an update offers more than this, λ of that update alone [1/s]; above `hold`.
    pub release: f32,
    /// Length of a block [s], and the shortest time of freedom.
    pub dwell: f32,
}

impl Plan {
    /// Biases are held below 1/2400 per second over 5 s, and released above 1/300, which costs the released bias of a
    /// hover 3 to 5 % of its σ (`host-tests/tests/gate.rs`).
    ///
    /// A filter whose heading is wrong by more than a degree or two lends every bias a share that is none, because it
    /// sees itself turn; the gate believes it.
    pub const BIASES: Self = Self {
        eligible: 0b111_111_000_000_000,
        always: 0,
        hold: 1.0 / 2400.0,
        release: 1.0 / 300.0,
        dwell: 5.0,
    };

    fn check(&self) -> Result<(), Error> {
        let numbers = [self.hold, self.release, self.dwell];
        if numbers.iter().any(|x| !x.is_finite()) {
            return Err(Error::NonFinite);
        }
        if self.hold > 0.0 && self.release >= self.hold && self.dwell > 0.0 {
            Ok(())
        } else {
            Err(Error::OutOfRange)
        }
    }
}

/// Holds what cannot be seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate {
    plan: Plan,
    /// Σ of what the updates of this block offer each state.
    offered: [f32; N],
    held: u16,
    /// Released in this block.
    young: u16,
    began: Option<f64>,
}

impl Gate {
    /// Nothing held yet.
    ///
    /// # Errors
    /// [`Error::NonFinite`], [`Error::OutOfRange`] for a plan that cannot be.
    pub fn new(plan: Plan) -> Result<Self, Error> {
        plan.check()?;
        Ok(Self {
            plan,
            offered: [0.0; N],
            held: 0,
            young: 0,
            began: None,
        })
    }

    /// Uses a measurement through the gate, in place of [`Filter::update`].
    ///
    /// # Errors
    /// Those of [`Filter::update`].
    pub fn update<const M: usize, H: MeasurementRows<M>>(
        &mut self,
        filter: &mut Filter,
        measurement: &Linearized<M, H>,
    ) -> Result<UpdateReport<M>, Error> {
        let mut report = UpdateReport::empty();
        self.update_into(filter, measurement, &mut report)?;
        Ok(report)
    }

    /// As [`Gate::update`], with the report written where the caller has room for it, as [`Filter::update_into`] does.
    ///
    /// # Errors
    /// Those of [`Filter::update`].
    pub fn update_into<const M: usize, H: MeasurementRows<M>>(
        &mut self,
        filter: &mut Filter,
        measurement: &Linearized<M, H>,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        filter.synchronize();
        self.decide(filter.time());
        let offers = offers(filter, measurement);
        self.release(&offers, measurement.interval);
        filter.consider(self.held());
        filter.update_into(measurement, report)?;
        macro_rules! add {
            ($i:literal) => {
                self.offered[$i] += offers[$i];
            };
        }
        each_state!(add);
        Ok(())
    }

    /// The states that are held, as bits.
    pub fn held(&self) -> u16 {
        self.held | self.plan.always
    }

    /// Releases what this update would teach.
    fn release(&mut self, offers: &[f32; N], interval: f32) {
        if self.held == 0 || interval <= 0.0 {
            return;
        }
        for (i, offer) in offers.iter().enumerate() {
            let bit = 1 << i;
            if self.held & bit != 0 && *offer > self.plan.release * interval {
                self.held &= !bit;
                // not held again before a whole block has passed
                self.young |= bit;
            }
        }
    }

    /// Closes a block that is over.
    fn decide(&mut self, time: f64) {
        let Some(began) = self.began else {
            self.began = Some(time);
            return;
        };
        let length = (time - began) as f32;
        if (0.0..self.plan.dwell).contains(&length) {
            return;
        }
        self.began = Some(time);
        for (i, offered) in self.offered.iter_mut().enumerate() {
            let bit = 1 << i;
            if self.plan.eligible & bit != 0 && length > 0.0 {
                if *offered > self.plan.release * length {
                    self.held &= !bit;
                } else if *offered < self.plan.hold * length && self.young & bit == 0 {
                    self.held |= bit;
                }
            }
            *offered = 0.0;
        }
        self.young = 0;
    }
}

/// What each state would learn from the rows: Σ c²/(s p), at most 1.
#[inline(never)] // so that its rows are off the stack when the update begins
fn offers<const M: usize, H: MeasurementRows<M>>(
    filter: &Filter,
    measurement: &Linearized<M, H>,
) -> [f32; N] {
    let (p, unit) = (filter.covariance(), filter.sigma0());
    let mut offers = [0.0; N];
    let variances = measurement.r.as_slice().iter();
    match measurement.h.kind() {
        Kind::Direct { first } => {
            for (r, state) in variances.zip(first..) {
                let mut row = [0.0; N];
                if let (Some(h), Some(unit)) = (row.get_mut(state), unit.get(state)) {
                    *h = -*unit;
                }
                p.add_shares(&row, *r, &mut offers);
            }
        }
        rows => {
            let dense = rows.dense();
            for (m, r) in variances.enumerate() {
                p.add_shares(&in_units(&dense, m, unit), *r, &mut offers);
            }
        }
    }
    macro_rules! bound {
        ($i:literal) => {
            offers[$i] = f32::min(offers[$i], 1.0);
        };
    }
    each_state!(bound);
    offers
}

/// Row m of H, states in these units.
#[inline(always)]
fn in_units<const M: usize>(h: &SMatrix<f32, M, N>, m: usize, unit: &[f32; N]) -> [f32; N] {
    let mut row = [0.0; N];
    macro_rules! one {
        ($j:literal) => {
            if let Some(h) = h.data.0[$j].get(m) {
                row[$j] = *h * unit[$j];
            }
        };
    }
    each_state!(one);
    row
}
