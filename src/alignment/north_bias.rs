//! Peng's self-observation of the north gyro bias: what the first position has found of it is the measurement of the
//! second.
//!
//! A standing filter finds one combination of the gyro biases well, the one that points north, and splits it over the
//! level gyros. In the body that direction is h = (row "north" of C_b^n), and h does not change when the vehicle is
//! turned: with the biases constant, hᵀb_g found at position 1 holds at position 2.
//!
//! Applied **once**, with its own variance hᵀPh. The paper applies it at every step of position 2 with a made-up
//! variance; its error is one constant then, not noise, and after a minute the filter boasts of what it does not know
//! (measured in `host-tests/tests/two_position.rs`). Carrying the whole block ([`super::carry`]) is the same idea with
//! nothing left out, and needs nothing more than this does.
//!
//! At a turn of 180° this observation says nothing new: the north gyro of position 1 is the north gyro of position 2.
//!
//! Source: Peng et al. 2016, eq. (3)–(5) and (12). The paper's yaw is counter-clockwise: h = (sin ψ, cos ψ, 0) there.

use nalgebra::{SMatrix, SVector, Vector3};

use crate::error::Error;
use crate::error_model::{BG, N};
use crate::filter::Filter;
use crate::measurement::{variance, Linearized};
use crate::nav::NavState;

/// The north gyro bias as one position has found it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NorthBias {
    /// North in body axes at that position.
    pub h: Vector3<f32>,
    /// hᵀb_g [rad/s].
    pub value: f32,
    /// Its variance hᵀPh, the unit of `value` squared.
    pub variance: f32,
}

impl NorthBias {
    /// Reads it off a filter at the end of a position, best just after an update.
    pub fn of(filter: &Filter) -> Self {
        let (p, sigma0) = (filter.covariance(), filter.sigma0());
        let h = filter.nav().c_b_n().row(1).transpose();
        let unit = Vector3::new(sigma0[BG], sigma0[BG + 1], sigma0[BG + 2]);
        let scaled = h.component_mul(&unit);
        let block = SMatrix::<f32, 3, 3>::from_fn(|i, j| p.element(BG + i, BG + j));
        Self {
            h,
            value: h.dot(&filter.nav().b_g()),
            variance: scaled.dot(&(block * scaled)),
        }
    }

    /// One row: ν = z − hᵀb̂_g, h on the gyro biases.
    ///
    /// # Errors
    /// Those of [`variance`], for a filter whose covariance is broken.
    pub fn linearize(&self, nav: &NavState) -> Result<Linearized<1, SMatrix<f32, 1, N>>, Error> {
        let r = variance(libm::sqrtf(self.variance))?;
        let mut h = SMatrix::<f32, 1, N>::zeros();
        h.fixed_view_mut::<1, 3>(0, BG)
            .copy_from(&self.h.transpose());
        Ok(Linearized {
            nu: SVector::from([self.value - self.h.dot(&nav.b_g())]),
            h,
            r: SVector::from([r]),
            interval: 0.0, // once
        })
    }
}

/// Eq. (5) of the paper, literally: the north gyro bias [rad/s] from the estimated biases of the right and the forward gyro
/// of a level vehicle.
///
/// ```text
/// ε_N = ½ (b̃_x/sin ψ + b̃_y/cos ψ);  where |sin ψ| < 0.01 or |cos ψ| < 0.01 the other term alone;   ψ = −heading
/// ```
/// **Not for use**: it divides by the sine of the heading, and near the four quarters amplifies the error of the weaker
/// gyro up to a hundredfold. At a yaw of 88.5° its error is seven times that of hᵀb_g, and the heading ends worse than in
/// one position. It is here so that the paper can be compared with.
pub fn paper_eq5(b_x: f32, b_y: f32, heading: f32) -> f32 {
    const SMALL: f32 = 0.01;
    let (sin, cos) = libm::sincosf(-heading);
    // One of the two is always at least 0.7.
    if libm::fabsf(sin) < SMALL {
        b_y / cos
    } else if libm::fabsf(cos) < SMALL {
        b_x / sin
    } else {
        0.5 * (b_x / sin + b_y / cos)
    }
}
