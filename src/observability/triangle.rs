//! Packed lower triangles: element (i, j), j ≤ i, at i(i+1)/2 + j, row after row. The layout of
//! [`crate::covariance::Covariance`] seen as rows.

use crate::linalg::Real;

/// Where row `i` starts.
#[inline(always)]
pub(super) const fn start(i: usize) -> usize {
    i * (i + 1) / 2
}

/// Row i: elements (i, 0) … (i, i).
#[inline(always)]
pub(super) fn row<T>(a: &[T], i: usize) -> &[T] {
    a.get(start(i)..start(i + 1)).unwrap_or(&[])
}

/// Row i, to be written.
#[inline(always)]
pub(super) fn row_mut<T>(a: &mut [T], i: usize) -> &mut [T] {
    a.get_mut(start(i)..start(i + 1)).unwrap_or(&mut [])
}

/// Row i to be written, and the rows above it.
#[inline(always)]
pub(super) fn split<T>(a: &mut [T], i: usize) -> (&[T], &mut [T]) {
    let (above, rest) = a.split_at_mut_checked(start(i)).unwrap_or_default();
    (above, rest.get_mut(..=i).unwrap_or_default())
}

/// Element (i, j), j ≤ i; zero outside.
#[inline(always)]
pub(super) fn at<T: Real>(a: &[T], i: usize, j: usize) -> T {
    a.get(start(i) + j).copied().unwrap_or_else(T::zero)
}

/// Sets element (i, j), j ≤ i.
#[inline(always)]
pub(super) fn set<T: Real>(a: &mut [T], i: usize, j: usize, x: T) {
    if let Some(to) = a.get_mut(start(i) + j) {
        *to = x;
    }
}

/// Σ x y over the shorter of the two.
#[inline(always)]
pub(super) fn dot<T: Real>(x: &[T], y: &[T]) -> T {
    let mut sum = T::zero();
    for (x, y) in x.iter().zip(y) {
        sum += *x * *y;
    }
    sum
}

/// Exchanges rows and columns p < q of a symmetric matrix of n rows whose first p columns may already hold a factor.
pub(super) fn exchange<T: Real>(a: &mut [T], n: usize, p: usize, q: usize) {
    let mut swap = |x: usize, y: usize| {
        if x.max(y) < a.len() {
            a.swap(x, y);
        }
    };
    for k in 0..p {
        swap(start(p) + k, start(q) + k);
    }
    for k in p + 1..q {
        swap(start(k) + p, start(q) + k);
    }
    for k in q + 1..n {
        swap(start(k) + p, start(k) + q);
    }
    swap(start(p) + p, start(q) + q);
}

/// What is left of element (i, k), i ≥ k, once the first k columns of the factor are taken out:
/// a_ik − Σ_{j<k} l_ij l_kj.
#[inline(always)]
pub(super) fn reduce<T: Real>(a: &[T], i: usize, k: usize) -> T {
    let left = row(a, i).get(..k).unwrap_or(&[]);
    at(a, i, k) - dot(left, row(a, k))
}

/// Row i of LᵀL in place of row i of L; rows below i must still hold L, rows above are already done.
///
/// Summed from the last row up: in a pivoted factor those are the smallest.
pub(super) fn gram_row<T: Real, const N: usize>(a: &mut [T], n: usize, i: usize) {
    let mut sum = [T::zero(); N];
    for k in (i..n).rev() {
        let l = row(a, k);
        let factor = l.get(i).copied().unwrap_or_else(T::zero);
        for (sum, l) in sum.iter_mut().zip(l).take(i + 1) {
            *sum += factor * *l;
        }
    }
    for (to, sum) in row_mut(a, i).iter_mut().zip(&sum) {
        *to = *sum;
    }
}

/// Row i of G = B⁻¹ A for two lower triangles, in place of row i of A; rows above are already done.
pub(super) fn divide_row<T: Real>(a: &mut [T], b: &[T], i: usize) {
    let factor = row(b, i);
    let (above, row_i) = split(a, i);
    for (j, factor) in factor.iter().enumerate().take(i) {
        for (x, g) in row_i.iter_mut().zip(row(above, j)) {
            *x -= *factor * *g;
        }
    }
    let pivot = at(b, i, i);
    for x in row_i.iter_mut() {
        *x /= pivot;
    }
}

/// Step k of A ← B⁻¹ A B⁻ᵀ for a symmetric A and a lower triangular B.
pub(super) fn congruence_step<T: Real, const N: usize>(a: &mut [T], b: &[T], n: usize, k: usize) {
    let pivot = at(b, k, k);
    let a_kk = at(a, k, k) / (pivot * pivot);
    set(a, k, k, a_kk);
    let half = T::of(-0.5) * a_kk;
    // columns k of A and B, from row k + 1 on
    let (mut x, mut y) = ([T::zero(); N], [T::zero(); N]);
    for (i, (x, y)) in x.iter_mut().zip(&mut y).enumerate().take(n).skip(k + 1) {
        *y = at(b, i, k);
        *x = at(a, i, k) / pivot + half * *y;
    }
    for (i, (x_i, y_i)) in x.iter().zip(&y).enumerate().take(n).skip(k + 1) {
        let columns = x.iter().zip(&y);
        for (a, (x, y)) in row_mut(a, i).iter_mut().zip(columns).skip(k + 1) {
            *a -= *x_i * *y + *y_i * *x;
        }
    }
    for (x, y) in x.iter_mut().zip(&y) {
        *x += half * *y;
    }
    // forward substitution with the rest of B
    for i in k + 1..n {
        let b_row = row(b, i);
        let (done, rest) = x.split_at_mut_checked(i).unwrap_or_default();
        let b_left = b_row.get(k + 1..i).unwrap_or(&[]);
        let x_left = done.get(k + 1..).unwrap_or(&[]);
        if let Some(x) = rest.first_mut() {
            *x = (*x - dot(b_left, x_left)) / at(b, i, i);
            set(a, i, k, *x);
        }
    }
}

/// Solves Bᵀ x = x for a lower triangular B of n rows, in place.
pub(super) fn solve_transposed<T: Real>(b: &[T], n: usize, x: &mut [T]) {
    for i in (0..n).rev() {
        let b_row = row(b, i);
        let (above, rest) = x.split_at_mut_checked(i).unwrap_or_default();
        if let Some(x_i) = rest.first_mut() {
            *x_i /= b_row.last().copied().unwrap_or_else(T::one);
            for (x, b) in above.iter_mut().zip(b_row) {
                *x -= *b * *x_i;
            }
        }
    }
}
