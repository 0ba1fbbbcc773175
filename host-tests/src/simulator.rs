//! A vehicle that stands, is turned about the vertical, and stands again: what its IMU measures, exactly, and what a
//! sensor of a given grade makes of it.
//!
//! ```text
//! ω_ib^b = C_n^b ω_ie + C_n^b (0, 0, −heading rate),   f^b = C_n^b (0, 0, g),   C_b^n = R_z(−heading(t)) C_tilt
//! ```
//! The tilt is constant, so the last rate and the specific force are constant in b; the earth rate is integrated over
//! each sample by Simpson's rule, whose error at 2° per sample is below 1e-9 of the earth rate.

use nalgebra::{Matrix3, Vector3};
use navsight::earth::{normal_gravity, omega_ie_n, Geodetic};

/// One turn about the vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// When it begins [s].
    pub start: f64,
    /// How long it takes [s].
    pub duration: f64,
    /// Heading rate, clockwise [rad/s].
    pub rate: f64,
}

/// The true motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Stand {
    /// Where [rad, m].
    pub position: Geodetic,
    /// Heading at the start, clockwise from north [rad].
    pub heading: f64,
    /// Pitch, nose up [rad].
    pub pitch: f64,
    /// Roll, right side down [rad].
    pub roll: f64,
    /// Turns in order of time, not overlapping.
    pub turns: Vec<Turn>,
}

impl Stand {
    /// Heading at a time, clockwise from north and not wrapped [rad].
    pub fn heading_at(&self, t: f64) -> f64 {
        self.turns.iter().fold(self.heading, |h, turn| {
            h + turn.rate * (t - turn.start).clamp(0.0, turn.duration)
        })
    }

    /// Whether the vehicle turns at some time within `from..to`.
    pub fn turns_within(&self, from: f64, to: f64) -> bool {
        self.turns
            .iter()
            .any(|turn| from < turn.start + turn.duration && to > turn.start)
    }

    /// Body to n at a time.
    pub fn c_b_n(&self, t: f64) -> Matrix3<f64> {
        let (s, c) = self.heading_at(t).sin_cos();
        Matrix3::new(c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0) * self.tilt()
    }

    /// R_x(pitch) R_y(roll)
    fn tilt(&self) -> Matrix3<f64> {
        let ((sp, cp), (sr, cr)) = (self.pitch.sin_cos(), self.roll.sin_cos());
        Matrix3::new(1.0, 0.0, 0.0, 0.0, cp, -sp, 0.0, sp, cp)
            * Matrix3::new(cr, 0.0, sr, 0.0, 1.0, 0.0, -sr, 0.0, cr)
    }

    /// ∫ω_ib^b dt [rad] and ∫f^b dt [m/s] from `t0` to `t1`.
    pub fn increments(&self, t0: f64, t1: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (sin_lat, cos_lat) = self.position.lat.sin_cos();
        let omega_ie = omega_ie_n(sin_lat, cos_lat);
        let gravity = normal_gravity(sin_lat, self.position.height);
        let up_b = self.tilt().transpose() * Vector3::z();
        let mut delta_theta = up_b * -(self.heading_at(t1) - self.heading_at(t0));
        // The rate jumps where a turn begins or ends: Simpson's rule on each side of it.
        let mut cuts = vec![t0, t1];
        let edges = self
            .turns
            .iter()
            .flat_map(|t| [t.start, t.start + t.duration]);
        cuts.extend(edges.filter(|&e| t0 < e && e < t1));
        cuts.sort_by(f64::total_cmp);
        for (a, b) in cuts.iter().zip(cuts.iter().skip(1)) {
            let at = |t: f64| self.c_b_n(t).transpose() * omega_ie;
            delta_theta += (at(*a) + at(0.5 * (a + b)) * 4.0 + at(*b)) * ((b - a) / 6.0);
        }
        (delta_theta, up_b * (gravity * (t1 - t0)))
    }
}

/// Errors of one sensor: what it adds to the truth.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuErrors {
    /// Gyro biases, right, forward, up [rad/s].
    pub gyro_bias: Vector3<f64>,
    /// Accelerometer biases [m/s²].
    pub accel_bias: Vector3<f64>,
    /// Angle random walk [rad/√s].
    pub angle_walk: f64,
    /// Velocity random walk [m/s/√s].
    pub velocity_walk: f64,
    noise: Noise,
}

