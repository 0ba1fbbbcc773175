//! What the lab is told about a sensor and a filter: TOML with units in the key names, and its way into the library.
//!
//! ```toml
//! [sensor]                      # one grade for all three axes
//! gyro_bias_deg_h = 0.02
//! accel_bias_ug = 100
//! angle_walk_deg_sqrt_h = 0.003
//! velocity_walk_ug_sqrt_hz = 10
//! gyro_tau_h = 20               # correlation time; left out: constant
//! accel_tau_h = 20
//!
//! [prior]                       # how well the start is known
//! position_m = 10
//! velocity_m_s = 0.15
//! level_deg = 0.5
//! heading_deg = 3
//!
//! [zero_velocity]
//! sigma_m_s = 0.005
//! interval_s = 1
//! turning_deg_s = 1             # above this mean rate it is a turn, not a standstill
//!
//! [coarse]
//! seconds = 60
//!
//! [filter]
//! propagation_interval_s = 0.1
//! gate = 25                     # largest ν²/s of a row; left out: none is refused
//! gap_s = 0.5                   # longest sample
//!
//! [gnss]
//! position_m = 2
//! height_m = 4
//! velocity_m_s = 0.1
//! latency_s = 0.25              # how old a fix is when its line comes
//! lever_arm_m = [0.2, 0, 0.9]   # from the IMU to the antenna: right, forward, up
//! lock_out_s = 5                # refused for so long the filter is reset to it
//!
//! [wheels]                      # a vehicle that moves neither sideways nor upwards; left out: it may
//! axle_m = [0, -1.2, -0.5]      # from the IMU to the axle that is not steered
//! boresight_deg = [1.5, 0, 0]   # how the vehicle stands to the IMU: heading, pitch, roll
//! sideways_m_s = 0.1
//! upwards_m_s = 0.2
//! interval_s = 0.2
//!
//! [required]                    # σ that the user wants; left out: no requirement
//! position_m = 5
//! velocity_m_s = 0.05
//! level_deg = 0.02
//! heading_deg = 0.2
//! gyro_bias_deg_h = 0.01
//! accel_bias_ug = 50
//! ```

use std::fs;
use std::path::Path;

use navsight::alignment::standing::Plan;
use navsight::attitude::Euler;
use navsight::error::Error;
use navsight::error_model::{BiasModel, NoiseDensity, N};
use navsight::filter::{Prior, Settings};
use navsight::imu::ImuLimits;
use navsight::measurement::{Antenna, Boresight, NonHolonomic, ZeroVelocity};
use serde::de::DeserializeOwned;
use serde::Deserialize;

use crate::flight::Setup;
use crate::lab::LabError;

mod number;

pub use number::check_latency;

/// One degree per hour [rad/s].
pub const DEG_PER_H: f64 = core::f64::consts::PI / 180.0 / 3600.0;
/// One micro-g [m/s²].
pub const MICRO_G: f64 = 9.806_65e-6;
const HOUR: f64 = 3600.0;
const STANDARD_GRAVITY: f64 = 9.806_65;

/// Everything but the position.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Grade of the sensor.
    pub sensor: Sensor,
    /// How well the start is known.
    pub prior: Start,
    /// The zero-velocity update.
    pub zero_velocity: StandingStill,
    /// The coarse window.
    pub coarse: Coarse,
    /// How the filter runs.
    pub filter: Running,
    /// How good satellite fixes are.
    pub gnss: Gnss,
    /// A vehicle on wheels.
    pub wheels: Option<Wheels>,
    /// What is wanted of the states.
    pub required: Required,
}

/// Standard deviations that the user wants, per axis; none: no requirement.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Required {
    /// [m]
    #[serde(deserialize_with = "number::positive_or_none")]
    pub position_m: Option<f64>,
    /// [m/s]
    #[serde(deserialize_with = "number::positive_or_none")]
    pub velocity_m_s: Option<f64>,
    /// Tilt [°].
    #[serde(deserialize_with = "number::positive_or_none")]
    pub level_deg: Option<f64>,
    /// Heading [°].
    #[serde(deserialize_with = "number::positive_or_none")]
    pub heading_deg: Option<f64>,
    /// [°/h]
    #[serde(deserialize_with = "number::positive_or_none")]
    pub gyro_bias_deg_h: Option<f64>,
    /// [µg]
    #[serde(deserialize_with = "number::positive_or_none")]
    pub accel_bias_ug: Option<f64>,
}

