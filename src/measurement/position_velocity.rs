//! Position and velocity of one epoch of a satellite receiver, in one update.

use nalgebra::{SMatrix, SVector};

use super::{Antenna, Jacobian, Linearized, Position, Velocity};
use crate::error_model::N;
use crate::nav::NavState;

/// A fix: position and velocity of the same antenna at the same time, six rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionVelocity {
    position: Position,
    velocity: Velocity,
}

impl PositionVelocity {
    /// Both halves of one epoch, as measurements of this antenna. The interval is that of the position.
    pub fn new(position: Position, velocity: Velocity, antenna: Antenna) -> Self {
        Self {
            position: position.of(antenna),
            velocity: velocity.of(antenna),
        }
    }

    /// Nominal interval between two such updates [s], zero or below when unknown.
    pub fn interval(&self) -> f32 {
        self.position.interval()
    }

    /// Position half.
    pub fn position(&self) -> &Position {
        &self.position
    }

    /// Velocity half.
    pub fn velocity(&self) -> &Velocity {
        &self.velocity
    }

    /// The rows of [`Position::linearize`], then those of [`Velocity::linearize`]. One report, one ξ1.
    pub fn linearize(&self, nav: &NavState) -> Linearized<6> {
        let c_b_n = nav.c_b_n();
        let mut h = SMatrix::<f32, 6, N>::zeros();
        let nu_r = self.position.innovation::<6, 0>(nav, &c_b_n, &mut h);
        let nu_v = self.velocity.innovation::<6, 3>(nav, &c_b_n, &mut h);
        let (r, v) = (
            self.position.accuracy().variances(),
            self.velocity.accuracy().variances(),
        );
        Linearized {
            nu: SVector::from([nu_r.x, nu_r.y, nu_r.z, nu_v.x, nu_v.y, nu_v.z]),
            h: Jacobian::Dense(h),
            r: SVector::from([r.x, r.y, r.z, v.x, v.y, v.z]),
            interval: self.position.interval(),
        }
    }
}
