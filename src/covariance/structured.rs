//! Propagation with the block pattern of the 15-state filter, spelled out.
//!
//! The products are written by macro, not by loops: the instruction count is then the same at opt-level "s" and 3,
//! where a loop-written kernel loses a factor of 3 to 8.
//!
//! Three elements are formed and stored before the next three are looked at, and the blocks of A P live in an array: a
//! compiler that sees more at once forms several blocks before it stores one, and has no registers for them.

use core::hint::black_box;
use core::mem::MaybeUninit;

use super::packed::{at, Covariance15};
use crate::linalg::{in_order, two_add, BlockTransition, Real};
use nalgebra::{Matrix3, Vector3};

/// A row or a column of a 3×3 block.
type Line<T> = [T; 3];
/// A 3×3 block, column after column.
type Block<'a, T> = [&'a mut Line<T>; 3];
/// Room for one.
type Room<T> = [MaybeUninit<Line<T>>; 3];
/// From an element of P on as far as the last of its block, where that is one of the last three columns of blocks.
type Part<T> = [T; 30];

/// Element (i, j) of a matrix, by constants: no bounds check is left.
macro_rules! of {
    ($a:expr, $i:expr, $j:expr) => {
        $a.data.0[$j][$i]
    };
}

/// A block for the constant 0, then 1, then 2. What one of them reads and writes comes before the next.
macro_rules! each {
    ($k:ident => $e:block) => {
        each!(0, $k, $e);
        each!(1, $k, $e);
        each!(2, $k, $e);
    };
    ($n:literal, $k:ident, $e:block) => {{
        const $k: usize = $n;
        $e
        in_order();
    }};
}

/// A block written into its room, column J by this expression.
macro_rules! block {
    ($room:ident; $j:ident => $e:block) => {{
        let [a, b, c] = $room;
        [
            block!(0, $j, a, $e),
            block!(1, $j, b, $e),
            block!(2, $j, c, $e),
        ]
    }};
    ($n:literal, $j:ident, $room:ident, $e:block) => {{
        const $j: usize = $n;
        let column = $room.write($e);
        in_order();
        column
    }};
}

/// A x, A without its diagonal.
#[inline(always)]
fn hollow0<T: Real>(a: &Matrix3<T>, x: Line<T>) -> Line<T> {
    [
        of!(a, 0, 1) * x[1] + of!(a, 0, 2) * x[2],
        of!(a, 1, 2) * x[2] + of!(a, 1, 0) * x[0],
        of!(a, 2, 0) * x[0] + of!(a, 2, 1) * x[1],
    ]
}

/// t + A x, A without its diagonal.
#[inline(always)]
fn hollow<T: Real>(t: Line<T>, a: &Matrix3<T>, x: Line<T>) -> Line<T> {
    [
        t[0] + of!(a, 0, 1) * x[1] + of!(a, 0, 2) * x[2],
        t[1] + of!(a, 1, 2) * x[2] + of!(a, 1, 0) * x[0],
        t[2] + of!(a, 2, 0) * x[0] + of!(a, 2, 1) * x[1],
    ]
}

/// t + A x, A full.
#[inline(always)]
fn full<T: Real>(t: Line<T>, a: &Matrix3<T>, x: Line<T>) -> Line<T> {
    [
        t[0] + of!(a, 0, 0) * x[0] + of!(a, 0, 1) * x[1] + of!(a, 0, 2) * x[2],
        t[1] + of!(a, 1, 0) * x[0] + of!(a, 1, 1) * x[1] + of!(a, 1, 2) * x[2],
        t[2] + of!(a, 2, 0) * x[0] + of!(a, 2, 1) * x[1] + of!(a, 2, 2) * x[2],
    ]
}

/// t + diag(a) x
#[inline(always)]
fn diagonal<T: Real>(t: Line<T>, a: &Vector3<T>, x: Line<T>) -> Line<T> {
    [
        t[0] + of!(a, 0, 0) * x[0],
        t[1] + of!(a, 1, 0) * x[1],
        t[2] + of!(a, 2, 0) * x[2],
    ]
}

/// t + a x
#[inline(always)]
fn scaled<T: Real>(t: Line<T>, a: T, x: Line<T>) -> Line<T> {
    [t[0] + a * x[0], t[1] + a * x[1], t[2] + a * x[2]]
}

#[inline(always)]
fn sum<T: Real>(x: Line<T>, y: Line<T>) -> Line<T> {
    [x[0] + y[0], x[1] + y[1], x[2] + y[2]]
}

/// Row I of a block.
#[inline(always)]
fn row<T: Real, const I: usize>(x: &Block<T>) -> Line<T> {
    [x[0][I], x[1][I], x[2][I]]
}

