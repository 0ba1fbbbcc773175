//! The navigator with its 15-state error-state Kalman filter: samples in, solution and its covariance out.
//!
//! One IMU sample costs one mechanization step. The covariance moves when a measurement arrives or a configured
//! interval has passed, with ∫C dt and ∫f dt collected in between. Errors are fed back into the nominal state at every
//! update, so the error state itself is zero between calls and is not stored.
//!
//! | file | holds |
//! |---|---|
//! | `settings` | what the user tells once: noise, limits, how much is known at the start |
//! | `report` | what an update shows from outside |
//! | `source` | gate, counters and lock-out of one source of measurements |
//! | [`late`] | the filter with a memory, for measurements that arrive late |
//! | `history`, `past` | that memory, and the way of an error back through it |
//!
//! Every call returns a typed outcome. A refused sample or measurement leaves the filter bit for bit as it was.

mod history;
pub mod late;
mod past;
mod report;
pub(crate) mod ring;
mod settings;
mod source;

pub use late::LateFilter;
pub use report::UpdateReport;
pub use settings::{Prior, Settings, MAX_STEP};
pub use source::{Aided, Gate, Handling, Source, States};

use crate::covariance::{each_row, Covariance15, Lines, Pattern, Slots};
use crate::error::Error;
use crate::error_model::{block_transition_into, Environment, Interval, Scaling, N, POS, VEL};
use crate::imu::ImuIncrement;
use crate::linalg::{looped, looped_mut, BlockTransition, Real, Two};
use crate::measurement::{AntennaRows, Jacobian, Linearized};
use crate::mechanization::Step;
use crate::nav::NavState;
use nalgebra::SMatrix;

/// Largest |ν| [unit of z] and |h| that a measurement may hold: far beyond any sensor, and small enough for the squares
/// and products of the update to stay inside f32.
const MAX_MAGNITUDE: f32 = 1e9;
/// Largest noise variance that a measurement may hold: a standard deviation of the same size.
const MAX_VARIANCE: f32 = MAX_MAGNITUDE * MAX_MAGNITUDE;

/// The state that a height measures.
const HEIGHT: usize = POS + 2;

/// The navigator and its filter.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    nav: NavState,
    covariance: Covariance15<f32>,
    scaling: Scaling<f32>,
    sigma0: [f32; N],
    interval: Interval<f32>,
    /// Of the last propagation; room for the next, which the stack need not have.
    transition: BlockTransition<f32>,
    settings: Settings,
    time: Two,
    normalised: u16,
    considered: u16,
}

impl Filter {
    /// A filter that starts at `nav`, known as well as `prior` says, its states uncorrelated.
    ///
    /// Errors: [`Error::NonFinite`], [`Error::OutOfRange`] for a prior or a setting that cannot be.
    pub fn new(nav: NavState, prior: &Prior, settings: Settings) -> Result<Self, Error> {
        let sigma0 = prior.sigma0()?;
        let mut unit = sigma0;
        for p in looped_mut(&mut unit) {
            *p = if *p > 0.0 { 1.0 } else { 0.0 };
        }
        Self::start(nav, sigma0, Covariance15::from_diagonal(&unit)?, settings)
    }

    /// A filter that starts at `nav` with the full covariance `p0` (15×15, SI, state order of [`crate::error_model`]).
    ///
    /// Errors: as [`Filter::new`], and [`Error::NotPositive`] when `p0` is not symmetric positive semi-definite.
    pub fn with_covariance(
        nav: NavState,
        p0: &SMatrix<f32, N, N>,
        settings: Settings,
    ) -> Result<Self, Error> {
        let mut sigma0 = [0.0; N];
        for (sigma, &var) in sigma0.iter_mut().zip(p0.diagonal().iter()) {
            if !var.finite() {
                return Err(Error::NonFinite);
            }
            if var < 0.0 {
                return Err(Error::OutOfRange);
            }
            *sigma = libm::sqrtf(var);
        }
        let unit = sigma0.map(unit_of);
        let mut correlation = *p0;
        for (mut column, &u) in correlation.column_iter_mut().zip(&unit) {
            for (x, &v) in column.iter_mut().zip(&unit) {
                *x = *x / u / v;
            }
        }
        for (i, &sigma) in sigma0.iter().enumerate() {
            // exactly one, whatever the root rounded to: ξ2 must start at 1
            if let Some(x) = correlation.get_mut((i, i)) {
                *x = if sigma > 0.0 { 1.0 } else { 0.0 };
            }
        }
        Self::start(
            nav,
            sigma0,
            Covariance15::from_matrix(&correlation)?,
            settings,
        )
    }

