//! `lab covariance`: covariance analysis of one configuration.

use std::fs;
use std::path::{Path, PathBuf};

use navsight::error::Error;

use super::{print_json, progress, LabError};
use crate::covariance_analysis::{self, Config, Eigen, Instant, N};
use crate::report::{short, Table};

/// Flags of the command.
#[derive(clap::Args)]
pub struct Args {
    /// JSON with the keys of `cfg`, and `sigma0`, `constants`, `nondiag_P0_corr_pairs`
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// 1: one position; 2: a half turn from 300 s to 302 s
    #[arg(long, value_name = "1|2", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    case: u8,
    /// Times to report [s], multiples of T
    #[arg(long, value_name = "T1,T2,…", value_delimiter = ',', required = true)]
    times: Vec<String>,
    /// Number type of the covariance kernel
    #[arg(long, value_name = "f32|f64", default_value = "f64")]
    scalar: Scalar,
    /// One JSON object on standard output instead of a table
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Scalar {
    F32,
    F64,
}

/// Reads, runs, prints.
pub fn run(args: &Args) -> Result<(), LabError> {
    let config = read(&args.config)?;
    let times = times(&args.times, &config)?;
    let last = times
        .iter()
        .fold(0.0f64, |last, time| last.max(time.seconds));
    let bar = progress((last / config.interval).round() as u64, "covariance");
    let mut seconds: Vec<f64> = times.iter().map(|time| time.seconds).collect();
    seconds.sort_by(f64::total_cmp);
    let run = match args.scalar {
        Scalar::F32 => covariance_analysis::run::<f32>,
        Scalar::F64 => covariance_analysis::run::<f64>,
    };
    let instants =
        run(&config, args.case, &seconds, &mut || bar.inc(1)).map_err(|(t, error)| {
            let refused = |what| LabError::in_file(&args.config, what);
            match error {
                Error::NotPositive { row } if t == 0.0 => {
                    refused(format!("P0 is not positive definite, seen at state {row}"))
                        .field("nondiag_P0_corr_pairs")
                }
                error => refused(format!("the filter refused the run at {t} s: {error:?}")),
            }
        })?;
    bar.finish_and_clear();
    let mut object = serde_json::Map::new();
    for time in &times {
        let found = instants
            .iter()
            .find(|instant| near(instant.t, time.seconds));
        let Some(instant) = found else { continue };
        if args.json {
            object.insert(time.text.clone(), json(instant));
        } else {
            println!("{}", table(instant, &config).to_text());
            for (name, eigen) in [
                ("T = P0⁻¹P", &instant.accuracy),
                ("M = −P0⁻¹Ṗ", &instant.speed),
            ] {
                let values = eigen.as_ref().map_or("n/a".into(), |eigen| {
                    let values: Vec<String> = eigen.values.iter().map(|x| short(*x)).collect();
                    values.join("  ")
                });
                println!("eigenvalues of {name}: {values}\n");
            }
        }
    }
    if args.json {
        print_json(&object.into())?;
    }
    Ok(())
}

/// A time as the user wrote it and in seconds.
struct Time {
    text: String,
    seconds: f64,
}

fn times(texts: &[String], config: &Config) -> Result<Vec<Time>, LabError> {
    let wrong =
        |text: &str, what: &str| LabError::plain(format!("`{text}` {what}")).field("--times");
    let time = |text: &String| {
        let text = text.trim();
        let seconds: f64 = text
            .parse()
            .map_err(|_| wrong(text, "is not a number of seconds"))?;
        let steps = (seconds / config.interval).round();
        if !(steps >= 1.0 && near(steps * config.interval, seconds)) {
            return Err(wrong(
                text,
                &format!("is not a multiple of T = {} s", config.interval),
            ));
        }
        if seconds > config.t_end + 0.5 * config.interval {
            return Err(wrong(text, &format!("is after t_end = {} s", config.t_end)));
        }
        Ok(Time {
            text: text.into(),
            seconds,
        })
    };
    texts.iter().map(time).collect()
}

/// Equal up to the rounding of a sum of steps.
fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 * a.abs().max(b.abs())
}

fn json(instant: &Instant) -> serde_json::Value {
    let values = |eigen: &Option<Eigen>| eigen.as_ref().map(|eigen| eigen.values.clone());
    serde_json::json!({
        "P": instant.p,
        "xi2": instant.xi2,
        "xi1": instant.xi1,
        "xi1_meas": instant.xi1_meas,
        "eigT": values(&instant.accuracy),
        "eigM": values(&instant.speed),
    })
}

fn table(instant: &Instant, config: &Config) -> Table {
    let mut table = Table::new(
        format!("t = {} s", instant.t),
        [
            "state",
            "σ0",
            "σ",
            "ξ2",
            "ξ1 exact [1/s]",
            "ξ1 Riccati [1/s]",
        ],
    );
    let or_none = |x: Option<f64>| x.map_or("n/a".into(), short);
    for (i, name) in NAMES.iter().enumerate() {
        table.row([
            (*name).to_string(),
            short(config.sigma0[i]),
            short(instant.p[i].sqrt()),
            or_none(instant.xi2[i]),
            or_none(instant.xi1_meas[i]),
            or_none(instant.xi1[i]),
        ]);
    }
    table
}

/// The states of a configuration, SI.
const NAMES: [&str; N] = [
    "θx [rad]",
    "θy [rad]",
    "h [m]",
    "v east [m/s]",
    "v north [m/s]",
    "v up [m/s]",
    "ψ east [rad]",
    "ψ north [rad]",
    "ψ up [rad]",
    "gyro x [rad/s]",
    "gyro y [rad/s]",
    "gyro z [rad/s]",
    "accel x [m/s²]",
    "accel y [m/s²]",
    "accel z [m/s²]",
];

fn read(path: &Path) -> Result<Config, LabError> {
    let text =
        fs::read_to_string(path).map_err(|error| LabError::in_file(path, error.to_string()))?;
    let mut json = serde_json::Deserializer::from_str(&text);
    let config: Config = serde_path_to_error::deserialize(&mut json).map_err(|error| {
        let field = error.path().to_string();
        let line = error.inner().line();
        let located = LabError::in_file(path, error.inner().to_string()).line(line.max(1));
        if field == "." || field.contains('?') {
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
