//! WGS-84: radii of curvature, normal gravity, earth rate and transport rate, and the local values that the
//! mechanization needs at every sample.
//!
//! Geodetic positions enter and leave as doubles ([`Geodetic`]); f32 radians alone would be 0.4 m apart.

use nalgebra::Vector3;

use crate::error::Error;
use crate::linalg::{Real, Two};

/// Semi-major axis a [m].
pub const A: f64 = 6_378_137.0;
/// Flattening f [-].
pub const F: f64 = 1.0 / 298.257_223_563;
/// First eccentricity squared e² = f(2 − f) [-].
pub const E2: f64 = F * (2.0 - F);
/// Earth rate ω_ie [rad/s].
pub const OMEGA_IE: f64 = 7.292_115e-5;
/// Gravitational constant times the mass of the earth, GM [m³/s²].
pub const GM: f64 = 3.986_004_418e14;
/// Normal gravity at the equator on the ellipsoid, γ_e [m/s²].
pub const GAMMA_E: f64 = 9.780_325_335_9;
/// Somigliana's constant k = (b γ_p)/(a γ_e) − 1 [-].
pub const K_SOMIGLIANA: f64 = 0.001_931_852_652_41;
/// m = ω²a²b/GM: centrifugal against gravitational acceleration at the equator [-].
pub const M_CENTRIFUGAL: f64 = OMEGA_IE * OMEGA_IE * A * A * A * (1.0 - F) / GM;

/// Largest |latitude| of the navigator, 80° [rad]: a north-slaved local level frame turns without bound at the poles.
pub const MAX_LATITUDE: f32 = 1.396_263_4;
/// Lowest ellipsoidal height that is accepted [m].
pub const MIN_HEIGHT: f32 = -20_000.0;
/// Largest ellipsoidal height that is accepted [m]. The second-order height term of [`normal_gravity`] is within
/// 2e-5 of the closed form there.
pub const MAX_HEIGHT: f32 = 100_000.0;

/// A geodetic position on WGS-84.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Geodetic {
    /// Geodetic latitude, north positive [rad].
    pub lat: f64,
    /// Longitude, east positive [rad].
    pub lon: f64,
    /// Height above the ellipsoid [m].
    pub height: f64,
}

impl Geodetic {
    /// From degrees and metres.
    pub fn from_degrees(lat_deg: f64, lon_deg: f64, height: f64) -> Self {
        const RAD: f64 = core::f64::consts::PI / 180.0;
        Self {
            lat: lat_deg * RAD,
            lon: lon_deg * RAD,
            height,
        }
    }

    /// Latitude and longitude in degrees, height in metres.
    pub fn to_degrees(&self) -> (f64, f64, f64) {
        const DEG: f64 = 180.0 / core::f64::consts::PI;
        (self.lat * DEG, self.lon * DEG, self.height)
    }

    /// Checks that a navigator can start here.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::Polar`] beyond [`MAX_LATITUDE`]; [`Error::OutOfRange`] for a longitude beyond
    /// ±2π or a height outside [`MIN_HEIGHT`]..[`MAX_HEIGHT`].
    pub fn check(&self) -> Result<(), Error> {
        if !(self.lat.is_finite() && self.lon.is_finite() && self.height.is_finite()) {
            return Err(Error::NonFinite);
        }
        if self.lat.abs() > f64::from(MAX_LATITUDE) {
            return Err(Error::Polar);
        }
        let height = f64::from(MIN_HEIGHT)..=f64::from(MAX_HEIGHT);
        if self.lon.abs() > core::f64::consts::TAU || !height.contains(&self.height) {
            return Err(Error::OutOfRange);
        }
        Ok(())
    }
}

/// Radii of curvature in the meridian and in the prime vertical, (R_M, R_N) [m].
///
/// ```text
/// R_N = a/√(1 − e² sin²L),   R_M = R_N (1 − e²)/(1 − e² sin²L)
/// ```
/// Source: Groves 2013, (2.105) and (2.106).
pub fn radii<T: Real>(sin_lat: T) -> (T, T) {
    let d = T::one() - T::of(E2) * sin_lat * sin_lat;
    let r_n = T::of(A) / d.root();
    (r_n * T::of(1.0 - E2) / d, r_n)
}

