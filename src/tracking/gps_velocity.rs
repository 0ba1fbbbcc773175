//! Tracking by satellite positions and velocities: the filter of Fang 1998, one axis or three.
//!
//! Positions are metres in a local frame, its axes east, north, up or any others: keep its origin within some 100 km.
//! Position, velocity and both are taken, at any interval, with any channel missing.
//!
//! # What it cannot know
//!
//! The filter believes that noise is white. A constant velocity error b becomes a position error of about b/k₁₁, k₁₁
//! being the gain of position by position (1 cm/s: 10 m, where σ is 100 m, 0.1 m/s and the interval 1 s), and a
//! position error that lasts longer than the filter averages is not averaged: of 95 m over 300 s it keeps half, while
//! its σ says 3 m. Then give the position a larger σ, or a lower bound to what σ is believed.

use super::current_model::{CurrentModel, Transition};
use super::fix::{Fix, Noise, Reading};
use crate::covariance::{Chain, Covariance, Lines, Observation, Pattern, Slots, Sums};
use crate::error::Error;
use crate::linalg::{two_add, Real};
use crate::observability::riccati::Information;
use nalgebra::{SMatrix, SVector};

/// Position, velocity and acceleration of every axis: an estimate, or standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics<T, const AXES: usize> {
    /// [m]
    pub position: [T; AXES],
    /// [m/s]
    pub velocity: [T; AXES],
    /// [m/s²]
    pub acceleration: [T; AXES],
}

/// What a tracker is set to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings<T> {
    /// Motion of each axis.
    pub model: CurrentModel<T>,
    /// Largest ν²/s that a channel may have: χ² with one degree (10.8 is passed by 99.9 %); `None` accepts all.
    pub gate: Option<T>,
    /// A channel that fails its gate this many times in a row is believed, from that reading on until one passes
    /// again: the vehicle does what the model did not expect. 0 never believes it, and such a filter can lock out its
    /// measurements for good.
    pub believe_after: u8,
    /// Longest interval [s] to be predicted over; beyond it a restart is the honest answer.
    pub longest: T,
}

impl<T: Real> Settings<T> {
    /// A motion model with the gate at 99.99 %, the third outlier in a row believed, intervals up to a minute.
    pub fn new(model: CurrentModel<T>) -> Self {
        Self {
            model,
            gate: Some(T::of(15.1)),
            believe_after: 3,
            longest: T::of(60.0),
        }
    }

    fn check(&self) -> Result<(), Error> {
        self.model.check()?;
        let gate = self.gate.unwrap_or_else(T::one);
        if !gate.finite() || !self.longest.finite() {
            return Err(Error::NonFinite);
        }
        let fits = gate > T::zero() && self.longest > T::zero();
        fits.then_some(()).ok_or(Error::OutOfRange)
    }
}

/// What became of one channel of a fix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// Not in the fix.
    Missing,
    /// Inside its gate, and used.
    Used,
    /// Outside its gate, and not used.
    Rejected,
    /// Outside its gate once too often, and used.
    Believed,
}

impl Outcome {
    /// Whether the filter learned from it.
    pub fn used(self) -> bool {
        matches!(self, Self::Used | Self::Believed)
    }
}

/// What one fix did. Channels: position of each axis, then velocity of each axis; states in σ0 units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report<T, const AXES: usize, const N: usize> {
    /// Innovation z − x̂ of position [m] and velocity [m/s]; 0 where the channel is missing.
    pub nu: [[T; AXES]; 2],
    /// Its variance P + R before the fix [m², m²/s²]; 0 where the channel is missing.
    pub s: [[T; AXES]; 2],
    /// What became of it.
    pub outcome: [[Outcome; AXES]; 2],
    /// Normalised innovation squared of all used channels together: χ² with [`Report::used`] degrees.
    pub nis: T,
    /// p⁻ − p⁺ of each state.
    pub decrease: [T; N],
    /// Variances before.
    pub p_before: [T; N],
    /// Variances after.
    pub p_after: [T; N],
    /// ∂ν/∂δx of the uncorrelated rows that were used, a row per channel in units of its σ0; 0 where none was.
    pub h: SMatrix<T, N, N>,
    /// Noise variance of each row of `h`; 1 where none was used.
    pub r: [T; N],
}

