//! Covariance of a linear filter: stored, propagated and updated. Knows no navigation.
//!
//! | file | holds |
//! |---|---|
//! | `packed` | [`Covariance`]: upper triangle, two words per element; how it is made and read |
//! | `general` | [`Covariance::propagate`]: any N, any dense A = Φ − I |
//! | `structured` | [`Covariance15::propagate_blocks`]: the 15-state pattern of [`crate::linalg::BlockTransition`], spelled out |
//! | `update` | [`Covariance::update`]: M rows in one sweep, each with its gate |

mod general;
mod packed;
mod structured;
mod update;

pub use packed::{Covariance, Covariance15};
pub use update::{Observation, Rows, Update};
