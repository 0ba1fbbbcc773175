//! Propagation of chains: position, velocity and acceleration of several axes.

use super::packed::{at, Covariance};
use crate::linalg::{two_add, Real};

/// Of one chain of three states, in the units of the covariance: what is not zero of Φ − I, and the noise.
///
/// ```text
///         [ 0  a  b ]        [ q0 q1 q2 ]
/// Φ − I = [ 0  0  c ]    Q = [    q3 q4 ]
///         [ 0  0  d ]        [       q5 ]
/// ```
#[derive(Clone, Copy)]
pub(crate) struct Chain<T> {
    /// a, b, c, d.
    pub a: [T; 4],
    pub q: [T; 6],
}

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// P ← Φ P Φᵀ + Q of chains whose states are `i`, `AXES + i`, `2 AXES + i`. Products in one word, sums compensated;
    /// where two chains have nothing to do with each other, nothing is done.
    #[inline(never)]
    pub(crate) fn propagate_chains<const AXES: usize>(&mut self, chains: &[Chain<T>; AXES]) {
        const { Self::SIZE };
        for (j, right) in chains.iter().enumerate() {
            for (i, left) in chains.iter().enumerate().take(j + 1) {
                self.propagate_pair::<AXES>((i, left), (j, right));
            }
        }
    }

    /// The covariances of chain i with chain j.
    #[inline(always)]
    fn propagate_pair<const AXES: usize>(
        &mut self,
        (i, left): (usize, &Chain<T>),
        (j, right): (usize, &Chain<T>),
    ) {
        let mut any = 0;
        macro_rules! p {
            ($m:literal, $n:literal) => {{
                let p = self.hi.get(at($m * AXES + i, $n * AXES + j));
                let p = p.copied().unwrap_or_else(T::zero);
                any |= p.abs().sign_word();
                p
            }};
        }
        let p = [
            [p!(0, 0), p!(0, 1), p!(0, 2)],
            [p!(1, 0), p!(1, 1), p!(1, 2)],
            [p!(2, 0), p!(2, 1), p!(2, 2)],
        ];
        if any == 0 && i != j {
            return;
        }
        // A P, and P + A P
        let ([a, b, c, d], q) = (left.a, &right.q);
        macro_rules! row {
            ($n:literal) => {
                [a * p[1][$n] + b * p[2][$n], c * p[2][$n], d * p[2][$n]]
            };
        }
        let ap = [row!(0), row!(1), row!(2)]; // ap[n][m]
        let [a, b, c, d] = right.a;
        macro_rules! add {
            ($m:literal, $n:literal, $to_right:expr, $q:expr) => {
                if $m <= $n || i != j {
                    let e = at($m * AXES + i, $n * AXES + j);
                    if let (Some(hi), Some(lo)) = (self.hi.get_mut(e), self.lo.get_mut(e)) {
                        let mut delta = ap[$n][$m] + $to_right;
                        if i == j {
                            delta += $q;
                        }
                        (*hi, *lo) = two_add(*hi, *lo, delta);
                    }
                }
            };
        }
        macro_rules! line {
            ($m:literal, $q:expr) => {
                let q: [T; 3] = $q;
                let (v, acc) = (p[$m][1] + ap[1][$m], p[$m][2] + ap[2][$m]);
                add!($m, 0, a * v + b * acc, q[0]);
                add!($m, 1, c * acc, q[1]);
                add!($m, 2, d * acc, q[2]);
            };
        }
        line!(0, [q[0], q[1], q[2]]);
        line!(1, [q[1], q[3], q[4]]);
        line!(2, [q[2], q[4], q[5]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SMatrix;

    #[test]
    fn noise_reaches_an_axis_that_is_known_exactly() {
        let chain = |q: f64| Chain {
            a: [1.0, 0.5, 1.0, -0.1],
            q: [q; 6],
        };
        let mut p = Covariance::<f64, 6, 21>::zero();
        p.propagate_chains(&[chain(1.0), chain(2.0)]);
        for i in 0..6 {
            for j in 0..6 {
                let q = if i % 2 == j % 2 {
                    1.0 + (i % 2) as f64
                } else {
                    0.0
                };
                assert_eq!(p.element(i, j), q, "({i}, {j})");
            }
        }
    }

    #[test]
    fn it_is_the_general_propagation() {
        let mut seed = 5u64;
        let mut next = move || {
            seed = seed
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let x = SMatrix::<f64, 9, 9>::from_fn(|_, _| next());
        let start = x * x.transpose() + SMatrix::identity();
        let chains = [(); 3].map(|()| Chain {
            a: [(); 4].map(|()| next()),
            q: [(); 6].map(|()| next()),
        });
        let (mut a, mut q) = (SMatrix::<f64, 9, 9>::zeros(), SMatrix::<f64, 9, 9>::zeros());
        for (i, chain) in chains.iter().enumerate() {
            let [pv, pa, va, aa] = chain.a;
            a[(i, 3 + i)] = pv;
            a[(i, 6 + i)] = pa;
            a[(3 + i, 6 + i)] = va;
            a[(6 + i, 6 + i)] = aa;
            for (k, (m, n)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
                .iter()
                .enumerate()
            {
                q[(3 * m + i, 3 * n + i)] = chain.q[k];
            }
        }
        let mut p = Covariance::<f64, 9, 45>::from_matrix(&start).unwrap();
        let mut general = p;
        p.propagate_chains(&chains);
        general.propagate_full(&a, &q);
        // numbers up to 30
        assert!((p.to_matrix() - general.to_matrix()).amax() < 1e-13);
    }
}
