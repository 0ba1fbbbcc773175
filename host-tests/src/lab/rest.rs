//! `lab rest`: when did the sensor stand still? The detector on a recording, both of its errors where there are flags to
//! compare with, and how they trade.

use std::path::PathBuf;

use navsight::alignment::stationary::{StationarySettings, OFFSET_LIMIT, SCATTER_LIMIT};
use serde_json::json;

use super::LabError;
use crate::input::rest;
use crate::report::{digits, Band, Chart, Page, Scale, Series, Table};
use crate::stationary::{each, mems};

/// Flags of the command.
#[derive(clap::Args)]
pub struct Args {
    /// Inertial samples, as for `replay`
    #[arg(long, value_name = "FILE")]
    imu: PathBuf,
    /// Flags to compare with: t_s, at_rest (0 or 1)
    #[arg(long, value_name = "FILE")]
    rest: Option<PathBuf>,
    /// Noise density of the gyros [°/s/√Hz]
    #[arg(long, value_name = "DEG/S/SQRT(HZ)", default_value_t = 0.006)]
    gyro_noise: f32,
    /// Noise density of the accelerometers [µg/√Hz]
    #[arg(long, value_name = "UG/SQRT(HZ)", default_value_t = 300.0)]
    accel_noise: f32,
    /// What the carrier still turns by at rest, 1σ [°/s]
    #[arg(long, value_name = "DEG/S", default_value_t = 0.0)]
    sway_rate: f32,
    /// What it still accelerates by, 1σ [m/s²]
    #[arg(long, value_name = "M/S2", default_value_t = 0.0)]
    sway_accel: f32,
    /// One JSON object on standard output instead of tables
    #[arg(long)]
    json: bool,
    /// Write report.html with pictures into this folder
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
}

/// One sample: its length, the scatter if a window was full and its means were possible, and the flag.
struct Sample {
    dt: f64,
    scatter: f32,
    at_rest: bool,
}

/// One limit.
struct Point {
    limit: f64,
    found: f64,
    wrong: f64,
}

