//! `lab replay --gnss` from a standing start, from outside: a simulated car that stands, is aligned, and drives away with
//! a late receiver on a lever arm. Whatever the configuration says of the receiver shows in the result.

use std::f64::consts::TAU;

use host_tests::sim::{Pose, Sensor, SensorErrors, Simulator, Trajectory, Truth};
use nalgebra::Vector3;
use navsight::earth::Geodetic;
use serde_json::Value;

mod common;
use common::{events, lab_json, refused};

fn written(name: &str, text: &str) -> String {
    common::written("lab_standing_start", name, text)
}

/// Stands for [`STANDING`], then speeds up and slows down, left and right.
#[derive(Clone, Copy)]
struct Car;

const STANDING: f64 = 70.0;
const SECONDS: f64 = 180.0;
const DT: f64 = 0.02;
/// Between two fixes: samples.
const FIX: usize = 10;
/// Of the receiver [s].
const LATE: f64 = 0.3;
/// From the IMU to the antenna [m].
const LEVER: Vector3<f64> = Vector3::new(0.5, 2.0, 1.5);
/// One line of the recording covers all samples of these times [s].
const GAP: [f64; 2] = [95.0, 95.2];

impl Trajectory for Car {
    fn start(&self) -> Geodetic {
        Geodetic::from_degrees(48.0, 9.0, 500.0)
    }
    fn pose(&self, t: f64) -> Pose {
        let t = (t - STANDING).max(0.0);
        let (w, u) = (TAU / 30.0, TAU / 40.0);
        let heading = 1.0 + 0.9 * (1.0 - (w * t).cos());
        let rate = 0.9 * w * (w * t).sin();
        let (v, a) = (8.0 * (1.0 - (u * t).cos()), 8.0 * u * (u * t).sin());
        Pose::along(heading, rate, v, a)
    }
}

/// Recordings of that car and its last state; from `jump` on the fixes are 200 m further north.
struct Recording {
    imu: String,
    gnss: String,
    /// The same without velocities.
    places: String,
    rest: String,
    last: Truth,
}

fn recorded(name: &str, jump: f64) -> Recording {
    let errors = SensorErrors::NAVIGATION.with_biases([0.01, -0.01, 0.01], [50.0, -50.0, 50.0]);
    let mut sensor = Sensor::new(errors, 5);
    let mut imu = String::from("t_s,dtheta_x,dtheta_y,dtheta_z,dvel_x,dvel_y,dvel_z\n");
    let mut truths: Vec<Truth> = Vec::new();
    let (mut theta, mut vel) = (Vector3::<f64>::zeros(), Vector3::<f64>::zeros());
    for (truth, ideal) in Simulator::new(Car, DT).take((SECONDS / DT).round() as usize) {
        let s = sensor.sample(&ideal);
        theta += s.delta_theta_b.cast::<f64>();
        vel += s.delta_v_b.cast::<f64>();
        let t = truth.time;
        if !(GAP[0] + 0.5 * DT..GAP[1] - 0.5 * DT).contains(&t) {
            let (g, a) = (theta, vel);
            imu += &format!("{t:.3},{},{},{},{},{},{}\n", g.x, g.y, g.z, a.x, a.y, a.z);
            (theta, vel) = (Vector3::zeros(), Vector3::zeros());
        }
        truths.push(truth);
    }
    let places = String::from("t_s,lat_deg,lon_deg,height_m");
    let (mut gnss, mut places) = (places.clone() + ",v_e,v_n,v_u\n", places + "\n");
    let arm = |k: usize| truths[k].q * LEVER;
    for k in (FIX..truths.len() - 1).step_by(FIX) {
        let truth = &truths[k];
        let swing = (arm(k + 1) - arm(k - 1)) / (2.0 * DT);
        let v = truth.v_n + swing + sensor.normal() * 0.05;
        let north = if truth.time >= jump { 200.0 } else { 0.0 };
        let e = arm(k) + sensor.normal() + Vector3::y() * north;
        let lat = (truth.lat + e.y / 6.366e6).to_degrees();
        let lon = (truth.lon + e.x / 6.39e6 / truth.lat.cos()).to_degrees();
        let (t, up) = (truth.time + LATE, truth.height + e.z);
        let place = format!("{t:.3},{lat:.9},{lon:.9},{up:.3}");
        gnss += &format!("{place},{},{},{}\n", v.x, v.y, v.z);
        places += &format!("{place}\n");
    }
    let file = |kind: &str, text: &str| written(&format!("{name}_{kind}.csv"), text);
    Recording {
        imu: file("imu", &imu),
        gnss: file("gnss", &gnss),
        places: file("places", &places),
        rest: file("rest", &format!("t_s,at_rest\n0,1\n{STANDING},0\n")),
        last: *truths.last().unwrap(),
    }
}

