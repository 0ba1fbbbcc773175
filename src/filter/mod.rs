//! The navigator with its 15-state error-state Kalman filter: samples in, solution and its covariance out.
//!
//! One IMU sample costs one mechanization step. The covariance moves when a measurement arrives or a configured
//! interval has passed, with ∫C dt and ∫f dt collected in between. Errors are fed back into the nominal state at every
//! update, so the error state itself is zero between calls and is not stored.
//!
//! | file | holds |
//! |---|---|
//! | `settings` | what the user tells once: noise, limits, how much is known at the start |
//! | `update` | what a measurement does |
//! | `report` | what an update shows from outside |
//! | `source` | gate, counters and lock-out of one source of measurements |
//! | [`late`] | the filter with a memory, for measurements that arrive late |
//! | `room` | working room of propagation and update |
//! | `history`, `past` | that memory, and the way of an error back through it |
//!
//! Every call returns a typed outcome. A refused sample or measurement leaves the filter bit for bit as it was.

mod history;
pub mod late;
mod past;
mod report;
pub(crate) mod ring;
mod room;
mod settings;
mod source;
mod update;

pub use late::LateFilter;
pub use report::UpdateReport;
pub use settings::{Prior, Settings, MAX_STEP};
pub use source::{Aided, Gate, Handling, Source, States};

use crate::covariance::Covariance15;
use crate::error::Error;
use crate::error_model::{block_transition_into, Environment, Interval, Scaling, N};
use crate::imu::ImuIncrement;
use crate::linalg::{each_state, looped_mut, rolled, BlockTransition, Real, Two};
use crate::mechanization::Step;
use crate::nav::NavState;
use nalgebra::SMatrix;

use room::Room;
use update::MAX_MAGNITUDE;

