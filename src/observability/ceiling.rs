//! Ceilings and links: how far ξ2 can rise, how much of it is reached, and what an order costs.
//!
//! ```text
//! s_j = ‖N_j‖²,  N: orthonormal null space of Q in σ0 units        ξ2_j → 1/s_j, never above without process noise
//! η2_i = 1 + λ_i of the information matrix in σ0 units              (initial-state form)
//! ```
//!
//! Three exact links between Lu (ξ, η), Yang (λ, null space) and Peng (couplings): with Peng's prior-weighted couplings
//! c of an unseen combination the ceiling is 1 + 1/Σc². A ceiling is a property of the model (F, H, P0), not of the data:
//! a filter that re-linearises about its own estimate may rise some percent above it (heading: 424 against 404), and a
//! Markov bias is a random constant only for a while (414 against 404). Far above it the filter learns from itself.
//! `host-tests/tests/yang.rs` has the numbers.

use nalgebra::{SMatrix, SVector};

use super::basis::Basis;
use super::comprehensive::null_vector;
use super::one_sided::{identity, rotate, Triangle};
use super::pwcs::Staged;
use super::vector::{self, dot};
use crate::filter::UpdateReport;
use crate::linalg::Real;
use crate::measurement::{Linearized, MeasurementRows};

/// How far ξ2 may stand above its ceiling, relatively, in an honest filter: re-linearising about a noisy attitude lifts it
/// by 5 % (404 → 424; 3 % in `laser_static`, `host-tests/tests/ceiling_margin.rs`) and a Markov bias by 2.5 % (404 → 414),
/// which is 8 % where both come together; rounding of ξ2 in f32 is below 0.1 %. A filter that learns from its own linearisation
/// goes past it by factors.
pub const MARGIN: f64 = 0.1;

/// By how much a tilt lifts ξ2 of the tilts and of the level accelerometers above the ceiling of one position, relatively.
///
/// ```text
/// δ² σ_a² / σ_up²,     σ_up² = q²/T
/// ```
/// Tilted by δ, a level accelerometer bias b shows δ b in the vertical, where nothing but the noise of the specific force
/// hides it: σ_up after T seconds. An order of magnitude, and on the safe side: 3 to 4 times what was measured where δ is the
/// rms tilt, more where it is the largest. Above [`MARGIN`] the ceilings of those states have to be given up.
///
/// * `tilt` δ, the turn of the vertical in the body [rad], as the accelerometers feel it in the mean of some seconds: what
///   the filter thinks also moves by its corrections; `accel_bias` σ_a of the prior [m/s²]; `walk` q, velocity random
///   walk [m/s/√s]; `seconds` T of standing
pub fn tilt_excess(tilt: f32, accel_bias: f32, walk: f32, seconds: f32) -> f32 {
    let ratio = tilt * accel_bias / walk;
    ratio * ratio * seconds
}

/// What no measurement sees: an orthonormal basis N of the unobservable space, in the σ0 units of the elimination's scale.
///
/// Found once after an elimination; states and directions are then looked up in it. It lives where the caller has room
/// for N² numbers, often beside the elimination.
#[derive(Clone, Copy, Debug)]
pub struct Unseen<T, const N: usize> {
    basis: Basis<T, N>,
}

impl<T: Real, const N: usize> Default for Unseen<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const N: usize> Unseen<T, N> {
    /// Nothing is unseen.
    pub fn new() -> Self {
        Self {
            basis: Basis::new(),
        }
    }

    /// What an elimination leaves unseen.
    pub fn of<const M: usize>(staged: &Staged<T, N, M>) -> Self {
        let mut unseen = Self::new();
        unseen.find(staged);
        unseen
    }

