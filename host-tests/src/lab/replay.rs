//! `lab replay`: the filter on recorded data.
//!
//! A standing vehicle is aligned by the library's own [`StandingAlignment`]: coarse window, then zero-velocity
//! updates. Where fixes (`--gnss`) or rest flags (`--rest`) are given, the filter that the coarse window started goes
//! on with those. With `--in-motion` the vehicle need not stand: its attitude is found from the changes of the satellite
//! velocities ([`crate::flight`]), heading unknown at the start.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use navsight::alignment::coarse::CoarseSolution;
use navsight::alignment::standing::{Progress, StandingAlignment};
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::ATT;
use navsight::filter::{Filter, Handling, UpdateReport};
use navsight::imu::ImuIncrement;
use navsight::measurement::{Position, Velocity, ZeroVelocity};

use super::history::Snapshot;
use super::solution::{angles_deg, turn_deg, Solution};
use super::states::xi;
use super::LabError;
use crate::config::{self, Config};
use crate::flight::{Flight, Setup, GAP};
use crate::input::gnss::{self, Fix};
use crate::input::reference::{self, Attitude};
use crate::input::rest::{self, Flag};
use crate::input::{Axes, ImuReader, ImuSample};

mod evidence;
mod manoeuvres;
mod pages;
mod tally;
mod verdicts;

use pages::Outcome;
use tally::{Last, Tally};
use verdicts::Watch;

/// Flags of the command.
#[derive(clap::Args)]
pub struct Args {
    /// Inertial samples: t_s, dtheta_x,y,z [rad], dvel_x,y,z [m/s], or gyro_x,y,z [rad/s], acc_x,y,z [m/s²]
    #[arg(long, value_name = "FILE")]
    imu: PathBuf,
    /// Satellite fixes: t_s, lat_deg, lon_deg, height_m, and v_e, v_n, v_u [m/s] where known
    #[arg(long, value_name = "FILE")]
    gnss: Option<PathBuf>,
    /// Somebody else's attitude to compare with: t_s, qw, qx, qy, qz (body to local, z up)
    #[arg(long = "ref", value_name = "FILE")]
    reference: Option<PathBuf>,
    /// When the sensor stood still: t_s, at_rest (0 or 1); without it, whenever it does not turn
    #[arg(long, value_name = "FILE")]
    rest: Option<PathBuf>,
    /// Latitude [°]; without it, that of the first fix
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    lat: Option<f64>,
    /// Longitude [°]; without it, that of the first fix, or 0
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    lon: Option<f64>,
    /// Height above the ellipsoid [m]; without it, that of the first fix, or 0
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    height: Option<f64>,
    /// The vehicle is moving from the start: attitude and heading are found from the velocities of --gnss
    #[arg(long, requires = "gnss")]
    in_motion: bool,
    /// Leave out the fixes of these times [s]; may be given several times
    #[arg(long, value_names = ["FROM", "TO"], num_args = 2, requires = "gnss")]
    outage: Vec<f64>,
    /// How old a fix is when its line comes [s], with --in-motion; instead of gnss.latency_s
    #[arg(long, value_name = "S", requires = "in_motion")]
    latency: Option<f64>,
    /// Begin here [s]
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    from: Option<f64>,
    /// End here [s]
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    to: Option<f64>,
    /// TOML with sensor grade, priors and filter settings; navigation grade without it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Sensor axes that point right, forward, up, as in y,x,-z
    #[arg(
        long,
        value_name = "X,Y,Z",
        default_value = "x,y,z",
        allow_hyphen_values = true
    )]
    axes: Axes,
    /// One JSON object on standard output instead of tables
    #[arg(long)]
    json: bool,
    /// Write report.html with pictures into this folder
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
}

