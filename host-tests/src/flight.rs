//! The filter on a recording: satellite fixes that come late from an antenna on a lever arm, rest, wheels. It begins with a
//! filter that was aligned at a standstill, or in motion with nothing known of the attitude.

use nalgebra::{SVector, Vector3};
use navsight::alignment::in_motion::{InMotion, MIN_PAIRS};
use navsight::attitude::quaternion_of;
use navsight::attitude::RfuToEnu;
use navsight::earth::{normal_gravity, Geodetic};
use navsight::error::Error;
use navsight::error_model::{BiasModel, NoiseDensity, POS};
use navsight::filter::{
    Aided, Filter, Gate, Handling, LateFilter, Prior, Settings, Source, States,
};
use navsight::imu::ImuLimits;
use navsight::measurement::{Antenna, NonHolonomic, Position, Velocity, ZeroVelocity};
use navsight::nav::NavState;

use crate::input::gnss::Fix;
use crate::input::rest::{self, Flag};
use crate::input::ImuSample;

/// Samples, or states, that are remembered.
pub const REMEMBERED: usize = 256;
/// What is remembered reaches at least this much further back than the latency [s]: a fix waits for the end of a sample.
const WAITING: f64 = 0.5;

/// A sample longer than this is reported as a gap [s].
pub const GAP: f64 = 0.1;

/// How a recording is filtered.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    /// Those of the filter; their gate is that of every source.
    pub settings: Settings,
    /// 1σ of a fix that says nothing of it: horizontal, vertical [m], velocity [m/s].
    pub sigma: [f32; 3],
    /// How old a fix is when its line comes [s].
    pub latency: f64,
    /// Antenna on the vehicle.
    pub antenna: Antenna,
    /// Refused for this long, the filter is reset to the fixes [s].
    pub lock_out: f32,
    /// A vehicle on wheels moves neither sideways nor upwards: once in its interval.
    pub wheels: Option<NonHolonomic>,
    /// Used once in its interval where the vehicle was flagged at rest for all of it.
    pub rest: Option<ZeroVelocity>,
    /// In motion the filter starts when its heading is found to this [rad], 1σ.
    pub heading: f32,
    /// How well that start is known: level [rad], gyro bias [rad/s], accelerometer bias [m/s²].
    pub start: [f32; 3],
}

impl Setup {
    /// The settings at which two other filters were measured on `quad_flight`.
    pub const QUAD: Self = Self {
        settings: Settings {
            limits: ImuLimits::DEFAULT,
            noise: NoiseDensity {
                velocity: 0.1 * 0.1,
                attitude: 3e-3 * 3e-3,
                gyro_bias: [5e-5 * 5e-5; 3],
                accel_bias: [1e-3 * 1e-3; 3],
            },
            bias: BiasModel {
                rate_g: 0.0,
                rate_a: 0.0,
            },
            propagation_interval: 0.1,
            gate: Some(25.0),
        },
        sigma: [2.5, 5.0, 0.3],
        latency: 0.25,
        antenna: Antenna::AT_IMU,
        lock_out: 5.0,
        wheels: None,
        rest: None,
        heading: 0.14,
        start: [0.05, 0.01, 0.3],
    };

    /// A filter that starts here with this knowledge of its attitude.
    fn filter(&self, start: NavState, attitude: Vector3<f32>) -> Result<Filter, Error> {
        let [flat, up, speed] = self.sigma;
        let [level, gyro, accel] = self.start;
        let prior = Prior {
            position: [flat, flat, up],
            velocity: [speed; 3],
            attitude: [
                attitude.x.max(level),
                attitude.y.max(level),
                attitude.z.max(level),
            ],
            gyro_bias: [gyro; 3],
            accel_bias: [accel; 3],
        };
        Filter::new(start, &prior, self.settings)
    }

    /// That filter, remembering what the latency asks for.
    fn remembering(&self, filter: Filter) -> Result<LateFilter<REMEMBERED>, Error> {
        let spacing = (self.latency + WAITING) / REMEMBERED as f64;
        LateFilter::new(filter, spacing as f32)
    }
}

/// What comes besides the samples.
#[derive(Clone, Debug, Default)]
pub struct Aids {
    /// In order of time.
    pub fixes: Vec<Fix>,
    /// When the vehicle stood still.
    pub flags: Vec<Flag>,
    /// Fixes of these times are left out [s].
    pub outages: Vec<(f64, f64)>,
}

impl Aids {
    /// Mean distance between fixes [s]; 0: unknown.
    fn interval(&self) -> f32 {
        match (self.fixes.first(), self.fixes.last()) {
            (Some(first), Some(last)) if last.t > first.t => {
                ((last.t - first.t) / (self.fixes.len() - 1) as f64) as f32
            }
            _ => 0.0,
        }
    }

