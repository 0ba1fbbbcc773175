//! Coarse alignment of a standing vehicle that people and wind keep shaking.
//!
//! A plain mean of the gyros over a minute finds a heading that is wrong by tens of degrees when somebody boards the
//! vehicle: the disturbance is larger than the earth rate. What stays small is the *velocity* of the disturbance, since
//! the vehicle ends where it began. So the specific force is integrated in an inertial frame, the body frame of the first
//! sample, into which the gyros resolve it. There gravity draws an arc:
//!
//! ```text
//! v(t) = v₀ + f·t + ½ (ω_ie × f)·t² + …      f = specific force, up;   ω_ie × f = g Ω cos L, east
//! ```
//!
//! A quadratic fit to v gives both directions, up and east, and with them the attitude; its residuals tell how much to
//! believe it. Time is counted from the middle of the window, where the cubic term of the arc does not reach the fit.
//!
//! Source: the inertial-frame method (Titterton & Weston 2004, 10.4.3); fit and its covariance derived here.

use super::inertial::{rotation_by, InertialFrame};
use crate::attitude::Euler;
use crate::earth::{normal_gravity, omega_ie_n, Geodetic, MAX_LATITUDE};
use crate::error::Error;
use crate::imu::{ImuIncrement, ImuLimits};
use crate::linalg::{cross, divided, dot, minus, plus, product, product_transposed, scaled, Two};
use heapless::Vec;
use nalgebra::{Matrix3, Vector3};

/// Velocity points kept; when full, every second one goes and the spacing doubles, so any window fits.
const POINTS: usize = 128;
/// Spacing of the velocity points at the start [s].
const SPACING: f32 = 0.25;
/// Fewest points that a fit is made from, so that the residuals have 30 degrees of freedom.
pub const MIN_POINTS: usize = 33;
/// Standard deviation of an angle of which nothing is known: uniform over the circle, π/√3 [rad].
pub const UNKNOWN_HEADING: f32 = 1.813_799_4;

/// What the window said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoarseSolution {
    /// Attitude at the last sample.
    pub c_b_n: Matrix3<f32>,
    /// Standard deviation of the heading from the scatter of the window [rad], without the gyro bias, at most
    /// [`UNKNOWN_HEADING`].
    pub sigma_heading: f32,
    /// Standard deviation of the level from the scatter of the window [rad], without the accelerometer bias.
    pub sigma_level: f32,
    /// Standard deviation per level axis of the velocity about the fit, if it were white from second to second [m/s]: what
    /// people and wind move the vehicle by. 0 where nothing was fitted.
    pub motion: f32,
    /// Mean specific force over normal gravity: 1 for a good sensor at rest.
    pub gravity_ratio: f32,
    /// Turn of gravity towards the east over the one expected: 1 for a sensor that feels the earth turn; 0 where it was not
    /// asked for, the heading being from outside.
    pub earth_rate_ratio: f32,
}

impl CoarseSolution {
    /// Heading, pitch and roll at the last sample.
    pub fn euler(&self) -> Euler {
        Euler::from_c_b_n(&self.c_b_n)
    }
}

/// Gathers the window sample by sample, then fits it. About 1.7 KiB.
#[derive(Clone, Debug)]
pub struct CoarseAlignment {
    lat: f32,
    gravity: f32,
    limits: ImuLimits,
    frame: InertialFrame,
    /// ∫ specific force in that frame, less `f_ref`·t so that f32 points keep the micrometres per second.
    v: [Two; 3],
    f_ref: Vector3<f32>,
    points: Vec<Vector3<f32>, POINTS>,
    /// Samples between two points, 0 until the length of a sample is known.
    stride: u32,
    since_point: u32,
    time: Two,
}

