//! `lab replay --in-motion` from outside: a simulated car whose truth is known, a recorded quadrotor, and one line for bad
//! input.

use std::fs;
use std::path::{Path, PathBuf};

use host_tests::sim::{Pose, Sensor, SensorErrors, Simulator, Trajectory, Truth};
use nalgebra::{Matrix3, Vector3};
use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use serde_json::Value;

mod common;
use common::{events, lab, lab_json, refused};

fn scratch(name: &str) -> PathBuf {
    common::scratch("lab_flight", name)
}

fn written(name: &str, text: &str) -> String {
    common::written("lab_flight", name, text)
}

/// A car in the plane: its speed goes up and down, and it turns left and right.
#[derive(Clone, Copy)]
struct Car;

impl Trajectory for Car {
    fn start(&self) -> Geodetic {
        Geodetic::from_degrees(48.0, 9.0, 500.0)
    }
    fn pose(&self, t: f64) -> Pose {
        let (w, u) = (std::f64::consts::TAU / 30.0, std::f64::consts::TAU / 47.0);
        let heading = 1.0 + 0.9 * (1.0 - (w * t).cos());
        let rate = 0.9 * w * (w * t).sin();
        let v = 12.0 - 6.0 * (u * t).cos();
        let a = 6.0 * u * (u * t).sin();
        Pose::along(heading, rate, v, a)
    }
}

const SECONDS: usize = 150;
/// Vehicle in the axes of the IMU: 6° to the right, 2° up.
const BORESIGHT: [f32; 3] = [6.0, 2.0, 0.0];

/// Recordings of that car: `imu.csv`, `gnss.csv`; from `jump` on the fixes are 200 m further north.
fn recorded(name: &str, jump: f64) -> ([String; 2], Vec<Truth>) {
    let [h, p, r] = BORESIGHT;
    let c_m_b: Matrix3<f64> = Euler::from_degrees(h, p, r).c_b_n().cast();
    let mut sensor = Sensor::new(SensorErrors::TACTICAL, 4);
    let mut imu = String::from("t_s,dtheta_x,dtheta_y,dtheta_z,dvel_x,dvel_y,dvel_z\n");
    let mut gnss = String::from("t_s,lat_deg,lon_deg,height_m,v_e,v_n,v_u\n");
    let mut truths = Vec::new();
    for (k, (truth, mut ideal)) in Simulator::new(Car, 0.02).take(SECONDS * 50).enumerate() {
        ideal.delta_theta_b = c_m_b * ideal.delta_theta_b;
        ideal.delta_v_b = c_m_b * ideal.delta_v_b;
        let s = sensor.sample(&ideal);
        let (g, a) = (s.delta_theta_b, s.delta_v_b);
        let t = truth.time;
        imu += &format!("{t:.3},{},{},{},{},{},{}\n", g.x, g.y, g.z, a.x, a.y, a.z);
        if k % 10 == 9 {
            let v = truth.v_n + sensor.normal() * 0.05;
            let e = sensor.normal() + Vector3::y() * if t >= jump { 200.0 } else { 0.0 };
            let lat = (truth.lat + e.y / 6.366e6).to_degrees();
            let lon = (truth.lon + e.x / 6.39e6 / truth.lat.cos()).to_degrees();
            // 0.1 s in the receiver
            let (t, up) = (t + 0.1, truth.height + e.z);
            gnss += &format!("{t:.3},{lat:.9},{lon:.9},{up:.3},{},{},{}\n", v.x, v.y, v.z);
        }
        truths.push(truth);
    }
    let files = [
        written(&format!("{name}_imu.csv"), &imu),
        written(&format!("{name}_gnss.csv"), &gnss),
    ];
    (files, truths)
}

/// Settings of that car.
fn config(name: &str, wheels: &str) -> String {
    let text = format!(
        "[sensor]\nangle_walk_deg_sqrt_h = 0.1\nvelocity_walk_ug_sqrt_hz = 100\ngyro_bias_deg_h = 10\n\
         accel_bias_ug = 1000\n[prior]\nlevel_deg = 1\nheading_deg = 5\n[gnss]\nposition_m = 1\nheight_m = 1\n\
         velocity_m_s = 0.05\nlatency_s = 0.1\nlock_out_s = 3\n[filter]\ngate = 25\n[required]\nheading_deg = 1\n{wheels}"
    );
    written(&format!("{name}.toml"), &text)
}

fn replay(files: &[String; 2], config: &str, more: &[&str]) -> Value {
    let [imu, gnss] = files;
    let all = [
        "replay",
        "--in-motion",
        "--imu",
        imu,
        "--gnss",
        gnss,
        "--config",
        config,
        "--json",
    ];
    lab_json(all.iter().chain(more))
}

