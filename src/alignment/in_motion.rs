//! Attitude of a moving vehicle from nothing: inertial samples against the velocities of a satellite receiver.
//!
//! A 15-state filter is linear in the attitude error, and with an unknown heading it settles on a wrong one more often
//! than not. So the attitude is found first, without linearisation. The gyros carry the body frame of the first sample
//! (b₀) along, and between two velocities
//!
//! ```text
//! β = v₂ − v₁ + g (t₂ − t₁) up = C_b₀^n α,      α = ∫ C_b^b₀ f_b dt
//! ```
//! Gravity gives the level; every horizontal change of velocity gives a piece of heading, in whatever direction. The
//! rotation that fits all pairs best (Wahba) is found from their sums: the way between the two mean vectors first, then
//! the best turn about it, then Gauss-Newton. A vehicle that never changes its velocity has no heading, and the result
//! says so: its σ stays large.
//!
//! Source: the velocity pairs of in-motion alignment (Wu & Pan 2013, IEEE TAES 49(2)); solution from the sums and its
//! covariance derived here. Left out: the turn of the level frame with the earth and the vehicle, 15°/h; so windows of up
//! to two minutes.

use nalgebra::{Matrix3, Vector3};

use super::inertial::{rotation_by, InertialFrame};
use crate::attitude::{Enu, Euler};
use crate::error::Error;
use crate::filter::ring::Ring;
use crate::imu::{ImuIncrement, ImuLimits};
use crate::linalg::{
    all_finite, cross, divided, dot, minus, plus, product, product_transposed, scaled, skew,
    transformed, Two,
};

/// Fewest pairs that an attitude is made from.
pub const MIN_PAIRS: u16 = 5;

/// ∫ C f dt at one time.
#[derive(Clone, Copy, Debug)]
struct Point {
    time: f64,
    v_b0: Vector3<f32>,
}

/// What the pairs said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InMotionSolution {
    /// Attitude at the last sample.
    pub c_b_n: Matrix3<f32>,
    /// Standard deviation about east, north, up from the scatter of the pairs [rad]; without the sensor biases.
    pub sigma: Vector3<f32>,
    /// What the velocity has changed from the last velocity handed in to the last sample, by the samples,
    /// east-north-up [m/s].
    pub delta_v_n: Vector3<f32>,
    /// How long that was [s].
    pub age: f32,
}

impl InMotionSolution {
    /// Heading, pitch and roll at the last sample.
    pub fn euler(&self) -> Euler {
        Euler::from_c_b_n(&self.c_b_n)
    }
}

/// Gathers samples and velocities. K samples are remembered for velocities that arrive late.
#[derive(Clone, Debug)]
pub struct InMotion<const K: usize> {
    limits: ImuLimits,
    gravity: f32,
    /// Shortest time between two velocities that make a pair [s].
    spacing: f32,
    frame: InertialFrame,
    v_b0: [Two; 3],
    time: Two,
    points: Ring<Point, K>,
    last: Option<(Point, Vector3<f32>)>,
    pairs: u16,
    sum_a: Vector3<f32>,
    sum_b: Vector3<f32>,
    /// Σ α αᵀ
    aa: Matrix3<f32>,
    /// Σ β αᵀ
    ba: Matrix3<f32>,
    /// Σ |β|²
    bb: f32,
}

impl<const K: usize> InMotion<K> {
    /// Begins with the next sample. `gravity` [m/s²] of the place; velocities closer than `spacing` [s] are left out, so
    /// that their noise does not swamp the change: about a second.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for a gravity outside 9 … 10 m/s² or a spacing outside 0.1 … 10 s.
    pub fn new(gravity: f32, spacing: f32, limits: ImuLimits) -> Result<Self, Error> {
        if !(gravity.is_finite() && spacing.is_finite()) {
            return Err(Error::NonFinite);
        }
        if !((9.0..=10.0).contains(&gravity) && (0.1..=10.0).contains(&spacing)) {
            return Err(Error::OutOfRange);
        }
        let zero = Two::of(0.0);
        let mut points = Ring::new();
        points.keep(Point {
            time: 0.0,
            v_b0: Vector3::zeros(),
        });
        Ok(Self {
            limits,
            gravity,
            spacing,
            frame: InertialFrame::new(),
            v_b0: [zero; 3],
            time: zero,
            points,
            last: None,
            pairs: 0,
            sum_a: Vector3::zeros(),
            sum_b: Vector3::zeros(),
            aa: Matrix3::zeros(),
            ba: Matrix3::zeros(),
            bb: 0.0,
        })
    }

    /// Seconds of samples taken so far.
    pub fn time(&self) -> f64 {
        self.time.wide()
    }