impl<T: Real, const AXES: usize, const N: usize> Report<T, AXES, N> {
    /// Room for a report ([`Tracker::update_into`]); what it holds before means nothing.
    #[must_use]
    pub fn empty() -> Self {
        let zero = const { [[T::ZERO; AXES]; 2] };
        Self {
            nu: zero,
            s: zero,
            outcome: [[Outcome::Missing; AXES]; 2],
            nis: T::zero(),
            decrease: const { [T::ZERO; N] },
            p_before: const { [T::ZERO; N] },
            p_after: const { [T::ZERO; N] },
            h: SMatrix::zeros(),
            r: [T::one(); N],
        }
    }

    /// Of a channel that is used.
    fn innovation(&self, kind: usize, axis: usize) -> Option<T> {
        let used = self.outcome.get(kind)?.get(axis)?.used();
        let nu = self.nu.get(kind)?.get(axis)?;
        used.then_some(*nu)
    }

    /// Number of channels used.
    pub fn used(&self) -> usize {
        self.outcome.iter().flatten().filter(|o| o.used()).count()
    }

    /// What the used rows know per second when a fix like this one comes every `interval` [s], for
    /// [`crate::observability`]; `None` when the interval is unknown (≤ 0 or not finite).
    pub fn information(&self, interval: T) -> Option<Information<T, N, N>> {
        (interval > T::zero() && interval.finite()).then(|| Information {
            h: Observation::Dense(self.h),
            r_t: self.r.map(|r| r * interval),
        })
    }
}

/// The continuous model in σ0 units, for metrics that need it: ẋ = F x, noise density Q.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates<T, const N: usize> {
    /// F [1/s].
    pub f: SMatrix<T, N, N>,
    /// Diagonal of the noise density [1/s].
    pub q: SVector<T, N>,
}

/// The tracker: N = 3·AXES states, position of each axis, then velocity, then acceleration; L = N(N+1)/2.
///
/// Three axes are one filter, so that a receiver's correlated noise is used as it is; without correlation the axes
/// stay exactly independent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracker<T, const AXES: usize, const N: usize, const L: usize> {
    /// Estimate, two words each.
    x: [(T, T); N],
    /// σ0 of each state, its unit in the covariance.
    unit: [T; N],
    covariance: Covariance<T, N, L>,
    settings: Settings<T>,
    transition: Option<Transition<T>>,
    /// σ² of each axis in the last prediction; before the first, what it would be.
    sigma2: [T; AXES],
    /// How often in a row each channel failed its gate.
    failed: [[u8; AXES]; 2],
}

/// One axis.
pub type AxisTracker<T> = Tracker<T, 1, 3, 6>;
/// Three axes of a local frame, east, north, up.
pub type LocalTracker<T> = Tracker<T, 3, 9, 45>;

/// Element of an array that is known to be there.
#[inline(always)]
fn at<T: Real>(array: &[T], i: usize) -> T {
    array.get(i).copied().unwrap_or_else(T::zero)
}

#[inline(always)]
fn set<T, const N: usize>(m: &mut SMatrix<T, N, N>, i: usize, j: usize, x: T) {
    if let Some(e) = m.get_mut((i, j)) {
        *e = x;
    }
}

impl<T: Real, const AXES: usize, const N: usize, const L: usize> Tracker<T, AXES, N, L> {
    const SHAPE: () = assert!(AXES > 0 && N == 3 * AXES, "N must be 3·AXES");
    /// All states have a prior: the `normalised` of [`crate::observability`].
    pub const NORMALISED: u32 = (1 << N) - 1;

