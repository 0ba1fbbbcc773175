//! `lab align --sweep`: by what angle to turn between two positions.

use std::path::Path;

use navsight::alignment::angle::{condition, heading_degree};
use navsight::earth::Local;
use rayon::prelude::*;
use serde_json::json;

use super::compare::COLORS;
use crate::alignment::{variant, Scenario, Tally, Variant};
use crate::lab::scenario::File;
use crate::lab::{self, LabError};
use crate::report::{digits, Chart, Page, Scale, Series, Table};

/// Angles from −180° to 180° in this step.
const STEP_DEG: f64 = 15.0;

/// The closed forms in this one, for a smooth line.
const FINE_DEG: f64 = 2.0;

/// What is carried over the turn.
const WAYS: [Variant; 2] = [Variant::Full, Variant::Carry];

/// One angle.
struct Point {
    alpha_deg: f64,
    /// Closed form, Fig. 4.
    degree: f64,
    /// Closed form, Fig. 5.
    condition: f64,
    /// The filter's own heading σ for each of [`WAYS`] [°].
    sigma_deg: [f64; 2],
    /// Its σ of the level accelerometers [µg].
    accel_ug: [f64; 2],
}

/// Runs, prints, writes.
pub fn run(file: &File, json: bool, report: &Path) -> Result<(), LabError> {
    let base = file.scenario();
    if base.schedule.positions.len() != 2 {
        return Err(LabError::plain("a sweep needs a scenario of two positions").field("position"));
    }
    let steps = (360.0 / STEP_DEG) as i32;
    let bar = lab::progress(steps as u64 + 1, "sweep");
    let points: Vec<Point> = (0..=steps)
        .into_par_iter()
        .map(|k| {
            let point = point(&base, f64::from(k) * STEP_DEG - 180.0, file.first_seed);
            bar.inc(1);
            point
        })
        .collect::<Result<_, _>>()
        .map_err(|e| LabError::plain(format!("the filter refused this scenario: {e:?}")))?;
    bar.finish_and_clear();
    let table = table(&points);
    let path = page(&base, &points, &table).write(report)?;
    if json {
        let list: Vec<_> = points
            .iter()
            .map(|p| {
                json!({
                    "alpha_deg": p.alpha_deg,
                    "heading_degree": p.degree,
                    "condition": p.condition,
                    "sigma_heading_deg": { "full": p.sigma_deg[0], "carry": p.sigma_deg[1] },
                    "sigma_level_accel_ug": { "full": p.accel_ug[0], "carry": p.accel_ug[1] },
                })
            })
            .collect();
        return lab::print_json(&json!({ "angles": list, "report": path.display().to_string() }));
    }
    lab::print_text(&format!(
        "{}\nReport: {}\n",
        table.to_text(),
        path.display()
    ))
}

/// One angle, one seed: σ hangs on the attitude, not on the noise.
fn point(base: &Scenario, alpha_deg: f64, seed: u64) -> Result<Point, navsight::error::Error> {
    let mut scenario = base.clone();
    scenario.marks.clear();
    // The second position stays; the first is where the turn by α, clockwise, ends there.
    let second = scenario.schedule.positions[1].euler.x;
    scenario.schedule.positions[0].euler.x = second - alpha_deg.to_radians();
    let mut tally = Tally::default();
    variant::run(&scenario, &scenario.track(), &WAYS, seed, &mut tally)?;
    let end = |v| tally.end(v);
    let (degree, condition) = closed_forms(base, alpha_deg);
    Ok(Point {
        alpha_deg,
        degree,
        condition,
        sigma_deg: WAYS.map(|v| end(v).map_or(f64::NAN, |c| c.heading_sigma_deg())),
        accel_ug: WAYS.map(|v| end(v).map_or(f64::NAN, |c| c.level_accel_sigma_ug())),
    })
}

