//! What the earth and the motion over it contribute to the error model.

use nalgebra::Vector3;

use crate::earth::{normal_gravity, omega_en_n, radii, Local, OMEGA_IE};
use crate::linalg::Real;

/// Earth rate, transport rate, gravity and radii at the place where F is built.
///
/// The error model takes these as an argument instead of asking for the earth itself, so that the filter hands in the
/// values that the mechanization has cached, and a test hands in a paper's sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Environment<T> {
    /// Earth rate ω_ie, east-north-up [rad/s]
    pub omega_ie_n: Vector3<T>,
    /// Transport rate ω_en, east-north-up [rad/s]
    pub omega_en_n: Vector3<T>,
    /// Gravity, positive down [m/s²]
    pub gravity: T,
    /// Radius of the meridian plus height, R_M + h [m]
    pub r_m: T,
    /// Radius of the prime vertical plus height, R_N + h [m]
    pub r_n: T,
    /// Tangent of the latitude
    pub tan_lat: T,
    /// Velocity, east-north-up [m/s]
    pub v_n: Vector3<T>,
}

impl<T: Real> Environment<T> {
    /// WGS-84 at geodetic latitude `lat` [rad] and ellipsoidal height [m], moving with `v_n` [m/s].
    ///
    /// Keep |lat| ≤ 80°: tan L has no bound at the pole. Computed in double precision and rounded once, so it is for
    /// analysis and tests; a filter on a small core uses [`Environment::from_local`].
    pub fn wgs84(lat: f64, height: f64, v_n: Vector3<T>) -> Self {
        let (sin_lat, cos_lat) = (libm::sin(lat), libm::cos(lat));
        let (r_m, r_n) = radii(sin_lat);
        Self::build(
            sin_lat,
            cos_lat,
            r_m + height,
            r_n + height,
            normal_gravity(sin_lat, height),
            OMEGA_IE,
            v_n,
        )
    }

    /// A sphere, as papers use it: latitude [rad], radius [m], gravity [m/s²], earth rate [rad/s], velocity [m/s].
    ///
    /// `radius` counts from the centre to the vehicle. Double precision inside, as [`Environment::wgs84`].
    pub fn sphere(lat: f64, radius: f64, gravity: f64, omega_ie: f64, v_n: Vector3<T>) -> Self {
        Self::build(
            libm::sin(lat),
            libm::cos(lat),
            radius,
            radius,
            gravity,
            omega_ie,
            v_n,
        )
    }

    fn build(
        sin: f64,
        cos: f64,
        r_m: f64,
        r_n: f64,
        gravity: f64,
        omega_ie: f64,
        v_n: Vector3<T>,
    ) -> Self {
        let tan = sin / cos;
        Self {
            omega_ie_n: Vector3::new(0.0, omega_ie * cos, omega_ie * sin).map(T::of),
            omega_en_n: omega_en_n(&v_n.map(T::wide), r_m, r_n, tan).map(T::of),
            gravity: T::of(gravity),
            r_m: T::of(r_m),
            r_n: T::of(r_n),
            tan_lat: T::of(tan),
            v_n,
        }
    }

    /// ω_in = ω_ie + ω_en, rate of the level frame against inertial space [rad/s].
    #[inline(always)]
    pub fn omega_in_n(&self) -> Vector3<T> {
        self.omega_ie_n + self.omega_en_n
    }

    /// 2 ω_ie + ω_en, the rate in the Coriolis term [rad/s].
    #[inline(always)]
    pub fn omega_coriolis_n(&self) -> Vector3<T> {
        self.omega_in_n() + self.omega_ie_n
    }

    /// Change of the computed gravity with a position error, resolved in the level frame at the estimated position:
    /// diagonal of ∂(δg_n)/∂(δr_n) [1/s²], east-north-up.
    ///
    /// ```text
    /// [ −g/(R_N+h),  −g/(R_M+h),  g/(R_M+h) + g/(R_N+h) ]
    /// ```
    ///
    /// The level terms are the turn of the vertical between the two positions; on a sphere the last one is the usual
    /// 2g/R. Left out: the centrifugal part 2ω_ie² < 1.07e-8 /s² of the vertical gradient (0.35 % of it; Bruns'
    /// formula), and ∂g/∂L·1/R ≤ 8.2e-9 /s², which would couple δr_N into the vertical channel.
    #[inline(always)]
    pub fn gravity_gradient(&self) -> Vector3<T> {
        let (m, n) = (self.gravity / self.r_m, self.gravity / self.r_n);
        Vector3::new(-n, -m, m + n)
    }
}

impl Environment<f32> {
    /// From the values that the mechanization keeps of its place, moving with `v_n` [m/s].
    #[inline(always)]
    pub fn from_local(local: &Local, v_n: &Vector3<f32>) -> Self {
        Self {
            omega_ie_n: local.omega_ie_n(),
            omega_en_n: local.omega_en_n(v_n),
            gravity: local.gravity,
            r_m: local.r_m,
            r_n: local.r_n,
            tan_lat: local.tan_lat,
            v_n: *v_n,
        }
    }
}
