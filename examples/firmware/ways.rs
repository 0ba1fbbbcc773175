//! Rows of the bench for the ways of looking beside ξ and η: structure, staged elimination, eigenvalues.

use core::slice::from_ref;

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use navsight::error::Error;
use navsight::error_model::{psi, BiasModel, Environment, N, POS, VEL};
use navsight::observability::agreement::{Limits, View};
use navsight::observability::ceiling::{Gramian, Unseen};
use navsight::observability::eigen_degree::{EigenDegree, Form};
use navsight::observability::pwcs::{Progress, Scale, Staged, NAVIGATION};
use navsight::observability::structural::{
    Changes, Groups, Linking, Matchings, Pattern, Report, Segments,
};

use crate::rows::{refused, Table};

type F = SMatrix<f32, N, N>;
type H = SMatrix<f32, 6, N>;

/// 10 m, 0.15 m/s, 0.5° and 2°, 0.02 °/h, 100 µg.
const SIGMA0: [f32; N] = [
    10.0, 10.0, 10.0, 0.15, 0.15, 0.15, 8.7e-3, 8.7e-3, 3.5e-2, 9.7e-8, 9.7e-8, 9.7e-8, 9.8e-4,
    9.8e-4, 9.8e-4,
];

/// The vehicle at rest at 40° north, tilted by nothing; `facing` 1 north, −1 south.
fn at_rest(facing: f32) -> F {
    let env = Environment::wgs84(0.698_131_7, 0.0, Vector3::zeros());
    let c_b_n = Matrix3::from_diagonal(&Vector3::new(facing, facing, 1.0));
    let bias = BiasModel {
        rate_g: 0.0,
        rate_a: 0.0,
    };
    psi::f_matrix(&env, &c_b_n, &Vector3::new(0.0, 0.0, env.gravity), &bias)
}

/// Position and velocity.
fn fix() -> H {
    let mut h = H::zeros();
    h.fixed_view_mut::<3, 3>(0, POS).fill_diagonal(-1.0);
    h.fixed_view_mut::<3, 3>(3, VEL).fill_diagonal(-1.0);
    h
}

/// One segment after the other, from nothing.
fn two_positions(
    staged: &mut Staged<f32, N, 6>,
    (north, south, h): &(F, F, H),
) -> Result<(), Error> {
    staged.segment(north, h, None)?;
    staged.segment(south, h, None)
}

/// All rows of this page.
pub fn run(table: &mut Table) -> core::fmt::Result {
    let sigma = SVector::<f32, N>::from(SIGMA0);
    let (north, south, h) = (at_rest(1.0), at_rest(-1.0), fix());
    let pattern = Pattern::from_model(&north, &h, &sigma, 1e-9, 0).map_err(refused)?;
    let changes = Changes::between(&south, &north, 1e-6).map_err(refused)?;
    structure(table, pattern, changes)?;

    let scale = Scale::canonical(&NAVIGATION, &sigma, 9.8);
    let model = (north, south, h);
    let empty = Staged::<f32, N, 6>::new(&scale).map_err(refused)?;
    table.row(
        "staged elimination, 6 rows, rest and two positions",
        "f32",
        (empty, model),
        |(staged, model)| two_positions(staged, model),
    )?;
    let mut staged = empty;
    for f in [north, south] {
        staged.begin(&h).map_err(refused)?;
        let mut state = (staged, f);
        let name = "staged elimination, largest slice";
        while table.slice(name, "f32", &mut state, |(staged, f)| staged.step(f, None))?
            == Progress::Working
        {}
        staged = state.0;
    }
    table.row(
        "agreement of one state",
        "f32",
        (staged, Unseen::new()),
        |(staged, unseen)| {
            let limits = Limits::default();
            unseen.find(staged);
            let view = View::of(staged, unseen, 8, None, Some(400.0), &limits);
            Ok((view.flag(&limits), view))
        },
    )?;
    eigenvalues(table, &north, &h, &scale)?;

    table.row(
        "Gramian, one propagation and three rows",
        "f32",
        (
            Gramian::<f32, N>::new(),
            north,
            SVector::<f32, N>::repeat(0.1),
        ),
        |(gramian, a, row)| {
            gramian.propagate(a);
            for _ in 0..3 {
                gramian.observe(row);
            }
            Ok(())
        },
    )
}

/// What the zero pattern alone decides.
fn structure(table: &mut Table, pattern: Pattern<N>, turn: Changes<N>) -> core::fmt::Result {
    table.row("structural report, one segment", "-", pattern, |pattern| {
        Ok(Report::new(pattern))
    })?;
    let linking = Linking::<N, N>::new(from_ref(&pattern));
    table.row("structural groups, one segment", "-", linking, |linking| {
        linking.widen(N);
        linking.link(u32::MAX);
        Ok(Groups::of_linking(linking))
    })?;
    table.row("linking by span", "-", linking, |linking| {
        Ok(linking.by_span())
    })?;
    let mut segments = Segments::new(&pattern);
    segments.add(&pattern, &turn).map_err(refused)?;
    table.row(
        "structural bound D, two segments",
        "-",
        (segments, [pattern; 2]),
        |(segments, patterns)| Ok(segments.bound(patterns)),
    )?;
    table.row(
        "maximum matchings, the first ten",
        "-",
        pattern,
        |pattern| Ok(Matchings::new(pattern).count(10, 10_000)),
    )
}

/// Eigenvalues of the scaled observability matrix: all at once, and the dearest slice.
fn eigenvalues(table: &mut Table, f: &F, h: &H, scale: &Scale<f32, N>) -> core::fmt::Result {
    let mut staged = Staged::<f32, N, 6>::new(scale).map_err(refused)?;
    staged.segment(f, h, None).map_err(refused)?;
    let form = Form {
        blocks: 4,
        ..Form::scaled(SIGMA0, [10.0, 10.0, 10.0, 0.1, 0.1, 0.1], 300.0)
    };
    let degree = EigenDegree::new(f, h, &form, &staged).map_err(refused)?;
    table.row(
        "eigenvalue degree, 6 rows, four blocks",
        "f32",
        (degree, *f),
        |(degree, f)| {
            degree.run(f);
            Ok(())
        },
    )?;
    let mut state = (degree, *f);
    let name = "eigenvalue degree, largest slice";
    while table.slice(name, "f32", &mut state, |(degree, f)| Ok(degree.step(f)))?
        == Progress::Working
    {}
    Ok(())
}