/// The navigator and its filter.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    nav: NavState,
    covariance: Covariance15<f32>,
    scaling: Scaling<f32>,
    sigma0: [f32; N],
    interval: Interval<f32>,
    room: Room,
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
        let mut start = Start::new();
        start.fill(prior, &settings)?;
        Ok(Self::started(&nav, &start, &settings))
    }

    /// [`Filter::new`] in the place of this filter, without room for a second one.
    ///
    /// Errors: those of [`Filter::new`]; the filter is then unchanged.
    pub fn restart(
        &mut self,
        nav: &NavState,
        prior: &Prior,
        settings: &Settings,
    ) -> Result<(), Error> {
        let mut start = Start::new();
        start.fill(prior, settings)?;
        *self = Self::blank(nav, &start, settings);
        self.begin();
        Ok(())
    }

    /// A filter that starts at `nav` with the full covariance `p0` (15×15, SI, state order of [`crate::error_model`]).
    ///
    /// Errors: as [`Filter::new`], and [`Error::NotPositive`] when `p0` is not symmetric positive semi-definite.
    pub fn with_covariance(
        nav: NavState,
        p0: &SMatrix<f32, N, N>,
        settings: Settings,
    ) -> Result<Self, Error> {
        Self::correlated(&nav, &settings, |i, j| {
            p0.get((i, j)).copied().unwrap_or_default()
        })
    }

    /// [`Filter::with_covariance`] of the matrix with these elements.
    #[inline(always)]
    pub(crate) fn correlated(
        nav: &NavState,
        settings: &Settings,
        p0: impl Fn(usize, usize) -> f32,
    ) -> Result<Self, Error> {
        let mut start = Start::new();
        for (i, sigma) in start.unit.iter_mut().enumerate() {
            let var = p0(i, i);
            if !var.finite() {
                return Err(Error::NonFinite);
            }
            if var < 0.0 {
                return Err(Error::OutOfRange);
            }
            *sigma = libm::sqrtf(var);
        }
        start.normalise();
        let correlation = |i: usize, j: usize| {
            let unit = |i: usize| start.unit.get(i).copied().unwrap_or(1.0);
            if i == j {
                // exactly one, whatever the root rounded to: ξ2 must start at 1
                f32::from(start.normalised >> i & 1)
            } else {
                p0(i, j) / unit(j) / unit(i)
            }
        };
        Covariance15::check(&correlation)?;
        settings.check()?;
        Ok(Self::with(nav, &start, settings, &correlation))
    }

    /// [`Filter::new`] of what has been checked.
    #[inline(always)]
    fn started(nav: &NavState, start: &Start, settings: &Settings) -> Self {
        let scaling = Scaling::of(&start.unit, &settings.bias, &settings.noise);
        Self {
            scaling,
            ..Self::blank(nav, start, settings)
        }
    }

    /// With these correlations.
    #[inline(never)]
    fn with(
        nav: &NavState,
        start: &Start,
        settings: &Settings,
        correlation: &impl Fn(usize, usize) -> f32,
    ) -> Self {
        Self {
            covariance: Covariance15::of(correlation),
            scaling: Scaling::of(&start.unit, &settings.bias, &settings.noise),
            ..Self::blank(nav, start, settings)
        }
    }

    /// A filter that is still to [begin](Filter::begin). Spelled out, and no reference to the whole of it taken: so that it
    /// is written where it is wanted, and not somewhere else and moved.
    #[inline(always)]
    pub(crate) fn blank(nav: &NavState, start: &Start, settings: &Settings) -> Self {
        let mut covariance = Covariance15::zero();
        macro_rules! one {
            ($i:literal) => {
                covariance.set_variance($i, start.variance[$i]);
            };
        }
        each_state!(one);
        Self {
            nav: *nav,
            covariance,
            scaling: Scaling::blank(&settings.bias),
            sigma0: start.unit,
            interval: Interval::empty(),
            room: Room::Transition(BlockTransition::identity()),
            settings: *settings,
            time: Two { hi: 0.0, lo: 0.0 },
            normalised: start.normalised,
            considered: 0,
        }
    }

    /// What a filter of [`Filter::blank`] still lacks.
    #[inline(always)]
    pub(crate) fn begin(&mut self) {
        self.scaling.fill(&self.sigma0, &self.settings.noise);
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
        if self.interval.dt <= 0.0 {
            return;
        }
        for _ in 0..self.form_transition() {
            let transition = self.room.transition();
            self.covariance.propagate_blocks(transition);
            watch(transition);
        }
        self.interval = Interval::default();
    }

    /// The transition of one of the equal parts that the interval is divided into; returns how many there are. For itself:
    /// what it puts on the stack does not lie below the propagation.
    #[inline(never)]
    fn form_transition(&mut self) -> u8 {
        let total = self.interval.dt;
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
        let transition = self.room.transition();
        block_transition_into(&environment, &self.interval, &self.scaling, transition);
        parts
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

/// What a filter starts with, checked.
pub(crate) struct Start {
    /// Of each state.
    unit: [f32; N],
    /// Of each state, in its unit: 1, or 0 where nothing is to be learnt.
    variance: [f32; N],
    /// The same as bits.
    normalised: u16,
}

impl Start {
    /// Room for one.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        Self {
            unit: [0.0; N],
            variance: [0.0; N],
            normalised: 0,
        }
    }

    /// Refuses what [`Filter::new`] refuses.
    #[inline(never)]
    pub(crate) fn fill(&mut self, prior: &Prior, settings: &Settings) -> Result<(), Error> {
        prior.sigma0_into(&mut self.unit)?;
        self.normalise();
        settings.check()
    }

    /// From standard deviations to units.
    #[inline(always)]
    fn normalise(&mut self) {
        let states = looped_mut(&mut self.unit)
            .iter_mut()
            .zip(&mut self.variance);
        for (i, (unit, variance)) in states.enumerate() {
            rolled();
            if *unit > 0.0 {
                *variance = 1.0;
                self.normalised |= 1 << i;
            } else {
                *unit = 1.0;
            }
        }
    }
}

/// Nobody looks on.
fn unwatched(_: &BlockTransition<f32>) {}
