//! `lab align --sweep`, `--scenario` and `lab montecarlo` as a caller sees them: the angle of the turn, parts that add up to
//! the whole, and one line for what is wrong with a file.
#![cfg(not(target_os = "none"))]

use std::fs;
use std::path::PathBuf;

use serde_json::Value;

mod common;

/// A file of this test.
fn file(name: &str, text: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::write(&path, text).unwrap();
    path
}

/// Two minutes in each position, drawn biases.
const SHORT: &str =
    "seeds = 6\nsample_s = 0.1\nvariants = [\"full\", \"carry\", \"one-position\"]\n\
    [[position]]\nheading_deg = 20\nseconds = 60\n\
    [[position]]\nheading_deg = 200\nroll_deg = 5\nseconds = 60\n\
    [sensor]\ngrade = \"navigation\"\n[prior]\nlevel_deg = 0.01\nvelocity_m_s = 0.01\n";

#[test]
fn a_half_turn_is_best_for_the_filter_and_a_quarter_for_biases_alone() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("sweep");
    let o = common::lab_json([
        "align",
        "--sweep",
        "--json",
        "--report",
        folder.to_str().unwrap(),
    ]);
    let angles = o["angles"].as_array().unwrap();
    let sigma = |alpha: f64, way: &str| {
        let at = angles.iter().find(|a| a["alpha_deg"] == alpha).unwrap();
        at["sigma_heading_deg"][way].as_f64().unwrap()
    };
    let best = |way: &str| {
        let all = angles.iter().map(|a| a["alpha_deg"].as_f64().unwrap());
        all.min_by(|a, b| sigma(*a, way).total_cmp(&sigma(*b, way)))
            .unwrap()
    };
    assert_eq!(best("carry").abs(), 90.0);
    assert_eq!(best("full").abs(), 180.0);
    // Notes: 0.0373° and 0.051° at 90°, ARW 0.003 °/√h. No turn: one position, whose bias the filter is told to 0.05 °/h.
    assert!((sigma(90.0, "full") - 0.0373).abs() < 0.001);
    assert!((sigma(90.0, "carry") - 0.051).abs() < 0.001);
    for alpha in [0.0, 180.0] {
        assert!((0.22..0.25).contains(&sigma(alpha, "carry")), "{alpha}");
    }
    for alpha in [30.0, 75.0, 135.0] {
        for way in ["full", "carry"] {
            // The turn itself differs: 10 s one way or the other.
            let (a, b) = (sigma(alpha, way), sigma(-alpha, way));
            assert!((a / b - 1.0).abs() < 0.03, "{alpha} {way}: {a} {b}");
        }
        // A filter that carries everything is never worse than one that carries a part.
        assert!(sigma(alpha, "full") < sigma(alpha, "carry"));
    }
    // What the carried attitude adds goes with 1 − cos α, nothing beside the sin α of the biases at small angles.
    assert!(sigma(15.0, "full") / sigma(15.0, "carry") > 0.95);
    assert!(fs::metadata(folder.join("report.html")).unwrap().len() > 10_000);
}