impl Required {
    /// In the order of the states, SI.
    pub fn sigma(&self) -> [Option<f32>; N] {
        let [r, v, level, heading, g, a] = [
            (self.position_m, 1.0),
            (self.velocity_m_s, 1.0),
            (self.level_deg, 1f64.to_radians()),
            (self.heading_deg, 1f64.to_radians()),
            (self.gyro_bias_deg_h, DEG_PER_H),
            (self.accel_bias_ug, MICRO_G),
        ]
        .map(|(sigma, unit)| sigma.map(|s| (s * unit) as f32));
        [r, r, r, v, v, v, level, level, heading, g, g, g, a, a, a]
    }
}

/// Grade of the sensor, navigation grade unless said otherwise.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sensor {
    /// Gyro bias, 1σ [°/h].
    #[serde(deserialize_with = "number::not_negative")]
    pub gyro_bias_deg_h: f64,
    /// Accelerometer bias, 1σ [µg].
    #[serde(deserialize_with = "number::not_negative")]
    pub accel_bias_ug: f64,
    /// Angle random walk [°/√h].
    #[serde(deserialize_with = "number::not_negative")]
    pub angle_walk_deg_sqrt_h: f64,
    /// Velocity random walk [µg/√Hz].
    #[serde(deserialize_with = "number::not_negative")]
    pub velocity_walk_ug_sqrt_hz: f64,
    /// Random walk of the gyro bias [°/h/√s], besides that of the correlation time.
    #[serde(deserialize_with = "number::not_negative")]
    pub gyro_bias_walk_deg_h_sqrt_s: f64,
    /// Random walk of the accelerometer bias [µg/√s], besides that of the correlation time.
    #[serde(deserialize_with = "number::not_negative")]
    pub accel_bias_walk_ug_sqrt_s: f64,
    /// Correlation time of the gyro bias [h]; none: constant.
    #[serde(deserialize_with = "number::positive_or_none")]
    pub gyro_tau_h: Option<f64>,
    /// Correlation time of the accelerometer bias [h]; none: constant.
    #[serde(deserialize_with = "number::positive_or_none")]
    pub accel_tau_h: Option<f64>,
}

impl Default for Sensor {
    fn default() -> Self {
        Self::of(Grade::Navigation)
    }
}

/// Grades of inertial sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// 0.003 °/h, 25 µg
    High,
    /// 0.02 °/h, 100 µg
    Navigation,
    /// 1 °/h, 1000 µg
    Tactical,
}

impl Sensor {
    /// Typical numbers of a grade.
    pub fn of(grade: Grade) -> Self {
        let [gyro_bias_deg_h, accel_bias_ug, angle_walk_deg_sqrt_h, velocity_walk_ug_sqrt_hz] =
            match grade {
                Grade::High => [0.003, 25.0, 0.0005, 5.0],
                Grade::Navigation => [0.02, 100.0, 0.003, 10.0],
                Grade::Tactical => [1.0, 1000.0, 0.1, 100.0],
            };
        Self {
            gyro_bias_deg_h,
            accel_bias_ug,
            angle_walk_deg_sqrt_h,
            velocity_walk_ug_sqrt_hz,
            gyro_bias_walk_deg_h_sqrt_s: 0.0,
            accel_bias_walk_ug_sqrt_s: 0.0,
            gyro_tau_h: None,
            accel_tau_h: None,
        }
    }

    /// Angle random walk [rad/√s].
    pub fn angle_walk(&self) -> f64 {
        self.angle_walk_deg_sqrt_h.to_radians() / HOUR.sqrt()
    }

    /// Velocity random walk [m/s/√s].
    pub fn velocity_walk(&self) -> f64 {
        self.velocity_walk_ug_sqrt_hz * MICRO_G
    }

