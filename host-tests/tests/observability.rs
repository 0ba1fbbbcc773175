//! ξ and η: systems known on paper, states that cannot be seen by construction, units, and the promises about slices.

use host_tests::reference::random::Random;
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2};
use navsight::covariance::{Covariance, Covariance15, Observation, Rows};
use navsight::error::Error;
use navsight::filter::{Filter, Prior as Start, Settings};
use navsight::linalg::Real;
use navsight::observability::diagonal::{xi1, xi1_riccati, xi1_riccati_blocks, xi2, Xi};
use navsight::observability::riccati::{DecreaseRate, Information};

const ALL: u32 = u32::MAX;

/// A position that starts at 1, a velocity that starts at 1, measured positions of variance r every T.
/// Known on paper: the Kalman filter of a straight line through points.
fn straight_line<T: Real>(r: f64, interval: f64, steps: usize) -> (Covariance<T, 2, 3>, [T; 2]) {
    let mut p = Covariance::<T, 2, 3>::from_diagonal(&[T::one(); 2]).unwrap();
    let a = SMatrix::<T, 2, 2>::new(T::zero(), T::of(interval), T::zero(), T::zero());
    let mut decrease = [T::zero(); 2];
    for _ in 0..steps {
        p.propagate(&a, &SVector::zeros());
        decrease = p
            .update(&Rows {
                nu: [T::zero()],
                h: Observation::Direct { first: 0 },
                r: [T::of(r)],
                gate: None,
            })
            .unwrap()
            .decrease;
    }
    (p, decrease)
}

#[test]
fn a_line_through_points_is_learnt_as_on_paper() {
    // Least squares with a prior of 1 on both: information = I + Σ h hᵀ/r with h = (1, (k − n) T) at the last time.
    let (r, interval, n) = (0.5, 0.1, 20);
    let mut information = Matrix2::identity();
    // the prior is one on the state at time 0, which is x(n) − n T v
    let back = Matrix2::new(1.0, -(n as f64) * interval, 0.0, 1.0);
    information = back.transpose() * information * back;
    let mut before = information;
    for k in 1..=n {
        let h = Vector2::new(1.0, (k as f64 - n as f64) * interval);
        if k == n {
            before = information;
        }
        information += h * h.transpose() / r;
    }
    let (after, before) = (
        information.try_inverse().unwrap(),
        before.try_inverse().unwrap(),
    );
    let (p, decrease) = straight_line::<f64>(r, interval, n);
    let xi2 = xi2(&p.diagonal(), ALL).unwrap();
    let xi1 = xi1(&decrease, interval, ALL).unwrap();
    for i in 0..2 {
        // rounding of twenty steps in double precision
        assert!((xi2.get(i).unwrap() * after[(i, i)] - 1.0).abs() < 1e-13);
        let taken = (before[(i, i)] - after[(i, i)]) / interval;
        assert!((xi1.get(i).unwrap() / taken - 1.0).abs() < 1e-11, "{taken}");
    }
    assert_eq!(xi2.get(2), None);
}

#[test]
fn a_scalar_follows_both_forms_of_the_speed() {
    // ṗ = q − p²/(R T) on paper; the exact form is larger by (R + p⁻)/R.
    let (q, r, interval) = (0.3, 2.0, 0.25);
    let mut p = Covariance::<f64, 1, 1>::from_diagonal(&[1.0]).unwrap();
    p.propagate(&SMatrix::zeros(), &SVector::<f64, 1>::new(q * interval));
    let before = 1.0 + q * interval;
    let update = p
        .update(&Rows {
            nu: [0.0],
            h: Observation::Direct { first: 0 },
            r: [r],
            gate: None,
        })
        .unwrap();
    let after = before * r / (before + r);
    let exact = xi1(&update.decrease, interval, 1).unwrap().get(0).unwrap();
    assert!((exact - (before - after) / interval).abs() < 1e-15);
    let information = Information {
        h: Observation::Direct { first: 0 },
        r_t: [r * interval],
    };
    let speed = |information| {
        xi1_riccati(
            &p,
            &SMatrix::zeros(),
            &SVector::<f64, 1>::new(q),
            information,
            1,
        )
    };
    let riccati = speed(Some(&information)).get(0).unwrap();
    assert!((riccati - (after * after / (r * interval) - q)).abs() < 1e-15);
    let measured = riccati + q;
    assert!((exact / measured - (r + before) / r).abs() < 1e-14);
    assert_eq!(speed(None).get(0), None);
}

