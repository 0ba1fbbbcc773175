//! Jacobi rotations of a packed symmetric matrix whose diagonal is kept apart.

use super::triangle::{for_pairs, set};
use crate::linalg::Real;

/// Relative gap below which two eigenvalues are told apart, but not their directions.
pub(super) const GAP: f64 = 1e-3;

/// When an off-diagonal element is small enough to be left alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Threshold<T> {
    /// Smallest size that a diagonal element counts with: resolution of an indefinite matrix, 0 for a definite one.
    pub floor: T,
    /// Whether the axes must be as good as the values.
    pub axes: bool,
}

impl<T: Real> Threshold<T> {
    /// Whether rotating a pair with diagonal x, y and off-diagonal a would change nothing that counts.
    ///
    /// The rotation would move the values by about a²/|x − y|. It is skipped when that is below 400 ε of the smaller
    /// one (2.4e-5 in f32; all pairs of a row together 3e-4), 100 ε in an indefinite matrix, or when a is rounding by
    /// itself (4 ε of the geometric mean). For axes the angle a/|x − y| and the scaled cosine a/√(xy) must be below
    /// 8192 ε (1e-3 in f32) as well, unless the two values are so close that only their plane is told.
    #[inline(always)]
    pub fn negligible(&self, x: T, y: T, a: T) -> bool {
        let square = a * a;
        let (x_size, y_size) = (x.abs() + self.floor, y.abs() + self.floor);
        let small = if x_size < y_size { x_size } else { y_size };
        let gap = (x - y).abs();
        let part = T::of(if self.floor > T::zero() { 100.0 } else { 400.0 });
        if square <= part * T::EPSILON * small * gap {
            if !self.axes || gap <= T::of(GAP) * small {
                return true;
            }
            let angle = T::of(8192.0) * T::EPSILON;
            if square <= angle * angle * small * gap && a.abs() <= angle * gap {
                return true;
            }
        }
        let rounding = T::of(4.0) * T::EPSILON;
        square <= rounding * rounding * (x_size * y_size)
    }
}

/// A rotation in the plane of two axes p < q: x_p ← x_p − s (x_q + τ x_p), x_q ← x_q + s (x_p − τ x_q).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rotation<T> {
    /// Sine.
    pub s: T,
    /// s/(1 + c), the tangent of half the angle.
    pub tau: T,
    /// What moves from the diagonal element p to q.
    pub shift: T,
}

impl<T: Real> Rotation<T> {
    /// The smaller of the two rotations that annul the off-diagonal `a` ≠ 0 of a pair with diagonal x (p), y (q).
    #[inline(always)]
    pub fn annulling(x: T, y: T, a: T) -> Self {
        let one = T::one();
        let theta = (y - x) / (a + a);
        let square = one + theta * theta;
        // where θ² overflows the angle is below rounding
        let root = if square.finite() {
            square * square.inverse_root_near()
        } else {
            theta.abs()
        };
        let t = if theta < T::zero() {
            -one / (root - theta)
        } else {
            one / (root + theta)
        };
        let c = (one + t * t).inverse_root_near();
        // From the half angle, so that sine and cosine belong together whatever the roots are off.
        let tau = t * c / (one + c);
        Self {
            s: (tau + tau) / (one + tau * tau),
            tau,
            shift: t * a,
        }
    }

    /// Turns one pair of elements.
    #[inline(always)]
    pub fn turn(&self, x_p: &mut T, x_q: &mut T) {
        let (g, h) = (*x_p, *x_q);
        *x_p = g - self.s * (h + self.tau * g);
        *x_q = h + self.s * (g - self.tau * h);
    }
}

/// Applies a rotation of axes p < q to the off-diagonal elements of a packed symmetric matrix of n rows and annuls
/// element (q, p). The diagonal is the caller's.
pub(super) fn rotate<T: Real>(a: &mut [T], n: usize, p: usize, q: usize, rotation: &Rotation<T>) {
    for_pairs(a, n, p, q, |x_p, x_q| rotation.turn(x_p, x_q));
    set(a, q, p, T::zero());
}

