//! Strapdown mechanization in the local level frame: attitude, velocity and position from one corrected sample.
//!
//! Everything is multiplied in f32, and every state is a sum of two words: at 100 Hz the earth turns 7e-7 rad in a
//! sample and a slow vehicle moves by less than the last place of an f32 latitude, so a single word would lose it.

use nalgebra::{Matrix3, Vector3};

use crate::attitude::c_b_n_scaled;
use crate::earth::{Local, A, MAX_HEIGHT, MAX_LATITUDE, MIN_HEIGHT, OMEGA_IE};
use crate::error::Error;
use crate::imu::Motion;
use crate::linalg::{two_add, Two};

/// Largest speed that is accepted [m/s].
pub const MAX_SPEED: f32 = 10_000.0;

/// What a sample did, for the covariance: collected over an interval these are ∫C dt and ∫f dt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// C_b^n at the middle of the sample.
    pub c_b_n: Matrix3<f32>,
    /// ∫f_n dt over the sample, specific force in n [m/s].
    pub delta_v_n: Vector3<f32>,
    /// Length of the sample [s].
    pub dt: f32,
}

/// Attitude, velocity and position, each component in two words, for reading. [`crate::nav::NavState`] owns one, and
/// [`crate::nav::NavState::correct`] changes it.
///
/// What a step costs stands in `BENCHMARKS.md` (`cargo xtask bench`). Every eighth step renews the slow values and costs
/// a third more; the correction of the length of q falls on another one, every 64th.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Strapdown {
    /// Unit quaternion (w, x, y, z) that takes b to n.
    pub q: [Two; 4],
    /// Velocity over the ground, east-north-up [m/s].
    pub v_n: [Two; 3],
    /// Geodetic latitude [rad].
    pub lat: Two,
    /// Longitude in [−π, π] [rad].
    pub lon: Two,
    /// Ellipsoidal height [m].
    pub height: Two,
    slow: Slow,
    count: u8,
}

/// What changes slowly with the position, renewed every [`SLOW`] samples for the middle of the time until the next
/// renewal: at 200 m/s and 100 Hz it is never more than 7 m off, and not at all in the mean.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Slow {
    /// ω_ie, north and up [rad/s].
    ie_n: f32,
    ie_u: f32,
    tan_lat: f32,
    /// 1/(R_M + h), 1/(R_N + h), 1/((R_N + h) cos L) [1/m].
    inv_r_m: f32,
    inv_r_n: f32,
    inv_parallel: f32,
    /// [m/s²]
    gravity: f32,
}

/// Samples between two renewals of the slow values; a power of two.
const SLOW: u8 = 8;
/// Samples between two corrections of the quaternion's length; a power of two.
const LENGTH: u8 = 64;

impl Strapdown {
    /// From a checked position (latitude, longitude, height), velocity and unit quaternion.
    pub(crate) fn new([lat, lon, height]: [Two; 3], v_n: [f32; 3], q: [f32; 4]) -> Self {
        let one_word = |hi| Two { hi, lo: 0.0 };
        let mut state = Self {
            q: q.map(one_word),
            v_n: v_n.map(one_word),
            lat,
            lon,
            height,
            slow: Slow {
                ie_n: 0.0,
                ie_u: 0.0,
                tan_lat: 0.0,
                inv_r_m: 0.0,
                inv_r_n: 0.0,
                inv_parallel: 0.0,
                gravity: 0.0,
            },
            count: 0,
        };
        state.settle();
        state.renew(0.0);
        state
    }

    /// 1/(R_M + h), 1/(R_N + h) [1/m] and tan L, of the last renewal.
    #[inline(always)]
    pub(crate) fn curvature(&self) -> (f32, f32, f32) {
        (self.slow.inv_r_m, self.slow.inv_r_n, self.slow.tan_lat)
    }

    /// 1/((R_N + h) cos L) [1/m], of the last renewal.
    #[inline(always)]
    pub(crate) fn inv_parallel(&self) -> f32 {
        self.slow.inv_parallel
    }

