//! The rows of Q, block by block, in the units of a form.

use nalgebra::SMatrix;

use crate::linalg::Real;
use crate::observability::vector;

/// Units in which Q is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Form<T, const N: usize, const M: usize> {
    /// What counts as 1 of each state: σ0, or 1.
    pub state: [T; N],
    /// What counts as 1 of each row: the standard deviation of its noise, or 1.
    pub row: [T; M],
    /// T of the weight Tᵏ/k! of block k [s]; `None`: no weight.
    pub interval: Option<T>,
    /// Blocks of Q: orders 0 … blocks − 1. N by default.
    pub blocks: usize,
}

impl<T: Real, const N: usize, const M: usize> Form<T, N, M> {
    /// Q as the paper has it. Its λ depend on the units of the states: fit for comparing with print, and for systems
    /// with one unit.
    pub fn raw() -> Self {
        Self {
            state: [T::one(); N],
            row: [T::one(); M],
            interval: None,
            blocks: N,
        }
    }

    /// States by σ0, rows by their noise, block k by Tᵏ/k!: λ is a ratio of information to prior.
    pub fn scaled(sigma0: [T; N], row_sigma: [T; M], interval: T) -> Self {
        Self {
            state: sigma0,
            row: row_sigma,
            interval: Some(interval),
            blocks: N,
        }
    }
}

/// Rows H Fᵏ of one order, weighted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blocks<T, const N: usize, const M: usize> {
    pub rows: [[T; N]; M],
    pub order: u8,
}

impl<T: Real, const N: usize, const M: usize> Blocks<T, N, M> {
    /// Order 0: the rows of H.
    pub fn start(h: &SMatrix<T, M, N>, form: &Form<T, N, M>) -> Self {
        let mut rows = [[T::zero(); N]; M];
        for ((row, source), sigma) in rows.iter_mut().zip(h.row_iter()).zip(&form.row) {
            for ((x, entry), unit) in row.iter_mut().zip(source.iter()).zip(&form.state) {
                *x = *entry * *unit / *sigma;
            }
        }
        Self { rows, order: 0 }
    }

    /// Row `m` of the next order; true after the last row, when the block is complete.
    pub fn advance(&mut self, m: usize, f: &SMatrix<T, N, N>, form: &Form<T, N, M>) -> bool {
        let order = self.order.saturating_add(1);
        let weight = form
            .interval
            .map_or(T::one(), |t| t / T::of(f64::from(order)));
        if let Some(row) = self.rows.get_mut(m) {
            *row = vector::times(row, &form.state, f);
            vector::combine(row, &form.state, |x, unit| x * weight * unit);
        }
        let complete = m + 1 >= M;
        if complete {
            self.order = order;
        }
        complete
    }
}