    fn lost(&self, t: f64) -> bool {
        self.outages.iter().any(|(a, b)| (*a..*b).contains(&t))
    }
}

/// What runs.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)] // one of them, for the length of a run
enum Stage {
    /// Nothing is known of the attitude yet.
    Finding(InMotion<REMEMBERED>),
    /// The filter.
    Running(LateFilter<REMEMBERED>),
}

/// The filter, its sources and where it is in the list of fixes.
#[derive(Clone, Debug)]
pub struct Flight {
    stage: Stage,
    /// Positions.
    pub position: Source,
    /// Velocities.
    pub velocity: Source,
    /// Wheels.
    pub wheels: Source,
    /// Rest.
    pub rest: Source,
    /// Samples longer than [`GAP`]: end and length [s].
    pub gaps: Vec<(f64, f64)>,
    setup: Setup,
    /// Time of the recording at which the filter's is zero.
    begin: f64,
    /// Time of the filter before which it knows nothing [s].
    earliest: f64,
    /// The next fix.
    next: usize,
    interval: f32,
    /// Since the wheels were used [s].
    rolled: f64,
    /// Since rest was due: seconds, and whether the vehicle was at rest in all of them.
    waited: f64,
    rested: bool,
}

/// What one fix led to.
#[derive(Clone, Copy, Debug)]
pub struct Fixed {
    /// Time of arrival [s].
    pub t: f64,
    /// The position half.
    pub position: Aided<3>,
    /// The velocity half, where there is one.
    pub velocity: Option<Aided<3>>,
}

impl Fixed {
    /// Whether the filter was reset.
    pub fn reset(&self) -> bool {
        let reset = |aided: &Aided<3>| aided.handling == Handling::Reset;
        reset(&self.position) || self.velocity.as_ref().is_some_and(reset)
    }
}

/// What came with one sample.
#[derive(Clone, Debug, Default)]
pub struct Taken {
    /// Wheels, where it was their time.
    pub wheels: Option<Aided<2>>,
    /// Rest, where it was its time.
    pub rest: Option<Aided<3>>,
    /// Fixes that have come by its end.
    pub fixes: Vec<Fixed>,
}

/// What was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refused {
    /// The sample, or what is known of the vehicle at its end.
    Sample(Error),
    /// The fix in this line.
    Fix(usize, Error),
}

impl Flight {
    /// Starts with nothing at the beginning of this sample.
    ///
    /// # Errors
    /// [`Error::Size`] without a fix; settings that cannot be.
    pub fn new(setup: Setup, first: &ImuSample, aids: &Aids) -> Result<Self, Error> {
        let at = aids.fixes.first().ok_or(Error::Size)?;
        let (lat, height) = (at.lat_deg.to_radians() as f32, at.height as f32);
        let gravity = normal_gravity(lat.sin(), height);
        let finder = InMotion::new(gravity, 0.9, setup.settings.limits)?;
        let next = aids.fixes.partition_point(|fix| fix.t < first.t);
        Self::from(
            setup,
            Stage::Finding(finder),
            first.t - first.dt,
            aids,
            next,
        )
    }

    /// Goes on with a filter whose last sample ended at this time of the recording [s].
    ///
    /// # Errors
    /// Settings that cannot be.
    pub fn aligned(setup: Setup, filter: Filter, now: f64, aids: &Aids) -> Result<Self, Error> {
        let time = filter.time();
        let stage = Stage::Running(setup.remembering(filter)?);
        let next = aids.fixes.partition_point(|fix| fix.t <= now);
        let mut flight = Self::from(setup, stage, now - time, aids, next)?;
        flight.earliest = time;
        Ok(flight)
    }

    fn from(
        setup: Setup,
        stage: Stage,
        begin: f64,
        aids: &Aids,
        next: usize,
    ) -> Result<Self, Error> {
        let source = |lock_out| {
            Source::new(Gate {
                limit: setup.settings.gate,
                lock_out,
            })
        };
        Ok(Self {
            stage,
            position: source(Some((setup.lock_out, States::POSITION)))?,
            velocity: source(Some((setup.lock_out, States::VELOCITY)))?,
            wheels: source(None)?,
            rest: source(None)?,
            gaps: Vec::new(),
            setup,
            begin,
            earliest: 0.0,
            next,
            interval: aids.interval(),
            rolled: 0.0,
            waited: 0.0,
            rested: true,
        })
    }

    /// The filter, once it runs.
    pub fn filter(&self) -> Option<&Filter> {
        match &self.stage {
            Stage::Finding(_) => None,
            Stage::Running(filter) => Some(filter.filter()),
        }
    }

