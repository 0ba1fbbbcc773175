//! η: eigenvalues and directions of T and M, their accuracy in single precision, and the promises about slices.

use nalgebra::{Matrix2, SMatrix, SVector};
use navsight::covariance::{Covariance, Covariance15, Observation};
use navsight::error::Error;
use navsight::linalg::Real;
use navsight::observability::riccati::{DecreaseRate, DecreaseRate15, Information};
use navsight::observability::spectrum::{
    Axes, Directions, Prior, Progress, Spectrum, Spectrum15, ValuesOnly, SLICE,
};

use host_tests::covariance_analysis::Config;
use host_tests::reference::lu2009 as twin;
use host_tests::reference::random::Random;

const ALL: u32 = u32::MAX;

type Full<T, const N: usize, const L: usize> = Spectrum<'static, T, N, L, Directions<T, N>>;
type Dense15 = SMatrix<f64, 15, 15>;

fn values<T: Real, const N: usize, const L: usize, A: Axes<T>>(
    spectrum: &Spectrum<'_, T, N, L, A>,
) -> Vec<f64> {
    (0..spectrum.len())
        .map(|k| spectrum.value(k).unwrap().wide())
        .collect()
}

#[test]
fn two_states_as_on_paper() {
    // P = [[2, 1], [1, 2]]: 1 along (1, −1)/√2, 3 along (1, 1)/√2
    let p = Covariance::<f64, 2, 3>::from_matrix(&Matrix2::new(2.0, 1.0, 1.0, 2.0)).unwrap();
    let mut s = Full::<f64, 2, 3>::new();
    assert!(s.is_empty());
    s.start_accuracy(&p, Prior::Independent, ALL).unwrap();
    assert_eq!(s.value(0), None);
    assert_eq!(s.step(ALL), Ok(Progress::Done));
    let half = 0.5f64.sqrt();
    for (k, value, second) in [(0, 1.0, -half), (1, 3.0, half)] {
        assert!((s.value(k).unwrap() - value).abs() < 1e-15);
        let d = s.direction(k).unwrap();
        // the sign is that of the largest component, and these two are alike
        let sign = d.vector[0].signum();
        assert!((d.vector[0] * sign - half).abs() < 1e-15);
        assert!((d.vector[1] * sign - second).abs() < 1e-15);
        assert_eq!((d.first, d.dimension), (k, 1));
    }
    assert_eq!(s.value(2), None);
    assert_eq!(s.direction(2), None);
    assert_eq!(s.step(ALL), Ok(Progress::Done));

    // The same P with P0 = [[1, c], [c, 1]]: 3/(1 + c) along (1, 1)/√(2(1 + c)), 1/(1 − c) along (1, −1)/√(2(1 − c))
    let c = 0.25;
    let p0 = Covariance::<f64, 2, 3>::from_matrix(&Matrix2::new(1.0, c, c, 1.0)).unwrap();
    let mut s = Spectrum::<f64, 2, 3, Directions<f64, 2>>::new();
    s.start_accuracy(&p, Prior::Correlated(&p0), ALL).unwrap();
    assert_eq!(s.step(ALL), Ok(Progress::Done));
    for (k, value, size) in [
        (0, 1.0 / (1.0 - c), 1.0 / (2.0 * (1.0 - c)).sqrt()),
        (1, 3.0 / (1.0 + c), 1.0 / (2.0 * (1.0 + c)).sqrt()),
    ] {
        assert!((s.value(k).unwrap() - value).abs() < 1e-14);
        let d = s.direction(k).unwrap().vector;
        assert!((d[0].abs() - size).abs() < 1e-14 && (d[1].abs() - size).abs() < 1e-14);
    }

    // M of process noise alone: −Q/P0
    let information = Information::<f64, 0, 2> {
        h: Observation::Direct { first: 0 },
        r_t: [],
    };
    let q = SVector::<f64, 2>::new(0.3, 0.7);
    let rate = DecreaseRate::riccati(&p, &SMatrix::zeros(), &q, &information);
    s.start_speed(&rate, Prior::Independent, ALL).unwrap();
    assert_eq!(s.step(ALL), Ok(Progress::Done));
    assert_eq!(values(&s), [-0.7, -0.3]);
}

