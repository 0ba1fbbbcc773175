//! `lab align --scenario`: the ways of using several positions, side by side over some seeds.

use serde_json::{json, Value};

use crate::alignment::tally::GROUPS;
use crate::alignment::{monte_carlo, Cell, Scenario, Tally, Variant};
use crate::lab::scenario::File;
use crate::lab::{self, LabError};
use crate::report::{digits, Chart, Page, Scale, Series, Table};

/// Colours of the variants in pictures.
pub(super) const COLORS: [&str; 6] = [
    "#64748b", "#2563eb", "#ea580c", "#16a34a", "#dc2626", "#9333ea",
];

/// Runs, prints, writes.
pub fn run(file: &File, json: bool, report: &std::path::Path) -> Result<(), LabError> {
    let mut scenario = file.scenario();
    if scenario.marks.is_empty() {
        // a course to draw: every half minute of the longest position
        let longest = scenario.schedule.positions.iter().map(|p| p.seconds);
        let longest = longest.fold(0.0, f64::max);
        let step = (longest / 60.0).max(30.0);
        scenario.marks = (1..)
            .map(|k| f64::from(k) * step)
            .take_while(|t| *t < longest)
            .collect();
    }
    let bar = lab::progress(file.seeds, "align");
    let seeds = file.first_seed..file.first_seed.saturating_add(file.seeds);
    let tally = monte_carlo(&scenario, &file.variants, seeds, || bar.inc(1))
        .map_err(|e| LabError::plain(format!("the filter refused this scenario: {e:?}")))?;
    bar.finish_and_clear();
    let table = table(&tally, &file.variants);
    let path = page(&scenario, &tally, &file.variants, &table).write(report)?;
    if json {
        return lab::print_json(&json!({
            "seeds": tally.seeds,
            "variants": variants_json(&tally, &file.variants),
            "report": path.display().to_string(),
        }));
    }
    lab::print_text(&format!(
        "{}\nReport: {}\n",
        table.to_text(),
        path.display()
    ))
}

/// The last cell of each variant as JSON.
pub fn variants_json(tally: &Tally, variants: &[Variant]) -> Vec<Value> {
    ends(tally, variants)
        .map(|(variant, cell)| {
            let mut value = cell_json(cell);
            value["variant"] = json!(variant);
            value
        })
        .collect()
}

/// Each variant with the end of its last position. A scenario of one position has only one filter.
fn ends<'a>(
    tally: &'a Tally,
    variants: &'a [Variant],
) -> impl Iterator<Item = (Variant, &'a Cell)> + 'a {
    let last = tally.cells.keys().map(|place| place.1).max().unwrap_or(0);
    let all: Vec<Variant> = match last {
        0 => vec![Variant::Full],
        _ => variants.to_vec(),
    };
    all.into_iter()
        .filter_map(|variant| tally.end(variant).map(|cell| (variant, cell)))
}

/// What a cell says, in words and units of a report.
pub fn cell_json(cell: &Cell) -> Value {
    let groups: serde_json::Map<String, Value> = GROUPS
        .iter()
        .enumerate()
        .map(|(g, (name, _))| {
            let [one, three] = cell.coverage(g);
            let ((l95, h95), (l999, h999)) = (cell.band(g, 1.96), cell.band(g, 3.29));
            let value = json!({
                "anees": cell.anees(g),
                "band_95": [l95, h95],
                "band_99_9": [l999, h999],
                "within_1_sigma": one,
                "within_3_sigma": three,
            });
            ((*name).to_owned(), value)
        })
        .collect();
    json!({
        "runs": cell.runs,
        "heading_mean_deg": cell.heading_mean_deg(),
        "heading_rms_deg": cell.heading_rms_deg(),
        "heading_sigma_deg": cell.heading_sigma_deg(),
        "level_gyro_rms_deg_h": cell.level_gyro_rms_deg_h(),
        "level_accel_rms_ug": cell.level_accel_rms_ug(),
        "nis_per_row": cell.nis_per_row(),
        "groups": groups,
    })
}

/// Where each variant ends.
pub fn table(tally: &Tally, variants: &[Variant]) -> Table {
    let mut table = Table::new(
        format!(
            "At the end of the last position, {} seeds; heading counter-clockwise, estimate minus truth",
            tally.seeds
        ),
        [
            "variant",
            "mean [°]",
            "rms [°]",
            "own σ [°]",
            "gyro x, y [°/h]",
            "acc x, y [µg]",
            "heading",
            "gyros",
            "accel.",
            "NIS/row",
        ],
    )
    .groups([("", 1), ("heading", 3), ("rms error of biases", 2), ("ANEES", 3), ("", 1)]);
    for (variant, c) in ends(tally, variants) {
        table.row([
            variant.name().to_owned(),
            format!("{:+.4}", c.heading_mean_deg()),
            format!("{:.4}", c.heading_rms_deg()),
            format!("{:.4}", c.heading_sigma_deg()),
            format!("{:.4}", c.level_gyro_rms_deg_h()),
            format!("{:.1}", c.level_accel_rms_ug()),
            digits(c.anees(0), 3),
            digits(c.anees(1), 3),
            digits(c.anees(2), 3),
            format!("{:.3}", c.nis_per_row()),
        ]);
    }
    table
}

fn page(scenario: &Scenario, tally: &Tally, variants: &[Variant], table: &Table) -> Page {
    let mut page = Page::new(
        "Alignment in several positions",
        "The ways of carrying what one position has taught into the next, on the same simulated samples.",
    );
    page.table(table);
    page.text(
        "One position: what the last position alone gives. ANEES is the squared error in units of what the filter believes: 1 \
         for a filter that knows its errors, above it for one that boasts.",
    );
    let spans = scenario.schedule.spans();
    let line = |variant: Variant, pick: fn(&Cell) -> f64| Series {
        label: String::new(),
        color: COLORS[variant as usize % COLORS.len()],
        width: 2,
        points: tally
            .cells
            .range((variant, 0, 0)..=(variant, usize::MAX, u32::MAX))
            .filter_map(|((_, position, second), cell)| {
                let begin = spans.get(*position)?.0;
                Some((begin + f64::from(*second), pick(cell)))
            })
            .collect(),
    };
    let all: Vec<Variant> = ends(tally, variants).map(|(v, _)| v).collect();
    let chart = |title: &str, pick: fn(&Cell) -> f64| {
        let series = all.iter().map(|&v| line(v, pick)).collect();
        Chart {
            x_label: "time [s]".into(),
            size: (520, 260),
            ..Chart::new(title, Scale::Logarithmic, series)
        }
        .svg()
    };
    let key: Vec<(&str, &str)> = all
        .iter()
        .map(|&v| (COLORS[v as usize % COLORS.len()], v.name()))
        .collect();
    page.section("Heading over time");
    page.key(&key);
    page.figures(
        2,
        &[
            chart("rms heading error [°]", Cell::heading_rms_deg),
            chart("what the filter believes, 1σ [°]", Cell::heading_sigma_deg),
        ],
        "Left: the real error over all seeds. Right: the filter's own. Where they part, the filter is wrong about itself.",
    );
    page.section("Biases over time");
    page.key(&key);
    page.figures(
        2,
        &[
            chart("rms error of gyro x, y [°/h]", Cell::level_gyro_rms_deg_h),
            chart("rms error of accelerometer x, y [µg]", Cell::level_accel_rms_ug),
        ],
        "The level accelerometers are seen only by a filter that keeps its attitude through the turn.",
    );
    page
}