/// The same block for a call: the places of its columns need no room of their own beyond it.
#[inline(always)]
fn again<'a, T>([x, y, z]: &'a mut Block<'_, T>) -> Block<'a, T> {
    [x, y, z]
}

/// Adds the noise of state 3·K + I + 3 to element I.
#[inline(always)]
fn noise<T: Real, const K: usize, const I: usize>(t: &mut Line<T>, q: &[T; 12]) {
    t[I] += q[3 * K + I];
}

/// Column J of block (A, B) of a triangle.
#[inline(always)]
fn column_of<T: Real, const A: usize, const B: usize, const J: usize>(words: &[T; 120]) -> Line<T> {
    let j = 3 * B + J;
    [
        words[at(3 * A, j)],
        words[at(3 * A + 1, j)],
        words[at(3 * A + 2, j)],
    ]
}

/// Row I of a block in the columns B.
#[inline(always)]
fn line_of<T: Real, const B: usize, const I: usize>(part: &Part<T>) -> Line<T> {
    [part[I], part[3 * B + 1 + I], part[6 * B + 3 + I]]
}

/// Adds to row I of a block in the columns B, compensated.
#[inline(always)]
fn add_line<T: Real, const B: usize, const I: usize>(
    hi: &mut Part<T>,
    lo: &mut Part<T>,
    d: Line<T>,
) {
    let (j, k) = (3 * B + 1 + I, 6 * B + 3 + I);
    (hi[I], lo[I]) = two_add(hi[I], lo[I], d[0]);
    (hi[j], lo[j]) = two_add(hi[j], lo[j], d[1]);
    (hi[k], lo[k]) = two_add(hi[k], lo[k], d[2]);
}

/// A block above the diagonal in the columns B of states that only fade: `b` of A P is added, and becomes that of P + A P.
#[inline(never)]
fn add_fading<T: Real, const B: usize>(hi: &mut Part<T>, lo: &mut Part<T>, fade: T, b: Block<T>) {
    each!(I => {
        let x = row::<T, I>(&b);
        let q = sum(line_of::<T, B, I>(hi), x);
        add_line::<T, B, I>(hi, lo, scaled(x, fade, q));
        if B == 3 {
            (b[0][I], b[1][I], b[2][I]) = (q[0], q[1], q[2]);
        }
    });
}

/// A block above the diagonal in the columns of attitude: `b` of A P, `q3` of P + A P in the columns of the gyro bias.
#[inline(never)]
fn add_attitude<T: Real>(
    hi: &mut Part<T>,
    lo: &mut Part<T>,
    t: &BlockTransition<T>,
    b: Block<T>,
    q3: Block<T>,
) {
    each!(I => {
        let x = row::<T, I>(&b);
        let q = sum(line_of::<T, 2, I>(hi), x);
        add_line::<T, 2, I>(hi, lo, full(hollow(x, &t.a22, q), &t.a23, row::<T, I>(&q3)));
    });
}

/// A line that travels in registers: the calling convention of C hands an aggregate of floats over so, and returns it so.
#[repr(C)]
struct Held<T>(Line<T>);

/// Column of A P of the velocity: those of P at attitude, accelerometer bias, velocity and position, the first two
/// with their low words.
#[inline(never)]
extern "C" fn velocity_recut<T: Real>(
    t: &BlockTransition<T>,
    p2: Held<T>,
    low2: Held<T>,
    p4: Held<T>,
    low4: Held<T>,
    p1: Held<T>,
    p0: Held<T>,
) -> Held<T> {
    let ((h2, l2), (h4, l4)) = (recut(p2.0, low2.0), recut(p4.0, low4.0));
    let x = full(hollow0(&t.a12, h2), &t.a14, h4);
    let x = full(hollow(x, &t.a12, l2), &t.a14, l4);
    Held(diagonal(hollow(x, &t.a11, p1.0), &t.a10, p0.0))
}

/// A line of P in two words that are cut elsewhere than those in store: the first differs from the high word by up to an
/// eighth, as the low word has it, and the second holds all that is left.
///
/// A covariance that stands still for thousands of steps gives every product the same rounding error, and the
/// errors of a row add up to a drift. Cut by the low word, which moves with every addition, they scatter and
/// average out. Exact for f32: h + l is the stored sum but for the rounding of l. Read where a velocity meets what
/// two states that hide each other, tilt and accelerometer bias, tell it: in columns r, ψ and b_a.
#[inline(always)]
fn recut<T: Real>(p: Line<T>, low: Line<T>) -> (Line<T>, Line<T>) {
    let h = scaled(p, T::CUT, low);
    let l = [
        (p[0] - h[0]) + low[0],
        (p[1] - h[1]) + low[1],
        (p[2] - h[2]) + low[2],
    ];
    (h, l)
}

