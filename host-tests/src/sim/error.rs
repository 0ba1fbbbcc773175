//! What an estimate is wrong by, in the error states of the filter.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use navsight::earth::Geodetic;
use navsight::error_model::N;
use navsight::filter::Filter;

use super::{SensorErrors, Truth};

/// Estimate minus truth in the filter's error states (biases: truth minus estimate), SI.
pub fn error_state(filter: &Filter, truth: &Truth, sensor: &SensorErrors) -> [f64; N] {
    let nav = filter.nav();
    let local = nav.local();
    let there = Geodetic {
        lat: truth.lat,
        lon: truth.lon,
        height: truth.height,
    };
    let r = nav
        .displacement_to(&there)
        .map_or(Vector3::repeat(f64::NAN), |d| -d.map(f64::from));
    // Ĉ = (I − [φ×]) C and ψ = φ − δθ
    let estimate: Matrix3<f64> = navsight::attitude::c_b_n(nav.quaternion().map(f64::from));
    let turn = truth.q.to_rotation_matrix().matrix() * estimate.transpose();
    let phi = Vector3::new(
        turn.m32 - turn.m23,
        turn.m13 - turn.m31,
        turn.m21 - turn.m12,
    ) * 0.5;
    let theta = Vector3::new(
        -r.y * f64::from(local.inv_r_m),
        r.x * f64::from(local.inv_r_n),
        r.x * f64::from(local.inv_r_n * local.tan_lat),
    );
    let psi = phi - theta;
    // the true velocity, resolved in the frame at the estimated position
    let v = nav.v_n().map(f64::from) - (truth.v_n - theta.cross(&truth.v_n));
    let g = sensor.gyro_bias - nav.b_g().map(f64::from);
    let b = sensor.accel_bias - nav.b_a().map(f64::from);
    let mut error = [0.0; N];
    for (to, x) in error.iter_mut().zip([r, v, psi, g, b].iter().flatten()) {
        *to = *x;
    }
    error
}

/// Covariance of the filter's error states, SI.
pub fn covariance(filter: &Filter) -> SMatrix<f64, N, N> {
    let unit = SVector::from(*filter.sigma0()).map(f64::from);
    let unit = SMatrix::<f64, N, N>::from_diagonal(&unit);
    unit * filter.covariance().to_matrix().cast::<f64>() * unit
}
