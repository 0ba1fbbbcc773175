//! Standing in one position after another, turned in between.

use nalgebra::Vector3;
use navsight::earth::Geodetic;

use super::{Pose, Trajectory, DEG};

/// One position of a standing vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// Heading clockwise from north, pitch, roll [rad].
    pub euler: Vector3<f64>,
    /// How long [s].
    pub seconds: f64,
}

impl Position {
    /// Attitude in degrees.
    pub fn degrees(heading: f64, pitch: f64, roll: f64, seconds: f64) -> Self {
        Self {
            euler: Vector3::new(heading, pitch, roll) * DEG,
            seconds,
        }
    }
}

/// Positions with turns between them, each turn at constant rates of the three angles. The turn goes by the difference
/// of the angles as they are written: from 350° to 10° is a turn of −340°.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// Where.
    pub at: Geodetic,
    /// At least one.
    pub positions: Vec<Position>,
    /// Length of every turn [s].
    pub turn: f64,
}

impl Schedule {
    /// When each position begins and ends [s].
    pub fn spans(&self) -> Vec<(f64, f64)> {
        let mut begin = 0.0;
        self.positions
            .iter()
            .map(|p| {
                let span = (begin, begin + p.seconds);
                begin = span.1 + self.turn;
                span
            })
            .collect()
    }

    /// From the first sample to the last [s].
    pub fn seconds(&self) -> f64 {
        self.spans().last().map_or(0.0, |span| span.1)
    }
}

impl Trajectory for &Schedule {
    fn start(&self) -> Geodetic {
        self.at
    }
    fn pose(&self, t: f64) -> Pose {
        let o = Vector3::zeros();
        let standing = |euler| Pose {
            euler,
            euler_rate: o,
            v_n: o,
            a_n: o,
        };
        let mut begin = 0.0;
        let mut before: Option<Vector3<f64>> = None;
        for p in &self.positions {
            if let Some(from) = before {
                // The nodes of an integration never fall on the corners when the samples do.
                if t < begin {
                    let part = 1.0 - (begin - t) / self.turn;
                    return Pose {
                        euler_rate: (p.euler - from) / self.turn,
                        ..standing(from + (p.euler - from) * part)
                    };
                }
            }
            if t <= begin + p.seconds {
                return standing(p.euler);
            }
            before = Some(p.euler);
            begin += p.seconds + self.turn;
        }
        standing(before.unwrap_or(o))
    }
}
