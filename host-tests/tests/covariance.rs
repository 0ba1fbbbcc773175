//! Laws of the covariance kernels on random input, against the textbook's dense filter.

use host_tests::reference::kalman::Dense;
use host_tests::reference::random::Random;
use navsight::attitude::Euler;
use navsight::covariance::{Covariance15, Observation, Rows, Update};
use navsight::error_model::{
    block_transition, discrete::phi_minus_identity, psi, BiasModel, Environment, Interval,
    NoiseDensity, Scaling, N,
};
use navsight::linalg::Real;

use nalgebra::{SMatrix, SVector, Vector3};
use proptest::prelude::*;

type P = SMatrix<f64, N, N>;

/// A covariance in σ0 units: variances between 1e-4 and about 1, correlated.
fn covariance(random: &mut Random) -> P {
    let p = random.spd::<N>();
    let scale = SVector::<f64, N>::from_fn(|_, _| 10f64.powf(-1.0 + random.uniform()));
    let unit = SVector::<f64, N>::from_fn(|i, _| scale[i] / p[(i, i)].sqrt());
    let p = P::from_fn(|i, j| p[(i, j)] * unit[i] * unit[j]);
    // what f32 can hold, so that both precisions start with the same numbers
    p.map(|x| f64::from(x as f32))
}

/// M rows: of the states themselves, or dense.
struct Case<const M: usize> {
    nu: [f64; M],
    r: [f64; M],
    h: SMatrix<f64, M, N>,
    direct: Option<usize>,
}

impl<const M: usize> Case<M> {
    fn new(random: &mut Random, direct: bool) -> Self {
        let single = |x: f64| f64::from(x as f32);
        let first = ((random.uniform() + 1.0) * 0.5 * (N - M) as f64) as usize;
        let mut h = SMatrix::<f64, M, N>::zeros();
        for i in 0..M {
            for j in 0..N {
                h[(i, j)] = match direct {
                    true if j == first + i => -1.0,
                    true => 0.0,
                    false => single(random.uniform()),
                };
            }
        }
        Self {
            nu: core::array::from_fn(|_| single(random.uniform())),
            // from a noise far below the variance to one far above
            r: core::array::from_fn(|_| single(10f64.powf(-3.0 + 3.0 * random.uniform()))),
            h,
            direct: direct.then_some(first),
        }
    }

    fn rows<T: Real>(&self, gate: Option<T>) -> Rows<T, M, N> {
        Rows {
            nu: self.nu.map(T::of),
            h: match self.direct {
                Some(first) => Observation::Direct { first },
                None => Observation::Dense(self.h.map(T::of)),
            },
            r: self.r.map(T::of),
            gate,
        }
    }
}

fn of<T: Real>(p: &P) -> Covariance15<T> {
    Covariance15::from_matrix(&p.map(T::of)).unwrap()
}

/// Largest difference of two covariances, each element against the σ of its row and column before the update.
fn off<T: Real>(ours: &Covariance15<T>, theirs: &P, before: &P) -> f64 {
    let ours = ours.to_matrix();
    let mut worst = 0.0f64;
    for i in 0..N {
        for j in 0..N {
            let unit = (before[(i, i)] * before[(j, j)]).sqrt();
            worst = worst.max((ours[(i, j)].wide() - theirs[(i, j)]).abs() / unit);
        }
    }
    worst
}

