//! Simulator: an analytic motion over the WGS-84 earth, the increments an ideal sensor would report, and what a real
//! one makes of them.
//!
//! ```
//! use host_tests::sim::{Sensor, SensorErrors, Simulator, Static};
//! use navsight::earth::Geodetic;
//!
//! let still = Static::degrees(Geodetic::from_degrees(40.0, 116.0, 100.0), 30.0, 2.0, 1.0);
//! let mut sensor = Sensor::new(SensorErrors::TACTICAL, 7);
//! for (truth, ideal) in Simulator::new(still, 0.01).take(100) {
//!     let imu = sensor.sample(&ideal);
//!     assert!(truth.time < 1.005 && (imu.delta_v_b.norm() - 0.098).abs() < 0.002);
//! }
//! ```

mod error;
mod patrol;
mod schedule;
mod sensor;
mod standing;
mod trajectory;
mod truth;

pub use error::{covariance, error_state};
pub use patrol::Patrol;
pub use schedule::{Position, Schedule};
pub use sensor::{Sensor, SensorErrors};
pub use standing::navigation_grade;
pub use trajectory::{ClimbingTurns, Coning, Pose, Static, Swing, Trajectory, Turn};
pub use truth::{Ideal, Simulator, Truth};

/// One degree [rad].
pub const DEG: f64 = std::f64::consts::PI / 180.0;
/// One second of arc [rad].
pub const ARCSEC: f64 = DEG / 3600.0;