    /// A tracker that starts at `state`, each component known to within `sigma` (1σ, above 0) and uncorrelated.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] for a σ that is not positive or a setting that cannot be.
    pub fn new(
        state: &Kinematics<T, AXES>,
        sigma: &Kinematics<T, AXES>,
        settings: Settings<T>,
    ) -> Result<Self, Error> {
        const { Self::SHAPE };
        settings.check()?;
        let (x, unit) = (flat::<T, AXES, N>(state), flat::<T, AXES, N>(sigma));
        if x.iter().chain(&unit).any(|x| !x.finite()) {
            return Err(Error::NonFinite);
        }
        if unit.iter().any(|sigma| *sigma <= T::zero()) {
            return Err(Error::OutOfRange);
        }
        Ok(Self {
            x: x.map(|x| (x, T::zero())),
            unit,
            covariance: Covariance::from_diagonal(&[T::one(); N])?,
            settings,
            transition: None,
            sigma2: state.acceleration.map(|a| settings.model.sigma2(a)),
            failed: [[0; AXES]; 2],
        })
    }

    /// Predicts over `dt` [s].
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::Time`] when `dt` is not positive or longer than the longest interval;
    /// [`Error::OutOfRange`] when it is too short for the scalar or the estimate left its range. The tracker is then
    /// unchanged.
    pub fn predict(&mut self, dt: T) -> Result<(), Error> {
        if !dt.finite() {
            return Err(Error::NonFinite);
        }
        if dt <= T::zero() || dt > self.settings.longest {
            return Err(Error::Time);
        }
        let model = &self.settings.model;
        let over = match self.transition {
            Some(t) if t.dt == dt => t,
            _ => Transition::new(dt, model.tau)?,
        };
        let mut moved = const { [[(T::ZERO, T::ZERO); 3]; AXES] };
        let mut sigma2 = self.sigma2;
        let mut chains = const {
            [Chain {
                a: [T::ZERO; 4],
                q: [T::ZERO; 6],
            }; AXES]
        };
        let [phi_p, phi_v, phi_a] = over.phi;
        let mut finite = true;
        let axes = moved.iter_mut().zip(&mut sigma2).zip(&mut chains);
        for (axis, ((moved, sigma2), chain)) in axes.enumerate() {
            let x = |kind: usize| match self.x.get(kind * AXES + axis) {
                Some(x) => *x,
                None => (T::ZERO, T::ZERO),
            };
            let (p, v, acc) = (x(0), x(1), x(2));
            let [gain_p, gain_v, gain_a] = model.gain(&over, acc.0);
            *sigma2 = model.sigma2(acc.0 + gain_a);
            *moved = [
                two_add(p.0, p.1, dt * v.0 + gain_p),
                two_add(v.0, v.1, gain_v),
                two_add(acc.0, acc.1, gain_a),
            ];
            let [p, v, acc] = moved;
            finite &= p.0.finite() & v.0.finite() & acc.0.finite();
            let unit = |kind: usize| at(&self.unit, kind * AXES + axis);
            let (unit_p, unit_v, unit_a) = (unit(0), unit(1), unit(2));
            chain.a = [
                dt * unit_v / unit_p,
                phi_p * unit_a / unit_p,
                phi_v * unit_a / unit_v,
                phi_a,
            ];
            let [q11, q12, q13, q22, q23, q33] = over.noise(*sigma2);
            chain.q = [
                q11 / unit_p / unit_p,
                q12 / unit_p / unit_v,
                q13 / unit_p / unit_a,
                q22 / unit_v / unit_v,
                q23 / unit_v / unit_a,
                q33 / unit_a / unit_a,
            ];
        }
        if !finite {
            return Err(Error::OutOfRange);
        }
        self.covariance.propagate_chains(&chains);
        for (axis, [p, v, acc]) in moved.iter().enumerate() {
            for (kind, moved) in [p, v, acc].into_iter().enumerate() {
                if let Some(x) = self.x.get_mut(kind * AXES + axis) {
                    *x = *moved;
                }
            }
        }
        (self.sigma2, self.transition) = (sigma2, Some(over));
        Ok(())
    }

    /// Takes in one fix: every channel through its gate, then what passed, exactly.
    ///
    /// Channels are gated one by one against their own variance P + R, so that the outcome does not depend on their
    /// order, and a wrong position takes no velocity with it.
    ///
    /// # Errors
    /// [`Error::NonFinite`] and [`Error::OutOfRange`] for a reading that cannot be; [`Error::NotPositive`] when a
    /// correlated noise is no covariance; [`Error::InnovationVariance`] and [`Error::Variance`] when the filter's own
    /// covariance is broken, which a new start must answer. The tracker is then unchanged.
    #[inline(always)]
    pub fn update(&mut self, fix: &Fix<T, AXES>) -> Result<Report<T, AXES, N>, Error> {
        let mut report = Report::empty();
        self.update_into(fix, &mut report)?;
        Ok(report)
    }

    /// As [`Tracker::update`], with the report written where the caller has room for it: a copy and its stack less. After
    /// an error the report may hold anything.
    ///
    /// # Errors
    /// Those of [`Tracker::update`].
    #[inline(never)]
    pub fn update_into(
        &mut self,
        fix: &Fix<T, AXES>,
        report: &mut Report<T, AXES, N>,
    ) -> Result<(), Error> {
        let readings = [&fix.position, &fix.velocity];
        for reading in readings.into_iter().flatten() {
            reading.check()?;
        }
        report.nu = const { [[T::ZERO; AXES]; 2] };
        report.s = const { [[T::ZERO; AXES]; 2] };
        report.outcome = [[Outcome::Missing; AXES]; 2];
        report.nis = T::zero();
        report.decrease = const { [T::ZERO; N] };
        report.h.data.0 = const { [[T::ZERO; N]; N] };
        report.r = [T::one(); N];
        let mut failed = self.failed;
        let mut work = Work {
            covariance: self.covariance,
            dx: const { [T::ZERO; N] },
        };
        for (kind, (reading, failed)) in readings.iter().zip(&mut failed).enumerate() {
            let Some(reading) = reading else { continue };
            self.gate(reading, kind, report, failed);
            match &reading.noise {
                Noise::Independent(r) => self.direct(kind, r, &mut work, report)?,
                Noise::Correlated(_) => self.correlated(kind, reading, &mut work, report)?,
            }
        }
        self.covariance.variances_into(&mut report.p_before);
        work.covariance.variances_into(&mut report.p_after);
        for ((x, d), unit) in self.x.iter().zip(&work.dx).zip(&self.unit) {
            if !(x.0 - *d * *unit).finite() {
                return Err(Error::OutOfRange);
            }
        }
        for ((x, d), unit) in self.x.iter_mut().zip(&work.dx).zip(&self.unit) {
            *x = two_add(x.0, x.1, -*d * *unit); // δx is estimate minus truth
        }
        (self.covariance, self.failed) = (work.covariance, failed);
        Ok(())
    }

    /// The used channels of a reading whose axes have nothing to do with each other.
    fn direct(
        &self,
        kind: usize,
        r: &[T; AXES],
        work: &mut Work<T, N, L>,
        report: &mut Report<T, AXES, N>,
    ) -> Result<(), Error> {
        for (axis, r) in r.iter().enumerate() {
            let Some(nu) = report.innovation(kind, axis) else {
                continue;
            };
            let row = kind * AXES + axis;
            let unit = at(&self.unit, row);
            // the row over the unit of its own state, which then has exactly −1
            let e = nu / unit + at(&work.dx, row);
            let r = *r / unit / unit;
            set(&mut report.h, row, row, -T::one());
            if let Some(e) = report.r.get_mut(row) {
                *e = r;
            }
            let mut sums = Sums {
                dx: &mut work.dx,
                decrease: &mut report.decrease,
                nis: &mut report.nis,
            };
            if !work.covariance.update_state(row, e, r, &mut sums) {
                work.carefully(e, Pattern::Direct { first: row }, r, report)?;
            }
        }
        Ok(())
    }

    /// The used channels of one that was made by geometry.
    #[cold]
    #[inline(never)]
    fn correlated(
        &self,
        kind: usize,
        reading: &Reading<T, AXES>,
        work: &mut Work<T, N, L>,
        report: &mut Report<T, AXES, N>,
    ) -> Result<(), Error> {
        let mut used = [false; AXES];
        for (axis, used) in used.iter_mut().enumerate() {
            *used = report.innovation(kind, axis).is_some();
        }
        let white = reading.whiten(&used)?;
        for axis in 0..AXES {
            if report.innovation(kind, axis).is_none() {
                continue;
            }
            let row = kind * AXES + axis;
            let unit = at(&self.unit, row);
            let mut h = SMatrix::<T, 1, N>::zeros();
            let mut e = T::zero();
            for k in 0..AXES {
                let state = kind * AXES + k;
                let w = white.w.get((axis, k)).copied().unwrap_or_else(T::zero);
                if w != T::zero() {
                    let w = w / unit;
                    let slope = if k == axis {
                        -T::one()
                    } else {
                        -w * at(&self.unit, state)
                    };
                    let nu = report.innovation(kind, k).unwrap_or_else(T::zero);
                    e += w * nu - slope * at(&work.dx, state);
                    if let Some(h) = h.get_mut(state) {
                        *h = slope;
                    }
                    set(&mut report.h, row, state, slope);
                }
            }
            let r = at(&white.r, axis) / unit / unit;
            if let Some(e) = report.r.get_mut(row) {
                *e = r;
            }
            let unit = &[T::one(); N];
            work.carefully(e, Pattern::Dense { h: &h, unit }, r, report)?;
        }
        Ok(())
    }

    /// Innovations of one reading, their variances, and what is to become of each.
    fn gate(
        &self,
        reading: &Reading<T, AXES>,
        kind: usize,
        report: &mut Report<T, AXES, N>,
        failed: &mut [u8; AXES],
    ) {
        let of_kind = report.nu.iter_mut().zip(&mut report.s);
        let Some(((nu, s), outcome)) = of_kind.zip(&mut report.outcome).nth(kind) else {
            return;
        };
        let first = kind * AXES;
        let measured = reading.z.iter().zip(&reading.valid);
        let results = nu.iter_mut().zip(s).zip(outcome).zip(failed);
        let own = self.x.iter().zip(&self.unit).skip(first);
        for (axis, (((z, valid), (x, unit)), (((nu, s), outcome), failed))) in
            measured.zip(own).zip(results).enumerate()
        {
            if !valid {
                continue;
            }
            *nu = (*z - x.0) - x.1;
            let p = self.covariance.variance(first + axis);
            *s = p * *unit * *unit + reading.variance(axis);
            let inside = match self.settings.gate {
                Some(gate) => *nu * *nu <= gate * *s,
                None => true,
            };
            (*outcome, *failed) = if inside {
                (Outcome::Used, 0)
            } else {
                let times = failed.saturating_add(1);
                let enough = self.settings.believe_after;
                if enough > 0 && times >= enough {
                    (Outcome::Believed, times)
                } else {
                    (Outcome::Rejected, times)
                }
            };
        }
    }

    /// The estimate.
    pub fn state(&self) -> Kinematics<T, AXES> {
        folded(&self.x.map(|x| x.0))
    }

    /// Its standard deviations.
    pub fn sigma(&self) -> Kinematics<T, AXES> {
        let mut sigma = self.unit;
        for (sigma, p) in sigma.iter_mut().zip(self.covariance.diagonal()) {
            *sigma *= p.root();
        }
        folded(&sigma)
    }

    /// The covariance in σ0 units: element (i, j) times σ0ᵢ σ0ⱼ is SI. Its diagonal started at 1.
    pub fn covariance(&self) -> &Covariance<T, N, L> {
        &self.covariance
    }

    /// σ0 of each state.
    pub fn sigma0(&self) -> &[T; N] {
        &self.unit
    }

    /// Variance of each axis' acceleration about its mean in the last prediction [m²/s⁴].
    pub fn sigma2(&self) -> &[T; AXES] {
        &self.sigma2
    }

    /// The continuous model with the σ² of the last prediction.
    pub fn rates(&self) -> Rates<T, N> {
        let rate = T::one() / self.settings.model.tau;
        let mut rates: Rates<T, N> = Rates {
            f: SMatrix::zeros(),
            q: SVector::zeros(),
        };
        for (axis, sigma2) in self.sigma2.iter().enumerate() {
            let (p, v, a) = (axis, AXES + axis, 2 * AXES + axis);
            let unit_a = at(&self.unit, a);
            set(&mut rates.f, p, v, at(&self.unit, v) / at(&self.unit, p));
            set(&mut rates.f, v, a, unit_a / at(&self.unit, v));
            set(&mut rates.f, a, a, -rate);
            if let Some(q) = rates.q.get_mut(a) {
                *q = T::of(2.0) * *sigma2 * rate / unit_a / unit_a;
            }
        }
        rates
    }
}

/// What a fix is worked on with: all or nothing of it becomes the tracker's.
struct Work<T, const N: usize, const L: usize> {
    covariance: Covariance<T, N, L>,
    dx: [T; N],
}

impl<T: Real, const N: usize, const L: usize> Work<T, N, L> {
    /// One row in double words. What the report says last has room for what is not needed.
    #[cold]
    #[inline(never)]
    fn carefully<const AXES: usize>(
        &mut self,
        nu: T,
        h: Pattern<'_, T, 1, N>,
        r: T,
        report: &mut Report<T, AXES, N>,
    ) -> Result<(), Error> {
        let zero = T::zero();
        let (mut dx, mut decrease, mut nis) = ([zero; N], [zero; N], zero);
        let mut slots = Slots {
            s: &mut [zero],
            nis: &mut nis,
            row_nis: &mut [zero],
            accepted: &mut [false],
            dx: &mut dx,
            decrease: &mut decrease,
            p_before: &mut report.p_before,
            p_after: &mut report.p_after,
        };
        let lines = Lines {
            nu: &[nu],
            r: &[r],
            gate: None,
        };
        self.covariance
            .update_carefully_by(&lines, h, 0, None, &mut slots, &mut |_| Ok(()))?;
        report.nis += nis;
        for (sum, d) in self.dx.iter_mut().zip(dx) {
            *sum += d;
        }
        for (sum, d) in report.decrease.iter_mut().zip(decrease) {
            *sum += d;
        }
        Ok(())
    }
}

/// Kinematics as one array in state order.
fn flat<T: Real, const AXES: usize, const N: usize>(k: &Kinematics<T, AXES>) -> [T; N] {
    let mut x = [T::zero(); N];
    let all = k.position.iter().chain(&k.velocity).chain(&k.acceleration);
    for (x, from) in x.iter_mut().zip(all) {
        *x = *from;
    }
    x
}

/// The reverse of [`flat`].
fn folded<T: Real, const AXES: usize, const N: usize>(x: &[T; N]) -> Kinematics<T, AXES> {
    let part = |first: usize| {
        let mut part = [T::zero(); AXES];
        for (to, from) in part.iter_mut().zip(x.iter().skip(first)) {
            *to = *from;
        }
        part
    };
    Kinematics {
        position: part(0),
        velocity: part(AXES),
        acceleration: part(2 * AXES),
    }
}
