//! One axis tracked through a list of measurements.

use navsight::error::Error;
use navsight::linalg::Real;
use navsight::observability::diagonal::{xi1, xi1_riccati, xi2};
use navsight::observability::riccati::DecreaseRate;
use navsight::observability::spectrum::{Prior, Progress, Spectrum, ValuesOnly};
use navsight::tracking::{
    AxisTracker, Beyond, CurrentModel, Fix, Kinematics, Limits, Outcome, Reading, Settings,
};
use serde::{Deserialize, Serialize};

/// A run: the filter and what it is given. Step 0 is an update only; step k predicts over `dt[k]`, then takes in the
/// channels of step k.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Correlation time [s].
    pub tau: f64,
    /// Upper limit of the acceleration [m/s²].
    pub a_max: f64,
    /// Lower limit, negative [m/s²].
    pub a_min: f64,
    /// Smallest headroom, part of the larger limit.
    pub floor_frac: f64,
    /// "abs", "full" or "clamp".
    pub beyond: BeyondName,
    /// Half width of the transition between unequal limits [m/s²].
    #[serde(default)]
    pub blend: f64,
    /// Variances at the start [m², m²/s², m²/s⁴].
    #[serde(rename = "P0")]
    pub p0: [f64; 3],
    /// Variances of a position and of a velocity measurement [m², m²/s²].
    #[serde(rename = "R")]
    pub r: [f64; 2],
    /// "cs" or "singer".
    pub model: ModelName,
    /// Variance of Singer's model [m²/s⁴].
    #[serde(default)]
    pub sigma2: Option<f64>,
    /// Largest ν²/s of a channel; none accepts all.
    #[serde(default)]
    pub gate: Option<f64>,
    /// The how manieth outlier in a row is believed; 0 = none.
    #[serde(default = "third")]
    pub believe_after: u8,
    /// Position, velocity, acceleration at the start.
    pub x0: [f64; 3],
    /// Interval before each step [s]; 0 = none.
    pub dt: Vec<f64>,
    /// Position [m].
    pub z_pos: Vec<Option<f64>>,
    /// Velocity [m/s].
    pub z_vel: Vec<Option<f64>>,
    /// Whether the position is there.
    pub has_pos: Vec<Flag>,
    /// Whether the velocity is there.
    pub has_vel: Vec<Flag>,
}

fn third() -> u8 {
    3
}

/// The rule beyond a limit.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum BeyondName {
    /// |h|.
    Abs,
    /// The whole headroom.
    Full,
    /// The floor.
    Clamp,
}

impl From<BeyondName> for Beyond {
    fn from(name: BeyondName) -> Self {
        match name {
            BeyondName::Abs => Beyond::Abs,
            BeyondName::Full => Beyond::Full,
            BeyondName::Clamp => Beyond::Clamp,
        }
    }
}

/// The motion model.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum ModelName {
    /// 'Current' statistical model.
    Cs,
    /// Singer.
    Singer,
}

/// Yes or no, written as 1, 0, true or false.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(try_from = "serde_json::Value")]
pub struct Flag(pub bool);

impl TryFrom<serde_json::Value> for Flag {
    type Error = String;

    fn try_from(value: serde_json::Value) -> Result<Self, String> {
        match (value.as_bool(), value.as_f64()) {
            (Some(flag), _) => Ok(Self(flag)),
            (_, Some(0.0)) => Ok(Self(false)),
            (_, Some(1.0)) => Ok(Self(true)),
            _ => Err(format!("{value} is not 0, 1, true or false")),
        }
    }
}

