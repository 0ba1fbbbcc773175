//! Why does heading not converge? A vehicle stands still with velocity updates; the four ways of looking say what is
//! learnt, what cannot be, and what would help. Then it is turned by half a circle.
//!
//! Expect: heading tied to the east gyro at rest, and nothing unseen but position after the turn; the same bits on the host
//! and on a Cortex-M4F.
#![cfg_attr(target_os = "none", no_std, no_main)]

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use navsight::error::Error;
use navsight::error_model::{discrete::phi_minus_identity, psi, BiasModel, Environment, N, VEL};
use navsight::observability::agreement::{Limits, View};
use navsight::observability::ceiling::{Gramian, Unseen};
use navsight::observability::pwcs::{Scale, Staged, NAVIGATION};
use navsight::observability::structural::{Pattern, Report};

type F = SMatrix<f32, N, N>;

const NAMES: [&str; N] = [
    "position east",
    "position north",
    "height",
    "velocity east",
    "velocity north",
    "velocity up",
    "tilt about east",
    "tilt about north",
    "heading",
    "the right gyro (east)",
    "the forward gyro (north)",
    "the up gyro",
    "the right accelerometer",
    "the forward accelerometer",
    "the up accelerometer",
];
/// 10 m, 0.15 m/s, 0.5° and 2°, 0.02 °/h, 100 µg.
const SIGMA0: [f32; N] = [
    10.0, 10.0, 10.0, 0.15, 0.15, 0.15, 8.7e-3, 8.7e-3, 3.5e-2, 9.7e-8, 9.7e-8, 9.7e-8, 9.8e-4,
    9.8e-4, 9.8e-4,
];
/// Residual motion of a standing vehicle [m/s].
const NOISE: f32 = 1e-3;

/// F at rest at 40° north; `facing` 1 north, −1 south.
fn at_rest(facing: f32) -> F {
    let env = Environment::wgs84(0.698_131_7, 0.0, Vector3::zeros());
    let c_b_n = Matrix3::from_diagonal(&Vector3::new(facing, facing, 1.0));
    let bias = BiasModel {
        rate_g: 0.0,
        rate_a: 0.0,
    };
    psi::f_matrix(&env, &c_b_n, &Vector3::new(0.0, 0.0, env.gravity), &bias)
}

fn velocity() -> SMatrix<f32, 3, N> {
    let mut h = SMatrix::<f32, 3, N>::zeros();
    h.fixed_view_mut::<3, 3>(0, VEL).fill_diagonal(-1.0);
    h
}

/// Ten minutes of updates at 1 Hz.
fn learn(gramian: &mut Gramian<f32, N>, f: &F) {
    let a = phi_minus_identity(f, 1.0, 2);
    let a = F::from_fn(|i, j| {
        let of = |k: usize| SIGMA0.get(k).copied().unwrap_or(1.0);
        a.get((i, j)).copied().unwrap_or(0.0) * of(j) / of(i)
    });
    for _ in 0..600 {
        gramian.propagate(&a);
        for axis in [VEL, VEL + 1, VEL + 2] {
            let mut row = SVector::<f32, N>::zeros();
            if let (Some(x), Some(sigma)) = (row.get_mut(axis), SIGMA0.get(axis)) {
                *x = -sigma / NOISE;
            }
            gramian.observe(&row);
        }
    }
}

fn say(
    out: &mut impl core::fmt::Write,
    staged: &Staged<f32, N, 3>,
    gramian: &Gramian<f32, N>,
) -> core::fmt::Result {
    let limits = Limits::default();
    let unseen = Unseen::of(staged);
    let xi2 = gramian.xi2(&gramian.information());
    writeln!(out, "rank {} of {N}", staged.rank())?;
    for (state, xi2) in xi2.iter().enumerate().skip(VEL) {
        let view = View::of(staged, &unseen, state, None, Some(*xi2), &limits);
        writeln!(
            out,
            "{:<13} {:08x}  {}",
            view.flag(&limits).name(),
            xi2.to_bits(),
            view.sentence(&limits, &NAMES, &NAVIGATION)
        )?;
    }
    Ok(())
}

fn work(out: &mut impl core::fmt::Write) -> Result<core::fmt::Result, Error> {
    let sigma = SVector::<f32, N>::from(SIGMA0);
    let (north, south, h) = (at_rest(1.0), at_rest(-1.0), velocity());
    let report = Report::new(&Pattern::from_model(&north, &h, &sigma, 1e-9, 0)?);
    let mut staged = Staged::new(&Scale::canonical(&NAVIGATION, &sigma, 9.8))?;
    let mut gramian = Gramian::new();

    staged.segment(&north, &h, None)?;
    learn(&mut gramian, &north);
    let structure = writeln!(
        out,
        "structure: at most {} dimensions; alone {:#06x}, coupled {:#06x}, unseen {:#06x}",
        report.d, report.unique, report.coupled, report.unseen
    );
    if structure
        .and_then(|()| say(out, &staged, &gramian))
        .is_err()
    {
        return Ok(Err(core::fmt::Error));
    }
    staged.segment(&south, &h, None)?;
    learn(&mut gramian, &south);
    Ok(writeln!(out, "after half a turn").and_then(|()| say(out, &staged, &gramian)))
}

fn run(out: &mut impl core::fmt::Write) -> core::fmt::Result {
    match work(out) {
        Ok(written) => written,
        Err(error) => writeln!(out, "refused: {error:?}"),
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    let mut s = String::new();
    run(&mut s).unwrap();
    print!("{s}");
}

#[cfg(target_os = "none")]
mod firmware;
