//! Numbers of a configuration that cannot be: refused where they are read, so that the message has their line and key.

use nalgebra::Vector3;
use navsight::measurement::{Antenna, MAX_LEVER};
use serde::de::{Deserialize, Deserializer, Error};

/// Oldest fix that is asked for [s].
const OLDEST: f64 = 5.0;

/// A latency is none that is to come, and none of minutes.
///
/// # Errors
/// A sentence.
pub fn check_latency(s: f64) -> Result<(), String> {
    match s {
        0.0..=OLDEST => Ok(()),
        _ => Err(format!("{s} is not in 0 to {OLDEST} s")),
    }
}

fn checked<'de, D: Deserializer<'de>>(
    from: D,
    allowed: impl Fn(f64) -> bool,
    what: &str,
) -> Result<f64, D::Error> {
    let x = f64::deserialize(from)?;
    if x.is_finite() && allowed(x) {
        Ok(x)
    } else {
        Err(D::Error::custom(format!("{x} is not {what}")))
    }
}

pub(super) fn positive<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    checked(from, |x| x > 0.0, "above 0")
}

pub(super) fn positive_or_none<'de, D: Deserializer<'de>>(
    from: D,
) -> Result<Option<f64>, D::Error> {
    positive(from).map(Some)
}

pub(super) fn not_negative<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    checked(from, |x| x >= 0.0, "0 or more")
}

pub(super) fn latency<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    let s = f64::deserialize(from)?;
    check_latency(s).map(|()| s).map_err(D::Error::custom)
}

pub(super) fn window<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    checked(from, |x| (9.0..=3600.0).contains(&x), "in 9 to 3600 s")
}

pub(super) fn lever_arm<'de, D: Deserializer<'de>>(from: D) -> Result<[f64; 3], D::Error> {
    let arm = <[f64; 3]>::deserialize(from)?;
    match Antenna::new(Vector3::from(arm.map(|x| x as f32))) {
        Ok(_) => Ok(arm),
        Err(_) => Err(D::Error::custom(format!(
            "a lever arm has three components within {MAX_LEVER} m"
        ))),
    }
}
