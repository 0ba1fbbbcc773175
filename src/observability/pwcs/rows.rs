//! Rows in reduced echelon form, and the row operations of the elimination. Zeros are skipped: the rows of a navigator's
//! observability matrix hold few numbers, and reduced ones fewer.

use crate::linalg::Real;

/// Reduced rows: each has 1 in its own pivot column and 0 in those of the others.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows<T, const N: usize> {
    /// The rows, canonical units.
    pub u: [[T; N]; N],
    /// Pivot column per row.
    pub pivot: [u8; N],
    /// Pivot columns.
    pub taken: u64,
    pub len: usize,
}

impl<T: Real, const N: usize> Rows<T, N> {
    pub fn new() -> Self {
        Self {
            u: [[T::zero(); N]; N],
            pivot: [0; N],
            taken: 0,
            len: 0,
        }
    }

    /// Forgets the rows.
    pub fn clear(&mut self) {
        self.len = 0;
        self.taken = 0;
    }

    /// The next accepted row from `from` on that a row still has to be reduced by.
    pub fn next_factor(&self, row: &[T; N], from: usize) -> Option<(usize, T)> {
        for (a, pivot) in self.pivot.iter().enumerate().take(self.len).skip(from) {
            let factor = get(row, usize::from(*pivot), T::zero());
            if factor != T::zero() {
                return Some((a, factor));
            }
        }
        None
    }

    /// Takes row `a`, times its factor, from `row`.
    pub fn reduce_by(&self, row: &mut [T; N], a: usize, factor: T) {
        if let (Some(u), Some(pivot)) = (self.u.get(a), self.pivot.get(a)) {
            subtract(row, factor, u);
            put(row, usize::from(*pivot), T::zero());
        }
    }

    /// Chooses the pivot of a reduced row, the state of largest weight, and divides the row by it. Returns 1/pivot.
    pub fn choose(&self, row: &mut [T; N], weight: &[T; N]) -> (usize, T) {
        let mut best = (0usize, T::zero());
        for (j, (x, w)) in row.iter().zip(weight).enumerate() {
            let size = x.abs() * *w;
            if size > best.1 && self.taken >> (j & 63) & 1 == 0 {
                best = (j, size);
            }
        }
        let inverse = T::one() / get(row, best.0, T::one());
        for x in row.iter_mut() {
            *x *= inverse;
        }
        (best.0, inverse)
    }

    /// The next accepted row from `from` on that holds the column `pivot` of a new row.
    pub fn next_to_clear(&self, pivot: usize, from: usize) -> Option<(usize, T)> {
        for (a, u) in self.u.iter().enumerate().take(self.len).skip(from) {
            let factor = get(u, pivot, T::zero());
            if factor != T::zero() {
                return Some((a, factor));
            }
        }
        None
    }

    /// Clears the column of a new row in row `a`.
    pub fn clear_in(&mut self, a: usize, factor: T, row: &[T; N], pivot: usize) {
        if let Some(u) = self.u.get_mut(a) {
            subtract(u, factor, row);
            put(u, pivot, T::zero());
        }
    }

    /// Takes the row in.
    pub fn push(&mut self, row: &[T; N], pivot: usize) {
        if let (Some(u), Some(p)) = (self.u.get_mut(self.len), self.pivot.get_mut(self.len)) {
            *u = *row;
            *p = pivot as u8;
            self.taken |= 1 << (pivot & 63);
            self.len += 1;
        }
    }
}

/// Takes `factor` times another row away, and drops what cancellation leaves: a difference below 32 ε of its parts is
/// nothing.
pub(super) fn subtract<T: Real, const N: usize>(row: &mut [T; N], factor: T, other: &[T; N]) {
    let noise = T::of(32.0) * T::EPSILON;
    for (x, y) in row.iter_mut().zip(other) {
        if *y == T::zero() {
            continue;
        }
        let part = factor * *y;
        let rest = *x - part;
        *x = if rest.abs() <= noise * part.abs() {
            T::zero()
        } else {
            rest
        };
    }
}

/// |row|².
pub(super) fn square<T: Real>(row: &[T]) -> T {
    let mut sum = T::zero();
    for x in row {
        sum += *x * *x;
    }
    sum
}

/// Divides a row by the power of two nearest below its largest element; returns that power. Exact.
pub(super) fn normalise<T: Real>(row: &mut [T]) -> i16 {
    let mut largest = T::zero();
    for x in row.iter() {
        if x.abs() > largest {
            largest = x.abs();
        }
    }
    let exponent = largest.exponent();
    let factor = T::two_to(-exponent);
    for x in row {
        *x *= factor;
    }
    exponent
}

/// An element of a table, or something else beyond its end.
pub(super) fn get<V: Copy>(table: &[V], index: usize, or: V) -> V {
    match table.get(index) {
        Some(value) => *value,
        None => or,
    }
}

fn put<V>(table: &mut [V], index: usize, value: V) {
    if let Some(place) = table.get_mut(index) {
        *place = value;
    }
}
