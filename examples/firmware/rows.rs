//! The rows of the bench: each is a piece of work that a user's program would call.

use core::fmt::Write;

use cortex_m_semihosting::hio::HostStream;
use nalgebra::{Matrix3, Vector3};

use crate::probe::region;

/// Counts one piece of work: adding a row to the table is one call of this.
fn row<S>(
    out: &mut HostStream,
    work: &str,
    scalar: &str,
    mut state: S,
    f: fn(&mut S),
) -> core::fmt::Result {
    region(&mut state, f);
    writeln!(out, "row\t{work}\t{scalar}")
}

/// All rows, in the order of the table. The first one is what the markers themselves cost.
pub fn run(out: &mut HostStream) -> core::fmt::Result {
    row(out, "empty", "", (), |_| ())?;
    row(
        out,
        "skew matrix",
        "f32",
        (Vector3::new(1.0f32, 2.0, 3.0), Matrix3::zeros()),
        |s| {
            s.1 = navsight::linalg::skew(&s.0);
        },
    )?;
    Ok(())
}