#[test]
fn a_state_that_nothing_touches_keeps_its_one() {
    let mut m = SMatrix::<f64, 3, 3>::identity();
    (m[(0, 0)], m[(1, 1)], m[(0, 1)], m[(1, 0)]) = (1e-4, 2e-6, 1e-5, 1e-5);
    let p = Covariance::<f64, 3, 6>::from_matrix(&m).unwrap();
    let mut s = Full::<f64, 3, 6>::new();
    s.start_accuracy(&p, Prior::Independent, ALL).unwrap();
    assert_eq!(s.step(ALL), Ok(Progress::Done));
    assert_eq!(s.value(2), Some(1.0));
    assert_eq!(s.direction(2).unwrap().vector, [0.0, 0.0, 1.0]);
}

/// Residuals of P ν = λ P0 ν and of ν'P0ν = 1 for one random pair.
fn residual<const N: usize, const L: usize>(random: &mut Random, correlated: bool) -> f64 {
    let p = random.spd::<N>();
    let mut p0 = SMatrix::<f64, N, N>::identity();
    if correlated {
        p0 = random.spd::<N>();
        let d = SMatrix::from_diagonal(&p0.diagonal().map(|x| 1.0 / x.sqrt()));
        p0 = d * p0 * d;
    }
    p0 = (p0 + p0.transpose()) * 0.5;
    let packed = Covariance::<f64, N, L>::from_matrix(&p).unwrap();
    let packed0 = Covariance::<f64, N, L>::from_matrix(&p0).unwrap();
    let prior = if correlated {
        Prior::Correlated(&packed0)
    } else {
        Prior::Independent
    };
    let mut s = Spectrum::<f64, N, L, Directions<f64, N>>::new();
    let mut worst = 0.0f64;

    // speed: the same matrix with a shift makes it indefinite
    let shift = p.trace() / N as f64;
    let f = -SMatrix::<f64, N, N>::identity() * 0.5;
    let information = Information::<f64, 0, N> {
        h: Observation::Direct { first: 0 },
        r_t: [],
    };
    let rate = DecreaseRate::riccati(&packed, &f, &SVector::repeat(shift), &information);
    let m = p - SMatrix::identity() * shift;

    for (matrix, definite) in [(p, true), (m, false)] {
        if definite {
            s.start_accuracy(&packed, prior, ALL).unwrap();
        } else {
            s.start_speed(&rate, prior, ALL).unwrap();
        }
        assert_eq!(s.step(ALL), Ok(Progress::Done));
        let mut last = f64::NEG_INFINITY;
        for k in 0..N {
            let value = s.value(k).unwrap();
            assert!(value >= last);
            last = value;
            let nu = SVector::<f64, N>::from(s.direction(k).unwrap().vector);
            let size = matrix.amax() * nu.amax();
            worst = worst.max((matrix * nu - p0 * nu * value).amax() / size);
            worst = worst.max((nu.dot(&(p0 * nu)) - 1.0).abs());
            let largest = nu[nu.iamax()];
            assert!(largest > 0.0);
        }
    }
    worst
}

#[test]
fn the_pairs_solve_their_equation_for_any_size() {
    let mut random = Random(3);
    for correlated in [false, true] {
        let mut worst = 0.0f64;
        for _ in 0..20 {
            worst = worst.max(residual::<1, 1>(&mut random, correlated));
            worst = worst.max(residual::<2, 3>(&mut random, correlated));
            worst = worst.max(residual::<3, 6>(&mut random, correlated));
            worst = worst.max(residual::<6, 21>(&mut random, correlated));
            worst = worst.max(residual::<15, 120>(&mut random, correlated));
        }
        // Each axis is turned until its angle against every other is below 8192 ε = 1.8e-12: up to 14 of them, and the
        // root of the condition of P0 (up to 30) for correlated priors.
        assert!(worst < 5e-11, "{worst:e}");
    }
}

