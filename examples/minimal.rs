//! The least that knows what it has learnt: mechanization, covariance, zero-velocity updates, ξ1 and ξ2. Ten seconds at
//! rest; prints the bits of heading's ξ2 and of the north tilt's, and what the last update took of the latter.
//!
//! `docs/performance.md` says how much flash this takes.
#![cfg_attr(target_os = "none", no_std, no_main)]

use nalgebra::Vector3;
use navsight::attitude::RfuToEnu;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{BiasModel, NoiseDensity, ATT};
use navsight::filter::{Filter, Prior, Settings, UpdateReport};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::ZeroVelocity;
use navsight::nav::NavState;
use navsight::observability::diagonal::Xi;

fn run(out: &mut impl core::fmt::Write) -> core::fmt::Result {
    let xi = ten_seconds().map_err(|_| core::fmt::Error)?;
    let (heading, tilt) = (xi.xi2.get(ATT + 2), xi.xi2.get(ATT + 1));
    let fast = xi.xi1.get(ATT + 1);
    for (x, end) in [(heading, " "), (tilt, " "), (fast, "\n")] {
        write_bits(out, x.unwrap_or(0.0))?;
        out.write_str(end)?;
    }
    Ok(())
}

/// Eight hexadecimal digits; the formatting of `core` would take 1.5 KiB.
#[inline(never)]
fn write_bits(out: &mut impl core::fmt::Write, x: f32) -> core::fmt::Result {
    const DIGITS: &str = "0123456789abcdef";
    // seen from outside: a loop and not eight copies of what writes
    core::hint::black_box(0..8).try_for_each(|k| {
        let digit = (x.to_bits() >> (28 - 4 * k)) as usize % 16;
        out.write_str(DIGITS.get(digit..=digit).unwrap_or("?"))
    })
}

fn ten_seconds() -> Result<Xi<f32, 15>, Error> {
    let position = Geodetic::from_degrees(40.0, 116.0, 100.0);
    // Level, heading 30°. Angles would bring sine and cosine, 3 KiB.
    let attitude = RfuToEnu([0.965_925_8, 0.0, 0.0, -0.258_819_05]);
    let nav = NavState::new(position, Vector3::zeros(), attitude)?;
    let prior = Prior {
        position: [10.0; 3],
        velocity: [0.1; 3],
        attitude: [5e-3, 5e-3, 0.05],
        gyro_bias: [1e-6; 3],
        accel_bias: [1e-3; 3],
    };
    let settings = Settings {
        limits: ImuLimits::DEFAULT,
        noise: NoiseDensity::from_random_walks(1e-5, 1e-5),
        bias: BiasModel::constant(),
        propagation_interval: 0.1,
        gate: Some(10.8),
    };
    // what the sensors show at rest
    let local = nav.local();
    let c_n_b = nav.c_b_n().transpose();
    let imu = ImuIncrement::from_rates(
        c_n_b * local.omega_ie_n(),
        c_n_b * Vector3::new(0.0, 0.0, local.gravity),
        0.01,
    );
    let mut filter = Filter::new(nav, &prior, settings)?;
    let standing = ZeroVelocity::new(0.01, 1.0)?;
    let mut report = UpdateReport::empty();
    for k in 1..=1000u16 {
        filter.propagate(&imu)?;
        if k.is_multiple_of(100) {
            filter.update_into(&standing.linearize(filter.nav()), &mut report)?;
        }
    }
    Xi::of(&report)
}

#[cfg(not(target_os = "none"))]
fn main() {
    let mut text = String::new();
    run(&mut text).expect("a String takes all");
    print!("{text}");
}

#[cfg(target_os = "none")]
mod firmware;
