//! Strapdown mechanization in the local level frame: attitude, velocity and position from one corrected sample.
//!
//! Everything is multiplied in f32, and every state is a sum of two words: at 100 Hz the earth turns 7e-7 rad in a
//! sample and a slow vehicle moves by less than the last place of an f32 latitude, so a single word would lose it.

use nalgebra::{Matrix3, Vector3};

use crate::attitude::c_b_n_scaled;
use crate::earth::{Local, MAX_HEIGHT, MAX_LATITUDE, MIN_HEIGHT, OMEGA_IE};
use crate::error::Error;
use crate::imu::Motion;
use crate::linalg::Two;

/// Largest speed that is accepted [m/s].
pub const MAX_SPEED: f32 = 10_000.0;

/// Samples between two corrections of the quaternion's length.
const NORM_INTERVAL: u8 = 64;

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

/// Attitude, velocity and position, each component in two words.
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
    /// Samples until the length of q is corrected.
    pub countdown: u8,
}

impl Strapdown {
    /// Moves on by one sample.
    ///
    /// ```text
    /// q   ← exp(−ζ/2) ∘ q ∘ exp(φ/2),             ζ = (ω_ie + ω_en) T
    /// Δ_n = C_mid u_m                              = ∫f_n dt;  C_mid from (q₋ + q₊)/2, both frames at mid-sample
    /// v   ← v + Δ_n + g T − (2ω_ie + ω_en) T × (v + ½(Δ_n + g T))
    /// L, λ, h ← by the mean of the velocities before and after
    /// ```
    /// ω_en, radii and gravity are those at the beginning of the sample. `motion` comes from a checked sample.
    ///
    /// Source: Groves 2013, 5.4, in east-north-up, with the velocity transformed at mid-sample.
    /// Accuracy against the same in f64, fed with the same noisy samples: `host-tests/tests/mechanization.rs`.
    ///
    /// # Errors
    /// [`Error::Polar`] if the latitude would pass [`MAX_LATITUDE`], [`Error::OutOfRange`] if the speed or the height
    /// would leave what is accepted. Nothing has changed then.
    #[inline(always)]
    pub fn step(&mut self, motion: &Motion) -> Result<Step, Error> {
        let local = Local::at_words(self.lat, self.height.hi);
        let dt = motion.dt;
        let (q0, q1, q2, q3) = (self.q[0].hi, self.q[1].hi, self.q[2].hi, self.q[3].hi);
        let (v_e, v_n, v_u) = (self.v_n[0].hi, self.v_n[1].hi, self.v_n[2].hi);

        // Frame rates: transport (x, y, z) and earth (0, y, z), then the half angle of ζ.
        let en_x = -v_n * local.inv_r_m;
        let en_y = v_e * local.inv_r_n;
        let en_z = en_y * local.tan_lat;
        let ie_y = OMEGA_IE as f32 * local.cos_lat;
        let ie_z = OMEGA_IE as f32 * local.sin_lat;
        let half = 0.5 * dt;
        let (n1, n2, n3) = (half * en_x, half * (ie_y + en_y), half * (ie_z + en_z));

        // exp(φ/2) − 1; the next terms are 3e-9 of the angle at MAX_ROTATION.
        let phi = &motion.phi_b;
        let p = phi.x * phi.x + phi.y * phi.y + phi.z * phi.z;
        let sine = 0.5 - p * (1.0 / 48.0 - p * (1.0 / 3840.0 - p * (1.0 / 645_120.0)));
        let e0 = -p * (0.125 - p * (1.0 / 384.0 - p * (1.0 / 46_080.0)));
        let (e1, e2, e3) = (sine * phi.x, sine * phi.y, sine * phi.z);

        // d = q∘(e − 1), then the frame rotation acts on q + d: dropping n∘d would lose 2e-5 of |q|² in an hour of swing.
        let d0 = e0 * q0 - (q1 * e1 + q2 * e2 + q3 * e3);
        let d1 = e0 * q1 + q0 * e1 + (q2 * e3 - q3 * e2);
        let d2 = e0 * q2 + q0 * e2 + (q3 * e1 - q1 * e3);
        let d3 = e0 * q3 + q0 * e3 + (q1 * e2 - q2 * e1);
        let (r0, r1, r2, r3) = (q0 + d0, q1 + d1, q2 + d2, q3 + d3);
        let d0 = d0 + (n1 * r1 + n2 * r2 + n3 * r3);
        let d1 = d1 - (n1 * r0 + n2 * r3 - n3 * r2);
        let d2 = d2 - (n2 * r0 + n3 * r1 - n1 * r3);
        let d3 = d3 - (n3 * r0 + n1 * r2 - n2 * r1);

        // The mean of the quaternions before and after has the length cos(|φ|/4), squared 1 + e0/2.
        let mid = [q0 + 0.5 * d0, q1 + 0.5 * d1, q2 + 0.5 * d2, q3 + 0.5 * d3];
        let c = c_b_n_scaled(mid, 2.0 / (1.0 + 0.5 * e0));
        let u = &motion.delta_v_mid;
        let w_e = c.m11 * u.x + c.m12 * u.y + c.m13 * u.z;
        let w_n = c.m21 * u.x + c.m22 * u.y + c.m23 * u.z;
        let w_u = c.m31 * u.x + c.m32 * u.y + c.m33 * u.z;

        // Velocity: gravity and Coriolis at the velocity of mid-sample.
        let g_dt = local.gravity * dt;
        let a_u = w_u - g_dt;
        let (m_e, m_n, m_u) = (v_e + 0.5 * w_e, v_n + 0.5 * w_n, v_u + 0.5 * a_u);
        let (c1, c2, c3) = (n1 + n1, n2 + n2 + dt * ie_y, n3 + n3 + dt * ie_z);
        let dv_e = w_e - (c2 * m_u - c3 * m_n);
        let dv_n = w_n - (c3 * m_e - c1 * m_u);
        let dv_u = a_u - (c1 * m_n - c2 * m_e);
        let mut next = *self;
        next.v_n[0].add(dv_e);
        next.v_n[1].add(dv_n);
        next.v_n[2].add(dv_u);

        // Position by the mean velocity.
        next.lat.add((v_n + 0.5 * dv_n) * dt * local.inv_r_m);
        next.lon
            .add((v_e + 0.5 * dv_e) * dt * (local.inv_r_n * local.inv_cos_lat));
        next.height.add((v_u + 0.5 * dv_u) * dt);
        next.admit()?;

        next.q[0].add(d0);
        next.q[1].add(d1);
        next.q[2].add(d2);
        next.q[3].add(d3);
        next.countdown = match self.countdown.checked_sub(1) {
            Some(left) => left,
            None => {
                next.normalize();
                NORM_INTERVAL - 1
            }
        };
        *self = next;
        Ok(Step {
            c_b_n: c,
            delta_v_n: Vector3::new(w_e, w_n, w_u),
            dt,
        })
    }