    /// Moves on by one sample.
    ///
    /// ```text
    /// q   ← exp(−ζ/2) ∘ q ∘ exp(φ/2),             ζ = (ω_ie + ω_en) T
    /// Δ_n = C_mid u_m                              = ∫f_n dt;  C_mid half-way between the two attitudes
    /// v   ← v + Δ_n + g T − (2ω_ie + ω_en) T × (v + ½(Δ_n + g T))
    /// L, λ, h ← by the mean of the velocities before and after
    /// ```
    /// ω_en is that of the velocity at the beginning of the sample. `motion` comes from a checked sample.
    ///
    /// Source: Groves 2013, 5.4, in east-north-up, with the velocity transformed at mid-sample.
    /// Accuracy against the same in f64, fed with the same noisy samples: `host-tests/tests/mechanization.rs`.
    ///
    /// # Errors
    /// If the state to start from is beyond 80° of latitude, [`Error::Polar`], or beyond the heights and speeds that are
    /// accepted, [`Error::OutOfRange`]: it stays as it is. This is looked at with every renewal of the slow values, so
    /// that the sample across such a limit is still taken, and up to seven more; then none.
    #[inline(always)]
    pub fn step(&mut self, motion: &Motion) -> Result<Step, Error> {
        let dt = motion.dt;
        if self.count.is_multiple_of(SLOW) {
            inside(&self.lat, &self.height, self.v_n.map(|v| v.hi))?;
            self.renew(dt);
        }
        if self.count % LENGTH == SLOW / 2 {
            self.normalize();
        }
        self.count = self.count.wrapping_add(1);

        // Frame rates: transport (x, y, z) and earth (0, y, z), then the half angle of ζ.
        let slow = &self.slow;
        let (v_e, v_n, v_u) = (self.v_n[0].hi, self.v_n[1].hi, self.v_n[2].hi);
        let en_y = v_e * slow.inv_r_n;
        let half = 0.5 * dt;
        let n1 = -half * (v_n * slow.inv_r_m);
        let n2 = half * (slow.ie_n + en_y);
        let n3 = half * (slow.ie_u + en_y * slow.tan_lat);

        // The frame rotation −ζ/2∘q, some ten last places of q, goes to the low words; p is q in the turned frame, which
        // the body then turns. To leave the product of the two rotations out costs 2e-5 of |q|² in an hour of swing.
        let [q0, q1, q2, q3] = self.q;
        let l0 = q0.lo + n1 * q1.hi + n2 * q2.hi + n3 * q3.hi;
        let l1 = q1.lo - n1 * q0.hi - n2 * q3.hi + n3 * q2.hi;
        let l2 = q2.lo - n2 * q0.hi - n3 * q1.hi + n1 * q3.hi;
        let l3 = q3.lo - n3 * q0.hi - n1 * q2.hi + n2 * q1.hi;
        let (p0, p1, p2, p3) = (q0.hi + l0, q1.hi + l1, q2.hi + l2, q3.hi + l3);

        // exp(φ/2) − 1 = (e0, e + s): e the measured half angle, s the small rest of the rotation vector and its series,
        // whose next terms are 3e-9 of the angle at MAX_ROTATION.
        let (a, r) = (&motion.delta_theta_b, &motion.theta_correction_b);
        let (x, y, z) = (a.x + r.x, a.y + r.y, a.z + r.z);
        let m = x * x + y * y + z * z;
        let less = m * (1.0 / 48.0 - m * (1.0 / 3840.0 - m * (1.0 / 645_120.0)));
        let e0 = m * (m * (1.0 / 384.0 - m * (1.0 / 46_080.0)) - 0.125);
        let (e1, e2, e3) = (0.5 * a.x, 0.5 * a.y, 0.5 * a.z);
        let (s1, s2, s3) = (
            0.5 * r.x - less * x,
            0.5 * r.y - less * y,
            0.5 * r.z - less * z,
        );

        // p∘(e0, s) is small and goes to the low words before p∘e is added, so that it is never rounded to the last place
        // of that.
        let l0 = l0 + e0 * p0 - p1 * s1 - p2 * s2 - p3 * s3;
        let l1 = l1 + e0 * p1 + p0 * s1 + p2 * s3 - p3 * s2;
        let l2 = l2 + e0 * p2 + p0 * s2 + p3 * s1 - p1 * s3;
        let l3 = l3 + e0 * p3 + p0 * s3 + p1 * s2 - p2 * s1;
        let m0 = add(&mut self.q[0], l0, -(p1 * e1 + p2 * e2 + p3 * e3));
        let m1 = add(&mut self.q[1], l1, p0 * e1 + (p2 * e3 - p3 * e2));
        let m2 = add(&mut self.q[2], l2, p0 * e2 + (p3 * e1 - p1 * e3));
        let m3 = add(&mut self.q[3], l3, p0 * e3 + (p1 * e2 - p2 * e1));

        // The sum of the quaternions before and after points to mid-sample and has the length 2 cos(|φ|/4), squared
        // 4 (1 + e0/2).
        let mid = [q0.hi + m0, q1.hi + m1, q2.hi + m2, q3.hi + m3];
        let c = c_b_n_scaled(mid, 0.5 / (1.0 + 0.5 * e0));
        let u = &motion.delta_v_mid;
        let f_e = c.m11 * u.x + c.m12 * u.y + c.m13 * u.z;
        let f_n = c.m21 * u.x + c.m22 * u.y + c.m23 * u.z;
        let f_u = c.m31 * u.x + c.m32 * u.y + c.m33 * u.z;

        // Velocity: gravity, and Coriolis at the velocity of mid-sample.
        let a_u = f_u - slow.gravity * dt;
        let (h_e, h_n, h_u) = (v_e + 0.5 * f_e, v_n + 0.5 * f_n, v_u + 0.5 * a_u);
        let (c1, c2, c3) = (n1 + n1, n2 + n2 + dt * slow.ie_n, n3 + n3 + dt * slow.ie_u);
        let dv_e = f_e - (c2 * h_u - c3 * h_n);
        let dv_n = f_n - (c3 * h_e - c1 * h_u);
        let dv_u = a_u - (c1 * h_n - c2 * h_e);
        self.v_n[0].add(dv_e);
        self.v_n[1].add(dv_n);
        self.v_n[2].add(dv_u);

        // Position by the mean velocity.
        self.lat.add((v_n + 0.5 * dv_n) * dt * slow.inv_r_m);
        self.lon.add((v_e + 0.5 * dv_e) * dt * slow.inv_parallel);
        self.height.add((v_u + 0.5 * dv_u) * dt);
        if self.lon.hi.abs() > core::f32::consts::PI {
            self.lon = wrapped(self.lon);
        }
        Ok(Step {
            c_b_n: c,
            delta_v_n: Vector3::new(f_e, f_n, f_u),
            dt,
        })
    }

