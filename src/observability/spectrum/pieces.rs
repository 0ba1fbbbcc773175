//! The pieces of work of a spectrum: what each costs, what it does, and which comes next.

use super::{Axes, Prior, Spectrum};
use crate::covariance::Covariance;
use crate::linalg::Real;
use crate::observability::jacobi::{rotate, Rotation, Threshold};
use crate::observability::triangle::{
    at, congruence_step, copy_rows, divide_row, factor_column, gram_row, pivot, row,
};

/// Sweeps over all pairs before the iteration gives up. Covariances need 2 to 5; random dense matrices 5 to 7.
const MAX_SWEEPS: u8 = 16;

/// Share of the largest diagonal element that every element of an indefinite matrix counts with at least, in single
/// precision: rotations that move a value by less than 6 ε of the largest are left out, which is below what the
/// rounding of Ṗ has done to it.
const FLOOR: f64 = 1.0 / 16.0;
/// The same in double precision, where time is cheap: less than 0.1 ε.
const FLOOR_DOUBLE: f64 = 1.0 / 1024.0;

/// Cost of looking at one pair.
const PAIR: u32 = 4;

/// What is to be done next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Stage {
    /// Nothing was started, or a start or a step was refused.
    Idle,
    /// Column k of the factor of P.
    Factor {
        k: usize,
    },
    /// Column k of the factor of P0.
    Prior {
        k: usize,
    },
    /// Row i of L0⁻¹ L.
    Divide {
        i: usize,
    },
    /// Step k of L0⁻¹ X L0⁻ᵀ.
    Congruence {
        k: usize,
    },
    /// Row i of Lᵀ L.
    Gram {
        i: usize,
    },
    /// Pair (q, p) is looked at, and rotated when needed.
    Pair {
        q: usize,
        p: usize,
    },
    /// The values are put in order.
    Sort,
    /// Column k of the factor of P0, once more, for the directions.
    Again {
        k: usize,
    },
    Done,
    NotConverged,
}

