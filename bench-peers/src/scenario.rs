//! The same vehicle for everybody: half a minute at rest, half a minute turning in place at 3 °/s, on the earth that
//! turns; exact 100 Hz samples, a velocity of zero once a second.

use navsight::earth::Geodetic;
use navsight::nav::NavState;

pub const LAT_DEG: f64 = 34.0;
pub const LON_DEG: f64 = 108.0;
pub const HEIGHT_M: f64 = 400.0;
/// [s]
pub const DT: f64 = 0.01;
pub const SAMPLES: u32 = 6000;
/// Samples between two updates.
pub const UPDATE: u32 = 100;
pub const HEADING_DEG: f64 = 30.0;
pub const PITCH_DEG: f64 = 2.0;
pub const ROLL_DEG: f64 = 1.0;
/// What everybody starts wrong by.
pub const HEADING_ERROR_DEG: f64 = 0.5;
pub const PITCH_ERROR_DEG: f64 = 0.1;
const TURN_DEG_PER_S: f64 = 3.0;
const EARTH_RATE: f64 = 7.292_115e-5;

/// 1σ that everybody is told.
pub const SIGMA_VELOCITY: f64 = 0.02;
pub const PRIOR_POSITION: f64 = 10.0;
pub const PRIOR_VELOCITY: f64 = 0.1;
pub const PRIOR_TILT: f64 = 0.2 * RAD;
pub const PRIOR_HEADING: f64 = 1.0 * RAD;
pub const PRIOR_GYRO: f64 = 1e-4;
pub const PRIOR_ACCEL: f64 = 1e-2;
/// Random walks: rad/√s, m/s/√s, rad/s/√s, m/s²/√s.
pub const WALKS: [f64; 4] = [1e-4, 1e-3, 1e-7, 1e-5];

pub const RAD: f64 = core::f64::consts::PI / 180.0;

/// One sample, right-forward-up.
#[derive(Clone, Copy)]
pub struct Sample {
    pub k: u32,
    /// Angular rate against inertial space [rad/s].
    pub omega: [f64; 3],
    /// Specific force [m/s²].
    pub f: [f64; 3],
}

/// Seconds after the start.
pub fn time(k: u32) -> f64 {
    f64::from(k) * DT
}

/// Heading at a time [°].
pub fn heading_deg(t: f64) -> f64 {
    HEADING_DEG + TURN_DEG_PER_S * (t - 30.0).max(0.0)
}

/// Columns of C_b^n, east-north-up: right, forward and up.
pub fn axes(heading_deg: f64) -> [[f64; 3]; 3] {
    let (sh, ch) = sin_cos(heading_deg);
    let (sp, cp) = sin_cos(PITCH_DEG);
    let (sr, cr) = sin_cos(ROLL_DEG);
    let right = [ch, -sh, 0.0];
    let forward = [sh * cp, ch * cp, sp];
    let up = [
        right[1] * forward[2] - right[2] * forward[1],
        right[2] * forward[0] - right[0] * forward[2],
        right[0] * forward[1] - right[1] * forward[0],
    ];
    let mix = |a: f64, x: [f64; 3], b: f64, y: [f64; 3]| {
        [
            a * x[0] + b * y[0],
            a * x[1] + b * y[1],
            a * x[2] + b * y[2],
        ]
    };
    [mix(cr, right, -sr, up), forward, mix(cr, up, sr, right)]
}

fn sin_cos(deg: f64) -> (f64, f64) {
    (libm::sin(deg * RAD), libm::cos(deg * RAD))
}

/// Gravity here [m/s²].
pub fn gravity() -> f64 {
    let here = Geodetic::from_degrees(LAT_DEG, LON_DEG, HEIGHT_M);
    let level = navsight::attitude::Euler::from_degrees(0.0, 0.0, 0.0);
    NavState::new(here, nalgebra::Vector3::zeros(), level)
        .map_or(9.8, |nav| f64::from(nav.local().gravity))
}

/// The sample that ends at k + 1 steps.
pub fn sample(k: u32, gravity: f64) -> Sample {
    let middle = time(k) + 0.5 * DT;
    let axes = axes(heading_deg(middle));
    let (sl, cl) = sin_cos(LAT_DEG);
    let turn = if middle > 30.0 {
        TURN_DEG_PER_S * RAD
    } else {
        0.0
    };
    // clockwise is negative about up
    let rate = [0.0, EARTH_RATE * cl, EARTH_RATE * sl - turn];
    let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    Sample {
        k,
        omega: [
            dot(&axes[0], &rate),
            dot(&axes[1], &rate),
            dot(&axes[2], &rate),
        ],
        f: [
            axes[0][2] * gravity,
            axes[1][2] * gravity,
            axes[2][2] * gravity,
        ],
    }
}

/// Right-forward-up as forward-right-down, and back.
pub fn frd([x, y, z]: [f64; 3]) -> [f64; 3] {
    [y, x, -z]
}

/// A filter with what it needs to run: three calls, and what it says at the end.
#[cfg_attr(not(target_os = "none"), allow(dead_code))] // the firmware prints all of it
pub trait Peer: Sized {
    const NAME: &'static str;
    const SCALAR: &'static str;
    /// Whether it is linear algebra only: no navigation, no building of the matrices in the count.
    const ALGEBRA_ONLY: bool;
    fn start() -> Option<Self>;
    /// One IMU sample: nominal state and covariance.
    fn predict(&mut self, sample: &Sample) -> bool;
    /// The vehicle stands still.
    fn update(&mut self, k: u32) -> bool;
    /// Variance of the east velocity [m²/s²].
    fn velocity_variance(&self) -> f64;
    /// Heading, pitch and roll [°].
    fn attitude_deg(&self) -> Option<[f64; 3]>;
}