/// Reads, runs, prints.
pub fn run(args: &Args) -> Result<(), LabError> {
    let config: Config = match &args.config {
        Some(path) => config::read(path)?,
        None => Config::default(),
    };
    let aids = Aids {
        fixes: optional(&args.gnss, gnss::read)?,
        flags: args.rest.as_deref().map(rest::read).transpose()?,
        attitudes: optional(&args.reference, reference::read)?,
    };
    let position = position(args, &aids.fixes)?;
    let mut replay = Replay::new(args, &config, aids, position)?;
    let (from, to) = (
        args.from.unwrap_or(f64::NEG_INFINITY),
        args.to.unwrap_or(f64::INFINITY),
    );
    let size = std::fs::metadata(&args.imu).map_or(0, |m| m.len());
    let bar = super::progress(size, "replay");
    let mut samples = ImuReader::open(&args.imu)?;
    while let Some(sample) = samples.next() {
        let sample = sample?;
        if sample.line % 1024 == 0 {
            bar.set_position(samples.bytes());
        }
        if sample.t > to {
            break;
        }
        if sample.t > from {
            replay.take(&sample).map_err(|what| {
                LabError::in_file(&args.imu, what)
                    .line(sample.line)
                    .field("t_s")
            })?;
        }
    }
    bar.finish_and_clear();
    let outcome = replay
        .finish()
        .map_err(|what| LabError::in_file(&args.imu, what))?;
    let written = match &args.report {
        Some(folder) => Some(outcome.page(&args.imu).write(folder)?),
        None => None,
    };
    if args.json {
        return super::print_json(&outcome.json());
    }
    let mut text = outcome.text();
    if let Some(path) = written {
        text += &format!("\nReport: {}\n", path.display());
    }
    super::print_text(&text)
}

fn optional<T>(
    path: &Option<PathBuf>,
    read: impl Fn(&Path) -> Result<Vec<T>, LabError>,
) -> Result<Vec<T>, LabError> {
    path.as_deref().map_or(Ok(Vec::new()), read)
}

/// Where the vehicle is at the start: flags first, then the first fix.
fn position(args: &Args, fixes: &[Fix]) -> Result<Geodetic, LabError> {
    let first = fixes
        .iter()
        .find(|fix| fix.t >= args.from.unwrap_or(f64::NEG_INFINITY));
    let Some(lat) = args.lat.or(first.map(|fix| fix.lat_deg)) else {
        // A damaged file is the more useful thing to hear of.
        ImuReader::open(&args.imu)?.try_for_each(|sample| sample.map(drop))?;
        return Err(LabError::plain("where was this? The latitude is needed").field("--lat"));
    };
    let lon = args.lon.or(first.map(|fix| fix.lon_deg)).unwrap_or(0.0);
    let height = args.height.or(first.map(|fix| fix.height)).unwrap_or(0.0);
    let position = Geodetic::from_degrees(lat, lon, height);
    position.check().map_err(|error| {
        let what = match error {
            Error::Polar => format!("{lat}° is too close to a pole (limit 80°)"),
            _ => format!("{lat}°, {lon}°, {height} m is no place on earth"),
        };
        LabError::plain(what).field("--lat, --lon, --height")
    })?;
    Ok(position)
}

/// What is known besides the samples.
struct Aids {
    fixes: Vec<Fix>,
    flags: Option<Vec<Flag>>,
    attitudes: Vec<Attitude>,
}

/// What runs.
#[allow(clippy::large_enum_variant)] // one of them, for the length of a run
enum Driver {
    /// The library's alignment of a standing vehicle, from the first sample on.
    Standing(StandingAlignment),
    /// The filter with the aids of this recording.
    Aided(Filter),
    /// A vehicle in motion, before its first sample.
    Waiting(Setup),
    /// A vehicle in motion.
    Flying(Flight),
}

struct Replay<'a> {
    axes: Axes,
    config: &'a Config,
    aids: Aids,
    driver: Driver,
    zero_velocity: ZeroVelocity,
    coarse: Option<(CoarseSolution, Solution)>,
    next_fix: usize,
    /// Mean distance between fixes [s].
    fix_interval: f32,
    /// Times without fixes [s].
    outages: Vec<(f64, f64)>,
    next_attitude: usize,
    /// Since the last zero-velocity update was due: seconds, and whether all of them were at rest.
    waited: f64,
    rested: bool,
    turning: bool,
    tally: Tally,
}