impl<T: Real> Covariance15<T> {
    /// Column J of block (A, B).
    #[inline(always)]
    fn column<const A: usize, const B: usize, const J: usize>(&self) -> Line<T> {
        column_of::<T, A, B, J>(&self.hi)
    }

    /// Its low words.
    #[inline(always)]
    fn low<const A: usize, const B: usize, const J: usize>(&self) -> Line<T> {
        column_of::<T, A, B, J>(&self.lo)
    }

    /// Row I of block (A, B).
    #[inline(always)]
    fn line<const A: usize, const B: usize, const I: usize>(&self) -> Line<T> {
        let i = 3 * A + I;
        [
            self.hi[at(i, 3 * B)],
            self.hi[at(i, 3 * B + 1)],
            self.hi[at(i, 3 * B + 2)],
        ]
    }

    /// Adds to row I of block (A, B), compensated; of a diagonal block, to its upper half.
    #[inline(always)]
    fn add<const A: usize, const B: usize, const I: usize>(&mut self, d: Line<T>) {
        macro_rules! one {
            ($j:literal) => {
                if A != B || I <= $j {
                    let k = at(3 * A + I, 3 * B + $j);
                    (self.hi[k], self.lo[k]) = two_add(self.hi[k], self.lo[k], d[$j]);
                }
            };
        }
        one!(0);
        one!(1);
        one!(2);
    }

    /// From the first element of block (A, B) on, A < B, B one of the last three.
    #[inline(always)]
    fn part<const A: usize, const B: usize>(&mut self) -> Option<(&mut Part<T>, &mut Part<T>)> {
        let k = at(3 * A, 3 * B);
        Some((
            self.hi[k..].first_chunk_mut()?,
            self.lo[k..].first_chunk_mut()?,
        ))
    }

    /// [`add_fading`] of block (A, B).
    #[inline(always)]
    fn add_fading<const A: usize, const B: usize>(&mut self, fade: T, b: &mut Block<T>) {
        if let Some((hi, lo)) = self.part::<A, B>() {
            add_fading::<T, B>(hi, lo, fade, again(b));
        }
    }

    /// [`add_attitude`] of block (A, 2).
    #[inline(always)]
    fn add_attitude<const A: usize>(
        &mut self,
        t: &BlockTransition<T>,
        b: &mut Block<T>,
        q3: &mut Block<T>,
    ) {
        if let Some((hi, lo)) = self.part::<A, 2>() {
            add_attitude(hi, lo, t, again(b), again(q3));
        }
    }

    /// As [`Covariance15::propagate`], for a transition of the pattern of [`BlockTransition`].
    pub fn propagate_blocks(&mut self, t: &BlockTransition<T>) {
        self.propagate_motion(t);
        self.propagate_rest(t);
    }

    /// The rows of position and velocity: the first part of [`Covariance15::propagate_blocks`], for who must stop halfway.
    #[inline(never)]
    pub(crate) fn propagate_motion(&mut self, t: &BlockTransition<T>) {
        let mut room = [const { [const { MaybeUninit::uninit() }; 3] }; 10];
        // seen from outside, so that it is memory and not three dozen registers
        let [r0, r1, r2, r3, r4, r5, r6, r7, r8, r9] = black_box(&mut room);
        let mut b12 = self.row_1::<2>(t, r0);
        let mut b14 = self.row_1::<4>(t, r1);
        let b11 = self.row_1::<1>(t, r2);
        let b10 = self.row_1::<0>(t, r3);
        let mut b13 = self.row_1::<3>(t, r4);
        let mut b03 = self.row_0::<3>(t, r5);
        let mut b04 = self.row_0::<4>(t, r6);
        let mut b02 = self.row_0::<2>(t, r7);
        let b00 = self.row_0::<0>(t, r8);
        let b01 = self.row_0::<1>(t, r9);
        self.add_fading::<0, 3>(t.a33, &mut b03);
        self.add_fading::<1, 3>(t.a33, &mut b13);
        self.add_attitude::<0>(t, &mut b02, &mut b03);
        self.add_attitude::<1>(t, &mut b12, &mut b13);
        self.add_fading::<0, 4>(t.a44, &mut b04);
        self.add_fading::<1, 4>(t.a44, &mut b14);
        each!(I => {
            let d = sum(row::<T, I>(&b00), *b00[I]);
            let d = hollow(d, &t.a00, row::<T, I>(&b00));
            self.add::<0, 0, I>(diagonal(d, &t.a01, row::<T, I>(&b01)));
        });
        each!(I => {
            let d = sum(row::<T, I>(&b01), *b10[I]);
            let d = hollow(diagonal(d, &t.a10, row::<T, I>(&b00)), &t.a11, row::<T, I>(&b01));
            self.add::<0, 1, I>(full(hollow(d, &t.a12, row::<T, I>(&b02)), &t.a14, row::<T, I>(&b04)));
        });
        each!(I => {
            let d = sum(row::<T, I>(&b11), *b11[I]);
            let d = hollow(diagonal(d, &t.a10, row::<T, I>(&b10)), &t.a11, row::<T, I>(&b11));
            let mut d = full(hollow(d, &t.a12, row::<T, I>(&b12)), &t.a14, row::<T, I>(&b14));
            noise::<T, 0, I>(&mut d, &t.q);
            self.add::<1, 1, I>(d);
        });
    }

