//! Self-alignment of a standing vehicle: from no attitude at all to the filter's own.
//!
//! | file | does |
//! |---|---|
//! | [`coarse`] | attitude from a window of samples that resists disturbance: level and gyrocompass |
//! | [`levelling`] | level and gyro bias from plain means, for sensors that cannot feel the earth turn |
//! | [`heading_source`] | earth rate or a heading from outside: the criterion |
//! | [`in_motion`] | attitude of a moving vehicle from satellite velocities, heading unknown at the start |
//! | [`gate`] | holds states that cannot be seen just now (Schmidt update); off unless used |
//! | [`planner`] | which manoeuvre would help, tried on a copy of the covariance |
//! | [`standing`] | coarse window, then the filter with zero-velocity updates (the samples of the window once more, where there is room for them), through turns to further positions |
//! | [`carry`] | the biases of one alignment, with their covariance, into the next: power-off between two positions |
//! | [`north_bias`] | Peng's observation of the north gyro bias from one position in the next |
//! | [`stationary`] | at rest or not, and the zero-velocity and zero-rotation updates of a rest |
//! | [`supervisor`] | is it finished, if not why not, and how long will it take |
//! | [`angle`] | by what angle to turn, and for which of these ways |
//!
//! Two positions, best first (heading after 10 + 15 min, `host-tests/tests/two_position.rs`): the filter carried through a
//! turn of 180°, through one of 90°, the bias block carried into a new start, Peng's observation applied once. Peng's
//! observation at every step ends as near but believes itself too much.

pub mod angle;
pub mod carry;
pub mod coarse;
pub mod gate;
pub mod heading_source;
pub mod in_motion;
mod inertial;
pub mod levelling;
pub mod north_bias;
pub mod planner;
pub mod standing;
pub mod stationary;
pub mod supervisor;
mod window;
