//! `lab covariance` from outside: what a bad configuration is answered with, and what JSON holds.

use std::path::{Path, PathBuf};
use std::process::Output;

use serde_json::{json, Value};

mod common;

fn config() -> Value {
    let file: Value = serde_json::from_str(include_str!("../golden/lu2009.json")).unwrap();
    let mut config = file["configs"]["best_open"]["cfg"].clone();
    for key in ["sigma0", "constants", "nondiag_P0_corr_pairs"] {
        config[key] = file[key].clone();
    }
    config
}

fn write(name: &str, text: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("covariance_{name}.json"));
    std::fs::write(&path, text).unwrap();
    path
}

/// The command line of one analysis.
fn line<'a>(config: &'a Path, arguments: &[&'a str]) -> Vec<&'a str> {
    let config = config.to_str().unwrap();
    [&["covariance", "--config", config], arguments].concat()
}

fn lab(config: &Path, arguments: &[&str]) -> Output {
    common::lab(line(config, arguments))
}

/// Exit 2, nothing on standard output, and one line that names the file (where one is at fault) and these words.
fn refused(name: &str, output: &Output, words: &[&str]) {
    let error = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(output.status.code(), Some(2), "{name}: {error}");
    assert!(output.stdout.is_empty(), "{name}");
    assert_eq!(error.trim_end().lines().count(), 1, "{name}: {error}");
    for word in words {
        assert!(error.contains(word), "{name}: {error} lacks {word}");
    }
}

#[test]
fn a_bad_configuration_is_refused_in_one_line_with_file_line_and_field() {
    let with = |key: &str, value: Value| {
        let mut config = config();
        config[key] = value;
        serde_json::to_string_pretty(&config).unwrap()
    };
    let pretty = serde_json::to_string_pretty(&config()).unwrap();
    let line_of = |text: &str, key: &str| {
        let at = text
            .lines()
            .position(|line| line.contains(&format!("\"{key}\"")))
            .unwrap();
        format!(":{}:", at + 1)
    };
    for (name, key, value) in [
        ("type", "tau_g", json!("long")),
        ("range", "R", json!(-1.0)),
        ("latitude", "lat_deg", json!(89.0)),
        ("order", "phi_order", json!(0)),
        ("steps", "T", json!(0.0)),
        ("gap", "gap", json!([2.0, 1.0])),
        ("model", "model", json!("chi")),
        ("unknown", "foo", json!(1)),
        ("sigma0", "sigma0", json!(vec![-1.0; 15])),
    ] {
        let text = with(key, value);
        let path = write(name, &text);
        let line = line_of(&text, key);
        let file = path.display().to_string();
        let output = lab(&path, &["--times", "1", "--json"]);
        // a list that spans lines is reported at its first or its last one
        let near: &str = if matches!(name, "gap") { ":" } else { &line };
        refused(name, &output, &[&file, near, key]);
    }
    let mut less = config();
    less.as_object_mut().unwrap().remove("T");
    let path = write("missing", &less.to_string());
    refused(
        "missing",
        &lab(&path, &["--times", "1"]),
        &["missing", "`T`", ":1:"],
    );
    let path = write("truncated", &pretty[..200]);
    refused(
        "truncated",
        &lab(&path, &["--times", "1"]),
        &["EOF", "line"],
    );
    let path = write("empty", "");
    refused("empty", &lab(&path, &["--times", "1"]), &[":1:"]);
    let mut odd = config();
    odd["P0"] = json!("correlated");
    odd["nondiag_P0_corr_pairs"] = json!([[0, 1, 0.9], [1, 2, 0.9], [0, 2, -0.9]]);
    let path = write("indefinite", &odd.to_string());
    refused(
        "indefinite",
        &lab(&path, &["--times", "1"]),
        &["nondiag_P0_corr_pairs", "positive"],
    );
    refused(
        "nofile",
        &lab(&path.with_file_name("nofile.json"), &["--times", "1"]),
        &["nofile.json"],
    );
}

#[test]
fn a_bad_time_is_refused() {
    let path = write("times", &config().to_string());
    for times in ["0", "0.5", "x", "601", "1,,2", "-1", "NaN", "inf"] {
        let output = lab(&path, &[&format!("--times={times}"), "--json"]);
        refused(times, &output, &["--times"]);
    }
    refused(
        "case",
        &lab(&path, &["--times", "1", "--case", "3"]),
        &["--case"],
    );
    refused(
        "scalar",
        &lab(&path, &["--times", "1", "--scalar", "f16"]),
        &["--scalar"],
    );
}

#[test]
fn json_is_one_object_with_the_times_as_they_were_written() {
    let path = write("json", &config().to_string());
    let object = common::lab_json(line(
        &path,
        &[
            "--times", "300,1", "--case", "2", "--scalar", "f32", "--json",
        ],
    ));
    let keys: Vec<&String> = object.as_object().unwrap().keys().collect();
    assert_eq!(keys, ["1", "300"]);
    for key in ["P", "xi2", "xi1", "xi1_meas", "eigT", "eigM"] {
        assert_eq!(object["1"][key].as_array().unwrap().len(), 15, "{key}");
    }
    // the table for people
    let output = lab(&path, &["--times", "1"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success() && text.contains("t = 1 s") && text.contains("eigenvalues of T")
    );
}
