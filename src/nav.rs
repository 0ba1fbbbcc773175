//! The nominal state of the navigator: attitude, velocity, position, the biases it compensates, and the memory of the
//! coning and sculling corrections.

use nalgebra::{Matrix3, SVector, Vector3};

use crate::attitude::{c_b_n, normalized, product, rotation_minus_one, Enu, Euler, RfuToEnu};
use crate::earth::{Geodetic, Local};
use crate::error::Error;
use crate::imu::{ConingSculling, ImuIncrement, ImuLimits};
use crate::linalg::{all_finite, each_state, minus, Two};
use crate::mechanization::{admit, Step, Strapdown};

/// Largest gyro bias that is compensated, per axis [rad/s].
pub const MAX_GYRO_BIAS: f32 = 1.0;
/// Largest accelerometer bias that is compensated, per axis [m/s²].
pub const MAX_ACCEL_BIAS: f32 = 50.0;

/// Attitude, velocity, position and compensated biases.
///
/// ```
/// use nalgebra::Vector3;
/// use navsight::{attitude::Euler, earth::Geodetic, imu::ImuIncrement, nav::NavState};
///
/// let start = Geodetic::from_degrees(40.0, 116.0, 100.0);
/// let mut nav = NavState::new(start, Vector3::zeros(), Euler::from_degrees(30.0, 2.0, 1.0))?;
/// let f_b = nav.c_b_n().transpose() * Vector3::new(0.0, 0.0, nav.local().gravity);
/// for _ in 0..100 {
///     nav.advance(&ImuIncrement::from_rates(Vector3::zeros(), f_b, 0.01))?;
/// }
/// // A gyro that does not feel the earth turn makes the level tilt at earth rate: 1 s × 5.6e-5 rad/s.
/// assert!(nav.v_n().norm() < 1e-3);
/// # Ok::<(), navsight::error::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavState {
    strapdown: Strapdown,
    b_g: Vector3<f32>,
    b_a: Vector3<f32>,
    coning: ConingSculling,
}

impl NavState {
    /// Starts at a geodetic position, with a velocity over the ground [m/s] (bare or [`Enu`], or
    /// [`crate::attitude::Ned`]) and an attitude ([`Euler`], [`RfuToEnu`] or [`crate::attitude::FrdToNed`]); the
    /// biases are 0.
    ///
    /// # Errors
    /// [`Error::NonFinite`], [`Error::OutOfRange`], [`Error::Polar`]: see [`Geodetic::check`],
    /// [`crate::mechanization::MAX_SPEED`] and [`crate::attitude::normalized`].
    pub fn new(
        position: Geodetic,
        v_n: impl Into<Enu>,
        attitude: impl Into<RfuToEnu>,
    ) -> Result<Self, Error> {
        position.check()?;
        let place = [position.lat, position.lon, position.height].map(Two::of);
        Self::start(place, &v_n.into().0, attitude.into().0)
    }

    /// Once, for every way to write the arguments down.
    #[inline(never)]
    fn start(place: [Two; 3], v_n: &Vector3<f32>, q: [f32; 4]) -> Result<Self, Error> {
        let [x, y, z] = v_n.data.0[0];
        if !all_finite(&[x, y, z]) {
            return Err(Error::NonFinite);
        }
        let mut nav = Self {
            strapdown: Strapdown::new(place, [x, y, z], normalized(q)?),
            b_g: Vector3::zeros(),
            b_a: Vector3::zeros(),
            coning: ConingSculling::NEW,
        };
        let [lat, lon, height] = place;
        nav.strapdown.lon = admit(&lat, lon, &height, [x, y, z])?;
        Ok(nav)
    }

    /// The same with these bias estimates, gyro [rad/s] and accelerometer [m/s²], body axes.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] beyond [`MAX_GYRO_BIAS`] or [`MAX_ACCEL_BIAS`].
    pub fn with_biases(self, b_g: Vector3<f32>, b_a: Vector3<f32>) -> Result<Self, Error> {
        check_biases(&b_g, &b_a)?;
        Ok(Self { b_g, b_a, ..self })
    }