impl<'a> Replay<'a> {
    fn new(
        args: &Args,
        config: &'a Config,
        aids: Aids,
        position: Geodetic,
    ) -> Result<Self, LabError> {
        let impossible = |error: Error| {
            let refused = LabError::plain(format!("the settings are refused: {error:?}"));
            match &args.config {
                Some(path) => LabError::in_file(path, refused.what),
                None => refused,
            }
        };
        let plan = config.plan().map_err(impossible)?;
        let settings = config.settings().map_err(impossible)?;
        let alignment =
            StandingAlignment::new(position, plan, config.prior(position.lat), settings)
                .map_err(impossible)?;
        let fix_interval = match (aids.fixes.first(), aids.fixes.last()) {
            (Some(first), Some(last)) if last.t > first.t => {
                ((last.t - first.t) / (aids.fixes.len() - 1) as f64) as f32
            }
            _ => 0.0, // unknown
        };
        let driver = if args.in_motion {
            if aids.fixes.iter().any(|fix| fix.v_n.is_none()) {
                return Err(LabError::plain(
                    "there are no velocities v_e, v_n, v_u to find it from",
                )
                .field("--in-motion"));
            }
            let setup = config.setup().map_err(impossible)?;
            Driver::Waiting(Setup {
                latency: args.latency.unwrap_or(setup.latency),
                ..setup
            })
        } else {
            Driver::Standing(alignment)
        };
        let mut tally = Tally::default();
        let outages = super::outages(&args.outage)?;
        for (from, to) in &outages {
            tally.event(&format!("fixes from {from} s to {to} s are left out"));
        }
        Ok(Self {
            axes: args.axes,
            config,
            aids,
            driver,
            outages,
            zero_velocity: plan.zero_velocity,
            coarse: None,
            next_fix: 0,
            fix_interval,
            next_attitude: 0,
            waited: 0.0,
            rested: true,
            turning: false,
            tally,
        })
    }

    /// One sample. An error is a sentence about this sample.
    fn take(&mut self, sample: &ImuSample) -> Result<(), String> {
        let narrow = |v: [f64; 3]| Vector3::from(self.axes.apply(v).map(|x| x as f32));
        let imu = ImuIncrement {
            delta_theta_b: narrow(sample.delta_theta),
            delta_v_b: narrow(sample.delta_v),
            dt: sample.dt as f32,
        };
        self.tally.time = sample.t;
        self.tally.samples += 1;
        let refused = |error: Error| match error {
            Error::Time => format!(
                "the sample before is {:.3} s away (limit {} s)",
                sample.dt, self.config.filter.gap_s
            ),
            Error::OutOfRange => {
                "no vehicle turns or accelerates like this, or it was not standing still".into()
            }
            other => format!("refused by the filter: {other:?}"),
        };
        match &mut self.driver {
            Driver::Standing(alignment) => {
                let progress = alignment.take(&imu).map_err(refused)?;
                if let Some(watch) = &mut self.tally.watch {
                    watch.stands(&imu.delta_v_b, imu.dt);
                }
                self.progress(progress).map_err(refused)?;
            }
            Driver::Aided(filter) => {
                filter.propagate(&imu).map_err(refused)?;
                self.aid(sample)
                    .map_err(|error| format!("the update was refused: {error:?}"))?;
            }
            Driver::Waiting(setup) => {
                let flight = Flight::new(*setup, sample, &self.aids.fixes).map_err(refused)?;
                self.driver = Driver::Flying(flight);
                self.fly(sample).map_err(refused)?;
            }
            Driver::Flying(_) => self.fly(sample).map_err(refused)?,
        }
        self.moved();
        self.compare(sample.t);
        Ok(())
    }

    fn filter(&self) -> Option<&Filter> {
        match &self.driver {
            Driver::Standing(alignment) => alignment.filter(),
            Driver::Aided(filter) => Some(filter),
            Driver::Waiting(_) => None,
            Driver::Flying(flight) => flight.filter(),
        }
    }

