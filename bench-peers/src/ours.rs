//! navsight, moved as often as the others (at every sample), and as it is meant to be (ten times a second).

use core::hint::black_box;

use nalgebra::Vector3;
use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use navsight::error_model::{BiasModel, NoiseDensity};
use navsight::filter::{Filter, Prior, Settings, UpdateReport};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::ZeroVelocity;
use navsight::nav::NavState;
use navsight::observability::diagonal::Xi;

use crate::scenario::*;

pub struct Ours<const EVERY: u32> {
    filter: Filter,
    standing: ZeroVelocity,
    report: UpdateReport<3>,
}

/// Covariance moved at every sample.
pub type EverySample = Ours<1>;
/// Covariance moved ten times a second.
pub type TenHertz = Ours<10>;

fn three(x: [f64; 3]) -> Vector3<f32> {
    Vector3::new(x[0] as f32, x[1] as f32, x[2] as f32)
}

impl<const EVERY: u32> Peer for Ours<EVERY> {
    const NAME: &'static str = if EVERY == 1 {
        "navsight, covariance at every sample"
    } else {
        "navsight, covariance at 10 Hz"
    };
    const SCALAR: &'static str = "f32";
    const ALGEBRA_ONLY: bool = false;

    fn start() -> Option<Self> {
        let attitude = Euler::from_degrees(
            (HEADING_DEG + HEADING_ERROR_DEG) as f32,
            (PITCH_DEG + PITCH_ERROR_DEG) as f32,
            ROLL_DEG as f32,
        );
        let here = Geodetic::from_degrees(LAT_DEG, LON_DEG, HEIGHT_M);
        let nav = NavState::new(here, Vector3::zeros(), attitude).ok()?;
        let [angle, velocity, gyro, accel] = WALKS;
        let mut noise = NoiseDensity::from_random_walks(angle as f32, velocity as f32);
        noise.gyro_bias = [(gyro * gyro) as f32; 3];
        noise.accel_bias = [(accel * accel) as f32; 3];
        let prior = Prior {
            position: [PRIOR_POSITION as f32; 3],
            velocity: [PRIOR_VELOCITY as f32; 3],
            attitude: [PRIOR_TILT as f32, PRIOR_TILT as f32, PRIOR_HEADING as f32],
            gyro_bias: [PRIOR_GYRO as f32; 3],
            accel_bias: [PRIOR_ACCEL as f32; 3],
        };
        let settings = Settings {
            limits: ImuLimits::DEFAULT,
            noise,
            bias: BiasModel::constant(),
            propagation_interval: EVERY as f32 * DT as f32,
            gate: Some(16.3),
        };
        Some(Self {
            filter: Filter::new(nav, &prior, settings).ok()?,
            standing: ZeroVelocity::new(SIGMA_VELOCITY as f32, 1.0).ok()?,
            report: UpdateReport::empty(),
        })
    }

    fn predict(&mut self, sample: &Sample) -> bool {
        let imu = ImuIncrement::from_rates(three(sample.omega), three(sample.f), DT as f32);
        self.filter.propagate(&imu).is_ok()
    }

    fn update(&mut self, _: u32) -> bool {
        let rows = self.standing.linearize(self.filter.nav());
        if self.filter.update_into(&rows, &mut self.report).is_err() {
            return false;
        }
        black_box(Xi::of(&self.report)).is_ok()
    }

    fn velocity_variance(&self) -> f64 {
        let sigma = f64::from(self.filter.sigma(3).unwrap_or(f32::NAN));
        sigma * sigma
    }

    fn attitude_deg(&self) -> Option<[f64; 3]> {
        let e = self.filter.nav().euler();
        Some([e.heading, e.pitch, e.roll].map(|x| f64::from(x) / RAD))
    }
}
