//! Both error models against finite differences of a navigator that knows no level frame, at tilted, moving, turning
//! states; and the filter's block form against the same.

use host_tests::reference::error_model::{
    c_e_n, errors, estimate, f_by_differences, transition_by_differences, Angle, Earth, Nav, Place,
};
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector3};
use navsight::attitude::Euler;
use navsight::earth::{Geodetic, Local};
use navsight::error::Error;
use navsight::error_model::{
    block_rates, block_transition, block_transition_into, discrete, phi, psi, BiasModel,
    Environment, Interval, NoiseDensity, Scaling, ATT, BA, BG, POS, VEL,
};
use navsight::linalg::BlockTransition;
use navsight::nav::NavState;

type M15 = SMatrix<f64, 15, 15>;

const SPHERE: Earth = Earth::Sphere {
    radius: 6_378_137.0,
    gravity: 9.80,
    omega_ie: 7.292_115e-5,
};

/// A state of motion: where, how fast, how tilted, and what the axes feel.
struct State {
    at: Place,
    v_n: Vector3<f64>,
    c_b_n: Matrix3<f64>,
    omega_ib_b: Vector3<f64>,
    f_b: Vector3<f64>,
}

/// Heading, pitch, roll in degrees, as axes turned one after the other (not from the library).
fn attitude(heading: f64, pitch: f64, roll: f64) -> Matrix3<f64> {
    (Rotation3::from_axis_angle(&Vector3::z_axis(), -heading.to_radians())
        * Rotation3::from_axis_angle(&Vector3::x_axis(), pitch.to_radians())
        * Rotation3::from_axis_angle(&Vector3::y_axis(), roll.to_radians()))
    .into_inner()
}

fn states() -> Vec<State> {
    let state =
        |lat: f64, lon: f64, height, v: [f64; 3], att: [f64; 3], w: [f64; 3], f: [f64; 3]| State {
            at: Place {
                lat: lat.to_radians(),
                lon: lon.to_radians(),
                height,
            },
            v_n: v.into(),
            c_b_n: attitude(att[0], att[1], att[2]),
            omega_ib_b: w.into(),
            f_b: f.into(),
        };
    vec![
        // a climbing turn, an inverted dive on the other hemisphere beside the date line, and a fast flight far north
        state(
            45.5,
            12.0,
            3e3,
            [150.0, -220.0, 40.0],
            [30.0, 20.0, -35.0],
            [0.2, -0.1, 0.3],
            [3.0, -4.0, 11.0],
        ),
        state(
            -33.0,
            179.9,
            9e3,
            [-90.0, 160.0, -60.0],
            [250.0, -50.0, 170.0],
            [-0.4, 0.3, 0.1],
            [-6.0, 8.0, 5.0],
        ),
        state(
            72.0,
            -75.0,
            12e3,
            [280.0, 90.0, -25.0],
            [110.0, 5.0, 60.0],
            [0.05, 0.4, -0.2],
            [2.0, 9.0, 14.0],
        ),
    ]
}

fn bias() -> BiasModel<f64> {
    BiasModel::constant() // the decay has a test of its own
}

fn model(angle: Angle, earth: &Earth, s: &State) -> M15 {
    let env = match *earth {
        Earth::Wgs84 => Environment::wgs84(s.at.lat, s.at.height, s.v_n),
        Earth::Sphere {
            radius, omega_ie, ..
        } => Environment::sphere(
            s.at.lat,
            radius + s.at.height,
            earth.gravity(&s.at),
            omega_ie,
            s.v_n,
        ),
    };
    let f_n = s.c_b_n * s.f_b;
    match angle {
        Angle::Psi => psi::f_matrix(&env, &s.c_b_n, &f_n, &bias()),
        Angle::Phi => phi::f_matrix(&env, &s.c_b_n, &f_n, &bias()),
    }
}

