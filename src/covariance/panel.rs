//! P Hᵀ and H P Hᵀ of rows that are not just states of one block, spelled out for 15 states.

use super::packed::{at, column, Covariance};
use super::sequence::{all_zero, each_row};
use crate::linalg::{each_state, in_order, Real};
use nalgebra::SMatrix;

/// Six rows. Row m is −1 on state m; off the diagonals of two 3×3 blocks −`on_6[m]` on the next state but one round
/// states 6, 7, 8; rows 3, 4, 5 also −`on_9` on states 9, 10, 11. After that each three are multiplied by the inverse of
/// a unit lower triangle, of which `lower` holds (1, 0), (2, 0) and (2, 1).
///
/// An antenna on a lever arm: position, velocity, attitude, gyro bias.
pub(crate) struct Six<T> {
    /// Of row m: on state 6 + (m + 1) mod 3, and on state 6 + (m + 2) mod 3.
    pub on_6: [[T; 2]; 6],
    pub on_9: [[T; 3]; 3],
    pub lower: [[T; 3]; 2],
    /// Whether there is anything in `lower`.
    pub correlated: bool,
}

/// Rows of H, all signs turned, times a vector of which `$x!(i)` is element i.
macro_rules! six {
    ($six:ident, $x:ident) => {{
        let (a, b) = (&$six.on_6, &$six.on_9);
        let mut y = [
            $x!(0) + a[0][0] * $x!(7) + a[0][1] * $x!(8),
            $x!(1) + a[1][0] * $x!(8) + a[1][1] * $x!(6),
            $x!(2) + a[2][0] * $x!(6) + a[2][1] * $x!(7),
            $x!(3)
                + a[3][0] * $x!(7)
                + a[3][1] * $x!(8)
                + b[0][0] * $x!(9)
                + b[0][1] * $x!(10)
                + b[0][2] * $x!(11),
            $x!(4)
                + a[4][0] * $x!(8)
                + a[4][1] * $x!(6)
                + b[1][0] * $x!(9)
                + b[1][1] * $x!(10)
                + b[1][2] * $x!(11),
            $x!(5)
                + a[5][0] * $x!(6)
                + a[5][1] * $x!(7)
                + b[2][0] * $x!(9)
                + b[2][1] * $x!(10)
                + b[2][2] * $x!(11),
        ];
        if $six.correlated {
            let [p, v] = &$six.lower;
            y[1] -= p[0] * y[0];
            y[2] = y[2] - p[1] * y[0] - p[2] * y[1];
            y[4] -= v[0] * y[3];
            y[5] = y[5] - v[1] * y[3] - v[2] * y[4];
        }
        y
    }};
}

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// P Hᵀ, and H P Hᵀ on and below its diagonal, of [`Six`] with all signs turned. M is 6.
    #[inline(always)]
    pub(super) fn six_panel<const M: usize>(
        &self,
        six: &Six<T>,
        c: &mut [[T; N]; M],
    ) -> [[T; M]; M] {
        macro_rules! column {
            ($i:literal) => {
                macro_rules! p {
                    ($j:literal) => {
                        self.hi[at($i, $j)]
                    };
                }
                let y = six!(six, p);
                each_row!(m; c[m][$i] = y[m]);
                in_order();
            };
        }
        each_state!(column);
        let mut hph = const { [[T::ZERO; M]; M] };
        each_row!(m; {
            let row = &c[m];
            macro_rules! c {
                ($j:literal) => {
                    row[$j]
                };
            }
            let y = six!(six, c);
            each_row!(n; if n >= m { hph[n][m] = y[n] });
        });
        hph
    }

    /// P Hᵀ and H P Hᵀ of direct rows from any state on; zeros where there is no such state.
    #[inline(always)]
    pub(super) fn direct_panel<const M: usize>(
        &self,
        first: usize,
        c: &mut [[T; N]; M],
    ) -> [[T; M]; M] {
        let mut hph = const { [[T::ZERO; M]; M] };
        for (m, c) in c.iter_mut().enumerate() {
            *c = if first + m < N {
                column::<T, N>(&self.hi, first + m)
            } else {
                const { [T::ZERO; N] }
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
        let mut hph = const { [[T::ZERO; M]; M] };
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