/// Eigenvalues of T of one P in f32 and f64, with and without directions.
fn both(p: &Dense15, p0: Option<&Dense15>) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let wide = Covariance15::from_matrix(p).unwrap();
    let narrow = Covariance15::from_matrix(&p.map(|x| x as f32)).unwrap();
    let wide0 = p0.map(|p0| Covariance15::from_matrix(p0).unwrap());
    let narrow0 = p0.map(|p0| Covariance15::from_matrix(&p0.map(|x| x as f32)).unwrap());
    let mut a = Spectrum15::<f64, ValuesOnly>::new();
    let prior = wide0.as_ref().map_or(Prior::Independent, Prior::Correlated);
    a.start_accuracy(&wide, prior, ALL).unwrap();
    assert_eq!(a.step(ALL), Ok(Progress::Done));
    let prior = narrow0
        .as_ref()
        .map_or(Prior::Independent, Prior::Correlated);
    let mut b = Spectrum15::<f32, ValuesOnly>::new();
    b.start_accuracy(&narrow, prior, ALL).unwrap();
    assert_eq!(b.step(ALL), Ok(Progress::Done));
    let mut c = Spectrum15::<f32, Directions<f32, 15>>::new();
    c.start_accuracy(&narrow, prior, ALL).unwrap();
    assert_eq!(c.step(ALL), Ok(Progress::Done));
    (values(&a), values(&b), values(&c))
}

/// The golden configurations, and P of each at interesting times with P0, in σ0 units.
fn alignments(mut each: impl FnMut(&str, &Config, &twin::Step, &Dense15, &Dense15)) {
    let file: serde_json::Value =
        serde_json::from_str(include_str!("../golden/lu2009.json")).unwrap();
    for (name, entry) in file["configs"].as_object().unwrap() {
        let mut cfg = entry["cfg"].clone();
        for key in ["sigma0", "constants", "nondiag_P0_corr_pairs"] {
            cfg[key] = file[key].clone();
        }
        let config: Config = serde_json::from_value(cfg).unwrap();
        let unit = Dense15::from_diagonal(&SVector::from(config.sigma0.map(|s| 1.0 / s)));
        let p0 = unit * twin::p0(&config) * unit;
        for case in [1, 2] {
            twin::run(&config, case, |step| {
                if [1.0, 10.0, 100.0, 300.0, 303.0, 310.0, 400.0, 600.0].contains(&step.t) {
                    let p = unit * step.p * unit;
                    let what = format!("{name}/{case}/{}", step.t);
                    each(&what, &config, step, &((p + p.transpose()) * 0.5), &p0);
                }
            });
        }
    }
}

#[test]
fn single_precision_holds_eight_decades() {
    let (mut worst, mut deep) = (0.0f64, 0.0f64);
    alignments(|what, config, _, p, p0| {
        let p0 = (config.p0 != "paper").then_some(p0);
        let (exact, narrow, with_axes) = both(p, p0);
        for ((exact, a), b) in exact.iter().zip(&narrow).zip(&with_axes) {
            let error = (a / exact - 1.0).abs().max((b / exact - 1.0).abs());
            if *exact >= 3e-8 {
                // the bound that is documented
                assert!(error <= 2e-3, "{what}: {exact:e} off by {error:e}");
                worst = worst.max(error);
            } else {
                deep = deep.max(error);
            }
        }
    });
    println!("f32 eigenvalues of T above 3e-8: {worst:.1e}; below, down to 2.5e-9: {deep:.1e}");
    // below: the correlation matrix of P has a condition of 1e5 there, and 6e-8 of that is what rounding P costs
    assert!(deep < 3e-2);
}

