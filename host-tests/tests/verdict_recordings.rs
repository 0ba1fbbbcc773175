//! Verdicts on recorded data, through `lab replay`: every change comes with a reason, the reason belongs to the verdict,
//! and what is said at the end is what physics says of that recording.
//!
//! Reads `../shared/data` beside the repository; says so and passes where it is not there.
#![cfg(not(target_os = "none"))]

use std::path::PathBuf;

use serde_json::Value;

mod common;

/// `lab replay --json` on a recording, with TOML and further flags; None where it is not there.
fn replay(name: &str, toml: &str, flags: &[&str]) -> Option<Value> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data")
        .join(name);
    let imu = folder.join("imu.csv");
    if !imu.exists() {
        eprintln!("skipped: {} is not there", imu.display());
        return None;
    }
    let config = std::env::temp_dir().join(format!("navsight_verdicts_{name}.toml"));
    std::fs::write(&config, toml).unwrap();
    let mut arguments: Vec<String> = ["replay", "--json", "--imu"].map(String::from).to_vec();
    arguments.push(imu.display().to_string());
    arguments.extend(["--config".into(), config.display().to_string()]);
    let rest = folder.join("rest.csv");
    if rest.exists() {
        arguments.extend(["--rest".into(), rest.display().to_string()]);
    }
    arguments.extend(flags.iter().map(|f| (*f).to_owned()));
    Some(common::lab_json(arguments))
}

/// Every change is one, follows the one before, and its reason belongs to its verdict.
fn check_changes(name: &str, o: &Value) {
    let verdicts = |reason: &str| match reason {
        "NotYet" | "NothingSeen" | "Drifts" => "unseen",
        "NoiseWins" | "Slow" | "Fading" => "weak",
        "Falling" => "learning",
        "Required" | "PriorSuffices" | "AtRest" => "settled",
        "AtCeiling" | "Balance" | "Exhausted" => "limited",
        "InnovationsLarge" | "InnovationsSilent" | "MovesAlone" | "AboveCeiling" => "inconsistent",
        other => panic!("{name}: unknown reason {other}"),
    };
    let changes = o["verdict_changes"].as_array().unwrap();
    let states = o["states"].as_array().unwrap();
    let mut now = vec!["unseen".to_owned(); states.len()];
    let mut last = f64::NEG_INFINITY;
    for change in changes {
        let text = |key: &str| change[key].as_str().unwrap();
        let t = change["t_s"].as_f64().unwrap();
        assert!(t >= last, "{name}: {change}");
        last = t;
        let state = states.iter().position(|s| *s == change["state"]).unwrap();
        assert_eq!(text("from"), now[state], "{name}: {change}");
        assert_ne!(text("from"), text("to"), "{name}: {change}");
        assert_eq!(verdicts(text("reason")), text("to"), "{name}: {change}");
        assert!(text("sentence").ends_with('.'), "{name}: {change}");
        now[state] = text("to").to_owned();
    }
    // What is left is what is said at the end.
    for (now, end) in now.iter().zip(o["verdicts"].as_array().unwrap()) {
        assert_eq!(now, end, "{name}");
    }
    println!("{name}: {} changes", changes.len());
    for (state, word) in states.iter().zip(&now) {
        println!("  {:<28} {word}", state.as_str().unwrap());
    }
}

fn word(o: &Value, state: usize) -> &str {
    o["verdicts"][state].as_str().unwrap()
}

#[test]
fn a_navigation_grade_sensor_at_rest() {
    let toml = "[required]\nheading_deg = 0.05\nlevel_deg = 0.02\n";
    let Some(o) = replay(
        "laser_static",
        toml,
        &["--lat", "34.246048", "--height", "380"],
    ) else {
        return;
    };
    check_changes("laser_static", &o);
    // Heading 90°: the forward gyro points east, hides behind the heading, and limits it to 0.09°.
    assert_eq!((word(&o, 8), word(&o, 10)), ("limited", "unseen"));
    // The levels are as good as the accelerometers, 0.006°.
    assert_eq!((word(&o, 6), word(&o, 7)), ("settled", "settled"));
    // No position is measured, and nobody says more of it.
    assert!((0..3).all(|i| word(&o, i) == "unseen"));
    // Nothing in this recording contradicts its filter, though people and wind move the vehicle.
    let changes = o["verdict_changes"].as_array().unwrap();
    assert!(changes.iter().all(|c| c["to"] != "inconsistent"));
}

/// A MEMS sensor in the hand, its noise and drift widely set, its gyro bias in the first rest unknown.
const HAND: &str = "[sensor]\ngyro_bias_deg_h = 1500\naccel_bias_ug = 20000\nangle_walk_deg_sqrt_h = 1\n\
    velocity_walk_ug_sqrt_hz = 1000\n[zero_velocity]\nsigma_m_s = 0.02\ninterval_s = 0.1\n[coarse]\nseconds = 9\n";

#[test]
fn sensors_in_the_hand() {
    for name in ["hand_slow_rotation", "hand_slow_translation"] {
        let Some(o) = replay(name, HAND, &["--lat", "52.5"]) else {
            return;
        };
        check_changes(name, &o);
    }
}

#[test]
fn a_sensor_that_cannot_feel_the_earth_turn() {
    let toml = "[sensor]\ngyro_bias_deg_h = 1500\naccel_bias_ug = 10000\nangle_walk_deg_sqrt_h = 2.4\n\
        velocity_walk_ug_sqrt_hz = 700\n[zero_velocity]\nsigma_m_s = 0.01\n[required]\nheading_deg = 2\n";
    let flags = ["--lat", "40", "--axes", "x,-y,-z", "--to", "900"];
    let Some(o) = replay("mems_static", toml, &flags) else {
        return;
    };
    check_changes("mems_static", &o);
    // With a plain gyrocompass start and no gate this filter learns a heading from its own linearisation, and the verdict
    // must not call it settled; how it is done well is in `supervisor.rs`.
    assert!(
        matches!(word(&o, 8), "inconsistent" | "unseen" | "weak"),
        "{}",
        word(&o, 8)
    );
    let changes = o["verdict_changes"].as_array().unwrap();
    assert!(changes
        .iter()
        .all(|c| c["state"] != "heading" || c["to"] != "settled"));
}
