//! One row that measures a state by itself, of any number of states up to 15: one word per product, as `swift` does it
//! for 15.
//!
//! ```text
//! s = P_kk + r,   P⁺_:k = P_:k r/s,   P⁺_ij = P_ij − P_ik P_jk/s  for i, j ≠ k
//! ```
//! Nothing is subtracted where the variance falls. It writes nothing when another variance would fall to less than half,
//! or anything is not as it should be: the careful update knows what to do then.

use super::column::spelled_column;
use super::packed::{at, upper, Covariance};
use crate::linalg::{each_state, two_add, Real};

/// What the rows of a fix did together.
pub(crate) struct Sums<'a, T, const N: usize> {
    pub dx: &'a mut [T; N],
    pub decrease: &'a mut [T; N],
    pub nis: &'a mut T,
}

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// Takes in the row that is −1 on state k, ungated; whether it did. P at the start: any that was made by this room.
    #[inline(never)]
    pub(crate) fn update_state(
        &mut self,
        k: usize,
        nu: T,
        r: T,
        sums: &mut Sums<'_, T, N>,
    ) -> bool {
        const { Self::SIZE };
        if N > 15 || k >= N {
            return false;
        }
        let c = spelled_column::<T, N>(&self.hi, k);
        // not c[k], so that c may live in registers
        let p = self.hi.get(upper(k, k)).copied().unwrap_or_else(T::zero);
        let s = p + r;
        let inverse = T::one() / s;
        let nis = nu * nu * inverse;
        if !(r > T::zero() && s >= r && nis.finite()) {
            return false;
        }
        // what is left of each variance less what is taken: its own is multiplied, and counts as unhurt
        let (mut signs, mut total) = (0, T::zero());
        macro_rules! check {
            ($i:literal) => {
                if $i < N {
                    let d = c[$i] * (c[$i] * inverse);
                    let left = self.hi[upper($i, $i)] - d - d;
                    signs |= if $i == k { 0 } else { left.sign_word() };
                    total += left;
                }
            };
        }
        each_state!(check);
        if signs >> 31 != 0 || !total.finite() {
            return false;
        }
        let gain = -(nu * inverse);
        macro_rules! sweep {
            ($j:literal) => {
                // a state that has nothing to do with k: most of those of another axis
                if $j < N && c[$j] != T::zero() {
                    let g = c[$j] * inverse;
                    sums.dx[$j] += c[$j] * gain;
                    sums.decrease[$j] += c[$j] * g;
                    macro_rules! one {
                        ($i:literal) => {
                            if $i <= $j && $i < N {
                                let e = upper($i, $j);
                                (self.hi[e], self.lo[e]) =
                                    two_add(self.hi[e], self.lo[e], -(c[$i] * g));
                            }
                        };
                    }
                    each_state!(one);
                }
            };
        }
        each_state!(sweep);
        *sums.nis += nis;
        let shrink = inverse * r;
        macro_rules! own {
            ($i:literal) => {
                if $i < N {
                    let e = at($i, k);
                    if let (Some(hi), Some(lo)) = (self.hi.get_mut(e), self.lo.get_mut(e)) {
                        (*hi, *lo) = (c[$i] * shrink, T::zero());
                    }
                }
            };
        }
        each_state!(own);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::covariance::{Observation, Rows};
    use nalgebra::{SMatrix, Vector3};

    const P: SMatrix<f64, 3, 3> =
        SMatrix::<f64, 3, 3>::new(2.0, 0.5, 0.1, 0.5, 1.0, -0.2, 0.1, -0.2, 0.7);

    /// P, δx and decrease, NIS.
    type Done = (SMatrix<f64, 3, 3>, [Vector3<f64>; 2], f64);

    /// The two kernels, and what they add to sums that stand at 1.
    fn both(k: usize, nu: f64, r: f64) -> Option<[Done; 2]> {
        let mut p = Covariance::<f64, 3, 6>::from_matrix(&P).unwrap();
        let mut careful = p;
        let (mut dx, mut decrease, mut nis) = ([1.0; 3], [1.0; 3], 1.0);
        let mut sums = Sums {
            dx: &mut dx,
            decrease: &mut decrease,
            nis: &mut nis,
        };
        if !p.update_state(k, nu, r, &mut sums) {
            assert_eq!((p, dx, decrease, nis), (careful, [1.0; 3], [1.0; 3], 1.0));
            return None;
        }
        let rows = Rows {
            nu: [nu],
            h: Observation::Direct { first: k },
            r: [r],
            gate: None,
        };
        let update = careful.update(&rows).unwrap();
        let one = Vector3::repeat(1.0);
        let sums = [
            Vector3::from(update.dx) + one,
            Vector3::from(update.decrease) + one,
        ];
        Some([
            (
                p.to_matrix(),
                [Vector3::from(dx), Vector3::from(decrease)],
                nis,
            ),
            (careful.to_matrix(), sums, update.nis + 1.0),
        ])
    }

    #[test]
    fn it_is_the_careful_update() {
        for (k, r) in [(0, 0.3), (1, 1e-9), (2, 5.0)] {
            let [(p, [dx, decrease], nis), (careful, sums, of_careful)] = both(k, 0.3, r).unwrap();
            for (a, b) in p.iter().zip(careful.iter()) {
                // of a variance of 1e-9 relative to it
                assert!((a - b).abs() < 1e-13 * b.abs(), "{k}: {a} {b}");
            }
            assert!((dx - sums[0]).amax() < 1e-14 && (decrease - sums[1]).amax() < 1e-14);
            assert!((nis - of_careful).abs() < 1e-12);
        }
    }

    #[test]
    fn what_it_does_not_like_it_leaves() {
        for (k, nu, r) in [
            (3, 0.1, 1.0),
            (0, f64::NAN, 1.0),
            (0, 0.1, 0.0),
            (0, 0.1, f64::NAN),
        ] {
            assert!(both(k, nu, r).is_none(), "{k} {nu} {r}");
        }
        // the variance of state 1 would fall to a hundredth
        let mut p = Covariance::<f64, 2, 3>::from_matrix(&SMatrix::<f64, 2, 2>::new(
            1.0, 0.995, 0.995, 1.0,
        ))
        .unwrap();
        let before = p;
        let mut sums = Sums {
            dx: &mut [0.0; 2],
            decrease: &mut [0.0; 2],
            nis: &mut 0.0,
        };
        assert!(!p.update_state(0, 0.1, 1e-6, &mut sums));
        assert_eq!(p, before);
    }
}
