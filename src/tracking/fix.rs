//! What a receiver delivers at one instant.

use crate::error::Error;
use crate::linalg::Real;
use nalgebra::SMatrix;

/// Largest position [m] or velocity [m/s] and standard deviation that a reading may hold: small enough for its square
/// to stay inside single precision.
const MAX_MAGNITUDE: f64 = 1e9;

/// Noise of the axes of one reading, in its unit squared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Noise<T, const AXES: usize> {
    /// A variance per axis.
    Independent([T; AXES]),
    /// A full covariance, as geometry makes it (east and up of a receiver under a half sky: −0.7).
    Correlated(SMatrix<T, AXES, AXES>),
}

/// One vector of a fix: position or velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<T, const AXES: usize> {
    /// Measured values, position [m] or velocity [m/s]. An axis that is not valid is not looked at.
    pub z: [T; AXES],
    /// Noise.
    pub noise: Noise<T, AXES>,
    /// Which axes were measured.
    pub valid: [bool; AXES],
}

/// Position, velocity, or both; with neither nothing is learned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix<T, const AXES: usize> {
    /// Position in the local frame [m].
    pub position: Option<Reading<T, AXES>>,
    /// Velocity in the local frame [m/s].
    pub velocity: Option<Reading<T, AXES>>,
}

/// A reading made of uncorrelated rows: row m is z_m + Σ_{k<m} w_mk z_k with variance r_m.
pub(super) struct White<T, const AXES: usize> {
    /// Unit lower triangle, the inverse of L in R = L D Lᵀ.
    pub w: SMatrix<T, AXES, AXES>,
    /// D.
    pub r: [T; AXES],
}

impl<T: Real, const AXES: usize> Reading<T, AXES> {
    /// All axes measured, each with this standard deviation.
    pub fn new(z: [T; AXES], sigma: T) -> Self {
        Self {
            z,
            noise: Noise::Independent([sigma * sigma; AXES]),
            valid: [true; AXES],
        }
    }

    /// Variance of one axis.
    pub(super) fn variance(&self, axis: usize) -> T {
        let r = match &self.noise {
            Noise::Independent(r) => r.get(axis),
            Noise::Correlated(r) => r.get((axis, axis)),
        };
        r.copied().unwrap_or_else(T::zero)
    }

    /// Refuses what no receiver can have sent.
    pub(super) fn check(&self) -> Result<(), Error> {
        let large = T::of(MAX_MAGNITUDE);
        for (axis, (z, valid)) in self.z.iter().zip(&self.valid).enumerate() {
            if !valid {
                continue;
            }
            let r = self.variance(axis);
            if !z.finite() || !r.finite() {
                return Err(Error::NonFinite);
            }
            if z.abs() > large || r <= T::zero() || r > large * large {
                return Err(Error::OutOfRange);
            }
        }
        Ok(())
    }

    /// Uncorrelated rows of the axes in `used`; the others come out as rows of their own that nobody reads.
    ///
    /// R = L D Lᵀ of what is used, so that rows L⁻¹ z have the variances D: no root is taken.
    pub(super) fn whiten(&self, used: &[bool; AXES]) -> Result<White<T, AXES>, Error> {
        let mut white = White {
            w: SMatrix::identity(),
            r: [T::one(); AXES],
        };
        let full = match &self.noise {
            Noise::Independent(r) => {
                white.r = *r;
                return Ok(white);
            }
            Noise::Correlated(r) => r,
        };
        let both = |i: usize, j: usize| {
            used.get(i).copied().unwrap_or(false) && used.get(j).copied().unwrap_or(false)
        };
        let get = |m: &SMatrix<T, AXES, AXES>, i: usize, j: usize| {
            m.get((i, j)).copied().unwrap_or_else(T::zero)
        };
        let slack = T::of(8.0) * T::EPSILON;
        // rows of L, then of its inverse
        let mut l = SMatrix::<T, AXES, AXES>::identity();
        for i in 0..AXES {
            if !both(i, i) {
                continue;
            }
            let refuse = Err(Error::NotPositive { row: i as u8 });
            let mut pivot = get(full, i, i);
            for j in 0..i {
                if !both(i, j) {
                    continue;
                }
                let (mut x, mirror) = (get(full, i, j), get(full, j, i));
                if !x.finite() || !mirror.finite() {
                    return Err(Error::NonFinite);
                }
                let (off, scale) = (x - mirror, get(full, i, i) * get(full, j, j));
                if off * off > slack * slack * scale {
                    return refuse;
                }
                for k in 0..j {
                    let d = white.r.get(k).copied().unwrap_or_else(T::one);
                    x -= get(&l, i, k) * get(&l, j, k) * d;
                }
                let d = white.r.get(j).copied().unwrap_or_else(T::one);
                let ratio = x / d;
                pivot -= ratio * x;
                if let Some(e) = l.get_mut((i, j)) {
                    *e = ratio;
                }
            }
            if pivot <= slack * get(full, i, i) {
                return refuse;
            }
            if let Some(d) = white.r.get_mut(i) {
                *d = pivot;
            }
            for j in 0..i {
                // row i of L⁻¹: −Σ l_ik (L⁻¹)_kj
                let mut x = T::zero();
                for k in j..i {
                    x -= get(&l, i, k) * get(&white.w, k, j);
                }
                if let Some(e) = white.w.get_mut((i, j)) {
                    *e = x;
                }
            }
        }
        Ok(white)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    const R: Matrix3<f64> = Matrix3::new(4.0, 0.5, -2.0, 0.5, 1.0, 0.3, -2.0, 0.3, 9.0);

    fn reading(noise: Matrix3<f64>) -> Reading<f64, 3> {
        Reading {
            z: [1.0, -2.0, 3.0],
            noise: Noise::Correlated(noise),
            valid: [true; 3],
        }
    }

    #[test]
    fn rows_are_white() {
        let white = reading(R).whiten(&[true; 3]).unwrap();
        let left = white.w * R * white.w.transpose();
        let want = Matrix3::from_diagonal(&Vector3::from(white.r));
        assert!((left - want).amax() < 1e-14);
        // without the middle axis, the rows of the other two are those of their own 2×2
        let white = reading(R).whiten(&[true, false, true]).unwrap();
        assert_eq!(white.w.row(2), nalgebra::RowVector3::new(0.5, 0.0, 1.0));
        assert_eq!(white.r, [4.0, 1.0, 8.0]);
    }

    #[test]
    fn a_covariance_that_is_none_is_refused() {
        let mut r = R;
        r[(2, 0)] = -7.0;
        let refuse = |r, row| {
            let done = reading(r).whiten(&[true; 3]).err();
            assert_eq!(done, Some(Error::NotPositive { row }));
        };
        refuse(r, 2); // not symmetric
        r[(0, 2)] = -7.0;
        refuse(r, 2); // 4·9 < 7²
        assert_eq!(reading(R * -1.0).check(), Err(Error::OutOfRange));
        assert_eq!(reading(R * f64::NAN).check(), Err(Error::NonFinite));
    }
}
