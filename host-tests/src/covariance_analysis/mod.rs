//! Covariance analysis of a two-position alignment: a configuration in, P, ξ and η at chosen times out.

mod config;

pub use config::{Config, Constants, Model};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use navsight::covariance::{Covariance15, Observation, Rows};
use navsight::error::Error;
pub use navsight::error_model::N;
use navsight::error_model::{
    discrete, phi, psi, BiasModel, Environment, NoiseDensity, ATT, POS, VEL,
};
use navsight::linalg::Real;
use navsight::observability::diagonal::{xi1, xi1_riccati, xi2};
use navsight::observability::riccati::{DecreaseRate15, Information};
use navsight::observability::spectrum::{Directions, Prior, Progress, Spectrum15};

type Dense<T> = SMatrix<T, N, N>;
type States = SVector<f64, N>;

/// What the analysis says at one time. Arrays are in the states of [`Config`]; what no update or no prior gives is
/// `None`.
#[derive(Clone, Debug, PartialEq)]
pub struct Instant {
    /// Time [s].
    pub t: f64,
    /// Variances.
    pub p: [f64; N],
    /// p(0)/p.
    pub xi2: [Option<f64>; N],
    /// −ṗ/p(0) by the Riccati equation with R·T [1/s].
    pub xi1: [Option<f64>; N],
    /// (p⁻ − p⁺)/(T p(0)) [1/s]; 0 in the gap, where the other rates are those of a measurement that might arrive.
    pub xi1_meas: [Option<f64>; N],
    /// P0⁻¹P.
    pub accuracy: Option<Eigen>,
    /// −P0⁻¹Ṗ [1/s].
    pub speed: Option<Eigen>,
    /// As `speed`, with R·0.1 s in place of R·T: what the paper printed.
    pub speed_paper: Option<Eigen>,
    /// As `xi1`, with R·0.1 s.
    pub xi1_paper: [Option<f64>; N],
}

/// Eigenvalues in ascending order, and the direction of each in σ0 units.
#[derive(Clone, Debug, PartialEq)]
pub struct Eigen {
    /// Eigenvalues.
    pub values: Vec<f64>,
    /// ν_i σ0_i with ν'P0ν = 1; row k belongs to value k.
    pub vectors: Vec<[f64; N]>,
    /// How many values are too close to k to tell its direction from theirs; 1: none but itself.
    pub dimensions: Vec<usize>,
}

/// The interval that the paper took for T in R·T [s].
const PAPER_INTERVAL: f64 = 0.1;
/// Attitude error at the start of a closed-loop run, on each axis [rad].
const START_ERROR: f64 = 0.5 * core::f64::consts::PI / 180.0;
/// Start and end of the turn of case 2 [s], and its rate [rad/s], counter-clockwise.
const TURN: [f64; 2] = [300.0, 302.0];
const TURN_RATE: f64 = core::f64::consts::FRAC_PI_2;

/// Runs `case` (1: one position, 2: turned at 300 s) with the general kernel in `T`, and reports at `times` [s], each
/// a multiple of T, ascending. `tick` is called after each step.
///
/// The filter's states are metres, east and north; those of the configuration are angles, north first. In σ0 units the
/// two differ by an exchange and a sign, so that is all that stands between them.
///
/// # Errors
/// What the kernel refused, and when [s].
pub fn run<T: Real>(
    config: &Config,
    case: u8,
    times: &[f64],
    mut tick: impl FnMut(),
) -> Result<Vec<Instant>, (f64, Error)> {
    let mut run = Run::<T>::new(config, case).map_err(|error| (0.0, error))?;
    let mut instants = Vec::new();
    let mut wanted = times
        .iter()
        .map(|t| (t / config.interval).round() as usize)
        .peekable();
    let mut k = 0;
    while let Some(next) = wanted.peek().copied() {
        k += 1;
        let t = k as f64 * config.interval;
        let at = |error| (t, error);
        let step = run.step(t).map_err(at)?;
        tick();
        while wanted.next_if(|wanted| *wanted <= k).is_some() {
            instants.push(run.report(t, &step).map_err(at)?);
        }
        debug_assert!(next >= k);
    }
    Ok(instants)
}

