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
//! over blocks of [`Plan::dwell`] seconds; rows of one update count as if each were alone. In a hover λ of a level
//! accelerometer bias falls to nothing as soon as the tilt has taken up the specific force, held or not, because its
//! correlation with the velocity goes; a turn brings it back at once.

use crate::error::Error;
use crate::error_model::N;
use crate::filter::{Filter, UpdateReport};
use crate::measurement::Linearized;
use nalgebra::SVector;

/// When a state is held and when it is free.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Plan {
    /// States that may be held, bit i for state i.
    pub eligible: u16,
    /// A state is held when λ stays below this over a block [1/s]. 1/2400 leaves 12 % of σ per ten minutes to be learnt.
    pub hold: f32,
    /// It is released when λ exceeds this over a block [1/s]; above `hold`.
    pub release: f32,
    /// Length of a block [s].
    pub dwell: f32,
}

impl Plan {
    /// Biases are held below 1/2400 per second and released above 1/600, blocks of 5 s: an eighth of the loss of 10 % in σ
    /// that a manoeuvre of a minute makes up for.
    pub const BIASES: Self = Self {
        eligible: 0b111_111_000_000_000,
        hold: 1.0 / 2400.0,
        release: 1.0 / 600.0,
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
            began: None,
        })
    }

    /// Uses a measurement through the gate, in place of [`Filter::update`].
    ///
    /// # Errors
    /// Those of [`Filter::update`].
    pub fn update<const M: usize>(
        &mut self,
        filter: &mut Filter,
        measurement: &Linearized<M>,
    ) -> Result<UpdateReport<M>, Error> {
        filter.synchronize();
        self.decide(filter.time());
        let offers = offers(filter, measurement);
        filter.consider(self.held);
        let report = filter.update(measurement)?;
        for (sum, offer) in self.offered.iter_mut().zip(&offers) {
            *sum += *offer;
        }
        Ok(report)
    }

    /// The states that are held, as bits.
    pub fn held(&self) -> u16 {
        self.held
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
                let rate = *offered / length;
                if rate > self.plan.release {
                    self.held &= !bit;
                } else if rate < self.plan.hold {
                    self.held |= bit;
                }
            }
            *offered = 0.0;
        }
    }
}

/// What each state would learn from the rows: Σ c²/(s p), at most 1.
fn offers<const M: usize>(filter: &Filter, measurement: &Linearized<M>) -> [f32; N] {
    let (p, sigma0) = (filter.covariance(), filter.sigma0());
    let mut offers = [0.0; N];
    let dense = measurement.h.dense();
    for (row, r) in dense.row_iter().zip(measurement.r.iter()) {
        let mut c = SVector::<f32, N>::zeros();
        let mut s = *r;
        for (j, (h, sigma)) in row.iter().zip(sigma0).enumerate() {
            let h = *h * *sigma;
            if h != 0.0 {
                for (i, c) in c.iter_mut().enumerate() {
                    *c += p.element(i, j) * h;
                }
            }
        }
        for ((h, sigma), c) in row.iter().zip(sigma0).zip(c.iter()) {
            s += *h * *sigma * *c;
        }
        for (i, (offer, c)) in offers.iter_mut().zip(c.iter()).enumerate() {
            let sp = s * p.variance(i);
            if sp > 0.0 {
                *offer += *c * *c / sp;
            }
        }
    }
    offers.map(|offer: f32| offer.min(1.0))
}
