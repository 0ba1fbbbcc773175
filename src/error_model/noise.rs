//! Bias model, noise densities, and where the noise enters: G.

use core::cmp::Ordering;

use nalgebra::{Matrix3, SMatrix, SVector};

use super::{ATT, BA, BG, N, VEL};
use crate::error::Error;
use crate::linalg::{all_finite, first_negative, Real};

/// First-order Gauss-Markov biases: ḃ = −b/τ + w. A rate is 1/τ; zero means a constant (or a random walk, if its
/// noise density is not zero).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BiasModel<T> {
    /// 1/τ of the gyro biases [1/s]
    pub rate_g: T,
    /// 1/τ of the accelerometer biases [1/s]
    pub rate_a: T,
}

impl<T: Real> BiasModel<T> {
    /// Biases that stay what they are (τ = ∞).
    pub fn constant() -> Self {
        Self {
            rate_g: T::zero(),
            rate_a: T::zero(),
        }
    }

    /// From the correlation times of the gyro and the accelerometer biases [s]; +∞ is allowed and means constant.
    ///
    /// [`Error::NonFinite`] for NaN, [`Error::OutOfRange`] for zero and below, and for a time so short that its
    /// inverse overflows.
    pub fn from_correlation_times(tau_g: T, tau_a: T) -> Result<Self, Error> {
        let rate = |tau: T| match tau.partial_cmp(&T::zero()) {
            None => Err(Error::NonFinite),
            Some(Ordering::Greater) if (T::one() / tau).finite() => Ok(T::one() / tau), // 0 for ∞
            _ => Err(Error::OutOfRange),
        };
        Ok(Self {
            rate_g: rate(tau_g)?,
            rate_a: rate(tau_a)?,
        })
    }

    /// Refuses rates that are not finite or below zero.
    pub fn check(&self) -> Result<(), Error> {
        check([self.rate_g, self.rate_a])
    }
}

/// Densities of the white noise that drives the error states; one-sided spectra as data sheets give them, squared.
///
/// Velocity and attitude noise are those of three alike accelerometers and gyros, so that turning with C_b_n changes
/// nothing (C q Cᵀ = q for a multiple of the identity); the bias noises are per body axis.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NoiseDensity<T> {
    /// Velocity random walk squared [(m/s)²/s]
    pub velocity: T,
    /// Angle random walk squared [rad²/s]
    pub attitude: T,
    /// Density that drives each gyro bias [(rad/s)²/s]; 2σ²/τ keeps a Gauss-Markov bias at σ
    pub gyro_bias: [T; 3],
    /// Density that drives each accelerometer bias [(m/s²)²/s]
    pub accel_bias: [T; 3],
}

impl<T: Real> NoiseDensity<T> {
    /// No noise at all.
    pub fn zero() -> Self {
        let o = T::zero();
        Self {
            velocity: o,
            attitude: o,
            gyro_bias: [o; 3],
            accel_bias: [o; 3],
        }
    }

    /// From the random walks of a data sheet, SI: velocity [m/s/√s], angle [rad/√s]; no noise on the biases yet.
    pub fn from_random_walks(velocity: T, angle: T) -> Self {
        Self {
            velocity: velocity * velocity,
            attitude: angle * angle,
            ..Self::zero()
        }
    }

    /// With the noise that keeps Gauss-Markov biases at their standard deviations: 2σ²/τ per axis, zero for a
    /// constant bias. `sigma_g` [rad/s], `sigma_a` [m/s²].
    pub fn with_stationary_biases(
        self,
        model: &BiasModel<T>,
        sigma_g: [T; 3],
        sigma_a: [T; 3],
    ) -> Self {
        let density = |rate: T| move |sigma: T| (rate + rate) * sigma * sigma;
        Self {
            gyro_bias: sigma_g.map(density(model.rate_g)),
            accel_bias: sigma_a.map(density(model.rate_a)),
            ..self
        }
    }

    /// The diagonal of G q Gᵀ, in state order; zero for the position.
    pub fn diagonal(&self) -> SVector<T, N> {
        let (o, v, a, [gx, gy, gz], [ax, ay, az]) = (
            T::zero(),
            self.velocity,
            self.attitude,
            self.gyro_bias,
            self.accel_bias,
        );
        SVector::from([o, o, o, v, v, v, a, a, a, gx, gy, gz, ax, ay, az])
    }

