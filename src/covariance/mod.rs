//! Covariance of a linear filter: stored, propagated and updated. Knows no navigation.
//!
//! | file | holds |
//! |---|---|
//! | `packed` | [`Covariance`]: upper triangle, two words per element; how it is made and read |
//! | `column` | one column, the variances, what one row by itself would take of them: spelled out |
//! | `general` | [`Covariance::propagate`]: any N, any dense A = Φ − I |
//! | `structured` | [`Covariance15::propagate_blocks`]: the 15-state pattern of [`crate::linalg::BlockTransition`], spelled out |
//! | `update` | [`Covariance::update`]: M rows in one sweep, each with its gate |
//! | `swift`, `sweep` | how that is done when no variance collapses but those of the measured states: one word per product, spelled out for 15 states; what is checked, and what is written |
//! | `direct`, `chains` | one row that measures one state, and positions that have velocities that have accelerations: what a tracker does, any N |
//! | `panel`, `sequence` | P Hᵀ of any rows; M rows made a sequence, each gated given those before it |
//! | `careful` | how it is done when one does, for any other N, and where states are to be left alone (Schmidt): double words |

mod careful;
mod chains;
mod column;
mod direct;
mod general;
mod packed;
mod panel;
mod sequence;
mod structured;
mod sweep;
mod swift;
mod update;

pub(crate) use chains::Chain;
pub(crate) use direct::Sums;
pub use packed::{Covariance, Covariance15};
pub(crate) use panel::Six;
pub(crate) use sequence::each_row;
pub(crate) use update::{Lines, Pattern, Slots};
pub use update::{Observation, Rows, Update};
