//! A flight with satellite fixes and what each manoeuvre teaches, on a PC and on a Cortex-M4F from one file.
//!
//! Ten samples a second, one fix a second, 0.2 s late, from an antenna a metre from the IMU. The vehicle flies straight,
//! speeds up, flies straight, turns, flies straight. Two filters run side by side: one is given positions only, the other
//! positions and velocities. Printed at the end of each leg, per filter: the error and σ of the heading, and ξ2 (how many
//! times smaller the variance has become) of velocity, pitch-and-roll, heading and gyro bias about the vertical; numbers
//! that host and target agree on in every bit, which the last column holds.
//!
//! What to look for: straight flight teaches next to nothing about heading; the acceleration does, the turn more; the gyro
//! bias follows. Velocities raise ξ2 of the velocity ten to fifty times, and of heading behind it.
#![cfg_attr(target_os = "none", no_std, no_main)]

use nalgebra::{SVector, Vector3};
use navsight::attitude::Euler;
use navsight::earth::{Geodetic, Local};
use navsight::error::Error;
use navsight::error_model::{BiasModel, NoiseDensity, ATT, BG, VEL};
use navsight::filter::{Aided, Filter, Gate, LateFilter, Prior, Settings, Source};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::{Antenna, Position, PositionVelocity, Velocity};
use navsight::nav::NavState;
use navsight::observability::diagonal::Xi;

#[path = "shared/stop.rs"]
mod stop;
use stop::{said, Stop};

/// Samples per second.
const RATE: u16 = 10;
/// Fixes are this many samples old.
const LATE: u16 = 2;
/// End of each leg [s], and its name.
const LEGS: [(u16, &str); 5] = [
    (20, "straight"),
    (30, "faster"),
    (50, "straight"),
    (70, "turn"),
    (90, "straight"),
];

const RAD: f32 = core::f32::consts::PI / 180.0;
/// From the IMU to the antenna, right-forward-up [m].
const LEVER: [f32; 3] = [0.36, 0.8, 0.48];

fn run(out: &mut impl core::fmt::Write) -> core::fmt::Result {
    let outcome = fly(out);
    said(out, outcome)
}

/// The truth: a vehicle that stays level and points where it goes.
struct Truth {
    samples: u16,
    speed: f32,
    heading: f32,
    at: Geodetic,
    /// Angular rate about the vertical, counter-clockwise [rad/s].
    yaw_rate: f32,
}

impl Truth {
    /// Moves on by a sample; what the sensors saw.
    fn step(&mut self) -> ImuIncrement {
        let dt = 1.0 / f32::from(RATE);
        let second = self.samples / RATE;
        self.samples += 1;
        let faster = (20..30).contains(&second);
        let turning = (50..70).contains(&second);
        let acceleration = if faster { 2.0 } else { 0.0 };
        let rate = if turning { 4.5 * RAD } else { 0.0 }; // clockwise
        let (speed, heading) = (
            self.speed + 0.5 * acceleration * dt,
            self.heading + 0.5 * rate * dt,
        );
        let (sin, cos) = libm::sincosf(heading);
        let v_n = Vector3::new(sin, cos, 0.0) * speed;
        let local = Local::at(self.at.lat as f32, self.at.height as f32);
        let (ie, en) = (local.omega_ie_n(), local.omega_en_n(&v_n));
        let a_n = Vector3::new(sin, cos, 0.0) * acceleration
            + Vector3::new(cos, -sin, 0.0) * (speed * rate);
        let f_n = a_n + (ie * 2.0 + en).cross(&v_n) + Vector3::new(0.0, 0.0, local.gravity);
        let omega_n = ie + en - Vector3::new(0.0, 0.0, rate);
        let c_n_b = Euler {
            heading,
            pitch: 0.0,
            roll: 0.0,
        }
        .c_b_n()
        .transpose();
        self.at.lat += f64::from(v_n.y * dt * local.inv_r_m);
        self.at.lon += f64::from(v_n.x * dt * local.inv_r_n * local.inv_cos_lat);
        self.speed += acceleration * dt;
        self.heading += rate * dt;
        self.yaw_rate = -rate;
        ImuIncrement::from_rates(c_n_b * omega_n, c_n_b * f_n, dt)
    }

    /// What a receiver sees of the antenna.
    fn fix(&self, noise: &mut Noise) -> Result<PositionVelocity, Error> {
        let euler = Euler {
            heading: self.heading,
            pitch: 0.0,
            roll: 0.0,
        };
        let offset = euler.c_b_n() * Vector3::from(LEVER);
        let motion = Vector3::new(0.0, 0.0, self.yaw_rate).cross(&offset);
        let (sin, cos) = libm::sincosf(self.heading);
        let v = Vector3::new(sin, cos, 0.0) * self.speed + motion + noise.vector() * 0.05;
        let r = offset + noise.vector() * 1.0;
        let local = Local::at(self.at.lat as f32, self.at.height as f32);
        let at = Geodetic {
            lat: self.at.lat + f64::from(r.y * local.inv_r_m),
            lon: self.at.lon + f64::from(r.x * local.inv_r_n * local.inv_cos_lat),
            height: self.at.height + f64::from(r.z),
        };
        Ok(PositionVelocity::new(
            Position::new(at, Vector3::repeat(1.0), 1.0)?,
            Velocity::new(v, Vector3::repeat(0.05), 1.0)?,
            Antenna::new(Vector3::from(LEVER))?,
        ))
    }
}