    /// Gyro bias, 1σ [rad/s].
    pub fn gyro_bias(&self) -> f64 {
        self.gyro_bias_deg_h * DEG_PER_H
    }

    /// Accelerometer bias, 1σ [m/s²].
    pub fn accel_bias(&self) -> f64 {
        self.accel_bias_ug * MICRO_G
    }
}

/// Standard deviations at the start; those of the biases are the sensor's.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Start {
    /// Position, per axis [m].
    #[serde(deserialize_with = "number::not_negative")]
    pub position_m: f64,
    /// Velocity, per axis [m/s].
    #[serde(deserialize_with = "number::not_negative")]
    pub velocity_m_s: f64,
    /// Tilt after the coarse window [°].
    #[serde(deserialize_with = "number::not_negative")]
    pub level_deg: f64,
    /// Heading after the coarse window [°].
    #[serde(deserialize_with = "number::not_negative")]
    pub heading_deg: f64,
}

impl Default for Start {
    fn default() -> Self {
        Self {
            position_m: 10.0,
            velocity_m_s: 0.15,
            level_deg: 0.5,
            heading_deg: 3.0,
        }
    }
}

/// The zero-velocity update.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StandingStill {
    /// Residual motion, per axis [m/s].
    #[serde(deserialize_with = "number::positive")]
    pub sigma_m_s: f64,
    /// Between two updates [s].
    #[serde(deserialize_with = "number::positive")]
    pub interval_s: f64,
    /// Mean rate above which the vehicle turns [°/s].
    #[serde(deserialize_with = "number::positive")]
    pub turning_deg_s: f64,
}

impl Default for StandingStill {
    fn default() -> Self {
        Self {
            sigma_m_s: 0.005,
            interval_s: 1.0,
            turning_deg_s: 1.0,
        }
    }
}

/// The coarse window.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Coarse {
    /// Its length [s].
    #[serde(deserialize_with = "number::window")]
    pub seconds: f64,
}

impl Default for Coarse {
    fn default() -> Self {
        Self { seconds: 60.0 }
    }
}

/// How the filter runs.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Running {
    /// The covariance moves at least this often [s].
    #[serde(deserialize_with = "number::positive")]
    pub propagation_interval_s: f64,
    /// Largest ν²/s of a row; none: every row is used.
    #[serde(deserialize_with = "number::positive_or_none")]
    pub gate: Option<f64>,
    /// Longest sample [s].
    #[serde(deserialize_with = "number::positive")]
    pub gap_s: f64,
}

impl Default for Running {
    fn default() -> Self {
        Self {
            propagation_interval_s: 0.1,
            gate: None,
            gap_s: 0.5,
        }
    }
}

/// How good satellite fixes are, 1σ, where their file does not say it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Gnss {
    /// East and north [m].
    #[serde(deserialize_with = "number::positive")]
    pub position_m: f64,
    /// Up [m].
    #[serde(deserialize_with = "number::positive")]
    pub height_m: f64,
    /// Velocity, per axis [m/s].
    #[serde(deserialize_with = "number::positive")]
    pub velocity_m_s: f64,
    /// How old a fix is when its line comes [s].
    #[serde(deserialize_with = "number::latency")]
    pub latency_s: f64,
    /// From the IMU to the antenna: right, forward, up [m].
    #[serde(deserialize_with = "number::lever_arm")]
    pub lever_arm_m: [f64; 3],
    /// Refused for so long, the filter is reset to the fixes [s].
    #[serde(deserialize_with = "number::not_negative")]
    pub lock_out_s: f64,
}

impl Default for Gnss {
    fn default() -> Self {
        Self {
            position_m: 2.0,
            height_m: 4.0,
            velocity_m_s: 0.1,
            latency_s: 0.0,
            lever_arm_m: [0.0; 3],
            lock_out_s: 5.0,
        }
    }
}

