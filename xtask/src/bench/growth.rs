//! `cargo xtask bench --all`: how the counts grow, as a table in docs/performance.md and as docs/growth.svg.

use std::fmt::Write as _;
use std::fs;

use anyhow::{Context, Result};

use super::measure;
use super::measure::{Firmware, Row, PLAIN, SMALL, SMALLEST};
use super::table::{grouped, record_in};
use crate::toolchain::Toolchain;
use crate::{qemu, shell};

const GROWTH: &str = "growth";

/// Opt-levels that the growth is shown for, and the same bytes on a core with another pipeline.
const BUILDS: [Firmware; 4] = [
    Firmware {
        example: GROWTH,
        ..PLAIN
    },
    Firmware {
        example: GROWTH,
        ..SMALL
    },
    Firmware {
        example: GROWTH,
        ..SMALLEST
    },
    Firmware {
        machine: qemu::M7,
        example: GROWTH,
        ..PLAIN
    },
];

/// Counts, records, and prints unless the counts are wanted in another form.
pub fn run(toolchain: &Toolchain, quiet: bool) -> Result<()> {
    let plugin = measure::plugin()?;
    let mut columns = Vec::new();
    for build in &BUILDS {
        columns.push(build.count(toolchain, &plugin)?.rows);
    }

    let mut text = format!(
        "rustc {}; instructions on the Cortex-M4F by opt-level, and of the first build on a Cortex-M7.\n\n\
         | work | 3 | s | z | 3, M7 |\n|---|---|---|---|---|\n",
        toolchain.release
    );
    let first = columns.first().context("a build")?;
    for (i, row) in first.iter().enumerate() {
        write!(text, "| {} |", named(&row.work))?;
        for column in &columns {
            let cell = column.get(i).map_or(0, |row| row.instructions);
            write!(text, " {} |", grouped(cell))?;
        }
        text.push('\n');
    }
    if !quiet {
        println!("{text}");
    }
    let points = |prefix: &str| -> Vec<(f64, f64)> {
        first.iter().filter_map(|row| point(row, prefix)).collect()
    };
    let plot = svg(&points("rows "), &points("rate "))?;
    fs::write(shell::root().join("docs/growth.svg"), plot)?;
    record_in("docs/performance.md", "bench --all", text.trim_end())
}

fn named(work: &str) -> String {
    match (work.strip_prefix("rows "), work.strip_prefix("rate ")) {
        (Some(n), _) => format!("update of {n} rows with ξ1 and ξ2"),
        (_, Some(rate)) => format!("a second of 100 Hz samples, covariance at {rate} Hz"),
        _ => work.to_owned(),
    }
}

fn point(row: &Row, prefix: &str) -> Option<(f64, f64)> {
    let x = row.work.strip_prefix(prefix)?.parse().ok()?;
    Some((x, row.instructions as f64))
}

/// Two panels side by side, both axes from zero.
fn svg(rows: &[(f64, f64)], rates: &[(f64, f64)]) -> Result<String> {
    let mut text = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 760 300\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"760\" height=\"300\" fill=\"white\"/>\n",
    );
    panel(
        &mut text,
        70.0,
        "rows of an update",
        "instructions",
        1.0,
        rows,
    )?;
    panel(
        &mut text,
        450.0,
        "covariance rate [Hz]",
        "1000 instructions a second",
        1e3,
        rates,
    )?;
    text += "</svg>\n";
    Ok(text)
}

fn panel(
    text: &mut String,
    left: f64,
    x: &str,
    y: &str,
    unit: f64,
    points: &[(f64, f64)],
) -> Result<()> {
    let (width, top, bottom) = (280.0, 30.0, 250.0);
    let max = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).fold(1.0, f64::max);
    let (x_max, y_max) = (max(|p| p.0), max(|p| p.1));
    let place = |(x, y): (f64, f64)| {
        (
            left + width * x / x_max,
            bottom - (bottom - top) * y / (1.05 * y_max),
        )
    };
    writeln!(
        text,
        "<path d=\"M{left} {top}V{bottom}H{}\" fill=\"none\" stroke=\"black\"/>",
        left + width
    )?;
    writeln!(
        text,
        "<text x=\"{}\" y=\"285\" text-anchor=\"middle\">{x}</text>",
        left + width / 2.0
    )?;
    writeln!(text, "<text x=\"{left}\" y=\"18\">{y}</text>")?;
    let mut path = String::new();
    for (i, &point) in points.iter().enumerate() {
        let (px, py) = place(point);
        write!(path, "{}{px:.1} {py:.1}", if i == 0 { "M" } else { "L" })?;
        writeln!(
            text,
            "<circle cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"3\" fill=\"#1f77b4\"/>"
        )?;
        writeln!(
            text,
            "<text x=\"{px:.1}\" y=\"265\" text-anchor=\"middle\" font-size=\"9\">{}</text>",
            point.0
        )?;
        writeln!(
            text,
            "<text x=\"{px:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-size=\"9\">{}</text>",
            py - 7.0,
            grouped((point.1 / unit).round() as u64)
        )?;
    }
    writeln!(
        text,
        "<path d=\"{path}\" fill=\"none\" stroke=\"#1f77b4\"/>"
    )?;
    Ok(())
}