    /// The rows of attitude and biases: the second part, which reads nothing that the first has written.
    #[inline(never)]
    pub(crate) fn propagate_rest(&mut self, t: &BlockTransition<T>) {
        let mut room = [const { [const { MaybeUninit::uninit() }; 3] }; 3];
        let [r0, r1, r2] = black_box(&mut room);
        let b22 = self.row_2::<2>(t, r0);
        let mut b23 = self.row_2::<3>(t, r1);
        let mut b24 = self.row_2::<4>(t, r2);
        each!(I => {
            let d = sum(row::<T, I>(&b22), *b22[I]);
            let mut d = full(hollow(d, &t.a22, row::<T, I>(&b22)), &t.a23, row::<T, I>(&b23));
            noise::<T, 1, I>(&mut d, &t.q);
            self.add::<2, 2, I>(d);
        });
        self.add_fading::<2, 3>(t.a33, &mut b23);
        self.add_fading::<2, 4>(t.a44, &mut b24);
        let (one, two) = (T::one(), T::one() + T::one());
        let both = t.a33 + t.a44 * (one + t.a33);
        each!(I => { self.fade::<3, 4, I>(both, &[T::zero(); 12]); });
        each!(I => { self.fade::<3, 3, I>(t.a33 * (two + t.a33), &t.q); });
        each!(I => { self.fade::<4, 4, I>(t.a44 * (two + t.a44), &t.q); });
    }

    /// Block (0, B) of A P.
    #[inline(always)]
    fn row_0<'a, const B: usize>(
        &self,
        t: &BlockTransition<T>,
        to: &'a mut Room<T>,
    ) -> Block<'a, T> {
        block!(to; J => {
            let x = hollow0(&t.a00, self.column::<0, B, J>());
            diagonal(x, &t.a01, self.column::<1, B, J>())
        })
    }

    /// Block (1, B) of A P.
    #[inline(always)]
    fn row_1<'a, const B: usize>(
        &self,
        t: &BlockTransition<T>,
        to: &'a mut Room<T>,
    ) -> Block<'a, T> {
        block!(to; J => {
            let (p2, p4) = (self.column::<2, B, J>(), self.column::<4, B, J>());
            let (p1, p0) = (self.column::<1, B, J>(), self.column::<0, B, J>());
            if B == 2 || B == 4 || B == 0 {
                let (low2, low4) = (self.low::<2, B, J>(), self.low::<4, B, J>());
                velocity_recut(t, Held(p2), Held(low2), Held(p4), Held(low4), Held(p1), Held(p0)).0
            } else {
                let x = full(hollow0(&t.a12, p2), &t.a14, p4);
                diagonal(hollow(x, &t.a11, p1), &t.a10, p0)
            }
        })
    }

    /// Block (2, B) of A P.
    #[inline(always)]
    fn row_2<'a, const B: usize>(
        &self,
        t: &BlockTransition<T>,
        to: &'a mut Room<T>,
    ) -> Block<'a, T> {
        block!(to; J => {
            let x = hollow0(&t.a22, self.column::<2, B, J>());
            full(x, &t.a23, self.column::<3, B, J>())
        })
    }

    /// Row I of block (A, B), both of states that only fade.
    #[inline(always)]
    fn fade<const A: usize, const B: usize, const I: usize>(&mut self, fade: T, q: &[T; 12]) {
        let p = self.line::<A, B, I>();
        let mut d = [fade * p[0], fade * p[1], fade * p[2]];
        if A == B {
            d[I] += q[3 * A - 3 + I];
        }
        self.add::<A, B, I>(d);
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
    fn what_is_cut_elsewhere_is_the_same_number() {
        let p = [1.0f32, -0.7, 3e-4];
        let low = [2e-8f32, 1.5e-8, -1e-11];
        let (h, l) = recut(p, low);
        for i in 0..3 {
            let stored = f64::from(p[i]) + f64::from(low[i]);
            let cut = f64::from(h[i]) + f64::from(l[i]);
            // the second word is below an eighth of the first, and rounded once
            let rounding = f64::from(l[i].abs()) * 2f64.powi(-24);
            assert!((cut - stored).abs() <= rounding, "{i}");
            assert!(h[i] != p[i] && l[i].abs() <= 0.125 * p[i].abs(), "{i}");
        }
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
