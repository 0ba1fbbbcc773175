//! `lab track` from outside: its JSON, its outage, and one line for bad input.

use std::process::Output;

mod common;
use common::{assert_refused, json_of, lab_on};

fn lab(arguments: &[&str]) -> Output {
    common::lab(["track"].iter().chain(arguments))
}

fn with_input(name: &str, text: &str, more: &[&str]) -> Output {
    lab_on(&["track", "--input"], name, text, more)
}

const INPUT: &str = r#"{"tau": 100, "a_max": 2, "a_min": -2, "floor_frac": 0.1, "beyond": "abs", "model": "cs",
"P0": [1e4, 100, 1], "R": [1e4, 0.01], "x0": [0, 0, 0], "dt": [0, 1, 0.5],
"z_pos": [0, null, 6], "z_vel": [5, 5, 5],
"has_pos": [1, 0, 1], "has_vel": [true, true, false]}"#;

#[test]
fn json_and_nothing_else() {
    let output = with_input("good", INPUT, &["--json"]);
    let json = json_of(&output);
    assert_eq!(json["x"].as_array().unwrap().len(), 3);
    let detail = json["detail"].as_array().unwrap();
    assert_eq!(detail.len(), 3);
    // a column of K per channel that was used
    let columns = detail.iter().map(|d| d["K"][0].as_array().unwrap().len());
    assert_eq!(columns.collect::<Vec<_>>(), [2, 1, 1]);
    // no interval, no rate
    assert!(detail[0]["xi1_meas"].is_null() && detail[1]["xi1_meas"].is_array());
}

#[test]
fn bad_input_is_one_line_with_file_line_and_field() {
    for (name, from, to, line, field) in [
        ("short", "[5, 5, 5]", "[5, 5]", 3, "z_vel"),
        ("null", "[1, 0, 1]", "[1, 1, 1]", 3, "z_pos"),
        ("back", "[0, 1, 0.5]", "[0, 1, -0.5]", 2, "dt"),
        ("word", "\"abs\"", "\"none\"", 1, "beyond"),
        ("flag", "[1, 0, 1]", "[1, 0, 7]", 4, "has_pos[2]"),
        ("tau", "\"tau\": 100", "\"tau\": -1", 1, "tau"),
        ("unknown", "\"tau\": 100", "\"tow\": 100", 1, "tow"),
        ("variance", "[1e4, 0.01]", "[1e4, 0]", 2, "R"),
    ] {
        let output = with_input(name, &INPUT.replace(from, to), &["--json"]);
        assert_refused(&output, name, line, field);
    }
}

#[test]
fn an_outage_cuts_the_measurements() {
    let json = |more: &[&str]| -> serde_json::Value {
        let mut arguments = vec!["--json"];
        arguments.extend(more);
        serde_json::from_slice(&lab(&arguments).stdout).unwrap()
    };
    let at = |json: &serde_json::Value, k: u64| {
        let detail = json["detail"].as_array().unwrap().clone();
        detail.into_iter().find(|d| d["k"] == k).unwrap()
    };
    let (all, cut) = (json(&[]), json(&["--outage", "101", "131"]));
    assert_eq!(at(&all, 100), at(&cut, 100));
    let sigma2 = |json: &serde_json::Value| at(json, 130)["P_upper"][0].as_f64().unwrap();
    assert!(sigma2(&cut) > 100.0 * sigma2(&all));
    assert_eq!(at(&cut, 130)["K"][0].as_array().unwrap().len(), 0);
}

#[test]
fn the_report_is_one_file_with_its_pictures() {
    let folder = std::env::temp_dir().join(format!("{}-track", std::process::id()));
    let output = lab(&[
        "--report",
        folder.to_str().unwrap(),
        "--outage",
        "300",
        "340",
    ]);
    assert!(output.status.success());
    let html = std::fs::read_to_string(folder.join("report.html")).unwrap();
    std::fs::remove_dir_all(folder).unwrap();
    assert_eq!(html.matches("<svg").count(), 11);
    assert!(
        !html
            .replace("http://www.w3.org/2000/svg", "")
            .contains("http")
            && !html.contains("src=")
    );
}
