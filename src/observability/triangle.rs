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

/// Hands the elements of axes p < q of a packed symmetric matrix of n rows to `f`, pair by pair: (p, k) with (q, k) for
/// every k but p and q. The elements (p, p), (q, p) and (q, q) are left out.
#[inline(always)]
pub(super) fn for_pairs<T: Real>(
    a: &mut [T],
    n: usize,
    p: usize,
    q: usize,
    mut f: impl FnMut(&mut T, &mut T),
) {
    let Some((above, row_q)) = a.split_at_mut_checked(start(q)) else {
        return;
    };
    // left of p: row p against row q
    let row_p = above.get_mut(start(p)..start(p) + p).unwrap_or_default();
    for (x_p, x_q) in row_p.iter_mut().zip(row_q.iter_mut()) {
        f(x_p, x_q);
    }
    // between p and q: column p against row q
    let mut at = start(p + 1) + p;
    let between = row_q.get_mut(p + 1..q).unwrap_or_default();
    for (step, x_q) in (p + 2..).zip(between) {
        if let Some(x_p) = above.get_mut(at) {
            f(x_p, x_q);
        }
        at += step;
    }
    // below q: columns p and q of one row
    let mut at = start(q + 1) + p;
    let across = q - p.min(q);
    for step in q + 2..=n {
        if let (Some(mut x_p), Some(mut x_q)) = (a.get(at).copied(), a.get(at + across).copied()) {
            f(&mut x_p, &mut x_q);
            if let Some(to) = a.get_mut(at) {
                *to = x_p;
            }
            if let Some(to) = a.get_mut(at + across) {
                *to = x_q;
            }
        }
        at += step;
    }
}

/// Exchanges axes p < q of a symmetric matrix of n rows whose first p columns may already hold a factor.
fn exchange<T: Real>(a: &mut [T], n: usize, p: usize, q: usize) {
    for_pairs(a, n, p, q, core::mem::swap);
    let (x, y) = (at(a, p, p), at(a, q, q));
    set(a, p, p, y);
    set(a, q, q, x);
}

/// Brings the largest of what `left` holds from k on to row k.
pub(super) fn pivot<T: Real>(a: &mut [T], n: usize, k: usize, left: &mut [T], order: &mut [u8]) {
    let (mut best, mut largest) = (k, T::zero());
    for (i, left) in (k..).zip(left.get(k..n).unwrap_or_default()) {
        if *left > largest {
            (best, largest) = (i, *left);
        }
    }
    if best > k {
        exchange(a, n, k, best);
        if best < order.len() && k < order.len() && best < left.len() && k < left.len() {
            order.swap(k, best);
            left.swap(k, best);
        }
    }
}

/// Column k of a Cholesky factor in place, left-looking, once the columns before it are there:
/// l_ik = (a_ik − Σ_{j<k} l_ij l_kj)/l_kk. `left` is the diagonal that remains and gets l_ik² taken off.
///
/// Returns `false`, and does nothing, where the pivot is not positive.
#[inline(always)]
pub(super) fn factor_column<T: Real>(a: &mut [T], n: usize, k: usize, left: &mut [T]) -> bool {
    let Some((above, mut below)) = a.split_at_mut_checked(start(k + 1)) else {
        return false;
    };
    let Some((pivot, row_k)) = above.get_mut(start(k)..).and_then(<[T]>::split_last_mut) else {
        return false;
    };
    let square = *pivot - dot(row_k, row_k);
    if !(square > T::zero() && square.finite()) {
        return false;
    }
    *pivot = square.root();
    let inverse = T::one() / *pivot;
    let left = left.get_mut(k + 1..n).unwrap_or_default();
    for (length, left) in (k + 2..).zip(left) {
        let Some((row, rest)) = below.split_at_mut_checked(length) else {
            return false;
        };
        if let Some((done, x)) = row.get_mut(..=k).and_then(<[T]>::split_last_mut) {
            *done = (*done - dot(x, row_k)) * inverse;
            *left -= *done * *done;
        }
        below = rest;
    }
    true
}

/// The rows from the top.
#[inline(always)]
pub(super) fn rows<T>(a: &[T]) -> impl Iterator<Item = &[T]> {
    let (mut rest, mut length) = (a, 0);
    core::iter::from_fn(move || {
        length += 1;
        let (row, below) = rest.split_at_checked(length)?;
        rest = below;
        Some(row)
    })
}

