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

mod blocks;
mod orders;

pub use blocks::Form;

use nalgebra::SMatrix;

use super::basis::Basis;
use super::one_sided::{identity, rotate_pair, Triangle, SWEEPS};
use super::pwcs::{Progress, Staged};
use super::vector::dot;
use crate::error::Error;
use crate::linalg::Real;
use blocks::Blocks;
use orders::Settling;

/// No order: the combination is not observable.
const NONE: u8 = u8::MAX;

/// What a slice does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// A row into the triangle.
    Collect,
    /// A row of the next block.
    Advance,
    /// A row of the triangle into a column.
    Transpose,
    /// A pair of columns.
    Rotate,
    /// Squares of the columns.
    Values,
    /// The least order of each combination.
    Minimal(Settling),
    /// The weight of a block in a combination.
    Naive,
    /// A row of the next block for it.
    NaiveAdvance,
    Done,
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
    /// Collected rows; then columns; then the parts of the combinations inside the basis of the first orders.
    triangle: Triangle<T, N>,
    axes: [[T; N]; N],
    basis: Basis<T, N>,
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
        for x in f.as_slice().iter().chain(h.as_slice()).chain(all.clone()) {
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
            basis: Basis::new(),
            lambda: [T::zero(); N],
            naive: [NONE; N],
            minimal: [NONE; N],
            phase: Phase::Collect,
            at: (0, 0),
            sweeps: 0,
            moved: false,
        })
    }

    /// One slice: a row, a pair of columns, or one combination. `f`: the same at every step.
    pub fn step(&mut self, f: &SMatrix<T, N, N>) -> Progress {
        match self.phase {
            Phase::Collect => {
                if let Some(row) = self.blocks.rows.get(self.at.0) {
                    self.triangle.add(row);
                }
                self.at.0 += 1;
                if self.at.0 >= M {
                    self.at.0 = 0;
                    self.phase = if self.last_block() {
                        Phase::Transpose
                    } else {
                        Phase::Advance
                    };
                }
            }
            Phase::Advance => self.advance(f, Phase::Collect),
            Phase::Transpose => {
                self.triangle.transpose_row(self.at.0);
                self.at.0 += 1;
                if self.at.0 >= N {
                    self.phase = Phase::Rotate;
                    self.at = (0, 1);
                }
            }
            Phase::Rotate => {
                if self.rotate(0, N) {
                    self.phase = Phase::Values;
                }
            }
            Phase::Values => {
                for (lambda, column) in self.lambda.iter_mut().zip(&self.triangle.rows) {
                    *lambda = dot(column, column);
                }
                self.blocks = self.first;
                self.at = (0, 0);
                self.phase = Phase::Minimal(Settling::START);
            }
            Phase::Minimal(settling) => {
                if let Some(next) = self.settle(settling, f) {
                    self.phase = Phase::Minimal(next);
                } else {
                    self.blocks = self.first;
                    self.at = (0, 0);
                    self.phase = Phase::Naive;
                }
            }
            Phase::Naive => {
                self.weigh(self.at.0);
                self.at.0 += 1;
                if self.at.0 >= self.rank {
                    self.at.0 = 0;
                    self.phase = if self.last_block() {
                        Phase::Done
                    } else {
                        Phase::NaiveAdvance
                    };
                }
            }
            Phase::NaiveAdvance => self.advance(f, Phase::Naive),
            Phase::Done => {}
        }
        if self.phase == Phase::Done {
            Progress::Done
        } else {
            Progress::Working
        }
    }

    /// All slices at once.
    pub fn run(&mut self, f: &SMatrix<T, N, N>) {
        // Rows, pairs, blocks and combinations have bounds of their own; this one is above their sum.
        for _ in 0..(N + 1) * (SWEEPS * N + 4 * (N + M) + SWEEPS * N * N) {
            if self.step(f) == Progress::Done {
                break;
            }
        }
    }

    fn last_block(&self) -> bool {
        usize::from(self.blocks.order) + 1 >= self.form.blocks.min(N)
    }

    /// One row of the next block, and after the last the phase that uses it.
    fn advance(&mut self, f: &SMatrix<T, N, N>, then: Phase) {
        if self.blocks.advance(self.at.0, f, &self.form) {
            self.at.0 = 0;
            self.phase = then;
        } else {
            self.at.0 += 1;
        }
    }

    /// Rotates the pair at hand of columns `from` … `end`; true where a sweep has moved nothing and all is done.
    fn rotate(&mut self, from: usize, end: usize) -> bool {
        let (p, q) = self.at;
        if q < end {
            self.moved |= rotate_pair(&mut self.triangle.rows, Some(&mut self.axes), p, q);
        }
        self.at = if q + 1 < end {
            (p, q + 1)
        } else {
            (p + 1, p + 2)
        };
        if self.at.1 < end {
            return false;
        }
        self.sweeps += 1;
        let done = !self.moved || self.sweeps >= SWEEPS;
        self.moved = false;
        self.at = (from, from + 1);
        if done {
            self.sweeps = 0;
        }
        done
    }

    /// The paper's order: does this block hold a tenth of Q ξ?
    fn weigh(&mut self, i: usize) {
        let (Some(axis), Some(naive)) = (self.axes.get(i), self.naive.get_mut(i)) else {
            return;
        };
        if i >= self.rank {
            return;
        }
        let mut weight = T::zero();
        for row in &self.blocks.rows {
            let part = dot(row, axis);
            weight += part * part;
        }
        if weight >= T::of(0.01) * get(&self.lambda, i) {
            *naive = self.blocks.order;
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
