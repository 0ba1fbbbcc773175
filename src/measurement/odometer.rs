//! Wheels: speed along the vehicle, and that it moves neither sideways nor off the ground.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::{check_interval, variances, Antenna, Boresight, Jacobian, Linearized};
use crate::error::Error;
use crate::error_model::{ATT, BG, N, VEL};
use crate::linalg::skew;
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
    pub fn linearize(&self, nav: &NavState) -> Linearized<3> {
        let (v_m, h) = self.mount.rows(nav);
        Linearized {
            nu: Vector3::new(0.0, self.speed, 0.0) - v_m,
            h: Jacobian::Dense(h),
            r: self.r,
            interval: self.interval,
        }
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
    pub fn linearize(&self, nav: &NavState) -> Linearized<2> {
        let (v_m, full) = self.mount.rows(nav);
        let mut h = SMatrix::<f32, 2, N>::zeros();
        h.fixed_view_mut::<1, N>(0, 0)
            .copy_from(&full.fixed_view::<1, N>(0, 0));
        h.fixed_view_mut::<1, N>(1, 0)
            .copy_from(&full.fixed_view::<1, N>(2, 0));
        Linearized {
            nu: SVector::from([-v_m.x, -v_m.z]),
            h: Jacobian::Dense(h),
            r: SVector::from([self.r.x, self.r.z]),
            interval: self.interval,
        }
    }
}

impl Mount {
    fn new(wheel: Antenna, boresight: &Boresight) -> Self {
        Self {
            wheel,
            c_b_m: boresight.c_m_b().transpose(),
        }
    }

    /// Velocity of the wheel in vehicle axes, and the rows of all three components.
    fn rows(&self, nav: &NavState) -> (Vector3<f32>, SMatrix<f32, 3, N>) {
        let (v_n, l) = (nav.v_n(), self.wheel.lever_arm());
        let c_n_m = self.c_b_m * nav.c_b_n().transpose();
        let v_m = c_n_m * v_n + self.c_b_m * nav.omega_ib_b().cross(&l);
        let mut h = SMatrix::<f32, 3, N>::zeros();
        h.fixed_view_mut::<3, 3>(0, VEL).copy_from(&-c_n_m);
        h.fixed_view_mut::<3, 3>(0, ATT)
            .copy_from(&(c_n_m * skew(&v_n)));
        h.fixed_view_mut::<3, 3>(0, BG)
            .copy_from(&(self.c_b_m * skew(&l)));
        (v_m, h)
    }
}
