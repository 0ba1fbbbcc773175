//! The filter as its user meets it: what it refuses, that it stays as it was then, and what a start means.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{BiasModel, NoiseDensity, BG, N, VEL};
use navsight::filter::{Filter, Prior, Settings, MAX_STEP};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::{
    Accuracy, Antenna, Height, Jacobian, Linearized, Position, PositionVelocity, Velocity,
    ZeroVelocity,
};
use navsight::nav::NavState;

const DEG: f32 = core::f32::consts::PI / 180.0;
const DT: f32 = 0.01;

fn settings() -> Settings {
    let bias = BiasModel::from_correlation_times(3600.0, 3600.0).unwrap();
    Settings {
        limits: ImuLimits::DEFAULT,
        noise: NoiseDensity::from_random_walks(1e-3, 3e-5)
            .with_stationary_biases(&bias, [1e-4; 3], [1e-2; 3]),
        bias,
        propagation_interval: 0.1,
        gate: Some(25.0),
    }
}

fn prior() -> Prior {
    Prior {
        position: [5.0; 3],
        velocity: [0.5; 3],
        attitude: [DEG, DEG, 5.0 * DEG],
        gyro_bias: [1e-4; 3],
        accel_bias: [1e-2; 3],
    }
}

fn tilted() -> NavState {
    let at = Geodetic::from_degrees(34.0, -120.0, 50.0);
    let attitude = Euler::from_degrees(130.0, 20.0, -35.0);
    NavState::new(at, Vector3::new(3.0, -2.0, 0.5), attitude).unwrap()
}

/// A sample of gentle motion, different every time.
fn sample(k: u32) -> ImuIncrement {
    let x = (k as f32 * 0.7).sin();
    ImuIncrement::from_rates(
        Vector3::new(0.02 * x, -0.01, 0.03),
        Vector3::new(5.0 + 0.2 * x, 3.0, 7.5),
        DT,
    )
}

/// A filter in the middle of its work: biases learnt, an interval half gathered.
fn running() -> Filter {
    let mut filter = Filter::new(tilted(), &prior(), settings()).unwrap();
    for k in 0..257 {
        filter.propagate(&sample(k)).unwrap();
        if k % 100 == 99 {
            let height = Height::new(50.0, 1.0, 1.0).unwrap();
            filter.update(&height.linearize(filter.nav())).unwrap();
        }
    }
    filter
}

/// Every word of the filter, signs of zeros included.
fn bits(filter: &Filter) -> String {
    format!("{filter:?}")
}

#[test]
fn a_refused_sample_leaves_every_bit() {
    let mut filter = running();
    let before = bits(&filter);
    let good = sample(1);
    let mut refused = 0;
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
        for axis in 0..7 {
            let mut imu = good;
            match axis {
                0..3 => imu.delta_theta_b[axis] = bad,
                3..6 => imu.delta_v_b[axis - 3] = bad,
                _ => imu.dt = bad,
            }
            assert!(filter.propagate(&imu).is_err(), "{bad} in field {axis}");
            assert_eq!(bits(&filter), before, "{bad} in field {axis}");
            refused += 1;
        }
    }
    for dt in [0.0, -0.01, 0.6] {
        let imu = ImuIncrement { dt, ..good };
        assert_eq!(filter.propagate(&imu), Err(Error::Time));
        assert_eq!(bits(&filter), before);
        refused += 1;
    }
    assert_eq!(refused, 38);
    assert_eq!(filter.propagate(&good), Ok(()));
    assert_ne!(bits(&filter), before);
}

#[test]
fn a_refused_measurement_leaves_every_bit() {
    let mut filter = running();
    let before = bits(&filter);
    let good = Linearized::<2> {
        nu: SVector::from([0.1, -0.2]),
        h: Jacobian::Dense(SMatrix::from_fn(|i, j| (i + j) as f32 * 0.1 - 0.5)),
        r: SVector::from([0.01, 0.02]),
        interval: 1.0,
    };
    let with_h = |row: usize, col: usize, x: f32| {
        let mut h = SMatrix::<f32, 2, N>::zeros();
        h[(row, col)] = x;
        Jacobian::Dense(h)
    };
    let mut bad = Vec::new();
    for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
        for row in 0..2 {
            let mut nu = good.nu;
            nu[row] = x;
            let mut r = good.r;
            r[row] = x;
            bad.push(Linearized { nu, ..good });
            bad.push(Linearized { r, ..good });
            bad.push(Linearized {
                h: with_h(row, 7, x),
                ..good
            });
        }
    }
    for r in [0.0, -1.0] {
        bad.push(Linearized {
            r: SVector::from([0.01, r]),
            ..good
        });
    }
    for interval in [f32::NAN, f32::INFINITY] {
        bad.push(Linearized { interval, ..good });
    }
    for first in [14, 15, 16, usize::MAX] {
        bad.push(Linearized {
            h: Jacobian::Direct { first },
            ..good
        });
    }
    for (k, measurement) in bad.iter().enumerate() {
        let outcome = filter.update(measurement);
        assert!(
            matches!(outcome, Err(Error::NonFinite | Error::OutOfRange)),
            "{k}: {outcome:?}"
        );
        assert_eq!(bits(&filter), before, "{k}: {measurement:?}");
    }
    assert!(filter.update(&good).is_ok());
    assert_ne!(bits(&filter), before);
}

