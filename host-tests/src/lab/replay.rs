//! `lab replay`: the filter on recorded data.
//!
//! A standing vehicle is aligned by the library's own [`StandingAlignment`]: coarse window, then zero-velocity
//! updates. Where fixes (`--gnss`) or rest flags (`--rest`) are given, the filter that the coarse window started goes
//! on with those ([`crate::flight`]). With `--in-motion` the vehicle need not stand: its attitude is found from the
//! changes of the satellite velocities, heading unknown at the start. From there on both are the same.

use std::path::{Path, PathBuf};

use navsight::alignment::coarse::CoarseSolution;
use navsight::alignment::standing::{Progress, StandingAlignment};
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{ATT, N};
use navsight::filter::{Filter, Handling, UpdateReport};

use super::history::Snapshot;
use super::solution::{angles_deg, turn_deg, Solution};
use super::states::xi;
use super::LabError;
use crate::config::{self, Config};
use crate::flight::{self, Flight, Refused, Setup, Taken, GAP};
use crate::input::gnss::{self, Fix};
use crate::input::reference::{self, Attitude};
use crate::input::rest;
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
    /// Satellite fixes: t_s, lat_deg, lon_deg, height_m, and where known v_e, v_n, v_u [m/s] and the accuracies of the
    /// receiver, h_acc_m, v_acc_m, s_acc_m_s, which go before those of the configuration
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
    /// How old a fix is when its line comes [s]; instead of gnss.latency_s
    #[arg(long, value_name = "S", requires = "gnss", value_parser = latency, allow_hyphen_values = true)]
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
    let aids = flight::Aids {
        fixes: optional(&args.gnss, gnss::read)?,
        flags: optional(&args.rest, rest::read)?,
        outages: super::outages(&args.outage)?,
    };
    let attitudes = optional(&args.reference, reference::read)?;
    let position = position(args, &aids.fixes)?;
    let mut replay = Replay::new(args, &config, aids, attitudes, position)?;
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
            replay.take(&sample)?;
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

fn latency(text: &str) -> Result<f64, String> {
    let s = text.parse().map_err(|_| "it is no number".to_owned())?;
    config::check_latency(s).map(|()| s)
}

/// What runs.
#[allow(clippy::large_enum_variant)] // one of them, for the length of a run
enum Driver {
    /// The library's alignment of a standing vehicle, from the first sample on.
    Standing(StandingAlignment),
    /// A vehicle in motion, before its first sample.
    Waiting,
    /// The filter with the aids of this recording.
    Flying(Flight),
}

struct Replay<'a> {
    args: &'a Args,
    config: &'a Config,
    setup: Setup,
    aids: flight::Aids,
    /// To compare with.
    attitudes: Vec<Attitude>,
    next_attitude: usize,
    driver: Driver,
    coarse: Option<(CoarseSolution, Solution)>,
    turning: bool,
    /// When the filter began, had an update, or was looked at without one [s].
    heard: f64,
    tally: Tally,
}

/// Without an update for so long the filter is looked at all the same: its σ grows, and verdicts fade [s].
const SILENCE: f64 = 2.0;

impl<'a> Replay<'a> {
    fn new(
        args: &'a Args,
        config: &'a Config,
        aids: flight::Aids,
        attitudes: Vec<Attitude>,
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
        let setup = config.setup().map_err(impossible)?;
        let setup = Setup {
            latency: args.latency.unwrap_or(setup.latency),
            rest: args.rest.as_ref().map(|_| plan.zero_velocity),
            ..setup
        };
        let driver = if args.in_motion {
            if aids.fixes.iter().any(|fix| fix.v_n.is_none()) {
                return Err(LabError::plain(
                    "there are no velocities v_e, v_n, v_u to find it from",
                )
                .field("--in-motion"));
            }
            Driver::Waiting
        } else {
            let prior = config.prior(position.lat);
            let alignment = StandingAlignment::new(position, plan, prior, setup.settings);
            Driver::Standing(alignment.map_err(impossible)?)
        };
        let mut tally = Tally::default();
        for (from, to) in &aids.outages {
            tally.event(&format!("fixes from {from} s to {to} s are left out"));
        }
        Ok(Self {
            args,
            config,
            setup,
            aids,
            attitudes,
            next_attitude: 0,
            driver,
            coarse: None,
            turning: false,
            heard: 0.0,
            tally,
        })
    }

    fn take(&mut self, sample: &ImuSample) -> Result<(), LabError> {
        let sample = ImuSample {
            delta_theta: self.args.axes.apply(sample.delta_theta),
            delta_v: self.args.axes.apply(sample.delta_v),
            ..*sample
        };
        self.tally.time = sample.t;
        self.tally.samples += 1;
        self.step(&sample)
            .map_err(|refused| self.why(&sample, refused))?;
        if self.filter().is_none() {
            self.heard = sample.t;
        } else if sample.t - self.heard >= SILENCE {
            self.silent();
        }
        self.moved();
        self.compare(sample.t);
        Ok(())
    }

    fn step(&mut self, sample: &ImuSample) -> Result<(), Refused> {
        match &mut self.driver {
            Driver::Standing(alignment) => {
                let imu = sample.increment();
                let progress = alignment.take(&imu).map_err(Refused::Sample)?;
                if let Some(watch) = &mut self.tally.watch {
                    watch.stands(&imu.delta_v_b, imu.dt);
                }
                self.progress(progress).map_err(Refused::Sample)
            }
            Driver::Waiting => {
                let flight = Flight::new(self.setup, sample, &self.aids);
                self.driver = Driver::Flying(flight.map_err(Refused::Sample)?);
                self.fly(sample)
            }
            Driver::Flying(_) => self.fly(sample),
        }
    }

