//! One-sided Jacobi (Hestenes): rotates vectors until they are orthogonal, without forming their products' matrix.

use super::vector::{self, dot};
use crate::linalg::Real;

/// Sweeps before giving up; six to eight suffice for 15 vectors.
pub(super) const SWEEPS: usize = 30;

/// Two different elements of a table.
fn pair<V, const C: usize>(table: &mut [V; C], p: usize, q: usize) -> Option<(&mut V, &mut V)> {
    let (low, high) = table.split_at_mut_checked(q)?;
    Some((low.get_mut(p)?, high.get_mut(0)?))
}

/// Rotates one pair p < q of vectors to be orthogonal, and the pair of `axes` alike; true where something moved.
///
/// Angles below 4 ε are left alone. The longer of the two comes out first, so a sweep also sorts.
pub(super) fn rotate_pair<T: Real, const R: usize, const C: usize>(
    vectors: &mut [[T; R]; C],
    axes: Option<&mut [[T; C]; C]>,
    p: usize,
    q: usize,
) -> bool {
    let Some((x, y)) = pair(vectors, p, q) else {
        return false;
    };
    let (a, b, c) = (dot(x, x), dot(y, y), dot(x, y));
    let noise = T::of(4.0) * T::EPSILON;
    let orthogonal = c * c <= noise * noise * (a * b);
    if orthogonal && a >= b {
        return false;
    }
    let one = T::one();
    let (cos, sin) = if orthogonal {
        // Only the order is wrong: a quarter turn.
        (T::zero(), one)
    } else {
        let zeta = (b - a) / (c + c);
        let root = (one + zeta * zeta).root();
        let t = if zeta < T::zero() {
            -one / (root - zeta)
        } else {
            one / (root + zeta)
        };
        let cos = one / (one + t * t).root();
        let sin = cos * t;
        // The small angle makes x the vector of a − t c and y that of b + t c; swap where y would be longer.
        if a - t * c >= b + t * c {
            (cos, -sin)
        } else {
            (-sin, -cos)
        }
    };
    vector::turn(x, y, cos, sin);
    if let Some((x, y)) = axes.and_then(|axes| pair(axes, p, q)) {
        vector::turn(x, y, cos, sin);
    }
    true
}

/// x ← c x + s y, y ← −s x + c y.
#[inline(always)]
fn turn<T: Real>(x: &mut [T], y: &mut [T], cos: T, sin: T) {
    for (x, y) in x.iter_mut().zip(y) {
        let old = *x;
        *x = cos * old + sin * *y;
        *y = cos * *y - sin * old;
    }
}

/// Sweeps until nothing moves; false where [`SWEEPS`] did not suffice. Vectors come out longest first.
pub(super) fn rotate<T: Real, const R: usize, const C: usize>(
    vectors: &mut [[T; R]; C],
    mut axes: Option<&mut [[T; C]; C]>,
) -> bool {
    for _ in 0..SWEEPS {
        let mut moved = false;
        for p in 0..C {
            for q in p + 1..C {
                moved |= rotate_pair(vectors, axes.as_deref_mut(), p, q);
            }
        }
        if !moved {
            return true;
        }
    }
    false
}

/// Upper triangle R with RᵀR = Σ rowᵀ row: what many measurement rows come to, without their product (f32 would lose half
/// of its digits in RᵀR).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Triangle<T, const N: usize> {
    /// Row i holds zeros before column i.
    pub rows: [[T; N]; N],
}

impl<T: Real, const N: usize> Triangle<T, N> {
    pub fn new() -> Self {
        Self {
            rows: [[T::zero(); N]; N],
        }
    }

    /// Adds a row by Givens rotations.
    #[inline]
    pub fn add(&mut self, row: &[T; N]) {
        let mut new = *row;
        for (i, r) in self.rows.iter_mut().enumerate() {
            let r = r.get_mut(i..).and_then(<[T]>::split_first_mut);
            let new = new.get_mut(i..).and_then(<[T]>::split_first_mut);
            let (Some((a, r)), Some((b, new))) = (r, new) else {
                return;
            };
            if *b == T::zero() {
                continue;
            }
            // The larger of the two is taken out, so that no square overflows or vanishes.
            let (cos, sin) = if a.abs() > b.abs() {
                let t = *b / *a;
                let c = T::one() / (T::one() + t * t).root();
                (c, c * t)
            } else {
                let t = *a / *b;
                let s = T::one() / (T::one() + t * t).root();
                (s * t, s)
            };
            (*a, *b) = (cos * *a + sin * *b, T::zero());
            turn(r, new, cos, sin);
        }
    }

    /// Rows become columns, to be rotated until they are orthogonal.
    pub fn transpose(&mut self) {
        for i in 0..N {
            self.transpose_row(i);
        }
    }

    /// Exchanges row i before the diagonal with column i above it.
    pub fn transpose_row(&mut self, i: usize) {
        let (above, rest) = self.rows.split_at_mut_checked(i).unwrap_or_default();
        let row = rest.first_mut().into_iter().flatten();
        for (x, other) in row.zip(above) {
            if let Some(y) = other.get_mut(i) {
                core::mem::swap(x, y);
            }
        }
    }
}

/// The identity, as axes to begin with.
pub(super) fn identity<T: Real, const C: usize>() -> [[T; C]; C] {
    let mut axes = [[T::zero(); C]; C];
    for (i, axis) in axes.iter_mut().enumerate() {
        if let Some(x) = axis.get_mut(i) {
            *x = T::one();
        }
    }
    axes
}