#[test]
fn single_precision_of_m_is_a_hundred_thousandth_of_its_largest_term() {
    let mut worst = 0.0f64;
    alignments(|_, config, step, p, _| {
        if config.p0 != "paper" {
            return;
        }
        let up = Dense15::from_diagonal(&SVector::from(config.sigma0));
        let down = Dense15::from_diagonal(&SVector::from(config.sigma0.map(|s| 1.0 / s)));
        let (f, q) = (down * step.f * up, down * down * step.q);
        let mut h = SMatrix::<f64, 4, 15>::zeros();
        let mut r_t = [1.0; 4];
        for (m, (state, r)) in step.rows.iter().enumerate() {
            h[(m, *state)] = -1.0;
            r_t[m] = r * config.interval / config.sigma0[*state].powi(2);
        }
        let wide = DecreaseRate15::riccati(
            &Covariance15::from_matrix(p).unwrap(),
            &f,
            &q,
            &Information {
                h: Observation::Dense(h),
                r_t,
            },
        );
        let narrow = DecreaseRate15::riccati(
            &Covariance15::from_matrix(&p.map(|x| x as f32)).unwrap(),
            &f.map(|x| x as f32),
            &q.map(|x| x as f32),
            &Information {
                h: Observation::Dense(h.map(|x| x as f32)),
                r_t: r_t.map(|x| x as f32),
            },
        );
        let mut a = Spectrum15::<f64, ValuesOnly>::new();
        a.start_speed(&wide, Prior::Independent, ALL).unwrap();
        assert_eq!(a.step(ALL), Ok(Progress::Done));
        let mut b = Spectrum15::<f32, ValuesOnly>::new();
        b.start_speed(&narrow, Prior::Independent, ALL).unwrap();
        assert_eq!(b.step(ALL), Ok(Progress::Done));
        // largest sum of absolute terms of any element of −Ṗ
        let fp = f.abs() * p.abs();
        let mut terms = fp + fp.transpose() + Dense15::from_diagonal(&q);
        for (m, (state, _)) in step.rows.iter().enumerate() {
            let column = p.column(*state).abs();
            terms += column * column.transpose() / r_t[m];
        }
        let scale = terms.amax();
        for (a, b) in values(&a).iter().zip(values(&b)) {
            worst = worst.max((a - b).abs() / scale);
        }
    });
    println!("f32 eigenvalues of M: {worst:.1e} of the largest term");
    // a rotation is left out when it would move a value by less than 100 ε = 1.2e-5 of it; rounding is far below
    assert!(worst < 1.2e-5, "{worst:e}");
}

/// The bits of all that a finished spectrum says.
fn bits(s: &Spectrum15<'_, f32, Directions<f32, 15>>) -> Vec<u32> {
    let mut bits = Vec::new();
    for k in 0..s.len() {
        bits.push(s.value(k).unwrap().to_bits());
        let d = s.direction(k).unwrap();
        bits.extend(d.vector.iter().map(|x| x.to_bits()));
        bits.extend([d.first as u32, d.dimension as u32]);
    }
    bits
}

type Narrow = Spectrum15<'static, f32, Directions<f32, 15>>;