    /// The line of the file that stopped the run.
    fn why(&self, sample: &ImuSample, refused: Refused) -> LabError {
        let of_sample = |what: String| {
            LabError::in_file(&self.args.imu, what)
                .line(sample.line)
                .field("t_s")
        };
        match (refused, &self.args.gnss) {
            (Refused::Sample(Error::Time), _) => of_sample(format!(
                "the sample before is {:.3} s away (limit {} s)",
                sample.dt, self.config.filter.gap_s
            )),
            (Refused::Sample(Error::OutOfRange), _) => of_sample(
                "no vehicle turns or accelerates like this, or it was not standing still".into(),
            ),
            (Refused::Fix(line, error), Some(path)) => {
                let (what, field) = match error {
                    Error::Late => (
                        format!(
                            "with a latency of {} s it is older than what is remembered",
                            self.setup.latency
                        ),
                        "t_s",
                    ),
                    Error::Polar => ("too close to a pole (limit 80°)".into(), "lat_deg"),
                    _ => (
                        format!("no fix of a vehicle ({error:?})"),
                        "lat_deg, lon_deg, height_m, v_e, v_n, v_u",
                    ),
                };
                LabError::in_file(path, what).line(line).field(field)
            }
            (Refused::Sample(error) | Refused::Fix(_, error), _) => {
                of_sample(format!("refused by the filter: {error:?}"))
            }
        }
    }

    fn filter(&self) -> Option<&Filter> {
        match &self.driver {
            Driver::Standing(alignment) => alignment.filter(),
            Driver::Waiting => None,
            Driver::Flying(flight) => flight.filter(),
        }
    }

    /// A sample, and the aids that came with it.
    fn fly(&mut self, sample: &ImuSample) -> Result<(), Refused> {
        let Driver::Flying(flight) = &mut self.driver else {
            return Ok(());
        };
        let running = flight.filter().is_some();
        let taken = flight.take(sample, &self.aids)?;
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
            let watch = Watch::new(&filter, &self.config.required, false);
            self.tally.watch = Some(watch.map_err(Refused::Sample)?);
        }
        self.taken(&taken).map_err(Refused::Sample)
    }

    /// What the aids of one sample said.
    fn taken(&mut self, taken: &Taken) -> Result<(), Error> {
        if let Some(wheels) = &taken.wheels {
            self.updated(&[wheels.report])?;
        }
        if let Some(rest) = &taken.rest {
            self.updated(&[rest.report])?;
        }
        for fix in &taken.fixes {
            let velocity = fix.velocity.as_ref();
            for (aided, name) in [(Some(&fix.position), "position"), (velocity, "velocity")] {
                if aided.is_some_and(|aided| aided.handling == Handling::Reset) {
                    self.tally.event(&format!("reset to the {name} fixes"));
                }
            }
            let velocity = velocity.map(|aided| aided.report);
            self.tally.fix(&fix.position.report, velocity.as_ref());
            match velocity {
                Some(velocity) => self.updated(&[fix.position.report, velocity])?,
                None => self.updated(&[fix.position.report])?,
            }
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
                let Some(filter) = self.filter().cloned() else {
                    return Ok(());
                };
                let standing = self.aids.fixes.is_empty() && self.aids.flags.is_empty();
                self.tally.watch = Some(Watch::new(&filter, &self.config.required, standing)?);
                self.coarse = Some((coarse, Solution::of(&filter)));
                if !standing {
                    let flight = Flight::aligned(self.setup, filter, self.tally.time, &self.aids)?;
                    self.driver = Driver::Flying(flight);
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
    fn updated<const M: usize>(&mut self, reports: &[UpdateReport<M>]) -> Result<(), Error> {
        self.tally.innovations(reports);
        let (xi1, xi2) = xi(reports)?;
        self.tally.last = Some(Last { xi1, xi2 });
        let (nav_time, time) = (self.filter().map_or(0.0, Filter::time), self.tally.time);
        if let Some(watch) = &mut self.tally.watch {
            watch.take(time, nav_time, reports);
        }
        self.remember(xi1, xi2, self.tally.nis.last);
        Ok(())
    }

    /// No update for a while.
    fn silent(&mut self) {
        let Some(filter) = self.filter() else { return };
        let (nav_time, p) = (filter.time(), filter.covariance().diagonal());
        let time = self.tally.time;
        if let Some(watch) = &mut self.tally.watch {
            watch.pass(time, nav_time, &p);
        }
        self.remember([f64::NAN; N], p.map(|p| f64::from(p).recip()), f64::NAN);
    }

    /// The filter now, for the pictures.
    fn remember(&mut self, xi1: [f64; N], xi2: [f64; N], nis: f64) {
        self.heard = self.tally.time;
        let Some(filter) = self.filter() else { return };
        let snapshot = Snapshot {
            t: self.tally.time,
            angles_deg: angles_deg(&filter.nav().c_b_n()),
            sigma: std::array::from_fn(|i| filter.sigma(i).map_or(f64::NAN, f64::from)),
            xi1,
            xi2,
            nis,
        };
        self.tally.history.push(snapshot);
    }

    /// Differences to the reference at its instants, at the sample just behind.
    fn compare(&mut self, t: f64) {
        while let Some(there) = self.attitudes.get(self.next_attitude).filter(|a| a.t <= t) {
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
        if let Driver::Flying(flight) = &mut self.driver {
            flight.synchronize();
        }
        let Some(filter) = self.filter() else {
            let need = self.config.coarse.seconds;
            if !matches!(self.driver, Driver::Standing(_)) {
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
            outages: self.aids.outages,
            sigma0,
            sigma,
            tally: self.tally,
        })
    }
}
