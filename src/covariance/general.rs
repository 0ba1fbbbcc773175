//! Propagation with any transition.

use super::packed::{column, Covariance};
use crate::linalg::{two_add, Real};
use nalgebra::{SMatrix, SVector};

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// Carries the covariance over one step: P ← Φ P Φᵀ + Q with Φ = I + A, as
    ///
    /// ```text
    /// B = A P,   P ← P + (B + Bᵀ + B Aᵀ + Q)
    /// ```
    ///
    /// * `a` — A = Φ − I of any order, in the units of P. Never formed as 1 + small, so that a rate of 1e-6 per step
    ///   keeps all its digits.
    /// * `q` — diagonal of the noise added over the step.
    ///
    /// Every stored element is added once, compensated, so the result is exactly symmetric. B is formed once and used
    /// for both A P and P Aᵀ, low words included: where two states all but cancel in it (a tilt and the accelerometer
    /// bias that hides it), two separate roundings would leave their difference behind. Zeros of A are skipped.
    ///
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
            let mut b = [T::zero(); N];
            add_product(&mut b, a, &column(&self.hi, j));
            let mut low = [T::zero(); N];
            add_product(&mut low, a, &column(&self.lo, j));
            b.iter_mut().zip(&low).for_each(|(b, low)| *b += *low);
            j += 1;
            b
        });
        let mut words = self.hi.iter_mut().zip(self.lo.iter_mut());
        for (j, (b_j, a_j)) in b.iter().zip(a.row_iter()).enumerate() {
            let mut delta = [T::zero(); N];
            for (b_k, a_jk) in b.iter().zip(a_j.iter()) {
                if *a_jk != T::zero() {
                    delta
                        .iter_mut()
                        .zip(b_k)
                        .for_each(|(d, b)| *d += *a_jk * *b);
                }
            }
            for ((d, b_ij), b_i) in delta.iter_mut().zip(b_j).zip(&b) {
                *d += *b_ij + b_i.get(j).copied().unwrap_or_else(T::zero);
            }
            noise(j, &mut delta);
            for (d, (hi, lo)) in delta.iter().take(j + 1).zip(words.by_ref()) {
                (*hi, *lo) = two_add(*hi, *lo, *d);
            }
        }
    }
}

/// y ← y + A x, zeros of A skipped.
#[inline(always)]
fn add_product<T: Real, const N: usize>(y: &mut [T; N], a: &SMatrix<T, N, N>, x: &[T; N]) {
    for (column, x) in a.column_iter().zip(x) {
        for (y, a) in y.iter_mut().zip(column.iter()) {
            if *a != T::zero() {
                *y += *a * *x;
            }
        }
    }
}
