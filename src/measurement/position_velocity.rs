//! Position and velocity of one epoch of a satellite receiver, in one update.

use nalgebra::SVector;

use super::{Antenna, AntennaRows, Linearized, Position, Velocity};
use crate::nav::NavState;

/// A fix: position and velocity of the same antenna at the same time, six rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionVelocity {
    position: Position,
    velocity: Velocity,
    antenna: Antenna,
}

impl PositionVelocity {
    /// Both halves of one epoch, as measurements of this antenna. The interval is that of the position.
    pub fn new(position: Position, velocity: Velocity, antenna: Antenna) -> Self {
        Self {
            position: position.of(antenna),
            velocity: velocity.of(antenna),
            antenna,
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
    pub fn linearize(&self, nav: &NavState) -> Linearized<6, AntennaRows> {
        let c_b_n = nav.c_b_n();
        let offset = self.antenna.offset(&c_b_n);
        let motion = self.antenna.motion(nav, &c_b_n);
        let nu_r = self.position.innovation_at(nav, &offset);
        let nu_v = self.velocity.innovation_at(nav, &motion);
        let (of_r, of_v) = (self.position.accuracy(), self.velocity.accuracy());
        let (r, v) = (of_r.variances(), of_v.variances());
        let lower = [of_r.lower(), of_v.lower()];
        Linearized {
            nu: SVector::from([nu_r.x, nu_r.y, nu_r.z, nu_v.x, nu_v.y, nu_v.z]),
            h: self.antenna.rows(&offset, &motion, &c_b_n, lower),
            r: SVector::from([r.x, r.y, r.z, v.x, v.y, v.z]),
            interval: self.position.interval(),
        }
    }
}