impl CoarseAlignment {
    /// A window that begins with the next sample, at a known latitude and height.
    ///
    /// Errors: [`Error::NonFinite`], [`Error::OutOfRange`], [`Error::Polar`] for a position that cannot be.
    pub fn new(position: &Geodetic, limits: ImuLimits) -> Result<Self, Error> {
        let (lat, gravity) = Self::place(position)?;
        Ok(Self::at(lat, gravity, limits))
    }

    /// Latitude and gravity of a place that can be.
    #[inline(never)]
    pub(super) fn place(position: &Geodetic) -> Result<(f32, f32), Error> {
        position.check()?;
        let lat = position.lat as f32;
        if lat.abs() > MAX_LATITUDE {
            return Err(Error::Polar);
        }
        Ok((lat, normal_gravity(libm::sinf(lat), position.height as f32)))
    }

    /// [`CoarseAlignment::new`] of what [`CoarseAlignment::place`] gives; written where it is wanted.
    #[inline(always)]
    pub(super) fn at(lat: f32, gravity: f32, limits: ImuLimits) -> Self {
        let zero = Two { hi: 0.0, lo: 0.0 };
        Self {
            lat,
            gravity,
            limits,
            frame: InertialFrame::new(),
            v: [zero; 3],
            f_ref: Vector3::new(0.0, 0.0, 0.0),
            points: Vec::new(),
            stride: 0,
            since_point: 0,
            time: zero,
        }
    }

    /// Seconds gathered.
    pub fn time(&self) -> f32 {
        self.time.hi
    }

    /// Takes one sample. The samples of a window must be of about equal length: the points of the fit are counted.
    ///
    /// Errors: those of [`ImuIncrement::check`]; the window is then as it was.
    pub fn take(&mut self, imu: &ImuIncrement) -> Result<(), Error> {
        imu.check(&self.limits)?;
        let delta_v = self.frame.take(imu);
        if self.stride == 0 {
            self.f_ref = divided(&delta_v, imu.dt);
            // a stride of zero samples would mean that no point is ever due
            self.stride = ((SPACING / imu.dt) as u32).max(1);
        }
        let [vx, vy, vz] = &mut self.v;
        vx.add(delta_v.x - self.f_ref.x * imu.dt);
        vy.add(delta_v.y - self.f_ref.y * imu.dt);
        vz.add(delta_v.z - self.f_ref.z * imu.dt);
        self.time.add(imu.dt);
        self.since_point += 1;
        if self.since_point >= self.stride {
            self.since_point = 0;
            self.point();
        }
        Ok(())
    }

    /// Keeps the velocity reached now; a full store is thinned to every second point first.
    fn point(&mut self) {
        let v = Vector3::new(self.v[0].hi, self.v[1].hi, self.v[2].hi);
        if self.points.push(v).is_err() {
            return; // thinned below before it can be full
        }
        if self.points.is_full() {
            let mut keep = false;
            self.points.retain(|_| {
                keep = !keep;
                !keep
            });
            self.stride = self.stride.saturating_mul(2);
        }
    }

    /// Attitude at the first sample, from the one that a solution (or somebody else) has at the last: the gyros have
    /// counted how the body turned between, and the level frame has turned with the earth.
    pub fn at_start(&self, c_b_n: &Matrix3<f32>) -> Matrix3<f32> {
        let omega = omega_ie_n(libm::sinf(self.lat), libm::cosf(self.lat));
        let turned = product(&rotation_by(&scaled(&omega, self.time.hi)), c_b_n);
        product_transposed(&turned, &self.frame.c_b_b0())
    }

