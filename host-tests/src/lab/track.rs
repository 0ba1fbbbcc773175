//! `lab track`: the tracker of Fang 1998 on satellite positions and velocities.

use std::fs;
use std::path::{Path, PathBuf};

use navsight::tracking::Outcome;
use serde_json::json;

use super::LabError;
use crate::report::{short, Band, Chart, Page, Scale, Series, Table, Tone};
use crate::tracking::scenario::{Drive, Receiver};
use crate::tracking::{run as track, Config, Flag, Step};

/// Flags of the command.
#[derive(clap::Args)]
pub struct Args {
    /// JSON: tau, a_max, a_min, floor_frac, beyond, P0, R, model, sigma2, x0, dt, z_pos, z_vel, has_pos, has_vel, and
    /// where wanted gate, believe_after, blend. Without it, the paper's vehicle is simulated
    #[arg(long, value_name = "FILE")]
    input: Option<PathBuf>,
    /// Acceleration of the simulated vehicle [m/s²], from 200 s to 220 s
    #[arg(long, default_value_t = 1.0, conflicts_with = "input")]
    acceleration: f64,
    /// Simulate without velocity measurements
    #[arg(long, conflicts_with = "input")]
    position_only: bool,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1, conflicts_with = "input")]
    seed: u64,
    /// No measurements for FROM ≤ t < TO [s]; may be given several times
    #[arg(long, num_args = 2, value_names = ["FROM", "TO"])]
    outage: Vec<f64>,
    /// Number type of the filter
    #[arg(long, value_name = "f32|f64", default_value = "f64")]
    scalar: Scalar,
    /// Folder for report.html
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// One JSON object on standard output instead of a table
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Scalar {
    F32,
    F64,
}

/// Reads or simulates, runs, prints.
pub fn run(args: &Args) -> Result<(), LabError> {
    let drive = Drive {
        from: 200.0,
        ..Drive::paper(args.acceleration)
    };
    let mut config = match &args.input {
        Some(path) => read(path)?,
        None => simulated(args, &drive)?,
    };
    let times = times(&config);
    let outages = super::outages(&args.outage)?;
    for &(from, to) in &outages {
        for (k, t) in times.iter().enumerate() {
            if (from..to).contains(t) {
                (config.has_pos[k], config.has_vel[k]) = (Flag(false), Flag(false));
            }
        }
    }
    let done = match args.scalar {
        Scalar::F32 => track::<f32>(&config),
        Scalar::F64 => track::<f64>(&config),
    };
    let steps = done.map_err(|(k, error)| {
        let what = format!("step {k}: the filter refused it: {error:?}");
        match &args.input {
            Some(path) => LabError::in_file(path, what),
            None => LabError::plain(what),
        }
    })?;
    if args.json {
        super::print_json(&to_json(&steps))?;
    } else {
        print!("{}", summary(&times, &steps).to_text());
        if config.gate.is_some() {
            println!("{}", outliers(&steps));
        }
    }
    if let Some(folder) = &args.report {
        let truth = args.input.is_none().then_some(&drive);
        let path = page(&config, &times, &steps, truth, &outages).write(folder)?;
        eprintln!("written: {}", path.display());
    }
    Ok(())
}

fn count(steps: &[Step], what: Outcome) -> usize {
    let outcomes = steps.iter().flat_map(|s| s.outcome);
    outcomes.filter(|o| *o == what).count()
}

/// A sentence about what the gate did.
fn outliers(steps: &[Step]) -> String {
    let (rejected, believed) = (
        count(steps, Outcome::Rejected),
        count(steps, Outcome::Believed),
    );
    let all = 2 * steps.len() - count(steps, Outcome::Missing);
    format!("Of {all} measurements {rejected} were rejected, and {believed} believed though outside their gate.")
}

/// Time of each step [s].
fn times(config: &Config) -> Vec<f64> {
    let sum = |t: &mut f64, dt: &f64| {
        *t += dt;
        Some(*t)
    };
    config.dt.iter().scan(0.0, sum).collect()
}

fn read(path: &Path) -> Result<Config, LabError> {
    let text =
        fs::read_to_string(path).map_err(|error| LabError::in_file(path, error.to_string()))?;
    let mut json = serde_json::Deserializer::from_str(&text);
    let config: Config = serde_path_to_error::deserialize(&mut json).map_err(|error| {
        let field = error.path().to_string();
        let line = error.inner().line();
        let located = LabError::in_file(path, error.inner().to_string()).line(line.max(1));
        if field == "." {
            located
        } else {
            located.field(field)
        }
    })?;
    json.end()
        .map_err(|error| LabError::in_file(path, error.to_string()).line(error.line()))?;
    config.check().map_err(|(field, what)| {
        let key = format!("\"{field}\"");
        let line = text
            .lines()
            .position(|line| line.contains(&key))
            .map_or(1, |at| at + 1);
        LabError::in_file(path, what).line(line).field(field)
    })?;
    Ok(config)
}