    /// [`Unseen::of`] in place of what was found before.
    pub fn find<const M: usize>(&mut self, staged: &Staged<T, N, M>) {
        let scale = staged.scale();
        self.basis.len = 0;
        let states = if N >= 64 { u64::MAX } else { (1 << N) - 1 };
        let mut left = states & !staged.pivots();
        while left != 0 {
            let free = left.trailing_zeros() as usize;
            left &= left - 1;
            if let Some(mut v) = null_vector(staged, free) {
                let mut largest = T::zero();
                for (x, (unit, sigma)) in v.iter_mut().zip(scale.unit.iter().zip(&scale.sigma)) {
                    *x *= *unit / *sigma;
                    if x.abs() > largest {
                        largest = x.abs();
                    }
                }
                // Its own state is 1 in canonical units, so the largest is not 0.
                let inverse = T::one() / largest;
                for x in &mut v {
                    *x *= inverse;
                }
                self.basis.add_rest(&mut v, T::zero());
            }
        }
    }

    /// s_j of every state: the share of it that is unseen. 0: fully seen, ξ2 unbounded; 1: not seen at all, ξ2 stays 1.
    pub fn shares(&self) -> [T; N] {
        let mut shares = [T::zero(); N];
        for v in self.basis.vectors.iter().take(self.basis.len) {
            for (s, x) in shares.iter_mut().zip(v) {
                *s += *x * *x;
            }
        }
        shares
    }

    /// The same share of a direction in σ0 units, of any length; 0 for none.
    pub fn share(&self, direction: &[T; N]) -> T {
        let mut share = T::zero();
        for v in self.basis.vectors.iter().take(self.basis.len) {
            let part = dot(v, direction);
            share += part * part;
        }
        let length = dot(direction, direction);
        if length > T::zero() {
            share / length
        } else {
            T::zero()
        }
    }

    /// The unit vector of a state, projected on the unseen space: its own element is the state's share.
    pub fn shadow(&self, state: usize) -> [T; N] {
        let mut shadow = [T::zero(); N];
        for v in self.basis.vectors.iter().take(self.basis.len) {
            let own = v.get(state).copied().unwrap_or_else(T::zero);
            for (x, y) in shadow.iter_mut().zip(v) {
                *x += own * *y;
            }
        }
        shadow
    }
}

/// The ceiling of ξ2: 1/s; `None` where s = 0 and there is none.
pub fn ceiling<T: Real>(share: T) -> Option<T> {
    (share > T::zero()).then(|| T::one() / share)
}

/// How much of the ceiling is reached: ξ2 s, 0 … 1; above 1 by more than re-linearisation explains, something is wrong.
pub fn saturation<T: Real>(xi2: T, share: T) -> T {
    xi2 * share
}

/// What an order costs: information left in a Taylor coefficient of order k from n equally spaced updates, after the
/// lower coefficients are free. λ of the scaled form times this predicts the information gained.
///
/// ```text
/// n / ((2k + 1) C(2k, k)²)      n, n/12, n/180, n/2800 for k = 0 … 3
/// ```
///
/// For the top order of a measurement chain; rows that share a chain with higher orders come out 5 to 100 times too
/// large. 0 for k > 30, where the number is below 1e-34 n.
pub fn order_cost<T: Real>(updates: T, order: u8) -> T {
    if order > 30 {
        return T::zero();
    }
    let mut binomial = 1.0f64;
    for i in 0..order {
        let i = f64::from(i);
        binomial *= (2.0 * i + 1.0) * 2.0 / (i + 1.0);
    }
    updates * T::of(1.0 / ((2.0 * f64::from(order) + 1.0) * binomial * binomial))
}

/// What the updates so far say about the *initial* state, in σ0 units: an accumulator beside the filter.
///
/// ```text
/// W = Σ Φ(t, 0)ᵀ Hᵀ R⁻¹ H Φ(t, 0),        held as a triangle with RᵀR = W, and Ψ = Φ(t, 0)
/// ```
///
/// It is fed with what the filter uses: A = Φ − I of each propagation ([`crate::filter::Filter::propagate_watched`] shows
/// it) and the rows of each update, both in σ0 units. It knows no process noise, so it says what the model could have learnt, for comparison with ξ2 and η2.
/// Ψ grows without bound where the model does; start anew after the horizon of interest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gramian<T: Real, const N: usize> {
    triangle: Triangle<T, N>,
    psi: [[T; N]; N],
    updates: u32,
}

