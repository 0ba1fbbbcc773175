//! Behaviour under version control: the trace of one alignment, state, σ, ξ and η over time.
//!
//! A change of the library that moves these numbers changes the file in the same commit, by
//! `cargo xtask golden --accept`, and CHANGELOG.md says why.

use std::fmt::Write as _;
use std::path::Path;

use host_tests::sim::{navigation_grade, Sensor, SensorErrors, Simulator, Static, Turn, DEG};
use navsight::alignment::standing::{Progress, StandingAlignment};
use navsight::earth::Geodetic;
use navsight::error_model::N;
use navsight::filter::{Filter, UpdateReport};
use navsight::observability::diagonal::Xi;

/// The numbers are f32: a machine whose `sin` or `exp` differs in the last place of the simulator's double moves them by
/// less than this, and anything that a user could see moves them by more.
const RELATIVE: f64 = 1e-5;

fn line(out: &mut String, time: f64, filter: &Filter, report: &UpdateReport<3>) {
    let nav = filter.nav();
    let (heading, pitch, roll) = nav.euler().to_degrees();
    let mut row = vec![time, heading.into(), pitch.into(), roll.into()];
    row.extend(nav.v_n().iter().map(|&v| f64::from(v)));
    row.extend((0..N).map(|i| f64::from(filter.sigma(i).unwrap())));
    let xi = Xi::of(report).unwrap();
    row.extend(
        xi.xi1
            .all()
            .iter()
            .chain(&xi.xi2.all())
            .map(|x| f64::from(x.unwrap())),
    );
    for (k, x) in row.iter().enumerate() {
        write!(out, "{}{x:.7e}", if k == 0 { "" } else { "," }).unwrap();
    }
    out.push('\n');
}

/// Two positions, a navigation-grade sensor, one update a second; a row every ten seconds.
fn trace() -> String {
    let at = Geodetic::from_degrees(40.0, 116.0, 50.0);
    let motion = Turn {
        before: Static::degrees(at, 30.0, 2.0, -1.0),
        begin: 180.0,
        duration: 2.0,
        rate: 90.0 * DEG,
    };
    let errors = SensorErrors::NAVIGATION.with_biases([0.015, -0.02, 0.01], [60.0, -80.0, 100.0]);
    let mut sensor = Sensor::new(errors, 42);
    let (plan, prior, settings) = navigation_grade();
    let mut alignment = StandingAlignment::new(at, plan, prior, settings).unwrap();
    let state = "rE rN rU vE vN vU psiE psiN psiU bgx bgy bgz bax bay baz";
    let mut out = String::from("t,heading_deg,pitch_deg,roll_deg,v_e,v_n,v_u");
    for kind in ["sigma", "xi1", "xi2"] {
        for name in state.split(' ') {
            write!(out, ",{kind}_{name}").unwrap();
        }
    }
    out.push('\n');
    let mut updates = 0;
    for (truth, ideal) in Simulator::new(motion, 0.01).take(36_000) {
        if let Progress::Updated(report) = alignment.take(&sensor.sample(&ideal)).unwrap() {
            updates += 1;
            if updates % 10 == 0 {
                line(&mut out, truth.time, alignment.filter().unwrap(), &report);
            }
        }
    }
    out
}

#[test]
fn two_position_alignment() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/two_position.csv");
    let now = trace();
    if std::env::var("NAVSIGHT_GOLDEN").is_ok_and(|v| v == "accept") {
        std::fs::write(&file, &now).unwrap();
        return;
    }
    let golden =
        std::fs::read_to_string(&file).expect("golden/two_position.csv is part of the repository");
    let (mut a, mut b) = (now.lines(), golden.lines());
    let names: Vec<&str> = a.next().unwrap().split(',').collect();
    assert_eq!(
        Some(names.join(",").as_str()),
        b.next(),
        "the columns have changed"
    );
    assert_eq!(
        now.lines().count(),
        golden.lines().count(),
        "the number of rows has changed"
    );
    for (a, b) in a.zip(b) {
        for ((a, b), name) in a.split(',').zip(b.split(',')).zip(&names) {
            let (x, y): (f64, f64) = (a.parse().unwrap(), b.parse().unwrap());
            // velocities pass through zero: 1e-5 of the millimetres per second that matter there
            let floor = if name.starts_with("v_") { 1e-3 } else { 0.0 };
            assert!(
                (x - y).abs() <= RELATIVE * y.abs().max(floor),
                "{name}: {x}, was {y}"
            );
        }
    }
}