/// Heading of the vehicle minus what was found for the IMU [°], and the horizontal error [m].
fn errors(o: &Value, truth: &Truth) -> (f64, f64) {
    let at = |name: &str| o["final"][name].as_f64().unwrap();
    let off = truth.euler.x.to_degrees() - f64::from(BORESIGHT[0]) - at("heading_deg");
    let north = (at("lat_deg").to_radians() - truth.lat) * 6.366e6;
    let east = (at("lon_deg").to_radians() - truth.lon) * 6.39e6 * truth.lat.cos();
    ((off + 180.0).rem_euclid(360.0) - 180.0, north.hypot(east))
}

const WHEELS: &str =
    "[wheels]\nboresight_deg = [6, 2, 0]\nsideways_m_s = 0.05\nupwards_m_s = 0.05\n";

#[test]
fn a_car_is_replayed_by_its_configuration() {
    let (files, truths) = recorded("car", f64::INFINITY);
    let last = truths.last().unwrap();
    let (plain, wheels) = (config("plain", ""), config("wheels", WHEELS));
    let crooked = config("crooked", &WHEELS.replace("[6, 2, 0]", "[0, 0, 0]"));
    let o = replay(&files, &plain, &[]);
    let (heading, away) = errors(&o, last);
    println!("heading {heading:.3}°, {away:.2} m");
    // 1 °/√h·0.1, and fixes of 1 m
    assert!(heading.abs() < 0.5 && away < 1.0, "{heading} {away}");
    assert!(o["coarse"].is_null() && events(&o).contains("attitude found in motion"));
    let heading_sigma = o["final"]["heading_deg_sigma"].as_f64().unwrap();
    assert!(
        heading.abs() < 3.0 * heading_sigma,
        "{heading} {heading_sigma}"
    );
    let done = o["manoeuvres"].as_array().unwrap();
    assert!(done.iter().any(|m| m["what"] == "turn"), "{done:?}");
    // In an outage verdicts fade, though no update says so: after twenty seconds without fixes positions are known to less
    // than before, and it is told while it lasts.
    let o20 = replay(&files, &plain, &["--outage", "100", "125"]);
    let faded = |c: &&Value| {
        let t = c["t_s"].as_f64().unwrap();
        c["state"] == "position east" && c["to"] == "weak" && (100.0..125.0).contains(&t)
    };
    assert!(o20["verdict_changes"]
        .as_array()
        .unwrap()
        .iter()
        .any(|c| faded(&c)));
    assert!(!o["verdict_changes"]
        .as_array()
        .unwrap()
        .iter()
        .any(|c| faded(&c)));
    // Half a minute without fixes at the end: wheels hold the car on its track; told to be straight, they mislead it.
    let out = |config: &str| {
        let o = replay(&files, config, &["--outage", "118", "200"]);
        assert!(events(&o).contains("fixes from 118 s to 200 s are left out"));
        errors(&o, last).1
    };
    let (without, with, wrong) = (out(&plain), out(&wheels), out(&crooked));
    println!("after an outage {without:.2} m, with wheels {with:.2} m, without their boresight {wrong:.2} m");
    assert!(
        with < 0.5 * without && wrong > 3.0 * with,
        "{without} {with} {wrong}"
    );
    // The configured delay is used, and --latency goes before it.
    let late = replay(&files, &plain, &["--latency", "0.4"]);
    assert!(
        late["nis"]["mean_per_row"].as_f64() > o["nis"]["mean_per_row"].as_f64().map(|x| 2.0 * x)
    );
}

#[test]
fn a_lock_out_ends_with_a_reset_that_is_told() {
    let (files, truths) = recorded("jump", 80.0);
    let o = replay(&files, &config("jump", ""), &[]);
    assert!(
        events(&o).contains("reset to the position fixes"),
        "{}",
        events(&o)
    );
    // some rows were refused before, 3 s of five fixes a second
    assert!(o["rejected"].as_u64().unwrap() >= 10);
    let (_, away) = errors(&o, truths.last().unwrap());
    assert!((away - 200.0).abs() < 3.0, "{away}");
}

#[test]
fn the_report_shows_where_and_when() {
    let (files, _) = recorded("report", f64::INFINITY);
    let [imu, gnss] = &files;
    let (folder, config) = (scratch("report"), config("report", ""));
    let output = lab([
        "replay",
        "--in-motion",
        "--imu",
        imu,
        "--gnss",
        gnss,
        "--config",
        &config,
        "--outage",
        "100",
        "120",
        "--report",
        folder.to_str().unwrap(),
    ]);
    assert!(output.status.success(), "{output:?}");
    let html = fs::read_to_string(folder.join("report.html")).unwrap();
    for word in [
        "Trajectory and speed",
        "Innovations of the fixes",
        "outage of the fixes",
        ">turn<",
        "\noutage\n",
        "accelerometer bias up",
    ] {
        assert!(html.contains(word), "{word}");
    }
    // attitude and σ, track and speed, innovations, ξ2, ν²/s
    assert_eq!(html.matches("<svg").count(), 6 + 2 + 6 + 15 + 1);
}