    /// As [`Filter::synchronize`], once it runs.
    pub fn synchronize(&mut self) {
        if let Stage::Running(filter) = &mut self.stage {
            filter.synchronize();
        }
    }

    /// One sample, and what has come by its end.
    ///
    /// # Errors
    /// Those of the filter.
    pub fn take(&mut self, sample: &ImuSample, aids: &Aids) -> Result<Taken, Refused> {
        if sample.dt > GAP {
            self.gaps.push((sample.t, sample.dt));
        }
        let mut taken = self.step(sample, aids).map_err(Refused::Sample)?;
        while let Some(fix) = aids.fixes.get(self.next).filter(|fix| fix.t <= sample.t) {
            self.next += 1;
            let time = fix.t - self.begin - self.setup.latency;
            if time >= self.earliest && !aids.lost(fix.t) {
                let fixed = self.fix(fix, time);
                taken
                    .fixes
                    .extend(fixed.map_err(|error| Refused::Fix(fix.line, error))?);
            }
        }
        Ok(taken)
    }

    /// The sample, and what is known of the vehicle at its end.
    fn step(&mut self, sample: &ImuSample, aids: &Aids) -> Result<Taken, Error> {
        let imu = sample.increment();
        let filter = match &mut self.stage {
            Stage::Finding(finder) => {
                finder.take(&imu)?;
                return Ok(Taken::default());
            }
            Stage::Running(filter) => filter,
        };
        filter.propagate(&imu)?;
        let now = filter.filter().time();
        let mut taken = Taken::default();
        // Half a sample early rather than half a sample late.
        let due = |waited: f64, interval: f32| waited + 0.5 * sample.dt >= f64::from(interval);
        if let Some(wheels) = &self.setup.wheels {
            self.rolled += sample.dt;
            if due(self.rolled, wheels.interval()) {
                self.rolled = 0.0;
                let rolling = filter.update(&mut self.wheels, now, |nav| wheels.linearize(nav));
                taken.wheels = Some(rolling?);
            }
        }
        if let Some(still) = &self.setup.rest {
            self.rested &= rest::at(&aids.flags, sample.t);
            self.waited += sample.dt;
            if due(self.waited, still.interval()) {
                if self.rested {
                    let standing = filter.update(&mut self.rest, now, |nav| still.linearize(nav));
                    taken.rest = Some(standing?);
                }
                (self.waited, self.rested) = (0.0, true);
            }
        }
        Ok(taken)
    }

    fn fix(&mut self, fix: &Fix, time: f64) -> Result<Option<Fixed>, Error> {
        let place = Geodetic::from_degrees(fix.lat_deg, fix.lon_deg, fix.height);
        let v_n = fix.v_n.map(|v| Vector3::from(v.map(|x| x as f32)));
        let mut sigma = self.setup.sigma;
        for (sigma, said) in sigma.iter_mut().zip(fix.accuracy) {
            *sigma = said.map_or(*sigma, |said| said as f32);
        }
        let [flat, up, speed] = sigma;
        let filter = match (&mut self.stage, v_n) {
            (Stage::Running(filter), _) => filter,
            (Stage::Finding(_), None) => return Ok(None),
            (Stage::Finding(finder), Some(v)) => {
                if finder.velocity(time, v)? && finder.pairs() >= MIN_PAIRS {
                    // A vehicle that stands, or does not turn yet, tells nothing.
                    let Ok(found) = finder.solve(speed) else {
                        return Ok(None);
                    };
                    if found.sigma.z < self.setup.heading {
                        let attitude = RfuToEnu(quaternion_of(&found.c_b_n)?);
                        let moved = (v + found.delta_v_n * 0.5) * found.age;
                        let mut dx = SVector::<f32, 15>::zeros();
                        dx.fixed_rows_mut::<3>(POS).copy_from(&-moved);
                        let start = NavState::new(place, v + found.delta_v_n, attitude)?;
                        let filter = self.setup.filter(start.corrected(&dx), found.sigma)?;
                        self.begin += finder.time();
                        self.stage = Stage::Running(self.setup.remembering(filter)?);
                    }
                }
                return Ok(None);
            }
        };
        let position = Position::new(place, Vector3::new(flat, flat, up), self.interval)?
            .of(self.setup.antenna);
        let position = filter.update(&mut self.position, time, |nav| position.linearize(nav))?;
        let velocity = match v_n {
            Some(v) => {
                let velocity =
                    Velocity::new(v, Vector3::repeat(speed), self.interval)?.of(self.setup.antenna);
                Some(filter.update(&mut self.velocity, time, |nav| velocity.linearize(nav))?)
            }
            None => None,
        };
        Ok(Some(Fixed {
            t: fix.t,
            position,
            velocity,
        }))
    }
}