    /// A sample of a vehicle in motion, and the fixes that came with it.
    fn fly(&mut self, sample: &ImuSample) -> Result<(), Error> {
        let Driver::Flying(flight) = &mut self.driver else {
            return Ok(());
        };
        let running = flight.filter().is_some();
        let sample = ImuSample {
            delta_theta: self.axes.apply(sample.delta_theta),
            delta_v: self.axes.apply(sample.delta_v),
            ..*sample
        };
        let fixed = flight.take(&sample, &self.aids.fixes, &self.outages)?;
        if sample.dt > GAP {
            self.tally.event(&format!(
                "a gap of {:.0} ms in the samples",
                1e3 * sample.dt
            ));
        }
        let found = (!running).then(|| flight.filter().cloned()).flatten();
        if let Some(filter) = found {
            let sigma = filter.sigma(ATT + 2).map_or(f32::NAN, f32::to_degrees);
            self.tally.event(&format!(
                "attitude found in motion, heading to {sigma:.1}°: the filter starts"
            ));
            self.tally.watch = Some(Watch::new(&filter, &self.config.required, false)?);
        }
        for fix in &fixed {
            for (aided, name) in [(&fix.position, "position"), (&fix.velocity, "velocity")] {
                if aided.handling == Handling::Reset {
                    self.tally.event(&format!("reset to the {name} fixes"));
                }
            }
            let reports = [fix.position.report, fix.velocity.report];
            self.tally.fix(&reports[0], Some(&reports[1]));
            self.updated(&reports)?;
        }
        Ok(())
    }

    /// Where the vehicle is and how it moves, for the pictures.
    fn moved(&mut self) {
        let Some(filter) = self.filter() else { return };
        let (nav, origin) = (filter.nav(), self.aids.fixes.first());
        let v = nav.v_n();
        let heading = f64::from(nav.euler().heading.to_degrees());
        let place = origin.map(|f| Geodetic::from_degrees(f.lat_deg, f.lon_deg, f.height));
        let away = place.and_then(|place| nav.displacement_to(&place).ok());
        let now = self.tally.time;
        let level = [v.x, v.y].map(f64::from);
        self.tally.manoeuvres.take(now, heading, level);
        if let Some(d) = away {
            self.tally
                .moved([-d.x, -d.y, v.x.hypot(v.y)].map(f64::from));
        }
    }

    /// What the alignment of a standing vehicle did with a sample.
    fn progress(&mut self, progress: Progress) -> Result<(), Error> {
        match progress {
            Progress::Coarse | Progress::Between => {}
            Progress::Started(coarse) => {
                self.tally.event("coarse alignment done, the filter starts");
                let filter = self.filter().cloned();
                let standing = self.aids.fixes.is_empty() && self.aids.flags.is_none();
                if let Some(filter) = &filter {
                    self.tally.watch = Some(Watch::new(filter, &self.config.required, standing)?);
                }
                self.coarse = filter.as_ref().map(|filter| (coarse, Solution::of(filter)));
                if let Some(filter) = filter {
                    if !standing {
                        self.next_fix = self
                            .aids
                            .fixes
                            .partition_point(|fix| fix.t <= self.tally.time);
                        self.driver = Driver::Aided(filter);
                    }
                }
            }
            Progress::Turning => self.turning(true),
            Progress::Updated(report) => {
                self.turning(false);
                self.updated(&[report])?;
            }
        }
        Ok(())
    }

