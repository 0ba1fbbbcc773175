//! Is alignment finished, and if not, why not, and what would help? On a PC and on a Cortex-M4F from one file.
//!
//! A vehicle with a navigation-grade sensor stands at 40° north and takes a zero-velocity update every second; a heading
//! of 0.06° is wanted. Printed are the verdicts about all states and what the supervisor says, then, when it says that time
//! does not help, what the planner makes of six manoeuvres. The best one is done, and the supervisor asked again.
//!
//! What to expect: in one position the east gyro bias limits the heading to 0.1°; the planner recommends half a turn,
//! and after it the supervisor ends with "Aligned". Host and target print the same.
#![cfg_attr(target_os = "none", no_std, no_main)]

use core::fmt::Write;

use nalgebra::Vector3;
use navsight::alignment::planner::{Manoeuvre, Planner, Progress, Rules};
use navsight::alignment::supervisor::{Status, Supervisor, NAMES};
use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{BiasModel, NoiseDensity, ATT, N};
use navsight::filter::{Filter, Prior, Settings};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::ZeroVelocity;
use navsight::nav::NavState;
use navsight::observability::verdict::{Limits, Verdict};

#[path = "shared/stop.rs"]
mod stop;
use stop::{said, Stop};

/// Samples per second.
const RATE: u16 = 10;
/// The longest that anybody waits [s].
const END: u16 = 3600;
const HEADING: usize = ATT + 2;
const RAD: f32 = core::f32::consts::PI / 180.0;

fn run(out: &mut impl Write) -> core::fmt::Result {
    let outcome = advise(out);
    said(out, outcome)
}

fn advise(out: &mut impl Write) -> Result<(), Stop> {
    let at = Geodetic::from_degrees(40.0, 116.0, 50.0);
    let mut filter = start(at)?;
    let standing = ZeroVelocity::new(2e-3, 1.0)?;
    let mut required = [None; N];
    required[HEADING] = Some(0.06 * RAD);
    required[ATT] = Some(0.01 * RAD);
    required[ATT + 1] = Some(0.01 * RAD);
    let mut supervisor = Supervisor::new(filter.sigma0(), &required, Limits::DEFAULT)?;
    let mut vehicle = Vehicle::new(&filter);
    let (mut turning, mut turned) = (0, false);
    let mut last = Status::Starting;
    for second in 1..=END {
        vehicle.second(&mut filter, turning > 0)?;
        if turning > 0 {
            turning -= 1;
            continue;
        }
        let report = filter.update(&standing.linearize(filter.nav()))?;
        let status = supervisor.take(filter.time(), &report);
        if status != last {
            last = status;
            write!(out, "{second:>5} s  {}", supervisor.sentence())?;
            match supervisor.time_to_go() {
                Some(go) if go > 0.0 => writeln!(out, " About {go:.0} s to go.")?,
                _ => writeln!(out)?,
            }
        }
        match status {
            Status::Aligned => return verdicts(out, &supervisor),
            Status::Limited { .. } if !turned => {
                verdicts(out, &supervisor)?;
                turned = true;
                if plan(out, &filter, standing)? == Some(Manoeuvre::USUAL[2]) {
                    turning = 2;
                    supervisor.manoeuvred(filter.time());
                    writeln!(out, "       it turns")?;
                }
            }
            _ => {}
        }
    }
    verdicts(out, &supervisor)
}

/// What stands about every state.
fn verdicts(out: &mut impl Write, supervisor: &Supervisor) -> Result<(), Stop> {
    let mut words = [Verdict::Unseen; N];
    for (word, judgement) in words.iter_mut().zip(supervisor.verdicts().all()) {
        *word = judgement.verdict;
    }
    for (name, word) in NAMES.iter().zip(words) {
        writeln!(out, "       {name:<26} {}", word.name())?;
    }
    Ok(())
}