/// One run: the covariance in σ0 units of the filter's states, and the true error where the loop is closed.
struct Run<'c, T: Real> {
    config: &'c Config,
    case: u8,
    environment: Environment<f64>,
    bias: BiasModel<f64>,
    /// Unit of each filter state.
    unit: States,
    /// Noise density in σ0 units.
    noise: States,
    normalised: u32,
    p0: Covariance15<T>,
    p: Covariance15<T>,
    /// Estimate minus truth (biases: truth minus estimate), in σ0 units.
    error: States,
    /// Φ − I of the last step, and the F it came from.
    last: Option<(Dense<f64>, Dense<f64>)>,
}

/// What one step leaves for the report.
struct Step {
    /// F at the end of the step, in σ0 units.
    f: Dense<f64>,
    /// p⁻ − p⁺; zero where nothing was measured.
    decrease: States,
}

impl<'c, T: Real> Run<'c, T> {
    fn new(config: &'c Config, case: u8) -> Result<Self, Error> {
        let Constants { g, re, wie } = config.constants;
        let lat = config.lat_deg.to_radians();
        let sigma = States::from(config.sigma0);
        // the two angles in metres: which of them is east, and how long a radian is
        let mut unit = sigma;
        match config.model {
            Model::Psi => (unit[0], unit[1]) = (sigma[1] * re, sigma[0] * re),
            Model::Phi => (unit[0], unit[1]) = (sigma[1] * re * lat.cos(), sigma[0] * re),
        }
        let mut normalised = 0;
        for (i, sigma) in unit.iter_mut().enumerate() {
            if *sigma > 0.0 {
                normalised |= 1 << i;
            } else {
                *sigma = 1.0;
            }
        }
        let bias = BiasModel {
            rate_g: config.tau_g.map_or(0.0, |tau| 1.0 / tau),
            rate_a: config.tau_a.map_or(0.0, |tau| 1.0 / tau),
        };
        let three = |first: usize| [sigma[first], sigma[first + 1], sigma[first + 2]];
        let noise = NoiseDensity {
            velocity: config.qv,
            attitude: config.qpsi,
            ..NoiseDensity::zero()
        }
        .with_stationary_biases(&bias, three(9), three(12))
        .diagonal()
        .component_div(&unit.component_mul(&unit));
        let mut p0 = Dense::from_diagonal(&SVector::from_fn(|i, _| {
            T::of(f64::from((normalised >> i) & 1))
        }));
        if config.p0 != "paper" {
            for &(i, j, c) in &config.pairs {
                let c = T::of(c * north_sign(config.model, i) * north_sign(config.model, j));
                let (i, j) = (other(i), other(j));
                p0[(i, j)] = c;
                p0[(j, i)] = c;
            }
        }
        let p0 = Covariance15::from_matrix(&p0)?;
        let mut error = States::zeros();
        for i in ATT..ATT + 3 {
            error[i] = START_ERROR / unit[i];
        }
        Ok(Self {
            config,
            case,
            environment: Environment::sphere(lat, re, g, wie, Vector3::zeros()),
            bias,
            unit,
            noise,
            normalised,
            p0,
            p: p0,
            error,
            last: None,
        })
    }

    /// C_b_n at time t: the identity, turned in case 2.
    fn attitude(&self, t: f64) -> Matrix3<f64> {
        let yaw = if self.case == 2 {
            (t.clamp(TURN[0], TURN[1]) - TURN[0]) * TURN_RATE
        } else {
            0.0
        };
        let (sin, cos) = yaw.sin_cos();
        Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
    }