/// What a model leaves out on WGS-84: the change of gravity with latitude and its centrifugal change with height, and
/// in the phi-angle model the change of the radii with latitude.
fn left_out(angle: Angle, s: &State) -> M15 {
    let gravity = |north: f64, up: f64| {
        Earth::Wgs84.gravity(&Place {
            lat: s.at.lat + north,
            height: s.at.height + up,
            ..s.at
        })
    };
    let env = Environment::<f64>::wgs84(s.at.lat, s.at.height, s.v_n);
    let mut m = M15::zeros();
    m[(VEL + 2, POS + 1)] = -(gravity(1e-3, 0.0) - gravity(-1e-3, 0.0)) / 2e-3 / env.r_m;
    m[(VEL + 2, POS + 2)] = -(gravity(0.0, 1e3) - gravity(0.0, -1e3)) / 2e3
        - env.gravity * (1.0 / env.r_m + 1.0 / env.r_n);
    if angle == Angle::Phi {
        // dR/dL = n e² sinL cosL R/(1 − e² sin²L), n = 3 for R_M and 1 for R_N
        let (sin, cos) = s.at.lat.sin_cos();
        let e2 = 6.694_379_990_14e-3;
        let relative = e2 * sin * cos / (1.0 - e2 * sin * sin);
        let (d_m, d_n) = (
            3.0 * relative * (env.r_m - s.at.height),
            relative * (env.r_n - s.at.height),
        );
        let omega = Vector3::new(
            -env.omega_en_n.x * d_m / env.r_m,
            -env.omega_en_n.y * d_n / env.r_n,
            -env.omega_en_n.z * d_n / env.r_n,
        ) / env.r_m;
        m.fixed_view_mut::<3, 1>(ATT, POS + 1).copy_from(&omega);
        let mut vel = m.fixed_view_mut::<3, 1>(VEL, POS + 1);
        vel += s.v_n.cross(&omega);
    }
    m
}

#[test]
fn every_element_of_f_is_that_of_finite_differences() {
    for earth in [SPHERE, Earth::Wgs84] {
        for (k, s) in states().iter().enumerate() {
            let truth = Nav::new(&earth, &s.at, &s.v_n, &s.c_b_n);
            for angle in [Angle::Psi, Angle::Phi] {
                let f = model(angle, &earth, s);
                let (numeric, doubt) =
                    f_by_differences(&earth, angle, &truth, &s.omega_ib_b, &s.f_b);
                let left_out = match earth {
                    Earth::Wgs84 => left_out(angle, s),
                    Earth::Sphere { .. } => M15::zeros(),
                };
                for i in 0..15 {
                    for j in 0..15 {
                        let (ours, theirs) = (f[(i, j)], numeric[(i, j)]);
                        // third order in the size of the error: (1e-3 rad)², of the largest element of the block
                        let block = f.fixed_view::<3, 3>(i / 3 * 3, j / 3 * 3).amax();
                        let tolerance = doubt[(i, j)] + 1e-6 * block;
                        let place = format!("{earth:?}, state {k}, {angle:?} ({i}, {j})");
                        assert!(
                            (theirs - ours - left_out[(i, j)]).abs() <= tolerance,
                            "{place}: {ours:e}, by differences {theirs:e}, tolerance {tolerance:e}"
                        );
                        // Nothing hides in the tolerance: an element wrong by a tenth would be found.
                        assert!(
                            ours == 0.0 || tolerance < 0.1 * ours.abs(),
                            "{place}: {ours:e} is not seen with tolerance {tolerance:e}"
                        );
                    }
                }
            }
        }
    }
}

/// The numbers in the documentation of `psi`, `phi` and `Environment::gravity_gradient`.
#[test]
fn what_the_models_leave_out_is_below_what_they_say() {
    let mut largest = [0.0f64; 3];
    for lat in -80..=80 {
        let s = State {
            at: Place {
                lat: f64::from(lat).to_radians(),
                lon: 0.0,
                height: 1e3,
            },
            v_n: Vector3::new(300.0, 300.0, 0.0) / 2f64.sqrt(),
            ..states().swap_remove(0)
        };
        let m = left_out(Angle::Phi, &s);
        let omega = m.fixed_view::<3, 1>(ATT, POS + 1).norm();
        for (largest, value) in largest.iter_mut().zip([
            m[(VEL + 2, POS + 1)],
            m[(VEL + 2, POS + 2)],
            omega * 6.356_752e6 * 6.356_752e6 / s.v_n.norm(),
        ]) {
            *largest = largest.max(value.abs());
        }
    }
    let [latitude, height, radii] = largest;
    assert!(0.98 * 8.2e-9 < latitude && latitude < 8.2e-9);
    assert!(0.98 * 1.07e-8 < height && height < 1.07e-8);
    assert!(0.5 * 1.0e-2 < radii && radii < 1.0e-2);
}