    /// Moves on by one sample: checks it against [`ImuLimits::DEFAULT`], takes the biases off, corrects coning and
    /// sculling and steps the mechanization.
    ///
    /// # Errors
    /// Those of [`ImuIncrement::check`] and [`Strapdown::step`]. The state is bit-identical after any of them.
    #[inline]
    pub fn advance(&mut self, imu: &ImuIncrement) -> Result<Step, Error> {
        self.advance_within(imu, &ImuLimits::DEFAULT)
    }

    /// As [`NavState::advance`] with limits of one's own.
    ///
    /// # Errors
    /// As [`NavState::advance`].
    #[inline]
    pub fn advance_within(
        &mut self,
        imu: &ImuIncrement,
        limits: &ImuLimits,
    ) -> Result<Step, Error> {
        imu.check(limits)?;
        let motion = self.coning.correct(imu).less_biases(&self.b_g, &self.b_a);
        let step = self.strapdown.step(&motion)?;
        self.coning.remember(imu);
        Ok(step)
    }

    /// Takes an error estimate δx out of the state, in the order and signs of the crate's conventions.
    ///
    /// ```text
    /// L  ← L − δr_N/(R_M+h),   λ ← λ − δr_E/((R_N+h) cos L),   h ← h − δr_U
    /// v  ← exp([δθ×]) (v − δv),        δθ = (−δr_N/(R_M+h), δr_E/(R_N+h), δr_E tan L/(R_N+h))
    /// C  ← exp([(ψ+δθ)×]) C
    /// b_g ← b_g + δb_g,   b_a ← b_a + δb_a
    /// ```
    /// The rotations are proper ones at any angle up to one turn. A δx of nothing but zeros changes nothing.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for an attitude correction of more than one turn or a result
    /// outside what the state accepts; [`Error::Polar`]. The state is bit-identical after any of them.
    pub fn correct(&mut self, dx: &SVector<f32, 15>) -> Result<(), Error> {
        let [dx] = &dx.data.0;
        self.correct_in_units(dx, &[1.0; 15])
    }