/// One update against the dense filter: `tolerance` in units of the σ before.
fn agrees<T: Real, const M: usize>(p: &P, case: &Case<M>, tolerance: f64) -> Update<T, M, N> {
    let mut ours = of::<T>(p);
    let update = ours.update(&case.rows::<T>(None)).unwrap();
    let mut dense = Dense { p: *p };
    let gain = dense
        .update(&case.h, &SVector::from(case.r), &SVector::from(case.nu))
        .unwrap();
    let error = off(&ours, &dense.p, p);
    assert!(error < tolerance, "P by {error:e} of σσ");
    for i in 0..N {
        let sigma = p[(i, i)].sqrt();
        let error = (update.dx[i].wide() - gain.dx[i]).abs() / sigma;
        // δx is as large as ν/σ_ν times σ, and ν/σ_ν reaches the root of the NIS.
        assert!(
            error < tolerance * (1.0 + gain.nis.sqrt()) * 10.0,
            "δx[{i}] by {error:e} σ"
        );
        assert!(update.p_after[i] <= update.p_before[i], "variance {i} rose");
        assert!(update.decrease[i] >= T::zero());
        let difference = (update.p_before[i] - update.p_after[i]).wide();
        assert!(
            (update.decrease[i].wide() - difference).abs() < tolerance * p[(i, i)],
            "what was taken from variance {i} is not what is gone"
        );
    }
    for m in 0..M {
        assert!((update.s[m].wide() / gain.s[(m, m)] - 1.0).abs() < tolerance * 100.0);
    }
    let nis = update.nis.wide();
    assert!(
        (nis - gain.nis).abs() < tolerance * 100.0 * (1.0 + gain.nis),
        "{nis}"
    );
    update
}

/// f32: a hundred roundings of the products of one update, 6e-8 each; two words keep the sums.
const F32: f64 = 1e-5;
/// f64 against Joseph's form, which loses more itself where R is 1e-6 of the variance.
const F64: f64 = 1e-9;

fn every_size(seed: u64, direct: bool) {
    fn size<const M: usize>(random: &mut Random, direct: bool) {
        let p = covariance(random);
        let case = Case::<M>::new(random, direct);
        agrees::<f32, M>(&p, &case, F32);
        agrees::<f64, M>(&p, &case, F64);
    }
    let random = &mut Random(seed | 1);
    size::<1>(random, direct);
    size::<2>(random, direct);
    size::<3>(random, direct);
    size::<4>(random, direct);
    size::<5>(random, direct);
    size::<6>(random, direct);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn rows_of_states_do_what_the_textbook_does(seed: u64) {
        every_size(seed, true);
    }

    #[test]
    fn dense_rows_do_what_the_textbook_does(seed: u64) {
        every_size(seed, false);
    }

    #[test]
    fn rows_one_by_one_are_rows_in_one_sweep(seed: u64, direct: bool) {
        let random = &mut Random(seed | 1);
        let p = covariance(random);
        let case = Case::<3>::new(random, direct);
        let (mut sweep, mut single) = (of::<f64>(&p), of::<f64>(&p));
        let all = sweep.update(&case.rows(None)).unwrap();
        let mut dx = SVector::<f64, N>::zeros();
        let mut nis = 0.0;
        for m in 0..3 {
            let h = case.h.fixed_rows::<1>(m).into_owned();
            // the innovation after the correction by the rows before
            let nu = case.nu[m] - (h * dx).x;
            let rows = Rows { nu: [nu], h: Observation::Dense(h), r: [case.r[m]], gate: None };
            let one = single.update(&rows).unwrap();
            prop_assert!((one.row_nis[0] - all.row_nis[m]).abs() < 1e-9 * (1.0 + all.row_nis[m]));
            dx += SVector::from(one.dx);
            nis += one.nis;
        }
        prop_assert!((nis - all.nis).abs() < 1e-9 * (1.0 + nis));
        prop_assert!((dx - SVector::from(all.dx)).amax() < 1e-9 * (1.0 + dx.amax()));
        prop_assert!(off(&sweep, &single.to_matrix(), &p) < F64);
    }

    #[test]
    fn the_order_of_rows_changes_nothing(seed: u64) {
        let random = &mut Random(seed | 1);
        let p = covariance(random);
        let case = Case::<4>::new(random, false);
        let turned = Case::<4> {
            nu: core::array::from_fn(|m| case.nu[(m + 1) % 4]),
            r: core::array::from_fn(|m| case.r[(m + 1) % 4]),
            h: SMatrix::from_fn(|m, j| case.h[((m + 1) % 4, j)]),
            direct: None,
        };
        let (mut a, mut b) = (of::<f64>(&p), of::<f64>(&p));
        let (a_out, b_out) = (a.update(&case.rows(None)).unwrap(), b.update(&turned.rows(None)).unwrap());
        prop_assert!(off(&a, &b.to_matrix(), &p) < F64);
        prop_assert!((a_out.nis - b_out.nis).abs() < 1e-9 * (1.0 + a_out.nis));
    }

    #[test]
    fn what_the_gate_refuses_teaches_nothing(seed: u64, direct: bool) {
        let random = &mut Random(seed | 1);
        let p = covariance(random);
        let mut case = Case::<3>::new(random, direct);
        case.nu = [1e3, -1e3, 1e3];
        let before = of::<f32>(&p);
        let mut after = before;
        let update = after.update(&case.rows(Some(9.0))).unwrap();
        prop_assert_eq!(update.accepted, [false; 3]);
        prop_assert_eq!(update.dx, [0.0; N]);
        prop_assert_eq!(update.nis, 0.0);
        // bit for bit, both words
        prop_assert_eq!(format!("{before:?}"), format!("{after:?}"));
    }
}