/// The paper's vehicle, with the acceleration early so that it is seen, and the library's own rules.
fn simulated(args: &Args, drive: &Drive) -> Result<Config, LabError> {
    const STEPS: usize = 400;
    if !args.acceleration.is_finite() {
        return Err(LabError::plain("not a finite number").field("--acceleration"));
    }
    let z = Receiver::PAPER.measure(drive, 1.0, STEPS, args.seed);
    let mut dt = vec![1.0; STEPS];
    dt[0] = 0.0;
    let input = json!({
        "tau": 100.0, "a_max": 2.0, "a_min": -2.0, "floor_frac": 0.3, "beyond": "full",
        "P0": [1e4, 100.0, 1.0], "R": [1e4, 0.01], "model": "cs", "x0": [z[0][0], 0.0, 0.0], "dt": dt,
        "z_pos": z.iter().map(|z| z[0]).collect::<Vec<_>>(),
        "z_vel": z.iter().map(|z| z[1]).collect::<Vec<_>>(),
        "has_pos": vec![1; STEPS], "has_vel": vec![u8::from(!args.position_only); STEPS],
        "gate": 15.1,
    });
    serde_json::from_value(input).map_err(|error| LabError::plain(error.to_string()))
}

/// Estimates of every step; the rest of every tenth, the first three and the last.
fn to_json(steps: &[Step]) -> serde_json::Value {
    let last = steps.len() - 1;
    let shown = |k: usize| k.is_multiple_of(10) || k <= 2 || k == last;
    json!({
        "x": steps.iter().map(|s| s.x).collect::<Vec<_>>(),
        "detail": steps.iter().filter(|s| shown(s.k)).collect::<Vec<_>>(),
    })
}

fn sigma(step: &Step) -> [f64; 3] {
    [0, 3, 5].map(|i| step.p_upper[i].sqrt())
}

fn summary(times: &[f64], steps: &[Step]) -> Table {
    let mut table = Table::new(
        "Estimate, what it is known to (1σ), and how much was learnt (ξ2 = p0/p)",
        [
            "t, s",
            "position, m",
            "σ",
            "ξ2",
            "velocity, m/s",
            "σ",
            "ξ2",
            "acceleration, m/s²",
            "σ",
            "ξ2",
        ],
    );
    let stride = (steps.len() / 20).max(1);
    let last = steps.len() - 1;
    let rows = steps.iter().zip(times);
    for (step, t) in rows.filter(|(s, _)| s.k % stride == 0 || s.k == last) {
        let mut cells = vec![short(*t)];
        for ((x, sigma), xi2) in step.x.iter().zip(sigma(step)).zip(step.xi2) {
            cells.extend([short(*x), short(sigma), short(xi2)]);
        }
        table.row(cells);
    }
    table
}

const BLUE: &str = "#2563eb";
const ORANGE: &str = "#ea580c";
const GRAY: &str = "#94a3b8";
const GREEN: &str = "#16a34a";
const TURNING: &str = "#fef3c7";
const NO_FIXES: &str = "#fee2e2";

