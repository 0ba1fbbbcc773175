//! `lab align`: a simulated alignment in one position beside one with a half turn, through the library itself.
//!
//! The samples of [`crate::sim`] go through [`StandingAlignment`], in f32, as firmware would feed it: coarse
//! window, then zero-velocity updates. Beside it stands the covariance analysis of Lu 2009 with the printed tables.

use std::path::PathBuf;

use nalgebra::Vector3;
use navsight::alignment::standing::{Progress, StandingAlignment};
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{block_rates, N, VEL};
use navsight::filter::Filter;
use navsight::measurement::{Direct, Linearized};
use navsight::observability::diagonal::xi1_riccati_blocks;
use navsight::observability::riccati::{DecreaseRate, Information};
use navsight::observability::spectrum::{Directions, Prior, Spectrum, ValuesOnly};
use serde::Deserialize;
use serde_json::{json, Value};

use super::history::History;
use super::solution::Solution;
use super::states::{xi, STATES};
use super::LabError;
use crate::config::{self, Config};
use crate::report::write_file;
use crate::sim::{error_state, Pose, Sensor, SensorErrors, Simulator, Static, Trajectory};

pub mod compare;
mod pages;
mod paper;
mod sweep;

use paper::Paper;

/// Flags of the command.
#[derive(clap::Args)]
pub struct Args {
    /// TOML with the scenario: the flags below, and [alignment] as in `replay --config`
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// TOML with a schedule of positions, sensor, disturbance and variants: compares the ways of using the positions
    #[arg(long, value_name = "FILE", conflicts_with = "config")]
    scenario: Option<PathBuf>,
    /// The comparison for section 3 of Peng 2016, where there is no --scenario
    #[arg(long)]
    compare: bool,
    /// By what angle to turn: closed forms and the filter's σ over the angle, for the two positions of the scenario
    #[arg(long, conflicts_with = "compare")]
    sweep: bool,
    /// Latitude [°]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    lat: Option<f64>,
    /// Heading at the start [°]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    heading: Option<f64>,
    /// Length of both cases [s]
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// When case 2 begins to turn [s]
    #[arg(long, value_name = "S")]
    turn_at: Option<f64>,
    /// How fast [°/s]
    #[arg(long, value_name = "DEG/S", allow_hyphen_values = true)]
    turn_rate: Option<f64>,
    /// For how long [s]
    #[arg(long, value_name = "S")]
    turn_time: Option<f64>,
    /// Grade of the sensor
    #[arg(long, value_enum)]
    grade: Option<config::Grade>,
    /// Standard deviation of a zero-velocity update, √R [m/s]
    #[arg(long, value_name = "M/S")]
    sigma: Option<f64>,
    /// Interval of the updates, T [s]
    #[arg(long, value_name = "S")]
    interval: Option<f64>,
    /// Samples per second
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Seed of the sensor errors
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// One JSON object on standard output instead of tables
    #[arg(long)]
    json: bool,
    /// Write report.html with pictures into this folder
    #[arg(long, value_name = "DIR", default_value = "target/report")]
    report: PathBuf,
    /// Write the two pictures of the heading, σ and ξ2, into this folder as SVG files
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
}

/// What is simulated.
#[derive(Clone, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Scenario {
    lat_deg: f64,
    height_m: f64,
    heading_deg: f64,
    pitch_deg: f64,
    roll_deg: f64,
    duration_s: f64,
    turn_at_s: f64,
    turn_rate_deg_s: f64,
    turn_time_s: f64,
    rate_hz: f64,
    seed: u64,
    alignment: Config,
}

impl Default for Scenario {
    fn default() -> Self {
        let mut alignment = Config::default();
        // Lu 2009, Table 2 and P0, where a real sensor can have it: the paper's angle noise is printed twice.
        alignment.sensor.angle_walk_deg_sqrt_h = 0.0015;
        alignment.prior.heading_deg = 2.0;
        alignment.zero_velocity.sigma_m_s = 1e-3;
        Self {
            lat_deg: 37.4,
            height_m: 50.0,
            heading_deg: 0.0,
            pitch_deg: 0.0,
            roll_deg: 0.0,
            duration_s: 600.0,
            turn_at_s: 300.0,
            turn_rate_deg_s: 90.0,
            turn_time_s: 2.0,
            rate_hz: 100.0,
            seed: 1,
            alignment,
        }
    }
}