    fn start(
        nav: NavState,
        sigma0: [f32; N],
        covariance: Covariance15<f32>,
        settings: Settings,
    ) -> Result<Self, Error> {
        settings.check()?;
        let scaling = Scaling::new(&sigma0, &settings.bias, &settings.noise)?;
        let mut normalised = 0;
        for (i, &sigma) in looped(&sigma0).iter().enumerate() {
            normalised |= u16::from(sigma > 0.0) << i;
        }
        let mut unit = sigma0;
        for unit in looped_mut(&mut unit) {
            *unit = unit_of(*unit);
        }
        Ok(Self {
            nav,
            covariance,
            scaling,
            sigma0: unit,
            interval: Interval::default(),
            transition: BlockTransition::identity(),
            settings,
            time: Two::of(0.0),
            normalised,
            considered: 0,
        })
    }

    /// Takes one IMU sample: the nominal state advances, and the covariance with it once enough time has gathered.
    ///
    /// Errors: [`Error::NonFinite`], [`Error::OutOfRange`], [`Error::Time`], [`Error::Polar`] from the door of the
    /// mechanization; the filter is then unchanged.
    pub fn propagate(&mut self, imu: &ImuIncrement) -> Result<(), Error> {
        self.propagate_watched(imu, unwatched)
    }

    /// [`Filter::propagate`], and `watch` sees every transition by which the covariance moves: A = Φ − I and Q in σ0
    /// units, for what accumulates beside the filter ([`crate::observability::ceiling::Gramian`]).
    ///
    /// Errors: as [`Filter::propagate`].
    pub fn propagate_watched(
        &mut self,
        imu: &ImuIncrement,
        watch: impl FnMut(&BlockTransition<f32>),
    ) -> Result<(), Error> {
        self.advance(imu, watch).map(|_| ())
    }

    /// As [`Filter::propagate_watched`], and what the sample did.
    #[inline(always)]
    fn advance(
        &mut self,
        imu: &ImuIncrement,
        watch: impl FnMut(&BlockTransition<f32>),
    ) -> Result<Step, Error> {
        let step = self.nav.advance_within(imu, &self.settings.limits)?;
        self.interval.add(&step.c_b_n, &step.delta_v_n, step.dt);
        self.time.add(step.dt);
        // Half a sample early rather than half a sample late, whatever the rounding of the sum.
        if self.interval.dt + 0.5 * step.dt >= self.settings.propagation_interval {
            self.synchronize_watched(watch);
        }
        Ok(step)
    }

    /// Brings the covariance to the time of the last sample.
    ///
    /// Calls of [`Filter::update`] do this by themselves; a log that wants σ between updates calls it first.
    pub fn synchronize(&mut self) {
        self.synchronize_watched(unwatched);
    }

    /// [`Filter::synchronize`], and `watch` sees the transitions. Called before [`Filter::update`], it leaves that nothing
    /// to bring up to date.
    #[inline(never)]
    pub fn synchronize_watched(&mut self, mut watch: impl FnMut(&BlockTransition<f32>)) {
        let total = self.interval.dt;
        if total <= 0.0 {
            return;
        }
        let environment = self.environment();
        let mut parts = 1u8;
        while total > f32::from(parts) * (1.5 * MAX_STEP) && parts < u8::MAX {
            parts += 1;
        }
        if parts > 1 {
            let share = 1.0 / f32::from(parts);
            self.interval.c_dt *= share;
            self.interval.f_dt *= share;
            self.interval.dt *= share;
        }
        let transition = &mut self.transition;
        block_transition_into(&environment, &self.interval, &self.scaling, transition);
        for _ in 0..parts {
            self.covariance.propagate_blocks(transition);
            watch(transition);
        }
        self.interval = Interval::default();
    }