/// Normal gravity along the ellipsoid normal, positive down [m/s²].
///
/// ```text
/// γ0 = γ_e (1 + k sin²L)/√(1 − e² sin²L)                                   Somigliana
/// γ  = γ0 [1 − 2/a (1 + f + m − 2f sin²L) h + 3 h²/a²],   m = ω²a²b/GM
/// ```
/// * `h` — ellipsoidal height [m]
///
/// The small component towards the equator that grows with height, 8.1e-9 /s² · h sin 2L, is left out.
/// Source: Groves 2013, (2.134) and (2.139).
pub fn normal_gravity<T: Real>(sin_lat: T, h: T) -> T {
    let s2 = sin_lat * sin_lat;
    let root = (T::one() - T::of(E2) * s2).root();
    let gamma_0 = T::of(GAMMA_E) * (T::one() + T::of(K_SOMIGLIANA) * s2) / root;
    let x = h * T::of(1.0 / A);
    gamma_0 * (T::one() - x * (T::of(HEIGHT_1) - T::of(HEIGHT_2) * s2 - T::of(3.0) * x))
}

/// 2(1 + f + m): relative decrease of gravity per h/a at the equator.
const HEIGHT_1: f64 = 2.0 * (1.0 + F + M_CENTRIFUGAL);
/// 4f: how much less it is per sin²L.
const HEIGHT_2: f64 = 4.0 * F;

/// Earth rate in n, ω_ie^n = Ω [0, cos L, sin L] [rad/s].
pub fn omega_ie_n<T: Real>(sin_lat: T, cos_lat: T) -> Vector3<T> {
    Vector3::new(
        T::zero(),
        T::of(OMEGA_IE) * cos_lat,
        T::of(OMEGA_IE) * sin_lat,
    )
}

/// Transport rate ω_en resolved in n: how fast the local-level frame turns because the vehicle moves over a curved
/// earth.
///
/// ```text
/// ω_en^n = [ −v_N/(R_M+h),  v_E/(R_N+h),  v_E·tan L/(R_N+h) ]ᵀ        [rad/s]
/// ```
/// * `v_n` — velocity, east-north-up [m/s]
/// * `r_m`, `r_n` — R_M + h and R_N + h [m]
///
/// Source: Groves 2013, (5.44), axes re-ordered to east-north-up.
pub fn omega_en_n<T: Real>(v_n: &Vector3<T>, r_m: T, r_n: T, tan_lat: T) -> Vector3<T> {
    let omega_n = v_n.x / r_n;
    Vector3::new(-v_n.y / r_m, omega_n, omega_n * tan_lat)
}

/// What the local level frame knows about its place: trigonometry of the latitude, radii, gravity.
///
/// Computed from a table of sines at every 1/16 rad, compiled in, without a call to libm, a root or a loop: some ninety
/// instructions, cheap enough to be asked for whenever it is needed. The mechanization renews its copy at every eighth
/// sample.
///
/// Against f64 for |L| ≤ 80°, [`MIN_HEIGHT`] ≤ h ≤ [`MAX_HEIGHT`]: sine and cosine within 6e-8, tangent, radii, their
/// inverses and gravity within 4e-7 of their value (`host-tests/tests/earth.rs`).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Local {
    /// sin L [-].
    pub sin_lat: f32,
    /// cos L [-].
    pub cos_lat: f32,
    /// tan L [-].
    pub tan_lat: f32,
    /// 1/cos L [-].
    pub inv_cos_lat: f32,
    /// R_M + h [m].
    pub r_m: f32,
    /// R_N + h [m].
    pub r_n: f32,
    /// 1/(R_M + h) [1/m].
    pub inv_r_m: f32,
    /// 1/(R_N + h) [1/m].
    pub inv_r_n: f32,
    /// Normal gravity, positive down [m/s²].
    pub gravity: f32,
}

impl Local {
    /// At a latitude [rad], |L| ≤ [`MAX_LATITUDE`], and an ellipsoidal height [m].
    pub fn at(lat: f32, height: f32) -> Self {
        Self::at_words(Two { hi: lat, lo: 0.0 }, height)
    }