impl Config {
    /// The first field that cannot be, and why.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        let n = self.dt.len();
        if n == 0 {
            return Err(("dt", "no step".into()));
        }
        for (field, len) in [
            ("z_pos", self.z_pos.len()),
            ("z_vel", self.z_vel.len()),
            ("has_pos", self.has_pos.len()),
            ("has_vel", self.has_vel.len()),
        ] {
            if len != n {
                return Err((field, format!("{len} values where dt has {n}")));
            }
        }
        if let Some((k, dt)) = self.dt.iter().enumerate().find(|(_, dt)| **dt < 0.0) {
            return Err(("dt", format!("[{k}] is {dt}: time goes backwards")));
        }
        if self.model == ModelName::Singer && self.sigma2.is_none() {
            return Err(("sigma2", "missing, and Singer's model needs it".into()));
        }
        let channels = [
            ("z_pos", &self.z_pos, &self.has_pos),
            ("z_vel", &self.z_vel, &self.has_vel),
        ];
        for (field, z, has) in channels {
            let gap = z.iter().zip(has).position(|(z, has)| has.0 && z.is_none());
            if let Some(k) = gap {
                return Err((field, format!("[{k}] is null and not marked as missing")));
            }
        }
        for (field, variances) in [("P0", &self.p0[..]), ("R", &self.r)] {
            if let Some(v) = variances.iter().find(|v| !(**v > 0.0 && v.is_finite())) {
                return Err((field, format!("{v} is not positive")));
            }
        }
        let settings = self.settings::<f64>();
        AxisTracker::new(&self.start(), &self.sigma0(), settings)
            .map(drop)
            .map_err(|_| {
                (
                    "tau",
                    "tau, limits, floor, blend or gate out of range".into(),
                )
            })
    }

    /// The library's settings.
    pub fn settings<T: Real>(&self) -> Settings<T> {
        let model = match self.model {
            ModelName::Cs => CurrentModel::current(
                T::of(self.tau),
                Limits {
                    a_max: T::of(self.a_max),
                    a_min: T::of(self.a_min),
                    floor: T::of(self.floor_frac),
                    beyond: self.beyond.into(),
                    blend: T::of(self.blend),
                },
            ),
            ModelName::Singer => {
                CurrentModel::singer(T::of(self.tau), T::of(self.sigma2.unwrap_or(0.0)))
            }
        };
        Settings {
            gate: self.gate.map(T::of),
            believe_after: self.believe_after,
            longest: T::of(1e6),
            ..Settings::new(model)
        }
    }

    fn start<T: Real>(&self) -> Kinematics<T, 1> {
        kinematics(self.x0)
    }

    fn sigma0<T: Real>(&self) -> Kinematics<T, 1> {
        kinematics(self.p0.map(f64::sqrt))
    }
}

fn kinematics<T: Real>([p, v, a]: [f64; 3]) -> Kinematics<T, 1> {
    Kinematics {
        position: [T::of(p)],
        velocity: [T::of(v)],
        acceleration: [T::of(a)],
    }
}

/// What a step left, SI, in the names of the golden file. `P_upper`: elements 11, 12, 13, 22, 23, 33.
#[derive(Clone, Debug, Serialize, PartialEq)]
pub struct Step {
    /// Number.
    pub k: usize,
    /// Estimate.
    #[serde(skip)]
    pub x: [f64; 3],
    /// Innovations of position and velocity.
    #[serde(skip)]
    pub nu: [f64; 2],
    /// Their variances before the step.
    #[serde(skip)]
    pub s: [f64; 2],
    /// What became of them.
    #[serde(skip)]
    pub outcome: [Outcome; 2],
    /// Covariance after.
    #[serde(rename = "P_upper")]
    pub p_upper: [f64; 6],
    /// Gain: a row per state, a column per channel used.
    #[serde(rename = "K")]
    pub gain: Vec<Vec<f64>>,
    /// Normalised innovation squared.
    pub nis: f64,
    /// Acceleration variance of the prediction; none without one.
    pub sigma2: Option<f64>,
    /// −ṗ/p0 of the Riccati equation with R·T.
    pub xi1_ric: Option<[f64; 3]>,
    /// −Δp/(T p0) from update to update.
    pub xi1_diff: Option<[f64; 3]>,
    /// (p⁻ − p⁺)/(T p0).
    pub xi1_meas: Option<[f64; 3]>,
    /// p0/p.
    pub xi2: [f64; 3],
    /// Eigenvalues of −Ṗ against P0.
    pub eta1: Option<[f64; 3]>,
    /// 1/eigenvalues of P against P0.
    pub eta2: [f64; 3],
}

