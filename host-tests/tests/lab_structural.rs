//! `lab structural` and `lab analyze` from outside: their JSON, their pages, and one line for a bad model.

mod common;
use common::{assert_refused, json_of, lab_on};

/// Two integrators in a row, the second seen; and the same after a turn that changes the first row.
const CASES: &str = r#"{"cases": [
{"name": "chain", "kind": "lti", "n": 2, "m": 1, "adj": [2, 4]},
{"name": "turn", "kind": "pwcs", "n": 2, "m": 1,
 "seg_adj": [[2, 4], [3, 4]],
 "changed_row_masks": [[1, 0]]}]}"#;

const MODEL: &str = r#"{"states": [{"name": "velocity", "kind": "velocity"},
 {"name": "tilt", "kind": "attitude"}, {"name": "accelerometer", "kind": "accel_bias"}],
"segments": [{"duration_s": 60,
 "f": [[0, 9.8, 1], [0, 0, 0], [0, 0, 0]],
 "h": [[1, 0, 0]]}],
"sigma0": [0.1, 0.01, 0.001],
"r_sigma": [0.01],
"t_update_s": 1}"#;

#[test]
fn a_chain_is_seen_and_json_is_all_there_is() {
    let output = lab_on(&["structural", "--cases"], "chain", CASES, &["--json"]);
    let json = json_of(&output);
    assert_eq!(json["cases"][0]["d"], 2);
    assert_eq!(json["cases"][0]["unique"], 3);
    assert_eq!(json["cases"][1]["diff_bound"], 2);
}

#[test]
fn tilt_and_accelerometer_are_told_to_be_tied() {
    let output = lab_on(&["analyze", "--model"], "model", MODEL, &["--json"]);
    let json = json_of(&output);
    assert_eq!(json["rank"], 2);
    assert_eq!(json["agreement"]["velocity"]["flag"], "agree");
    assert_eq!(json["agreement"]["tilt"]["flag"], "prior_only");
    // g σ_tilt against σ_accelerometer: 98 : 1 in prior, so of the sum all is given to the tilt and its ceiling is
    // 1 + (0.098/0.001)², that of the accelerometer 1.0001.
    let ceiling = |state: &str| json["ceilings"][state]["ceiling"].as_f64().unwrap();
    assert!(
        (ceiling("tilt") - 9605.0).abs() < 1.0,
        "{}",
        ceiling("tilt")
    );
    assert!(
        (ceiling("accelerometer") - 1.000_104).abs() < 1e-6,
        "{}",
        ceiling("accelerometer")
    );

    let output = lab_on(&["analyze", "--model"], "words", MODEL, &[]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        text.contains("tilt") && text.contains("tied to accelerometer"),
        "{text}"
    );
}

#[test]
fn a_page_is_one_file_without_the_network() {
    for (command, flag, text) in [
        ("structural", "--cases", CASES),
        ("analyze", "--model", MODEL),
    ] {
        let folder = std::env::temp_dir().join(format!("{}-{command}-page", std::process::id()));
        let output = lab_on(
            &[command, flag],
            command,
            text,
            &["--report", folder.to_str().unwrap()],
        );
        assert!(output.status.success(), "{output:?}");
        let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
        assert!(
            page.contains("<svg") && !page.contains("src=\"http"),
            "{command}"
        );
        std::fs::remove_dir_all(folder).unwrap();
    }
}

#[test]
fn a_bad_pattern_is_one_line_with_file_line_and_field() {
    for (name, from, to, line, field) in [
        ("empty", CASES, "{\"cases\": []}", 1, "cases"),
        (
            "states",
            "\"n\": 2, \"m\": 1, \"adj\"",
            "\"n\": 33, \"m\": 1, \"adj\"",
            2,
            "n",
        ),
        (
            "none",
            "\"n\": 2, \"m\": 1, \"adj\"",
            "\"n\": 0, \"m\": 1, \"adj\"",
            2,
            "n",
        ),
        ("words", "[2, 4]}", "[2]}", 2, "adj"),
        ("edge", "[2, 4]}", "[2, 16]}", 2, "adj"),
        ("kind", "\"lti\"", "\"lti2\"", 2, "kind"),
        ("segments", "[[2, 4], [3, 4]]", "[]", 3, "seg_adj"),
        ("masks", "[[1, 0]]", "[[1, 0, 0]]", 3, "changed_row_masks"),
        ("letter", "[[1, 0]]", "[[x, 0]]", 5, "5"),
    ] {
        let output = lab_on(
            &["structural", "--cases"],
            name,
            &CASES.replace(from, to),
            &["--json"],
        );
        assert_refused(&output, name, line, field);
    }
}

#[test]
fn a_bad_model_is_one_line_with_file_line_and_field() {
    for (name, from, to, line, field) in [
        (
            "not-square",
            "[0, 0, 0], [0, 0, 0]]",
            "[0, 0, 0]]",
            4,
            "segments[0].f",
        ),
        ("row", "[0, 9.8, 1]", "[0, 9.8]", 4, "segments[0].f"),
        ("wide", "[[1, 0, 0]]", "[[1, 0, 0, 0]]", 5, "segments[0].h"),
        (
            "rows",
            "[[1, 0, 0]]",
            "[[1, 0, 0], [0, 1, 0]]",
            5,
            "segments[0].h",
        ),
        ("nan", "[0, 9.8, 1]", "[0, NaN, 1]", 4, ""),
        ("infinite", "[0, 9.8, 1]", "[0, 1e999, 1]", 4, ""),
        ("prior", "0.01, 0.001]", "0.01]", 6, "sigma0"),
        ("negative", "0.01, 0.001]", "0.01, -1]", 6, "sigma0[2]"),
        (
            "noise",
            "\"r_sigma\": [0.01]",
            "\"r_sigma\": []",
            7,
            "r_sigma",
        ),
        (
            "time",
            "\"t_update_s\": 1",
            "\"t_update_s\": 0",
            8,
            "t_update_s",
        ),
        (
            "long",
            "\"duration_s\": 60",
            "\"duration_s\": -1",
            3,
            "duration_s",
        ),
        ("kind", "\"attitude\"", "\"altitude\"", 2, "altitude"),
    ] {
        let output = lab_on(
            &["analyze", "--model"],
            name,
            &MODEL.replace(from, to),
            &["--json"],
        );
        assert_refused(&output, name, line, field);
    }
    let output = lab_on(&["analyze", "--model"], "nothing", "", &[]);
    assert_refused(&output, "nothing", 1, "");
}