/// Motion for the runs over time: a turn at about 6°/s with the nose going up and down.
fn turning(t: f64) -> (Vector3<f64>, Vector3<f64>) {
    (
        Vector3::new(0.05 * (0.7 * t).cos(), 0.02, -0.1),
        Vector3::new(1.0, 2.0 * (0.5 * t).sin(), 10.5),
    )
}

/// States on the way, at the middle of each of `steps` intervals.
fn on_the_way(earth: &Earth, start: &Nav, steps: usize, dt: f64) -> Vec<State> {
    let mut nav = *start;
    (0..steps)
        .map(|k| {
            let t = k as f64 * dt;
            let middle = nav.step(earth, &turning, t, dt / 2.0);
            nav = middle.step(earth, &turning, t + dt / 2.0, dt / 2.0);
            let (omega_ib_b, f_b) = turning(t + dt / 2.0);
            let at = earth.place(&middle.r_e);
            State {
                at,
                v_n: c_e_n(&at) * middle.v_e,
                c_b_n: c_e_n(&at) * middle.c_b_e,
                omega_ib_b,
                f_b,
            }
        })
        .collect()
}

/// Largest |a − b| in block (i, j), relative to the largest element there or to 1e-6 in units of usual errors.
fn block_error(a: &M15, b: &M15, i: usize, j: usize) -> f64 {
    const USUAL: [f64; 5] = [10.0, 0.1, 1e-4, 1e-6, 1e-3];
    let view = |m: &M15| m.fixed_view::<3, 3>(3 * i, 3 * j).into_owned();
    let size = view(b).amax().max(1e-6 * USUAL[i] / USUAL[j]);
    (view(a) - view(b)).amax() / size
}

#[test]
fn a_minute_of_turns_is_carried_by_either_model() {
    const DT: f64 = 0.1;
    const STEPS: usize = 600;
    let s = &states()[0];
    let start = Nav::new(&SPHERE, &s.at, &s.v_n, &s.c_b_n);
    for angle in [Angle::Psi, Angle::Phi] {
        let exact = transition_by_differences(&SPHERE, angle, &start, &turning, STEPS, DT);
        let a = on_the_way(&SPHERE, &start, STEPS, DT)
            .iter()
            .fold(M15::zeros(), |a, s| {
                discrete::chain(
                    &discrete::phi_minus_identity(&model(angle, &SPHERE, s), DT, 4),
                    &a,
                )
            });
        let ours = a + M15::identity();
        for (i, j) in (0..25).map(|k| (k / 5, k % 5)) {
            // F at the middle of each interval: second order, 5e-6 with these turns (1.2e-6 at half the interval)
            let error = block_error(&ours, &exact, i, j);
            assert!(error < 1e-5, "{angle:?}, block ({i}, {j}): {error:e}");
        }
    }
}