const ARM: &str = "lever_arm_m = [0.5, 2, 1.5]\n";

/// What the lab is told of it: its priors and noise as they are.
fn config(name: &str, arm: &str, wheels: &str) -> String {
    let text = format!(
        "[gnss]\nposition_m = 1\nheight_m = 1\nvelocity_m_s = 0.05\nlatency_s = {LATE}\nlock_out_s = 3\n{arm}\
         [filter]\ngate = 25\n{wheels}"
    );
    written(&format!("{name}.toml"), &text)
}

fn replay(r: &Recording, gnss: &str, config: &str, more: &[&str]) -> Value {
    let what = ["replay", "--json", "--imu", &r.imu];
    let told = ["--gnss", gnss, "--config", config];
    lab_json(what.iter().chain(&told).chain(more))
}

fn number(o: &Value, part: &str, name: &str) -> f64 {
    o[part][name].as_f64().unwrap()
}

/// Horizontal error at the end [m].
fn away(o: &Value, truth: &Truth) -> f64 {
    let north = (number(o, "final", "lat_deg").to_radians() - truth.lat) * 6.366e6;
    let east = number(o, "final", "lon_deg").to_radians() - truth.lon;
    north.hypot(east * 6.39e6 * truth.lat.cos())
}

#[test]
fn latency_and_lever_arm_count() {
    let r = recorded("drive", f64::INFINITY);
    let (right, no_arm) = (config("right", ARM, ""), config("no_arm", "", ""));
    let o = replay(&r, &r.gnss, &right, &[]);
    let told = events(&o);
    assert!(o["coarse"].is_object() && told.contains("coarse alignment done"));
    assert!(
        told.contains("a gap of 200 ms") && !told.contains("reset"),
        "{told}"
    );
    let nis = number(&o, "nis", "mean_per_row");
    let good = away(&o, &r.last);
    let heading = (r.last.euler.x.to_degrees() - number(&o, "final", "heading_deg") + 180.0)
        .rem_euclid(360.0)
        - 180.0;
    let sigma = number(&o, "final", "heading_deg_sigma");
    println!("{good:.2} m, heading {heading:.3}° (σ {sigma:.3}°), ν²/s {nis:.3}");
    // Fixes of 1 m, of which some tens count; noise as it is told, 3,600 rows: 1 ± 0.024.
    assert!(good < 0.5 && (0.9..1.1).contains(&nis), "{good} {nis}");
    assert!(
        heading.abs() < 3.0 * sigma && sigma < 1.0,
        "{heading} {sigma}"
    );
    // 8 m/s at the end: 2.4 m in 0.3 s. The antenna is 2.06 m from the IMU, of which the noise and what the swing of the
    // antenna does to the velocity leave half at the least.
    for (config, flags, least) in [(&right, &["--latency", "0"][..], 1.8), (&no_arm, &[], 1.0)] {
        let o = replay(&r, &r.gnss, config, flags);
        let (bad, surprise) = (away(&o, &r.last), number(&o, "nis", "mean_per_row"));
        println!("{bad:.2} m, ν²/s {surprise:.3}");
        assert!(bad > least && surprise > 1.3 * nis, "{bad} {surprise}");
    }
}

