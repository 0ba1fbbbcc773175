//! A two-position alignment and its degree of observability, on a PC and on a Cortex-M4F from one file.
//!
//! A vehicle stands at 40° north and takes a zero-velocity update every second. After 150 s it turns half round in
//! 2 s. Printed is what the filter has seen just before the turn, just after it, and at the end: per state ξ1 (how fast
//! it is learnt, per second) and ξ2 (how many times smaller its variance is), then η2 of all directions with the best
//! one, and the fastest η1. Numbers are given to be read and as bit patterns: host and target agree in every bit.
//!
//! What to look for: before the turn the accelerometers and the east gyro have ξ2 near 1, and heading a few hundred
//! at most; after it the level accelerometers jump, and heading follows slowly.
#![cfg_attr(target_os = "none", no_std, no_main)]

use nalgebra::Vector3;
use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{block_rates, BiasModel, NoiseDensity};
use navsight::filter::{Filter, Prior, Settings, UpdateReport};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::ZeroVelocity;
use navsight::nav::NavState;
use navsight::observability::diagonal::Xi;
use navsight::observability::riccati::{DecreaseRate15, Information};
use navsight::observability::spectrum::{
    self, Directions, Progress, Spectrum15, ValuesOnly, SLICE,
};

#[path = "shared/stop.rs"]
mod stop;
use stop::{said, Stop};

/// Samples per second.
const RATE: u16 = 10;
/// The turn: start and end [s], half round.
const TURN: (u16, u16) = (150, 152);
/// End [s].
const END: u16 = 300;
/// When to print [s].
const PRINT: [u16; 3] = [150, 153, 300];

const RAD: f32 = core::f32::consts::PI / 180.0;
const NAMES: [&str; 15] = [
    "r E", "r N", "r U", "v E", "v N", "v U", "psi E", "psi N", "psi U", "gyro x", "gyro y",
    "gyro z", "acc x", "acc y", "acc z",
];

fn run(out: &mut impl core::fmt::Write) -> core::fmt::Result {
    let outcome = align(out);
    said(out, outcome)
}

fn align(out: &mut impl core::fmt::Write) -> Result<(), Stop> {
    let at = Geodetic::from_degrees(40.0, 116.0, 50.0);
    let mut filter = start(at)?;
    let earth = filter.nav().local();
    let (earth_rate, gravity) = (earth.omega_ie_n(), earth.gravity);
    let dt = 1.0 / f32::from(RATE);
    let turn_rate = core::f32::consts::PI / f32::from(TURN.1 - TURN.0);
    let zero_velocity = ZeroVelocity::new(1e-3, 1.0)?;
    let mut noise = Noise(1);
    let mut yaw = 0.0;
    for second in 1..=END {
        let turning = TURN.0 < second && second <= TURN.1;
        for _ in 0..RATE {
            // attitude in the middle of the sample: level, turned counter-clockwise by yaw
            let rate = if turning { turn_rate } else { 0.0 };
            let (sin, cos) = libm::sincosf(yaw + 0.5 * rate * dt);
            yaw += rate * dt;
            let imu = ImuIncrement {
                delta_theta_b: Vector3::new(
                    earth_rate.y * sin * dt + 1e-8 * noise.next(),
                    earth_rate.y * cos * dt + 1e-8 * noise.next(),
                    (earth_rate.z + rate) * dt + 1e-8 * noise.next(),
                ),
                delta_v_b: Vector3::new(
                    1e-5 * noise.next(),
                    1e-5 * noise.next(),
                    gravity * dt + 1e-5 * noise.next(),
                ),
                dt,
            };
            filter.propagate(&imu)?;
        }
        if turning {
            continue;
        }
        let measurement = zero_velocity.linearize(filter.nav());
        let report = filter.update(&measurement)?;
        if PRINT.contains(&second) {
            writeln!(out, "t = {second} s")?;
            indices(out, &report)?;
            accuracy(out, &filter, u32::from(report.normalised))?;
            if let Some(information) = Information::of(&measurement, filter.sigma0()) {
                let f_n = Vector3::new(0.0, 0.0, gravity);
                let c_b_n = filter.nav().c_b_n();
                let rates = block_rates(&filter.environment(), &c_b_n, &f_n, filter.scaling());
                let rate = DecreaseRate15::blocks(filter.covariance(), &rates, &information);
                speed(out, &rate, u32::from(report.normalised))?;
            }
        }
    }
    Ok(())
}