impl<T: Real, const N: usize, const L: usize, A: Axes<T>> Spectrum<'_, T, N, L, A> {
    /// Multiply-adds of the next piece, with what stands around them; an upper bound.
    #[inline(always)]
    pub(super) fn cost(&self) -> u32 {
        let n = self.n;
        let units = match self.stage {
            Stage::Factor { k } => (n - k.min(n)) * (k + 6) + 4 * n + 16,
            Stage::Prior { k } | Stage::Again { k } => (n - k.min(n)) * (k + 6) + 16,
            Stage::Divide { i } => i * (i + 1) / 2 + 4 * i + 8,
            Stage::Congruence { k } => {
                let m = n - k.min(n);
                m * m + 4 * m + 8
            }
            Stage::Gram { i } => (n - i.min(n)) * (i + 3) + 2 * i + 8,
            Stage::Pair { .. } => PAIR as usize,
            Stage::Sort => n * n / 2 + n + 8,
            Stage::Idle | Stage::Done | Stage::NotConverged => 0,
        };
        units as u32
    }

    /// Does one piece of work and names the next, or the state at which a matrix turned out not to be positive.
    pub(super) fn piece(&mut self, stage: Stage) -> Result<Stage, u8> {
        let n = self.n;
        Ok(match stage {
            Stage::Factor { k } if k < n => {
                pivot(&mut self.a, n, k, &mut self.values, &mut self.order);
                if !factor_column(&mut self.a, n, k, &mut self.values) {
                    return Err(self.state(k));
                }
                Stage::Factor { k: k + 1 }
            }
            Stage::Factor { .. } => match self.prior {
                Prior::Independent => self.factored(),
                Prior::Correlated(p0) => {
                    self.load_prior(p0);
                    Stage::Prior { k: 0 }
                }
            },
            Stage::Prior { k } if k < n => {
                if !factor_column(&mut self.b, n, k, &mut [T::zero(); N]) {
                    return Err(self.state(k));
                }
                Stage::Prior { k: k + 1 }
            }
            Stage::Prior { .. } if self.definite => Stage::Divide { i: 0 },
            Stage::Prior { .. } => Stage::Congruence { k: 0 },
            Stage::Divide { i } if i < n => {
                divide_row(&mut self.a, &self.b, i);
                Stage::Divide { i: i + 1 }
            }
            Stage::Divide { .. } => self.factored(),
            Stage::Congruence { k } if k < n => {
                congruence_step::<T, N>(&mut self.a, &self.b, n, k);
                Stage::Congruence { k: k + 1 }
            }
            Stage::Gram { i } if i < n => {
                gram_row::<T, N>(&mut self.a, n, i);
                Stage::Gram { i: i + 1 }
            }
            Stage::Gram { .. } | Stage::Congruence { .. } => {
                self.read_diagonal();
                self.first_sweep()
            }
            Stage::Sort => {
                self.sort();
                match self.prior {
                    Prior::Correlated(p0) if A::KEPT && self.definite => {
                        copy_rows(&mut self.a, p0.words().0, &self.order, n);
                        Stage::Again { k: 0 }
                    }
                    _ => Stage::Done,
                }
            }
            // the same matrix was factorised before
            Stage::Again { k } if factor_column(&mut self.a, n, k, &mut [T::zero(); N]) => {
                Stage::Again { k: k + 1 }
            }
            Stage::Again { .. } => Stage::Done,
            other => other,
        })
    }

    /// The state in row k.
    fn state(&self, k: usize) -> u8 {
        self.order.get(k).copied().unwrap_or(0)
    }

    /// The factor is there: keep it for the directions, and multiply.
    fn factored(&mut self) -> Stage {
        if A::KEPT {
            self.b = self.a;
        }
        Stage::Gram { i: 0 }
    }

    pub(super) fn load_prior(&mut self, p0: &Covariance<T, N, L>) {
        copy_rows(&mut self.b, p0.words().0, &self.order, self.n);
    }

    pub(super) fn read_diagonal(&mut self) {
        for (i, value) in self.values.iter_mut().enumerate().take(self.n) {
            *value = at(&self.a, i, i);
        }
    }

    pub(super) fn first_sweep(&mut self) -> Stage {
        self.axes.reset();
        self.rotated = false;
        self.floor = T::zero();
        if !self.definite {
            let size = self
                .values
                .iter()
                .take(self.n)
                .fold(T::zero(), |m, x| m.max(x.abs()));
            self.floor = T::EPSILON * size;
        }
        Stage::Pair { q: 1, p: 0 }
    }

    /// Looks along the rows of the triangle from pair (q, p) on, and rotates those that need it, until the budget does
    /// not allow for another rotation.
    #[inline(always)]
    pub(super) fn pairs(&mut self, mut q: usize, mut p: usize, budget: &mut u32) -> Stage {
        let n = self.n;
        let rotation_cost = (n * if A::KEPT { 6 } else { 4 } + 16) as u32;
        let epsilon = T::EPSILON.wide();
        let share = if epsilon > 1e-10 { FLOOR } else { FLOOR_DOUBLE };
        let threshold = Threshold {
            floor: self.floor * T::of(share / epsilon),
            axes: A::KEPT,
        };
        while q < n {
            let look = (q - p.min(q)) as u32 * PAIR;
            if *budget < look + rotation_cost {
                return Stage::Pair { q, p };
            }
            *budget -= look;
            let (left, right) = self.values.split_at_mut_checked(q).unwrap_or_default();
            let Some(y) = right.first_mut() else {
                break;
            };
            let row_q = row(&self.a, q).get(p..q).unwrap_or_default();
            let candidates = left.get_mut(p..).unwrap_or_default().iter_mut();
            let mut rotation = None;
            for (x, a) in candidates.zip(row_q) {
                if !threshold.negligible(*x, *y, *a) {
                    let found = Rotation::annulling(*x, *y, *a);
                    *x -= found.shift;
                    *y += found.shift;
                    rotation = Some(found);
                    break;
                }
                p += 1;
            }
            match rotation {
                Some(rotation) => {
                    *budget -= rotation_cost;
                    rotate(&mut self.a, n, p, q, &rotation);
                    self.axes.turn(p, q, rotation.s, rotation.tau);
                    self.rotated = true;
                    p += 1;
                }
                None => (q, p) = (q + 1, 0),
            }
        }
        self.sweep += 1;
        match (self.rotated, self.sweep < MAX_SWEEPS) {
            (false, _) => Stage::Sort,
            (true, true) => {
                self.rotated = false;
                Stage::Pair { q: 1, p: 0 }
            }
            (true, false) => Stage::NotConverged,
        }
    }

    /// Insertion sort of the rows by their value. They come in nearly descending order from the pivots.
    fn sort(&mut self) {
        let rows = self.values.get(..self.n).unwrap_or_default().iter();
        for (sorted, (row, value)) in rows.enumerate().rev().enumerate() {
            let mut place = sorted;
            while place > 0 {
                let below = self.rank.get(place - 1).copied().unwrap_or(0);
                let other = self.values.get(usize::from(below));
                if !other.is_some_and(|x| x > value) {
                    break;
                }
                if let Some(to) = self.rank.get_mut(place) {
                    *to = below;
                }
                place -= 1;
            }
            if let Some(to) = self.rank.get_mut(place) {
                *to = row as u8;
            }
        }
    }
}