impl ImuErrors {
    /// Biases drawn from their standard deviations [rad/s], [m/s²], with white noise on top.
    pub fn drawn(
        seed: u64,
        sigma_gyro: f64,
        sigma_accel: f64,
        angle_walk: f64,
        velocity_walk: f64,
    ) -> Self {
        let mut noise = Noise::new(seed);
        Self {
            gyro_bias: noise.vector() * sigma_gyro,
            accel_bias: noise.vector() * sigma_accel,
            angle_walk,
            velocity_walk,
            noise,
        }
    }

    /// What the sensor reports for these true increments over `dt` [s].
    pub fn measure(
        &mut self,
        (delta_theta, delta_v): (Vector3<f64>, Vector3<f64>),
        dt: f64,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let root = dt.sqrt();
        (
            delta_theta + self.gyro_bias * dt + self.noise.vector() * (self.angle_walk * root),
            delta_v + self.accel_bias * dt + self.noise.vector() * (self.velocity_walk * root),
        )
    }
}

/// Reproducible normal numbers: the same on every machine for one seed.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    state: u64,
    spare: Option<f64>,
}

impl Noise {
    /// A sequence of its own for every seed.
    pub fn new(seed: u64) -> Self {
        Self {
            state: seed,
            spare: None,
        }
    }

    /// SplitMix64, to [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Mean 0, variance 1 (Box and Muller), from libm's functions so that hosts agree.
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.uniform()));
        let (s, c) = libm::sincos(core::f64::consts::TAU * self.uniform());
        self.spare = Some(radius * s);
        radius * c
    }

    /// Three of them.
    pub fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stand() -> Stand {
        Stand {
            position: Geodetic::from_degrees(37.4, 116.0, 50.0),
            heading: 0.5,
            pitch: 0.1,
            roll: -0.2,
            turns: vec![Turn {
                start: 1.005,
                duration: 2.0,
                rate: core::f64::consts::FRAC_PI_2,
            }],
        }
    }

    #[test]
    fn the_increments_turn_the_body_from_the_start_to_the_end() {
        // An independent way: the attitude against the inertial frame, n(0) turned back by the earth, must follow the
        // increments. They leave out the coning of the earth rate in a turning body, (0.0157 rad)² × 7.3e-7 rad / 12
        // in each of the 200 samples of the turn: 3e-9 if all pointed the same way.
        let s = stand();
        let (sin_lat, cos_lat) = s.position.lat.sin_cos();
        let omega_ie: Vector3<f64> = omega_ie_n(sin_lat, cos_lat);
        let mut c_b_i = s.c_b_n(0.0);
        let dt = 0.01;
        for k in 0..400 {
            let (delta_theta, _) = s.increments(f64::from(k) * dt, f64::from(k + 1) * dt);
            c_b_i *= nalgebra::Rotation3::new(delta_theta).matrix();
        }
        let c_i_n = nalgebra::Rotation3::new(-omega_ie * 4.0);
        let difference = c_i_n.matrix() * c_b_i - s.c_b_n(4.0);
        assert!(difference.amax() < 3e-9, "{difference}");
        assert!((s.heading_at(4.0) - 0.5 - core::f64::consts::PI).abs() < 1e-12);
    }

    #[test]
    fn noise_has_the_moments_of_a_normal_distribution() {
        // 100 000 numbers: the mean scatters by 0.0032, the variance by 0.0045, the fourth moment by 0.031 (1σ).
        let mut noise = Noise::new(7);
        let (mut m1, mut m2, mut m4) = (0.0, 0.0, 0.0);
        for _ in 0..100_000 {
            let x = noise.normal();
            (m1, m2, m4) = (m1 + x, m2 + x * x, m4 + x.powi(4));
        }
        let n = 1e5;
        assert!(
            (m1 / n).abs() < 0.0127 && (m2 / n - 1.0).abs() < 0.018 && (m4 / n - 3.0).abs() < 0.125
        );
    }
}
