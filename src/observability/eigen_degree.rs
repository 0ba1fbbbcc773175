//! Eigenvalue degree of observability and derivative orders (Yang and Yin).
//!
//! ```text
//! Q = [ H ; H F ; … ; H Fⁿ⁻¹ ],   QᵀQ ξ_i = λ_i ξ_i,   y_i = ξ_iᵀ x   shows in Q ξ_i with weight λ_i
//! ```
//!
//! λ = 0: the combination y is not seen. Otherwise the *order* decides, the highest derivative that is needed: the larger,
//! the less observable; λ only compares the same combination under different conditions. The largest component of ξ is
//! not "the state that is meant" where units differ, and raw λ are in mixed units: in SI the raw form calls heading
//! unobservable and the east gyro excellent, upside down. The scaled form (states by σ0, rows by their noise, block k by
//! Tᵏ/k!) has numbers that mean something.
//!
//! Q is not formed: its rows are collected in a triangle, and one-sided Jacobi gives λ = σ². Squaring first (QᵀQ) would
//! lose the small ones in f32.
//!
//! Source: Yang and Yin (all formulas are missing in print; a reconstruction). The orders are made precise here:
//! `naive_order` is the paper's, `min_order` the one to rank by. They differ as soon as position and velocity are both
//! measured. f64 and f32: `host-tests/tests/yang.rs`.

use nalgebra::SMatrix;

use super::comprehensive::Basis;
use super::one_sided::{identity, rotate, rotate_pair, Triangle, SWEEPS};
use super::pwcs::{Progress, Staged};
use crate::error::Error;
use crate::linalg::Real;

/// No order: the combination is not observable.
const NONE: u8 = u8::MAX;

/// Units in which Q is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Form<T, const N: usize, const M: usize> {
    /// What counts as 1 of each state: σ0, or 1.
    pub state: [T; N],
    /// What counts as 1 of each row: the standard deviation of its noise, or 1.
    pub row: [T; M],
    /// T of the weight Tᵏ/k! of block k [s]; `None`: no weight.
    pub interval: Option<T>,
    /// Blocks of Q: orders 0 … blocks − 1. N by default.
    pub blocks: usize,
}

impl<T: Real, const N: usize, const M: usize> Form<T, N, M> {
    /// Q as the paper has it. Its λ depend on the units of the states: fit for comparing with print, and for systems
    /// with one unit.
    pub fn raw() -> Self {
        Self {
            state: [T::one(); N],
            row: [T::one(); M],
            interval: None,
            blocks: N,
        }
    }

    /// States by σ0, rows by their noise, block k by Tᵏ/k!: λ is a ratio of information to prior.
    pub fn scaled(sigma0: [T; N], row_sigma: [T; M], interval: T) -> Self {
        Self {
            state: sigma0,
            row: row_sigma,
            interval: Some(interval),
            blocks: N,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Rows into the triangle.
    Collect,
    /// Pairs of columns.
    Rotate,
    /// Bases of the first orders, and the weight of each block in each combination.
    Orders,
    Done,
}

/// Rows H Fᵏ, weighted, block by block.
#[derive(Clone, Copy, Debug)]
struct Blocks<T, const N: usize, const M: usize> {
    rows: [[T; N]; M],
    order: u8,
}

impl<T: Real, const N: usize, const M: usize> Blocks<T, N, M> {
    fn start(h: &SMatrix<T, M, N>, form: &Form<T, N, M>) -> Self {
        let mut rows = [[T::zero(); N]; M];
        for ((row, source), sigma) in rows.iter_mut().zip(h.row_iter()).zip(&form.row) {
            for ((x, entry), unit) in row.iter_mut().zip(source.iter()).zip(&form.state) {
                *x = *entry * *unit / *sigma;
            }
        }
        Self { rows, order: 0 }
    }

    fn advance(&mut self, f: &SMatrix<T, N, N>, form: &Form<T, N, M>) {
        self.order = self.order.saturating_add(1);
        let weight = form
            .interval
            .map_or(T::one(), |t| t / T::of(f64::from(self.order)));
        for row in &mut self.rows {
            let mut next = [T::zero(); N];
            for ((sum, column), own) in next.iter_mut().zip(f.column_iter()).zip(&form.state) {
                for ((x, entry), unit) in row.iter().zip(column.iter()).zip(&form.state) {
                    if *x != T::zero() && *entry != T::zero() {
                        *sum += *x * *entry / *unit;
                    }
                }
                *sum *= weight * *own;
            }
            *row = next;
        }
    }
}

/// Eigenvalues of QᵀQ, their combinations and orders, in slices.
#[derive(Clone, Copy, Debug)]
pub struct EigenDegree<T: Real, const N: usize, const M: usize> {
    form: Form<T, N, M>,
    first: Blocks<T, N, M>,
    blocks: Blocks<T, N, M>,
    /// Rows of each order that are new, by staged elimination.
    accepted: [u64; N],
    rank: usize,
    triangle: Triangle<T, N>,
    axes: [[T; N]; N],
    lambda: [T; N],
    naive: [u8; N],
    minimal: [u8; N],
    phase: Phase,
    at: (usize, usize),
    sweeps: usize,
    moved: bool,
}

/// One eigenvalue and what belongs to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eigen<T, const N: usize> {
    /// λ, in the units of the form. Not to be compared between different combinations.
    pub lambda: T,
    /// ξ: the combination y = ξᵀx, in the units of the form, length 1.
    pub vector: [T; N],
    /// Highest order that holds 10 % of Q ξ; `None` where not observable. The paper's.
    pub naive_order: Option<u8>,
    /// Least order whose rows hold 99 % of |ξ|²; `None` where not observable. Rank by this one.
    pub min_order: Option<u8>,
}

impl<T: Real, const N: usize, const M: usize> EigenDegree<T, N, M> {
    /// Before the first slice. `staged` is the elimination of the same F and H: it decides the rank and which rows are
    /// new, because the size of an eigenvalue cannot.
    ///
    /// [`Error::NonFinite`], [`Error::OutOfRange`] for a unit or interval that is not positive.
    pub fn new(
        f: &SMatrix<T, N, N>,
        h: &SMatrix<T, M, N>,
        form: &Form<T, N, M>,
        staged: &Staged<T, N, M>,
    ) -> Result<Self, Error> {
        let all = form.state.iter().chain(&form.row).chain(&form.interval);
        for x in f.iter().chain(h.iter()).chain(all.clone()) {
            if !x.finite() {
                return Err(Error::NonFinite);
            }
        }
        for x in all {
            if *x <= T::zero() {
                return Err(Error::OutOfRange);
            }
        }
        let mut accepted = [0; N];
        for origin in staged.origins() {
            if let Some(rows) = accepted.get_mut(usize::from(origin.order)) {
                *rows |= 1 << (origin.row & 63);
            }
        }
        let blocks = Blocks::start(h, form);
        Ok(Self {
            form: *form,
            first: blocks,
            blocks,
            accepted,
            rank: staged.rank(),
            triangle: Triangle::new(),
            axes: identity(),
            lambda: [T::zero(); N],
            naive: [NONE; N],
            minimal: [NONE; N],
            phase: Phase::Collect,
            at: (0, 0),
            sweeps: 0,
            moved: false,
        })
    }

