//! The filter on a recorded flight with satellite fixes, heading unknown at the start.

use nalgebra::{Matrix3, SVector, Vector3};
use navsight::alignment::in_motion::{InMotion, MIN_PAIRS};
use navsight::attitude::quaternion_of;
use navsight::attitude::RfuToEnu;
use navsight::earth::{normal_gravity, Geodetic};
use navsight::error::Error;
use navsight::error_model::{BiasModel, NoiseDensity, POS};
use navsight::filter::{
    Aided, Filter, Gate, Handling, LateFilter, Prior, Settings, Source, States,
};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::{Antenna, NonHolonomic, Position, Velocity};
use navsight::nav::NavState;

use crate::input::gnss::Fix;
use crate::input::ImuSample;

/// States that are remembered: at 50 Hz and one a sample, 1.3 s.
pub const REMEMBERED: usize = 64;

/// A sample longer than this is reported as a gap [s].
pub const GAP: f64 = 0.1;

/// How a flight is filtered.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    /// Gyro noise [rad/s/√Hz].
    pub gyro_noise: f64,
    /// Accelerometer noise [m/s²/√Hz].
    pub accel_noise: f64,
    /// Gyro bias walk [rad/s/√s].
    pub gyro_walk: f64,
    /// Accelerometer bias walk [m/s²/√s].
    pub accel_walk: f64,
    /// 1σ of a fix: horizontal, vertical [m], velocity [m/s].
    pub sigma: [f32; 3],
    /// How old a fix is when its line comes [s].
    pub latency: f64,
    /// Antenna on the vehicle.
    pub antenna: Antenna,
    /// A vehicle on wheels moves neither sideways nor upwards: once in its interval.
    pub wheels: Option<NonHolonomic>,
    /// The filter starts when its heading is found to this [rad], 1σ.
    pub heading: f32,
    /// How well the start is known: level [rad], gyro bias [rad/s], accelerometer bias [m/s²].
    pub start: [f32; 3],
    /// Gate of both sources.
    pub limit: Option<f32>,
    /// Refused for this long, the filter is reset to the source [s].
    pub lock_out: f32,
}

impl Setup {
    /// The settings at which two other filters were measured on `quad_flight`.
    pub const QUAD: Self = Self {
        gyro_noise: 3e-3,
        accel_noise: 0.1,
        gyro_walk: 5e-5,
        accel_walk: 1e-3,
        sigma: [2.5, 5.0, 0.3],
        latency: 0.25,
        antenna: Antenna::AT_IMU,
        wheels: None,
        heading: 0.14,
        start: [0.05, 0.01, 0.3],
        limit: Some(25.0),
        lock_out: 5.0,
    };