#[test]
fn the_blocks_of_an_interval_carry_ten_seconds_of_turns() {
    // 100 Hz samples, propagated every 0.1 s, first order, as the filter does.
    let s = &states()[0];
    let start = Nav::new(&Earth::Wgs84, &s.at, &s.v_n, &s.c_b_n);
    let exact = transition_by_differences(&Earth::Wgs84, Angle::Psi, &start, &turning, 200, 0.05);
    let sigma0 = [
        10.0, 8.0, 5.0, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03, 1e-6, 2e-6, 3e-6, 1e-3, 2e-3, 3e-3,
    ];
    let scaling = Scaling::new(&sigma0, &bias(), &NoiseDensity::zero()).unwrap();
    let samples = on_the_way(&Earth::Wgs84, &start, 1000, 0.01);
    let mut a = M15::zeros();
    for ten in samples.chunks(10) {
        let mut interval = Interval::empty();
        for s in ten {
            interval.add(&s.c_b_n, &(s.c_b_n * s.f_b * 0.01), 0.01);
        }
        let last = &ten[9];
        let env = Environment::wgs84(last.at.lat, last.at.height, last.v_n);
        a = discrete::chain(&block_transition(&env, &interval, &scaling).dense(), &a);
    }
    let si = M15::from_fn(|i, j| a[(i, j)] * sigma0[i] / sigma0[j]) + M15::identity();
    // First order in N = 100 intervals: a state that is reached over k integrations has k(k−1)/2 of N² fewer
    // combinations of intervals, and its element errs by k(k−1)/(2N). One integration is exact but for C and f, which
    // are integrals, and ω, which moves by 1e-4 of itself in an interval. Gravity's share of δv ← δr lacks 2ω².
    let mut tolerance = [[3e-5; 5]; 5];
    (tolerance[0][2], tolerance[0][4], tolerance[1][3]) = (0.012, 0.012, 0.012);
    (tolerance[0][3], tolerance[1][0]) = (0.033, 0.004);
    for (i, row) in tolerance.iter().enumerate() {
        for (j, tolerance) in row.iter().enumerate() {
            let error = block_error(&si, &exact, i, j);
            assert!(error < *tolerance, "block ({i}, {j}): {error:e}");
        }
    }
}

#[test]
fn blocks_are_f_in_units_of_sigma0() {
    let s = &states()[1];
    let env = Environment::wgs84(s.at.lat, s.at.height, s.v_n);
    let bias = BiasModel::from_correlation_times(3600.0, 100.0).unwrap();
    let f_n = s.c_b_n * s.f_b;
    let f = psi::f_matrix(&env, &s.c_b_n, &f_n, &bias);
    let mut sigma0 = [
        10.0, 8.0, 5.0, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03, 1e-6, 2e-6, 3e-6, 1e-3, 2e-3, 3e-3,
    ];
    let noise = NoiseDensity::from_random_walks(2e-3, 3e-4).with_stationary_biases(
        &bias,
        [1e-6, 2e-6, 3e-6],
        [1e-3, 2e-3, 3e-3],
    );
    for zeroed in [None, Some(2), Some(11)] {
        if let Some(k) = zeroed {
            sigma0[k] = 0.0; // such a state is normalised by 1
        }
        let unit = sigma0.map(|s| if s > 0.0 { s } else { 1.0 });
        let scaling = Scaling::new(&sigma0, &bias, &noise).unwrap();
        let rates = block_rates(&env, &s.c_b_n, &f_n, &scaling);
        let expected = M15::from_fn(|i, j| f[(i, j)] * unit[j] / unit[i]);
        let error =
            (rates.dense() - expected).zip_map(&expected, |e, x| e.abs() / x.abs().max(1e-300));
        assert!(error.max() < 1e-15, "{error}"); // four roundings of 1.1e-16 each, and the sum in 2ω_ie + ω_en
        let q = noise.diagonal();
        for i in 0..15 {
            let expected = q[i] / (unit[i] * unit[i]);
            assert!(
                (rates.noise()[i] - expected).abs() <= 4e-16 * expected,
                "{i}"
            );
        }
        // and an interval is that times its length when nothing changes
        let mut interval = Interval::empty();
        for _ in 0..8 {
            interval.add(&s.c_b_n, &(f_n / 64.0), 1.0 / 64.0);
        }
        let t = block_transition(&env, &interval, &scaling);
        assert_eq!(t.noise() * 8.0, rates.noise());
        let mut into = BlockTransition::identity();
        block_transition_into(&env, &interval, &scaling, &mut into);
        assert_eq!(into, t);
        let error = (t.dense() * 8.0 - rates.dense())
            .zip_map(&rates.dense(), |e, x| e.abs() / x.abs().max(1e-300));
        assert!(error.max() < 1e-15, "{error}");
    }
}