    /// One row, one pair of columns, or one block of orders. `f`: the same at every step.
    pub fn step(&mut self, f: &SMatrix<T, N, N>) -> Progress {
        match self.phase {
            Phase::Collect => {
                if let Some(row) = self.blocks.rows.get(self.at.0) {
                    self.triangle.add(row);
                }
                self.at.0 += 1;
                if self.at.0 >= M {
                    self.at.0 = 0;
                    if usize::from(self.blocks.order) + 1 >= self.form.blocks.min(N) {
                        // From here on the triangle holds columns.
                        self.triangle.rows = self.triangle.columns();
                        self.phase = Phase::Rotate;
                        self.at = (0, 1);
                    } else {
                        self.blocks.advance(f, &self.form);
                    }
                }
            }
            Phase::Rotate => {
                let (p, q) = self.at;
                if q < N {
                    self.moved |= rotate_pair(&mut self.triangle.rows, Some(&mut self.axes), p, q);
                }
                self.at = if q + 1 < N {
                    (p, q + 1)
                } else {
                    (p + 1, p + 2)
                };
                if self.at.1 >= N {
                    self.sweeps += 1;
                    if !self.moved || self.sweeps >= SWEEPS {
                        self.finish_values();
                        self.blocks = self.first;
                        self.phase = Phase::Orders;
                    }
                    self.moved = false;
                    self.at = (0, 1);
                }
            }
            Phase::Orders => {
                if self.blocks.order == 0 {
                    self.minimal_orders(f);
                }
                self.naive_orders();
                if usize::from(self.blocks.order) + 1 >= self.form.blocks.min(N) {
                    self.phase = Phase::Done;
                } else {
                    self.blocks.advance(f, &self.form);
                }
            }
            Phase::Done => {}
        }
        if self.phase == Phase::Done {
            Progress::Done
        } else {
            Progress::Working
        }
    }

    /// All slices at once.
    pub fn run(mut self, f: &SMatrix<T, N, N>) -> Self {
        // Rows, pairs and blocks have bounds of their own; this one is their sum.
        for _ in 0..N * (M + 1) + SWEEPS * N * N + 1 {
            if self.step(f) == Progress::Done {
                break;
            }
        }
        self
    }

    fn finish_values(&mut self) {
        for (lambda, column) in self.lambda.iter_mut().zip(&self.triangle.rows) {
            *lambda = column.iter().fold(T::zero(), |sum, x| sum + *x * *x);
        }
    }

