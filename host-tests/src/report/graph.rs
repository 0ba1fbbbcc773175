//! Pictures of graphs and tables as SVG text: bipartite graph, linking, heat map, bars.

use std::fmt::Write;

use super::page::escape;

const INK: &str = "#1e293b";
const SOFT: &str = "#cbd5e1";
const CHOSEN: &str = "#0369a1";
const FONT: &str = "font-family=\"system-ui, sans-serif\" font-size=\"11\"";

fn svg(width: f64, height: f64, body: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" role=\"img\" viewBox=\"0 0 {width} {height}\" {FONT} \
         fill=\"{INK}\" style=\"max-width:{width}px;width:100%\">{body}</svg>"
    )
}

fn line(body: &mut String, a: (f64, f64), b: (f64, f64), color: &str, width: f64) {
    let _ = write!(
        body,
        "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"{color}\" stroke-width=\"{width}\"/>",
        a.0, a.1, b.0, b.1
    );
}

fn dot(body: &mut String, at: (f64, f64), color: &str) {
    let _ = write!(
        body,
        "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3.5\" fill=\"{color}\"/>",
        at.0, at.1
    );
}

fn text(body: &mut String, at: (f64, f64), anchor: &str, words: &str) {
    let _ = write!(
        body,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\">{}</text>",
        at.0,
        at.1 + 4.0,
        escape(words)
    );
}

/// States left, what they act on right; the chosen edges stand out.
pub fn bipartite(
    left: &[String],
    right: &[String],
    edges: &[(usize, usize)],
    chosen: &[(usize, usize)],
) -> String {
    let (step, top) = (20.0, 16.0);
    let height = top * 2.0 + step * (left.len().max(right.len()) as f64 - 1.0).max(0.0);
    let (x_left, x_right) = (90.0, 300.0);
    let at = |x: f64, i: usize| (x, top + step * i as f64);
    let mut body = String::new();
    for edge in edges {
        line(
            &mut body,
            at(x_left, edge.0),
            at(x_right, edge.1),
            SOFT,
            1.0,
        );
    }
    for edge in chosen {
        line(
            &mut body,
            at(x_left, edge.0),
            at(x_right, edge.1),
            CHOSEN,
            2.5,
        );
    }
    for (i, name) in left.iter().enumerate() {
        let matched = chosen.iter().any(|e| e.0 == i);
        dot(&mut body, at(x_left, i), if matched { CHOSEN } else { INK });
        text(&mut body, at(x_left - 10.0, i), "end", name);
    }
    for (i, name) in right.iter().enumerate() {
        dot(&mut body, at(x_right, i), INK);
        text(&mut body, at(x_right + 10.0, i), "start", name);
    }
    svg(390.0, height, &body)
}

/// Layers from left to right, states and outputs as rows; each path is a list of rows, one for each layer.
pub fn linking(
    states: &[String],
    outputs: &[String],
    layers: usize,
    paths: &[Vec<usize>],
) -> String {
    let (step, top, left, wide) = (20.0, 16.0, 90.0, 70.0);
    let rows = states.len() + outputs.len();
    let at = |layer: usize, row: usize| (left + wide * layer as f64, top + step * row as f64);
    let mut body = String::new();
    for layer in 0..=layers {
        for row in 0..rows {
            let is_output = row >= states.len();
            if (layer == layers && !is_output) || (layer == 0 && is_output) {
                continue;
            }
            dot(&mut body, at(layer, row), SOFT);
        }
    }
    for (row, name) in states.iter().chain(outputs).enumerate() {
        text(
            &mut body,
            (left - 10.0, top + step * row as f64),
            "end",
            name,
        );
    }
    for path in paths {
        for (layer, pair) in path.windows(2).enumerate() {
            line(
                &mut body,
                at(layer, pair[0]),
                at(layer + 1, pair[1]),
                CHOSEN,
                2.0,
            );
        }
        for (layer, row) in path.iter().enumerate() {
            dot(&mut body, at(layer, *row), CHOSEN);
        }
    }
    svg(
        left + wide * layers as f64 + 20.0,
        top * 2.0 + step * (rows as f64 - 1.0),
        &body,
    )
}

/// Rows × columns of (0 … 1, words in the cell): pale to full.
pub fn heat_map(rows: &[String], columns: &[&str], cells: &[Vec<(f64, String)>]) -> String {
    let (left, top, wide, high) = (150.0, 24.0, 105.0, 22.0);
    let mut body = String::new();
    for (j, column) in columns.iter().enumerate() {
        text(
            &mut body,
            (left + wide * (j as f64 + 0.5), 10.0),
            "middle",
            column,
        );
    }
    for (i, (row, values)) in rows.iter().zip(cells).enumerate() {
        let y = top + high * i as f64;
        text(&mut body, (left - 8.0, y + high / 2.0), "end", row);
        for (j, (value, words)) in values.iter().enumerate() {
            let x = left + wide * j as f64;
            let share = value.clamp(0.0, 1.0);
            let _ = write!(
                body,
                "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"#0369a1\" \
                 fill-opacity=\"{share:.3}\" stroke=\"#e2e8f0\"/>",
                wide - 2.0,
                high - 2.0
            );
            let ink = if share > 0.55 { "#ffffff" } else { INK };
            let _ = write!(
                body,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"{ink}\">{}</text>",
                x + wide / 2.0 - 1.0,
                y + high / 2.0 + 3.0,
                escape(words)
            );
        }
    }
    svg(
        left + wide * columns.len() as f64,
        top + high * rows.len() as f64,
        &body,
    )
}

/// A direction: one bar for each name, −1 … 1.
pub fn bars(title: &str, names: &[String], values: &[f64]) -> String {
    let (left, top, high, half) = (110.0, 24.0, 14.0, 90.0);
    let mut body = String::new();
    text(&mut body, (left + half, 10.0), "middle", title);
    let axis = left + half;
    let bottom = top + high * names.len() as f64;
    line(&mut body, (axis, top - 4.0), (axis, bottom), SOFT, 1.0);
    for (i, (name, value)) in names.iter().zip(values).enumerate() {
        let y = top + high * i as f64;
        text(&mut body, (left - 6.0, y + high / 2.0), "end", name);
        let length = half * value.abs().min(1.0);
        let x = if *value < 0.0 { axis - length } else { axis };
        let _ = write!(
            body,
            "<rect x=\"{x:.1}\" y=\"{:.1}\" width=\"{length:.1}\" height=\"{:.1}\" fill=\"{CHOSEN}\"/>",
            y + 2.0,
            high - 4.0
        );
    }
    svg(left + 2.0 * half + 10.0, bottom + 6.0, &body)
}
