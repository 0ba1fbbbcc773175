//! What a real sensor makes of the ideal increments: constant biases, white noise, single precision.

use nalgebra::Vector3;
use navsight::error_model::{BiasModel, NoiseDensity};
use navsight::filter::Settings;
use navsight::imu::{ImuIncrement, ImuLimits};
use rand::{rngs::StdRng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

use super::{truth::Ideal, DEG};

/// Biases and noise of a sensor. A sample is the truth plus these.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorErrors {
    /// Gyro bias, body axes [rad/s].
    pub gyro_bias: Vector3<f64>,
    /// Accelerometer bias, body axes [m/s²].
    pub accel_bias: Vector3<f64>,
    /// Angular random walk [rad/√s].
    pub arw: f64,
    /// Velocity random walk [m/s/√s].
    pub vrw: f64,
}

impl SensorErrors {
    /// None at all: what is left is the rounding to f32.
    pub const NONE: Self = Self {
        gyro_bias: Vector3::new(0.0, 0.0, 0.0),
        accel_bias: Vector3::new(0.0, 0.0, 0.0),
        arw: 0.0,
        vrw: 0.0,
    };
    /// Noise of a tactical-grade sensor, 0.1 °/√h and 100 µg/√Hz, without biases.
    pub const TACTICAL: Self = Self {
        arw: 0.1 * DEG / 60.0,
        vrw: 100.0 * 9.806_65e-6,
        ..Self::NONE
    };
    /// Noise of a navigation-grade sensor, 0.002 °/√h and 10 µg/√Hz, without biases.
    pub const NAVIGATION: Self = Self {
        arw: 0.002 * DEG / 60.0,
        vrw: 10.0 * 9.806_65e-6,
        ..Self::NONE
    };

    /// With biases in the units of data sheets: °/h and µg.
    pub fn with_biases(self, gyro_deg_per_h: [f64; 3], accel_ug: [f64; 3]) -> Self {
        Self {
            gyro_bias: Vector3::from(gyro_deg_per_h) * (DEG / 3600.0),
            accel_bias: Vector3::from(accel_ug) * 9.806_65e-6,
            ..self
        }
    }

    /// Settings of a filter that knows this noise: constant biases, the covariance moved every 0.1 s, no gate.
    pub fn settings(&self) -> Settings {
        Settings {
            limits: ImuLimits::DEFAULT,
            noise: NoiseDensity::from_random_walks(self.vrw as f32, self.arw as f32),
            bias: BiasModel::constant(),
            propagation_interval: 0.1,
            gate: None,
        }
    }
}

/// A sensor with a seeded noise source.
#[derive(Debug)]
pub struct Sensor {
    /// Its errors.
    pub errors: SensorErrors,
    rng: StdRng,
}

impl Sensor {
    /// The same seed gives the same noise.
    pub fn new(errors: SensorErrors, seed: u64) -> Self {
        Self {
            errors,
            rng: StdRng::seed_from_u64(seed),
        }
    }

    /// Three independent standard normal numbers.
    pub fn normal(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| StandardNormal.sample(&mut self.rng))
    }

    /// The sample that this sensor reports.
    pub fn sample(&mut self, ideal: &Ideal) -> ImuIncrement {
        let (e, root) = (self.errors, ideal.dt.sqrt());
        let mut theta = ideal.delta_theta_b + e.gyro_bias * ideal.dt;
        let mut v = ideal.delta_v_b + e.accel_bias * ideal.dt;
        if e.arw > 0.0 {
            theta += self.normal() * (e.arw * root);
        }
        if e.vrw > 0.0 {
            v += self.normal() * (e.vrw * root);
        }
        ImuIncrement::new(theta.cast::<f32>(), v.cast::<f32>(), ideal.dt as f32)
    }
}