    /// A filter that starts here with this knowledge of its attitude.
    fn filter(&self, start: NavState, attitude: Vector3<f32>) -> Result<Filter, Error> {
        let square = |x: f64| (x * x) as f32;
        let settings = Settings {
            limits: ImuLimits::DEFAULT,
            noise: NoiseDensity {
                velocity: square(self.accel_noise),
                attitude: square(self.gyro_noise),
                gyro_bias: [square(self.gyro_walk); 3],
                accel_bias: [square(self.accel_walk); 3],
            },
            bias: BiasModel::constant(),
            propagation_interval: 0.1,
            gate: None,
        };
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
        Filter::new(start, &prior, settings)
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

/// The filter, its two sources and where it is in the list of fixes.
#[derive(Clone, Debug)]
pub struct Flight {
    stage: Stage,
    /// Positions.
    pub position: Source,
    /// Velocities.
    pub velocity: Source,
    /// Wheels.
    pub wheels: Source,
    /// Samples longer than [`GAP`]: end and length [s].
    pub gaps: Vec<(f64, f64)>,
    setup: Setup,
    /// Time of the recording at which the filter's is zero.
    begin: f64,
    next: usize,
    interval: f32,
    /// Since the wheels were used [s].
    rolled: f64,
}

/// What one fix led to.
#[derive(Clone, Copy, Debug)]
pub struct Fixed {
    /// Time of arrival [s].
    pub t: f64,
    /// The position half.
    pub position: Aided<3>,
    /// The velocity half.
    pub velocity: Aided<3>,
}

impl Fixed {
    /// Whether the filter was reset.
    pub fn reset(&self) -> bool {
        self.position.handling == Handling::Reset || self.velocity.handling == Handling::Reset
    }
}

impl Flight {
    /// Starts with nothing at the beginning of this sample.
    ///
    /// # Errors
    /// [`Error::Size`] without a fix; settings that cannot be.
    pub fn new(setup: Setup, first: &ImuSample, fixes: &[Fix]) -> Result<Self, Error> {
        let at = fixes.first().ok_or(Error::Size)?;
        let (lat, height) = (at.lat_deg.to_radians() as f32, at.height as f32);
        let gravity = normal_gravity(lat.sin(), height);
        let gate = |states| {
            Source::new(Gate {
                limit: setup.limit,
                lock_out: Some((setup.lock_out, states)),
            })
        };
        let interval = match fixes.last() {
            Some(last) if fixes.len() > 1 => ((last.t - at.t) / (fixes.len() - 1) as f64) as f32,
            _ => 0.0,
        };
        Ok(Self {
            stage: Stage::Finding(InMotion::new(gravity, 0.9, ImuLimits::DEFAULT)?),
            position: gate(States::POSITION)?,
            velocity: gate(States::VELOCITY)?,
            wheels: Source::new(Gate {
                limit: setup.limit,
                lock_out: None,
            })?,
            rolled: 0.0,
            gaps: Vec::new(),
            setup,
            begin: first.t - first.dt,
            next: fixes.partition_point(|fix| fix.t < first.t),
            interval,
        })
    }

    /// The filter, once it runs.
    pub fn filter(&self) -> Option<&Filter> {
        match &self.stage {
            Stage::Finding(_) => None,
            Stage::Running(filter) => Some(filter.filter()),
        }
    }

    /// One sample, and the fixes that have come by its end. `cut`: fixes of these times are left out.
    ///
    /// # Errors
    /// Those of the filter.
    pub fn take(
        &mut self,
        sample: &ImuSample,
        fixes: &[Fix],
        cut: &[(f64, f64)],
    ) -> Result<Vec<Fixed>, Error> {
        let narrow = |v: [f64; 3]| Vector3::from(v.map(|x| x as f32));
        let imu = ImuIncrement {
            delta_theta_b: narrow(sample.delta_theta),
            delta_v_b: narrow(sample.delta_v),
            dt: sample.dt as f32,
        };
        if sample.dt > GAP {
            self.gaps.push((sample.t, sample.dt));
        }
        match &mut self.stage {
            Stage::Finding(finder) => finder.take(&imu)?,
            Stage::Running(filter) => filter.propagate(&imu)?,
        }
        self.roll(sample.dt)?;
        let mut done = Vec::new();
        while let Some(fix) = fixes.get(self.next).filter(|fix| fix.t <= sample.t) {
            self.next += 1;
            let time = fix.t - self.begin - self.setup.latency;
            let lost = cut.iter().any(|(from, to)| (*from..*to).contains(&fix.t));
            if let (Some(v), true, false) = (fix.v_n, time >= 0.0, lost) {
                let v = Vector3::from(v.map(|x| x as f32));
                done.extend(self.fix(fix, time, v)?);
            }
        }
        Ok(done)
    }

    /// The wheels, where it is their time.
    fn roll(&mut self, dt: f64) -> Result<(), Error> {
        let (Some(wheels), Stage::Running(filter)) = (&self.setup.wheels, &mut self.stage) else {
            return Ok(());
        };
        self.rolled += dt;
        if self.rolled + 0.5 * dt >= f64::from(wheels.interval()) {
            self.rolled = 0.0;
            let now = filter.filter().time();
            filter.update(&mut self.wheels, now, |nav| wheels.linearize(nav))?;
        }
        Ok(())
    }

    fn fix(&mut self, fix: &Fix, time: f64, v: Vector3<f32>) -> Result<Option<Fixed>, Error> {
        let place = Geodetic::from_degrees(fix.lat_deg, fix.lon_deg, fix.height);
        let [flat, up, speed] = self.setup.sigma;
        let filter = match &mut self.stage {
            Stage::Finding(finder) => {
                if finder.velocity(time, v)? && finder.pairs() >= MIN_PAIRS {
                    let found = finder.solve(speed)?;
                    if found.sigma.z < self.setup.heading {
                        let attitude = RfuToEnu(quaternion_of(&found.c_b_n)?);
                        let moved = (v + found.delta_v_n * 0.5) * found.age;
                        let mut dx = SVector::<f32, 15>::zeros();
                        dx.fixed_rows_mut::<3>(POS).copy_from(&-moved);
                        let start = NavState::new(place, v + found.delta_v_n, attitude)?;
                        let filter = self.setup.filter(start.corrected(&dx), found.sigma)?;
                        self.begin += finder.time();
                        self.stage = Stage::Running(LateFilter::new(filter, 0.0)?);
                    }
                }
                return Ok(None);
            }
            Stage::Running(filter) => filter,
        };
        let position = Position::new(place, Vector3::new(flat, flat, up), self.interval)?
            .of(self.setup.antenna);
        let velocity =
            Velocity::new(v, Vector3::repeat(speed), self.interval)?.of(self.setup.antenna);
        Ok(Some(Fixed {
            t: fix.t,
            position: filter.update(&mut self.position, time, |nav| position.linearize(nav))?,
            velocity: filter.update(&mut self.velocity, time, |nav| velocity.linearize(nav))?,
        }))
    }

    /// Attitude now, once it is known.
    pub fn c_b_n(&self) -> Option<Matrix3<f32>> {
        self.filter().map(|filter| filter.nav().c_b_n())
    }
}