    /// Fits the window.
    ///
    /// Errors: [`Error::Time`] for fewer than [`MIN_POINTS`] velocity points (8.25 s); [`Error::OutOfRange`] when the
    /// mean specific force is not within a tenth of gravity or nothing in the window turns: not a standing vehicle.
    pub fn solve(&self) -> Result<CoarseSolution, Error> {
        let count = self.points.len();
        if count < MIN_POINTS {
            return Err(Error::Time);
        }
        let n = count as f32;
        // The points reach from one stride after the start to `trailing` samples before the end.
        let samples = (self.stride * count as u32 + self.since_point) as f32;
        let spacing = self.time.hi * self.stride as f32 / samples;
        let half = 0.5 * (n - 1.0) * spacing;
        // Orthogonal on equally spaced x in −1 … 1: 1, x, x² − mean(x²).
        let step = 2.0 / (n - 1.0);
        let mean2 = (n + 1.0) / (3.0 * (n - 1.0));
        let basis = |k: usize| {
            let x = k as f32 * step - 1.0;
            (x, x * x - mean2)
        };
        let (mut sum0, mut sum1, mut sum2) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        let (mut norm1, mut norm2) = (0.0, 0.0);
        for (k, v) in self.points.iter().enumerate() {
            let (p1, p2) = basis(k);
            sum0 = plus(&sum0, v);
            sum1 = plus(&sum1, &scaled(v, p1));
            sum2 = plus(&sum2, &scaled(v, p2));
            norm1 += p1 * p1;
            norm2 += p2 * p2;
        }
        let (c0, c1, c2) = (
            divided(&sum0, n),
            divided(&sum1, norm1),
            divided(&sum2, norm2),
        );
        let f = plus(&self.f_ref, &divided(&c1, half));
        let turn = scaled(&c2, 2.0 / (half * half)); // ω_ie × f
        let f_norm = libm::sqrtf(dot(&f, &f));
        let gravity_ratio = f_norm / self.gravity;
        let up = divided(&f, f_norm);
        let across_up = |x: &Vector3<f32>| minus(x, &scaled(&up, dot(x, &up)));
        let east_part = across_up(&turn);
        let east_norm = libm::sqrtf(dot(&east_part, &east_part));
        if !((0.9..=1.1).contains(&gravity_ratio) && east_norm > 0.0) {
            return Err(Error::OutOfRange);
        }
        let east = divided(&east_part, east_norm);
        let north = cross(&up, &east);

        // Scatter along north turns the heading, scatter of the slope tilts the level. Residuals that follow each other
        // carry less than their number: (1 + ρ)/(1 − ρ) of a first-order sequence.
        let mut previous = None;
        let (mut square, mut product1) = (0.0, 0.0);
        for (k, v) in self.points.iter().enumerate() {
            let (p1, p2) = basis(k);
            let residual = minus(&minus(&minus(v, &c0), &scaled(&c1, p1)), &scaled(&c2, p2));
            let level = across_up(&residual);
            square += 0.5 * dot(&level, &level);
            if let Some(before) = previous.replace(level) {
                product1 += 0.5 * dot(&level, &before);
            }
        }
        let rho = (product1 / square).clamp(0.0, 0.99);
        let scatter = square / (n - 3.0);
        let var = scatter * (1.0 + rho) / (1.0 - rho);
        let expected = f_norm * omega_ie_n(libm::sinf(self.lat), libm::cosf(self.lat)).y;
        let sigma_turn = libm::sqrtf(var / norm2) * (2.0 / (half * half));
        let sigma_level = libm::sqrtf(var / norm1) / half / f_norm;

        // From the middle of the points to the last one the level frame has turned with the earth.
        let c_middle = Matrix3::new(
            east.x, east.y, east.z, north.x, north.y, north.z, up.x, up.y, up.z,
        );
        let omega = omega_ie_n(libm::sinf(self.lat), libm::cosf(self.lat));
        let late = (self.time.hi / samples) * self.since_point as f32;
        let c_b0_n = product(&rotation_by(&scaled(&omega, -(half + late))), &c_middle);
        Ok(CoarseSolution {
            c_b_n: product(&c_b0_n, &self.frame.c_b_b0()),
            sigma_heading: (sigma_turn / expected).min(UNKNOWN_HEADING),
            sigma_level,
            motion: libm::sqrtf(scatter.max(var * spacing)),
            gravity_ratio,
            earth_rate_ratio: east_norm / expected,
        })
    }
}