    fn naive_orders(&mut self) {
        let tenth = T::of(0.01);
        for ((axis, lambda), naive) in self
            .axes
            .iter()
            .zip(&self.lambda)
            .zip(&mut self.naive)
            .take(self.rank)
        {
            let mut weight = T::zero();
            for row in &self.blocks.rows {
                let part = dot(row, axis);
                weight += part * part;
            }
            if weight >= tenth * *lambda {
                *naive = self.blocks.order;
            }
        }
    }

    /// Orders by containment. In the space of one eigenvalue any basis is as good: the one is taken whose first vectors
    /// lie in the lowest orders.
    fn minimal_orders(&mut self, f: &SMatrix<T, N, N>) {
        let mut basis = Basis::<T, N>::new();
        let mut blocks = self.first;
        let mut settled = 0u64;
        for order in 0..N {
            let accepted = self.accepted.get(order).copied().unwrap_or(0);
            if accepted == 0 {
                break;
            }
            for (m, row) in blocks.rows.iter().enumerate() {
                if accepted >> (m & 63) & 1 == 1 {
                    basis.add(row, T::zero());
                }
            }
            let mut from = 0;
            while from < self.rank {
                let end = self.group_end(from);
                self.settle(&basis, from, end, order as u8, &mut settled);
                from = end;
            }
            blocks.advance(f, &self.form);
        }
    }

    /// One past the last eigenvalue that equals the one at `from`.
    fn group_end(&self, from: usize) -> usize {
        let gap = gap::<T>();
        let mut end = from + 1;
        while end < self.rank {
            let (a, b) = (get(&self.lambda, end - 1), get(&self.lambda, end));
            if a - b > gap * a {
                break;
            }
            end += 1;
        }
        end
    }

    /// Turns the vectors of one eigenvalue that have no order yet so that those inside the basis come first, and gives
    /// them this order.
    fn settle(
        &mut self,
        basis: &Basis<T, N>,
        from: usize,
        end: usize,
        order: u8,
        settled: &mut u64,
    ) {
        let mut start = from;
        while start < end && *settled >> (start & 63) & 1 == 1 {
            start += 1;
        }
        if start >= end {
            return;
        }
        // Parts inside the basis of the vectors start … end, at the front of a table.
        let mut inside = [[T::zero(); N]; N];
        for (parts, axis) in inside
            .iter_mut()
            .zip(self.axes.iter().skip(start))
            .take(end - start)
        {
            for (part, v) in parts.iter_mut().zip(basis.vectors.iter().take(basis.len)) {
                *part = dot(v, axis);
            }
        }
        if end - start > 1 {
            let mut turn = identity::<T, N>();
            rotate(&mut inside, Some(&mut turn));
            let old = self.axes;
            for (new, weights) in self
                .axes
                .iter_mut()
                .skip(start)
                .zip(&turn)
                .take(end - start)
            {
                *new = [T::zero(); N];
                for (axis, w) in old.iter().skip(start).zip(weights).take(end - start) {
                    for (x, y) in new.iter_mut().zip(axis) {
                        *x += *w * *y;
                    }
                }
            }
        }
        let most = T::of(0.99);
        for (i, parts) in inside.iter().enumerate().take(end - start) {
            if dot(parts, parts) >= most {
                if let Some(place) = self.minimal.get_mut(start + i) {
                    *place = order;
                }
                *settled |= 1 << ((start + i) & 63);
            }
        }
    }

    /// Rank, by staged elimination.
    pub const fn rank(&self) -> usize {
        self.rank
    }

    /// Eigenvalue number i, largest first.
    pub fn eigen(&self, i: usize) -> Option<Eigen<T, N>> {
        let order = |table: &[u8; N]| table.get(i).copied().filter(|k| *k != NONE);
        Some(Eigen {
            lambda: *self.lambda.get(i)?,
            vector: *self.axes.get(i)?,
            naive_order: order(&self.naive),
            min_order: order(&self.minimal),
        })
    }

    /// All of them.
    pub fn all(&self) -> impl Iterator<Item = Eigen<T, N>> + '_ {
        (0..N).filter_map(|i| self.eigen(i))
    }

    /// Share of a state in the unobservable combinations: 0 fully seen … 1 not at all. In the raw form this is a number
    /// about units.
    pub fn null_share(&self, state: usize) -> T {
        let mut share = T::zero();
        for axis in self.axes.iter().skip(self.rank) {
            let x = get(axis, state);
            share += x * x;
        }
        share
    }
}

/// Eigenvalues nearer than this, relatively, share one space.
fn gap<T: Real>() -> T {
    let rounding = T::of(4096.0) * T::EPSILON;
    let least = T::of(1e-6);
    if rounding > least {
        rounding
    } else {
        least
    }
}

fn get<T: Real, const N: usize>(table: &[T; N], i: usize) -> T {
    table.get(i).copied().unwrap_or(T::zero())
}

fn dot<T: Real, const N: usize>(a: &[T; N], b: &[T; N]) -> T {
    let mut sum = T::zero();
    for (x, y) in a.iter().zip(b) {
        sum += *x * *y;
    }
    sum
}