#[test]
fn bad_input_is_one_line() {
    let imu = written(
        "few_imu.csv",
        "t_s,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z\n0.1,0,0,0,0,0,9.8\n0.2,0,0,0,0,0,9.8\n",
    );
    let fixes =
        "t_s,lat_deg,lon_deg,height_m,v_e,v_n,v_u\n0.1,48,9,500,1,0,0\n0.2,48,9,500,1,0,0\n";
    let gnss = written("few_gnss.csv", fixes);
    let with = |gnss: &str, more: &[&str]| {
        let all = [
            &["replay", "--in-motion", "--imu", &imu, "--gnss", gnss][..],
            more,
        ];
        refused(&all.concat())
    };
    for (outage, word) in [
        (&["20", "10"][..], "--outage: "),
        (&["20", "20"], "--outage: "),
        (&["nan", "20"], "--outage: "),
        (&["1"], "--outage"),
        (&["one", "two"], "--outage"),
    ] {
        let message = with(&gnss, &[&["--outage"], outage].concat());
        assert!(message.contains(word), "{message}");
    }
    assert!(with("absent.csv", &[]).contains("absent.csv: cannot be read"));
    assert!(with(&gnss, &[]).contains("no attitude was found"));
    for (name, from, to, place) in [
        ("word", "0.2,48,9,500", "0.2,north,9,500", ":3: lat_deg: "),
        ("place", "0.2,48,9,500", "0.2,91,9,500", ":3: lat_deg: "),
        ("back", "0.2,48", "0.1,48", ":3: t_s: "),
        ("short", "500,1,0,0\n0.2", "500,1,0\n0.2", ":2: v_u: "),
        ("nan", "0.2,48,9,500,1,0", "0.2,48,9,500,1,nan", ":3: v_n: "),
        ("column", "v_e,v_n,v_u", "v_e,v_n,v_d", ":1: v_u: "),
    ] {
        let damaged = written(&format!("{name}_gnss.csv"), &fixes.replace(from, to));
        let message = with(&damaged, &[]);
        assert!(message.contains(&format!("{damaged}{place}")), "{message}");
    }
    let places = fixes.replace(",v_e,v_n,v_u", "").replace(",1,0,0", "");
    let places = written("places_gnss.csv", &places);
    assert!(with(&places, &[]).contains("no velocities"));
    assert!(refused(&["replay", "--imu", &imu, "--in-motion"]).contains("--gnss"));
    for (text, place) in [
        ("[wheels]\nboresight = 3\n", ":2: wheels.boresight: "),
        ("[gnss]\nlever_arm_m = [1, 2]\n", ":2: gnss.lever_arm_m: "),
    ] {
        let config = written("wrong.toml", text);
        let message = with(&gnss, &["--config", &config]);
        assert!(message.contains(&format!("{config}{place}")), "{message}");
    }
    assert!(refused(&["track", "--outage", "3", "2"]).contains("--outage: "));
}

#[test]
fn the_recorded_quadrotor() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/quad_flight");
    if !folder.exists() {
        println!("skipped: {} is not there", folder.display());
        return;
    }
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/quad_flight.toml");
    let reference = file("ref.csv");
    let files = [file("imu.csv"), file("gnss.csv")];
    let o = replay(&files, config.to_str().unwrap(), &["--ref", &reference]);
    // From the start of the filter at 24 s on; the bounds are those of tests/quad_flight.rs from 60 s on.
    let rms = |name: &str| o["rms_vs_ref"][name].as_f64().unwrap();
    println!("roll {}, pitch {}", rms("roll_deg"), rms("pitch_deg"));
    assert!(rms("roll_deg") <= 0.88 && rms("pitch_deg") <= 0.80);
    let told = events(&o);
    assert!(
        told.contains("a gap of 403 ms") && !told.contains("reset"),
        "{told}"
    );
    // The hover is seen as one,
    let hovers = o["manoeuvres"].as_array().unwrap().iter();
    let hover: f64 = hovers
        .filter(|m| m["what"] == "hover or rest")
        .map(|m| {
            let at = |key: &str| m[key].as_f64().unwrap().clamp(430.0, 590.0);
            at("to_s") - at("from_s")
        })
        .sum();
    assert!(hover > 120.0, "{hover}");
    // and the verdict about heading in it is the pinned one: weak from 430 s to 622 s.
    let changes: Vec<(f64, &str)> = o["verdict_changes"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|c| c["state"] == "heading")
        .map(|c| (c["t_s"].as_f64().unwrap(), c["to"].as_str().unwrap()))
        .collect();
    let at = |t: f64| changes.iter().rev().find(|c| c.0 <= t).unwrap().1;
    assert_eq!(
        (at(432.0), at(594.0), at(630.0)),
        ("weak", "weak", "settled")
    );
    assert!(!changes.iter().any(|c| (480.0..592.0).contains(&c.0)));
}