fn fly(out: &mut impl core::fmt::Write) -> Result<(), Stop> {
    let mut truth = Truth {
        samples: 0,
        speed: 30.0,
        heading: 0.7,
        at: Geodetic::from_degrees(48.0, 9.0, 500.0),
        yaw_rate: 0.0,
    };
    let mut noise = Noise(7);
    let start = start(&truth)?;
    let mut filters = [
        LateFilter::<4>::new(start.clone(), 0.0)?,
        LateFilter::<4>::new(start, 0.0)?,
    ];
    let mut sources = [Source::new(Gate::OPEN)?; 2];
    let mut waiting = None;
    writeln!(
        out,
        "   t  leg       filter    heading error     sigma       xi2 velocity       level     heading   gyro bias"
    )?;
    for (end, leg) in LEGS {
        while truth.samples < end * RATE {
            let ideal = truth.step();
            let bias = Vector3::new(2e-5, -1e-5, 3e-5);
            let imu = ImuIncrement {
                delta_theta_b: ideal.delta_theta_b + bias * ideal.dt + noise.vector() * 1e-5,
                delta_v_b: ideal.delta_v_b + noise.vector() * 3e-4,
                dt: ideal.dt,
            };
            for filter in &mut filters {
                filter.propagate(&imu)?;
            }
            if truth.samples.is_multiple_of(RATE) {
                waiting = Some((filters[0].filter().time(), truth.fix(&mut noise)?));
            }
            if truth.samples % RATE != LATE {
                continue;
            }
            let Some((time, fix)) = waiting.take() else {
                continue;
            };
            let [alone, both] = &mut filters;
            let [first, second] = &mut sources;
            let position = fix.position();
            let alone_report = alone.update(first, time, |nav| position.linearize(nav))?;
            let both_report = both.update(second, time, |nav| fix.linearize(nav))?;
            if truth.samples + RATE > end * RATE {
                line(out, &truth, leg, "position", alone.filter(), &alone_report)?;
                line(out, &truth, leg, "both", both.filter(), &both_report)?;
            }
        }
    }
    Ok(())
}

/// A filter that knows level to half a degree and heading to five, and is as wrong.
fn start(truth: &Truth) -> Result<Filter, Error> {
    let (sin, cos) = libm::sincosf(truth.heading);
    let v_n = Vector3::new(sin, cos, 0.0) * truth.speed;
    let nav = NavState::new(
        truth.at,
        v_n,
        Euler {
            heading: truth.heading,
            pitch: 0.0,
            roll: 0.0,
        },
    )?;
    let mut wrong = SVector::<f32, 15>::zeros();
    let psi = Vector3::new(0.4, -0.3, 4.0) * RAD;
    wrong.fixed_rows_mut::<3>(ATT).copy_from(&psi);
    let prior = Prior {
        position: [2.0; 3],
        velocity: [0.3; 3],
        attitude: [0.5 * RAD, 0.5 * RAD, 5.0 * RAD],
        gyro_bias: [3e-5; 3],
        accel_bias: [5e-3; 3],
    };
    let settings = Settings {
        limits: ImuLimits::default(),
        noise: NoiseDensity::from_random_walks(1e-3, 3e-5),
        bias: BiasModel::constant(),
        propagation_interval: 0.1,
        gate: None,
    };
    Filter::new(nav.corrected(&wrong), &prior, settings)
}

fn line<const M: usize>(
    out: &mut impl core::fmt::Write,
    truth: &Truth,
    leg: &str,
    name: &str,
    filter: &Filter,
    aided: &Aided<M>,
) -> Result<(), Stop> {
    let xi = Xi::of(&aided.report)?;
    let xi2 = |state: usize| xi.xi2.get(state).unwrap_or(f32::NAN);
    let error = (filter.nav().euler().heading - truth.heading) / RAD;
    let sigma = filter.sigma(ATT + 2).unwrap_or(f32::NAN) / RAD;
    let values = [
        0.5 * (xi2(VEL) + xi2(VEL + 1)),
        0.5 * (xi2(ATT) + xi2(ATT + 1)),
        xi2(ATT + 2),
        xi2(BG + 2),
    ];
    let [v, level, heading, bias] = values;
    let bits = values
        .iter()
        .fold(error.to_bits(), |all, x| all.rotate_left(5) ^ x.to_bits());
    writeln!(
        out,
        "{:>4}  {leg:<8}  {name:<8}  {error:>10.3} deg  {sigma:>6.3}  {v:>15.3}  {level:>10.3}  {heading:>10.3}  {bias:>10.3}  {bits:08x}",
        truth.samples / RATE
    )?;
    Ok(())
}

/// Small repeatable noise.
struct Noise(u32);

impl Noise {
    /// Uniform, of unit variance.
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        ((self.0 >> 8) as f32 / (1 << 23) as f32 - 1.0) * 1.732_050_8
    }

    fn vector(&mut self) -> Vector3<f32> {
        let (x, y) = (self.next(), self.next());
        Vector3::new(x, y, self.next())
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
