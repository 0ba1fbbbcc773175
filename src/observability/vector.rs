//! Vectors of N numbers. The fifteen states of the filter are spelled out: at opt-level "s" a loop over them costs about
//! twice as much.

use nalgebra::SMatrix;

use crate::linalg::Real;

/// Calls `$m!(0)` … `$m!(N − 1)`, the first fifteen spelled out.
macro_rules! each_element {
    ($n:ident, $m:ident) => {
        $crate::linalg::each_state!($m);
        for i in 15..$n {
            $m!(i);
        }
    };
}

pub(super) use each_element;

/// Σ x y.
#[inline]
pub(super) fn dot<T: Real, const N: usize>(x: &[T; N], y: &[T; N]) -> T {
    let mut sum = T::zero();
    macro_rules! element {
        ($i:expr) => {
            if let (Some(x), Some(y)) = (x.get($i), y.get($i)) {
                sum += *x * *y;
            }
        };
    }
    each_element!(N, element);
    sum
}

/// x ← x + factor y.
#[inline]
pub(super) fn add<T: Real, const N: usize>(x: &mut [T; N], factor: T, y: &[T; N]) {
    macro_rules! element {
        ($i:expr) => {
            if let (Some(x), Some(y)) = (x.get_mut($i), y.get($i)) {
                *x += factor * *y;
            }
        };
    }
    each_element!(N, element);
}

/// x ← factor x.
#[inline]
pub(super) fn scale<T: Real, const N: usize>(x: &mut [T; N], factor: T) {
    macro_rules! element {
        ($i:expr) => {
            if let Some(x) = x.get_mut($i) {
                *x *= factor;
            }
        };
    }
    each_element!(N, element);
}

/// x ← cos x + sin y, y ← cos y − sin x.
#[inline]
pub(super) fn turn<T: Real, const N: usize>(x: &mut [T; N], y: &mut [T; N], cos: T, sin: T) {
    macro_rules! element {
        ($i:expr) => {
            if let (Some(x), Some(y)) = (x.get_mut($i), y.get_mut($i)) {
                (*x, *y) = (cos * *x + sin * *y, cos * *y - sin * *x);
            }
        };
    }
    each_element!(N, element);
}

/// x ← x − a·y − b·z, the two products summed first.
#[inline]
pub(super) fn take_off_two<T: Real, const N: usize>(
    x: &mut [T; N],
    (a, y): (T, &[T; N]),
    (b, z): (T, &[T; N]),
) {
    macro_rules! element {
        ($i:expr) => {
            if let (Some(x), Some(y), Some(z)) = (x.get_mut($i), y.get($i), z.get($i)) {
                *x -= a * *y + b * *z;
            }
        };
    }
    each_element!(N, element);
}

/// x_i ← f(x_i, y_i).
#[inline(always)]
pub(super) fn combine<T: Real, const N: usize>(x: &mut [T; N], y: &[T; N], f: impl Fn(T, T) -> T) {
    macro_rules! element {
        ($i:expr) => {
            if let (Some(x), Some(y)) = (x.get_mut($i), y.get($i)) {
                *x = f(*x, *y);
            }
        };
    }
    each_element!(N, element);
}

/// The largest |x|.
#[inline]
pub(super) fn largest<T: Real, const N: usize>(x: &[T; N]) -> T {
    let mut largest = T::zero();
    macro_rules! element {
        ($i:expr) => {
            if let Some(x) = x.get($i) {
                if x.abs() > largest {
                    largest = x.abs();
                }
            }
        };
    }
    each_element!(N, element);
    largest
}

/// Whether all are finite: 0·x is NaN where x is not.
#[inline]
pub(super) fn finite<T: Real, const N: usize>(x: &[T; N]) -> bool {
    let mut sum = T::zero();
    macro_rules! element {
        ($i:expr) => {
            if let Some(x) = x.get($i) {
                sum += T::zero() * *x;
            }
        };
    }
    each_element!(N, element);
    sum == T::zero()
}

/// Row i of a matrix; 0 beyond its end.
#[inline]
pub(super) fn row<T: Real, const M: usize, const N: usize>(
    a: &SMatrix<T, M, N>,
    i: usize,
) -> [T; N] {
    let mut row = const { [T::ZERO; N] };
    macro_rules! element {
        ($j:expr) => {
            let column = a.data.0.get($j).and_then(|column| column.get(i));
            if let (Some(x), Some(a)) = (row.get_mut($j), column) {
                *x = *a;
            }
        };
    }
    each_element!(N, element);
    row
}

/// Σ_i (x_i/unit_i) A_i: the row x, in these units, times a matrix in the states' own. Zeros of x are skipped.
#[inline(always)]
pub(super) fn times<T: Real, const N: usize>(
    x: &[T; N],
    unit: &[T; N],
    a: &SMatrix<T, N, N>,
) -> [T; N] {
    let mut product = [T::zero(); N];
    for (i, (x, unit)) in x.iter().zip(unit).enumerate() {
        if *x == T::zero() {
            continue;
        }
        let x = *x / *unit;
        macro_rules! element {
            ($j:expr) => {
                let column = a.data.0.get($j).and_then(|column| column.get(i));
                if let (Some(sum), Some(a)) = (product.get_mut($j), column) {
                    *sum += x * *a;
                }
            };
        }
        each_element!(N, element);
    }
    product
}