/// Degree of the heading and condition of the two north gyros.
fn closed_forms(base: &Scenario, alpha_deg: f64) -> (f64, f64) {
    let at = base.schedule.at;
    let (lat, alpha) = (at.lat as f32, alpha_deg.to_radians() as f32);
    let gravity = Local::at(lat, at.height as f32).gravity;
    let degree = heading_degree(gravity, lat, alpha);
    (f64::from(degree), f64::from(condition(alpha)))
}

fn table(points: &[Point]) -> Table {
    let mut table = Table::new(
        "Angle of the turn: closed forms of Peng 2016, and the filter's own heading σ at the end",
        [
            "α [°]",
            "degree [m/s³]",
            "cond A",
            "σ full [°]",
            "σ carry [°]",
            "acc full [µg]",
            "acc carry [µg]",
        ],
    );
    for p in points {
        table.row([
            format!("{:+.0}", p.alpha_deg),
            digits(p.degree, 3),
            if p.condition < 1e4 {
                digits(p.condition, 3)
            } else {
                "∞".into()
            },
            digits(p.sigma_deg[0], 3),
            digits(p.sigma_deg[1], 3),
            digits(p.accel_ug[0], 3),
            digits(p.accel_ug[1], 3),
        ]);
    }
    table
}

fn page(base: &Scenario, points: &[Point], table: &Table) -> Page {
    let mut page = Page::new(
        "By what angle to turn",
        "Two positions, the second one fixed: what the angle between them is worth, by the closed forms and by the filter.",
    );
    page.text(
        "Carrying the biases only, each position adds the gyro that points north there: two different gyros at ±90°, the same one \
         at 180°, where nothing is gained. A filter that keeps its attitude through the turn sees the bias of the east gyro change \
         sign against a heading error that stays, in proportion to 1 − cos α, and the level accelerometers against the tilt \
         likewise: it is best at 180°.",
    );
    let line = |color, pick: &dyn Fn(&Point) -> f64| Series {
        label: String::new(),
        color,
        width: 2,
        points: points.iter().map(|p| (p.alpha_deg, pick(p))).collect(),
    };
    let chart = |title: &str, scale, series| {
        Chart {
            x_label: "angle of the turn [°]".into(),
            x_step: Some(45.0),
            size: (520, 260),
            ..Chart::new(title, scale, series)
        }
        .svg()
    };
    let steps = (360.0 / FINE_DEG) as i32;
    let fine: Vec<_> = (0..=steps)
        .map(|k| f64::from(k) * FINE_DEG - 180.0)
        .map(|alpha| (alpha, closed_forms(base, alpha)))
        .collect();
    let form = |pick: &dyn Fn((f64, f64)) -> f64| Series {
        label: String::new(),
        color: COLORS[5],
        width: 2,
        points: fine.iter().map(|(a, forms)| (*a, pick(*forms))).collect(),
    };
    let colors = WAYS.map(|v| COLORS[v as usize % COLORS.len()]);
    let ways = |pick: &dyn Fn(&Point, usize) -> f64| {
        vec![
            line(colors[0], &|p| pick(p, 0)),
            line(colors[1], &|p| pick(p, 1)),
        ]
    };
    page.section("Closed forms");
    page.figures(
        2,
        &[
            chart(
                "degree of the heading [m/s³], Fig. 4",
                Scale::Linear,
                vec![form(&|(degree, _)| degree)],
            ),
            chart(
                "cond A, Fig. 5",
                Scale::Logarithmic,
                vec![form(&|(_, condition)| condition.min(1e3))],
            ),
        ],
        "Both speak of biases carried alone: best at ±90°.",
    );
    page.section("Filter");
    page.key(&[(colors[0], WAYS[0].name()), (colors[1], WAYS[1].name())]);
    page.figures(
        2,
        &[
            chart("σ of the heading [°], Fig. 6", Scale::Logarithmic, ways(&|p, k| p.sigma_deg[k])),
            chart("σ of the level accelerometers [µg]", Scale::Logarithmic, ways(&|p, k| p.accel_ug[k])),
        ],
        "The filter's own σ at the end of the second position. The paper's Fig. 6 is the curve of the biases carried alone.",
    );
    page.table(table);
    page
}
