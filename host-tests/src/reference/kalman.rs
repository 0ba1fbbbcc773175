//! The dense Kalman filter of the textbook: full matrices, all rows at once, Joseph's form.

use nalgebra::{SMatrix, SVector};

/// A covariance as a full matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dense<const N: usize> {
    /// P
    pub p: SMatrix<f64, N, N>,
}

/// What an update finds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gain<const M: usize, const N: usize> {
    /// K = P Hᵀ S⁻¹
    pub k: SMatrix<f64, N, M>,
    /// S = H P Hᵀ + R
    pub s: SMatrix<f64, M, M>,
    /// K ν
    pub dx: SVector<f64, N>,
    /// νᵀ S⁻¹ ν
    pub nis: f64,
}

impl<const N: usize> Dense<N> {
    /// P ← Φ P Φᵀ + Q
    pub fn propagate(&mut self, phi: &SMatrix<f64, N, N>, q: &SMatrix<f64, N, N>) {
        self.settle(phi * self.p * phi.transpose() + q);
    }

    /// P ← (I − K H) P (I − K H)ᵀ + K R Kᵀ; None when S is singular.
    pub fn update<const M: usize>(
        &mut self,
        h: &SMatrix<f64, M, N>,
        r: &SVector<f64, M>,
        nu: &SVector<f64, M>,
    ) -> Option<Gain<M, N>> {
        let r = SMatrix::from_diagonal(r);
        let s = h * self.p * h.transpose() + r;
        let inverse = s.try_inverse()?;
        let k = self.p * h.transpose() * inverse;
        let left = SMatrix::identity() - k * h;
        self.settle(left * self.p * left.transpose() + k * r * k.transpose());
        Some(Gain {
            k,
            s,
            dx: k * nu,
            nis: (nu.transpose() * inverse * nu).x,
        })
    }

    fn settle(&mut self, p: SMatrix<f64, N, N>) {
        self.p = (p + p.transpose()) * 0.5;
    }
}