impl<T: Real, const N: usize> Default for Gramian<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl Gramian<f32, 15> {
    /// Takes in a measurement as the filter used it: its accepted rows.
    ///
    /// `sigma0`: the unit of each state, [`crate::filter::Filter::sigma0`].
    pub fn observe_update<const M: usize, H: MeasurementRows<M>>(
        &mut self,
        measurement: &Linearized<M, H>,
        report: &UpdateReport<M>,
        sigma0: &[f32; 15],
    ) {
        let h = measurement.dense();
        let used = report.accepted.iter().zip(measurement.r.iter());
        for (row, (used, r)) in h.row_iter().zip(used) {
            if *used {
                let mut scaled = row.transpose().component_mul(&SVector::from(*sigma0));
                scaled /= libm::sqrtf(*r);
                self.observe(&scaled);
            }
        }
    }
}

/// Eigenvalues and directions of the information, largest first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Information<T, const N: usize> {
    /// λ of W in σ0 units; η2 = 1 + λ.
    pub lambda: [T; N],
    /// Directions, one row for each λ, in σ0 units.
    pub directions: [[T; N]; N],
    /// Whether the rotations came to an end.
    pub converged: bool,
}

impl<T: Real, const N: usize> Gramian<T, N> {
    /// Nothing seen, at the initial time.
    pub fn new() -> Self {
        Self {
            triangle: Triangle::new(),
            psi: identity(),
            updates: 0,
        }
    }

    /// Moves on by A = Φ − I of an interval, in σ0 units (A_ij σ0_j / σ0_i).
    pub fn propagate(&mut self, a: &SMatrix<T, N, N>) {
        let old = self.psi;
        for (psi, row) in self.psi.iter_mut().zip(a.row_iter()) {
            for (factor, source) in row.iter().zip(&old) {
                if *factor != T::zero() {
                    vector::add(psi, *factor, source);
                }
            }
        }
    }

    /// Takes in a measurement row divided by its noise, in σ0 units: h_j σ0_j / √r.
    pub fn observe(&mut self, h: &SVector<T, N>) {
        let mut row = [T::zero(); N];
        for (factor, psi) in h.iter().zip(&self.psi) {
            if *factor != T::zero() {
                vector::add(&mut row, *factor, psi);
            }
        }
        self.triangle.add(&row);
        self.updates = self.updates.saturating_add(1);
    }

    /// Rows taken in.
    pub const fn rows(&self) -> u32 {
        self.updates
    }

    /// The information about each initial state if the others were known: diagonal of W.
    pub fn diagonal(&self) -> [T; N] {
        let mut sum = [T::zero(); N];
        for row in &self.triangle.rows {
            for (s, x) in sum.iter_mut().zip(row) {
                *s += *x * *x;
            }
        }
        sum
    }

    /// ξ2 that a filter without process noise has now: 1 / [Ψ (I + W)⁻¹ Ψᵀ]_jj. Compare with the filter's own.
    pub fn xi2(&self, information: &Information<T, N>) -> [T; N] {
        let mut xi2 = [T::one(); N];
        for (xi2, psi) in xi2.iter_mut().zip(&self.psi) {
            let mut left = T::zero();
            for (direction, lambda) in information.directions.iter().zip(&information.lambda) {
                let mut part = T::zero();
                for (x, y) in psi.iter().zip(direction) {
                    part += *x * *y;
                }
                left += part * part / (T::one() + *lambda);
            }
            *xi2 = T::one() / left;
        }
        xi2
    }

    /// Eigenvalues and directions. Not for every sample: eight sweeps of N(N−1)/2 rotations.
    pub fn information(&self) -> Information<T, N> {
        let mut columns = self.triangle;
        columns.transpose();
        let mut directions = identity();
        let converged = rotate(&mut columns.rows, Some(&mut directions));
        let mut lambda = [T::zero(); N];
        for (l, column) in lambda.iter_mut().zip(&columns.rows) {
            *l = column.iter().fold(T::zero(), |sum, x| sum + *x * *x);
        }
        Information {
            lambda,
            directions,
            converged,
        }
    }
}
