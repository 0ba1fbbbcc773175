//! `lab align`: a simulated one- and two-position alignment through the library in single precision ends where theory
//! says, its errors stay inside its σ, and the covariance analysis beside it gives the printed tables of Lu 2009.
#![cfg(not(target_os = "none"))]

use std::path::Path;

use serde_json::Value;

mod common;

fn align(args: &[&str]) -> Value {
    let report =
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("align_{}", args.concat().len()));
    let report = report.to_str().unwrap();
    common::lab_json(["align", "--json", "--report", report].iter().chain(args))
}

fn numbers(value: &Value) -> Vec<f64> {
    let list = value.as_array().unwrap();
    list.iter().map(|x| x.as_f64().unwrap()).collect()
}

const HEADING: usize = 8;
const EAST_GYRO: usize = 9;
const NORTH_GYRO: usize = 10;

#[test]
fn a_turn_separates_what_one_position_cannot() {
    let o = align(&[]);
    let (one, two) = (&o["case1"], &o["case2"]);
    let sigma = |case: &Value| numbers(&case["sigma"])[HEADING].to_degrees();
    // 0.02 °/h over 15.041 °/h · cos 37.4° = 0.0959°; noise adds to it: between the limit and 5 % above.
    assert!((0.0959..0.1007).contains(&sigma(one)), "{}", sigma(one));
    assert!(sigma(two) < sigma(one) / 3.0, "{}", sigma(two));
    let (xi2_one, xi2_two) = (numbers(&one["xi2"]), numbers(&two["xi2"]));
    assert!((1.0..1.05).contains(&xi2_one[EAST_GYRO]) && xi2_two[EAST_GYRO] > 5.0);
    assert!(xi2_one[NORTH_GYRO] > 5.0);
    for level in [12, 13] {
        assert!(xi2_one[level] < 1.1 && xi2_two[level] > 100.0);
    }
    for case in [one, two] {
        // ξ along a state lies between the extreme η: free invariants of a diagonal P0.
        let (xi2, eta2) = (numbers(&case["xi2"]), numbers(&case["eta2"]));
        let (xi1, eta1) = (numbers(&case["xi1_riccati"]), numbers(&case["eta1"]));
        // f32: 2e-3 of an eigenvalue of T; of M a few 1e-7 of the largest term of its sum, 1e-2 /s here.
        assert!(xi2
            .iter()
            .all(|x| *x <= eta2[0] * 1.002 && *x >= eta2[14] * 0.998));
        assert!(xi1
            .iter()
            .all(|x| *x <= eta1[0] + 1e-8 && *x >= eta1[14] - 1e-8));
        assert!(eta1.windows(2).chain(eta2.windows(2)).all(|w| w[0] >= w[1]));
        assert!(numbers(&case["xi1"]).iter().all(|x| *x >= 0.0));
    }
}

#[test]
fn errors_stay_inside_sigma_over_seeds() {
    // Six seeds, two cases, 12 states that noise and biases reach (position hardly moves from where it was put): 144
    // ratios, strongly correlated within a run. Beyond 4σ: 6e-5 each if normal, less than 1 % for all. The root mean
    // square over seeds is that of at least 6 independent ones: between 0.4 and 1.7 with 99.9 % (χ² of 12 runs, 6).
    let (mut sum, mut count) = (0.0, 0.0);
    for seed in ["1", "2", "3", "4", "5", "6"] {
        let o = align(&["--seed", seed]);
        for case in ["case1", "case2"] {
            let (error, sigma) = (numbers(&o[case]["error"]), numbers(&o[case]["sigma"]));
            for i in 3..15 {
                let ratio = error[i] / sigma[i];
                assert!(ratio.abs() < 4.0, "seed {seed} {case} state {i}: {ratio}");
                (sum, count) = (sum + ratio * ratio, count + 1.0);
            }
        }
    }
    let rms = f64::sqrt(sum / count);
    assert!((0.4..1.7).contains(&rms), "{rms}");
}

#[test]
fn any_attitude_and_hemisphere() {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("tilted.toml");
    let text = "lat_deg = -55\nheading_deg = 200\npitch_deg = 35\nroll_deg = -50\nrate_hz = 50\n";
    std::fs::write(&path, text).unwrap();
    let o = align(&["--config", path.to_str().unwrap()]);
    for case in ["case1", "case2"] {
        let (error, sigma) = (numbers(&o[case]["error"]), numbers(&o[case]["sigma"]));
        for i in 3..15 {
            assert!((error[i] / sigma[i]).abs() < 4.0, "{case} state {i}");
        }
    }
    let heading = o["case2"]["final"]["heading_deg"].as_f64().unwrap();
    // 200° + 180°; 4σ of about 0.03°
    assert!((heading - 20.0).abs() < 0.15, "{heading}");
}

#[test]
fn the_same_seed_gives_the_same_numbers() {
    assert_eq!(
        align(&["--seed", "7"])["case2"],
        align(&["--seed", "7"])["case2"]
    );
}

#[test]
fn the_printed_tables_are_reproduced() {
    let o = align(&[]);
    let lu = &o["lu2009"];
    let get = |name: &str| lu[name].as_f64().unwrap();
    // Table 5 ξ2 and Table 4: 15 states or eigenvalues, two cases. What is off by more than 1 % hangs on quantities
    // that the paper does not print (course of the estimate, damping); `paper::lu2009` has the reading.
    assert_eq!(get("cells"), 60.0);
    assert_eq!(get("cells_within_3_percent"), 60.0);
    assert!(get("cells_within_1_percent") >= 45.0);
    // Figs 1 and 2: ξ2 of the heading 400 against 401 at 303 s.
    for (case, want) in [("case1", 400.0), ("case2", 400.8)] {
        let heading = numbers(&lu[case]["xi2_303"])[HEADING];
        assert!((heading / want - 1.0).abs() < 1e-3, "{heading}");
    }
}
