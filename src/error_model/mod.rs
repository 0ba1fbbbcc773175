//! How the errors of the navigator grow: state order, F and G, Φ and Q over an interval.
//!
//! ```text
//! ẋ = F x + G w        x = [ δr_n, δv_n, ψ_n (or φ_n), b_g, b_a ]
//! ```
//!
//! | file | holds |
//! |---|---|
//! | `environment` | what the earth and the motion contribute to F; WGS-84 or a paper's sphere |
//! | [`psi`] | F of the psi-angle model: the filter's |
//! | [`phi`] | F of the phi-angle model: for analysis |
//! | `noise` | bias model, noise densities, and the mapping G |
//! | [`discrete`] | Φ − I and Q over an interval, for any F |
//! | `interval` | the filter's way: ∫C dt and ∫f dt collected between two propagations, then Φ − I block by block |
//!
//! Signs and frames: the table in the crate's front page. Both F are checked against finite differences of a
//! mechanization at tilted, moving, turning states in `host-tests/tests/error_model.rs`.

use nalgebra::{Matrix3, SMatrix};

use crate::linalg::Real;

pub mod discrete;
mod environment;
mod interval;
mod noise;
pub mod phi;
pub mod psi;

pub use environment::Environment;
pub use interval::{block_rates, block_transition, block_transition_into, Interval, Scaling};
pub use noise::{g_matrix, BiasModel, NoiseDensity};

/// Number of error states.
pub const N: usize = 15;
/// δr_n, position, east-north-up [m]
pub const POS: usize = 0;
/// δv_n, velocity, east-north-up [m/s]
pub const VEL: usize = 3;
/// ψ_n (or φ_n), attitude, east-north-up [rad]
pub const ATT: usize = 6;
/// b_g, gyro bias left uncompensated, body axes [rad/s]
pub const BG: usize = 9;
/// b_a, accelerometer bias left uncompensated, body axes [m/s²]
pub const BA: usize = 12;

const _: () = assert!(BA + 3 == N);

/// Writes a 3 × 3 block; the place is constant so that no bounds check is left.
#[inline(always)]
fn put<T: Real, const ROW: usize, const COL: usize>(f: &mut SMatrix<T, N, N>, block: &Matrix3<T>) {
    f.fixed_view_mut::<3, 3>(ROW, COL).copy_from(block);
}