/// Runs the filter in T. `Err`: step and reason.
pub fn run<T: Real>(config: &Config) -> Result<Vec<Step>, (usize, Error)> {
    let mut tracker = AxisTracker::<T>::new(&config.start(), &config.sigma0(), config.settings())
        .map_err(|e| (0, e))?;
    let mut previous = [1.0; 3];
    (0..config.dt.len())
        .map(|k| {
            let step = one(&mut tracker, config, k, &previous).map_err(|e| (k, e))?;
            previous = step.xi2.map(|xi2| 1.0 / xi2);
            Ok(step)
        })
        .collect()
}

fn one<T: Real>(
    tracker: &mut AxisTracker<T>,
    config: &Config,
    k: usize,
    previous: &[f64; 3],
) -> Result<Step, Error> {
    let dt = config.dt[k];
    if dt > 0.0 {
        tracker.predict(T::of(dt))?;
    }
    let reading = |z: &[Option<f64>], has: &[Flag], r: f64| {
        let z = z[k].filter(|_| has[k].0)?;
        let mut reading = Reading::new([T::of(z)], T::one());
        reading.noise = navsight::tracking::Noise::Independent([T::of(r)]);
        Some(reading)
    };
    let fix = Fix {
        position: reading(&config.z_pos, &config.has_pos, config.r[0]),
        velocity: reading(&config.z_vel, &config.has_vel, config.r[1]),
    };
    let report = tracker.update(&fix)?;
    let p = tracker.covariance();
    let unit = tracker.sigma0().map(Real::wide);
    let si = |i: usize, j: usize| p.element(i, j).wide() * unit[i] * unit[j];
    let outcome = [report.outcome[0][0], report.outcome[1][0]];
    let used = || (0..2).filter(|m| outcome[*m].used());
    let wide = |index: [Option<T>; 3]| -> Option<[f64; 3]> {
        index
            .iter()
            .all(Option::is_some)
            .then(|| index.map(|x| x.map_or(0.0, Real::wide)))
    };
    let all = AxisTracker::<T>::NORMALISED;
    let rates = tracker.rates();
    let interval = T::of(dt);
    let information = report.information(interval);
    let speed = information
        .as_ref()
        .map(|i| DecreaseRate::riccati(p, &rates.f, &rates.q, i));
    let xi2 = xi2(&report.p_after, all)?
        .all()
        .map(|x| x.map_or(f64::NAN, Real::wide));
    let state = tracker.state();
    let mut eta2 = eigenvalues::<T>(|s| s.start_accuracy(p, Prior::Independent, all))?;
    eta2.reverse();
    Ok(Step {
        k,
        x: [state.position[0], state.velocity[0], state.acceleration[0]].map(Real::wide),
        nu: report.nu.map(|nu| nu[0].wide()),
        s: report.s.map(|s| s[0].wide()),
        outcome,
        p_upper: [si(0, 0), si(0, 1), si(0, 2), si(1, 1), si(1, 2), si(2, 2)],
        gain: (0..3)
            .map(|i| used().map(|m| si(i, m) / config.r[m]).collect())
            .collect(),
        nis: report.nis.wide(),
        sigma2: (dt > 0.0).then(|| tracker.sigma2()[0].wide()),
        xi1_ric: wide(xi1_riccati(p, &rates.f, &rates.q, information.as_ref(), all).all()),
        xi1_diff: (dt > 0.0)
            .then(|| [0, 1, 2].map(|i| (previous[i] - report.p_after[i].wide()) / dt)),
        xi1_meas: wide(xi1(&report.decrease, interval, all)?.all()),
        xi2,
        eta1: speed
            .map(|rate| eigenvalues::<T>(|s| s.start_speed(&rate, Prior::Independent, all)))
            .transpose()?,
        eta2: eta2.map(|x| 1.0 / x),
    })
}

/// Eigenvalues in ascending order.
fn eigenvalues<T: Real>(
    start: impl FnOnce(&mut Spectrum<'static, T, 3, 6, ValuesOnly>) -> Result<(), Error>,
) -> Result<[f64; 3], Error> {
    let mut spectrum = Spectrum::new();
    start(&mut spectrum)?;
    match spectrum.step(u32::MAX)? {
        Progress::Done => Ok([0, 1, 2].map(|k| spectrum.value(k).map_or(f64::NAN, Real::wide))),
        _ => Ok([f64::NAN; 3]),
    }
}
