//! Section 4 of Fang 1998: the transfer functions, derived a second way, with their corrections; steady gains and what
//! follows from them.

use host_tests::analysis::transfer::{continuous_gain, pulse, response, value, Gain, Transfer};
use host_tests::tracking::scenario::Noise;
use nalgebra::{Complex, ComplexField, Matrix3, SMatrix};
use navsight::tracking::{
    AxisTracker, CurrentModel, Fix, Kinematics, Limits, Mean, Reading, Settings, Variance,
};
use serde_json::Value;

fn golden() -> Value {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/fang1998.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn rows(value: &Value) -> Vec<Vec<f64>> {
    serde_json::from_value(value.clone()).unwrap()
}

const TAU: f64 = 100.0;
/// (4 − π)/π · 2², the variance of the runs in cruise.
const SIGMA2: f64 = navsight::tracking::RAYLEIGH * 4.0;

fn steady(t: f64, velocity: bool) -> Gain {
    continuous_gain(TAU, SIGMA2, [1e4 * t, 0.01 * t], velocity).unwrap()
}

/// (25), (26), (32)–(41) are what the differential equation gives, at random gains and complex frequencies; the second
/// and third rows relative to the true velocity and acceleration.
#[test]
fn the_printed_polynomials_are_the_filter() {
    let mut noise = Noise::new(1998);
    for n in 0..200 {
        let mut k = Gain::from_fn(|_, _| noise.normal());
        if n % 2 == 0 {
            k.set_column(1, &nalgebra::Vector3::zeros()); // position alone: (25), (26)
        }
        let s = Complex::new(noise.normal(), noise.normal());
        let t = Transfer::of(&k);
        let exact = response(&k, 0.0, s).unwrap();
        let d = value(&t.denominator, s);
        for i in 0..3 {
            let truth = s.powu(i as u32);
            let scale = 1e-9 * (1.0 + 1.0 / d.modulus());
            let follows = value(&t.follows[i], s) / d;
            let misses = value(&t.misses[i], s) / d;
            assert!((exact[i] / truth - follows).modulus() < scale, "{i} {k}");
            assert!(
                (1.0 - exact[i] / truth - misses).modulus() < scale,
                "{i} {k}"
            );
            if i > 0 {
                // as printed, relative to X(s): wrong wherever s is not 1
                assert!((exact[i] - follows).modulus() > 1e-6 * follows.modulus());
            }
        }
        // compact: error = (sI − F₁ + KH)⁻¹ [0 0 1]ᵀ s³ X
        let error = Complex::new(1.0 - k.m12, 0.0) * s.powu(3) / d;
        assert!((1.0 - exact[0] - error).modulus() < 1e-9 * (1.0 + 1.0 / d.modulus()));
    }
}

/// With a fixed mean the acceleration decays in the model: D has (k11 + k22 + 1/τ) s², and the error of position starts
/// at s², not s³.
#[test]
fn the_polynomials_hold_with_the_adaptive_mean_only() {
    let (k, rate) = (steady(1.0, true), 0.3);
    let [[k11, k21, k31], [k12, k22, k32]] = k.data.0;
    for s in [Complex::new(0.1, 0.7), Complex::new(-0.2, 1.3)] {
        let d = s.powu(3)
            + s.powu(2) * (k11 + k22 + rate)
            + s * (k32 + k21 + k11 * k22 - k12 * k21 + rate * (k11 + k22))
            + (k11 * k32 - k12 * k31 + k31 + rate * (k21 + k11 * k22 - k12 * k21));
        let error = s.powu(2) * (s + rate) * (1.0 - k12) / d;
        let exact = 1.0 - response(&k, rate, s).unwrap()[0];
        assert!((exact - error).modulus() < 1e-10);
        let adaptive =
            value(&Transfer::of(&k).misses[0], s) / value(&Transfer::of(&k).denominator, s);
        assert!((exact - adaptive).modulus() > 1e-3 * adaptive.modulus());
    }
}

/// (24) is the estimated acceleration, not X(t): with it Φ + U [0 0 1] is Newton's matrix, and the state follows a
/// constant acceleration that a zero mean forgets.
#[test]
fn the_mean_is_the_estimated_acceleration() {
    let settle = |mean| {
        let model = CurrentModel {
            tau: 5.0,
            mean,
            variance: Variance::Fixed(1.0),
        };
        let mut tracker = start(model);
        for _ in 0..10 {
            tracker.predict(1.0).unwrap();
        }
        tracker.state()
    };
    let current = settle(Mean::Current);
    assert_eq!(current.velocity, [10.0]);
    assert_eq!(current.position, [50.0]);
    assert!((settle(Mean::Zero).acceleration[0] - (-2.0f64).exp()).abs() < 1e-14);
}

fn start(model: CurrentModel<f64>) -> AxisTracker<f64> {
    let kinematics = |position, velocity, acceleration| Kinematics {
        position: [position],
        velocity: [velocity],
        acceleration: [acceleration],
    };
    let mut settings = Settings::new(model);
    settings.gate = None;
    AxisTracker::new(
        &kinematics(0.0, 0.0, 1.0),
        &kinematics(100.0, 10.0, 1.0),
        settings,
    )
    .unwrap()
}

/// The variance rule as printed (a_max on both sides) opens while braking; the repaired one closes on both sides.
#[test]
fn the_variance_rule_is_symmetric() {
    let limits = Limits::<f64>::paper(2.0, -2.0);
    for a in [0.1, 0.9, 1.7] {
        assert_eq!(limits.variance(a), limits.variance(-a));
        let printed = navsight::tracking::RAYLEIGH * (-2.0 - a) * (-2.0 - a);
        assert!(printed > limits.variance(0.0) && limits.variance(-a) < limits.variance(0.0));
    }
}

#[test]
fn steady_gains() {
    for case in golden()["steady"].as_array().unwrap() {
        let (t, velocity) = (case["T"].as_f64().unwrap(), case["set"] == "pv");
        let k = steady(t, velocity);
        let columns = if velocity { 2 } else { 1 };
        for (i, row) in rows(&case["K_cont"]).iter().enumerate() {
            for m in 0..columns {
                // printed with 8 digits; k31 of both is a difference of two terms 1e3 times larger
                assert!((k[(i, m)] / row[m] - 1.0).abs() < 2e-7, "{case} {k}");
            }
        }
        let transfer = Transfer::of(&k);
        let d: Vec<f64> = serde_json::from_value(case["D"].clone()).unwrap();
        for (got, want) in transfer.denominator.iter().zip(&d) {
            assert!((got / want - 1.0).abs() < 2e-7);
        }
        for (got, want) in transfer.follows.iter().zip(rows(&case["N"])) {
            for (got, want) in got.iter().rev().zip(want.iter().rev()) {
                assert!((got / want - 1.0).abs() < 2e-7);
            }
        }
        // the library's own filter with that variance, until it stands
        let mut tracker = start(CurrentModel {
            tau: TAU,
            mean: Mean::Current,
            variance: Variance::Fixed(SIGMA2),
        });
        let fix = Fix {
            position: Some(Reading::new([0.0], 100.0)),
            velocity: velocity.then(|| Reading::new([0.0], 0.1)),
        };
        // the slowest pole, 1000 s, e^−25
        for _ in 0..(25_000.0 / t) as usize {
            tracker.predict(t).unwrap();
            tracker.update(&fix).unwrap();
        }
        let sigma0 = [100.0, 10.0, 1.0];
        let p = |i: usize, j: usize| tracker.covariance().element(i, j) * sigma0[i] * sigma0[j];
        for (i, row) in rows(&case["K"]).iter().enumerate() {
            for (m, want) in row.iter().enumerate() {
                let gain = p(i, m) / [1e4, 0.01][m];
                assert!((gain / want - 1.0).abs() < 2e-8, "{case} {i} {m} {gain}");
            }
        }
    }
}

#[test]
fn bandwidths_and_jerk() {
    // three printed digits each
    for (t, velocity, want, jerk) in [
        (1.0, false, [0.309, 0.184, 0.104], 806.0),
        (1.0, true, [f64::INFINITY, 2.49, 1.21], 0.0051),
        (20.0, false, [0.183, 0.108, 0.0594], 4037.0),
        (20.0, true, [f64::INFINITY, 1.17, 0.568], 0.103),
    ] {
        let transfer = Transfer::of(&steady(t, velocity));
        for (i, want) in want.iter().enumerate() {
            let got = transfer.bandwidth(i);
            assert!(
                got == *want || (got / want - 1.0).abs() < 5e-3,
                "{t} {i} {got}"
            );
        }
        let got = transfer.jerk_error();
        assert!((got / jerk - 1.0).abs() < 0.01, "{got}");
    }
    assert!((1.0 - steady(1.0, true).m12 - 7.4e-6).abs() < 5e-8);
    assert!((1.0 - steady(20.0, true).m12 - 3.3e-5).abs() < 5e-7);
}

/// "One zero more in each numerator": the degree rises by one in every row.
#[test]
fn velocity_adds_a_zero_to_every_numerator() {
    let degree = |c: &[f64; 4]| 3 - c.iter().position(|c| *c != 0.0).unwrap();
    let (one, both) = (
        Transfer::of(&steady(1.0, false)),
        Transfer::of(&steady(1.0, true)),
    );
    assert_eq!(one.follows.map(|c| degree(&c)), [2, 1, 0]);
    assert_eq!(both.follows.map(|c| degree(&c)), [3, 2, 1]);
}

#[test]
fn a_pulse_of_acceleration_without_noise() {
    let one = pulse(&steady(1.0, false), 1.0, 20.0, 200.0);
    assert!(
        (one.x - 34.2).abs() < 0.1 && (one.y - 8.16).abs() < 0.02,
        "{one}"
    );
    let both = pulse(&steady(1.0, true), 1.0, 20.0, 200.0);
    assert!(both.x < 1e-4 && (both.y - 0.38).abs() < 0.01, "{both}");
}

/// The price of velocity: position follows its integral, so 1 cm/s of constant error becomes b/k11.
#[test]
fn a_velocity_error_becomes_a_position_error() {
    let k = steady(1.0, true);
    let continuous = k.m32 * 0.01 / Transfer::of(&k).denominator[3];
    assert!((continuous - 10.0).abs() < 0.01, "{continuous}");
    for (t, want) in [(1.0, 9.98), (20.0, 1.88)] {
        let mut tracker = start(CurrentModel::current(TAU, Limits::paper(2.0, -2.0)));
        for _ in 0..(25_000.0 / t) as usize {
            tracker.predict(t).unwrap();
            tracker
                .update(&Fix {
                    position: Some(Reading::new([0.0], 100.0)),
                    velocity: Some(Reading::new([0.01], 0.1)),
                })
                .unwrap();
        }
        let got = tracker.state().position[0];
        assert!((got - want).abs() < 0.01, "{t} {got}");
    }
}

/// The paper's rank statement: true for both, but position alone has it already; velocity alone does not.
#[test]
fn rank_is_not_what_velocity_adds() {
    let a = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0 / TAU);
    let rank = |measured: &[usize]| {
        let mut rows = SMatrix::<f64, 6, 3>::zeros(); // what is not filled adds nothing
        let powers = [Matrix3::identity(), a, a * a];
        for (at, (power, state)) in powers
            .iter()
            .flat_map(|power| measured.iter().map(move |state| (power, state)))
            .enumerate()
        {
            rows.row_mut(at).copy_from(&power.row(*state));
        }
        rows.rank(1e-12)
    };
    assert_eq!([rank(&[0]), rank(&[0, 1]), rank(&[1])], [3, 3, 2]);
}
