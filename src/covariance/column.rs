//! Columns and the diagonal, spelled out for up to 15 states: at opt-level "s" [`column`] is a loop of twice the
//! instructions.

use super::packed::{column, upper, Covariance};
use crate::linalg::{each_state, Real};

/// Column k of the symmetric matrix of which `words` is the packed triangle, as [`column`].
#[inline(always)]
pub(super) fn spelled_column<T: Real, const N: usize>(words: &[T], k: usize) -> [T; N] {
    if N > 15 {
        return column(words, k);
    }
    let mut c = const { [T::ZERO; N] };
    // from place to place; `packed::at` of each would be kept for those who write the column back, on the stack
    let mut e = upper(0, k);
    macro_rules! one {
        ($i:literal) => {
            if $i < N {
                if $i > 0 {
                    e += if $i < k + 1 { 1 } else { $i };
                }
                if let Some(p) = words.get(e) {
                    c[$i] = *p;
                }
            }
        };
    }
    each_state!(one);
    c
}

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// Holds at compile time where a kernel is spelled out.
    const SPELLED: () = assert!(N <= 15, "more states than are spelled out");

    /// Adds to `shares` what one row by itself would take of each variance: c²/(s p) with c = P h, s = hᵀ c + r.
    ///
    /// A zero in the row costs four instructions, anything else 130.
    #[inline(never)]
    pub(crate) fn add_shares(&self, h: &[T; N], r: T, shares: &mut [T; N]) {
        const { Self::SPELLED };
        let mut c = const { [T::ZERO; N] };
        for (j, h) in h.iter().enumerate() {
            if *h != T::zero() {
                let p = spelled_column::<T, N>(&self.hi, j);
                macro_rules! one {
                    ($i:literal) => {
                        if $i < N {
                            c[$i] += p[$i] * *h;
                        }
                    };
                }
                each_state!(one);
            }
        }
        let mut s = r;
        macro_rules! add {
            ($i:literal) => {
                if $i < N {
                    s += h[$i] * c[$i];
                }
            };
        }
        each_state!(add);
        macro_rules! share {
            ($i:literal) => {
                if $i < N {
                    let sp = s * self.hi[upper($i, $i)];
                    if sp > T::zero() {
                        shares[$i] += c[$i] * c[$i] / sp;
                    }
                }
            };
        }
        each_state!(share);
    }

    /// All variances, written where they are wanted.
    #[inline(always)]
    pub(crate) fn variances_into(&self, to: &mut [T; N]) {
        const { Self::SIZE };
        macro_rules! one {
            ($i:literal) => {
                if $i < N {
                    to[$i] = self.hi[upper($i, $i)];
                }
            };
        }
        each_state!(one);
        if N > 15 {
            *to = self.diagonal();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{SMatrix, SVector};

    #[test]
    fn it_is_the_share_of_an_update() {
        let x = SMatrix::<f64, 5, 5>::from_fn(|i, j| ((3 * i + 7 * j) % 11) as f64 - 4.0);
        let p = x * x.transpose() + SMatrix::identity();
        let packed = Covariance::<f64, 5, 15>::from_matrix(&p).unwrap();
        for h in [[0.0, 0.0, -1.0, 0.0, 0.0], [0.5, -2.0, 0.0, 1.0, 3.0]] {
            let mut shares = [1.0; 5];
            packed.add_shares(&h, 0.3, &mut shares);
            let h = SVector::from(h);
            let c = p * h;
            let s = h.dot(&c) + 0.3;
            for (i, share) in shares.iter().enumerate() {
                let left = p[(i, i)] - c[i] * c[i] / s;
                // shares are below 1
                assert!((share - 1.0 - (1.0 - left / p[(i, i)])).abs() < 1e-14);
            }
        }
        let mut variances = [0.0; 5];
        packed.variances_into(&mut variances);
        assert_eq!(variances, packed.diagonal());
    }
}