/// The eigenvectors of a Jacobi iteration: kept, or not.
pub trait Axes<T> {
    /// Whether they are kept.
    const KEPT: bool;
    /// Starts with the unit axes.
    fn reset(&mut self);
    /// Turns axes p and q: x_p ← x_p − s (x_q + τ x_p), x_q ← x_q + s (x_p − τ x_q).
    fn turn(&mut self, p: usize, q: usize, s: T, tau: T);
    /// Axis k; empty when not kept.
    fn axis(&self, k: usize) -> &[T];
}

/// Eigenvalues only.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ValuesOnly;

impl<T: Real> Axes<T> for ValuesOnly {
    const KEPT: bool = false;
    #[inline(always)]
    fn reset(&mut self) {}
    #[inline(always)]
    fn turn(&mut self, _: usize, _: usize, _: T, _: T) {}
    #[inline(always)]
    fn axis(&self, _: usize) -> &[T] {
        &[]
    }
}

/// Eigenvalues and all directions: N² more numbers of memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Directions<T, const N: usize>([[T; N]; N]);

impl<T: Real, const N: usize> Default for Directions<T, N> {
    fn default() -> Self {
        Self([[T::zero(); N]; N])
    }
}

impl<T: Real, const N: usize> Axes<T> for Directions<T, N> {
    const KEPT: bool = true;

    fn reset(&mut self) {
        for (i, axis) in self.0.iter_mut().enumerate() {
            for (j, x) in axis.iter_mut().enumerate() {
                *x = if i == j { T::one() } else { T::zero() };
            }
        }
    }

    fn turn(&mut self, p: usize, q: usize, s: T, tau: T) {
        let rotation = Rotation {
            s,
            tau,
            shift: T::zero(),
        };
        let (left, right) = self.0.split_at_mut_checked(q).unwrap_or_default();
        if let (Some(axis_p), Some(axis_q)) = (left.get_mut(p), right.first_mut()) {
            for (x_p, x_q) in axis_p.iter_mut().zip(axis_q.iter_mut()) {
                rotation.turn(x_p, x_q);
            }
        }
    }

    fn axis(&self, k: usize) -> &[T] {
        self.0.get(k).map_or(&[], |axis| axis.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rotation_annuls_its_element_and_keeps_the_trace() {
        for (x, y, a) in [
            (2.0, 1.0, 0.5),
            (1.0, 2.0, 0.5),
            (1.0, 1.0, -0.3),
            (1.0, -1.0, 1e-9),
            (0.0, 0.0, 2.0),
        ] {
            let r = Rotation::<f64>::annulling(x, y, a);
            let (s, tau) = (r.s, r.tau);
            let c = 1.0 - s * tau;
            assert!((s * s + c * c - 1.0).abs() < 1e-15);
            assert!(((c * c - s * s) * a + c * s * (x - y)).abs() < 1e-15);
            let (p, q) = (x - r.shift, y + r.shift);
            assert!(
                (p * q - (x * y - a * a)).abs() < 1e-14,
                "the determinant stays"
            );
        }
        // so far apart that θ² overflows: hardly a turn, and no NaN
        let r = Rotation::<f32>::annulling(1e10, 1e-10, 1e-20);
        assert!(r.s.abs() < 1e-29 && r.shift == 0.0, "{r:?}");
    }

    #[test]
    fn what_would_change_nothing_is_left_alone() {
        let values = Threshold::<f32> {
            floor: 0.0,
            axes: false,
        };
        let axes = Threshold {
            axes: true,
            ..values
        };
        // moves 1e-4 by 1e-8/1: a tenth of a thousandth of it
        assert!(!values.negligible(1.0, 1e-4, 1e-4));
        // by 1e-10: 1e-6 of it; but the direction by 1e-3 of a cosine
        assert!(values.negligible(1.0, 1e-4, 1e-5));
        assert!(axes.negligible(1.0, 1e-4, 9e-6));
        assert!(!axes.negligible(1.0, 1e-4, 1.1e-5));
        // rounding
        assert!(axes.negligible(1.0, 1.0, 4e-7));
        assert!(!axes.negligible(1.0, 1.0, 6e-7));
    }
}
