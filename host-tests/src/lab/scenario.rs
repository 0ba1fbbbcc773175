//! Scenarios of alignment in several positions: TOML with units in the key names.
//!
//! ```toml
//! lat_deg = 40
//! height_m = 0
//! turn_s = 10                   # each turn from one position to the next
//! sample_s = 0.1                # at rest nothing is lost by long samples
//! interval_s = 1                # between zero-velocity updates
//! seeds = 20
//! first_seed = 1000
//! variants = ["full", "carry", "peng-once", "peng-every", "paper-eq5", "one-position"]
//! marks_s = [60, 300]           # seconds into each position to look at, besides its end
//!
//! [[position]]
//! heading_deg = -53.438
//! seconds = 600
//! [[position]]
//! heading_deg = -143.438        # the turn goes by the difference as it is written
//! pitch_deg = 0
//! roll_deg = 0
//! seconds = 900
//!
//! [sensor]
//! grade = "navigation"          # high, navigation, tactical; the numbers below stand over it
//! gyro_bias_deg_h = 0.05        # 1σ, what the filter is told; accel_bias_ug likewise
//! angle_walk_deg_sqrt_h = 0.003
//! velocity_walk_ug_sqrt_hz = 10
//!
//! [biases]                      # of every seed; left out: drawn from the sensor's
//! gyro_deg_h = [0.03, 0.05, 0.03]
//! accel_ug = [50, 50, 50]
//!
//! [prior]                       # of each start; the coarse attitude is drawn from it
//! position_m = 1
//! velocity_m_s = 0.15
//! level_deg = 0.5
//! heading_deg = 1
//!
//! [disturbance]
//! velocity_m_s = 0.001          # what the vehicle does, white from update to update
//! taken_for_m_s = 0.01          # what the filter takes it for; left out: the same
//! ```
//!
//! Without a file it is section 3 of Peng 2016, which these numbers are. Of a file, positions, times and priors that are
//! left out are those; sensor, biases and disturbance are a navigation-grade sensor that the filter knows.

use std::path::Path;

use navsight::earth::Geodetic;
use navsight::filter::Prior;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use super::LabError;
use crate::alignment::{Scenario, Variant};
use crate::config::{self, Grade, MICRO_G};
use crate::sim::{Position, Schedule, SensorErrors};

/// A number within limits, so that a refusal has its line and its key.
macro_rules! bounded {
    ($($name:ident: $low:literal, $high:literal;)*) => { $(
        fn $name<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
            let x = f64::deserialize(d)?;
            if ($low..=$high).contains(&x) {
                Ok(x)
            } else {
                Err(D::Error::custom(format!("{x} is outside {} … {}", $low, $high)))
            }
        }
    )* };
}

bounded! {
    latitude: -80.0, 80.0;
    height: -1e4, 1e5;
    angle: -720.0, 720.0;
    tilt: -89.0, 89.0;
    duration: 1.0, 86_400.0;
    turn: 0.1, 3600.0;
    sample: 0.001, 0.5;
    interval: 0.1, 100.0;
    velocity: 1e-6, 10.0;
    place: 1e-3, 1e4;
    degrees: 1e-4, 100.0;
}

/// A number above zero that may be left out.
fn positive<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    let x = f64::deserialize(d)?;
    if (1e-9..=1e9).contains(&x) {
        Ok(Some(x))
    } else {
        Err(D::Error::custom(format!("{x} is outside 1e-9 … 1e9")))
    }
}

/// Three finite numbers.
fn three<'de, D: Deserializer<'de>>(d: D) -> Result<[f64; 3], D::Error> {
    let all = <[f64; 3]>::deserialize(d)?;
    match all.iter().find(|x| !(-1e6..=1e6).contains(*x)) {
        Some(x) => Err(D::Error::custom(format!("{x} is outside -1e6 … 1e6"))),
        None => Ok(all),
    }
}

fn marks<'de, D: Deserializer<'de>>(d: D) -> Result<Vec<f64>, D::Error> {
    let all = Vec::<f64>::deserialize(d)?;
    match all.iter().find(|x| !(0.0..=86_400.0).contains(*x)) {
        Some(x) => Err(D::Error::custom(format!("{x} is outside 0 … 86400"))),
        None => Ok(all),
    }
}

