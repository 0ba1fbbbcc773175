//! Rows of the bench: the covariance alone, in both scalars.

use nalgebra::{SMatrix, SVector};

use navsight::covariance::{Covariance15, Observation, Rows};
use navsight::error_model::{
    block_transition, BiasModel, Environment, Interval, NoiseDensity, Scaling,
};
use navsight::filter::Filter;
use navsight::imu::ImuIncrement;
use navsight::linalg::Real;

use crate::rows::{refused, Table};

/// The covariance alone, without a navigator around it.
pub fn run<T: Real>(
    table: &mut Table,
    scalar: &str,
    filter: &Filter,
    imu: ImuIncrement,
) -> core::fmt::Result {
    let wide = |x: f32| T::of(f64::from(x));
    let mut nav = *filter.nav();
    let mut interval = Interval::<T>::empty();
    for _ in 0..10 {
        let step = nav.advance(&imu).map_err(refused)?;
        interval.add(
            &step.c_b_n.map(wide),
            &step.delta_v_n.map(wide),
            wide(step.dt),
        );
    }
    let p: SMatrix<T, 15, 15> = filter.covariance().to_matrix().map(wide);
    let covariance = Covariance15::from_matrix(&p).map_err(refused)?;
    let environment = Environment::<T>::wgs84(
        nav.position().lat,
        nav.position().height,
        nav.v_n().map(wide),
    );
    let scaling = Scaling::new(
        &filter.sigma0().map(wide),
        &BiasModel::constant(),
        &NoiseDensity::from_random_walks(T::of(1e-4), T::of(1e-6)),
    )
    .map_err(refused)?;
    table.row(
        "Φ and Q of an interval",
        scalar,
        (environment, interval, scaling),
        |(environment, interval, scaling)| Ok(block_transition(environment, interval, scaling)),
    )?;
    let blocks = block_transition(&environment, &interval, &scaling);
    table.row(
        "covariance propagation, structured kernel",
        scalar,
        (covariance, blocks),
        |(p, blocks)| {
            p.propagate_blocks(blocks);
            Ok(())
        },
    )?;
    let dense: (SMatrix<T, 15, 15>, SVector<T, 15>) = (blocks.dense(), blocks.noise());
    table.row(
        "covariance propagation, general kernel",
        scalar,
        (covariance, dense),
        |(p, (a, q))| {
            p.propagate(a, q);
            Ok(())
        },
    )?;
    let rows = Rows::<T, 3, 15> {
        nu: [T::of(1e-3); 3],
        h: Observation::Direct { first: 3 },
        r: [T::of(1e-2); 3],
        gate: None,
    };
    table.row(
        "three-row update, kernel",
        scalar,
        (covariance, rows),
        |(p, rows)| p.update(rows),
    )
}
