//! The forms in which a measurement keeps its rows.

use nalgebra::{SMatrix, Vector3};

use super::AntennaRows;
use crate::error_model::N;

/// ∂ν/∂δx of M rows, so that correcting the estimate by δx leaves ν − h·δx, in a form of its own.
pub trait MeasurementRows<const M: usize> {
    /// What is in them.
    fn kind(&self) -> Kind<'_, M>;
}

/// What M rows are; each kind has a kernel of its own in the covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind<'a, const M: usize> {
    /// Row m is −1 on error state `first + m`, and zero elsewhere.
    Direct {
        /// State of row 0
        first: usize,
    },
    /// The first M rows of position and velocity of an antenna, of which there are six.
    Antenna(&'a AntennaRows),
    /// Any rows.
    Dense(&'a SMatrix<f32, M, N>),
}

impl<const M: usize> Kind<'_, M> {
    /// All elements, M × N.
    pub fn dense(&self) -> SMatrix<f32, M, N> {
        match self {
            Self::Direct { first } => {
                SMatrix::from_fn(|row, col| match col.checked_sub(row) == Some(*first) {
                    true => -1.0,
                    false => 0.0,
                })
            }
            Self::Antenna(rows) => rows.elements(),
            Self::Dense(h) => **h,
        }
    }
}

/// Row m is −1 on error state FIRST + m, and zero elsewhere: the states themselves are measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Direct<const FIRST: usize>;

/// Rows of which only the running program knows what they are.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // no allocation here; and it lives for the length of a call
pub enum Jacobian<const M: usize> {
    /// Row m is −1 on error state `first + m`, and zero elsewhere.
    Direct {
        /// State of row 0
        first: usize,
    },
    /// The first M rows of position and velocity of an antenna, of which there are six.
    Antenna(AntennaRows),
    /// Any rows.
    Dense(SMatrix<f32, M, N>),
}

impl<const M: usize> From<Kind<'_, M>> for Jacobian<M> {
    #[inline(always)]
    fn from(kind: Kind<'_, M>) -> Self {
        match kind {
            Kind::Direct { first } => Self::Direct { first },
            Kind::Antenna(rows) => Self::Antenna(*rows),
            Kind::Dense(h) => Self::Dense(*h),
        }
    }
}

impl<const M: usize, const FIRST: usize> MeasurementRows<M> for Direct<FIRST> {
    #[inline(always)] // known where it is used: kernels of other kinds fold away
    fn kind(&self) -> Kind<'_, M> {
        const { assert!(FIRST + M <= N, "the rows measure states that there are") };
        Kind::Direct { first: FIRST }
    }
}

impl MeasurementRows<6> for AntennaRows {
    #[inline(always)]
    fn kind(&self) -> Kind<'_, 6> {
        Kind::Antenna(self)
    }
}

impl<const M: usize> MeasurementRows<M> for SMatrix<f32, M, N> {
    #[inline(always)]
    fn kind(&self) -> Kind<'_, M> {
        Kind::Dense(self)
    }
}

impl<const M: usize> MeasurementRows<M> for Jacobian<M> {
    #[inline(always)]
    fn kind(&self) -> Kind<'_, M> {
        match self {
            Self::Direct { first } => Kind::Direct { first: *first },
            Self::Antenna(rows) => Kind::Antenna(rows),
            Self::Dense(h) => Kind::Dense(h),
        }
    }
}

/// Three elements of a row: those of the states from FIRST on.
#[inline(always)]
pub(super) fn set<const ROW: usize, const FIRST: usize, const M: usize>(
    h: &mut SMatrix<f32, M, N>,
    x: &Vector3<f32>,
) {
    let columns = &mut h.data.0;
    columns[FIRST][ROW] = x.x;
    columns[FIRST + 1][ROW] = x.y;
    columns[FIRST + 2][ROW] = x.z;
}