#[test]
fn slices_and_one_shot_are_the_same_bits_and_no_slice_exceeds_its_budget() {
    let mut seen = 0;
    alignments(|what, _, _, p, p0| {
        if !what.ends_with("/600") {
            return;
        }
        seen += 1;
        let p = Covariance15::from_matrix(&p.map(|x| x as f32)).unwrap();
        let p0 = Covariance15::from_matrix(&p0.map(|x| x as f32)).unwrap();
        for prior in [Prior::Independent, Prior::Correlated(&p0)] {
            let fresh = || {
                let mut s = Spectrum15::<f32, Directions<f32, 15>>::new();
                s.start_accuracy(&p, prior, ALL).unwrap();
                s
            };
            let mut whole = fresh();
            assert_eq!(whole.step(ALL), Ok(Progress::Done));
            let want = bits(&whole);
            // all the work there is: the smallest budget that does it in one step
            let (mut low, mut high) = (0, 1 << 24);
            while high - low > 1 {
                let middle = (low + high) / 2;
                if fresh().step(middle) == Ok(Progress::Done) {
                    high = middle;
                } else {
                    low = middle;
                }
            }
            for budget in [Narrow::SMALLEST_BUDGET, 333, SLICE, 1000, 5000] {
                let mut s = fresh();
                let mut slices = 1;
                while s.step(budget).unwrap() == Progress::Working {
                    slices += 1;
                    // a budget that cannot be kept is refused and changes nothing
                    assert_eq!(s.step(Narrow::SMALLEST_BUDGET - 1), Err(Error::OutOfRange));
                }
                assert_eq!(bits(&s), want, "{what}, budget {budget}");
                // had one slice done more than its budget, fewer would have been enough
                assert!(
                    slices * budget >= high,
                    "{slices} slices of {budget} for {high}"
                );
            }
        }
    });
    assert_eq!(seen, 10);
}

#[test]
fn states_without_prior_have_no_share() {
    let mut random = Random(5);
    let p = random.spd::<6>();
    let keep = [0usize, 2, 3, 5];
    let sub = SMatrix::<f64, 4, 4>::from_fn(|i, j| p[(keep[i], keep[j])]);
    let mask = keep.iter().fold(0, |mask, i| mask | 1 << i);
    let mut full = p;
    // known exactly: legal for a state without prior
    for i in [1, 4] {
        full.row_mut(i).fill(0.0);
        full.column_mut(i).fill(0.0);
    }
    let packed = Covariance::<f64, 6, 21>::from_matrix(&full).unwrap();
    let small = Covariance::<f64, 4, 10>::from_matrix(&sub).unwrap();
    let mut a = Full::<f64, 6, 21>::new();
    let mut b = Full::<f64, 4, 10>::new();
    assert_eq!(
        a.start_accuracy(&packed, Prior::Independent, ALL),
        Err(Error::Variance { state: 1 })
    );
    a.start_accuracy(&packed, Prior::Independent, mask).unwrap();
    b.start_accuracy(&small, Prior::Independent, ALL).unwrap();
    assert_eq!(a.step(ALL), Ok(Progress::Done));
    assert_eq!(b.step(ALL), Ok(Progress::Done));
    assert_eq!(a.len(), 4);
    for k in 0..4 {
        assert_eq!(a.value(k), b.value(k));
        let (x, y) = (
            a.direction(k).unwrap().vector,
            b.direction(k).unwrap().vector,
        );
        assert_eq!(keep.map(|i| x[i]), y);
        assert_eq!((x[1], x[4]), (0.0, 0.0));
    }
    // nobody has a prior: nothing to say, and no failure
    a.start_accuracy(&packed, Prior::Independent, 0).unwrap();
    assert_eq!(a.step(ALL), Ok(Progress::Done));
    assert!(a.is_empty() && a.value(0).is_none());
}

