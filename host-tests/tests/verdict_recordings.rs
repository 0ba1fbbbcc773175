//! Verdicts on recorded data, through `lab replay`: every change comes with a reason, the reason belongs to the verdict and
//! is borne by what the updates said, summed up anew in f64, and what is said at the end is what physics says of that recording.
//!
//! Reads `../shared/data` beside the repository; says so and passes where it is not there.
#![cfg(not(target_os = "none"))]

use std::path::PathBuf;

use host_tests::stationary::{each, mems};
use navsight::observability::verdict::Limits;
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
    for (flag, file) in [("--gnss", "gnss.csv"), ("--ref", "ref.csv")] {
        let file = folder.join(file);
        if flags.contains(&"--in-motion") && file.exists() {
            arguments.extend([flag.into(), file.display().to_string()]);
        }
    }
    arguments.extend(flags.iter().map(|f| (*f).to_owned()));
    Some(common::lab_json(arguments))
}

/// Whether what the updates said bears the reason: the thresholds of `Limits::DEFAULT`, those for holding a verdict where
/// it may have been held, and some percent for what the verdict sums up in f32 and with a cheaper logarithm.
fn bears(change: &Value) -> bool {
    let l = Limits::DEFAULT;
    let rest = f64::from(l.rest);
    let get = |key: &str| change[key].as_f64();
    let x = |key: &str| get(key).unwrap_or(f64::NAN);
    let (xi2, net, learnt) = (x("xi2"), x("net_per_s"), x("learnt_per_s"));
    let reached = get("required").map(|required| x("sigma") <= 1.06 * required);
    let falling = net < -0.8 * rest;
    let known = xi2 >= 1.8;
    match change["reason"].as_str().unwrap() {
        "NothingSeen" => xi2 < 1.11 && learnt < 1.1 * rest,
        "Drifts" => xi2 < 0.91,
        "NoiseWins" => xi2 < 1.11 && learnt > 0.9 * rest,
        "Slow" => xi2 < 2.01 && net > -1.1 * rest,
        "Fading" => net > 0.9 * rest || x("grown") > 2.2,
        "Falling" => reached != Some(true) && falling,
        "Required" => reached == Some(true) && known,
        "PriorSuffices" => reached == Some(true) && xi2 < 2.01,
        "AtRest" => reached.is_none() && known && net > -1.1 * rest,
        "AtCeiling" => xi2 > 0.8 * x("ceiling"),
        "Balance" => known && net > -1.1 * rest && learnt > 0.9 * rest,
        "Exhausted" => known && net > -1.1 * rest && learnt < 1.1 * rest,
        "InnovationsLarge" => known && x("innovations") > 0.7 * f64::from(l.nis),
        "InnovationsSilent" => known && x("innovations") < 1.1 * f64::from(l.silent),
        "MovesAlone" => x("moved") > 0.7 * f64::from(l.moves),
        "AboveCeiling" => xi2 > (1.0 + 0.7 * f64::from(l.margin)) * x("ceiling"),
        _ => false,
    }
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
        assert!(bears(change), "{name}: {change}");
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

/// A person walks and halts; nobody has annotated when. The halts are those of the library's own detector, with the
/// settings of `stationary.rs`.
#[test]
fn halts_of_a_walk() {
    let imu = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/walk_zupt/imu.csv");
    if !imu.exists() {
        eprintln!("skipped: {} is not there", imu.display());
        return;
    }
    let mut flags = String::from("t_s,at_rest\n0,1\n"); // the first window is open when the recording begins
    each(&imu, mems(0.0045, 18.0), |t, _, look, _| {
        if let Some(look) = look {
            flags += &format!("{t},{}\n", u8::from(look.still));
        }
    })
    .unwrap();
    let rest = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("walk_rest.csv");
    std::fs::write(&rest, flags).unwrap();
    // The axes point forward, right, down or so: up is what gravity says, heading is anything.
    let toml = "[sensor]\ngyro_bias_deg_h = 500\naccel_bias_ug = 5000\nangle_walk_deg_sqrt_h = 0.5\n\
        velocity_walk_ug_sqrt_hz = 100\n[zero_velocity]\nsigma_m_s = 0.02\ninterval_s = 0.1\n[coarse]\nseconds = 9\n";
    let flags = [
        "--lat",
        "59.35",
        "--axes",
        "x,-y,-z",
        "--rest",
        rest.to_str().unwrap(),
    ];
    let Some(o) = replay("walk_zupt", toml, &flags) else {
        return;
    };
    check_changes("walk_zupt", &o);
    assert!(o["verdict_changes"].as_array().unwrap().len() >= 10);
    // Halts measure velocity, which was learnt to centimetres a second; a level, but no place.
    assert!((0..2).all(|i| word(&o, i) != "settled"));
}

/// A flight with satellite fixes, its heading found in motion.
#[test]
fn a_flight() {
    let toml = "[sensor]\ngyro_bias_deg_h = 1500\naccel_bias_ug = 20000\nangle_walk_deg_sqrt_h = 1\n\
        velocity_walk_ug_sqrt_hz = 3000\n[gnss]\nlatency_s = 0.24\nvelocity_m_s = 0.5\n[required]\nheading_deg = 3\n";
    let Some(o) = replay("quad_flight", toml, &["--in-motion"]) else {
        return;
    };
    check_changes("quad_flight", &o);
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
    // It claims more of tilt and accelerometers too than standing teaches, to the end.
    for (i, state) in [
        (8, "heading"),
        (7, "tilt about north"),
        (12, "accelerometer bias right"),
    ] {
        let above = |c: &Value| c["state"] == state && c["reason"] == "AboveCeiling";
        assert!(changes.iter().any(above), "{state}");
        assert_eq!(word(&o, i), "inconsistent");
    }
}