    /// Uses one measurement of M rows: gates it, corrects the nominal state, and reports what happened.
    ///
    /// Rows beyond their gate are reported and not used.
    ///
    /// Errors: [`Error::NonFinite`] and [`Error::OutOfRange`] for a measurement that cannot be, the filter then bit for
    /// bit as it was. [`Error::OutOfRange`] and [`Error::Polar`] for a correction that the nominal state does not accept,
    /// [`Error::InnovationVariance`] and [`Error::Variance`] when the covariance itself is broken, which a reset must
    /// answer: estimate and covariance are then those of the present, without this measurement.
    #[inline(always)]
    pub fn update<const M: usize>(
        &mut self,
        measurement: &Linearized<M>,
    ) -> Result<UpdateReport<M>, Error> {
        let mut report = UpdateReport::empty();
        self.update_into(measurement, &mut report)?;
        Ok(report)
    }

    /// As [`Filter::update`], with the report written where the caller has room for it: a copy and its stack less. After
    /// an error the report may hold anything.
    ///
    /// Errors: those of [`Filter::update`].
    #[inline(always)]
    pub fn update_into<const M: usize>(
        &mut self,
        measurement: &Linearized<M>,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        self.update_gated(measurement, self.settings.gate, report)
    }

    /// As [`Filter::update_into`] with this gate.
    ///
    /// The kind of the rows is looked at where the measurement was linearised: of a program that only has velocities
    /// nothing else is linked.
    #[inline(always)]
    fn update_gated<const M: usize>(
        &mut self,
        measurement: &Linearized<M>,
        gate: Option<f32>,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        let mut given = Given {
            nu: measurement.nu.data.0[0],
            r: measurement.r.data.0[0],
            interval: measurement.interval,
            gate,
        };
        match &measurement.h {
            Jacobian::Direct { first: HEIGHT } if M == 1 => {
                self.update_states::<M, HEIGHT>(&mut given, report)
            }
            Jacobian::Direct { first: VEL } if M == 3 => {
                self.update_states::<M, VEL>(&mut given, report)
            }
            Jacobian::Antenna(rows) if M == 6 => self.update_antenna(&mut given, rows, report),
            Jacobian::Antenna(rows) => {
                let h = Jacobian::Dense(rows.dense());
                self.update_any(&mut given, &h, report)
            }
            h => self.update_any(&mut given, h, report),
        }
    }

    /// The six rows of position and velocity of an antenna; M is 6.
    #[inline(never)]
    fn update_antenna<const M: usize>(
        &mut self,
        given: &mut Given<M>,
        rows: &AntennaRows,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        given.check()?;
        if !rows.within(MAX_MAGNITUDE) {
            return Err(Error::OutOfRange);
        }
        let mut unit = [1.0; M];
        each_row!(m; unit[m] = self.sigma0[POS + m]);
        given.scale(&unit, report)?;
        self.synchronize();
        let lines = Lines {
            nu: &given.nu,
            r: &given.r,
            gate: given.gate,
            h: Pattern::Direct { first: POS },
        };
        let (nav, sigma0) = (&mut self.nav, &self.sigma0);
        let mut accept = |dx: &[f32; N]| nav.correct_in_units(dx, sigma0);
        let mut slots = report.slots();
        let p = &mut self.covariance;
        let considered = u32::from(self.considered);
        let six = rows.in_units(sigma0);
        if considered != 0 || !p.update_six(&six, &lines, &mut slots, &mut accept)? {
            update_in_full(p, rows, sigma0, &lines, considered, &mut slots, &mut accept)?;
        }
        each_row!(m; {
            let unit = self.sigma0[POS + m];
            report.s[m] *= unit * unit;
        });
        report.normalised = self.normalised;
        report.interval = given.interval;
        Ok(())
    }

    /// Rows that are −1 on the states from FIRST on.
    #[inline(never)]
    fn update_states<const M: usize, const FIRST: usize>(
        &mut self,
        given: &mut Given<M>,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        given.check()?;
        let mut unit = [1.0; M];
        each_row!(m; unit[m] = self.sigma0[FIRST + m]);
        given.scale(&unit, report)?;
        self.synchronize();
        let lines = Lines {
            nu: &given.nu,
            r: &given.r,
            gate: given.gate,
            h: Pattern::Direct { first: FIRST },
        };
        let (nav, sigma0) = (&mut self.nav, &self.sigma0);
        let mut accept = |dx: &[f32; N]| nav.correct_in_units(dx, sigma0);
        let mut slots = report.slots();
        let considered = u32::from(self.considered);
        self.covariance
            .update_states::<M, FIRST>(&lines, considered, &mut slots, &mut accept)?;
        each_row!(m; {
            let unit = self.sigma0[FIRST + m];
            report.s[m] *= unit * unit;
        });
        report.normalised = self.normalised;
        report.interval = given.interval;
        Ok(())
    }