/// The rows of an antenna have a kernel of their own, which knows where their zeros are. It takes what moves no variance
/// by half, as the eleventh fix does; a first one goes through double words, whoever sent it.
#[test]
fn the_rows_of_an_antenna_do_what_the_same_rows_in_full_do() {
    let correlated = |size: f32| {
        let r = Matrix3::new(4.0, -1.0, 0.5, -1.0, 9.0, 2.0, 0.5, 2.0, 25.0) * size;
        Accuracy::covariance(&r).unwrap()
    };
    let plain = |size: f32| Accuracy::speed(size.sqrt()).unwrap();
    // far off, so that every element of its rows counts
    let antenna = Antenna::new(Vector3::new(60.0, -80.0, 30.0)).unwrap();
    for (of_r, of_v, first_halves) in [
        (plain(4.0), plain(0.04), true),
        (correlated(1.0), correlated(1e-2), true),
        (plain(1.0), correlated(1e-2), true),
        // So poor that no row could halve a variance, whatever stood in it.
        (plain(2.5e3), plain(25.0), false),
    ] {
        let fix = |filter: &Filter| {
            let nav = *filter.nav();
            let (c_b_n, local) = (nav.c_b_n(), nav.local());
            let (o, mut at) = (antenna.offset(&c_b_n), nav.position());
            at.lon += f64::from((o.x + 0.3) / (local.r_n * local.cos_lat));
            at.lat += f64::from((o.y - 0.2) / local.r_m);
            at.height += f64::from(o.z + 0.5);
            let position = Position::with_accuracy(at, of_r, 1.0).unwrap();
            let v = nav.v_n() + antenna.motion(&nav, &c_b_n) + Vector3::new(0.02, -0.01, 0.03);
            let velocity = Velocity::with_accuracy(v, of_v, 1.0).unwrap();
            PositionVelocity::new(position, velocity, antenna).linearize(&nav)
        };
        for (before, held) in [(0, 0), (10, 0), (10, 1 << BG | 1 << VEL)] {
            let mut own = running();
            for _ in 0..before {
                own.update(&fix(&own)).unwrap();
            }
            own.consider(held);
            let mut full = own.clone();
            let rows = fix(&own);
            let dense = Linearized {
                nu: rows.nu,
                h: rows.dense(),
                r: rows.r,
                interval: rows.interval,
            };
            let (a, b) = (own.update(&rows).unwrap(), full.update(&dense).unwrap());
            let halved = (0..N).any(|i| b.p_after[i] < 0.5 * b.p_before[i]);
            assert_eq!(halved, before == 0 && first_halves);
            // six rows of f32 in another order of additions; a variance is compared with itself
            for (a, b) in
                a.s.iter()
                    .chain(&a.p_after)
                    .zip(b.s.iter().chain(&b.p_after))
            {
                assert!((a - b).abs() < 2e-4 * b, "{a} {b}");
            }
            for i in 0..N {
                let sigma = b.p_before[i].sqrt();
                assert!((a.correction[i] - b.correction[i]).abs() < 1e-3 * sigma);
                for j in 0..i {
                    let (p, q) = (own.covariance(), full.covariance());
                    let scale = (q.variance(i) * q.variance(j)).sqrt();
                    let off = (p.element(i, j) - q.element(i, j)).abs() / scale;
                    assert!(off < 1e-3, "({i}, {j}): {off:e}");
                }
            }
        }
    }
}

#[test]
fn a_correction_that_the_state_does_not_accept_is_refused() {
    // A velocity that is wrong by half the speed of light: it passes the door, but not the nominal state.
    let settings = Settings {
        gate: None,
        ..settings()
    };
    let mut filter = Filter::new(tilted(), &prior(), settings).unwrap();
    let before = bits(&filter);
    let absurd = Linearized::<3> {
        nu: SVector::from([1.5e8, 0.0, 0.0]),
        h: Jacobian::Direct { first: VEL },
        r: SVector::from([1.0; 3]),
        interval: 1.0,
    };
    assert_eq!(filter.update(&absurd), Err(Error::OutOfRange));
    assert_eq!(bits(&filter), before);
}

#[test]
fn a_gated_row_teaches_nothing_and_is_reported() {
    let mut filter = running();
    filter.synchronize();
    let before = bits(&filter);
    let height = Height::new(5000.0, 1.0, 1.0).unwrap();
    let report = filter.update(&height.linearize(filter.nav())).unwrap();
    assert_eq!(report.accepted, [false]);
    assert_eq!(report.rows_accepted(), 0);
    assert_eq!(report.nis, 0.0);
    assert!(report.row_nis[0] > 25.0);
    assert_eq!(report.p_before, report.p_after);
    assert_eq!(bits(&filter), before);
}

