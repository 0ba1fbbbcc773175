//! One source of measurements: its gate, what was refused, and what happens when it is refused for too long.

use super::report::UpdateReport;
use crate::error::Error;
use crate::error_model::{POS, VEL};
use crate::measurement::{Jacobian, Linearized};
use nalgebra::{ArrayStorage, SVector};

/// States that a reset opens: bit i for state i.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct States(pub u16);

impl States {
    /// δr
    pub const POSITION: Self = Self(0b111 << POS);
    /// δr_U
    pub const HEIGHT: Self = Self(0b100 << POS);
    /// δv
    pub const VELOCITY: Self = Self(0b111 << VEL);
    /// δr and δv
    pub const POSITION_VELOCITY: Self = Self(Self::POSITION.0 | Self::VELOCITY.0);

    /// Whether state i is among them.
    pub fn has(&self, i: usize) -> bool {
        i < 16 && self.0 & (1 << i) != 0
    }
}

/// What a source may do.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Gate {
    /// A row is refused when its ν²/s exceeds this (χ², one degree of freedom; 10.8 is one false alarm in 1000). None:
    /// every row is used.
    pub limit: Option<f32>,
    /// Reset to the measurement when every one of it had refused rows for this long [s], and what to open then. None:
    /// never; the counters still tell.
    pub lock_out: Option<(f32, States)>,
}

impl Gate {
    /// Uses everything.
    pub const OPEN: Self = Self {
        limit: None,
        lock_out: None,
    };

    fn check(&self) -> Result<(), Error> {
        let (limit, seconds) = (
            self.limit.unwrap_or(1.0),
            self.lock_out.map_or(1.0, |(seconds, _)| seconds),
        );
        match () {
            () if !(limit.is_finite() && seconds.is_finite()) => Err(Error::NonFinite),
            () if limit <= 0.0 || seconds < 0.0 => Err(Error::OutOfRange),
            () => Ok(()),
        }
    }
}

/// A source of measurements and its record: one per receiver channel, wheel, barometer, kept by the caller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    gate: Gate,
    used: u32,
    refused: u32,
    in_a_row: u32,
    resets: u32,
    /// Time of the first measurement of the present series of refusals [s].
    since: f64,
}

/// What became of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Handling {
    /// All rows were used.
    Used,
    /// Some rows were beyond the gate, the others were used.
    Partly,
    /// All rows were beyond the gate.
    Refused,
    /// The source had been refused for too long: the states of its [`Gate::lock_out`] were opened and set by this
    /// measurement.
    Reset,
}

/// An update of a source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aided<const M: usize> {
    /// What the filter did, as seen from the rows; of a reset, with the states already opened.
    pub report: UpdateReport<M>,
    /// The measurement as the filter took it: its rows and its noise carried to the present; of a reset, its innovation
    /// what the first use of it had left.
    pub measurement: Linearized<M>,
    /// What became of the measurement.
    pub handling: Handling,
    /// How old it was when it arrived [s].
    pub age: f32,
}

impl<const M: usize> Aided<M> {
    /// Room for an outcome ([`crate::filter::LateFilter::update_into`]); what it holds before means nothing.
    #[inline(always)]
    pub const fn empty() -> Self {
        let zero = SVector::from_array_storage(ArrayStorage([[0.0; M]]));
        Self {
            report: UpdateReport::empty(),
            measurement: Linearized {
                nu: zero,
                h: Jacobian::Direct { first: 0 },
                r: zero,
                interval: 0.0,
            },
            handling: Handling::Refused,
            age: 0.0,
        }
    }
}

impl Source {
    /// A source that has sent nothing yet.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for a limit that is not positive or a time below zero.
    pub fn new(gate: Gate) -> Result<Self, Error> {
        gate.check()?;
        Ok(Self {
            gate,
            used: 0,
            refused: 0,
            in_a_row: 0,
            resets: 0,
            since: 0.0,
        })
    }

    /// What it may do.
    pub fn gate(&self) -> &Gate {
        &self.gate
    }

    /// Measurements of which every row was used, resets included.
    pub fn used(&self) -> u32 {
        self.used
    }

    /// Measurements with at least one row beyond the gate.
    pub fn refused(&self) -> u32 {
        self.refused
    }

    /// How many of the last ones in a row had refused rows.
    pub fn refused_in_a_row(&self) -> u32 {
        self.in_a_row
    }

    /// How often the filter was reset to it.
    pub fn resets(&self) -> u32 {
        self.resets
    }

    /// What is to be opened if the measurement of this time is refused again.
    pub(super) fn due(&self, time: f64) -> Option<States> {
        let (seconds, states) = self.gate.lock_out?;
        let late = self.in_a_row > 0 && time - self.since >= f64::from(seconds);
        late.then_some(states)
    }

    /// Keeps the record.
    pub(super) fn record<const M: usize>(
        &mut self,
        time: f64,
        report: &UpdateReport<M>,
        reset: bool,
    ) -> Handling {
        let used = report.rows_accepted();
        if used == M || reset {
            self.used = self.used.saturating_add(1);
            self.in_a_row = 0;
        } else {
            if self.in_a_row == 0 {
                self.since = time;
            }
            self.refused = self.refused.saturating_add(1);
            self.in_a_row = self.in_a_row.saturating_add(1);
        }
        match used {
            _ if reset => {
                self.resets = self.resets.saturating_add(1);
                Handling::Reset
            }
            0 => Handling::Refused,
            n if n < M => Handling::Partly,
            _ => Handling::Used,
        }
    }
}