    /// Rows of any kind.
    #[inline(never)]
    fn update_any<const M: usize>(
        &mut self,
        given: &mut Given<M>,
        h: &Jacobian<M>,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        given.check()?;
        check_rows(h)?;
        let mut unit = [1.0; M];
        if let Jacobian::Direct { first } = h {
            for (u, &sigma) in unit.iter_mut().zip(self.sigma0.iter().skip(*first)) {
                *u = sigma;
            }
        }
        given.scale(&unit, report)?;
        self.synchronize();
        let lines = Lines {
            nu: &given.nu,
            r: &given.r,
            gate: given.gate,
            h: match h {
                Jacobian::Direct { first } => Pattern::Direct { first: *first },
                Jacobian::Dense(h) => Pattern::Dense {
                    h,
                    unit: &self.sigma0,
                },
                Jacobian::Antenna(_) => return Err(Error::OutOfRange), // never: made dense by the caller
            },
        };
        let (nav, sigma0) = (&mut self.nav, &self.sigma0);
        let mut accept = |dx: &[f32; N]| nav.correct_in_units(dx, sigma0);
        let mut slots = report.slots();
        let considered = u32::from(self.considered);
        self.covariance
            .update_any(&lines, considered, &mut slots, &mut accept)?;
        each_row!(m; report.s[m] *= unit[m] * unit[m]);
        report.normalised = self.normalised;
        report.interval = given.interval;
        Ok(())
    }

    /// Forgets what is known of some states: each becomes independent of all others, with a standard deviation of
    /// `sigma` (in the unit of the state) or its present one, whichever is larger.
    ///
    /// What a source of measurements does after its lock-out; also for a caller who knows that a state has jumped.
    ///
    /// # Errors
    /// [`Error::NonFinite`], [`Error::OutOfRange`] for a σ that cannot be; nothing has changed then.
    pub fn open(&mut self, states: States, sigma: f32) -> Result<(), Error> {
        if !sigma.finite() {
            return Err(Error::NonFinite);
        }
        if !(0.0..=MAX_MAGNITUDE).contains(&sigma) {
            return Err(Error::OutOfRange);
        }
        self.synchronize();
        for (i, &unit) in self.sigma0.iter().enumerate() {
            if states.has(i) {
                let wanted = sigma / unit;
                let variance = (wanted * wanted).max(self.covariance.variance(i));
                self.covariance.isolate(i, variance)?;
            }
        }
        Ok(())
    }

    /// From now on the updates leave the states alone of which a bit is set (bit i: state i; 0, as at the start, for none):
    /// their estimates do not move, their variances are not reduced, and their correlations with the others stay honest
    /// (Schmidt update, [`Covariance15::update_considering`]). Propagation goes on as ever.
    ///
    /// For states that cannot be seen just now; the gate of the alignment room decides which.
    pub fn consider(&mut self, states: u16) {
        self.considered = states & ((1 << N) - 1);
    }

    /// The states that updates leave alone, as bits.
    pub fn considered(&self) -> u16 {
        self.considered
    }

    /// What the error model needs to know about the earth where the vehicle is.
    pub fn environment(&self) -> Environment<f32> {
        Environment::from_local(&self.nav.local(), &self.nav.v_n())
    }

    /// The navigation solution.
    pub fn nav(&self) -> &NavState {
        &self.nav
    }

    /// Standard deviation of a state, SI; None beyond the last state or when its variance is not a number ≥ 0.
    pub fn sigma(&self, state: usize) -> Option<f32> {
        let p = self.covariance.variance(state);
        let sigma0 = self.sigma0.get(state)?;
        (p >= 0.0).then(|| libm::sqrtf(p) * sigma0)
    }

    /// The covariance in σ0 units: element (i, j) times σ0ᵢ σ0ⱼ is SI.
    pub fn covariance(&self) -> &Covariance15<f32> {
        &self.covariance
    }

    /// The unit of each state: its standard deviation at the start, 1 where that was zero.
    pub fn sigma0(&self) -> &[f32; N] {
        &self.sigma0
    }