/// A filter that knows position and attitude roughly: half a degree of tilt, two of heading.
fn start(at: Geodetic) -> Result<Filter, Error> {
    let prior = Prior {
        position: [10.0; 3],
        velocity: [0.15; 3],
        attitude: [0.5 * RAD, 0.5 * RAD, 2.0 * RAD],
        gyro_bias: [0.02 * RAD / 3600.0; 3],
        accel_bias: [100e-6 * 9.8; 3],
    };
    let bias = BiasModel::from_correlation_times(72_000.0, 72_000.0)?;
    let settings = Settings {
        limits: ImuLimits::default(),
        noise: NoiseDensity::from_random_walks(1e-4, 1e-7).with_stationary_biases(
            &bias,
            prior.gyro_bias,
            prior.accel_bias,
        ),
        bias,
        propagation_interval: 0.1,
        gate: None,
    };
    let nav = NavState::new(at, Vector3::zeros(), Euler::from_degrees(0.0, 0.0, 0.0))?;
    Filter::new(nav, &prior, settings)
}

fn indices(out: &mut impl core::fmt::Write, report: &UpdateReport<3>) -> Result<(), Stop> {
    let xi = Xi::of(report)?;
    for (i, name) in NAMES.iter().enumerate() {
        if let (Some(xi1), Some(xi2)) = (xi.xi1.get(i), xi.xi2.get(i)) {
            let (a, b) = (xi1.to_bits(), xi2.to_bits());
            writeln!(
                out,
                "  {name:>6}  xi1 {xi1:>10.3e} {a:08x}  xi2 {xi2:>12.5} {b:08x}"
            )?;
        }
    }
    Ok(())
}

/// η2 of all directions, worked out in slices as between filter steps, and the best one.
fn accuracy(out: &mut impl core::fmt::Write, filter: &Filter, normalised: u32) -> Result<(), Stop> {
    let mut eta = Spectrum15::<f32, Directions<f32, 15>>::new();
    eta.start_accuracy(
        filter.covariance(),
        spectrum::Prior::Independent,
        normalised,
    )?;
    let mut slices = 1;
    while eta.step(SLICE)? == Progress::Working {
        slices += 1;
    }
    writeln!(out, "  eta2 in {slices} slices:")?;
    for k in 0..eta.len() {
        if let Some(value) = eta.value(k) {
            writeln!(out, "  {:>14.5} {:08x}", 1.0 / value, value.to_bits())?;
        }
    }
    if let Some(best) = eta.direction(0) {
        write!(out, "  best seen ({} dimensions):", best.dimension)?;
        for (x, name) in best.vector.iter().zip(NAMES) {
            if x.abs() > 0.1 {
                write!(out, " {x:.3} {name} {:08x}", x.to_bits())?;
            }
        }
        writeln!(out)?;
    }
    Ok(())
}

fn speed(
    out: &mut impl core::fmt::Write,
    rate: &DecreaseRate15<f32>,
    normalised: u32,
) -> Result<(), Stop> {
    let mut eta = Spectrum15::<f32, ValuesOnly>::new();
    eta.start_speed(rate, spectrum::Prior::Independent, normalised)?;
    while eta.step(SLICE)? == Progress::Working {}
    if let Some(value) = eta.len().checked_sub(1).and_then(|last| eta.value(last)) {
        writeln!(out, "  fastest eta1 {value:.4e} {:08x}", value.to_bits())?;
    }
    Ok(())
}

/// Small repeatable noise, −1 … 1.
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / (1 << 23) as f32 - 1.0
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    let mut s = String::new();
    run(&mut s).unwrap();
    print!("{s}");
}

#[cfg(target_os = "none")]
mod firmware;