/// Six manoeuvres, as between filter steps: fifty covariance steps at a time. Returns the best for the heading.
fn plan(
    out: &mut impl Write,
    filter: &Filter,
    standing: ZeroVelocity,
) -> Result<Option<Manoeuvre>, Stop> {
    let rules = Rules {
        turn_rate: 0.5 * core::f32::consts::PI,
        ..Rules::usual(standing)
    };
    let mut planner = Planner::new(filter, Manoeuvre::USUAL, rules)?;
    while planner.step(50)? == Progress::Working {}
    for candidate in planner.ranking(HEADING) {
        if let Some(outcome) = planner.outcome(candidate) {
            let sigma = outcome.sigma[HEADING];
            let xi2 = outcome.xi2[HEADING];
            let (what, bits) = (outcome.manoeuvre, sigma.to_bits());
            writeln!(
                out,
                "       heading {:.4}° xi2 {xi2:>8.1} {bits:08x}  {what}",
                sigma / RAD
            )?;
        }
    }
    let advice = planner.advice(HEADING);
    if let Some(advice) = advice {
        writeln!(out, "       {advice}")?;
    }
    Ok(advice.map(|advice| advice.best))
}

/// A filter that knows position and attitude roughly: half a degree of tilt, two of heading.
fn start(at: Geodetic) -> Result<Filter, Error> {
    let prior = Prior {
        position: [1.0; 3],
        velocity: [0.1; 3],
        attitude: [0.5 * RAD, 0.5 * RAD, 2.0 * RAD],
        gyro_bias: [0.02 * RAD / 3600.0; 3],
        accel_bias: [9.8e-4; 3],
    };
    let settings = Settings {
        limits: ImuLimits::default(),
        noise: NoiseDensity::from_random_walks(1e-4, 6e-7),
        bias: BiasModel::constant(),
        propagation_interval: 0.1,
        gate: None,
    };
    let nav = NavState::new(at, Vector3::zeros(), Euler::from_degrees(0.0, 0.0, 0.0))?;
    Filter::new(nav, &prior, settings)
}

/// A level vehicle and its sensor.
struct Vehicle {
    earth_rate: Vector3<f32>,
    gravity: f32,
    yaw: f32,
    noise: u32,
}

impl Vehicle {
    fn new(filter: &Filter) -> Self {
        let earth = filter.nav().local();
        Self {
            earth_rate: earth.omega_ie_n(),
            gravity: earth.gravity,
            yaw: 0.0,
            noise: 1,
        }
    }

    /// A second of samples, standing or turning clockwise by a quarter of a circle.
    fn second(&mut self, filter: &mut Filter, turning: bool) -> Result<(), Error> {
        let dt = 1.0 / f32::from(RATE);
        let rate = if turning {
            -0.5 * core::f32::consts::PI
        } else {
            0.0
        };
        for _ in 0..RATE {
            // attitude in the middle of the sample: level, turned counter-clockwise by yaw
            let (sin, cos) = libm::sincosf(self.yaw + 0.5 * rate * dt);
            self.yaw += rate * dt;
            let earth = self.earth_rate;
            let omega = Vector3::new(earth.y * sin, earth.y * cos, earth.z + rate);
            let delta_theta_b = omega * dt + self.triad(1.9e-7);
            let delta_v_b = Vector3::new(0.0, 0.0, self.gravity * dt) + self.triad(3.2e-5);
            filter.propagate(&ImuIncrement {
                delta_theta_b,
                delta_v_b,
                dt,
            })?;
        }
        Ok(())
    }

    /// Small repeatable noise of this standard deviation.
    fn triad(&mut self, sigma: f32) -> Vector3<f32> {
        let mut next = || {
            self.noise = self
                .noise
                .wrapping_mul(1_664_525)
                .wrapping_add(1_013_904_223);
            ((self.noise >> 8) as f32 / (1 << 23) as f32 - 1.0) * 1.732 * sigma
        };
        Vector3::new(next(), next(), next())
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
