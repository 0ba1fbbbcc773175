//! Room for what propagation and update need one after the other, so that the stack need not have it.

use crate::error_model::N;
use crate::linalg::BlockTransition;

/// Rows of an update that find room here; of more the stack has it.
const ROWS: usize = 6;

/// What was put down last; whoever needs the room for something else takes it.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // one room for both
pub(super) enum Room {
    /// Of the last propagation.
    Transition(BlockTransition<f32>),
    /// P Hᵀ of an update, row by row.
    Panel([[f32; N]; ROWS]),
}

impl Room {
    /// The room as a transition, the one that was there or any.
    #[inline(always)]
    pub fn transition(&mut self) -> &mut BlockTransition<f32> {
        loop {
            match self {
                Self::Transition(transition) => return transition,
                Self::Panel(_) => *self = Self::Transition(BlockTransition::identity()),
            }
        }
    }

    /// The room for M rows, with any numbers in it; `None` where they are too many.
    #[inline(always)]
    pub fn panel<const M: usize>(&mut self) -> Option<&mut [[f32; N]; M]> {
        if let Self::Transition(_) = self {
            *self = Self::Panel(const { [[0.0; N]; ROWS] });
        }
        match self {
            Self::Panel(rows) => rows.first_chunk_mut(),
            Self::Transition(_) => None,
        }
    }
}
