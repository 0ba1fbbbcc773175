//! The sparsity pattern of a first-order transition, as plain data.

use super::Real;
use nalgebra::{ArrayStorage, Matrix3, Vector3};

/// A = Φ − I of five 3-blocks (0 … 4) and the process noise of blocks 1 … 4: the input of the structured covariance
/// kernel.
///
/// ```text
///       0    1    2    3    4          states 3·block … 3·block + 2
/// 0  [ a00  a01   0    0    0  ]       a00, a11, a12, a22   read off the diagonal only
/// 1  [ a10  a11  a12   0   a14 ]       a01, a10             diagonal
/// 2  [  0    0   a22  a23   0  ]       a14, a23             full
/// 3  [  0    0    0   a33   0  ]       a33, a44             one number times I
/// 4  [  0    0    0    0   a44 ]
/// ```
///
/// All entries are in the units of the covariance they are used on: for states divided by σ0, A_ij σ0_j / σ0_i and
/// Q_ii / σ0_i². Diagonal entries of a00, a11, a12 and a22 are never read, so a skew matrix may be stored as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockTransition<T: Real> {
    /// Block (0, 0), off its diagonal.
    pub a00: Matrix3<T>,
    /// Block (0, 1), a diagonal.
    pub a01: Vector3<T>,
    /// Block (1, 0), a diagonal.
    pub a10: Vector3<T>,
    /// Block (1, 1), off its diagonal.
    pub a11: Matrix3<T>,
    /// Block (1, 2), off its diagonal.
    pub a12: Matrix3<T>,
    /// Block (1, 4), full.
    pub a14: Matrix3<T>,
    /// Block (2, 2), off its diagonal.
    pub a22: Matrix3<T>,
    /// Block (2, 3), full.
    pub a23: Matrix3<T>,
    /// Block (3, 3), this number times I (−dt/τ of a Markov process).
    pub a33: T,
    /// Block (4, 4), this number times I.
    pub a44: T,
    /// Diagonal of Q for blocks 1 … 4 (states 3 … 14); block 0 gets none.
    pub q: [T; 12],
}

impl<T: Real> BlockTransition<T> {
    /// Φ = I: nothing moves, no noise.
    #[must_use]
    #[inline(always)]
    pub fn identity() -> Self {
        Self::IDENTITY
    }

    /// Made at compile time, so that no opt-level forms it on the stack first.
    const IDENTITY: Self = {
        let zero = Matrix3::from_array_storage(ArrayStorage([[T::ZERO; 3]; 3]));
        let none = Vector3::from_array_storage(ArrayStorage([[T::ZERO; 3]; 1]));
        Self {
            a00: zero,
            a01: none,
            a10: none,
            a11: zero,
            a12: zero,
            a14: zero,
            a22: zero,
            a23: zero,
            a33: T::ZERO,
            a44: T::ZERO,
            q: [T::ZERO; 12],
        }
    };

    /// The same A as a dense matrix, for the general kernel and for tests.
    #[must_use]
    pub fn dense(&self) -> nalgebra::SMatrix<T, 15, 15> {
        let mut a = nalgebra::SMatrix::<T, 15, 15>::zeros();
        let hollow = |m: &Matrix3<T>| {
            let mut m = *m;
            m.fill_diagonal(T::zero());
            m
        };
        a.fixed_view_mut::<3, 3>(0, 0).copy_from(&hollow(&self.a00));
        a.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&Matrix3::from_diagonal(&self.a01));
        a.fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&Matrix3::from_diagonal(&self.a10));
        a.fixed_view_mut::<3, 3>(3, 3).copy_from(&hollow(&self.a11));
        a.fixed_view_mut::<3, 3>(3, 6).copy_from(&hollow(&self.a12));
        a.fixed_view_mut::<3, 3>(3, 12).copy_from(&self.a14);
        a.fixed_view_mut::<3, 3>(6, 6).copy_from(&hollow(&self.a22));
        a.fixed_view_mut::<3, 3>(6, 9).copy_from(&self.a23);
        a.fixed_view_mut::<3, 3>(9, 9).fill_diagonal(self.a33);
        a.fixed_view_mut::<3, 3>(12, 12).fill_diagonal(self.a44);
        a
    }

    /// Diagonal of Q for all 15 states.
    #[must_use]
    pub fn noise(&self) -> nalgebra::SVector<T, 15> {
        let mut q = nalgebra::SVector::<T, 15>::zeros();
        q.fixed_rows_mut::<12>(3).copy_from_slice(&self.q);
        q
    }
}
