//! Tracking a vehicle by satellite positions and velocities alone, without inertial sensors.
//!
//! | file | holds |
//! |---|---|
//! | `current_model` | [`CurrentModel`]: the 'current' statistical model and Singer's, one axis: Φ, U, Q, mean and variance |
//! | `fix` | [`Fix`]: what a receiver delivers, channels missing or correlated |
//! | `gps_velocity` | [`Tracker`]: the filter of Fang 1998 on that model, one axis or three |

mod current_model;
mod fix;
mod gps_velocity;

pub use current_model::{Beyond, CurrentModel, Limits, Mean, Transition, Variance, RAYLEIGH};
pub use fix::{Fix, Noise, Reading};
pub use gps_velocity::{
    AxisTracker, Kinematics, LocalTracker, Outcome, Rates, Report, Settings, Tracker,
};
