//! The strapdown algorithm in double precision: no cached value, no series, exact exponentials.
//!
//! The same definitions as the library's (coning and sculling with the previous sample, velocity transformed at
//! mid-sample, Coriolis at the velocity of mid-sample, position by the mean velocity), so that what is left between
//! the two is single precision. How good the definitions are is another question, answered against the simulator.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Semi-major axis [m].
const A: f64 = 6_378_137.0;
/// Flattening.
const F: f64 = 1.0 / 298.257_223_563;
/// Earth rate [rad/s].
pub const OMEGA: f64 = 7.292_115e-5;

/// First eccentricity squared.
fn e2() -> f64 {
    F * (2.0 - F)
}

/// Radii of curvature in the meridian and in the prime vertical [m].
pub fn radii(lat: f64) -> (f64, f64) {
    let w = (1.0 - e2() * lat.sin().powi(2)).sqrt();
    (A * (1.0 - e2()) / w.powi(3), A / w)
}

/// Normal gravity, by Somigliana's formula from the gravity at the equator and at the pole, and a second-order height
/// term [m/s²].
pub fn gravity(lat: f64, height: f64) -> f64 {
    let (g_e, g_p) = (9.780_325_335_9, 9.832_184_937_863);
    let b = A * (1.0 - F);
    let (s2, c2) = (lat.sin().powi(2), lat.cos().powi(2));
    let g_0 = (A * g_e * c2 + b * g_p * s2) / (A * A * c2 + b * b * s2).sqrt();
    let m = OMEGA * OMEGA * A * A * b / 3.986_004_418e14;
    g_0 * (1.0 - 2.0 / A * (1.0 + F + m - 2.0 * F * s2) * height + 3.0 * (height / A).powi(2))
}

/// Earth rate and transport rate, east-north-up [rad/s].
pub fn frame_rates(lat: f64, height: f64, v_n: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let (r_m, r_n) = radii(lat);
    let omega_ie = Vector3::new(0.0, OMEGA * lat.cos(), OMEGA * lat.sin());
    let omega_n = v_n.x / (r_n + height);
    (
        omega_ie,
        Vector3::new(-v_n.y / (r_m + height), omega_n, omega_n * lat.tan()),
    )
}

/// Rotation by a rotation vector.
pub fn exp(phi: Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(phi)
}

/// Nominal state in double precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strapdown {
    /// Body to east-north-up.
    pub q: UnitQuaternion<f64>,
    /// Velocity, east-north-up [m/s].
    pub v_n: Vector3<f64>,
    /// Latitude [rad].
    pub lat: f64,
    /// Longitude, not wrapped [rad].
    pub lon: f64,
    /// Ellipsoidal height [m].
    pub height: f64,
    /// Compensated gyro bias [rad/s].
    pub b_g: Vector3<f64>,
    /// Compensated accelerometer bias [m/s²].
    pub b_a: Vector3<f64>,
    /// Increments of angle and velocity of the previous sample and its length.
    pub previous: Option<(Vector3<f64>, Vector3<f64>, f64)>,
}

impl Strapdown {
    /// Without biases and without a previous sample.
    pub fn new(q: UnitQuaternion<f64>, v_n: Vector3<f64>, lat: f64, lon: f64, height: f64) -> Self {
        let (b_g, b_a) = (Vector3::zeros(), Vector3::zeros());
        Self {
            q,
            v_n,
            lat,
            lon,
            height,
            b_g,
            b_a,
            previous: None,
        }
    }

    /// Body to n.
    pub fn c_b_n(&self) -> Matrix3<f64> {
        self.q.to_rotation_matrix().into_inner()
    }

    /// One sample: increments of angle [rad] and velocity [m/s], and its length [s].
    /// Returns C_b^n at mid-sample and ∫f_n dt.
    pub fn step(
        &mut self,
        delta_theta: Vector3<f64>,
        delta_v: Vector3<f64>,
        dt: f64,
    ) -> (Matrix3<f64>, Vector3<f64>) {
        let (a, u) = (delta_theta, delta_v);
        let (mut phi, mut w) = (a - self.b_g * dt, u - self.b_a * dt);
        if let Some((a_1, u_1, dt_1)) = self.previous {
            // Rate and force linear over both samples: 1/12 for samples of one length.
            if dt <= 1.5 * dt_1 {
                let k = dt / dt_1 * dt / (dt + dt_1) / 6.0;
                phi += k * a_1.cross(&a);
                w += k * (a_1.cross(&u) + u_1.cross(&a));
            }
        }
        self.previous = Some((a, u, dt));

        let (omega_ie, omega_en) = frame_rates(self.lat, self.height, &self.v_n);
        let zeta = (omega_ie + omega_en) * dt;
        let c_mid = (exp(-0.5 * zeta) * self.q * exp(0.5 * phi))
            .to_rotation_matrix()
            .into_inner();
        self.q = exp(-zeta) * self.q * exp(phi);

        let f_dt = c_mid * w;
        let gain = f_dt - Vector3::z() * (gravity(self.lat, self.height) * dt);
        let dv = gain - (2.0 * omega_ie + omega_en).cross(&(self.v_n + 0.5 * gain)) * dt;
        let v_mean = self.v_n + 0.5 * dv;
        self.v_n += dv;

        let (r_m, r_n) = radii(self.lat);
        let cos_lat = self.lat.cos();
        self.lat += v_mean.y * dt / (r_m + self.height);
        self.lon += v_mean.x * dt / ((r_n + self.height) * cos_lat);
        self.height += v_mean.z * dt;
        (c_mid, f_dt)
    }
}
