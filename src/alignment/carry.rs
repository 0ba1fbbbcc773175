//! What one position has taught about the biases, carried into the next alignment: for power-off or a lost attitude
//! between two positions.
//!
//! Attitude, velocity and position start anew; the biases belong to the sensor and stay. Their 6×6 block of P, in body
//! axes, says along which direction they are known: after one position that is the gyro that pointed north, the up
//! accelerometer, and little else. The block goes on with its correlations; the variances alone would forget that
//! direction.
//!
//! Carrying the attitude as well, by letting the filter run through the turn, is better where it can be had:
//! measured in `host-tests/tests/two_position.rs`.

use nalgebra::{SMatrix, SVector, Vector3};

use crate::error::Error;
use crate::error_model::{BA, BG, N};
use crate::filter::{Filter, Prior, Settings};
use crate::nav::NavState;

/// Bias estimates and their covariance, body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BiasBlock {
    /// Gyro bias [rad/s].
    pub b_g: Vector3<f32>,
    /// Accelerometer bias [m/s²].
    pub b_a: Vector3<f32>,
    /// Covariance of both, gyro first, SI.
    pub p: SMatrix<f32, 6, 6>,
}

impl BiasBlock {
    /// Takes the block out of a filter, best just after an update; between updates call [`Filter::synchronize`] first.
    pub fn of(filter: &Filter) -> Self {
        let (covariance, sigma0) = (filter.covariance(), filter.sigma0());
        let unit = |i: usize| sigma0.get(BG + i).copied().unwrap_or(0.0);
        Self {
            b_g: filter.nav().b_g(),
            b_a: filter.nav().b_a(),
            p: SMatrix::from_fn(|i, j| covariance.element(BG + i, BG + j) * unit(i) * unit(j)),
        }
    }

    /// The same block, less well known: `gyro` [rad/s] and `accel` [m/s²] are what a bias may have changed by since,
    /// 1σ per axis, such as the repeatability from one turn-on to the next.
    pub fn loosened(&self, gyro: f32, accel: f32) -> Self {
        let mut p = self.p;
        let added = [gyro, gyro, gyro, accel, accel, accel];
        let added = SVector::from(added.map(|sigma| sigma * sigma));
        p += SMatrix::from_diagonal(&added);
        Self { p, ..*self }
    }

    /// Starts a filter with these biases. Its biases are known as the block says, all else as `prior` says (the prior's
    /// own biases are not used); ξ of the biases counts from here.
    ///
    /// # Errors
    /// Those of [`Filter::with_covariance`] and [`NavState::with_biases`].
    pub fn start(&self, nav: NavState, prior: &Prior, settings: Settings) -> Result<Filter, Error> {
        let sigma0 = prior.sigma0()?;
        let nav = nav.with_biases(self.b_g, self.b_a)?;
        Filter::correlated(&nav, &settings, |i, j| {
            match (i.checked_sub(BG), j.checked_sub(BG)) {
                (Some(row), Some(column)) => self.p.get((row, column)).copied().unwrap_or_default(),
                _ if i == j => sigma0.get(i).map_or(0.0, |sigma| sigma * sigma),
                _ => 0.0,
            }
        })
    }
}

const _: () = assert!(BG + 3 == BA && BA + 3 == N);