    /// [`NavState::correct`] by δx times `unit`, element by element.
    pub(crate) fn correct_in_units(
        &mut self,
        dx: &[f32; 15],
        unit: &[f32; 15],
    ) -> Result<(), Error> {
        let (mut scaled, mut size) = ([0.0; 15], 0.0);
        macro_rules! one {
            ($i:literal) => {
                scaled[$i] = dx[$i] * unit[$i];
                size += scaled[$i] * scaled[$i];
            };
        }
        each_state!(one);
        if size == 0.0 {
            return Ok(());
        }
        if !size.is_finite() && !finite_product(dx, unit) {
            return Err(Error::NonFinite);
        }
        let &[r_e, r_n, r_u, dv_e, dv_n, dv_u, psi_e, psi_n, psi_u, ref biases @ ..] = &scaled;
        let &[bg_x, bg_y, bg_z, ba_x, ba_y, ba_z] = biases;
        // of the last samples: 7 m off at most, which is a millionth
        let (inv_r_m, inv_r_n, tan_lat) = self.strapdown.curvature();
        let east = r_e * inv_r_n;
        let delta_theta = Vector3::new(-r_n * inv_r_m, east, east * tan_lat);
        let phi = Vector3::new(
            psi_e + delta_theta.x,
            psi_n + delta_theta.y,
            psi_u + delta_theta.z,
        );
        // A sum of squares of finite numbers: ∞ at worst, never NaN.
        let phi2 = phi.x * phi.x + phi.y * phi.y + phi.z * phi.z;
        if phi2 > core::f32::consts::TAU * core::f32::consts::TAU {
            return Err(Error::OutOfRange);
        }
        let b_g = Vector3::new(self.b_g.x + bg_x, self.b_g.y + bg_y, self.b_g.z + bg_z);
        let b_a = Vector3::new(self.b_a.x + ba_x, self.b_a.y + ba_y, self.b_a.z + ba_z);
        check_biases(&b_g, &b_a)?;

        let now = &self.strapdown;
        let (mut lat, mut lon, mut height) = (now.lat, now.lon, now.height);
        lat.add(-r_n * inv_r_m);
        lon.add(-r_e * now.inv_parallel());
        height.add(-r_u);
        let [mut v_e, mut v_n, mut v_u] = now.v_n;
        // The turn of v to second order of δθ, which is a milliradian at 6 km.
        let v = Vector3::new(v_e.hi - dv_e, v_n.hi - dv_n, v_u.hi - dv_u);
        let t = delta_theta.cross(&v);
        let t2 = delta_theta.cross(&t);
        v_e.add(t.x + 0.5 * t2.x - dv_e);
        v_n.add(t.y + 0.5 * t2.y - dv_n);
        v_u.add(t.z + 0.5 * t2.z - dv_u);
        let lon = admit(&lat, lon, &height, [v_e.hi, v_n.hi, v_u.hi])?;
        // accepted: from here on nothing can fail
        let s = &mut self.strapdown;
        (s.lat, s.lon, s.height, s.v_n) = (lat, lon, height, [v_e, v_n, v_u]);
        // (exp(φ/2) − 1) ∘ q
        let d = product(&rotation_minus_one(&phi), &s.q.map(|w| w.hi));
        for (q, d) in s.q.iter_mut().zip(d) {
            q.add(d);
        }
        // A turn this small, the bound of the short series, keeps the length to 2e-9, and the mechanization looks after it
        // within five samples.
        if 0.25 * phi2 < 1e-3 {
            s.renew_next();
        } else {
            s.settle();
        }
        (self.b_g, self.b_a) = (b_g, b_a);
        Ok(())
    }

    /// A copy that has been [corrected](NavState::correct), for finite differences and previews. A δx that `correct`
    /// refuses leaves the copy as it was.
    pub fn corrected(&self, dx: &SVector<f32, 15>) -> Self {
        let mut next = *self;
        let _ = next.correct(dx);
        next
    }

    /// Velocity over the ground, east-north-up [m/s].
    pub fn v_n(&self) -> Vector3<f32> {
        let v = &self.strapdown.v_n;
        Vector3::new(v[0].hi, v[1].hi, v[2].hi)
    }

    /// Direction cosine matrix, body to n.
    #[inline]
    pub fn c_b_n(&self) -> Matrix3<f32> {
        c_b_n(self.quaternion())
    }

    /// Unit quaternion (w, x, y, z), body to n.
    pub fn quaternion(&self) -> [f32; 4] {
        self.strapdown.q.map(|w| w.hi)
    }

    /// Heading, pitch and roll.
    pub fn euler(&self) -> Euler {
        Euler::from_c_b_n(&self.c_b_n())
    }

    /// Position in double precision.
    pub fn position(&self) -> Geodetic {
        let s = &self.strapdown;
        Geodetic {
            lat: s.lat.wide(),
            lon: s.lon.wide(),
            height: s.height.wide(),
        }
    }

    /// Geodetic latitude to f32 precision [rad]; for a difference of positions use [`NavState::displacement_to`].
    pub fn lat(&self) -> f32 {
        self.strapdown.lat.hi
    }

    /// Longitude to f32 precision, in [−π, π] [rad].
    pub fn lon(&self) -> f32 {
        self.strapdown.lon.hi
    }

    /// Ellipsoidal height to f32 precision [m].
    pub fn height(&self) -> f32 {
        self.strapdown.height.hi
    }

    /// Compensated gyro bias, body axes [rad/s].
    pub fn b_g(&self) -> Vector3<f32> {
        self.b_g
    }

