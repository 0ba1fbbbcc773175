//! How good three components of a measurement are: per axis, by the figures of a receiver, or with correlations.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::{variance, variances, MIN_SIGMA};
use crate::error::Error;
use crate::error_model::N;

/// Covariance R of three components east, north, up, kept as L D Lᵀ with ones on the diagonal of L.
///
/// The filter takes uncorrelated rows. Correlated ones are multiplied by L⁻¹: the first row stays the east component,
/// the second is what north says beyond east, the third what up says beyond both; D holds their variances. Units stay,
/// and the first two rows are the horizontal measurement by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    d: SVector<f32, 3>,
    /// l₁₀, l₂₀, l₂₁
    l: [f32; 3],
}

impl Accuracy {
    /// 1σ east, north, up, uncorrelated, unit of the measurement.
    ///
    /// # Errors
    /// Those of [`variance`].
    pub fn per_axis(sigma_n: Vector3<f32>) -> Result<Self, Error> {
        Ok(Self {
            d: variances(&sigma_n)?,
            l: [0.0; 3],
        })
    }

    /// The figures of a receiver for a position, as in UBX-NAV-PVT: `h_acc` is taken for 1σ of east and of north, `v_acc`
    /// for 1σ of up [m].
    ///
    /// Receivers are optimistic under trees and between houses, and say nothing of errors that stay the same from fix
    /// to fix; a factor of 1.5 to 3 is common practice.
    ///
    /// # Errors
    /// Those of [`variance`].
    pub fn horizontal_vertical(h_acc: f32, v_acc: f32) -> Result<Self, Error> {
        Self::per_axis(Vector3::new(h_acc, h_acc, v_acc))
    }

    /// The figure of a receiver for a velocity, as in UBX-NAV-PVT: `s_acc` is taken for 1σ of every component [m/s].
    ///
    /// # Errors
    /// Those of [`variance`].
    pub fn speed(s_acc: f32) -> Result<Self, Error> {
        Self::per_axis(Vector3::repeat(s_acc))
    }

    /// A full covariance, east-north-up, unit of the measurement squared. The lower triangle is read.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; those of [`variance`] for what is left of a diagonal element (D);
    /// [`Error::NotPositive`] naming the row where the factorisation failed.
    pub fn covariance(r: &Matrix3<f32>) -> Result<Self, Error> {
        if !r.iter().all(|x| x.is_finite()) {
            return Err(Error::NonFinite);
        }
        let smallest = MIN_SIGMA * MIN_SIGMA;
        let pivot = |d: f32, row: u8| match d {
            d if d >= smallest => variance(libm::sqrtf(d)).map(|_| d),
            _ => Err(Error::NotPositive { row }),
        };
        let d0 = pivot(r.m11, 0)?;
        let (l10, l20) = (r.m21 / d0, r.m31 / d0);
        let d1 = pivot(r.m22 - l10 * r.m21, 1)?;
        let c21 = r.m32 - l20 * r.m21;
        let l21 = c21 / d1;
        let d2 = pivot(r.m33 - l20 * r.m31 - l21 * c21, 2)?;
        Ok(Self {
            d: SVector::from([d0, d1, d2]),
            l: [l10, l20, l21],
        })
    }

    /// Whether the components are uncorrelated as they are.
    pub fn is_diagonal(&self) -> bool {
        self.l == [0.0; 3]
    }

    /// Variance of each row after the correlations are taken out, D.
    pub fn variances(&self) -> SVector<f32, 3> {
        self.d
    }

    /// Elements (1, 0), (2, 0) and (2, 1) of L.
    pub(super) fn lower(&self) -> [f32; 3] {
        self.l
    }

    /// L⁻¹ times the innovation.
    pub(super) fn decorrelated(&self, nu: &Vector3<f32>) -> Vector3<f32> {
        decorrelated(&self.l, nu)
    }
}

fn decorrelated([l10, l20, l21]: &[f32; 3], nu: &Vector3<f32>) -> Vector3<f32> {
    let north = nu.y - l10 * nu.x;
    Vector3::new(nu.x, north, nu.z - l20 * nu.x - l21 * north)
}

/// L⁻¹ times three rows, from `ROW` on; `lower`: [`Accuracy::lower`].
#[inline(always)]
pub(super) fn decorrelate_rows<const M: usize, const ROW: usize>(
    lower: &[f32; 3],
    h: &mut SMatrix<f32, M, N>,
) {
    if *lower == [0.0; 3] {
        return;
    }
    let mut rows = h.fixed_view_mut::<3, N>(ROW, 0);
    for mut column in rows.column_iter_mut() {
        let row = decorrelated(lower, &Vector3::new(column.x, column.y, column.z));
        column.copy_from(&row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_covariance_is_its_factors() {
        let r = Matrix3::new(4.0, -1.0, 0.5, -1.0, 9.0, 2.0, 0.5, 2.0, 25.0);
        let a = Accuracy::covariance(&r).unwrap();
        // L⁻¹ R L⁻ᵀ = D, by applying it to the columns and then to the rows
        let half = Matrix3::from_columns(&[0, 1, 2].map(|j| a.decorrelated(&r.column(j).into())));
        let both =
            Matrix3::from_columns(&[0, 1, 2].map(|j| a.decorrelated(&half.row(j).transpose())));
        // numbers up to 25 in f32
        assert!((both - Matrix3::from_diagonal(&a.variances())).amax() < 1e-5);
        assert!(!a.is_diagonal());
        let plain = Accuracy::per_axis(Vector3::new(2.0, 3.0, 5.0)).unwrap();
        assert!(plain.is_diagonal());
        assert_eq!(
            Accuracy::covariance(&Matrix3::from_diagonal(&Vector3::new(4.0, 9.0, 25.0))),
            Ok(plain)
        );
    }

    #[test]
    fn what_is_no_covariance_is_refused() {
        let mut r = Matrix3::identity();
        r.m21 = 1.0; // fully correlated: nothing is left for north
        r.m12 = 1.0;
        assert_eq!(Accuracy::covariance(&r), Err(Error::NotPositive { row: 1 }));
        r.m21 = f32::NAN;
        assert_eq!(Accuracy::covariance(&r), Err(Error::NonFinite));
        assert_eq!(
            Accuracy::covariance(&(Matrix3::identity() * -1.0)),
            Err(Error::NotPositive { row: 0 })
        );
        assert_eq!(
            Accuracy::horizontal_vertical(0.0, 1.0),
            Err(Error::OutOfRange)
        );
        assert_eq!(Accuracy::speed(f32::NAN), Err(Error::NonFinite));
    }
}
