//! What every command of the lab promises at its edges: one JSON object and nothing else on standard output, one line
//! and exit code 2 for bad input, and a report that needs nothing from outside.
#![cfg(not(target_os = "none"))]

use std::fs;
use std::path::PathBuf;

mod common;

use common::{lab, lab_json, refused};

fn scratch(name: &str) -> PathBuf {
    common::scratch("lab_cli", name)
}

/// A file of a sensor that stands still at 40°, pointing east, 50 Hz.
fn standing(name: &str, seconds: u32) -> String {
    let (omega, g) = (7.292_115e-5, 9.801_7);
    let lat = 40f64.to_radians();
    let mut text = String::from("# made up\nt_s,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z\n");
    for k in 1..=seconds * 50 {
        // right is south, forward east: the north part of the earth rate is on −right
        let (t, x, z) = (f64::from(k) / 50.0, -omega * lat.cos(), omega * lat.sin());
        text += &format!("{t},{x},0,{z},0,0,{g}\n");
    }
    let path = scratch(name);
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn bad_command_lines_are_one_line() {
    for args in [
        &["dance"][..],
        &[],
        &["replay"],
        &["replay", "--imu"],
        &["replay", "--imu", "x.csv", "--axes", "x,y,-z"],
        &["replay", "--imu", "x.csv", "--lat", "north"],
        &["align", "--grade", "toy"],
        &["align", "--seed", "-1"],
        &["align", "extra"],
    ] {
        refused(args);
    }
    assert_eq!(lab(["--help"]).status.code(), Some(0));
    assert_eq!(lab(["align", "--help"]).status.code(), Some(0));
}

#[test]
fn impossible_scenarios_name_their_field() {
    for (flag, value, field) in [
        ("--lat", "91", "lat_deg"),
        ("--lat", "nan", "lat_deg"),
        ("--duration", "5", "duration_s"),
        ("--turn-at", "700", "turn_at_s"),
        ("--turn-time", "1e9", "turn_time_s"),
        ("--rate", "0", "rate_hz"),
        ("--interval", "0", "interval_s"),
    ] {
        let message = refused(&["align", flag, value]);
        assert!(message.contains(field), "{message}");
    }
    // The filter's own checks: a measurement without noise.
    assert!(refused(&["align", "--sigma", "0"]).contains("refused"));
}

#[test]
fn a_wrong_configuration_names_file_line_and_key() {
    let path = scratch("wrong.toml");
    let name = path.to_str().unwrap();
    let imu = standing("few.csv", 1);
    for (text, place) in [
        ("lat_deg = 40\n\nlatitude = 3\n", ":3: latitude: "),
        ("lat_deg = \"forty\"\n", ":1: lat_deg: "),
        (
            "[alignment.sensor]\ngyro_bias_deg_h = true\n",
            ":2: alignment.sensor.gyro_bias_deg_h: ",
        ),
        ("lat_deg = \n", ":1: "),
    ] {
        fs::write(&path, text).unwrap();
        let message = refused(&["align", "--config", name]);
        assert!(message.contains(&format!("{name}{place}")), "{message}");
    }
    fs::write(&path, "[prior]\nheading = 3\n").unwrap();
    let message = refused(&["replay", "--imu", &imu, "--lat", "40", "--config", name]);
    assert!(
        message.contains(&format!("{name}:2: prior.heading: ")),
        "{message}"
    );
    assert!(refused(&["align", "--config", "absent.toml"]).contains("absent.toml"));
}

#[test]
fn replay_says_what_a_recording_lacks() {
    let imu = standing("standing.csv", 20);
    let with = |args: &[&str]| refused(&[&["replay", "--imu", &imu][..], args].concat());
    assert!(with(&[]).contains("--lat"));
    assert!(with(&["--lat", "85"]).contains("pole"));
    assert!(with(&["--lat", "40", "--height", "1e9"]).contains("--height"));
    assert!(with(&["--lat", "40"]).contains("coarse window of 60 s"));
    assert!(with(&["--lat", "40", "--from", "100"]).contains("no sample"));
    // A gap in the middle: named with its line (two lines of heading, 50 samples a second).
    let text = fs::read_to_string(&imu).unwrap();
    let kept: Vec<&str> = text
        .lines()
        .enumerate()
        .filter(|(i, _)| !(302..352).contains(i))
        .map(|(_, line)| line)
        .collect();
    let gap = scratch("gap.csv");
    fs::write(&gap, kept.join("\n") + "\n").unwrap();
    let message = refused(&["replay", "--imu", gap.to_str().unwrap(), "--lat", "40"]);
    assert!(
        message.contains("gap.csv:303: t_s: ") && message.contains("1.020 s"),
        "{message}"
    );
}

#[test]
fn replay_of_rates_in_other_axes_finds_the_heading() {
    let imu = standing("rates.csv", 90);
    let o = lab_json(["replay", "--imu", &imu, "--lat", "40", "--json"]);
    // No noise in the file: what is left is f32 and the prior, far below the 0.1° of σ.
    let heading = o["final"]["heading_deg"].as_f64().unwrap();
    assert!((heading - 90.0).abs() < 0.01, "{heading}");
    // The same sensor turned on its mount: what it calls y is right, what it calls −x is forward.
    let o = lab_json([
        "replay", "--imu", &imu, "--lat", "40", "--json", "--axes", "y,-x,z",
    ]);
    let heading = o["final"]["heading_deg"].as_f64().unwrap();
    assert!(
        (heading - 0.0).abs() < 0.01 || (heading - 360.0).abs() < 0.01,
        "{heading}"
    );
    for key in [
        "coarse",
        "final",
        "xi1",
        "xi2",
        "nis",
        "rejected",
        "rms_vs_ref",
        "events",
    ] {
        assert!(o.get(key).is_some(), "{key}");
    }
    for name in [
        "heading_deg",
        "v_n_m_s",
        "lat_deg",
        "height_m",
        "gyro_bias_deg_h",
        "accel_bias_ug",
    ] {
        for object in ["coarse", "final"] {
            assert!(!o[object][name].is_null() && !o[object][format!("{name}_sigma")].is_null());
        }
    }
}

/// Everything that a browser would fetch or run.
fn assert_self_contained(html: &str) {
    let alone = html.replace("http://www.w3.org/2000/svg", "");
    for outside in [
        "http:", "https:", "//cdn", "<script", "<link", "<img", "@import", "url(", "src=",
    ] {
        assert!(!alone.contains(outside), "{outside}");
    }
    assert!(
        !html.contains("NaN") && !html.contains("inf</"),
        "a number that is none"
    );
}

#[test]
fn align_writes_one_file_that_needs_nothing() {
    let folder = scratch("report");
    let name = folder.to_str().unwrap();
    let output = lab(["align", "--report", name]);
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    let last = text.lines().last().unwrap();
    assert_eq!(last, format!("Report: {name}/report.html"));
    assert!(text.contains("Table 5") && text.contains("Is alignment finished?"));
    let files: Vec<_> = fs::read_dir(&folder).unwrap().collect();
    assert_eq!(files.len(), 1);
    let html = fs::read_to_string(folder.join("report.html")).unwrap();
    assert_self_contained(&html);
    // Two of the heading, 15 states three times, four spectra, two figures.
    assert_eq!(html.matches("<svg").count(), 2 + 45 + 4 + 2);
    for word in [
        "Table 3", "Table 4", "Table 5", "Fig. 1", "Fig. 2", "ξ1", "ξ2", "η", "σ",
    ] {
        assert!(html.contains(word), "{word}");
    }
}

#[test]
fn replay_writes_a_report_too() {
    let imu = standing("for_report.csv", 90);
    let folder = scratch("replay_report");
    let name = folder.to_str().unwrap();
    let output = lab(["replay", "--imu", &imu, "--lat", "40", "--report", name]);
    assert!(output.status.success(), "{output:?}");
    assert_self_contained(&fs::read_to_string(folder.join("report.html")).unwrap());
}

#[test]
fn a_report_that_cannot_be_written_is_bad_input() {
    let file = scratch("a_file");
    fs::write(&file, "").unwrap();
    let inside = file.join("report");
    let message = refused(&[
        "align",
        "--duration",
        "30",
        "--turn-at",
        "15",
        "--turn-time",
        "2",
        "--config",
        short_window(),
        "--report",
        inside.to_str().unwrap(),
    ]);
    assert!(message.contains("cannot be written"), "{message}");
}

/// A scenario whose coarse window is short.
fn short_window() -> &'static str {
    let path = scratch("short.toml");
    fs::write(&path, "[alignment.coarse]\nseconds = 10\n").unwrap();
    Box::leak(path.to_str().unwrap().to_owned().into_boxed_str())
}
