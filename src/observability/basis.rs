//! Orthonormal vectors, by Gram and Schmidt with a second pass.

use super::vector::{self, dot};
use crate::linalg::Real;

/// Orthonormal vectors that grow.
#[derive(Clone, Copy, Debug)]
pub(super) struct Basis<T, const N: usize> {
    pub vectors: [[T; N]; N],
    pub len: usize,
}

impl<T: Real, const N: usize> Basis<T, N> {
    pub fn new() -> Self {
        Self {
            vectors: [[T::zero(); N]; N],
            len: 0,
        }
    }

    /// Takes away what lies in the span; twice, so that rounding of the first pass goes too.
    pub fn project_out(&self, row: &mut [T; N]) {
        self.pass(row);
        self.pass(row);
    }

    fn pass(&self, row: &mut [T; N]) {
        for v in self.vectors.iter().take(self.len) {
            vector::add(row, -dot(v, row), v);
        }
    }

    /// Adds what is new of a row; false where that is below `tolerance` of it.
    pub fn add(&mut self, row: &[T; N], tolerance: T) -> bool {
        self.add_rest(&mut { *row }, tolerance)
    }

    /// [`Basis::add`] without a copy: the row is left with what is new of it.
    pub fn add_rest(&mut self, row: &mut [T; N], tolerance: T) -> bool {
        let length = dot(row, row);
        self.project_out(row);
        let rest = dot(row, row);
        if rest <= tolerance * tolerance * length {
            return false;
        }
        self.push(row, rest)
    }

    /// [`Basis::add`] without a tolerance, in two slices: the first pass leaves its result behind the last vector, the
    /// second takes that in. True where nothing is left to do.
    pub fn add_in_two(&mut self, row: &[T; N], second: bool) -> bool {
        let mut new = match self.vectors.get(self.len) {
            None => return true,
            Some(place) if second => *place,
            Some(_) => *row,
        };
        self.pass(&mut new);
        if !second {
            if let Some(place) = self.vectors.get_mut(self.len) {
                *place = new;
            }
            return false;
        }
        let rest = dot(&new, &new);
        if rest > T::zero() {
            self.push(&new, rest);
        }
        true
    }

    /// Takes in a vector of this length squared.
    fn push(&mut self, new: &[T; N], square: T) -> bool {
        let inverse = T::one() / square.root();
        match self.vectors.get_mut(self.len) {
            Some(place) => {
                for (x, y) in place.iter_mut().zip(new) {
                    *x = *y * inverse;
                }
                self.len += 1;
                true
            }
            None => false,
        }
    }
}
