//! Rows in reduced echelon form, and the row operations of the elimination. Zeros are skipped: the rows of a navigator's
//! observability matrix hold few numbers, and reduced ones fewer.

use crate::linalg::Real;
use crate::observability::vector::{self, each_element};

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
        (from..self.len).find_map(|a| {
            let pivot = self.pivot.get(a)?;
            let factor = get(row, usize::from(*pivot), T::zero());
            (factor != T::zero()).then_some((a, factor))
        })
    }

    /// Takes row `a`, times its factor, from `row`.
    pub fn reduce_by(&self, row: &mut [T; N], a: usize, factor: T) {
        if let (Some(u), Some(pivot)) = (self.u.get(a), self.pivot.get(a)) {
            subtract(row, factor, u);
            put(row, usize::from(*pivot), T::zero());
        }
    }

    /// Chooses the pivot of a reduced row, the state of largest weight, and divides the row by it. Returns 1/pivot. In the
    /// pivot columns of other rows it is 0, so those are not taken again.
    pub fn choose(row: &mut [T; N], weight: &[T; N]) -> (usize, T) {
        let mut best = (0usize, T::zero());
        macro_rules! element {
            ($j:expr) => {
                if let (Some(x), Some(w)) = (row.get($j), weight.get($j)) {
                    let size = x.abs() * *w;
                    if size > best.1 {
                        best = ($j, size);
                    }
                }
            };
        }
        each_element!(N, element);
        let inverse = T::one() / get(row, best.0, T::one());
        vector::scale(row, inverse);
        (best.0, inverse)
    }

    /// The next accepted row from `from` on that holds the column `pivot` of a new row.
    pub fn next_to_clear(&self, pivot: usize, from: usize) -> Option<(usize, T)> {
        (from..self.len).find_map(|a| {
            let factor = get(self.u.get(a)?, pivot, T::zero());
            (factor != T::zero()).then_some((a, factor))
        })
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
    macro_rules! element {
        ($i:expr) => {
            if let (Some(x), Some(y)) = (row.get_mut($i), other.get($i)) {
                if *y != T::zero() {
                    let part = factor * *y;
                    let rest = *x - part;
                    *x = if rest.abs() <= noise * part.abs() {
                        T::zero()
                    } else {
                        rest
                    };
                }
            }
        };
    }
    each_element!(N, element);
}

/// Divides a row by the power of two nearest below its largest element; returns that power. Exact.
pub(super) fn normalise<T: Real, const N: usize>(row: &mut [T; N]) -> i16 {
    let exponent = vector::largest(row).exponent();
    vector::scale(row, T::two_to(-exponent));
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
