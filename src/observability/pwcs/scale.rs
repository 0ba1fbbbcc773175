//! Canonical units: numbers near 1 whatever the units of a model are.

use nalgebra::SVector;

use super::MOST;
use crate::error::Error;
use crate::linalg::Real;

/// What a state is, for its canonical unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Kind {
    /// Position [m]
    Position,
    /// Velocity [m/s]
    Velocity,
    /// Attitude [rad]
    Attitude,
    /// Gyro bias [rad/s]
    GyroBias,
    /// Accelerometer bias [m/s²]
    AccelBias,
    /// Anything else, taken as it is.
    Other,
}

impl Kind {
    /// The unit in which one radian of tilt acts with entries near 1 on everything: gτ², gτ, 1, 1/τ, g.
    pub fn unit<T: Real>(self, time: T, gravity: T) -> T {
        match self {
            Kind::Position => gravity * time * time,
            Kind::Velocity => gravity * time,
            Kind::Attitude | Kind::Other => T::one(),
            Kind::GyroBias => T::one() / time,
            Kind::AccelBias => gravity,
        }
    }
}

/// The 15 states of the filter, in their order.
pub const NAVIGATION: [Kind; 15] = [
    Kind::Position,
    Kind::Position,
    Kind::Position,
    Kind::Velocity,
    Kind::Velocity,
    Kind::Velocity,
    Kind::Attitude,
    Kind::Attitude,
    Kind::Attitude,
    Kind::GyroBias,
    Kind::GyroBias,
    Kind::GyroBias,
    Kind::AccelBias,
    Kind::AccelBias,
    Kind::AccelBias,
];

/// Canonical units and how small is nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale<T, const N: usize> {
    /// Unit of time τ [s].
    pub time: T,
    /// Unit of each state.
    pub unit: [T; N],
    /// Prior standard deviation of each state, in its own unit; decides which state stands for a row.
    pub sigma: [T; N],
    /// A row of which less than this part is new is dependent.
    pub tolerance: T,
}

impl<T: Real, const N: usize> Scale<T, N> {
    /// τ = 300 s, tolerance 1e-4, gravity [m/s²], for states of these kinds.
    ///
    /// With these the full 15-state model has f32 ranks that are right with a margin of more than 100 on both sides
    /// (`host-tests/tests/pwcs.rs`); 1/ω_ie as unit of time fails in f32.
    pub fn canonical(kinds: &[Kind; N], sigma: &SVector<T, N>, gravity: T) -> Self {
        let time = T::of(300.0);
        let mut scale = Self {
            time,
            unit: [T::one(); N],
            sigma: [T::one(); N],
            tolerance: T::of(1e-4),
        };
        for ((unit, weight), (kind, s)) in scale
            .unit
            .iter_mut()
            .zip(&mut scale.sigma)
            .zip(kinds.iter().zip(sigma.iter()))
        {
            *unit = kind.unit(time, gravity);
            *weight = *s;
        }
        scale
    }

    /// Numbers as they are (unit of time 1 s, units and priors 1), dependent below this tolerance.
    pub fn plain(tolerance: T) -> Self {
        Self {
            time: T::one(),
            unit: [T::one(); N],
            sigma: [T::one(); N],
            tolerance,
        }
    }

    pub(super) fn check(&self) -> Result<(), Error> {
        let mut good = self.time > T::zero() && self.tolerance > T::zero();
        let mut finite = self.time.finite() && self.tolerance.finite();
        for (unit, sigma) in self.unit.iter().zip(&self.sigma) {
            good &= *unit > T::zero() && *sigma > T::zero();
            finite &= unit.finite() && sigma.finite();
        }
        match (finite, good && N > 0 && N <= MOST) {
            (false, _) => Err(Error::NonFinite),
            (true, false) => Err(Error::OutOfRange),
            (true, true) => Ok(()),
        }
    }
}