    /// F in σ0 units about the attitude estimate Ĉ = (I − [ψ×]) C, height damping included.
    fn f_matrix(&self, c_true: &Matrix3<f64>, psi: &Vector3<f64>) -> Dense<f64> {
        let c = c_true - psi.cross_matrix() * c_true;
        let f_b = c_true.transpose() * Vector3::new(0.0, 0.0, self.config.constants.g);
        let build = match self.config.model {
            Model::Psi => psi::f_matrix,
            Model::Phi => phi::f_matrix,
        };
        let mut f = build(&self.environment, &c, &(c * f_b), &self.bias);
        f[(POS + 2, POS + 2)] -= self.config.k1;
        f[(VEL + 2, POS + 2)] -= self.config.k2;
        f.map_with_location(|i, j, x| x * self.unit[j] / self.unit[i])
    }

    /// Φ − I over the step that ends at t, about the estimate or, with ψ = 0, about the truth.
    fn transition(&mut self, t: f64, psi: &Vector3<f64>) -> Dense<f64> {
        let whole = self.config.interval;
        let order = self.config.phi_order;
        let turning = self.case == 2 && t > TURN[0] && t - whole < TURN[1];
        if !turning {
            let f = self.f_matrix(&self.attitude(t - 0.5 * whole), psi);
            return match &self.last {
                Some((last, a)) if *last == f => *a,
                _ => {
                    let a = discrete::phi_minus_identity(&f, whole, order);
                    self.last = Some((f, a));
                    a
                }
            };
        }
        let dt = whole / self.config.sub as f64;
        let mut a = Dense::zeros();
        for part in 0..self.config.sub {
            let mid = t - whole + (part as f64 + 0.5) * dt;
            let f = self.f_matrix(&self.attitude(mid), psi);
            a = discrete::chain(&discrete::phi_minus_identity(&f, dt, order), &a);
        }
        a
    }

    /// Propagates and, unless in the gap, updates.
    fn step(&mut self, t: f64) -> Result<Step, Error> {
        let config = self.config;
        let mut psi = Vector3::zeros();
        if config.closed_loop {
            psi = self
                .error
                .fixed_rows::<3>(ATT)
                .component_mul(&self.unit.fixed_rows::<3>(ATT));
        }
        let a = self.transition(t, &psi);
        if config.closed_loop {
            let truth = self.transition(t, &Vector3::zeros());
            self.error += truth * self.error;
        }
        let q = self.noise * config.interval;
        self.p.propagate(&a.map(T::of), &q.map(T::of));

        let gap = config.gap.map(|gap| TURN[0] + gap);
        let measured = !(self.case == 2 && t > gap[0] && t <= gap[1]);
        let mut decrease = States::zeros();
        if measured {
            decrease += self.update::<3>(VEL, config.r)?;
            if let Some(r) = config.r_height {
                decrease += self.update::<1>(POS + 2, r)?;
            }
        }
        let f = self.f_matrix(&self.attitude(t), &psi);
        Ok(Step { f, decrease })
    }

    /// Measures M states directly; returns p⁻ − p⁺.
    fn update<const M: usize>(&mut self, first: usize, r: f64) -> Result<States, Error> {
        let scaled: [T; M] = core::array::from_fn(|m| T::of(r / self.unit[first + m].powi(2)));
        let rows = Rows {
            nu: core::array::from_fn(|m| T::of(-self.error[first + m])),
            h: Observation::Direct { first },
            r: scaled,
            gate: None,
        };
        let update = self.p.update(&rows)?;
        self.error -= States::from(update.dx.map(T::wide));
        Ok(States::from(update.decrease.map(T::wide)))
    }

