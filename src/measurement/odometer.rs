//! Wheels: speed along the vehicle, and that it moves neither sideways nor off the ground.

use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};

use super::rows::set;
use super::{check_interval, variances, Antenna, Boresight, Linearized};
use crate::error::Error;
use crate::error_model::{ATT, BG, N, VEL};
use crate::linalg::{cross, dot, rows, transformed};
use crate::mechanization::MAX_SPEED;
use crate::nav::NavState;

/// Speed of a wheel that neither slides nor jumps, in the vehicle's own axes: z = (0, speed, 0) + noise.
///
/// ```text
/// h(x̂) = B (Ĉᵀ v̂ + ω̂ × l),     rows: −B Ĉᵀ on δv,  B Ĉᵀ [v̂×] on ψ,  B [l×] on b_g
/// ```
/// B takes body axes to vehicle axes, l is where the wheel (the axle that is not steered) touches the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odometer {
    speed: f32,
    mount: Mount,
    r: SVector<f32, 3>,
    interval: f32,
}

/// The non-holonomic constraint by itself: a vehicle on wheels moves neither sideways nor upwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonHolonomic {
    mount: Mount,
    r: SVector<f32, 3>,
    interval: f32,
}

/// Axes of the vehicle.
const RIGHT: usize = 0;
const FORWARD: usize = 1;
const UP: usize = 2;

/// Where the wheel is and how the vehicle stands.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Mount {
    wheel: Antenna,
    c_b_m: Matrix3<f32>,
}

impl Odometer {
    /// Speed along the vehicle [m/s], negative backwards; where the wheel is; how the vehicle stands to the IMU; 1σ to
    /// the right (side slip), along, and up [m/s]; and the nominal interval between two such updates [s] (zero:
    /// unknown).
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] beyond [`MAX_SPEED`]; and those of
    /// [`variance`](super::variance).
    pub fn new(
        speed: f32,
        wheel: Antenna,
        boresight: Boresight,
        sigma_m: Vector3<f32>,
        interval: f32,
    ) -> Result<Self, Error> {
        if !speed.is_finite() {
            return Err(Error::NonFinite);
        }
        if speed.abs() > MAX_SPEED {
            return Err(Error::OutOfRange);
        }
        Ok(Self {
            speed,
            mount: Mount::new(wheel, &boresight),
            r: variances(&sigma_m)?,
            interval: check_interval(interval)?,
        })
    }

    /// Nominal interval between two such updates [s], zero or below when unknown.
    pub fn interval(&self) -> f32 {
        self.interval
    }

    /// Rows right, forward, up.
    pub fn linearize(&self, nav: &NavState) -> Linearized<3, SMatrix<f32, 3, N>> {
        let mut measurement = Linearized {
            nu: Vector3::new(0.0, self.speed, 0.0),
            h: SMatrix::zeros(),
            r: self.r,
            interval: self.interval,
        };
        let wheel = self.mount.at(nav);
        let (nu, h) = (&mut measurement.nu, &mut measurement.h);
        nu.x -= wheel.row::<RIGHT, 0, 3>(h);
        nu.y -= wheel.row::<FORWARD, 1, 3>(h);
        nu.z -= wheel.row::<UP, 2, 3>(h);
        measurement
    }
}

impl NonHolonomic {
    /// Where the axle is that is not steered; how the vehicle stands to the IMU; 1σ to the right and up [m/s]; and the
    /// nominal interval between two such updates [s] (zero: unknown).
    ///
    /// # Errors
    /// Those of [`variance`](super::variance) and [`check_interval`].
    pub fn new(
        wheel: Antenna,
        boresight: Boresight,
        sigma_right: f32,
        sigma_up: f32,
        interval: f32,
    ) -> Result<Self, Error> {
        Ok(Self {
            mount: Mount::new(wheel, &boresight),
            r: variances(&Vector3::new(sigma_right, 1.0, sigma_up))?,
            interval: check_interval(interval)?,
        })
    }

    /// Nominal interval between two such updates [s], zero or below when unknown.
    pub fn interval(&self) -> f32 {
        self.interval
    }

    /// Rows right and up.
    pub fn linearize(&self, nav: &NavState) -> Linearized<2, SMatrix<f32, 2, N>> {
        let mut measurement = Linearized {
            nu: Vector2::zeros(),
            h: SMatrix::zeros(),
            r: Vector2::new(self.r.x, self.r.z),
            interval: self.interval,
        };
        let wheel = self.mount.at(nav);
        let (nu, h) = (&mut measurement.nu, &mut measurement.h);
        nu.x = -wheel.row::<RIGHT, 0, 2>(h);
        nu.y = -wheel.row::<UP, 1, 2>(h);
        measurement
    }
}

impl Mount {
    fn new(wheel: Antenna, boresight: &Boresight) -> Self {
        Self {
            wheel,
            c_b_m: boresight.c_m_b().transpose(),
        }
    }

    /// What all rows need.
    #[inline(always)]
    fn at<'a>(&'a self, nav: &NavState) -> Wheel<'a> {
        let l = self.wheel.lever_arm();
        Wheel {
            mount: self,
            l,
            v_n: nav.v_n(),
            c_b_n: nav.c_b_n(),
            motion: cross(&nav.omega_ib_b(), &l),
        }
    }
}

/// A wheel in motion.
struct Wheel<'a> {
    mount: &'a Mount,
    l: Vector3<f32>,
    v_n: Vector3<f32>,
    c_b_n: Matrix3<f32>,
    /// ω̂ × l
    motion: Vector3<f32>,
}

impl Wheel<'_> {
    /// The elements of one vehicle axis, and the velocity of the wheel along it.
    #[inline(always)]
    fn row<const AXIS: usize, const ROW: usize, const M: usize>(
        &self,
        h: &mut SMatrix<f32, M, N>,
    ) -> f32 {
        let b = rows(&self.mount.c_b_m)[AXIS];
        let along = transformed(&self.c_b_n, &b); // this axis in the level frame
        set::<ROW, VEL, M>(h, &Vector3::new(-along.x, -along.y, -along.z));
        set::<ROW, ATT, M>(h, &cross(&along, &self.v_n));
        set::<ROW, BG, M>(h, &cross(&b, &self.l));
        dot(&along, &self.v_n) + dot(&b, &self.motion)
    }
}
