//! The detector of rest on recordings: both of its errors, and how they trade.

use std::path::Path;

use nalgebra::Vector3;
use navsight::alignment::stationary::{Look, StationaryDetector, StationarySettings};
use navsight::imu::ImuIncrement;

use crate::input::rest::{self, Flag};
use crate::input::ImuReader;
use crate::lab::LabError;

/// Settings of a MEMS sensor from its noise densities [°/s/√Hz], [µg/√Hz]: turn-on biases of 0.5 °/s and 0.1 m/s².
pub fn mems(gyro_deg_s_sqrt_hz: f32, accel_ug_sqrt_hz: f32) -> StationarySettings {
    StationarySettings::from_noise(
        gyro_deg_s_sqrt_hz.to_radians(),
        accel_ug_sqrt_hz * 9.806_65e-6,
        0.5f32.to_radians(),
        0.1,
    )
}

/// Seconds of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// At rest by the annotation.
    pub rest: f64,
    /// Of these, called rest.
    pub rest_found: f64,
    /// Moving by the annotation.
    pub moving: f64,
    /// Of these, called rest.
    pub moving_wrong: f64,
}

impl Counts {
    /// Part of the rest that was found.
    pub fn found(&self) -> f64 {
        self.rest_found / self.rest
    }

    /// Part of the moving time that was called rest.
    pub fn wrong(&self) -> f64 {
        self.moving_wrong / self.moving
    }
}

/// Every sample of a recording with its length and what was said last: `None` until the first window is full.
///
/// # Errors
/// Those of the reader, and of settings that cannot be.
pub fn each(
    imu: &Path,
    settings: StationarySettings,
    mut see: impl FnMut(f64, f64, Option<&Look>, bool),
) -> Result<(), LabError> {
    let refused = |e| LabError::in_file(imu, format!("refused by the detector: {e:?}"));
    let mut detector = StationaryDetector::new(settings).map_err(refused)?;
    let mut last: Option<Look> = None;
    for sample in ImuReader::open(imu)? {
        let sample = sample?;
        let increment = ImuIncrement {
            delta_theta_b: Vector3::from(sample.delta_theta).cast(),
            delta_v_b: Vector3::from(sample.delta_v).cast(),
            dt: sample.dt as f32,
        };
        let look = match detector.take(&increment) {
            Ok(look) => look,
            Err(_) => {
                // a gap, or what no sensor sends: begin anew
                detector.restart();
                last = None;
                None
            }
        };
        let new = look.is_some();
        last = look.or(last);
        see(sample.t, sample.dt, last.as_ref(), new);
    }
    Ok(())
}

/// Counts both errors, sample by sample: what the detector says at the time of a sample, without looking ahead, against
/// the annotation of that sample.
///
/// # Errors
/// As [`each`].
pub fn count(imu: &Path, flags: &[Flag], settings: StationarySettings) -> Result<Counts, LabError> {
    let mut c = Counts::default();
    each(imu, settings, |t, dt, look, _| {
        let called = look.is_some_and(|l| l.still);
        let (all, part) = match rest::at(flags, t) {
            true => (&mut c.rest, &mut c.rest_found),
            false => (&mut c.moving, &mut c.moving_wrong),
        };
        *all += dt;
        *part += if called { dt } else { 0.0 };
    })?;
    Ok(c)
}
