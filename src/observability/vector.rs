//! Vectors of N numbers. The fifteen states of the filter are spelled out: at opt-level "s" a loop over them costs about
//! twice as much.

use crate::linalg::{each_state, Real};

/// Σ x y.
#[inline]
pub(super) fn dot<T: Real, const N: usize>(x: &[T; N], y: &[T; N]) -> T {
    let mut sum = T::zero();
    macro_rules! element {
        ($i:literal) => {
            if let (Some(x), Some(y)) = (x.get($i), y.get($i)) {
                sum += *x * *y;
            }
        };
    }
    each_state!(element);
    if N > 15 {
        for (x, y) in x.iter().zip(y).skip(15) {
            sum += *x * *y;
        }
    }
    sum
}

/// x ← x + factor y.
#[inline]
pub(super) fn add<T: Real, const N: usize>(x: &mut [T; N], factor: T, y: &[T; N]) {
    macro_rules! element {
        ($i:literal) => {
            if let (Some(x), Some(y)) = (x.get_mut($i), y.get($i)) {
                *x += factor * *y;
            }
        };
    }
    each_state!(element);
    if N > 15 {
        for (x, y) in x.iter_mut().zip(y).skip(15) {
            *x += factor * *y;
        }
    }
}

/// x ← factor x.
#[inline]
pub(super) fn scale<T: Real, const N: usize>(x: &mut [T; N], factor: T) {
    macro_rules! element {
        ($i:literal) => {
            if let Some(x) = x.get_mut($i) {
                *x *= factor;
            }
        };
    }
    each_state!(element);
    if N > 15 {
        for x in x.iter_mut().skip(15) {
            *x *= factor;
        }
    }
}

/// x ← cos x + sin y, y ← cos y − sin x.
#[inline]
pub(super) fn turn<T: Real, const N: usize>(x: &mut [T; N], y: &mut [T; N], cos: T, sin: T) {
    macro_rules! element {
        ($i:literal) => {
            if let (Some(x), Some(y)) = (x.get_mut($i), y.get_mut($i)) {
                (*x, *y) = (cos * *x + sin * *y, cos * *y - sin * *x);
            }
        };
    }
    each_state!(element);
    if N > 15 {
        for (x, y) in x.iter_mut().zip(y).skip(15) {
            (*x, *y) = (cos * *x + sin * *y, cos * *y - sin * *x);
        }
    }
}

/// x ← x − a·y − b·z, the two products summed first.
#[inline]
pub(super) fn take_off_two<T: Real, const N: usize>(
    x: &mut [T; N],
    (a, y): (T, &[T; N]),
    (b, z): (T, &[T; N]),
) {
    macro_rules! element {
        ($i:literal) => {
            if let (Some(x), Some(y), Some(z)) = (x.get_mut($i), y.get($i), z.get($i)) {
                *x -= a * *y + b * *z;
            }
        };
    }
    each_state!(element);
    if N > 15 {
        for (x, (y, z)) in x.iter_mut().zip(y.iter().zip(z)).skip(15) {
            *x -= a * *y + b * *z;
        }
    }
}