    /// Pairs of velocities so far.
    pub fn pairs(&self) -> u16 {
        self.pairs
    }

    /// Takes one sample.
    ///
    /// # Errors
    /// Those of [`ImuIncrement::check`]; nothing has changed then.
    pub fn take(&mut self, imu: &ImuIncrement) -> Result<(), Error> {
        imu.check(&self.limits)?;
        let delta_v = self.frame.take(imu);
        let [vx, vy, vz] = &mut self.v_b0;
        vx.add(delta_v.x);
        vy.add(delta_v.y);
        vz.add(delta_v.z);
        self.time.add(imu.dt);
        self.points.keep(self.now());
        Ok(())
    }

    fn now(&self) -> Point {
        let [x, y, z] = &self.v_b0;
        Point {
            time: self.time.wide(),
            v_b0: Vector3::new(x.hi, y.hi, z.hi),
        }
    }

    /// Takes a velocity over the ground [m/s] (bare vectors are east-north-up) of the time `time` [s of
    /// [`InMotion::time`]]. Whether it made a pair.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::Late`] for a time that is no longer remembered, [`Error::Time`] for one to come.
    pub fn velocity(&mut self, time: f64, v_n: impl Into<Enu>) -> Result<bool, Error> {
        let v_n = v_n.into().0;
        if !(time.is_finite() && all_finite(&[v_n.x, v_n.y, v_n.z])) {
            return Err(Error::NonFinite);
        }
        let point = self.at(time)?;
        let Some((before, v_before)) = self.last else {
            self.last = Some((point, v_n));
            return Ok(false);
        };
        let dt = (point.time - before.time) as f32;
        if dt < self.spacing {
            return Ok(false);
        }
        let a = minus(&point.v_b0, &before.v_b0);
        let mut b = minus(&v_n, &v_before);
        b.z += self.gravity * dt;
        self.sum_a = plus(&self.sum_a, &a);
        self.sum_b = plus(&self.sum_b, &b);
        add_outer(&mut self.aa, &a, &a);
        add_outer(&mut self.ba, &b, &a);
        self.bb += dot(&b, &b);
        self.pairs = self.pairs.saturating_add(1);
        self.last = Some((point, v_n));
        Ok(true)
    }

    /// The sum of α at a time.
    fn at(&self, time: f64) -> Result<Point, Error> {
        let mut after = self.now();
        if time >= after.time {
            // as much ahead as a sample is long: the clocks of two sensors
            return if time - after.time <= f64::from(self.limits.dt_max) * 0.1 {
                Ok(after)
            } else {
                Err(Error::Time)
            };
        }
        for age in 0..K {
            let Some(point) = self.points.back(age) else {
                break;
            };
            if point.time <= time {
                let whole = (after.time - point.time) as f32;
                let share = if whole > 0.0 {
                    (time - point.time) as f32 / whole
                } else {
                    0.0
                };
                return Ok(Point {
                    time,
                    v_b0: plus(
                        &point.v_b0,
                        &scaled(&minus(&after.v_b0, &point.v_b0), share),
                    ),
                });
            }
            after = *point;
        }
        Err(Error::Late)
    }