    /// Latitude, height and speed inside what is accepted; brings the longitude back into [−π, π].
    #[inline(always)]
    pub(crate) fn admit(&mut self) -> Result<(), Error> {
        let (x, y, z) = (self.v_n[0].hi, self.v_n[1].hi, self.v_n[2].hi);
        if self.lat.hi.abs() > MAX_LATITUDE {
            return Err(Error::Polar);
        }
        // Written as what is good: a NaN would fail both.
        let slow = x * x + y * y + z * z <= MAX_SPEED * MAX_SPEED;
        if !(slow && (MIN_HEIGHT..=MAX_HEIGHT).contains(&self.height.hi)) {
            return Err(Error::OutOfRange);
        }
        if self.lon.hi.abs() > core::f32::consts::PI {
            if self.lon.hi.abs() > core::f32::consts::TAU {
                return Err(Error::OutOfRange);
            }
            self.lon = wrapped(self.lon);
        }
        Ok(())
    }

    /// Pulls the quaternion back to unit length. The excess of |q|² over 1 is found in two words (products split after
    /// Veltkamp, since a fused multiplication is not available to every core).
    #[inline(always)]
    pub(crate) fn normalize(&mut self) {
        let (mut hi, mut lo) = (-1.0, 0.0);
        for w in &self.q {
            (hi, lo) = add_square(hi, lo, w);
        }
        let k = -0.5 * (hi + lo);
        for w in &mut self.q {
            w.add(k * w.hi);
        }
    }
}

/// (hi, lo) + w², to about twice the precision of f32.
#[inline(always)]
fn add_square(hi: f32, lo: f32, w: &Two) -> (f32, f32) {
    let split = w.hi * 4097.0; // 2¹² + 1
    let head = split - (split - w.hi);
    let tail = w.hi - head;
    let p = w.hi * w.hi;
    let error = ((head * head - p) + 2.0 * head * tail) + tail * tail;
    let sum = hi + p;
    let part = sum - hi;
    (
        sum,
        lo + ((hi - (sum - part)) + (p - part)) + error + 2.0 * w.hi * w.lo,
    )
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