/// A vehicle that moves neither sideways nor upwards.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Wheels {
    /// From the IMU to the axle that is not steered: right, forward, up [m].
    #[serde(deserialize_with = "number::lever_arm")]
    pub axle_m: [f64; 3],
    /// How the vehicle stands to the IMU: heading, pitch, roll [°].
    pub boresight_deg: [f64; 3],
    /// 1σ of its side slip [m/s].
    #[serde(deserialize_with = "number::positive")]
    pub sideways_m_s: f64,
    /// 1σ upwards [m/s].
    #[serde(deserialize_with = "number::positive")]
    pub upwards_m_s: f64,
    /// Between two uses [s].
    #[serde(deserialize_with = "number::positive")]
    pub interval_s: f64,
}

impl Default for Wheels {
    fn default() -> Self {
        Self {
            axle_m: [0.0; 3],
            boresight_deg: [0.0; 3],
            sideways_m_s: 0.1,
            upwards_m_s: 0.2,
            interval_s: 0.2,
        }
    }
}

impl Wheels {
    /// The constraint.
    ///
    /// # Errors
    /// Those of [`Antenna::new`], [`Boresight::new`] and [`NonHolonomic::new`].
    pub fn constraint(&self) -> Result<NonHolonomic, Error> {
        let axle = nalgebra::Vector3::from(self.axle_m.map(|x| x as f32));
        let [heading, pitch, roll] = self.boresight_deg.map(|x| x as f32);
        NonHolonomic::new(
            Antenna::new(axle)?,
            Boresight::new(Euler::from_degrees(heading, pitch, roll))?,
            self.sideways_m_s as f32,
            self.upwards_m_s as f32,
            self.interval_s as f32,
        )
    }
}

impl Config {
    /// What the filter is started with at this latitude [rad]. A sensor whose biases tilt the level or turn the
    /// gyrocompass by more than the configured level and heading makes those wider.
    pub fn prior(&self, lat: f64) -> Prior {
        let p = &self.prior;
        let tilt = self.sensor.accel_bias() / STANDARD_GRAVITY;
        let level = p.level_deg.to_radians().max(tilt) as f32;
        let compass = self.sensor.gyro_bias() / (navsight::earth::OMEGA_IE * lat.cos());
        let heading = p.heading_deg.to_radians().max(compass);
        let heading = (heading as f32).min(navsight::alignment::coarse::UNKNOWN_HEADING);
        Prior {
            position: [p.position_m as f32; 3],
            velocity: [p.velocity_m_s as f32; 3],
            attitude: [level, level, heading],
            gyro_bias: [self.sensor.gyro_bias() as f32; 3],
            accel_bias: [self.sensor.accel_bias() as f32; 3],
        }
    }

    /// How the filter runs.
    ///
    /// # Errors
    /// Those of [`BiasModel::from_correlation_times`] and [`Settings::check`].
    pub fn settings(&self) -> Result<Settings, Error> {
        let s = &self.sensor;
        let seconds = |tau: Option<f64>| tau.map_or(f32::INFINITY, |h| (h * HOUR) as f32);
        let bias =
            BiasModel::from_correlation_times(seconds(s.gyro_tau_h), seconds(s.accel_tau_h))?;
        let (gyro, accel) = (s.gyro_bias() as f32, s.accel_bias() as f32);
        let noise =
            NoiseDensity::from_random_walks(s.velocity_walk() as f32, s.angle_walk() as f32)
                .with_stationary_biases(&bias, [gyro; 3], [accel; 3]);
        let square = |x: f64| (x * x) as f32;
        let gyro_walk = square(s.gyro_bias_walk_deg_h_sqrt_s * DEG_PER_H);
        let accel_walk = square(s.accel_bias_walk_ug_sqrt_s * MICRO_G);
        let noise = NoiseDensity {
            gyro_bias: noise.gyro_bias.map(|q| q + gyro_walk),
            accel_bias: noise.accel_bias.map(|q| q + accel_walk),
            ..noise
        };
        let settings = Settings {
            limits: ImuLimits {
                dt_max: self.filter.gap_s as f32,
                ..ImuLimits::DEFAULT
            },
            noise,
            bias,
            propagation_interval: self.filter.propagation_interval_s as f32,
            gate: self.filter.gate.map(|g| g as f32),
        };
        settings.check()?;
        Ok(settings)
    }