    /// Refuses densities that are not finite or below zero.
    pub fn check(&self) -> Result<(), Error> {
        check([self.velocity, self.attitude])?;
        check(self.gyro_bias)?;
        check(self.accel_bias)
    }
}

fn check<T: Real, const M: usize>(values: [T; M]) -> Result<(), Error> {
    match () {
        () if !all_finite(&values) => Err(Error::NonFinite),
        () if first_negative(&values).is_some() => Err(Error::OutOfRange),
        () => Ok(()),
    }
}

/// Where the noise of the sensors enters the states: G of ẋ = F x + G w, the same for both attitude models.
///
/// ```text
/// w = [ accelerometer noise, gyro noise, noise of ḃ_g, noise of ḃ_a ]        body axes
///
///       δr   0    0   0  0
///       δv   C    0   0  0        the noise of a sensor acts as its bias does,
/// G =   ψ    0   −C   0  0        C stands for c_b_n
///       b_g  0    0   I  0
///       b_a  0    0   0  I
/// ```
///
/// The filter never forms it: with the densities of [`NoiseDensity`], G q Gᵀ is [`NoiseDensity::diagonal`].
pub fn g_matrix<T: Real>(c_b_n: &Matrix3<T>) -> SMatrix<T, N, 12> {
    let mut g = SMatrix::<T, N, 12>::zeros();
    g.fixed_view_mut::<3, 3>(VEL, 0).copy_from(c_b_n);
    g.fixed_view_mut::<3, 3>(ATT, 3).copy_from(&-c_b_n);
    g.fixed_view_mut::<3, 3>(BG, 6).fill_with_identity();
    g.fixed_view_mut::<3, 3>(BA, 9).fill_with_identity();
    g
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_diagonal_is_g_q_gt() {
        // A rotation of 3-4-5 triangles about two axes, exact to rounding.
        let c = Matrix3::new(0.6, -0.8, 0.0, 0.8, 0.6, 0.0, 0.0, 0.0, 1.0)
            * Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.8, -0.6, 0.0, 0.6, 0.8);
        let model = BiasModel::from_correlation_times(100.0, f64::INFINITY).unwrap();
        let noise = NoiseDensity::from_random_walks(3.0, 2.0).with_stationary_biases(
            &model,
            [1.0, 2.0, 3.0],
            [1.0, 1.0, 1.0],
        );
        let q = SVector::<f64, 12>::from([
            9.0, 9.0, 9.0, 4.0, 4.0, 4.0, 0.02, 0.08, 0.18, 0.0, 0.0, 0.0,
        ]);
        let g = g_matrix(&c);
        let full = g * SMatrix::from_diagonal(&q) * g.transpose();
        // Sums of three products of numbers up to 9: a few last places of f64.
        assert!((full - SMatrix::from_diagonal(&noise.diagonal())).amax() < 1e-14);
    }

    #[test]
    fn correlation_times_and_densities_are_checked() {
        let times = BiasModel::<f32>::from_correlation_times;
        assert_eq!(
            times(f32::INFINITY, f32::INFINITY),
            Ok(BiasModel::constant())
        );
        assert_eq!(times(f32::NAN, 1.0), Err(Error::NonFinite));
        for bad in [0.0, -1.0, -f32::INFINITY, 1e-45] {
            assert_eq!(times(1.0, bad), Err(Error::OutOfRange), "{bad}");
        }
        let noise = NoiseDensity::from_random_walks(1.0f32, 1.0);
        assert_eq!(noise.check(), Ok(()));
        assert_eq!(
            NoiseDensity {
                accel_bias: [0.0, 0.0, f32::NAN],
                ..noise
            }
            .check(),
            Err(Error::NonFinite)
        );
        assert_eq!(
            NoiseDensity {
                gyro_bias: [0.0, -1.0, 0.0],
                ..noise
            }
            .check(),
            Err(Error::OutOfRange)
        );
        assert_eq!(
            BiasModel {
                rate_g: -1.0f32,
                rate_a: 0.0
            }
            .check(),
            Err(Error::OutOfRange)
        );
    }
}