    /// Compensated accelerometer bias, body axes [m/s²].
    pub fn b_a(&self) -> Vector3<f32> {
        self.b_a
    }

    /// Mean angular rate over the last sample, the bias taken off, body axes [rad/s]; zero before the first sample.
    ///
    /// It belongs to the middle of that sample: with an angular acceleration α it lags by α T/2.
    #[inline]
    pub fn omega_ib_b(&self) -> Vector3<f32> {
        match self.coning.rate() {
            Some(omega) => minus(&omega, &self.b_g),
            None => Vector3::zeros(),
        }
    }

    /// Trigonometry, radii and gravity at the present position.
    pub fn local(&self) -> Local {
        Local::at_words(self.strapdown.lat, self.strapdown.height.hi)
    }

    /// Attitude, velocity and position in two words each.
    pub fn strapdown(&self) -> &Strapdown {
        &self.strapdown
    }

    /// East, north and up displacement from here to another position [m], by the radii of curvature here: the
    /// innovation z − h(x̂) of a position fix, the short way around the earth. Left out: second order, about s² tan L/R of
    /// a displacement s.
    ///
    /// Accuracy: rounding of the displacement to f32, of a longitude to two words, 4e-8 m, and 1e-6 tan L of the
    /// displacement, the radii being those of the last eight samples.
    ///
    /// # Errors
    /// Those of [`Geodetic::check`].
    pub fn displacement_to(&self, there: &Geodetic) -> Result<Vector3<f32>, Error> {
        there.check()?;
        Ok(self.displacement_to_checked(there))
    }

    /// [`NavState::displacement_to`] a position that has been checked.
    #[inline]
    pub(crate) fn displacement_to_checked(&self, there: &Geodetic) -> Vector3<f32> {
        let here = &self.strapdown;
        let (inv_r_m, ..) = here.curvature();
        let mut d_lon = Two::of(there.lon).less(here.lon);
        if d_lon.abs() > core::f32::consts::PI {
            d_lon = short_way(there.lon - here.lon.wide());
        }
        Vector3::new(
            d_lon / here.inv_parallel(),
            Two::of(there.lat).less(here.lat) / inv_r_m,
            Two::of(there.height).less(here.height),
        )
    }
}

/// A difference of two longitudes within ±2π, as an angle within ±π.
#[cold]
fn short_way(mut d: f64) -> f32 {
    const TURN: f64 = core::f64::consts::TAU;
    for _ in 0..2 {
        if d.abs() > 0.5 * TURN {
            d -= if d > 0.0 { TURN } else { -TURN };
        }
    }
    d as f32
}

fn check_biases(b_g: &Vector3<f32>, b_a: &Vector3<f32>) -> Result<(), Error> {
    // at a glance; written as what is good: a NaN fails
    let sum = |b: &Vector3<f32>| b.x.abs() + b.y.abs() + b.z.abs();
    if sum(b_g) <= MAX_GYRO_BIAS && sum(b_a) <= MAX_ACCEL_BIAS {
        return Ok(());
    }
    look_at_biases(b_g, b_a)
}

/// One axis after the other.
#[cold]
#[inline(never)]
fn look_at_biases(b_g: &Vector3<f32>, b_a: &Vector3<f32>) -> Result<(), Error> {
    if !all_finite(b_g.as_slice()) || !all_finite(b_a.as_slice()) {
        Err(Error::NonFinite)
    } else if b_g.amax() <= MAX_GYRO_BIAS && b_a.amax() <= MAX_ACCEL_BIAS {
        Ok(())
    } else {
        Err(Error::OutOfRange)
    }
}

/// Whether all products, element by element, are finite.
#[cold]
#[inline(never)]
fn finite_product(x: &[f32], y: &[f32]) -> bool {
    x.iter().zip(y).all(|(x, y)| (x * y).is_finite())
}
