//! P Hᵀ and H P Hᵀ of rows that are not just states of one block, spelled out for 15 states.

use super::packed::{at, column, Covariance};
use super::sequence::{all_zero, each_row};
use crate::linalg::{each_state, in_order, Real};
use nalgebra::SMatrix;

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// P Hᵀ and H P Hᵀ of direct rows from any state on; zeros where there is no such state.
    #[inline(always)]
    pub(super) fn direct_panel<const M: usize>(
        &self,
        first: usize,
        c: &mut [[T; N]; M],
    ) -> [[T; M]; M] {
        let mut hph = [[T::zero(); M]; M];
        for (m, c) in c.iter_mut().enumerate() {
            *c = if first + m < N {
                column::<T, N>(&self.hi, first + m)
            } else {
                [T::zero(); N]
            };
            for (g, c) in hph.iter_mut().zip(c.iter().skip(first)) {
                g[m] = *c;
            }
        }
        hph
    }

    /// P Hᵀ, and H P Hᵀ on and below its diagonal, of any rows. A 3×3 block of zeros in H costs little.
    #[inline(always)]
    pub(super) fn dense_panel<const M: usize>(
        &self,
        h: &SMatrix<T, M, N>,
        unit: &[T; N],
        c: &mut [[T; N]; M],
    ) -> [[T; M]; M] {
        let zero = T::zero();
        for c in c.iter_mut() {
            macro_rules! one {
                ($i:literal) => {
                    c[$i] = zero;
                };
            }
            each_state!(one);
        }
        let mut hph = [[zero; M]; M];
        let columns = &h.data.0;
        let mut seen = [false; 5];
        macro_rules! panel {
            ($b:literal) => {
                let [x, y, z] = [&columns[3 * $b], &columns[3 * $b + 1], &columns[3 * $b + 2]];
                let u = [unit[3 * $b], unit[3 * $b + 1], unit[3 * $b + 2]];
                let (x3, x1) = x.as_chunks::<3>();
                let (y3, y1) = y.as_chunks::<3>();
                let (z3, z1) = z.as_chunks::<3>();
                let (c3, c1) = c.as_chunks_mut::<3>();
                for (((c, x), y), z) in c3.iter_mut().zip(x3).zip(y3).zip(z3) {
                    seen[$b] |= self.add_rows::<3, $b>(c, [x, y, z], &u);
                }
                let rest = c1.iter_mut().zip(x1).zip(y1).zip(z1);
                for (((c, x), y), z) in rest {
                    let h = [&[*x], &[*y], &[*z]];
                    seen[$b] |= self.add_rows::<1, $b>(core::array::from_mut(c), h, &u);
                }
            };
        }
        panel!(0);
        panel!(1);
        panel!(2);
        panel!(3);
        panel!(4);
        macro_rules! inner {
            ($b:literal) => {
                if seen[$b] {
                    let u = [unit[3 * $b], unit[3 * $b + 1], unit[3 * $b + 2]];
                    let [x, y, z] = [&columns[3 * $b], &columns[3 * $b + 1], &columns[3 * $b + 2]];
                    each_row!(n; if !all_zero(&[x[n], y[n], z[n]]) {
                        let (x, y, z) = (x[n] * u[0], y[n] * u[1], z[n] * u[2]);
                        each_row!(m; if m <= n {
                            hph[n][m] += x * c[m][3 * $b] + y * c[m][3 * $b + 1] + z * c[m][3 * $b + 2];
                        });
                    });
                }
            };
        }
        inner!(0);
        inner!(1);
        inner!(2);
        inner!(3);
        inner!(4);
        hph
    }

    /// c ← c + P h for rows whose elements of block B are h[0], h[1] and h[2] times `unit`; whether there are any.
    #[inline(always)]
    fn add_rows<const M: usize, const B: usize>(
        &self,
        c: &mut [[T; N]; M],
        h: [&[T; M]; 3],
        unit: &[T; 3],
    ) -> bool {
        if all_zero(h[0]) && all_zero(h[1]) && all_zero(h[2]) {
            return false;
        }
        let (x, y, z) = (
            h[0].map(|h| h * unit[0]),
            h[1].map(|h| h * unit[1]),
            h[2].map(|h| h * unit[2]),
        );
        macro_rules! one {
            ($i:literal) => {
                let p = [
                    self.hi[at($i, 3 * B)],
                    self.hi[at($i, 3 * B + 1)],
                    self.hi[at($i, 3 * B + 2)],
                ];
                each_row!(m; c[m][$i] += x[m] * p[0] + y[m] * p[1] + z[m] * p[2]);
                in_order();
            };
        }
        each_state!(one);
        true
    }
}
