//! Propagation with any transition.

use super::packed::Covariance;
use crate::linalg::{two_add, Real};
use nalgebra::{SMatrix, SVector};

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// Carries the covariance over one step: P ← Φ P Φᵀ + Q with Φ = I + A, as
    ///
    /// ```text
    /// B = A P,   P ← P + (B + (P + B) Aᵀ + Q)
    /// ```
    ///
    /// * `a` — A = Φ − I of any order, in the units of P. Never formed as 1 + small, so that a rate of 1e-6 per step
    ///   keeps all its digits.
    /// * `q` — diagonal of the noise added over the step.
    ///
    /// Every stored element is added once, compensated, so the result is exactly symmetric. Zeros in `a` are skipped.
    /// Nothing is checked here: A and Q come from the caller's model, and [`Covariance::update`] refuses a P that is
    /// broken.
    pub fn propagate(&mut self, a: &SMatrix<T, N, N>, q: &SVector<T, N>) {
        self.propagate_with(a, |j, column| {
            if let (Some(e), Some(q)) = (column.get_mut(j), q.get(j)) {
                *e += *q;
            }
        });
    }

    /// As [`Covariance::propagate`] with a full symmetric Q, of which the upper triangle is read.
    pub fn propagate_full(&mut self, a: &SMatrix<T, N, N>, q: &SMatrix<T, N, N>) {
        self.propagate_with(a, |j, column| {
            for (e, q) in column.iter_mut().zip(q.column(j).iter()).take(j + 1) {
                *e += *q;
            }
        });
    }

    /// The step, with the noise of column j added by `noise(j, column)`.
    #[inline(always)]
    fn propagate_with(&mut self, a: &SMatrix<T, N, N>, noise: impl Fn(usize, &mut [T; N])) {
        const { Self::SIZE };
        // b[j] is column j of B = A P
        let mut j = 0;
        let b = [(); N].map(|()| {
            let column = product(a, &self.column(j));
            j += 1;
            column
        });
        let mut k = 0;
        for j in 0..N {
            // element (j, i) of what is added; of P nothing is read here that has been written already
            let b_j = b.map(|column| column.get(j).copied().unwrap_or_else(T::zero));
            let mut row = self.column(j);
            for (x, b) in row.iter_mut().zip(&b_j) {
                *x += *b;
            }
            let mut delta = product(a, &row);
            noise(j, &mut delta);
            let words = self.hi.iter_mut().zip(self.lo.iter_mut()).skip(k);
            for ((hi, lo), (d, b)) in words.zip(delta.iter().zip(&b_j).take(j + 1)) {
                (*hi, *lo) = two_add(*hi, *lo, *d + *b);
            }
            k += j + 1;
        }
    }
}

/// A x, zeros of A skipped.
#[inline(always)]
fn product<T: Real, const N: usize>(a: &SMatrix<T, N, N>, x: &[T; N]) -> [T; N] {
    let mut y = [T::zero(); N];
    for (column, x) in a.column_iter().zip(x) {
        for (y, a) in y.iter_mut().zip(column.iter()) {
            if *a != T::zero() {
                *y += *a * *x;
            }
        }
    }
    y
}
