//! A measured geodetic position, as satellite receivers give it.

use nalgebra::{SMatrix, Vector3};

use super::accuracy::decorrelate_rows;
use super::{check_interval, Accuracy, Antenna, Jacobian, Linearized};
use crate::earth::Geodetic;
use crate::error::Error;
use crate::error_model::{N, POS};
use crate::linalg::minus;
use crate::nav::NavState;

/// Geodetic position of the IMU or of an antenna: z = (L, λ, h) + noise, compared in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    z: Geodetic,
    accuracy: Accuracy,
    antenna: Antenna,
    interval: f32,
}

impl Position {
    /// Position on WGS-84, 1σ east, north, up [m], and the nominal interval between two such updates [s] (zero:
    /// unknown).
    ///
    /// # Errors
    /// Those of [`Geodetic::check`] and [`variance`](super::variance).
    pub fn new(z: Geodetic, sigma_n: Vector3<f32>, interval: f32) -> Result<Self, Error> {
        Self::with_accuracy(z, Accuracy::per_axis(sigma_n)?, interval)
    }

    /// As [`Position::new`] with the accuracy that came with this fix [m].
    ///
    /// # Errors
    /// Those of [`Geodetic::check`]; [`Error::NonFinite`] for the interval.
    pub fn with_accuracy(z: Geodetic, accuracy: Accuracy, interval: f32) -> Result<Self, Error> {
        z.check()?;
        Ok(Self {
            z,
            accuracy,
            antenna: Antenna::AT_IMU,
            interval: check_interval(interval)?,
        })
    }

    /// The same as the position of this antenna.
    #[must_use]
    pub fn of(self, antenna: Antenna) -> Self {
        Self { antenna, ..self }
    }

    /// Nominal interval between two such updates [s], zero or below when unknown.
    pub fn interval(&self) -> f32 {
        self.interval
    }

    /// How good it is.
    pub fn accuracy(&self) -> &Accuracy {
        &self.accuracy
    }

    /// ν = ((λ_z − λ̂)(R_N+h) cos L, (L_z − L̂)(R_M+h), h_z − ĥ) − Ĉ l [m], rows −1 on δr and [`Antenna`]'s on ψ.
    ///
    /// The differences are taken before anything is rounded to f32 ([`NavState::displacement_to`]). Left out: second
    /// order, |ν|² tan L/R (1e-3 m for 80 m at 45°).
    pub fn linearize(&self, nav: &NavState) -> Linearized<3> {
        let r = self.accuracy.variances();
        if self.antenna.is_at_imu() && self.accuracy.is_diagonal() {
            return Linearized {
                nu: self.displacement(nav),
                h: Jacobian::Direct { first: POS }, // δr is estimate minus truth
                r,
                interval: self.interval,
            };
        }
        let offset = self.antenna.offset(&nav.c_b_n());
        let mut h = SMatrix::<f32, 3, N>::zeros();
        Antenna::position_rows::<3, 0>(&offset, &mut h);
        decorrelate_rows::<3, 0>(&self.accuracy.lower(), &mut h);
        Linearized {
            nu: self.innovation_at(nav, &offset),
            h: Jacobian::Dense(h),
            r,
            interval: self.interval,
        }
    }

    /// The first two rows: a fix whose height is not used.
    pub fn linearize_horizontal(&self, nav: &NavState) -> Linearized<2> {
        self.linearize(nav).horizontal()
    }

    /// The innovation with the antenna at `offset`, the correlations taken out.
    #[inline(always)]
    pub(super) fn innovation_at(&self, nav: &NavState, offset: &Vector3<f32>) -> Vector3<f32> {
        self.accuracy
            .decorrelated(&minus(&self.displacement(nav), offset))
    }

    /// `new` has checked z.
    fn displacement(&self, nav: &NavState) -> Vector3<f32> {
        nav.displacement_to_checked(&self.z)
    }
}
