//! Room for what propagation and update need one after the other, so that the stack need not have it.

use core::fmt;

use crate::error_model::N;
use crate::linalg::{BlockTransition, Pair};

/// Rows of an update that find room here; of more the stack has it.
const ROWS: usize = 6;

/// What was put down last; whoever needs the room for something else takes it.
#[derive(Clone)]
#[allow(clippy::large_enum_variant)] // one room for all
pub(super) enum Room {
    /// Of the last propagation.
    Transition(BlockTransition<f32>),
    /// P Hᵀ of an update, row by row.
    Panel([[f32; N]; ROWS]),
    /// The same of half as many rows in double words.
    Pairs([[Pair<f32>; N]; ROWS / 2]),
}

/// What lies in it means nothing from one call to the next: filters are equal without it.
impl PartialEq for Room {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl fmt::Debug for Room {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Room")
    }
}

impl Room {
    /// The room as a transition, the one that was there or any.
    #[inline(always)]
    pub(super) fn transition(&mut self) -> &mut BlockTransition<f32> {
        loop {
            match self {
                Self::Transition(transition) => return transition,
                _ => *self = Self::Transition(BlockTransition::identity()),
            }
        }
    }

    /// The room for M rows, with any numbers in it; `None` where they are too many.
    #[inline(always)]
    pub(super) fn panel<const M: usize>(&mut self) -> Option<&mut [[f32; N]; M]> {
        if M > ROWS {
            return None;
        }
        loop {
            match self {
                Self::Panel(rows) => return rows.first_chunk_mut(),
                _ => *self = Self::Panel(const { [[0.0; N]; ROWS] }),
            }
        }
    }

    /// The room for M rows in double words, likewise.
    #[inline(always)]
    pub(super) fn pairs<const M: usize>(&mut self) -> Option<&mut [[Pair<f32>; N]; M]> {
        if M > ROWS / 2 {
            return None;
        }
        loop {
            match self {
                Self::Pairs(rows) => return rows.first_chunk_mut(),
                _ => *self = Self::Pairs(const { [[Pair::ZERO; N]; ROWS / 2] }),
            }
        }
    }
}