#[test]
fn impossible_starts_are_refused() {
    let start = |prior: Prior, settings: Settings| Filter::new(tilted(), &prior, settings).err();
    assert_eq!(start(prior(), settings()), None);
    for bad in [f32::NAN, f32::INFINITY] {
        let prior = Prior {
            gyro_bias: [1e-4, bad, 1e-4],
            ..prior()
        };
        assert_eq!(start(prior, settings()), Some(Error::NonFinite));
        let settings = Settings {
            propagation_interval: bad,
            ..settings()
        };
        assert_eq!(start(self::prior(), settings), Some(Error::NonFinite));
    }
    for bad in [-1.0, 1e30, 1e-30] {
        let prior = Prior {
            velocity: [bad; 3],
            ..prior()
        };
        assert_eq!(start(prior, settings()), Some(Error::OutOfRange), "{bad}");
    }
    for interval in [0.0, -0.1, 11.0] {
        let settings = Settings {
            propagation_interval: interval,
            ..settings()
        };
        assert_eq!(start(prior(), settings), Some(Error::OutOfRange));
    }
    for gate in [0.0, -1.0] {
        let settings = Settings {
            gate: Some(gate),
            ..settings()
        };
        assert_eq!(start(prior(), settings), Some(Error::OutOfRange));
    }
}

#[test]
fn a_full_prior_starts_as_its_diagonal_one() {
    // The same filter by both doors; only the rounding of the roots may differ, 2⁻²³ of a σ0.
    let sigma0 = prior().sigma0().unwrap();
    let p0 = SMatrix::<f32, N, N>::from_diagonal(&SVector::from(sigma0.map(|s| s * s)));
    let mut a = Filter::new(tilted(), &prior(), settings()).unwrap();
    let mut b = Filter::with_covariance(tilted(), &p0, settings()).unwrap();
    let zero = ZeroVelocity::new(0.1, 1.0).unwrap();
    for k in 0..300 {
        for filter in [&mut a, &mut b] {
            filter.propagate(&sample(k)).unwrap();
            if k % 100 == 99 {
                filter.update(&zero.linearize(filter.nav())).unwrap();
            }
        }
    }
    for i in 0..N {
        let (a, b) = (a.sigma(i).unwrap(), b.sigma(i).unwrap());
        // 300 steps and nine rows, each rounding once: far below 1e-5 when the two starts mean the same.
        assert!((a / b - 1.0).abs() < 1e-5, "state {i}: {a} {b}");
    }
    // a correlation of 1.5 between two states cannot be
    let mut broken = p0;
    broken[(VEL, BG)] = 1.5 * sigma0[VEL] * sigma0[BG];
    broken[(BG, VEL)] = broken[(VEL, BG)];
    assert!(matches!(
        Filter::with_covariance(tilted(), &broken, settings()),
        Err(Error::NotPositive { .. })
    ));
}

#[test]
fn a_state_known_exactly_stays_known_and_has_no_xi() {
    let prior = Prior {
        gyro_bias: [0.0; 3],
        ..prior()
    };
    let noise = NoiseDensity::from_random_walks(1e-3, 3e-5);
    let settings = Settings {
        noise,
        bias: BiasModel::constant(),
        ..settings()
    };
    let mut filter = Filter::new(tilted(), &prior, settings).unwrap();
    let zero = ZeroVelocity::new(0.1, 1.0).unwrap();
    for k in 0..500 {
        filter.propagate(&sample(k)).unwrap();
        if k % 100 == 99 {
            let report = filter.update(&zero.linearize(filter.nav())).unwrap();
            assert_eq!(report.normalised, 0b111_000_111_111_111);
        }
    }
    for i in BG..BG + 3 {
        assert_eq!(filter.sigma(i), Some(0.0));
    }
    assert_eq!(filter.nav().b_g(), Vector3::zeros());
}

#[test]
fn the_covariance_does_not_depend_on_how_the_interval_is_cut() {
    // A first-order step of length h moves the position with the velocity at its beginning: over t seconds of double
    // integration that is h/t of it, 0.1/20 here. The other states are held by the measurements or stay put; there a
    // step of 0.1 s costs 1e-3 at most (measured, the level). An interval of 10 s is moved in steps of at most 1.5 MAX_STEP, with its
    // mean attitude and force.
    let run = |propagation_interval: f32| {
        let settings = Settings {
            propagation_interval,
            ..settings()
        };
        let mut filter = Filter::new(tilted(), &prior(), settings).unwrap();
        let zero = ZeroVelocity::new(0.1, 1.0).unwrap();
        for k in 0..2000 {
            filter.propagate(&sample(k)).unwrap();
            if k % 100 == 99 {
                filter.update(&zero.linearize(filter.nav())).unwrap();
            }
        }
        filter
    };
    let (fine, coarse, long) = (run(0.02), run(MAX_STEP), run(10.0));
    for i in 0..N {
        let [f, c, l] = [&fine, &coarse, &long].map(|filter| filter.sigma(i).unwrap());
        let bound = if i < VEL { MAX_STEP / 20.0 } else { 2e-3 };
        assert!((c / f - 1.0).abs() < bound, "state {i}: {c} {f}");
        assert!((l / f - 1.0).abs() < 1.5 * bound, "state {i}: {l} {f}");
    }
}
