//! Fang 1998 against the golden numbers: matrices, variance rules, runs of the filter with their observability.

use host_tests::tracking::{run, Config, Flag, Step};
use navsight::linalg::Real;
use navsight::tracking::{Beyond, Limits, Transition};
use serde_json::Value;

fn golden() -> Value {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/fang1998.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        Value::Number(_) => vec![value.as_f64().unwrap()],
        _ => panic!("{value} is no number"),
    }
}

fn relative(got: &[f64], want: &[f64]) -> f64 {
    assert_eq!(got.len(), want.len());
    let pairs = got.iter().zip(want);
    pairs.map(|(g, w)| (g / w - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn matrices() {
    for m in golden()["matrices"].as_array().unwrap() {
        let [dt, tau, sigma] = ["T", "tau", "sigma"].map(|k| m[k].as_f64().unwrap());
        check::<f64>(m, dt, tau, sigma, 1e-9);
        check::<f32>(m, dt, tau, sigma, 2e-6);
    }
    fn check<T: Real>(m: &Value, dt: f64, tau: f64, sigma: f64, bound: f64) {
        let t = Transition::new(T::of(dt), T::of(tau)).unwrap();
        let q = t.noise(T::of(sigma * sigma)).map(Real::wide);
        assert!(relative(&q, &numbers(&m["Q_upper"])) < bound, "{m}");
        assert!(relative(&t.u.map(Real::wide), &numbers(&m["U"])) < bound);
        // φ33 is kept as φ33 − 1, which is −U3
        let [phi13, phi23, a33] = t.phi.map(Real::wide);
        let (u, column) = (numbers(&m["U"]), numbers(&m["phi_col3"]));
        assert!(relative(&[phi13, phi23, -a33], &[column[0], column[1], u[2]]) < bound);
    }
}

#[test]
fn variance_rules() {
    let golden = golden();
    let rows = golden["sigma2_cases"]["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 66);
    for row in rows {
        let number = |i: usize| row[i].as_f64().unwrap();
        let limits = Limits {
            a_max: number(1),
            a_min: number(2),
            floor: number(3),
            beyond: match row[4].as_str().unwrap() {
                "abs" => Beyond::Abs,
                "full" => Beyond::Full,
                _ => Beyond::Clamp,
            },
            blend: 0.0,
        };
        let got = limits.variance(number(0));
        assert!((got / number(5) - 1.0).abs() < 1e-9, "{row}: {got}");
    }
}

/// The configuration of a run of the golden file.
fn config(golden: &Value, name: &str) -> Config {
    let (c, seq) = (&golden["config"], &golden["seq"]);
    let n = seq["z_pos"].as_array().unwrap().len();
    let mut dt = vec![seq["dt"].as_f64().unwrap(); n];
    dt[0] = 0.0;
    let mut input = serde_json::json!({
        "tau": c["tau"], "a_max": c["a_max"], "a_min": c["a_min"], "floor_frac": c["floor_frac"],
        "beyond": c["beyond"], "P0": c["P0"], "R": c["R"], "x0": golden["runs"][name]["x0"],
        "model": if name.starts_with("singer") { "singer" } else { "cs" },
        "sigma2": c["sigma2_singer"], "dt": dt, "z_pos": seq["z_pos"], "z_vel": seq["z_vel"],
        "has_pos": vec![1; n], "has_vel": vec![u8::from(!name.ends_with("_pos")); n],
    });
    if name == "cs_pv_limit" {
        let limit = [("a_max", 0.9), ("a_min", -0.9), ("floor_frac", 0.3)];
        for (key, x) in limit {
            input[key] = x.into();
        }
        input["beyond"] = "full".into();
    }
    serde_json::from_value(input).unwrap()
}

/// Worst differences of a run: x in σ, then P_ii, P_ij/(σ_i σ_j), K, NIS, σ² and all indices relative.
#[derive(Debug, Default)]
struct Worst {
    x_sigma: f64,
    x: f64,
    p: f64,
    correlation: f64,
    gain: f64,
    sigma2: f64,
    xi2: f64,
    xi1_meas: f64,
    xi1_ric: f64,
    xi1_diff: f64,
    eta1: f64,
    eta2: f64,
}

fn compare(golden: &Value, name: &str, steps: &[Step]) -> Worst {
    let want = &golden["runs"][name];
    let mut w = Worst::default();
    let up = |to: &mut f64, x: f64| {
        assert!(x.is_finite(), "{name}");
        *to = to.max(x);
    };
    for (k, step) in steps.iter().enumerate() {
        let (x, sigma) = (
            numbers(&want["x"][k]),
            [0, 3, 5].map(|i| step.p_upper[i].sqrt()),
        );
        for i in 0..3 {
            let d = (step.x[i] - x[i]).abs();
            up(&mut w.x_sigma, d / sigma[i]);
            // relative to the number, or where that passes through zero, to what it is known to
            up(&mut w.x, d / x[i].abs().max(sigma[i]));
        }
    }
    for d in want["detail"].as_array().unwrap() {
        let step = &steps[d["k"].as_u64().unwrap() as usize];
        let p = numbers(&d["P_upper"]);
        let at = |i: usize, j: usize| [[0, 1, 2], [1, 3, 4], [2, 4, 5]][i][j];
        for i in 0..3 {
            up(&mut w.p, (step.p_upper[at(i, i)] / p[at(i, i)] - 1.0).abs());
            for j in 0..i {
                let scale = (p[at(i, i)] * p[at(j, j)]).sqrt();
                up(
                    &mut w.correlation,
                    (step.p_upper[at(i, j)] - p[at(i, j)]).abs() / scale,
                );
            }
        }
        let gain: Vec<f64> = step.gain.iter().flatten().copied().collect();
        let wanted = numbers(&d["K"]);
        // K_im = P_im/R_m: relative to the largest that P_ii and P_mm allow
        let m = wanted.len() / 3;
        for (n, (got, want)) in gain.iter().zip(&wanted).enumerate() {
            let r = [1e4, 0.01][n % m];
            let scale = (p[at(n / m, n / m)] * p[at(n % m, n % m)]).sqrt() / r;
            up(&mut w.gain, (got - want).abs() / scale);
        }
        assert_eq!(gain.len(), wanted.len());
        if let (Some(want), Some(got)) = (d["sigma2"].as_f64(), step.sigma2) {
            up(&mut w.sigma2, (got / want - 1.0).abs());
        }
        if d["k"] == 0 {
            continue;
        }
        let mut index = |to: fn(&mut Worst) -> &mut f64, got: [f64; 3], key: &str, floor: f64| {
            for (got, want) in got.iter().zip(numbers(&d[key])) {
                up(to(&mut w), (got - want).abs() / want.abs().max(floor));
            }
        };
        index(|w| &mut w.xi2, step.xi2, "xi2", 0.0);
        index(
            |w| &mut w.xi1_meas,
            step.xi1_meas.unwrap(),
            "xi1_meas",
            1e-12,
        );
        // sums of terms up to 0.1 1/s that cancel
        index(|w| &mut w.xi1_ric, step.xi1_ric.unwrap(), "xi1_ric", 1e-2);
        index(
            |w| &mut w.xi1_diff,
            step.xi1_diff.unwrap(),
            "xi1_diff",
            1e-2,
        );
        index(|w| &mut w.eta1, step.eta1.unwrap(), "eta1", 1e-2);
        index(|w| &mut w.eta2, step.eta2, "eta2", 0.0);
    }
    w
}

const RUNS: [&str; 5] = ["cs_pos", "cs_pv", "singer_pos", "singer_pv", "cs_pv_limit"];

#[test]
fn runs_in_double_precision() {
    let golden = golden();
    for name in RUNS {
        let steps = run::<f64>(&config(&golden, name)).unwrap();
        let w = compare(&golden, name, &steps);
        println!("{name} {w:?}");
        // 1e-9: the golden numbers carry 12 digits; 2e-9: the indices carry 10
        for x in [w.x, w.p, w.correlation, w.gain, w.sigma2] {
            assert!(x < 1e-9, "{name}: {w:?}");
        }
        for x in [w.xi2, w.xi1_meas, w.xi1_ric, w.xi1_diff, w.eta1, w.eta2] {
            assert!(x < 2e-9, "{name}: {w:?}");
        }
    }
}

#[test]
fn runs_in_single_precision() {
    let golden = golden();
    for name in RUNS {
        let steps = run::<f32>(&config(&golden, name)).unwrap();
        let w = compare(&golden, name, &steps);
        println!("{name} {w:?}");
        assert!(w.x_sigma < 5e-4, "{name}: {w:?}");
        assert!(w.p < 2e-5 && w.xi2 < 2e-5, "{name}: {w:?}");
    }
}

#[test]
fn one_axis_of_three_is_the_axis_alone() {
    use navsight::tracking::{Fix, Kinematics, LocalTracker, Noise, Reading};
    let golden = golden();
    let config = config(&golden, "cs_pv_limit");
    let steps = run::<f32>(&config).unwrap();
    let three = |x: f64, other: f32| [other, x as f32, 0.5 * other];
    let sigma = config.p0.map(f64::sqrt);
    let mut tracker = LocalTracker::<f32>::new(
        &Kinematics {
            position: three(config.x0[0], 7.0),
            velocity: three(config.x0[1], -3.0),
            acceleration: three(config.x0[2], 0.3),
        },
        &Kinematics {
            position: three(sigma[0], 30.0),
            velocity: three(sigma[1], 3.0),
            acceleration: three(sigma[2], 0.4),
        },
        config.settings(),
    )
    .unwrap();
    for (k, step) in steps.iter().enumerate() {
        if k > 0 {
            tracker.predict(1.0).unwrap();
        }
        let reading = |z: Option<f64>, r: f64, other: f32| Reading {
            z: three(z.unwrap(), other),
            noise: Noise::Independent(three(r, 2.0)),
            valid: [true, true, k % 3 == 0],
        };
        let report = tracker
            .update(&Fix {
                position: Some(reading(config.z_pos[k], config.r[0], k as f32)),
                velocity: Some(reading(config.z_vel[k], config.r[1], 1.0)),
            })
            .unwrap();
        let state = tracker.state();
        let got = [state.position[1], state.velocity[1], state.acceleration[1]];
        assert_eq!(got.map(f64::from), step.x, "step {k}"); // bit for bit: independent axes do not touch each other
        assert_eq!(report.used(), if k % 3 == 0 { 6 } else { 4 });
    }
}

#[test]
fn a_flag_is_a_number_or_a_word() {
    let flags: Vec<Flag> = serde_json::from_str("[1, 0, true, false, 1.0]").unwrap();
    assert_eq!(flags.iter().filter(|f| f.0).count(), 3);
    assert!(serde_json::from_str::<Flag>("2").is_err());
}