#[test]
fn biases_decay_at_their_own_rates() {
    let s = &states()[2];
    let env = Environment::wgs84(s.at.lat, s.at.height, s.v_n);
    let bias = BiasModel {
        rate_g: 0.01,
        rate_a: 0.2,
    };
    let constant = model(Angle::Psi, &Earth::Wgs84, s);
    let f_n = s.c_b_n * s.f_b;
    for f in [
        psi::f_matrix(&env, &s.c_b_n, &f_n, &bias) - constant,
        phi::f_matrix(&env, &s.c_b_n, &f_n, &bias) - model(Angle::Phi, &Earth::Wgs84, s),
    ] {
        let mut expected = M15::zeros();
        expected.fixed_view_mut::<3, 3>(BG, BG).fill_diagonal(-0.01);
        expected.fixed_view_mut::<3, 3>(BA, BA).fill_diagonal(-0.2);
        assert_eq!(f, expected);
    }
}

#[test]
fn phi_is_psi_plus_delta_theta() {
    // the formula of the crate's front page
    for s in states() {
        let earth = Earth::Wgs84;
        let truth = Nav::new(&earth, &s.at, &s.v_n, &s.c_b_n);
        let env = Environment::wgs84(s.at.lat, s.at.height, s.v_n);
        let x = SVector::<f64, 15>::from_fn(|i, _| {
            [20.0, -30.0, 10.0][i % 3] * [1.0, 1e-2, 1e-6, 0.0, 0.0][i / 3]
        });
        let est = estimate(&earth, Angle::Psi, &truth, &x);
        let difference =
            errors(&earth, Angle::Phi, &est, &truth) - errors(&earth, Angle::Psi, &est, &truth);
        let delta_theta = Vector3::new(
            -x[1] / env.r_m,
            x[0] / env.r_n,
            x[0] * env.tan_lat / env.r_n,
        );
        // second order: 36 m/R times tan L or 4e-5 rad of the values
        let tolerance = 5e-5 * delta_theta.norm();
        assert!((difference.fixed_rows::<3>(ATT) - delta_theta).norm() < tolerance);
        let delta_v = -delta_theta.cross(&s.v_n);
        assert!((difference.fixed_rows::<3>(VEL) - delta_v).norm() < tolerance * s.v_n.norm());
    }
}

#[test]
fn what_corrected_takes_away_is_the_psi_error() {
    let nav = NavState::new(
        Geodetic::from_degrees(45.5, 12.0, 3000.0),
        Vector3::new(150.0, -220.0, 40.0),
        Euler::from_degrees(30.0, 20.0, -35.0),
    )
    .unwrap();
    let as_twin = |nav: &NavState| {
        let g = nav.position();
        let at = Place {
            lat: g.lat,
            lon: g.lon,
            height: g.height,
        };
        let [e, n, u] = nav.strapdown().v_n.map(|w| w.wide());
        let mut twin = Nav::new(
            &Earth::Wgs84,
            &at,
            &Vector3::new(e, n, u),
            &navsight::attitude::c_b_n(nav.strapdown().q.map(|w| w.wide())),
        );
        // a bias of the estimate is what it takes off: less of it leaves more uncompensated
        twin.b_g = -nav.b_g().map(f64::from);
        twin.b_a = -nav.b_a().map(f64::from);
        twin
    };
    for j in 0..15 {
        let size = [100.0, 1.0, 1e-3, 1e-3, 0.1][j / 3];
        let dx = SVector::<f32, 15>::ith(j, size);
        let read = errors(
            &Earth::Wgs84,
            Angle::Psi,
            &as_twin(&nav),
            &as_twin(&nav.corrected(&dx)),
        );
        for i in 0..15 {
            let expected = f64::from(dx[i]);
            // second order: 100 m/R times 100 m, 270 m/s and 1 rad, and 1e-6/6 of the angle; f32 radii and the f32
            // biases: 1e-7 of the value
            let tolerance = [2e-3, 1e-6, 1e-9, 0.0, 0.0][i / 3] + 2e-7 * expected.abs();
            assert!(
                (read[i] - expected).abs() <= tolerance,
                "({i}, {j}): {:e} {expected:e}",
                read[i]
            );
        }
    }
}