    /// At a latitude held in two words.
    #[inline(never)]
    pub fn at_words(lat: Two, height: f32) -> Self {
        let (sin_lat, cos_lat) = sin_cos(lat);
        let s2 = sin_lat * sin_lat;
        // 1/√(1 − x) with x = e² sin²L ≤ 0.0067: the next term of the series is below 6e-10.
        let x = E2 as f32 * s2;
        let inv_root = 1.0 + x * (0.5 + x * (0.375 + x * 0.3125));
        let r_n0 = A as f32 * inv_root;
        let r_m = r_n0 * (inv_root * inv_root) * (1.0 - E2) as f32 + height;
        let r_n = r_n0 + height;
        let y = height * (1.0 / A) as f32;
        let gamma_0 = (GAMMA_E as f32 + (GAMMA_E * K_SOMIGLIANA) as f32 * s2) * inv_root;
        let gravity = gamma_0 - gamma_0 * (y * (HEIGHT_1 as f32 - HEIGHT_2 as f32 * s2 - 3.0 * y));
        let inv_cos_lat = 1.0 / cos_lat;
        Self {
            sin_lat,
            cos_lat,
            tan_lat: sin_lat * inv_cos_lat,
            inv_cos_lat,
            r_m,
            r_n,
            inv_r_m: 1.0 / r_m,
            inv_r_n: 1.0 / r_n,
            gravity,
        }
    }

    /// Earth rate in n [rad/s].
    pub fn omega_ie_n(&self) -> Vector3<f32> {
        omega_ie_n(self.sin_lat, self.cos_lat)
    }

    /// Transport rate in n at velocity `v_n` [rad/s].
    pub fn omega_en_n(&self, v_n: &Vector3<f32>) -> Vector3<f32> {
        let omega_n = v_n.x * self.inv_r_n;
        Vector3::new(-v_n.y * self.inv_r_m, omega_n, omega_n * self.tan_lat)
    }
}

/// Nodes of the table per radian.
const NODES_PER_RAD: f32 = 16.0;
/// Nodes on either side of the equator; the last one is at 82.4°.
const SIDE: usize = 23;
/// (sin, cos) at k/16 rad, k = −23..=23.
static TRIG: [(f32, f32); 2 * SIDE + 1] = trig_table();

const fn trig_table() -> [(f32, f32); 2 * SIDE + 1] {
    let mut table = [(0.0, 1.0); 2 * SIDE + 1];
    let mut k = 0;
    while k <= SIDE {
        // Taylor series in double: below 1e-17 after 30 terms for arguments up to 1.44.
        let x = k as f64 / NODES_PER_RAD as f64;
        let (mut sin, mut cos, mut term, mut i) = (0.0, 1.0, 1.0, 1);
        while i < 30 {
            term *= x / i as f64;
            match i % 4 {
                0 => cos += term,
                1 => sin += term,
                2 => cos -= term,
                _ => sin -= term,
            }
            i += 1;
        }
        table[SIDE + k] = (sin as f32, cos as f32);
        table[SIDE - k] = (-sin as f32, cos as f32);
        k += 1;
    }
    table
}

/// Sine and cosine of a latitude: nearest node and a short series around it, at most 1/32 rad long.
///
/// Beyond the last node the series goes on from there: at 90° it is wrong by 2e-6 in the cosine, and it never panics.
#[inline(always)]
fn sin_cos(lat: Two) -> (f32, f32) {
    // Casts saturate, NaN gives node 0 and stays NaN in the distance below.
    let k = ((lat.hi * NODES_PER_RAD + (SIDE as f32 + 0.5)) as usize).min(2 * SIDE);
    let (sin_0, cos_0) = *TRIG.get(k).unwrap_or(&(0.0, 1.0));
    let d = (lat.hi - (k as f32 - SIDE as f32) * (1.0 / NODES_PER_RAD)) + lat.lo;
    let d2 = d * d;
    let sin_d = d - d * d2 * (1.0 / 6.0 - d2 * (1.0 / 120.0));
    let versine_d = d2 * (0.5 - d2 * (1.0 / 24.0));
    (
        sin_0 + (cos_0 * sin_d - sin_0 * versine_d),
        cos_0 - (sin_0 * sin_d + cos_0 * versine_d),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gravity at the pole on the ellipsoid, NIMA TR8350.2: 9.8321849378 m/s²; at the equator γ_e by definition.
    #[test]
    fn gravity_at_equator_and_pole() {
        assert!((normal_gravity(0.0_f64, 0.0) - GAMMA_E).abs() < 1e-12);
        assert!((normal_gravity(1.0_f64, 0.0) - 9.832_184_937_8).abs() < 1e-9);
    }

    #[test]
    fn impossible_arguments_do_not_panic() {
        for lat in [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            1e30,
            -1e30,
            1.57,
            -1.57,
        ] {
            for h in [f32::NAN, f32::INFINITY, -6.4e6, 0.0] {
                let _ = Local::at(lat, h);
            }
        }
    }
}