/// The vehicle at rest, tilted: F and its first-order interval in σ0 units, and ξ2 after `seconds` with either.
fn xi2(first_order: bool, dt: f64, seconds: usize) -> [f64; N] {
    let env = Environment::<f64>::wgs84(0.6, 400.0, Vector3::zeros());
    let c_b_n = Euler::from_degrees(30.0, 2.0, -5.0).c_b_n().map(f64::from);
    let f_n = Vector3::new(0.0, 0.0, env.gravity);
    let bias = BiasModel::constant();
    let noise = NoiseDensity::from_random_walks(1e-4, 1e-6);
    let rad = core::f64::consts::PI / 180.0;
    let sigma0: [f64; N] = [
        [10.0; 3],
        [0.1; 3],
        [0.5 * rad, 0.5 * rad, 2.0 * rad],
        [0.02 * rad / 3600.0; 3],
        [1e-3; 3],
    ]
    .concat()
    .try_into()
    .unwrap();
    let scaling = Scaling::new(&sigma0, &bias, &noise).unwrap();
    let mut interval = Interval::<f64>::empty();
    interval.add(&c_b_n, &(f_n * dt), dt);
    let blocks = block_transition(&env, &interval, &scaling);
    let f = psi::f_matrix(&env, &c_b_n, &f_n, &bias);
    let f = P::from_fn(|i, j| f[(i, j)] * sigma0[j] / sigma0[i]);
    let exact = phi_minus_identity(&f, dt, 6);
    let mut p = Covariance15::<f64>::from_diagonal(&[1.0; N]).unwrap();
    let rows = Rows {
        nu: [0.0; 3],
        h: Observation::Direct { first: 3 },
        r: [(0.002f64 / 0.1).powi(2); 3],
        gate: None,
    };
    for _ in 0..seconds {
        for _ in 0..(1.0 / dt).round() as usize {
            match first_order {
                true => p.propagate_blocks(&blocks),
                false => p.propagate(&exact, &blocks.noise()),
            }
        }
        p.update(&rows).unwrap();
    }
    p.diagonal().map(|p| 1.0 / p)
}

#[test]
fn first_order_steps_of_a_tenth_of_a_second_are_exact_to_6e_5() {
    let (ours, exact) = (xi2(true, 0.1, 600), xi2(false, 0.1, 600));
    let mut worst = 0.0f64;
    for (ours, exact) in ours.iter().zip(&exact) {
        worst = worst.max((ours / exact - 1.0).abs());
    }
    println!("first order, steps of 0.1 s, 600 s: ξ2 off by {worst:.1e}");
    // What `MAX_STEP` documents.
    assert!(worst < 6e-5, "{worst:e}");
}