#[test]
fn a_scenario_compares_the_ways() {
    let scenario = file("short.toml", SHORT);
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("compare");
    let o = common::lab_json([
        "align",
        "--json",
        "--scenario",
        scenario.to_str().unwrap(),
        "--report",
        folder.to_str().unwrap(),
    ]);
    let variants = o["variants"].as_array().unwrap();
    let names: Vec<&str> = variants
        .iter()
        .map(|v| v["variant"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["full", "carry", "one-position"]);
    assert_eq!(o["seeds"], 6);
    let sigma = |k: usize| variants[k]["heading_sigma_deg"].as_f64().unwrap();
    assert!(sigma(0) < sigma(2));
    for v in variants {
        // six seeds: a mean of χ²₁ is below 4 in 999 of 1000 cases
        assert!(v["groups"]["heading"]["anees"].as_f64().unwrap() < 4.0);
        assert_eq!(v["groups"]["gyro bias"]["within_3_sigma"], 1.0);
        assert!((v["nis_per_row"].as_f64().unwrap() - 1.0).abs() < 0.1);
    }
}

#[test]
fn parts_add_up_to_the_whole() {
    let scenario = file("parts.toml", SHORT);
    let scenario = scenario.to_str().unwrap();
    let run = |more: &[&str]| -> Value {
        let fixed = [
            "montecarlo",
            "--json",
            "--scenario",
            scenario,
            "--consistent",
        ];
        common::lab_json(fixed.iter().chain(more))
    };
    let whole = run(&[]);
    let parts: Vec<String> = (1..=3)
        .map(|i| {
            let part = file(&format!("part{i}.json"), "");
            let part = part.to_str().unwrap().to_owned();
            let o = run(&["--shard", &format!("{i}/3"), "--out", &part]);
            assert_eq!(o["seeds"], 2);
            part
        })
        .collect();
    let arguments = ["montecarlo", "--json", "--merge"].map(str::to_owned);
    let merged = common::lab_json(arguments.iter().chain(&parts));
    assert_eq!((&merged["seeds"], &whole["seeds"]), (&6.into(), &6.into()));
    let cells = |o: &Value| o["cells"].as_array().unwrap().clone();
    for (a, b) in cells(&merged).iter().zip(&cells(&whole)) {
        assert_eq!(
            (&a["variant"], &a["position"]),
            (&b["variant"], &b["position"])
        );
        for key in ["heading_rms_deg", "nis_per_row", "level_accel_rms_ug"] {
            let (x, y) = (a[key].as_f64().unwrap(), b[key].as_f64().unwrap());
            // sums in another order
            assert!((x / y - 1.0).abs() < 1e-9, "{key} {x} {y}");
        }
    }
    // A part twice, and a part of another run, are refused.
    let refuse = |files: [&str; 2], what: &str| {
        let arguments = ["montecarlo", "--merge"].iter().chain(&files);
        let output = common::lab(arguments);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(
            message.contains(what) && message.trim_end().lines().count() == 1,
            "{message}"
        );
    };
    refuse([&parts[0], &parts[0]], "shares: share 1 is there twice");
    let other = file("other.json", "");
    let other = other.to_str().unwrap();
    run(&["--seeds", "4", "--shard", "1/3", "--out", other]);
    refuse([&parts[1], other], "run: belongs to another run");
    refuse([&parts[1], scenario], "parts.toml:1: is no part of a run");
}

#[test]
fn what_is_wrong_with_a_scenario_is_one_line_with_its_place() {
    for (text, place) in [
        ("lat_deg = 95\n", ":1: lat_deg: 95 is outside -80 … 80"),
        ("seeds = 0\n", ":1: seeds: 0 is outside"),
        ("[sensor]\n\ngrade = \"best\"\n", ":3: sensor.grade: "),
        ("[[position]]\nseconds = 10\n", ": position[0]: "),
        (
            "[[position]]\nheading_deg = 1\nseconds = 10\n\n[[position]]\nheading_deg = \"n\"\n",
            ":6: position[1].heading_deg: ",
        ),
        ("[biases]\ngyro_deg_h = [1, 2]\n", ":2: biases.gyro_deg_h: "),
        (
            "[disturbance]\nvelocity = 1\n",
            ":2: disturbance.velocity: ",
        ),
        ("variants = [\"magic\"]\n", ":1: variants[0]: "),
        ("variants = []\n", ": variants: there is none"),
        ("turn_s = \n", ":1: "),
        ("interval_s = 0.1\nsample_s = 0.5\n", ": interval_s: "),
    ] {
        let path = file("wrong.toml", text);
        for command in ["align", "montecarlo"] {
            let output = common::lab([command, "--scenario", path.to_str().unwrap()]);
            let message = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(2), "{text}: {message}");
            assert!(message.contains(place), "{place}\n{message}");
            assert_eq!(message.trim_end().lines().count(), 1, "{message}");
            assert!(output.stdout.is_empty());
        }
    }
    for wrong in ["0/3", "4/3", "a/b", "3"] {
        let output = common::lab(["montecarlo", "--out", "x", "--shard", wrong]);
        assert_eq!(output.status.code(), Some(2), "{wrong}");
    }
}
