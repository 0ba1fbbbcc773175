//! A small seeded source of matrices, the same on every machine.

use nalgebra::SMatrix;

/// A seeded generator (xorshift), so that failures repeat.
pub struct Random(pub u64);

impl Random {
    /// Uniform in −1 … 1.
    pub fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Symmetric positive definite: the square of a uniform matrix, and a tenth of the identity.
    pub fn spd<const N: usize>(&mut self) -> SMatrix<f64, N, N> {
        let g = SMatrix::<f64, N, N>::from_fn(|_, _| self.uniform());
        g * g.transpose() + SMatrix::identity() * 0.1
    }
}