impl Scenario {
    /// File first, flags on top.
    fn read(args: &Args) -> Result<Self, LabError> {
        let mut s: Self = match &args.config {
            Some(path) => config::read(path)?,
            None => Self::default(),
        };
        let a = &mut s.alignment;
        if let Some(grade) = args.grade {
            a.sensor = config::Sensor::of(grade);
        }
        for (to, flag) in [
            (&mut s.lat_deg, args.lat),
            (&mut s.heading_deg, args.heading),
            (&mut s.duration_s, args.duration),
            (&mut s.turn_at_s, args.turn_at),
            (&mut s.turn_rate_deg_s, args.turn_rate),
            (&mut s.turn_time_s, args.turn_time),
            (&mut s.rate_hz, args.rate),
            (&mut a.zero_velocity.sigma_m_s, args.sigma),
            (&mut a.zero_velocity.interval_s, args.interval),
        ] {
            if let Some(x) = flag {
                *to = x;
            }
        }
        s.seed = args.seed.unwrap_or(s.seed);
        s.check().map_err(|(field, what)| match &args.config {
            Some(path) => LabError::in_file(path, what).field(field),
            None => LabError::plain(what).field(field),
        })?;
        Ok(s)
    }

    /// The first field that is out of range, and why.
    fn check(&self) -> Result<(), (&'static str, String)> {
        let within = |field, x: f64, low: f64, high: f64| {
            if (low..=high).contains(&x) {
                Ok(())
            } else {
                Err((field, format!("{x} is outside {low} … {high}")))
            }
        };
        within("lat_deg", self.lat_deg, -80.0, 80.0)?;
        within("height_m", self.height_m, -1e4, 1e5)?;
        within("heading_deg", self.heading_deg, -360.0, 360.0)?;
        within("pitch_deg", self.pitch_deg, -89.0, 89.0)?;
        within("roll_deg", self.roll_deg, -180.0, 180.0)?;
        within("duration_s", self.duration_s, 20.0, 86_400.0)?;
        within("turn_at_s", self.turn_at_s, 0.0, self.duration_s)?;
        within(
            "turn_time_s",
            self.turn_time_s,
            0.0,
            self.duration_s - self.turn_at_s,
        )?;
        within("turn_rate_deg_s", self.turn_rate_deg_s, -360.0, 360.0)?;
        within("rate_hz", self.rate_hz, 10.0, 2000.0)?;
        let a = &self.alignment;
        let left = self.duration_s - a.coarse.seconds;
        within(
            "alignment.coarse.seconds",
            a.coarse.seconds,
            9.0,
            self.turn_at_s,
        )?;
        within(
            "alignment.zero_velocity.interval_s",
            a.zero_velocity.interval_s,
            0.01,
            left,
        )
    }

    /// Degrees that case 2 turns.
    fn turned_deg(&self) -> f64 {
        self.turn_rate_deg_s * self.turn_time_s
    }

    /// The motion of one case. The turn begins and ends with a sample.
    fn motion(&self, turn: bool) -> Turned {
        let at = Geodetic::from_degrees(self.lat_deg, 0.0, self.height_m);
        let whole = |t: f64| (t * self.rate_hz).round() / self.rate_hz;
        Turned {
            still: Static::degrees(at, self.heading_deg, self.pitch_deg, self.roll_deg),
            start: whole(self.turn_at_s),
            duration: if turn { whole(self.turn_time_s) } else { 0.0 },
            rate: self.turn_rate_deg_s.to_radians(),
        }
    }
}

/// Standing still, turned about the vertical once.
#[derive(Clone, Copy, Debug)]
struct Turned {
    still: Static,
    start: f64,
    duration: f64,
    rate: f64,
}

