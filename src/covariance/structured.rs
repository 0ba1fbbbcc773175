//! Propagation with the block pattern of the 15-state filter.

use super::packed::Covariance15;
use crate::linalg::{BlockTransition, Real};

impl<T: Real> Covariance15<T> {
    /// As [`Covariance15::propagate`], for a transition of the pattern of [`BlockTransition`].
    pub fn propagate_blocks(&mut self, t: &BlockTransition<T>) {
        self.propagate(&t.dense(), &t.noise());
    }
}