/// Reads, runs, prints, writes.
pub fn run(args: &Args) -> Result<(), LabError> {
    let settings = StationarySettings {
        residual_rate: args.sway_rate.to_radians(),
        residual_accel: args.sway_accel,
        ..mems(args.gyro_noise, args.accel_noise)
    };
    settings.check().map_err(|_| {
        let what = "noise must be above zero and sway not below it";
        LabError::plain(what).field("--gyro-noise, --accel-noise, --sway-rate, --sway-accel")
    })?;
    let flags = args.rest.as_deref().map(rest::read).transpose()?;
    let (mut samples, mut course, mut spans) = (Vec::new(), Vec::new(), Vec::<(f64, f64)>::new());
    let (mut still, mut all) = (0.0, 0.0);
    each(&args.imu, settings, |t, dt, look, new| {
        let possible = look.filter(|l| l.offset <= OFFSET_LIMIT);
        samples.push(Sample {
            dt,
            scatter: possible.map_or(f32::INFINITY, |l| l.scatter),
            at_rest: flags.as_ref().is_some_and(|f| rest::at(f, t)),
        });
        all += dt;
        let now = look.is_some_and(|l| l.still);
        still += if now { dt } else { 0.0 };
        match spans.last_mut() {
            Some(span) if now && t - span.1 < 1.5 * dt => span.1 = t,
            _ if now => spans.push((t, t)),
            _ => {}
        }
        if let Some(look) = look.filter(|_| new) {
            course.push((t, f64::from(look.scatter)));
        }
    })?;
    let limit = f64::from(SCATTER_LIMIT * settings.allowance);
    let at = |limit: f64| {
        let mut sums = [0.0f64; 4];
        for s in &samples {
            let kind = if s.at_rest { 0 } else { 2 };
            sums[kind] += s.dt;
            sums[kind + 1] += if f64::from(s.scatter) <= limit {
                s.dt
            } else {
                0.0
            };
        }
        Point {
            limit,
            found: sums[1] / sums[0],
            wrong: sums[3] / sums[2],
        }
    };
    let here = at(limit);
    let curve: Vec<Point> = (0..=40)
        .map(|k| at(0.5 * 10f64.powf(f64::from(k) / 8.0)))
        .collect();
    let mut table = Table::new(
        format!(
            "{:.1} s of {all:.1} s at rest, in {} stretches",
            still,
            spans.len()
        ),
        [
            "limit of the scatter",
            "rest found [%]",
            "moving called rest [%]",
        ],
    );
    if flags.is_some() {
        let named = std::iter::once((&here, " (used)"));
        for (p, name) in named.chain(curve.iter().step_by(4).map(|p| (p, ""))) {
            table.row([
                format!("{}{name}", digits(p.limit, 3)),
                format!("{:.2}", 100.0 * p.found),
                format!("{:.3}", 100.0 * p.wrong),
            ]);
        }
    }
    let written = match &args.report {
        Some(folder) => Some(page(&table, &course, &curve, limit, flags.is_some()).write(folder)?),
        None => None,
    };
    if args.json {
        let points = |p: &Point| json!({ "limit": p.limit, "rest_found": p.found, "moving_called_rest": p.wrong });
        let mut value = json!({
            "still_s": still,
            "all_s": all,
            "stretches": spans.iter().map(|s| [s.0, s.1]).collect::<Vec<_>>(),
            "limit": limit,
        });
        if flags.is_some() {
            value["counts"] = points(&here);
            value["curve"] = curve.iter().map(points).collect();
        }
        return super::print_json(&value);
    }
    let mut text = table.to_text();
    for (begin, end) in &spans {
        text += &format!("{begin:9.2} … {end:.2} s\n");
    }
    if let Some(path) = written {
        text += &format!("\nReport: {}\n", path.display());
    }
    super::print_text(&text)
}

fn page(table: &Table, course: &[(f64, f64)], curve: &[Point], limit: f64, compared: bool) -> Page {
    let mut page = Page::new(
        "At rest or not",
        "Likelihood ratio of a constant rate and force over the window; both constants unknown.",
    );
    page.table(table);
    let line = |color, points: Vec<(f64, f64)>| Series {
        label: String::new(),
        color,
        width: 1,
        points,
    };
    let chart = Chart {
        level: Some(limit),
        x_label: "time [s]".into(),
        size: (1060, 260),
        ..Chart::new(
            "scatter over its expectation at rest",
            Scale::Logarithmic,
            vec![line("#2563eb", course.to_vec())],
        )
    };
    page.figures(
        1,
        &[chart.svg()],
        "The dashed level is the limit that follows from the noise of the sensor.",
    );
    if compared {
        let pick = |f: &dyn Fn(&Point) -> f64| {
            let points = curve.iter().map(|p| (p.limit.log10(), 100.0 * f(p)));
            points.collect::<Vec<_>>()
        };
        let charts = [
            (
                "annotated rest that was found [%]",
                "#16a34a",
                pick(&|p| p.found),
            ),
            (
                "moving time that was called rest [%]",
                "#dc2626",
                pick(&|p| p.wrong),
            ),
        ]
        .map(|(title, color, points)| {
            Chart {
                x_label: "limit of the scatter, power of ten".into(),
                bands: vec![Band::plain(limit.log10() - 0.02..limit.log10() + 0.02)],
                size: (520, 260),
                ..Chart::new(title, Scale::Linear, vec![line(color, points)])
            }
            .svg()
        });
        page.section("Trade-off");
        page.figures(
            2,
            &charts,
            "Both errors over the limit, the bias limit unchanged. What is said at the time of a sample, without looking ahead, \
             is held against its annotation. The tinted stripe is the limit in use.",
        );
    }
    page
}
