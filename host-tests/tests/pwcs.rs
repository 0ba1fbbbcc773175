//! Ranks of the filter's 15-state model: at rest, after a turn, in f32 anywhere, and a system that grows by segments.
#![allow(clippy::needless_range_loop)] // matrices, read as in the equations
#![cfg(not(target_os = "none"))]

use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector3};
use navsight::error_model::{
    discrete::phi_minus_identity, psi, BiasModel, Environment, ATT, BG, POS, VEL,
};
use navsight::linalg::Real;
use navsight::observability::pwcs::*;

type F = SMatrix<f64, 15, 15>;

fn sigma() -> SVector<f64, 15> {
    let mut s = SVector::<f64, 15>::zeros();
    for (from, values) in [
        (POS, [10.0; 3]),
        (VEL, [0.15; 3]),
        (ATT, [0.01, 0.01, 0.035]),
        (BG, [1e-7; 3]),
        (12, [1e-3; 3]),
    ] {
        s.fixed_rows_mut::<3>(from).copy_from_slice(&values);
    }
    s
}

/// F at rest, with or without the way from position to velocity (change of gravity).
fn at_rest(lat: f64, c_b_n: &Matrix3<f64>, feedback: bool) -> F {
    let env = Environment::wgs84(lat, 0.0, Vector3::zeros());
    let bias = BiasModel {
        rate_g: 0.0,
        rate_a: 0.0,
    };
    let mut f = psi::f_matrix(&env, c_b_n, &Vector3::new(0.0, 0.0, env.gravity), &bias);
    if !feedback {
        f.fixed_view_mut::<3, 3>(VEL, POS).fill(0.0);
    }
    f
}

fn measure<const M: usize>(firsts: &[usize]) -> SMatrix<f64, M, 15> {
    let mut h = SMatrix::<f64, M, 15>::zeros();
    for (block, first) in firsts.iter().enumerate() {
        for i in 0..3 {
            h[(3 * block + i, first + i)] = -1.0;
        }
    }
    h
}

fn staged<T: Real, const M: usize>() -> Staged<T, 15, M> {
    let scale = Scale::canonical(&NAVIGATION, &sigma().map(T::of), T::of(9.8));
    Staged::new(&scale).unwrap()
}

fn ranks<T: Real, const M: usize>(fs: &[F], h: &SMatrix<f64, M, 15>, total: bool) -> Vec<usize> {
    let mut staged = staged::<T, M>();
    let mut before = F::identity();
    fs.iter()
        .enumerate()
        .map(|(k, f)| {
            let phi = before.map(T::of);
            staged
                .segment(
                    &f.map(T::of),
                    &h.map(T::of),
                    (total && k > 0).then_some(&phi),
                )
                .unwrap();
            // 300 s in each segment
            before = (F::identity() + phi_minus_identity(f, 300.0, 20)) * before;
            staged.rank()
        })
        .collect()
}

fn yaw(degrees: f64) -> Matrix3<f64> {
    *Rotation3::from_euler_angles(0.0, 0.0, degrees.to_radians()).matrix()
}

#[test]
fn rest_and_a_half_turn() {
    let lat = 40f64.to_radians();
    let (v, p, both) = (
        measure::<3>(&[VEL]),
        measure::<3>(&[POS]),
        measure::<6>(&[POS, VEL]),
    );
    for (feedback, after) in [(false, [12, 15, 15]), (true, [13, 15, 15])] {
        let fs = [
            at_rest(lat, &yaw(0.0), feedback),
            at_rest(lat, &yaw(180.0), feedback),
        ];
        let [v, p, both] = [
            ranks::<f64, 3>(&fs, &v, false),
            ranks::<f64, 3>(&fs, &p, false),
            ranks::<f64, 6>(&fs, &both, false),
        ];
        assert_eq!([v[0], p[0], both[0]], [9, 12, 12], "at rest");
        assert_eq!(
            [v[1], p[1], both[1]],
            after,
            "after the turn, feedback {feedback}"
        );
    }
}

#[test]
fn the_total_matrix_sees_what_the_stripped_one_sees_at_rest_and_after_a_turn() {
    let lat = 40f64.to_radians();
    let fs = [
        at_rest(lat, &yaw(0.0), true),
        at_rest(lat, &yaw(180.0), true),
    ];
    // Where null(Q_k) ⊂ null(F_k) the two are one; with gravity's feedback velocity alone misses that (Schuler), and
    // the total matrix may see more, never less.
    let h = measure::<6>(&[POS, VEL]);
    assert_eq!(
        ranks::<f64, 6>(&fs, &h, true),
        ranks::<f64, 6>(&fs, &h, false)
    );
    let h = measure::<3>(&[VEL]);
    let (total, stripped) = (
        ranks::<f64, 3>(&fs, &h, true),
        ranks::<f64, 3>(&fs, &h, false),
    );
    assert_eq!(total[0], stripped[0]);
    assert!(total[1] >= stripped[1], "{total:?} {stripped:?}");
}