impl Trajectory for Turned {
    fn start(&self) -> Geodetic {
        self.still.at
    }
    fn pose(&self, t: f64) -> Pose {
        let mut pose = self.still.pose(t);
        let since = t - self.start;
        pose.euler.x += self.rate * since.clamp(0.0, self.duration);
        if (0.0..self.duration).contains(&since) {
            pose.euler_rate.x = self.rate;
        }
        pose
    }
}

/// The filter after one update, and what the simulation knows about it.
#[derive(Clone, Debug)]
struct Moment {
    t: f64,
    sigma: [f64; N],
    /// Estimate minus truth, in the filter's error states, SI.
    error: [f64; N],
    xi1: [f64; N],
    xi1_riccati: [f64; N],
    xi2: [f64; N],
    /// Descending.
    eta1: [f64; N],
    /// Descending.
    eta2: [f64; N],
}

/// A direction in σ0 units and its η2.
struct Along {
    eta2: f64,
    vector: [f64; N],
    /// More than one: any direction of a space of so many dimensions.
    dimension: usize,
}

/// One case, done.
struct Case {
    coarse: Solution,
    solution: Solution,
    sigma0: [f64; N],
    history: History<Moment>,
    last: Moment,
    /// From the best known direction to the worst.
    directions: Vec<Along>,
}

/// Simulates, prints, writes.
pub fn run(args: &Args) -> Result<(), LabError> {
    if args.compare || args.sweep || args.scenario.is_some() {
        let file = match &args.scenario {
            Some(path) => super::scenario::File::read(path)?,
            None => super::scenario::File::default(),
        };
        return match args.sweep {
            true => sweep::run(&file, args.json, &args.report),
            false => compare::run(&file, args.json, &args.report),
        };
    }
    let scenario = Scenario::read(args)?;
    let samples = (scenario.duration_s * scenario.rate_hz) as u64;
    // A step of the analysis costs about as much as a hundred samples.
    let bar = super::progress(2 * samples + 200 * paper::STEPS, "align");
    let impossible =
        |error: Error| LabError::plain(format!("the filter refused this scenario: {error:?}"));
    let one = simulate(&scenario, false, &bar).map_err(impossible)?;
    let two = simulate(&scenario, true, &bar).map_err(impossible)?;
    let paper = Paper::run(|| bar.inc(100))?;
    bar.finish_and_clear();
    let outcome = pages::Outcome {
        scenario: &scenario,
        cases: [&one, &two],
        paper: &paper,
    };
    let path = outcome.page().write(&args.report)?;
    if let Some(folder) = &args.pictures {
        for (name, svg) in outcome.pictures() {
            write_file(&folder.join(name), &svg)?;
        }
    }
    if args.json {
        return super::print_json(&json!({
            "states": STATES.map(|s| s.name),
            "case1": one.json(),
            "case2": two.json(),
            "lu2009": paper.json(),
            "report": path.display().to_string(),
        }));
    }
    super::print_text(&format!("{}\nReport: {}\n", outcome.text(), path.display()))
}