#[test]
fn fixes_rest_and_wheels_are_used() {
    let r = recorded("aids", f64::INFINITY);
    let plain = config("plain", ARM, "");
    let updates = |o: &Value| o["nis"]["updates"].as_u64().unwrap();
    let all = replay(&r, &r.gnss, &plain, &[]);
    // Five fixes a second, each of two halves, from the end of the coarse window on; the first 0.3 s are of before that.
    let expected = (SECONDS - 60.0 - LATE) * 10.0;
    let count = updates(&all) as f64;
    assert!((count - expected).abs() <= 4.0, "{count} {expected}");
    // Without velocities half of them are left, and the place is held.
    let places = replay(&r, &r.places, &plain, &[]);
    assert_eq!(updates(&places), updates(&all) / 2);
    assert!(away(&places, &r.last) < 1.0, "{}", away(&places, &r.last));
    // 20 s without fixes
    let out = replay(&r, &r.gnss, &plain, &["--outage", "120", "140"]);
    assert_eq!(updates(&out), updates(&all) - 200);
    assert!(events(&out).contains("fixes from 120 s to 140 s are left out"));
    // Rest flags are a zero-velocity update a second, until the car leaves.
    let flagged = replay(&r, &r.gnss, &plain, &["--rest", &r.rest]);
    let more = updates(&flagged) - updates(&all);
    assert!((9..=10).contains(&more), "{more}");
    assert!(away(&flagged, &r.last) < 0.5);
    // And without fixes they are all there is: the same ten.
    let alone = lab_json([
        "replay", "--json", "--lat", "48", "--imu", &r.imu, "--rest", &r.rest,
    ]);
    assert_eq!(updates(&alone), more);
    // Wheels are used five times a second, and mislead the car where they are told to be crooked.
    let told = "[wheels]\nsideways_m_s = 0.05\nupwards_m_s = 0.05\nboresight_deg = ";
    let wheels = config("wheels", ARM, &format!("{told}[0, 0, 0]\n"));
    let crooked = config("crooked", ARM, &format!("{told}[6, 0, 0]\n"));
    let outage = ["--outage", "150", "200"];
    let [with, wrong] = [&wheels, &crooked].map(|c| replay(&r, &r.gnss, c, &outage));
    let without = replay(&r, &r.gnss, &plain, &outage);
    let rolls = updates(&with) - updates(&without);
    assert!((598..=600).contains(&rolls), "{rolls}");
    let [without, with, wrong] = [without, with, wrong].map(|o| away(&o, &r.last));
    println!("after 30 s without fixes {without:.2} m, wheels {with:.2} m, crooked {wrong:.2} m");
    assert!(with < 3.0 && wrong > 5.0 * with, "{with} {wrong}");
}

/// What the receiver says of a fix goes before the configuration.
#[test]
fn accuracies_of_the_receiver_are_used() {
    let r = recorded("accuracy", f64::INFINITY);
    let config = config("accuracy", ARM, "");
    let fixes = std::fs::read_to_string(&r.gnss).unwrap();
    let with = |said: &str| {
        let mut lines = fixes.lines();
        let mut text = lines.next().unwrap().to_owned() + ",h_acc_m,v_acc_m,s_acc_m_s\n";
        lines.for_each(|line| text += &format!("{line},{said}\n"));
        written("accuracy_said.csv", &text)
    };
    let plain = replay(&r, &r.gnss, &config, &[]);
    let same = replay(&r, &with("1,1,0.05"), &config, &[]);
    assert_eq!(same["final"], plain["final"]);
    // Twice as much: a quarter of ν²/s, and twice the σ where hardly anything else counts.
    let twice = replay(&r, &with("2,2,0.1"), &config, &[]);
    let ratio = |part, name| number(&twice, part, name) / number(&plain, part, name);
    let (nis, sigma) = (
        ratio("nis", "mean_per_row"),
        ratio("final", "height_m_sigma"),
    );
    println!("ν²/s {nis:.3}, σ of the height {sigma:.3} of what they were");
    assert!((nis - 0.25).abs() < 0.02 && (1.7..2.05).contains(&sigma));
    for (said, field) in [
        ("0,1,1", "h_acc_m"),
        ("1,-1,1", "v_acc_m"),
        ("1,1,fine", "s_acc_m_s"),
    ] {
        let damaged = with(said);
        let message = refused(&["replay", "--imu", &r.imu, "--gnss", &damaged]);
        assert!(
            message.contains(&format!("{damaged}:2: {field}: ")),
            "{message}"
        );
    }
}

#[test]
fn a_lock_out_ends_with_a_reset_that_is_told() {
    let r = recorded("jump", 110.0);
    let o = replay(&r, &r.gnss, &config("jump", ARM, ""), &[]);
    let told = events(&o);
    assert!(told.contains("beyond the gate") && told.contains("reset to the position fixes"));
    // one row of fifteen fixes in the 3 s before
    assert!(o["rejected"].as_u64().unwrap() >= 14);
    assert!((away(&o, &r.last) - 200.0).abs() < 1.0);
    // The first refused one, and the reset 3 s later.
    let at = |what: &str| {
        let all = o["events"].as_array().unwrap();
        let first = all
            .iter()
            .find(|e| e["event"].as_str().unwrap().contains(what));
        first.unwrap()["t_s"].as_f64().unwrap()
    };
    assert!((at("reset to") - at("beyond") - 3.0).abs() < 0.25);
}