    /// Settings that the filter was started with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The error-model coefficients in σ0 units, for metrics that need F.
    pub fn scaling(&self) -> &Scaling<f32> {
        &self.scaling
    }

    /// Seconds of samples taken so far.
    pub fn time(&self) -> f64 {
        self.time.wide()
    }
}

/// Nobody looks on.
fn unwatched(_: &BlockTransition<f32>) {}

/// Unit of a state that started with this standard deviation.
fn unit_of(sigma: f32) -> f32 {
    if sigma > 0.0 {
        sigma
    } else {
        1.0
    }
}

/// The careful update by the rows of an antenna in full, each in the unit of the state it is −1 on.
#[cold]
#[inline(never)]
fn update_in_full<const M: usize>(
    p: &mut Covariance15<f32>,
    rows: &AntennaRows,
    sigma0: &[f32; N],
    lines: &Lines<'_, f32, M, N>,
    considered: u32,
    out: &mut Slots<'_, f32, M, N>,
    accept: &mut dyn FnMut(&[f32; N]) -> Result<(), Error>,
) -> Result<(), Error> {
    let mut h = rows.dense::<M>();
    for (mut row, unit) in h.row_iter_mut().zip(sigma0.iter().skip(POS)) {
        row /= *unit;
    }
    p.update_dense_carefully(lines, &h, sigma0, considered, out, accept)
}

/// The numbers of a measurement, without its rows.
struct Given<const M: usize> {
    nu: [f32; M],
    r: [f32; M],
    interval: f32,
    gate: Option<f32>,
}

impl<const M: usize> Given<M> {
    /// Refuses what no sensor can have sent.
    #[inline(always)]
    fn check(&self) -> Result<(), Error> {
        let mut good = self.interval.finite();
        each_row!(m; {
            good &= self.nu[m].abs() <= MAX_MAGNITUDE;
            good &= (f32::MIN_POSITIVE..=MAX_VARIANCE).contains(&self.r[m]);
        });
        if good {
            Ok(())
        } else {
            Err(refused(self.interval, &self.nu, &self.r))
        }
    }

    /// Innovations and variances to the unit of each row, and the innovations as they are into the report.
    #[inline(always)]
    fn scale(&mut self, unit: &[f32; M], report: &mut UpdateReport<M>) -> Result<(), Error> {
        let mut sum = 0.0;
        each_row!(m; {
            report.nu[m] = self.nu[m];
            self.nu[m] /= unit[m];
            self.r[m] /= unit[m] * unit[m];
            sum += (self.nu[m] + self.r[m]) * 0.0; // NaN where one is not finite
        });
        if sum.finite() {
            Ok(())
        } else {
            Err(Error::OutOfRange)
        }
    }
}

/// Why a measurement is refused that is not as it should be.
#[cold]
#[inline(never)]
fn refused(interval: f32, nu: &[f32], r: &[f32]) -> Error {
    if !interval.finite() {
        return Error::NonFinite;
    }
    let nu = nu.iter().map(|x| within(*x, -MAX_MAGNITUDE, MAX_MAGNITUDE));
    let r = r
        .iter()
        .map(|x| within(*x, f32::MIN_POSITIVE, MAX_VARIANCE));
    nu.chain(r)
        .find_map(Result::err)
        .unwrap_or(Error::OutOfRange)
}

/// Refuses rows that no measurement can have.
fn check_rows<const M: usize>(h: &Jacobian<M>) -> Result<(), Error> {
    match h {
        Jacobian::Direct { first } if *first > N || M > N - *first => Err(Error::OutOfRange),
        Jacobian::Direct { .. } | Jacobian::Antenna(_) => Ok(()),
        Jacobian::Dense(h) => {
            // at a glance; written as what is good: a NaN fails
            let columns = h.data.0.as_flattened().iter();
            let size = columns.fold(0.0, |sum: f32, h| sum + h.abs());
            if size <= MAX_MAGNITUDE {
                return Ok(());
            }
            h.iter()
                .try_for_each(|&h| within(h, -MAX_MAGNITUDE, MAX_MAGNITUDE))
        }
    }
}

/// Refuses numbers outside `low` … `high`.
fn within(x: f32, low: f32, high: f32) -> Result<(), Error> {
    if !x.finite() {
        Err(Error::NonFinite)
    } else if (low..=high).contains(&x) {
        Ok(())
    } else {
        Err(Error::OutOfRange)
    }
}
