//! Propagation with the block pattern of the 15-state filter, spelled out.
//!
//! The 3×3 blocks are written by macro, not by loops: the instruction count is then the same at opt-level "s" and 3,
//! where a loop-written kernel loses a factor of 3 to 8.

use super::packed::{at, Covariance15};
use crate::linalg::{two_add, BlockTransition, Real};
use nalgebra::{Matrix3, Vector3};

/// A 3×3 block, `x[row][column]`.
type Block<T> = [[T; 3]; 3];

/// The nine elements of a block, `I` and `J` being constants in the expression.
macro_rules! nine {
    ($i:ident, $j:ident => $e:expr) => {{
        macro_rules! element {
            ($row:literal, $column:literal) => {{
                const $i: usize = $row;
                const $j: usize = $column;
                $e
            }};
        }
        [
            [element!(0, 0), element!(0, 1), element!(0, 2)],
            [element!(1, 0), element!(1, 1), element!(1, 2)],
            [element!(2, 0), element!(2, 1), element!(2, 2)],
        ]
    }};
}

/// Element (i, j) of a matrix, by constants: no bounds check is left.
macro_rules! of {
    ($a:ident, $i:expr, $j:expr) => {
        $a.data.0[$j][$i]
    };
}

/// Block (A, B) of a packed triangle.
#[inline(always)]
fn block<T: Real, const A: usize, const B: usize>(p: &[T; 120]) -> Block<T> {
    nine!(I, J => p[at(3 * A + I, 3 * B + J)])
}

#[inline(always)]
fn transposed<T: Real>(x: &Block<T>) -> Block<T> {
    nine!(I, J => x[J][I])
}

#[inline(always)]
fn sum<T: Real>(x: &Block<T>, y: &Block<T>) -> Block<T> {
    nine!(I, J => x[I][J] + y[I][J])
}

/// a x
#[inline(always)]
fn scaled<T: Real>(a: T, x: &Block<T>) -> Block<T> {
    nine!(I, J => a * x[I][J])
}

/// t + a x
#[inline(always)]
fn plus_scaled<T: Real>(t: &Block<T>, a: T, x: &Block<T>) -> Block<T> {
    nine!(I, J => t[I][J] + a * x[I][J])
}

/// t + A x, A full.
#[inline(always)]
fn full<T: Real>(t: &Block<T>, a: &Matrix3<T>, x: &Block<T>) -> Block<T> {
    nine!(I, J => t[I][J] + of!(a, I, 0) * x[0][J] + of!(a, I, 1) * x[1][J] + of!(a, I, 2) * x[2][J])
}

/// A x, A without its diagonal.
#[inline(always)]
fn hollow0<T: Real>(a: &Matrix3<T>, x: &Block<T>) -> Block<T> {
    nine!(I, J => of!(a, I, (I + 1) % 3) * x[(I + 1) % 3][J] + of!(a, I, (I + 2) % 3) * x[(I + 2) % 3][J])
}

/// t + A x, A without its diagonal.
#[inline(always)]
fn hollow<T: Real>(t: &Block<T>, a: &Matrix3<T>, x: &Block<T>) -> Block<T> {
    nine!(I, J => t[I][J]
        + of!(a, I, (I + 1) % 3) * x[(I + 1) % 3][J]
        + of!(a, I, (I + 2) % 3) * x[(I + 2) % 3][J])
}

/// t + diag(a) x
#[inline(always)]
fn diagonal<T: Real>(t: &Block<T>, a: &Vector3<T>, x: &Block<T>) -> Block<T> {
    nine!(I, J => t[I][J] + of!(a, I, 0) * x[I][J])
}

/// t + x Aᵀ, A full.
#[inline(always)]
fn times_full<T: Real>(t: &Block<T>, x: &Block<T>, a: &Matrix3<T>) -> Block<T> {
    nine!(I, J => t[I][J] + x[I][0] * of!(a, J, 0) + x[I][1] * of!(a, J, 1) + x[I][2] * of!(a, J, 2))
}

/// t + x Aᵀ, A without its diagonal.
#[inline(always)]
fn times_hollow<T: Real>(t: &Block<T>, x: &Block<T>, a: &Matrix3<T>) -> Block<T> {
    nine!(I, J => t[I][J]
        + x[I][(J + 1) % 3] * of!(a, J, (J + 1) % 3)
        + x[I][(J + 2) % 3] * of!(a, J, (J + 2) % 3))
}

/// t + x diag(a)
#[inline(always)]
fn times_diagonal<T: Real>(t: &Block<T>, x: &Block<T>, a: &Vector3<T>) -> Block<T> {
    nine!(I, J => t[I][J] + x[I][J] * of!(a, J, 0))
}