    /// How a recording is filtered; at rest by its flags only where the caller says so.
    ///
    /// # Errors
    /// Those of [`Config::settings`], [`Antenna::new`] and [`Wheels::constraint`].
    pub fn setup(&self) -> Result<Setup, Error> {
        let (s, g) = (&self.sensor, &self.gnss);
        let lever = nalgebra::Vector3::from(g.lever_arm_m.map(|x| x as f32));
        Ok(Setup {
            settings: self.settings()?,
            sigma: [g.position_m, g.height_m, g.velocity_m_s].map(|x| x as f32),
            latency: g.latency_s,
            antenna: Antenna::new(lever)?,
            lock_out: g.lock_out_s as f32,
            wheels: self.wheels.as_ref().map(Wheels::constraint).transpose()?,
            rest: None,
            heading: self.prior.heading_deg.max(1.0).to_radians() as f32,
            start: [
                self.prior.level_deg.to_radians() as f32,
                s.gyro_bias() as f32,
                s.accel_bias() as f32,
            ],
        })
    }

    /// How a standing vehicle is aligned.
    ///
    /// # Errors
    /// Those of [`ZeroVelocity::new`].
    pub fn plan(&self) -> Result<Plan, Error> {
        let z = &self.zero_velocity;
        Ok(Plan {
            coarse_duration: self.coarse.seconds as f32,
            zero_velocity: ZeroVelocity::new(z.sigma_m_s as f32, z.interval_s as f32)?,
            turning: z.turning_deg_s.to_radians() as f32,
        })
    }
}

/// Reads a TOML file; what is wrong with it is said with its line and its key.
///
/// # Errors
/// The file cannot be read, is no TOML, has an unknown key or a value of the wrong kind.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, LabError> {
    let text = fs::read_to_string(path)
        .map_err(|e| LabError::in_file(path, format!("cannot be read: {e}")))?;
    let refused = |error: &toml::de::Error, key: Option<String>| {
        let at = error.span().map_or(0, |span| span.start);
        let line = 1 + text.bytes().take(at).filter(|&b| b == b'\n').count();
        let refused = LabError::in_file(path, error.message().to_owned()).line(line);
        match key {
            Some(key) => refused.field(key),
            None => refused,
        }
    };
    let document = toml::Deserializer::parse(&text).map_err(|e| refused(&e, None))?;
    serde_path_to_error::deserialize(document).map_err(|error| {
        let key = error.path().to_string();
        let mut inner = error.into_inner();
        inner.set_input(Some(&text));
        refused(&inner, (key != ".").then_some(key))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_accepted_by_the_library() {
        let config = Config::default();
        assert!(config.settings().is_ok() && config.plan().is_ok());
        assert_eq!(config.prior(0.6).attitude[2], 3f32.to_radians());
        assert!(config.prior(0.6).sigma0().is_ok());
        let tactical = Config {
            sensor: Sensor::of(Grade::Tactical),
            ..config.clone()
        };
        // 1 °/h over 15.04 °/h cos 60°
        let heading = tactical.prior(60f64.to_radians()).attitude[2];
        assert!((heading - 0.13297).abs() < 1e-4, "{heading}");
        // 0.02 °/h and 10 µg/√Hz in SI
        assert!((config.sensor.gyro_bias() - 9.696e-8).abs() < 1e-11);
        assert!((config.sensor.velocity_walk() - 9.807e-5).abs() < 1e-8);
    }

    #[test]
    fn a_wrong_key_is_named_with_its_line() {
        let path = std::env::temp_dir().join("navsight_config_test.toml");
        for (text, place) in [
            (
                "[sensor]\ngyro_bias_deg_h = \"a\"\n",
                ":2: sensor.gyro_bias_deg_h: ",
            ),
            ("[sensor]\n\ngyro_bais = 1\n", ":3: sensor.gyro_bais: "),
            ("[sensor\n", ":1: "),
        ] {
            fs::write(&path, text).unwrap();
            let message = read::<Config>(&path).unwrap_err().to_string();
            assert!(message.contains(place), "{message}");
        }
    }
}