    /// After the state was set from outside: unit length, slow values at the next sample.
    pub(crate) fn settle(&mut self) {
        self.normalize();
        self.renew_next();
    }

    /// Slow values at the next sample, and unit length four samples later.
    #[inline(always)]
    pub(crate) fn renew_next(&mut self) {
        self.count = 0;
    }

    #[inline(never)]
    fn renew(&mut self, dt: f32) {
        let ahead = 0.5 * f32::from(SLOW - 1) * dt;
        let lat = Two {
            hi: self.lat.hi,
            lo: self.lat.lo + self.v_n[1].hi * ahead * (1.0 / A) as f32,
        };
        let local = Local::at_words(lat, self.height.hi + self.v_n[2].hi * ahead);
        self.slow = Slow {
            ie_n: OMEGA_IE as f32 * local.cos_lat,
            ie_u: OMEGA_IE as f32 * local.sin_lat,
            tan_lat: local.tan_lat,
            inv_r_m: local.inv_r_m,
            inv_r_n: local.inv_r_n,
            inv_parallel: local.inv_r_n * local.inv_cos_lat,
            gravity: local.gravity,
        };
    }

    /// Pulls the quaternion back to unit length.
    #[inline(never)]
    fn normalize(&mut self) {
        let [w, x, y, z] = &mut self.q;
        let ((w1, w2), (x1, x2)) = (square(w), square(x));
        let ((y1, y2), (z1, z2)) = (square(y), square(z));
        let excess = (((w1 + x1) + (y1 + z1)) - 1.0) + ((w2 + x2) + (y2 + z2));
        let k = -0.5 * excess;
        w.add(k * w.hi);
        x.add(k * x.hi);
        y.add(k * y.hi);
        z.add(k * z.hi);
    }
}

/// Latitude, height and speed inside what is accepted.
#[inline(always)]
fn inside(lat: &Two, height: &Two, [x, y, z]: [f32; 3]) -> Result<(), Error> {
    if lat.hi.abs() > MAX_LATITUDE {
        return Err(Error::Polar);
    }
    // Written as what is good: a NaN would fail both.
    let slow = x * x + y * y + z * z <= MAX_SPEED * MAX_SPEED;
    if slow && (MIN_HEIGHT..=MAX_HEIGHT).contains(&height.hi) {
        Ok(())
    } else {
        Err(Error::OutOfRange)
    }
}

/// Of a state that is set from outside: refuses what is not accepted, and brings the longitude into [−π, π].
#[inline(always)]
pub(crate) fn admit(lat: &Two, lon: Two, height: &Two, v_n: [f32; 3]) -> Result<Two, Error> {
    inside(lat, height, v_n)?;
    if lon.hi.abs() <= core::f32::consts::PI {
        Ok(lon)
    } else if lon.hi.abs() <= core::f32::consts::TAU {
        Ok(wrapped(lon))
    } else {
        Err(Error::OutOfRange)
    }
}

/// w² in two parts: the square of w to the nearest 2⁻¹¹, which has 22 bits and whose sums are exact, and what is missing,
/// to 2e-11.
#[inline(always)]
fn square(w: &Two) -> (f32, f32) {
    const LAST_PLACE: f32 = 6144.0; // 1.5·2¹²: its last place is 2⁻¹¹
    let head = (w.hi + LAST_PLACE) - LAST_PLACE;
    let tail = (w.hi - head) + w.lo;
    (head * head, (head + head + tail) * tail)
}

/// Adds `large` to `w.hi + lo` and returns the high word.
#[inline(always)]
fn add(w: &mut Two, lo: f32, large: f32) -> f32 {
    (w.hi, w.lo) = two_add(w.hi, lo, large);
    w.hi
}

/// A longitude just beyond ±π, less one turn.
#[cold]
fn wrapped(lon: Two) -> Two {
    const TURN: f64 = core::f64::consts::TAU;
    const HI: f32 = TURN as f32;
    const LO: f32 = (TURN - HI as f64) as f32;
    let sign = if lon.hi > 0.0 { -1.0 } else { 1.0 };
    // Exact: the two are within a factor of two of each other.
    let hi = lon.hi + sign * HI;
    let lo = lon.lo + sign * LO;
    let sum = hi + lo;
    Two {
        hi: sum,
        lo: lo - (sum - hi),
    }
}