#[test]
fn what_is_not_positive_is_refused_and_named() {
    let mut s = Full::<f32, 3, 6>::new();
    assert_eq!(s.step(ALL), Err(Error::OutOfRange), "nothing was started");
    let one = Covariance::<f32, 3, 6>::from_diagonal(&[1.0; 3]).unwrap();
    // a perfect correlation of states 0 and 2: singular, on the border of what a covariance may be
    let mut m = SMatrix::<f32, 3, 3>::identity();
    (m[(0, 2)], m[(2, 0)]) = (1.0, 1.0);
    let singular = Covariance::<f32, 3, 6>::from_matrix(&m).unwrap();
    s.start_accuracy(&singular, Prior::Independent, ALL)
        .unwrap();
    assert_eq!(s.step(ALL), Err(Error::NotPositive { row: 2 }));
    assert_eq!(
        s.step(ALL),
        Err(Error::OutOfRange),
        "it has to be started again"
    );
    assert_eq!(s.value(0), None);
    let mut s = Spectrum::<f32, 3, 6, ValuesOnly>::new();
    s.start_accuracy(&one, Prior::Correlated(&singular), ALL)
        .unwrap();
    assert_eq!(s.step(ALL), Err(Error::NotPositive { row: 2 }));
    let rate = |x: f32| {
        let information = Information::<f32, 0, 3> {
            h: Observation::Direct { first: 0 },
            r_t: [],
        };
        DecreaseRate::riccati(&one, &SMatrix::zeros(), &SVector::repeat(x), &information)
    };
    s.start_speed(&rate(1.0), Prior::Correlated(&singular), ALL)
        .unwrap();
    assert_eq!(s.step(ALL), Err(Error::NotPositive { row: 2 }));
    assert_eq!(
        s.start_speed(&rate(f32::NAN), Prior::Independent, ALL),
        Err(Error::NonFinite)
    );
    // after all that it still works
    s.start_accuracy(&one, Prior::Independent, ALL).unwrap();
    assert_eq!(s.step(ALL), Ok(Progress::Done));
    assert_eq!(values(&s), [1.0; 3]);
    assert_eq!(s.direction(0), None, "values only");
}

#[test]
fn close_eigenvalues_are_a_plane() {
    let p = Covariance::<f64, 4, 10>::from_diagonal(&[1.0, 0.5, 1.0 + 5e-4, 0.5 * (1.0 + 2e-3)])
        .unwrap();
    let mut s = Full::<f64, 4, 10>::new();
    s.start_accuracy(&p, Prior::Independent, ALL).unwrap();
    assert_eq!(s.step(ALL), Ok(Progress::Done));
    let group = |k| {
        let d = s.direction(k).unwrap();
        (d.first, d.dimension)
    };
    assert_eq!(
        [group(0), group(1), group(2), group(3)],
        [(0, 1), (1, 1), (2, 2), (2, 2)]
    );
}

#[test]
fn a_change_of_units_and_of_order_changes_nothing_else() {
    let mut random = Random(7);
    let (p, p0) = (random.spd::<6>(), random.spd::<6>());
    let run = |p: &SMatrix<f64, 6, 6>, p0: &SMatrix<f64, 6, 6>| {
        let half = |m: &SMatrix<f64, 6, 6>| {
            Covariance::<f64, 6, 21>::from_matrix(&((m + m.transpose()) * 0.5)).unwrap()
        };
        let (p, p0) = (half(p), half(p0));
        let mut s = Spectrum::<f64, 6, 21, Directions<f64, 6>>::new();
        s.start_accuracy(&p, Prior::Correlated(&p0), ALL).unwrap();
        assert_eq!(s.step(ALL), Ok(Progress::Done));
        let directions: Vec<_> = (0..6).map(|k| s.direction(k).unwrap().vector).collect();
        (values(&s), directions)
    };
    let (want, directions) = run(&p, &p0);
    let unit =
        SMatrix::<f64, 6, 6>::from_diagonal(&SVector::from([1e3, 1.0, 57.3, 0.3048, 1e-3, 9.8]));
    let (scaled, _) = run(&(unit * p * unit), &(unit * p0 * unit));
    let order = [3, 5, 0, 1, 4, 2];
    let swap = |m: &SMatrix<f64, 6, 6>| SMatrix::from_fn(|i, j| m[(order[i], order[j])]);
    let (swapped, moved) = run(&swap(&p), &swap(&p0));
    for k in 0..6 {
        // condition of P0 below 1e3
        assert!((scaled[k] / want[k] - 1.0).abs() < 1e-12);
        assert!((swapped[k] / want[k] - 1.0).abs() < 1e-12);
        for i in 0..6 {
            assert!((moved[k][i] - directions[k][order[i]]).abs() < 1e-9);
        }
    }
}