    /// The measurement of one update as a rate with R·`interval`: velocity, and height where there is one.
    fn information(&self, interval: f64) -> Information<T, 4, N> {
        let mut h = SMatrix::<T, 4, N>::zeros();
        let mut r_t = [T::one(); 4];
        for (m, state) in [VEL, VEL + 1, VEL + 2, POS + 2].into_iter().enumerate() {
            let r = if m < 3 {
                Some(self.config.r)
            } else {
                self.config.r_height
            };
            if let Some(r) = r {
                h[(m, state)] = -T::one();
                r_t[m] = T::of(r * interval / self.unit[state].powi(2));
            }
        }
        Information {
            h: Observation::Dense(h),
            r_t,
        }
    }

    fn report(&self, t: f64, step: &Step) -> Result<Instant, Error> {
        let interval = self.config.interval;
        let (f, q) = (step.f.map(T::of), self.noise.map(T::of));
        let prior = if self.config.p0 == "paper" {
            Prior::Independent
        } else {
            Prior::Correlated(&self.p0)
        };
        let accuracy = {
            let mut spectrum = Spectrum15::<T, Directions<T, N>>::new();
            spectrum.start_accuracy(&self.p, prior, self.normalised)?;
            self.eigen(&mut spectrum)
        };
        let speed = |interval| {
            let rate = DecreaseRate15::riccati(&self.p, &f, &q, &self.information(interval));
            let mut spectrum = Spectrum15::<T, Directions<T, N>>::new();
            spectrum.start_speed(&rate, prior, self.normalised).ok()?;
            self.eigen(&mut spectrum)
        };
        let riccati = |interval| {
            let information = self.information(interval);
            let index = xi1_riccati(&self.p, &f, &q, Some(&information), self.normalised);
            self.arranged(index.all())
        };
        let decrease: [T; N] = step.decrease.map(T::of).into();
        let p = self.p.diagonal().map(Some);
        let sigma0 = self.config.sigma0;
        let unit = sigma0.map(|sigma| if sigma > 0.0 { sigma } else { 1.0 });
        let fraction = self.arranged(p);
        Ok(Instant {
            t,
            p: core::array::from_fn(|i| fraction[i].unwrap_or(f64::NAN) * unit[i] * unit[i]),
            xi2: self.arranged(xi2(&self.p.diagonal(), self.normalised)?.all()),
            xi1: riccati(interval),
            xi1_meas: self.arranged(xi1(&decrease, T::of(interval), self.normalised)?.all()),
            accuracy,
            speed: speed(interval),
            speed_paper: speed(PAPER_INTERVAL),
            xi1_paper: riccati(PAPER_INTERVAL),
        })
    }

    /// Values per filter state in the order of the configuration.
    fn arranged<X: Real>(&self, x: [Option<X>; N]) -> [Option<f64>; N] {
        core::array::from_fn(|i| x[other(i)].map(X::wide))
    }

    /// All values and directions; `None` when T is too coarse for the matrix.
    fn eigen(&self, spectrum: &mut Spectrum15<T, Directions<T, N>>) -> Option<Eigen> {
        match spectrum.step(u32::MAX) {
            Ok(Progress::Done) => {}
            _ => return None,
        }
        let mut eigen = Eigen {
            values: Vec::new(),
            vectors: Vec::new(),
            dimensions: Vec::new(),
        };
        for k in 0..spectrum.len() {
            let direction = spectrum.direction(k)?;
            eigen.values.push(spectrum.value(k)?.wide());
            eigen.vectors.push(core::array::from_fn(|i| {
                direction.vector[other(i)].wide() * north_sign(self.config.model, i)
            }));
            eigen.dimensions.push(direction.dimension);
        }
        Some(eigen)
    }
}

/// The two level position states change places between the configuration and the filter.
fn other(i: usize) -> usize {
    match i {
        0 => 1,
        1 => 0,
        i => i,
    }
}

/// θx = −δr_N/R; every other state keeps its sign.
fn north_sign(model: Model, i: usize) -> f64 {
    if i == 0 && model == Model::Psi {
        -1.0
    } else {
        1.0
    }
}