/// Adds noise number 3·K … 3·K + 2 to the diagonal.
#[inline(always)]
fn noise<T: Real, const K: usize>(t: &mut Block<T>, q: &[T; 12]) {
    t[0][0] += q[3 * K];
    t[1][1] += q[3 * K + 1];
    t[2][2] += q[3 * K + 2];
}

impl<T: Real> Covariance15<T> {
    /// Adds to block (A, B), compensated; of a diagonal block, to its upper half.
    #[inline(always)]
    fn add_block<const A: usize, const B: usize>(&mut self, d: &Block<T>) {
        let _ = nine!(I, J => if A != B || I <= J {
            let k = at(3 * A + I, 3 * B + J);
            (self.hi[k], self.lo[k]) = two_add(self.hi[k], self.lo[k], d[I][J]);
        });
    }

    /// Block (A, B) in two words that are cut elsewhere than those in store: the first differs from the high word by up
    /// to an eighth, as the low word has it, and the second holds all that is left.
    ///
    /// A covariance that stands still for thousands of steps gives every product the same rounding error, and the
    /// errors of a row add up to a drift. Cut by the low word, which moves with every addition, they scatter and
    /// average out. Exact for f32: h + l is the stored sum but for the rounding of l. Read where a velocity meets what
    /// two states that hide each other, tilt and accelerometer bias, tell it: in columns r, ψ and b_a.
    #[inline(always)]
    fn recut<const A: usize, const B: usize>(&self) -> (Block<T>, Block<T>) {
        let (p, low) = (block::<T, A, B>(&self.hi), block::<T, A, B>(&self.lo));
        let h = nine!(I, J => p[I][J] + low[I][J] * T::CUT);
        let l = nine!(I, J => (p[I][J] - h[I][J]) + low[I][J]);
        (h, l)
    }

    /// As [`Covariance15::propagate`], for a transition of the pattern of [`BlockTransition`].
    pub fn propagate_blocks(&mut self, t: &BlockTransition<T>) {
        let b12 = self.row_1::<2>(t);
        let b14 = self.row_1::<4>(t);
        let b11 = self.row_1::<1>(t);
        let b10 = self.row_1::<0>(t);
        let b03 = self.row_0::<3>(t);
        let q03 = sum(&block::<T, 0, 3>(&self.hi), &b03);
        let b13 = self.row_1::<3>(t);
        self.add_block::<0, 3>(&plus_scaled(&b03, t.a33, &q03));
        let q13 = sum(&block::<T, 1, 3>(&self.hi), &b13);
        self.add_block::<1, 3>(&plus_scaled(&b13, t.a33, &q13));
        let b04 = self.row_0::<4>(t);
        let q04 = sum(&block::<T, 0, 4>(&self.hi), &b04);
        self.add_block::<0, 4>(&plus_scaled(&b04, t.a44, &q04));
        let q14 = sum(&block::<T, 1, 4>(&self.hi), &b14);
        self.add_block::<1, 4>(&plus_scaled(&b14, t.a44, &q14));
        let b02 = self.row_0::<2>(t);
        let q02 = sum(&block::<T, 0, 2>(&self.hi), &b02);
        let d = times_hollow(&b02, &q02, &t.a22);
        self.add_block::<0, 2>(&times_full(&d, &q03, &t.a23));
        let q12 = sum(&block::<T, 1, 2>(&self.hi), &b12);
        let d = times_hollow(&b12, &q12, &t.a22);
        self.add_block::<1, 2>(&times_full(&d, &q13, &t.a23));
        let b00 = self.row_0::<0>(t);
        let b01 = self.row_0::<1>(t);
        let d = sum(&b00, &transposed(&b00));
        self.add_block::<0, 0>(&times_diagonal(
            &times_hollow(&d, &b00, &t.a00),
            &b01,
            &t.a01,
        ));
        let d = times_diagonal(&sum(&b01, &transposed(&b10)), &b00, &t.a10);
        let d = times_hollow(&times_hollow(&d, &b01, &t.a11), &b02, &t.a12);
        self.add_block::<0, 1>(&times_full(&d, &b04, &t.a14));
        let d = times_diagonal(&sum(&b11, &transposed(&b11)), &b10, &t.a10);
        let d = times_hollow(&times_hollow(&d, &b11, &t.a11), &b12, &t.a12);
        let mut d = times_full(&d, &b14, &t.a14);
        noise::<T, 0>(&mut d, &t.q);
        self.add_block::<1, 1>(&d);
        self.rows_2(t);
        self.rows_3_4(t);
    }