/// Numbers in 0..1 (64-bit linear congruence, upper half).
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (self.0 >> 33) as f64 / (1u64 << 31) as f64
    }
}

#[test]
fn f32_ranks_are_right_at_200_places_and_attitudes() {
    let mut dice = Dice(7);
    for n in 0..200 {
        let lat = (140.0 * dice.roll() - 70.0f64).to_radians();
        let mut turn = || {
            Rotation3::from_euler_angles(
                std::f64::consts::TAU * dice.roll(),
                std::f64::consts::PI * dice.roll(),
                std::f64::consts::TAU * dice.roll(),
            )
        };
        let (c, other) = (*turn().matrix(), *turn().matrix());
        let f = [at_rest(lat, &c, true)];
        assert_eq!(ranks::<f32, 3>(&f, &measure(&[VEL]), false), [9], "{n} V");
        assert_eq!(
            ranks::<f32, 6>(&f, &measure(&[POS, VEL]), false),
            [12],
            "{n} P and V"
        );
        // The north gyro bias that another attitude has found.
        let mut h = SMatrix::<f64, 4, 15>::zeros();
        h.fixed_view_mut::<3, 15>(0, 0)
            .copy_from(&measure::<3>(&[VEL]));
        h.fixed_view_mut::<1, 3>(3, BG).copy_from(&other.row(1));
        assert_eq!(ranks::<f32, 4>(&f, &h, false), [10], "{n} V and a gyro");
    }
}

#[test]
fn slices_come_to_the_same_rows_as_one_call() {
    let f = at_rest(0.7, &yaw(25.0), true).map(|x| x as f32);
    let h = measure::<6>(&[POS, VEL]).map(|x| x as f32);
    let (mut whole, mut sliced) = (staged::<f32, 6>(), staged::<f32, 6>());
    whole.segment(&f, &h, None).unwrap();
    sliced.begin(&h).unwrap();
    let mut slices = 1;
    while sliced.step(&f, None).unwrap() == Progress::Working {
        slices += 1;
    }
    assert_eq!(whole.rank(), sliced.rank());
    for row in 0..whole.rank() {
        assert_eq!(whole.reduced(row), sliced.reduced(row));
    }
    // 12 rows, and one that ends each of the chains which do not end at their last order; each is reduced by 12 others at
    // most, cleared from as many, and has four more slices of its own.
    assert!(slices <= (12 + 6) * (2 * 12 + 4), "{slices}");
}

#[test]
fn broken_models_are_refused_and_nothing_changes() {
    use navsight::error::Error;
    let f = at_rest(0.7, &yaw(0.0), true);
    let h = measure::<3>(&[VEL]);
    let mut staged = staged::<f64, 3>();
    staged.segment(&f, &h, None).unwrap();
    let mut bad_h = h;
    bad_h[(1, 4)] = f64::NAN;
    assert_eq!(staged.begin(&bad_h), Err(Error::NonFinite));
    let mut bad_f = f;
    bad_f[(3, 7)] = f64::INFINITY;
    assert_eq!(staged.segment(&bad_f, &h, None), Err(Error::NonFinite));
    assert_eq!(staged.rank(), 9);
    let mut scale = Scale::<f64, 15>::plain(1e-9);
    scale.sigma[3] = 0.0;
    assert_eq!(
        Staged::<f64, 15, 3>::new(&scale).unwrap_err(),
        Error::OutOfRange
    );
    scale.sigma[3] = f64::NAN;
    assert_eq!(
        Staged::<f64, 15, 3>::new(&scale).unwrap_err(),
        Error::NonFinite
    );
}

#[test]
fn a_stiff_system_overflows_nothing() {
    // |F τ|^14 would be 1e70 in f32.
    let mut f = SMatrix::<f32, 15, 15>::zeros();
    for i in 0..14 {
        f[(i, i + 1)] = 1e5 * (1.0 + i as f32);
    }
    let mut h = SMatrix::<f32, 1, 15>::zeros();
    h[0] = 1.0;
    let mut staged = Staged::<f32, 15, 1>::new(&Scale::plain(1e-4)).unwrap();
    staged.segment(&f, &h, None).unwrap();
    assert_eq!(staged.rank(), 15);
}
