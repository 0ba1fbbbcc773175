//! A standing alignment with a navigation-grade sensor: what its tests start from.

use navsight::alignment::standing::Plan;
use navsight::filter::{Prior, Settings};
use navsight::measurement::ZeroVelocity;

use super::{SensorErrors, DEG};

/// Half a minute of coarse window and an update a second; biases of 0.02 °/h and 100 µg, the noise of
/// [`SensorErrors::NAVIGATION`].
pub fn navigation_grade() -> (Plan, Prior, Settings) {
    let errors = SensorErrors::NAVIGATION;
    let rad = DEG as f32;
    let plan = Plan {
        coarse_duration: 30.0,
        zero_velocity: ZeroVelocity::new(0.002, 1.0).expect("a σ and an interval above zero"),
        turning: rad,
    };
    let prior = Prior {
        position: [1.0; 3],
        velocity: [0.1; 3],
        attitude: [0.5 * rad, 0.5 * rad, 2.0 * rad],
        gyro_bias: [0.02 * rad / 3600.0; 3],
        accel_bias: [9.8e-4; 3],
    };
    let settings = errors.settings();
    (plan, prior, settings)
}
