//! What is simulated: where, in which positions, with which sensor, and what the filter is told about it.

use nalgebra::Vector3;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{BiasModel, NoiseDensity};
use navsight::filter::{Prior, Settings};
use navsight::imu::ImuLimits;

use crate::sim::{Ideal, Position, Schedule, SensorErrors, Simulator, Truth, DEG};

/// One microgram of specific force [m/s²].
const MICRO_G: f64 = 9.806_65e-6;

/// An alignment in one position after another.
///
/// Samples are long: a vehicle at rest turns by 7e-6 rad in 0.1 s, and white noise has the same effect in one increment of
/// 0.1 s as in ten of 0.01 s. What is lost is nothing but the noise within a sample; the turns are resolved exactly,
/// since the ideal increments are integrals and a turn about one axis has no coning. The covariance moves in steps of 0.1 s,
/// as it does at 100 Hz.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Positions and turns.
    pub schedule: Schedule,
    /// Length of a sample [s].
    pub dt: f64,
    /// Between two velocity updates [s].
    pub interval: f64,
    /// Noise and biases of the sensor; the biases are those of every seed, or none when they are drawn.
    pub sensor: SensorErrors,
    /// Draw biases from the prior, and initial velocity as well.
    pub draw_biases: bool,
    /// What the filter knows at the start, and what the coarse attitude of every new start is drawn from.
    pub prior: Prior,
    /// Residual motion, 1σ per axis, white from update to update [m/s].
    pub disturbance: f64,
    /// What the filter takes it for [m/s].
    pub sigma_velocity: f64,
    /// Seconds into each position at which errors are taken, besides its end.
    pub marks: Vec<f64>,
}

impl Scenario {
    /// Section 3 of Peng 2016 as rebuilt in the notes: 10 min at one heading, a turn of `turn_deg` counter-clockwise, and
    /// 15 min at a yaw of 143.438°, latitude 40°. Level gyro biases of 0.03 and 0.05 °/h, level accelerometer biases of
    /// 50 µg, 10 µg/√Hz, a real motion of 1 mm/s taken for 1 cm/s, a coarse heading of 1°.
    pub fn peng(turn_deg: f64, angle_walk_deg_sqrt_h: f64) -> Self {
        let rad = DEG as f32;
        let second = -143.438; // clockwise
        Self {
            schedule: Schedule {
                at: Geodetic::from_degrees(40.0, 0.0, 0.0),
                positions: vec![
                    Position::degrees(second + turn_deg, 0.0, 0.0, 600.0),
                    Position::degrees(second, 0.0, 0.0, 900.0),
                ],
                turn: 10.0,
            },
            dt: 0.1,
            interval: 1.0,
            sensor: SensorErrors {
                arw: angle_walk_deg_sqrt_h * DEG / 60.0,
                vrw: 10.0 * MICRO_G,
                ..SensorErrors::NONE
            }
            .with_biases([0.03, 0.05, 0.03], [50.0, 50.0, 50.0]),
            draw_biases: false,
            prior: Prior {
                position: [1.0; 3],
                velocity: [0.15; 3],
                attitude: [0.5 * rad, 0.5 * rad, rad],
                gyro_bias: [0.05 * rad / 3600.0; 3],
                accel_bias: [100.0 * MICRO_G as f32; 3],
            },
            disturbance: 1e-3,
            sigma_velocity: 1e-2,
            marks: Vec::new(),
        }
    }

    /// The same with nothing that the filter has not been told: truth drawn from the prior, R equal to the real motion.
    /// The start is level as a coarse window makes it, 0.01° (a bias of 100 µg is 0.006°). With tilts of 0.05° the product of
    /// tilt and heading error, which a linear filter leaves out, would be a microgram: taken for information, it moves the
    /// level accelerometer biases, of which one position says nothing, by a tenth of their σ.
    pub fn consistent(mut self) -> Self {
        let rad = DEG as f32;
        self.draw_biases = true;
        self.prior.attitude = [0.01 * rad, 0.01 * rad, rad];
        self.prior.velocity = [0.05; 3];
        self.sigma_velocity = self.disturbance;
        self
    }

    /// What the filter is started with.
    ///
    /// # Errors
    /// Those of [`Settings::check`].
    pub fn settings(&self) -> Result<Settings, Error> {
        let (vrw, arw) = (self.sensor.vrw as f32, self.sensor.arw as f32);
        let settings = Settings {
            limits: ImuLimits::DEFAULT,
            noise: NoiseDensity::from_random_walks(vrw, arw),
            bias: BiasModel::constant(),
            propagation_interval: 0.1,
            gate: None,
        };
        settings.check().map(|()| settings)
    }

    /// Standard deviation of the prior as a vector.
    pub(super) fn sigma(three: &[f32; 3]) -> Vector3<f64> {
        Vector3::from(*three).cast()
    }

    /// The true states and ideal samples, the same for every seed.
    pub fn track(&self) -> Vec<(Truth, Ideal)> {
        let samples = (self.schedule.seconds() / self.dt).round() as usize;
        Simulator::new(&self.schedule, self.dt)
            .take(samples)
            .collect()
    }
}