    #[inline(always)]
    fn row_0<const B: usize>(&self, t: &BlockTransition<T>) -> Block<T> {
        let p = &self.hi;
        diagonal(
            &hollow0(&t.a00, &block::<T, 0, B>(p)),
            &t.a01,
            &block::<T, 1, B>(p),
        )
    }
    #[inline(always)]
    fn row_1<const B: usize>(&self, t: &BlockTransition<T>) -> Block<T> {
        let p = &self.hi;
        let x = if B == 2 || B == 4 || B == 0 {
            let (h2, l2) = self.recut::<2, B>();
            let (h4, l4) = self.recut::<4, B>();
            let y = full(&hollow0(&t.a12, &h2), &t.a14, &h4);
            full(&hollow(&y, &t.a12, &l2), &t.a14, &l4)
        } else {
            full(
                &hollow0(&t.a12, &block::<T, 2, B>(p)),
                &t.a14,
                &block::<T, 4, B>(p),
            )
        };
        let x = hollow(&x, &t.a11, &block::<T, 1, B>(p));
        diagonal(&x, &t.a10, &block::<T, 0, B>(p))
    }
    #[inline(always)]
    fn rows_2(&mut self, t: &BlockTransition<T>) {
        let p = &self.hi;
        let (p22, p23, p24) = (
            block::<T, 2, 2>(p),
            block::<T, 2, 3>(p),
            block::<T, 2, 4>(p),
        );
        let b22 = full(&hollow0(&t.a22, &p22), &t.a23, &transposed(&p23));
        let b23 = full(&hollow0(&t.a22, &p23), &t.a23, &block::<T, 3, 3>(p));
        let b24 = full(&hollow0(&t.a22, &p24), &t.a23, &block::<T, 3, 4>(p));
        let d = sum(&b22, &transposed(&b22));
        let mut d = times_full(&times_hollow(&d, &b22, &t.a22), &b23, &t.a23);
        noise::<T, 1>(&mut d, &t.q);
        self.add_block::<2, 2>(&d);
        self.add_block::<2, 3>(&plus_scaled(&b23, t.a33, &sum(&p23, &b23)));
        self.add_block::<2, 4>(&plus_scaled(&b24, t.a44, &sum(&p24, &b24)));
    }

    #[inline(always)]
    fn rows_3_4(&mut self, t: &BlockTransition<T>) {
        let two = T::one() + T::one();
        let mut d = scaled(t.a33 * (two + t.a33), &block::<T, 3, 3>(&self.hi));
        noise::<T, 2>(&mut d, &t.q);
        self.add_block::<3, 3>(&d);
        let both = t.a33 + t.a44 * (T::one() + t.a33);
        self.add_block::<3, 4>(&scaled(both, &block::<T, 3, 4>(&self.hi)));
        let mut d = scaled(t.a44 * (two + t.a44), &block::<T, 4, 4>(&self.hi));
        noise::<T, 3>(&mut d, &t.q);
        self.add_block::<4, 4>(&d);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SMatrix;

    /// Some well-conditioned covariance and a transition with every allowed entry set, from a linear congruence.
    fn some() -> (SMatrix<f64, 15, 15>, BlockTransition<f64>) {
        let mut seed = 7u64;
        let mut next = move || {
            seed = seed
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let x = SMatrix::<f64, 15, 15>::from_fn(|_, _| next());
        let p = x * x.transpose() / 15.0 + SMatrix::identity() * 0.1;
        let t = BlockTransition {
            a00: Matrix3::from_fn(|_, _| next()),
            a01: Vector3::from_fn(|_, _| next()),
            a10: Vector3::from_fn(|_, _| next()),
            a11: Matrix3::from_fn(|_, _| next()),
            a12: Matrix3::from_fn(|_, _| next()),
            a14: Matrix3::from_fn(|_, _| next()),
            a22: Matrix3::from_fn(|_, _| next()),
            a23: Matrix3::from_fn(|_, _| next()),
            a33: next(),
            a44: next(),
            q: [(); 12].map(|()| next().abs()),
        };
        (p, t)
    }

    #[test]
    fn every_entry_of_the_pattern_is_used_once() {
        let (p0, t) = some();
        let phi = SMatrix::identity() + t.dense();
        let dense = phi * p0 * phi.transpose() + SMatrix::from_diagonal(&t.noise());
        let mut p = Covariance15::from_matrix(&p0).unwrap();
        p.propagate_blocks(&t);
        // entries of order 10, about 30 products each
        assert!((p.to_matrix() - dense).amax() < 1e-13);
        let mut g = Covariance15::from_matrix(&p0).unwrap();
        g.propagate(&t.dense(), &t.noise());
        assert!((g.to_matrix() - dense).amax() < 1e-13);
    }
}