    /// Fixes and zero velocity of this recording, where they are due.
    fn aid(&mut self, sample: &ImuSample) -> Result<(), Error> {
        let Driver::Aided(filter) = &mut self.driver else {
            return Ok(());
        };
        let mut reports = Vec::new();
        while let Some(fix) = self
            .aids
            .fixes
            .get(self.next_fix)
            .filter(|fix| fix.t <= sample.t)
        {
            self.next_fix += 1;
            if self.outages.iter().any(|(a, b)| (*a..*b).contains(&fix.t)) {
                continue;
            }
            let g = &self.config.gnss;
            let (flat, up) = (g.position_m as f32, g.height_m as f32);
            let place = Geodetic::from_degrees(fix.lat_deg, fix.lon_deg, fix.height);
            let interval = self.fix_interval;
            let position = Position::new(place, Vector3::new(flat, flat, up), interval)?;
            reports.push(filter.update(&position.linearize(filter.nav()))?);
            let first = reports.len() - 1;
            if let Some(v) = fix.v_n {
                let v = Vector3::from(v.map(|x| x as f32));
                let velocity = Velocity::new(v, Vector3::repeat(g.velocity_m_s as f32), interval)?;
                reports.push(filter.update(&velocity.linearize(filter.nav()))?);
            }
            self.tally.fix(&reports[first], reports.get(first + 1));
        }
        if let Some(flags) = &self.aids.flags {
            self.rested &= rest::at(flags, sample.t);
            self.waited += sample.dt;
            if self.waited + 0.5 * sample.dt >= f64::from(self.zero_velocity.interval()) {
                if self.rested {
                    reports.push(filter.update(&self.zero_velocity.linearize(filter.nav()))?);
                }
                (self.waited, self.rested) = (0.0, true);
            }
        }
        self.updated(&reports)
    }

    fn turning(&mut self, now: bool) {
        if now != self.turning {
            self.turning = now;
            if let Some(watch) = &mut self.tally.watch {
                watch.turned();
            }
            self.tally
                .event(if now { "turning" } else { "standing again" });
        }
    }

    /// All updates of one instant.
    fn updated(&mut self, reports: &[UpdateReport<3>]) -> Result<(), Error> {
        if reports.is_empty() {
            return Ok(());
        }
        self.tally.innovations(reports);
        let (xi1, xi2) = xi(reports)?;
        self.tally.last = Some(Last { xi1, xi2 });
        let (nav_time, time) = (self.filter().map_or(0.0, Filter::time), self.tally.time);
        if let Some(watch) = &mut self.tally.watch {
            watch.take(time, nav_time, reports);
        }
        if let Some(filter) = self.filter() {
            let snapshot = Snapshot {
                t: self.tally.time,
                angles_deg: angles_deg(&filter.nav().c_b_n()),
                sigma: std::array::from_fn(|i| filter.sigma(i).map_or(f64::NAN, f64::from)),
                xi1,
                xi2,
                nis: self.tally.nis.last,
            };
            self.tally.history.push(snapshot);
        }
        Ok(())
    }

    /// Differences to the reference at its instants, at the sample just behind.
    fn compare(&mut self, t: f64) {
        while let Some(there) = self
            .aids
            .attitudes
            .get(self.next_attitude)
            .filter(|a| a.t <= t)
        {
            self.next_attitude += 1;
            let q = there.q.map(|x| x as f32);
            let wanted = angles_deg(&navsight::attitude::c_b_n(q));
            let Some(filter) = self.filter() else {
                continue;
            };
            let got = angles_deg(&filter.nav().c_b_n());
            self.tally.compared.count += 1;
            for (i, (got, wanted)) in got.iter().zip(wanted).enumerate() {
                let d = turn_deg(wanted, *got);
                self.tally.compared.sum[i] += d;
                self.tally.compared.square[i] += d * d;
            }
        }
    }

    fn finish(mut self) -> Result<Outcome, String> {
        if self.tally.samples == 0 {
            return Err("there is no sample between --from and --to".into());
        }
        if let Driver::Aided(filter) = &mut self.driver {
            filter.synchronize();
        }
        let Some(filter) = self.filter() else {
            let need = self.config.coarse.seconds;
            if matches!(self.driver, Driver::Waiting(_) | Driver::Flying(_)) {
                return Err("no attitude was found: the velocity hardly changed".into());
            }
            return Err(format!(
                "the recording is over before the coarse window of {need} s"
            ));
        };
        let solution = Solution::of(filter);
        let sigma0 = filter.sigma0().map(f64::from);
        let sigma = std::array::from_fn(|i| filter.sigma(i).map_or(f64::NAN, f64::from));
        Ok(Outcome {
            coarse: self.coarse,
            solution,
            outages: self.outages,
            sigma0,
            sigma,
            tally: self.tally,
        })
    }
}