/// Runs one case through the library.
fn simulate(scenario: &Scenario, turn: bool, bar: &indicatif::ProgressBar) -> Result<Case, Error> {
    let a = &scenario.alignment;
    let noise = SensorErrors {
        arw: a.sensor.angle_walk(),
        vrw: a.sensor.velocity_walk(),
        ..SensorErrors::NONE
    };
    let mut sensor = Sensor::new(noise, scenario.seed);
    sensor.errors.gyro_bias = sensor.normal() * a.sensor.gyro_bias();
    sensor.errors.accel_bias = sensor.normal() * a.sensor.accel_bias();
    let motion = scenario.motion(turn);
    let position = motion.start();
    let plan = a.plan()?;
    let mut alignment =
        StandingAlignment::new(position, plan, a.prior(position.lat), a.settings()?)?;
    let (mut coarse, mut history, mut last) = (None, History::default(), None);
    let samples = (scenario.duration_s * scenario.rate_hz).round() as usize;
    for (truth, ideal) in Simulator::new(motion, 1.0 / scenario.rate_hz).take(samples) {
        let progress = alignment.take(&sensor.sample(&ideal))?;
        bar.inc(1);
        let Some(filter) = alignment.filter() else {
            continue;
        };
        match progress {
            Progress::Started(_) => coarse = Some(Solution::of(filter)),
            Progress::Updated(report) => {
                let (xi1, xi2) = xi(&[report])?;
                let measurement = plan.zero_velocity.linearize(filter.nav());
                let f_n = filter.nav().c_b_n() * ideal.delta_v_b.map(|x| (x / ideal.dt) as f32);
                let (xi1_riccati, eta1) = speed(filter, &f_n, &measurement, report.normalised)?;
                let moment = Moment {
                    t: truth.time,
                    sigma: std::array::from_fn(|i| filter.sigma(i).map_or(f64::NAN, f64::from)),
                    error: error_state(filter, &truth, &sensor.errors),
                    xi1,
                    xi1_riccati,
                    xi2,
                    eta1,
                    eta2: accuracy(filter, report.normalised)?.map(|d| d.eta2),
                };
                history.push(moment.clone());
                last = Some((moment, report.normalised));
            }
            _ => {}
        }
    }
    // The scenario leaves room for the coarse window and an update.
    let (Some(filter), Some(coarse), Some((last, normalised))) = (alignment.filter(), coarse, last)
    else {
        return Err(Error::Time);
    };
    Ok(Case {
        coarse,
        solution: Solution::of(filter),
        sigma0: filter.sigma0().map(f64::from),
        directions: accuracy(filter, normalised)?.into(),
        history,
        last,
    })
}

/// Eigenvalues and directions of T = P0⁻¹P, best known first.
fn accuracy(filter: &Filter, normalised: u16) -> Result<[Along; N], Error> {
    let mut spectrum = Box::new(Spectrum::<f32, N, 120, Directions<f32, N>>::new());
    spectrum.start_accuracy(
        filter.covariance(),
        Prior::Independent,
        u32::from(normalised),
    )?;
    spectrum.step(u32::MAX)?;
    Ok(std::array::from_fn(|k| {
        let direction = spectrum.direction(k);
        Along {
            eta2: spectrum
                .value(k)
                .map_or(f64::NAN, |lambda| 1.0 / f64::from(lambda)),
            vector: direction.map_or([f64::NAN; N], |d| d.vector.map(f64::from)),
            dimension: direction.map_or(0, |d| d.dimension),
        }
    }))
}

/// ξ1 by the Riccati equation and the eigenvalues of M = −P0⁻¹Ṗ, fastest first, just after an update.
fn speed(
    filter: &Filter,
    f_n: &Vector3<f32>,
    measurement: &Linearized<3, Direct<VEL>>,
    normalised: u16,
) -> Result<([f64; N], [f64; N]), Error> {
    let (mut xi1, mut eta1) = ([f64::NAN; N], [f64::NAN; N]);
    let Some(information) = Information::of(measurement, filter.sigma0()) else {
        return Ok((xi1, eta1));
    };
    let nav = filter.nav();
    let rates = block_rates(&filter.environment(), &nav.c_b_n(), f_n, filter.scaling());
    let mask = u32::from(normalised);
    let index = xi1_riccati_blocks(filter.covariance(), &rates, Some(&information), mask);
    xi1 = index.all().map(|x| x.map_or(f64::NAN, f64::from));
    let rate = DecreaseRate::blocks(filter.covariance(), &rates, &information);
    let mut spectrum = Box::new(Spectrum::<f32, N, 120, ValuesOnly>::new());
    spectrum.start_speed(&rate, Prior::Independent, mask)?;
    spectrum.step(u32::MAX)?;
    for (k, to) in eta1.iter_mut().rev().enumerate() {
        *to = spectrum.value(k).map_or(f64::NAN, f64::from);
    }
    Ok((xi1, eta1))
}

impl Case {
    fn json(&self) -> Value {
        json!({
            "coarse": self.coarse.json(),
            "final": self.solution.json(),
            "sigma0": self.sigma0,
            "sigma": self.last.sigma,
            "error": self.last.error,
            "xi1": self.last.xi1,
            "xi1_riccati": self.last.xi1_riccati,
            "xi2": self.last.xi2,
            "eta1": self.last.eta1,
            "eta2": self.last.eta2,
            "t_s": self.last.t,
        })
    }
}