fn page(
    config: &Config,
    times: &[f64],
    steps: &[Step],
    truth: Option<&Drive>,
    outages: &[(f64, f64)],
) -> Page {
    let mut page = Page::new(
        "Tracking by satellite positions and velocities",
        "One axis: what was measured, what the filter made of it, and how much it has learnt about each state.",
    );
    let line = |label: &str, color, f: &dyn Fn(usize) -> f64| Series {
        label: label.into(),
        color,
        width: 2,
        points: times.iter().enumerate().map(|(k, t)| (*t, f(k))).collect(),
    };
    let band = |(from, to), color, label: &str| Band {
        range: from..to,
        color,
        label: label.into(),
    };
    let bands: Vec<Band> = truth
        .map(|d| band((d.from, d.from + d.lasts), TURNING, "acceleration"))
        .into_iter()
        .chain(outages.iter().map(|o| band(*o, NO_FIXES, "outage")))
        .collect();
    let over_time = |title: &str, scale, series| Chart {
        x_label: "t, s".into(),
        bands: bands.clone(),
        ..Chart::new(title, scale, series)
    };
    let chart = |title: &str, scale, series| over_time(title, scale, series).svg();
    let rejected = count(steps, Outcome::Rejected);
    let tone = if rejected == 0 {
        Tone::Good
    } else {
        Tone::Note
    };
    page.verdict(tone, "Were measurements refused?", &outliers(steps));
    let used: usize = steps
        .iter()
        .map(|s| s.outcome.iter().filter(|o| o.used()).count())
        .sum();
    let nis: f64 = steps.iter().map(|s| s.nis).sum::<f64>() / used.max(1) as f64;
    page.verdict(
        if (0.8..1.25).contains(&nis) {
            Tone::Good
        } else {
            Tone::Note
        },
        "Do the innovations fit what the filter expects?",
        &format!(
            "Normalised innovation squared per channel: {}; 1 is right on average.",
            short(nis)
        ),
    );

    page.section("Trajectory");
    page.key(&[
        (GRAY, "measured"),
        (BLUE, "estimate"),
        (TURNING, "acceleration"),
        (NO_FIXES, "outage"),
    ]);
    let measured =
        |z: &[Option<f64>], has: &[Flag], k: usize| z[k].filter(|_| has[k].0).unwrap_or(f64::NAN);
    let names = ["position, m", "velocity, m/s", "acceleration, m/s²"];
    let mut pictures = Vec::new();
    for (i, name) in names.iter().enumerate() {
        let mut lines = Vec::new();
        if i == 0 {
            lines.push(line("", GRAY, &|k| {
                measured(&config.z_pos, &config.has_pos, k)
            }));
        } else if i == 1 {
            lines.push(line("", GRAY, &|k| {
                measured(&config.z_vel, &config.has_vel, k)
            }));
        }
        lines.push(line("", BLUE, &|k| steps[k].x[i]));
        pictures.push(chart(name, Scale::Linear, lines));
    }
    page.figures(3, &pictures, "Each state over time.");
    // the start and an outage would flatten all the rest
    let usual = |mut s: Vec<f64>| {
        s.retain(|s| *s > 0.0);
        s.sort_by(f64::total_cmp);
        s.get(s.len() / 2).map(|s| -6.0 * s..6.0 * s)
    };
    if let Some(drive) = truth {
        page.section("Errors");
        page.key(&[(BLUE, "error"), (ORANGE, "3σ")]);
        let mut pictures = Vec::new();
        for (i, name) in names.iter().enumerate() {
            let mut picture = over_time(
                name,
                Scale::Linear,
                vec![
                    line("", ORANGE, &|k| 3.0 * sigma(&steps[k])[i]),
                    line("", ORANGE, &|k| -3.0 * sigma(&steps[k])[i]),
                    line("", BLUE, &|k| steps[k].x[i] - drive.at(times[k])[i]),
                ],
            );
            picture.y_range = usual(steps.iter().map(|step| sigma(step)[i]).collect());
            pictures.push(picture.svg());
        }
        page.figures(
            3,
            &pictures,
            "Estimate minus truth; a line that leaves the picture comes back.",
        );
    }

    page.section("Innovations");
    let bounds = |m: usize, sign: f64| {
        move |k: usize| {
            let s = steps[k].s[m];
            if s > 0.0 {
                sign * 3.0 * s.sqrt()
            } else {
                f64::NAN
            }
        }
    };
    let innovation = |m: usize| {
        move |k: usize| {
            let there = steps[k].outcome[m] != Outcome::Missing;
            if there {
                steps[k].nu[m]
            } else {
                f64::NAN
            }
        }
    };
    let pictures: Vec<String> = ["position, m", "velocity, m/s"]
        .iter()
        .enumerate()
        .map(|(m, name)| {
            let lines = vec![
                line("", ORANGE, &bounds(m, 1.0)),
                line("", ORANGE, &bounds(m, -1.0)),
                line("", BLUE, &innovation(m)),
            ];
            let mut picture = over_time(name, Scale::Linear, lines);
            picture.y_range = usual(steps.iter().map(|step| step.s[m].sqrt()).collect());
            picture.svg()
        })
        .collect();
    page.figures(
        2,
        &pictures,
        "Measured minus predicted, and 3σ of what the filter expects. A gap: no measurement.",
    );

    page.section("What was learnt");
    page.text(
        "ξ2 = p0/p: how many times smaller each variance has become (prior-weighted). It falls where the vehicle goes \
         without measurements.",
    );
    let names = ["position", "velocity", "acceleration"];
    let colors = [BLUE, GREEN, ORANGE];
    page.key(&[(BLUE, names[0]), (GREEN, names[1]), (ORANGE, names[2])]);
    let three = |f: &dyn Fn(usize, usize) -> f64| -> Vec<Series> {
        (0..3).map(|i| line("", colors[i], &|k| f(k, i))).collect()
    };
    let pictures = [
        chart("ξ2", Scale::Logarithmic, three(&|k, i| steps[k].xi2[i])),
        chart(
            "ξ1, 1/s",
            Scale::Logarithmic,
            three(&|k, i| steps[k].xi1_meas.map_or(f64::NAN, |x| x[i])),
        ),
        chart(
            "σ over its start",
            Scale::Logarithmic,
            three(&|k, i| steps[k].xi2[i].powf(-0.5)),
        ),
    ];
    page.figures(
        3,
        &pictures,
        "Degree of observability of each state, its rate, and what is left of σ.",
    );
    page.section("Numbers");
    page.table(&summary(times, steps));
    page
}
