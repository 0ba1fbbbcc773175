//! Propagation with any transition.

use super::column::spelled_column;
use super::packed::Covariance;
use crate::linalg::{Pair, Real};
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
    /// Sums and products are in two words throughout, and every stored element is added to once, so the result is
    /// exactly symmetric. In one word a correlation of 1e-9, what ξ1 of a state near its end is made of, would keep two
    /// digits after ten minutes; so it keeps four, and ξ2 agrees with f64 to 1e-5. Zeros of A are skipped.
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
        let mut b = const { [[Pair::<T>::ZERO; N]; N] };
        for (j, b) in b.iter_mut().enumerate() {
            let (hi, lo): ([T; N], [T; N]) =
                (spelled_column(&self.hi, j), spelled_column(&self.lo, j));
            for ((a, hi), lo) in a.column_iter().zip(hi).zip(lo) {
                for (b, a) in b.iter_mut().zip(a.iter()) {
                    if *a != T::zero() {
                        *b = b.add_product(Pair { hi, lo }, *a);
                    }
                }
            }
        }
        let mut words = self.hi.iter_mut().zip(self.lo.iter_mut());
        for (j, (b_j, a_j)) in b.iter().zip(a.row_iter()).enumerate() {
            let mut column = [T::zero(); N];
            noise(j, &mut column);
            let mut delta = const { [Pair::<T>::ZERO; N] };
            for (d, q) in delta.iter_mut().zip(column) {
                d.hi = q;
            }
            for (b_k, a_jk) in b.iter().zip(a_j.iter()) {
                if *a_jk != T::zero() {
                    for (d, b) in delta.iter_mut().zip(b_k).take(j + 1) {
                        *d = d.add_product(*b, *a_jk);
                    }
                }
            }
            let columns = delta.iter().zip(b_j).zip(&b).take(j + 1);
            for (((d, b_ij), b_i), (hi, lo)) in columns.zip(words.by_ref()) {
                let b_ji = b_i.get(j).copied().unwrap_or(Pair::ZERO);
                let p = Pair { hi: *hi, lo: *lo }.add(b_ij.add(b_ji).add(*d));
                (*hi, *lo) = (p.hi, p.lo);
            }
        }
    }
}