#[test]
fn the_navigators_own_place_gives_the_same_environment() {
    for s in states() {
        let v = s.v_n.map(|x| x as f32);
        let local = Local::at(s.at.lat as f32, s.at.height as f32);
        let ours = Environment::from_local(&local, &v);
        let lat = f64::from(s.at.lat as f32);
        let exact = Environment::<f64>::wgs84(lat, s.at.height, s.v_n);
        let close = |a: f32, b: f64| (f64::from(a) - b).abs() <= 1e-6 * b.abs(); // Local promises 3e-7
        assert!(close(ours.gravity, exact.gravity) && close(ours.tan_lat, exact.tan_lat));
        assert!(close(ours.r_m, exact.r_m) && close(ours.r_n, exact.r_n));
        for k in 0..3 {
            assert!(close(ours.omega_ie_n[k], exact.omega_ie_n[k]));
            assert!(close(ours.omega_en_n[k], exact.omega_en_n[k]));
        }
        assert_eq!(ours.v_n, v);
    }
}

#[test]
fn damaged_settings_are_refused() {
    let bias = BiasModel::<f32>::constant();
    let noise = NoiseDensity::zero();
    let good = [1.0f32; 15];
    assert!(Scaling::new(&good, &bias, &noise).is_ok());
    for (value, error) in [
        (f32::NAN, Error::NonFinite),
        (f32::INFINITY, Error::NonFinite),
        (-1.0, Error::OutOfRange),
    ] {
        for k in 0..15 {
            let mut sigma0 = good;
            sigma0[k] = value;
            assert_eq!(Scaling::new(&sigma0, &bias, &noise), Err(error));
        }
        let damaged = NoiseDensity {
            velocity: value,
            ..noise
        };
        assert_eq!(Scaling::new(&good, &bias, &damaged), Err(error));
        let damaged = BiasModel {
            rate_a: value,
            ..bias
        };
        assert_eq!(Scaling::new(&good, &damaged, &noise), Err(error));
    }
}

#[test]
fn single_precision_is_double_precision_rounded() {
    // Products of at most five rounded factors: 6 · 2⁻²⁴ of an element; sums only of terms of one sign here (ω).
    let s = &states()[0];
    let sigma0 = [
        10.0, 8.0, 5.0, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03, 1e-7, 2e-7, 3e-7, 1e-3, 2e-3, 3e-3,
    ];
    let bias = BiasModel::from_correlation_times(72_000.0, 3600.0).unwrap();
    let noise = NoiseDensity::from_random_walks(1e-4, 1e-8)
        .with_stationary_biases(&bias, [1e-7; 3], [1e-3; 3]);
    let (c, f_n) = (s.c_b_n, s.c_b_n * s.f_b);
    let env = Environment::wgs84(s.at.lat, s.at.height, s.v_n);
    let double = block_rates(
        &env,
        &c,
        &f_n,
        &Scaling::new(&sigma0, &bias, &noise).unwrap(),
    );
    let single = {
        let bias = BiasModel::from_correlation_times(72_000.0f32, 3600.0).unwrap();
        let noise = NoiseDensity::from_random_walks(1e-4f32, 1e-8)
            .with_stationary_biases(&bias, [1e-7; 3], [1e-3; 3]);
        let env = Environment::wgs84(s.at.lat, s.at.height, s.v_n.cast());
        let scaling = Scaling::new(&sigma0.map(|x| x as f32), &bias, &noise).unwrap();
        block_rates(&env, &c.cast(), &f_n.cast(), &scaling)
    };
    let close = |a: f32, b: f64| (f64::from(a) - b).abs() <= 6.0 / 16_777_216.0 * b.abs();
    for (a, b) in single.dense().iter().zip(double.dense().iter()) {
        assert!(close(*a, *b), "{a:e} {b:e}");
    }
    for (a, b) in single.noise().iter().zip(double.noise().iter()) {
        assert!(close(*a, *b), "{a:e} {b:e}");
    }
}