#[test]
fn a_state_that_nothing_touches_is_not_seen() {
    // State 2 is not measured, moves nothing and is moved by nothing.
    let mut p = Covariance::<f32, 3, 6>::from_diagonal(&[1.0; 3]).unwrap();
    let a = Matrix3::new(0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for _ in 0..1000 {
        p.propagate(&a, &SVector::zeros());
        let update = p
            .update(&Rows {
                nu: [0.0],
                h: Observation::Direct { first: 0 },
                r: [0.01],
                gate: None,
            })
            .unwrap();
        assert_eq!(xi1(&update.decrease, 0.1, ALL).unwrap().get(2), Some(0.0));
        assert_eq!(xi2(&update.p_after, ALL).unwrap().get(2), Some(1.0));
    }
    assert!(xi2(&p.diagonal(), ALL).unwrap().get(1).unwrap() > 1e4);
}

#[test]
fn what_cannot_be_said_is_not_said() {
    // no prior: not available, whatever the variance; one that is still 0 is legal
    let some = xi2(&[0.5f32, 0.0, 2.0], 0b101).unwrap();
    assert_eq!(some.all(), [Some(2.0), None, Some(0.5)]);
    assert_eq!(some.available(), 0b101);
    // unknown interval
    for interval in [0.0f32, -1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(xi1(&[0.1], interval, 1).unwrap().all(), [None]);
    }
    // a broken filter is a fault, never a number
    for broken in [0.0, -1e-9, f32::NAN, f32::INFINITY] {
        assert_eq!(
            xi2(&[1.0, broken], 0b11).err(),
            Some(Error::Variance { state: 1 }),
            "{broken}"
        );
    }
    for broken in [-1e-9, f32::NAN, f32::INFINITY] {
        assert_eq!(
            xi2(&[1.0, broken], 0b01).err(),
            Some(Error::Variance { state: 1 }),
            "{broken}"
        );
        assert_eq!(
            xi1(&[0.0, 0.0, broken], 1.0, 0b111).err(),
            Some(Error::Variance { state: 2 }),
            "{broken}"
        );
    }
}

#[test]
fn the_riccati_rate_is_the_equation() {
    let mut random = Random(1);
    let p0 = random.spd::<5>();
    let p = Covariance::<f64, 5, 15>::from_matrix(&p0).unwrap();
    let f = SMatrix::<f64, 5, 5>::from_fn(|_, _| random.uniform());
    let q = SVector::<f64, 5>::from_fn(|_, _| random.uniform().abs());
    let h = SMatrix::<f64, 2, 5>::from_fn(|_, _| random.uniform());
    let r_t = [0.3, 0.7];
    let dense = Information {
        h: Observation::Dense(h),
        r_t,
    };
    let weight = SMatrix::<f64, 2, 2>::from_diagonal(&Vector2::new(1.0 / 0.3, 1.0 / 0.7));
    let want = -(f * p0 + p0 * f.transpose() + SMatrix::from_diagonal(&q)
        - p0 * h.transpose() * weight * h * p0);
    let rate = DecreaseRate::riccati(&p, &f, &q, &dense);
    for i in 0..5 {
        for j in 0..5 {
            // a few dozen products of numbers up to 30
            assert!((rate.element(i, j) - want[(i, j)]).abs() < 1e-12);
        }
    }
    let index = xi1_riccati(&p, &f, &q, Some(&dense), ALL);
    for i in 0..5 {
        assert!((index.get(i).unwrap() - want[(i, i)]).abs() < 1e-12);
        assert_eq!(rate.diagonal()[i], rate.element(i, i));
    }
    // rows that measure a state directly are dense rows with −1
    let mut h = SMatrix::<f64, 2, 5>::zeros();
    (h[(0, 2)], h[(1, 3)]) = (-1.0, -1.0);
    let dense = Information {
        h: Observation::Dense(h),
        r_t,
    };
    let direct = Information::<f64, 2, 5> {
        h: Observation::Direct { first: 2 },
        r_t,
    };
    let (a, b) = (
        DecreaseRate::riccati(&p, &f, &q, &dense),
        DecreaseRate::riccati(&p, &f, &q, &direct),
    );
    let (c, d) = (
        xi1_riccati(&p, &f, &q, Some(&dense), ALL),
        xi1_riccati(&p, &f, &q, Some(&direct), ALL),
    );
    for i in 0..5 {
        assert!((c.get(i).unwrap() - d.get(i).unwrap()).abs() < 1e-12);
        for j in 0..5 {
            assert!((a.element(i, j) - b.element(i, j)).abs() < 1e-12);
        }
    }
}

#[test]
fn the_block_form_is_the_general_form() {
    let mut random = Random(2);
    let p = Covariance15::from_matrix(&random.spd::<15>()).unwrap();
    let mut rates = navsight::linalg::BlockTransition::<f64>::identity();
    for m in [
        &mut rates.a00,
        &mut rates.a11,
        &mut rates.a12,
        &mut rates.a14,
        &mut rates.a22,
        &mut rates.a23,
    ] {
        *m = Matrix3::from_fn(|_, _| random.uniform());
    }
    rates.a01 = SVector::from_fn(|_, _| random.uniform());
    rates.a10 = SVector::from_fn(|_, _| random.uniform());
    (rates.a33, rates.a44) = (-0.3, -0.7);
    rates.q = core::array::from_fn(|_| random.uniform().abs());
    let information = Information::<f64, 3, 15> {
        h: Observation::Direct { first: 3 },
        r_t: [0.2, 0.3, 0.4],
    };
    let (f, q) = (rates.dense(), rates.noise());
    let general = DecreaseRate::riccati(&p, &f, &q, &information);
    let blocks = DecreaseRate::blocks(&p, &rates, &information);
    let diagonal = xi1_riccati_blocks(&p, &rates, Some(&information), ALL);
    for i in 0..15 {
        // the same few dozen products in another order
        assert!((diagonal.get(i).unwrap() - general.element(i, i)).abs() < 1e-11);
        for j in 0..15 {
            assert!((blocks.element(i, j) - general.element(i, j)).abs() < 1e-11);
        }
    }
}

/// A filter at a standstill and one zero-velocity update a second.
fn aligned(seconds: usize, prior: &Start) -> (Filter, navsight::filter::UpdateReport<3>) {
    use navsight::attitude::Euler;
    use navsight::earth::Geodetic;
    use navsight::error_model::{BiasModel, NoiseDensity};
    use navsight::imu::{ImuIncrement, ImuLimits};
    use navsight::measurement::ZeroVelocity;
    let at = Geodetic::from_degrees(40.0, 116.0, 50.0);
    let attitude = Euler::from_degrees(0.0, 0.0, 0.0);
    let nav = navsight::nav::NavState::new(at, nalgebra::Vector3::zeros(), attitude).unwrap();
    let settings = Settings {
        limits: ImuLimits::default(),
        noise: NoiseDensity::from_random_walks(1e-4, 1e-8),
        bias: BiasModel::constant(),
        propagation_interval: 0.1,
        gate: None,
    };
    let mut filter = Filter::new(nav, prior, settings).unwrap();
    let local = filter.nav().local();
    let rate = local.omega_ie_n();
    let mut report = None;
    for _ in 0..seconds {
        for _ in 0..10 {
            let imu = ImuIncrement {
                delta_theta_b: rate * 0.1,
                delta_v_b: nalgebra::Vector3::new(0.0, 0.0, local.gravity * 0.1),
                dt: 0.1,
            };
            filter.propagate(&imu).unwrap();
        }
        let z = ZeroVelocity::new(1e-3, 1.0)
            .unwrap()
            .linearize(filter.nav());
        report = Some(filter.update(&z).unwrap());
    }
    (filter, report.unwrap())
}

fn prior() -> Start {
    let rad = core::f32::consts::PI / 180.0;
    Start {
        position: [10.0; 3],
        velocity: [0.15; 3],
        attitude: [0.5 * rad, 0.5 * rad, 2.0 * rad],
        gyro_bias: [0.02 * rad / 3600.0; 3],
        accel_bias: [9.8e-4; 3],
    }
}

#[test]
fn a_report_holds_all_that_xi_needs() {
    let mut known = prior();
    known.accel_bias[2] = 0.0; // an instrument that is taken for perfect
    let (filter, report) = aligned(60, &known);
    let xi = Xi::of(&report).unwrap();
    assert_eq!(xi.xi1.available(), 0x7fff & !(1 << 14));
    assert_eq!(xi.xi2.get(14), None);
    for i in 0..14 {
        let (fast, far) = (xi.xi1.get(i).unwrap(), xi.xi2.get(i).unwrap());
        assert_eq!(far, 1.0 / filter.covariance().variance(i));
        // ξ1 T is what the update took; never more than there was
        assert!(fast >= 0.0 && fast * report.interval <= report.p_before[i]);
    }
    // levelling: half a degree against 100 µg is 7616 at the most (phi angle of a level vehicle: tilt = b/g)
    let tilt = xi.xi2.get(6).unwrap();
    assert!((5000.0..7700.0).contains(&tilt), "{tilt}");
    // the east gyro hides behind the heading, the accelerometers behind the tilts: 1.00 to a few percent
    for i in [9, 12, 13] {
        assert!((1.0..1.1).contains(&xi.xi2.get(i).unwrap()));
    }
}

#[test]
fn the_speed_of_a_report_is_the_riccati_speed_of_its_filter() {
    let (filter, report) = aligned(300, &prior());
    let mut z = navsight::measurement::ZeroVelocity::new(1e-3, 1.0)
        .unwrap()
        .linearize(filter.nav());
    let information = Information::of(&z, filter.sigma0()).unwrap();
    let f_n = nalgebra::Vector3::new(0.0, 0.0, filter.nav().local().gravity);
    let rates = navsight::error_model::block_rates(
        &filter.environment(),
        &filter.nav().c_b_n(),
        &f_n,
        filter.scaling(),
    );
    let index = xi1_riccati_blocks(
        filter.covariance(),
        &rates,
        Some(&information),
        u32::from(report.normalised),
    );
    let exact = Xi::of(&report).unwrap().xi1;
    // the north gyro: little process noise and a small decrease a second, where the two forms meet. p⁻/R is below 1 %
    // in its row, the rest is one second of change.
    let (a, b) = (index.get(10).unwrap(), exact.get(10).unwrap());
    assert!((a / b - 1.0).abs() < 0.25, "{a:e} {b:e}");
    // without an interval there is no rate
    z.interval = 0.0;
    assert_eq!(Information::of(&z, filter.sigma0()), None);
}

#[test]
fn xi_does_not_depend_on_units() {
    // A filter in σ0 units forgets SI; so the units can only come in with the priors: metres or feet, radians or
    // degrees. Scaled state by state through the general kernel, ξ must not move.
    let (p, decrease) = straight_line::<f64>(0.5, 0.1, 20);
    let mut scaled = Covariance::<f64, 2, 3>::from_diagonal(&[1.0; 2]).unwrap();
    // position in units of 0.3048, velocity in units of 57.3: σ0 follows, so in σ0 units A_01 = T σ_v/σ_r is the same
    let (position, velocity) = (1.0 / 0.3048, 57.3);
    let coupling = 0.1 * position / velocity; // A in the new units
    let (sigma_r, sigma_v) = (position, velocity); // σ0 in the new units
    let a = Matrix2::new(0.0, coupling * sigma_v / sigma_r, 0.0, 0.0);
    let mut last = [0.0; 2];
    for _ in 0..20 {
        scaled.propagate(&a, &SVector::zeros());
        last = scaled
            .update(&Rows {
                nu: [0.0],
                h: Observation::Direct { first: 0 },
                r: [0.5 * position * position / (sigma_r * sigma_r)],
                gate: None,
            })
            .unwrap()
            .decrease;
    }
    for i in 0..2 {
        assert!((scaled.variance(i) / p.variance(i) - 1.0).abs() < 1e-14);
        assert!((last[i] / decrease[i] - 1.0).abs() < 1e-12);
    }
}