    /// The attitude that fits best. `sigma_v`: 1σ of the velocities per axis [m/s]; the scatter of the pairs is taken
    /// instead where it is larger.
    ///
    /// # Errors
    /// [`Error::Time`] for fewer than [`MIN_PAIRS`] pairs; [`Error::OutOfRange`] when nothing tells the heading: no
    /// horizontal change of velocity at all, or a fit that does not converge.
    pub fn solve(&self, sigma_v: f32) -> Result<InMotionSolution, Error> {
        if self.pairs < MIN_PAIRS {
            return Err(Error::Time);
        }
        let Some((point, _)) = self.last else {
            return Err(Error::Time);
        };
        // The mean vectors onto each other,
        let (a, b) = (unit(&self.sum_a)?, unit(&self.sum_b)?);
        let mut c = shortest(&a, &b);
        // the best turn about them: Σ β·(R α) = const + cos·Σ(β·α' − …) + sin·Σ b·(α' × β),
        let m = product_transposed(&self.ba, &c); // Σ β α'ᵀ
        let sin = dot(&b, &vee(&m));
        let cos = trace(&m) - dot(&b, &transformed(&m, &b));
        let length = libm::sqrtf(sin * sin + cos * cos);
        if !(length > 0.0 && length.is_finite()) {
            return Err(Error::OutOfRange);
        }
        let about = scaled(&b, libm::atan2f(sin, cos));
        c = product(&rotation_by(&about), &c);
        // and what is left of both.
        let mut inverse = Matrix3::zeros();
        let mut step = Vector3::zeros();
        for _ in 0..6 {
            let a_n = product_transposed(&product(&c, &self.aa), &c);
            let normal = trace_less(&a_n);
            inverse = normal.try_inverse().ok_or(Error::OutOfRange)?;
            step = transformed(&inverse, &vee(&product_transposed(&self.ba, &c)));
            c = product(&rotation_by(&step), &c);
        }
        let rest = dot(&step, &step);
        if rest.is_nan() || rest > 1e-6 {
            return Err(Error::OutOfRange);
        }
        let n = f32::from(self.pairs);
        let fit = trace(&product_transposed(&self.ba, &c));
        let loss = self.bb + trace(&self.aa) - 2.0 * fit;
        let scatter = loss / (3.0 * n - 3.0);
        let var = scatter.max(2.0 * sigma_v * sigma_v);
        let sigma = |x: f32| libm::sqrtf(var * x).min(super::coarse::UNKNOWN_HEADING);
        let now = self.now();
        let age = (now.time - point.time).max(0.0) as f32;
        let mut delta_v_n = transformed(&c, &minus(&now.v_b0, &point.v_b0));
        delta_v_n.z -= self.gravity * age;
        Ok(InMotionSolution {
            c_b_n: product(&c, &self.frame.c_b_b0()),
            sigma: Vector3::new(sigma(inverse.m11), sigma(inverse.m22), sigma(inverse.m33)),
            delta_v_n,
            age,
        })
    }
}

/// Σ α' × β of Σ β α'ᵀ.
fn vee(m: &Matrix3<f32>) -> Vector3<f32> {
    Vector3::new(m.m32 - m.m23, m.m13 - m.m31, m.m21 - m.m12)
}

fn trace(m: &Matrix3<f32>) -> f32 {
    m.m11 + m.m22 + m.m33
}

/// I tr M − M
fn trace_less(m: &Matrix3<f32>) -> Matrix3<f32> {
    let t = trace(m);
    Matrix3::new(
        t - m.m11,
        0.0 - m.m12,
        0.0 - m.m13,
        0.0 - m.m21,
        t - m.m22,
        0.0 - m.m23,
        0.0 - m.m31,
        0.0 - m.m32,
        t - m.m33,
    )
}

/// M + a bᵀ
fn add_outer(m: &mut Matrix3<f32>, a: &Vector3<f32>, b: &Vector3<f32>) {
    m.m11 += a.x * b.x;
    m.m12 += a.x * b.y;
    m.m13 += a.x * b.z;
    m.m21 += a.y * b.x;
    m.m22 += a.y * b.y;
    m.m23 += a.y * b.z;
    m.m31 += a.z * b.x;
    m.m32 += a.z * b.y;
    m.m33 += a.z * b.z;
}

#[inline(always)] // a Result of a vector would be copied byte by byte
fn unit(v: &Vector3<f32>) -> Result<Vector3<f32>, Error> {
    let norm = libm::sqrtf(dot(v, v));
    if norm > 1e-3 {
        Ok(divided(v, norm))
    } else {
        Err(Error::OutOfRange)
    }
}

/// The shortest rotation of unit vector a onto unit vector b; any half turn when they are opposite.
fn shortest(a: &Vector3<f32>, b: &Vector3<f32>) -> Matrix3<f32> {
    if dot(a, b) > -0.999 {
        return shortest_narrow(a, b);
    }
    // By way of a third vector, at right angles to b.
    let side = if b.x.abs() < 0.7 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let over = cross(b, &side);
    let over = scaled(&over, 1.0 / libm::sqrtf(dot(&over, &over)));
    product(&shortest_narrow(&over, b), &shortest_narrow(a, &over))
}

/// As [`shortest`] for vectors that are not opposite.
fn shortest_narrow(a: &Vector3<f32>, b: &Vector3<f32>) -> Matrix3<f32> {
    let k = skew(&cross(a, b));
    let (kk, s) = (product(&k, &k), 1.0 / (1.0 + dot(a, b)));
    Matrix3::new(
        1.0 + k.m11 + kk.m11 * s,
        0.0 + k.m12 + kk.m12 * s,
        0.0 + k.m13 + kk.m13 * s,
        0.0 + k.m21 + kk.m21 * s,
        1.0 + k.m22 + kk.m22 * s,
        0.0 + k.m23 + kk.m23 * s,
        0.0 + k.m31 + kk.m31 * s,
        0.0 + k.m32 + kk.m32 * s,
        1.0 + k.m33 + kk.m33 * s,
    )
}