/// `--in-motion` waits for the motion.
#[test]
fn in_motion_a_vehicle_that_stands_tells_nothing() {
    let mut imu = String::from("t_s,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z\n");
    let mut gnss = String::from("t_s,lat_deg,lon_deg,height_m,v_e,v_n,v_u\n");
    for k in 1..=200 {
        let t = 0.1 * f64::from(k);
        imu += &format!("{t},0,0,0,0,0,9.8\n");
        if k % 10 == 0 {
            gnss += &format!("{t},48,9,500,0,0,0\n");
        }
    }
    let (imu, gnss) = (
        written("still_imu.csv", &imu),
        written("still_gnss.csv", &gnss),
    );
    let message = refused(&["replay", "--in-motion", "--imu", &imu, "--gnss", &gnss]);
    assert!(message.contains("no attitude was found"), "{message}");
}

#[test]
fn bad_configuration_is_one_line() {
    let imu = written(
        "few_imu.csv",
        "t_s,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z\n0.1,0,0,0,0,0,9.8\n0.2,0,0,0,0,0,9.8\n",
    );
    let gnss = written(
        "few_gnss.csv",
        "t_s,lat_deg,lon_deg,height_m\n0.1,48,9,500\n",
    );
    let with = |gnss: &str, more: &[&str]| {
        refused(&[&["replay", "--imu", &imu, "--gnss", gnss][..], more].concat())
    };
    for (text, place) in [
        ("[gnss]\nlatency_s = -0.1\n", ":2: gnss.latency_s: -0.1 "),
        ("[gnss]\n\nlatency_s = 60\n", ":3: gnss.latency_s: 60 "),
        ("[gnss]\nlock_out_s = -1\n", ":2: gnss.lock_out_s: -1 "),
        ("[gnss]\nposition_m = 0\n", ":2: gnss.position_m: 0 "),
        (
            "[gnss]\nvelocity_m_s = nan\n",
            ":2: gnss.velocity_m_s: NaN ",
        ),
        (
            "[gnss]\nlever_arm_m = [0, 1000, 0]\n",
            ":2: gnss.lever_arm_m: ",
        ),
        (
            "[gnss]\nlever_arm_m = [0, inf, 0]\n",
            ":2: gnss.lever_arm_m: ",
        ),
        ("[filter]\ngate = 0\n", ":2: filter.gate: 0 "),
        ("[filter]\ngap_s = -1\n", ":2: filter.gap_s: -1 "),
        (
            "[wheels]\nsideways_m_s = 0\n",
            ":2: wheels.sideways_m_s: 0 ",
        ),
        ("[wheels]\naxle_m = [0, -300, 0]\n", ":2: wheels.axle_m: "),
        ("[coarse]\nseconds = 5\n", ":2: coarse.seconds: 5 "),
        ("[sensor]\ngyro_tau_h = 0\n", ":2: sensor.gyro_tau_h: 0 "),
        (
            "[required]\nheading_deg = -1\n",
            ":2: required.heading_deg: -1 ",
        ),
    ] {
        let config = written("wrong.toml", text);
        let message = with(&gnss, &["--config", &config]);
        assert!(message.contains(&format!("{config}{place}")), "{message}");
    }
    for seconds in ["-1", "9", "nan", "soon"] {
        let message = with(&gnss, &["--latency", seconds]);
        assert!(
            message.contains("--latency") && message.contains(seconds),
            "{message}"
        );
    }
    assert!(refused(&["replay", "--imu", &imu, "--latency", "1"]).contains("--gnss"));
    // A fix that is nowhere stops the run with its own line: there the filter must run already.
    let r = recorded("nowhere", f64::INFINITY);
    let fixes = std::fs::read_to_string(&r.gnss).unwrap();
    let line = fixes
        .lines()
        .position(|line| line.starts_with("100.120,"))
        .unwrap();
    let moon = fixes.replace("\n100.120,", "\n100.120,48,9,4e8,0,0,0\n100.121,");
    let moon = written("moon_gnss.csv", &moon);
    let message = refused(&["replay", "--imu", &r.imu, "--gnss", &moon]);
    assert!(
        message.contains(&format!("{moon}:{}: ", line + 1)),
        "{message}"
    );
    assert!(message.contains("height_m"), "{message}");
}