fn seeds<'de, D: Deserializer<'de>>(d: D) -> Result<u64, D::Error> {
    match u64::deserialize(d)? {
        n @ 1..=1_000_000 => Ok(n),
        n => Err(D::Error::custom(format!("{n} is outside 1 … 1000000"))),
    }
}

/// The file.
#[derive(Clone, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct File {
    #[serde(deserialize_with = "latitude")]
    lat_deg: f64,
    #[serde(deserialize_with = "height")]
    height_m: f64,
    #[serde(deserialize_with = "turn")]
    turn_s: f64,
    #[serde(deserialize_with = "sample")]
    sample_s: f64,
    #[serde(deserialize_with = "interval")]
    interval_s: f64,
    /// How many runs.
    #[serde(deserialize_with = "seeds")]
    pub seeds: u64,
    /// Seed of the first.
    pub first_seed: u64,
    /// What is compared.
    pub variants: Vec<Variant>,
    #[serde(deserialize_with = "marks")]
    marks_s: Vec<f64>,
    position: Vec<Stand>,
    sensor: Sensor,
    biases: Option<Biases>,
    prior: Start,
    disturbance: Disturbance,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stand {
    #[serde(deserialize_with = "angle")]
    heading_deg: f64,
    #[serde(default, deserialize_with = "tilt")]
    pitch_deg: f64,
    #[serde(default, deserialize_with = "angle")]
    roll_deg: f64,
    #[serde(deserialize_with = "duration")]
    seconds: f64,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Sensor {
    grade: Option<Grade>,
    #[serde(deserialize_with = "positive")]
    gyro_bias_deg_h: Option<f64>,
    #[serde(deserialize_with = "positive")]
    accel_bias_ug: Option<f64>,
    #[serde(deserialize_with = "positive")]
    angle_walk_deg_sqrt_h: Option<f64>,
    #[serde(deserialize_with = "positive")]
    velocity_walk_ug_sqrt_hz: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Biases {
    #[serde(deserialize_with = "three")]
    gyro_deg_h: [f64; 3],
    #[serde(deserialize_with = "three")]
    accel_ug: [f64; 3],
}

#[derive(Clone, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Start {
    #[serde(deserialize_with = "place")]
    position_m: f64,
    #[serde(deserialize_with = "velocity")]
    velocity_m_s: f64,
    #[serde(deserialize_with = "degrees")]
    level_deg: f64,
    #[serde(deserialize_with = "degrees")]
    heading_deg: f64,
}

impl Default for Start {
    fn default() -> Self {
        Self {
            position_m: 1.0,
            velocity_m_s: 0.15,
            level_deg: 0.5,
            heading_deg: 1.0,
        }
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Disturbance {
    #[serde(deserialize_with = "velocity")]
    velocity_m_s: f64,
    #[serde(deserialize_with = "positive")]
    taken_for_m_s: Option<f64>,
}

impl Default for Disturbance {
    fn default() -> Self {
        Self {
            velocity_m_s: 0.001,
            taken_for_m_s: None,
        }
    }
}

impl Default for File {
    fn default() -> Self {
        let position = |heading_deg, seconds| Stand {
            heading_deg,
            pitch_deg: 0.0,
            roll_deg: 0.0,
            seconds,
        };
        Self {
            lat_deg: 40.0,
            height_m: 0.0,
            turn_s: 10.0,
            sample_s: 0.1,
            interval_s: 1.0,
            seeds: 20,
            first_seed: 1000,
            variants: Variant::ALL.to_vec(),
            marks_s: Vec::new(),
            position: vec![position(-53.438, 600.0), position(-143.438, 900.0)],
            sensor: Sensor {
                gyro_bias_deg_h: Some(0.05),
                ..Sensor::default()
            },
            biases: Some(Biases {
                gyro_deg_h: [0.03, 0.05, 0.03],
                accel_ug: [50.0; 3],
            }),
            prior: Start::default(),
            disturbance: Disturbance {
                velocity_m_s: 0.001,
                taken_for_m_s: Some(0.01),
            },
        }
    }
}

impl File {
    /// Reads a file; what it leaves out is as in the default, but for a sensor of navigation grade, biases drawn from it, and
    /// a disturbance of 1 mm/s that the filter knows.
    ///
    /// # Errors
    /// Those of [`config::read`], and a file without a position or a variant.
    pub fn read(path: &Path) -> Result<Self, LabError> {
        let text: toml::Table = config::read(path)?;
        let mut file: Self = config::read(path)?;
        if !text.contains_key("biases") {
            file.biases = None;
        }
        if !text.contains_key("disturbance") {
            file.disturbance = Disturbance::default();
        }
        if !text.contains_key("sensor") {
            file.sensor = Sensor::default();
        }
        let refused = |field, what: &str| LabError::in_file(path, what.to_owned()).field(field);
        if file.position.is_empty() {
            return Err(refused("position", "there is none"));
        }
        if file.variants.is_empty() {
            return Err(refused("variants", "there is none"));
        }
        if file.interval_s < file.sample_s {
            return Err(refused("interval_s", "it is shorter than a sample"));
        }
        let total: f64 = file.position.iter().map(|p| p.seconds).sum();
        if total / file.sample_s > 2e7 {
            return Err(refused("sample_s", "more than 20 million samples a run"));
        }
        Ok(file)
    }

    /// What is simulated. Positions and turns are rounded to whole samples.
    pub fn scenario(&self) -> Scenario {
        let base = config::Sensor::of(self.sensor.grade.unwrap_or(Grade::Navigation));
        let s = &self.sensor;
        let sensor = config::Sensor {
            gyro_bias_deg_h: s.gyro_bias_deg_h.unwrap_or(base.gyro_bias_deg_h),
            accel_bias_ug: s.accel_bias_ug.unwrap_or(base.accel_bias_ug),
            angle_walk_deg_sqrt_h: s
                .angle_walk_deg_sqrt_h
                .unwrap_or(base.angle_walk_deg_sqrt_h),
            velocity_walk_ug_sqrt_hz: s
                .velocity_walk_ug_sqrt_hz
                .unwrap_or(base.velocity_walk_ug_sqrt_hz),
            ..base
        };
        let whole = |t: f64| (t / self.sample_s).round().max(1.0) * self.sample_s;
        let mut errors = SensorErrors {
            arw: sensor.angle_walk(),
            vrw: sensor.velocity_walk(),
            ..SensorErrors::NONE
        };
        if let Some(b) = &self.biases {
            errors = errors.with_biases(b.gyro_deg_h, b.accel_ug);
        }
        let p = &self.prior;
        let level = p.level_deg.to_radians() as f32;
        Scenario {
            schedule: Schedule {
                at: Geodetic::from_degrees(self.lat_deg, 0.0, self.height_m),
                positions: self
                    .position
                    .iter()
                    .map(|p| {
                        let seconds = whole(p.seconds);
                        Position::degrees(p.heading_deg, p.pitch_deg, p.roll_deg, seconds)
                    })
                    .collect(),
                turn: whole(self.turn_s),
            },
            dt: self.sample_s,
            interval: self.interval_s,
            sensor: errors,
            draw_biases: self.biases.is_none(),
            prior: Prior {
                position: [p.position_m as f32; 3],
                velocity: [p.velocity_m_s as f32; 3],
                attitude: [level, level, p.heading_deg.to_radians() as f32],
                gyro_bias: [sensor.gyro_bias() as f32; 3],
                accel_bias: [(sensor.accel_bias_ug * MICRO_G) as f32; 3],
            },
            disturbance: self.disturbance.velocity_m_s,
            sigma_velocity: self
                .disturbance
                .taken_for_m_s
                .unwrap_or(self.disturbance.velocity_m_s),
            marks: self.marks_s.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_file_it_is_peng() {
        let (ours, paper) = (File::default().scenario(), Scenario::peng(90.0, 0.003));
        assert_eq!(ours.schedule.at, paper.schedule.at);
        assert_eq!(ours.schedule.turn, paper.schedule.turn);
        assert_eq!(
            ours.schedule.positions.len(),
            paper.schedule.positions.len()
        );
        for (a, b) in ours
            .schedule
            .positions
            .iter()
            .zip(&paper.schedule.positions)
        {
            assert_eq!(a.seconds, b.seconds);
            // degrees to radians in another order
            let off = (a.euler - b.euler).amax();
            assert!(off < 1e-14, "{off:e}");
        }
        assert_eq!(ours.sensor, paper.sensor);
        assert_eq!(ours.sigma_velocity, paper.sigma_velocity);
        let close =
            |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6 * b);
        assert!(close(ours.prior.attitude, paper.prior.attitude));
        assert!(close(ours.prior.gyro_bias, paper.prior.gyro_bias));
        assert!(close(ours.prior.accel_bias, paper.prior.accel_bias));
    }
}