/// Row i of LᵀL in place of row i of L; rows below i must still hold L, rows above are already done.
///
/// Summed from the last row up: in a pivoted factor those are the smallest.
#[inline(always)]
pub(super) fn gram_row<T: Real, const N: usize>(a: &mut [T], n: usize, i: usize) {
    let mut sum = [T::zero(); N];
    let mut rest = a.get(start(i)..start(n)).unwrap_or(&[]);
    let mut last = |length: usize| {
        let (above, row) = rest.split_at_checked(rest.len().checked_sub(length)?)?;
        rest = above;
        row.get(..=i)
    };
    // two rows at a time: the sums are read and written half as often
    let mut k = n;
    while k > i + 1 {
        let (Some(lower), Some(upper)) = (last(k), last(k - 1)) else {
            return;
        };
        let of = |row: &[T]| row.last().copied().unwrap_or_else(T::zero);
        let (x, y) = (of(lower), of(upper));
        for (sum, (lower, upper)) in sum.iter_mut().zip(lower.iter().zip(upper)) {
            *sum += x * *lower + y * *upper;
        }
        k -= 2;
    }
    let row_i = row_mut(a, i);
    if k == i + 1 {
        let x = row_i.last().copied().unwrap_or_else(T::zero);
        for (sum, l) in sum.iter_mut().zip(row_i.iter()) {
            *sum += x * *l;
        }
    }
    for (to, sum) in row_i.iter_mut().zip(&sum) {
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

/// The states whose bit is set, one after the other; how many there are.
pub(super) fn select<const N: usize>(order: &mut [u8; N], bits: u32) -> usize {
    let mut n = 0;
    for state in (0..N).filter(|state| bits & (1 << state) != 0) {
        if let Some(to) = order.get_mut(n) {
            *to = state as u8;
            n += 1;
        }
    }
    n
}

/// A vector over the first n rows as one over the states, its largest component positive; the other states have 0.
pub(super) fn oriented<T: Real, const N: usize>(u: &[T; N], order: &[u8; N], n: usize) -> [T; N] {
    let largest = u
        .iter()
        .fold(T::zero(), |m, x| if x.abs() > m.abs() { *x } else { m });
    let sign = if largest < T::zero() {
        -T::one()
    } else {
        T::one()
    };
    let mut vector = [T::zero(); N];
    for (u, state) in u.iter().zip(order).take(n) {
        if let Some(to) = vector.get_mut(usize::from(*state)) {
            *to = *u * sign;
        }
    }
    vector
}

/// Rows and columns `order` of a packed symmetric matrix.
pub(super) fn copy_rows<T: Real>(to: &mut [T], from: &[T], order: &[u8], n: usize) {
    let mut to = to.iter_mut();
    for i in order.iter().take(n) {
        for j in order.iter().take(n) {
            let (row, column) = (i.max(j), i.min(j));
            if let Some(to) = to.next() {
                *to = at(from, usize::from(*row), usize::from(*column));
            }
            if i == j {
                break;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// [[4, 2, -2], [2, 10, 1], [-2, 1, 3]] = L Lᵀ with L = [[2], [1, 3], [-1, 2/3, …]].
    const A: [f64; 6] = [4.0, 2.0, 10.0, -2.0, 1.0, 3.0];

    #[test]
    fn a_factor_times_its_transpose_is_the_matrix() {
        let mut l = A;
        let mut left = [4.0, 10.0, 3.0];
        for k in 0..3 {
            assert!(factor_column(&mut l, 3, k, &mut left));
        }
        for i in 0..3 {
            for j in 0..=i {
                // three products of numbers below 4
                assert!((dot(row(&l, i), row(&l, j)) - at(&A, i, j)).abs() < 1e-15);
            }
        }
        // what remained when each pivot came up is its square
        assert!((left[1] - l[2] * l[2]).abs() < 1e-15 && (left[2] - l[5] * l[5]).abs() < 1e-15);
        // Lᵀ L, element (1, 0): l11 l10 + l21 l20
        let mut gram = l;
        for i in 0..3 {
            gram_row::<f64, 3>(&mut gram, 3, i);
        }
        assert!((at(&gram, 1, 0) - (l[2] * l[1] + l[4] * l[3])).abs() < 1e-15);
        assert!((at(&gram, 2, 2) - l[5] * l[5]).abs() < 1e-15);
        // A⁻¹ A = I by the factor: L⁻¹ L, and L⁻¹ A L⁻ᵀ
        let mut one = l;
        for i in 0..3 {
            divide_row(&mut one, &l, i);
        }
        let mut same = A;
        for k in 0..3 {
            congruence_step::<f64, 3>(&mut same, &l, 3, k);
        }
        for (one, same) in one.iter().zip(&same) {
            assert!((one - same).abs() < 1e-15);
        }
        assert_eq!([one[0], one[2], one[5]], [1.0; 3]);
        // Lᵀ x = b
        let mut x = [l[0] + l[1] + l[3], l[2] + l[4], l[5]];
        solve_transposed(&l, 3, &mut x);
        assert!(x.iter().all(|x| (x - 1.0).abs() < 1e-15));
    }

    #[test]
    fn a_pivot_that_is_not_positive_is_told() {
        let mut a = [1.0, 2.0, 1.0];
        assert!(factor_column(&mut a, 2, 0, &mut [1.0, 1.0]));
        let before = a;
        assert!(!factor_column(&mut a, 2, 1, &mut [1.0, 1.0]));
        assert_eq!(a, before);
        assert!(!factor_column(&mut [f64::NAN], 1, 0, &mut [1.0]));
    }

    #[test]
    fn exchanged_axes_are_exchanged() {
        // element (i, j) is 10 i + j, so every one of them can be followed
        let mut a: [f64; 10] = [0.0, 10.0, 11.0, 20.0, 21.0, 22.0, 30.0, 31.0, 32.0, 33.0];
        exchange(&mut a, 4, 0, 2);
        assert_eq!(
            a,
            [22.0, 21.0, 11.0, 20.0, 10.0, 0.0, 32.0, 31.0, 30.0, 33.0]
        );
        exchange(&mut a, 4, 1, 3);
        assert_eq!(
            a,
            [22.0, 32.0, 33.0, 20.0, 30.0, 0.0, 21.0, 31.0, 10.0, 11.0]
        );
    }
}
