//! Comprehensive degree of observability: relative degree, order and couplings of every state (Peng 2016).
//!
//! ```text
//! P Z = [ U ; 0 ] x        Z = [ z, ż, z̈, … ]      degree = |u_pivot|,  order = highest derivative in the row of P
//! ```
//!
//! The paper's algorithm (its Fig. 3) is lost; this is the staged elimination of [`super::pwcs`], and a closed form as an
//! independent check. A row is scaled so that its part of P of the highest order has length 1, which gives both numbers
//! of the paper's Table 2. Degrees of different states can be compared only where their units agree (the paper's
//! "relative").
//!
//! *Strict*: the row holds one state and nothing else. *Prior-weighted*: what else it holds, weighted by the prior, is
//! below θ of it. At rest nothing but the velocities is strictly observable; tilt and heading are so only by trusting
//! the prior of the biases.

use nalgebra::SMatrix;

use super::basis::Basis;
use super::one_sided;
use super::pwcs::Staged;
use super::vector::dot;
use crate::linalg::Real;

/// One observable combination of states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Combination<T, const N: usize> {
    /// The state that stands for it.
    pub pivot: usize,
    /// Order: derivatives of the measurement that are needed; the higher, the slower.
    pub order: u8,
    /// Relative degree |u| of the pivot [unit of the measurement's derivative per unit of the state].
    pub degree: T,
    /// The combination in the states' own units, its pivot 1. Multiply by the degree for the row of U.
    pub u: [T; N],
    /// u_j σ_j / (u_pivot σ_pivot) without sign: how much of the row is other states, a priori. 1 at the pivot.
    pub coupling: [T; N],
}

impl<T: Real, const N: usize> Combination<T, N> {
    /// Largest coupling with another state, and which; (pivot, 0) where there is none.
    pub fn strongest(&self) -> (usize, T) {
        let mut best = (self.pivot, T::zero());
        for (j, c) in self.coupling.iter().enumerate() {
            if j != self.pivot && *c > best.1 {
                best = (j, *c);
            }
        }
        best
    }

    /// States whose part, weighted by the prior, is at least `theta` of the largest; θ = 0 leaves every state that is
    /// in the row.
    pub fn kept(&self, theta: T) -> u64 {
        let mut largest = T::zero();
        for c in &self.coupling {
            if *c > largest {
                largest = *c;
            }
        }
        let mut set = 0;
        for (j, c) in self.coupling.iter().enumerate() {
            if *c > T::zero() && *c >= theta * largest {
                set |= 1 << (j & 63);
            }
        }
        set
    }

    /// The row holds its pivot and nothing else.
    pub fn strict(&self) -> bool {
        self.kept(T::zero()) == 1 << (self.pivot & 63)
    }

    /// The row holds its pivot and, prior-weighted, nothing else that reaches `theta` of it.
    pub fn prior_weighted(&self, theta: T) -> bool {
        self.kept(theta) == 1 << (self.pivot & 63)
    }
}

/// Row `row` of the elimination, from 0, in the order of acceptance.
pub fn combination<T: Real, const N: usize, const M: usize>(
    staged: &Staged<T, N, M>,
    row: usize,
) -> Option<Combination<T, N>> {
    let pivot = staged.pivot(row)?;
    let u = staged.reduced(row)?;
    let (order, length) = staged.highest_order(row)?;
    let sigma = &staged.scale().sigma;
    let own = sigma.get(pivot).copied().unwrap_or(T::one());
    let mut coupling = [T::zero(); N];
    for (c, (x, s)) in coupling.iter_mut().zip(u.iter().zip(sigma)) {
        *c = (*x * *s / own).abs();
    }
    Some(Combination {
        pivot,
        order,
        // An accepted row has a part in P that is not zero; if it were, no degree could be told.
        degree: if length > T::zero() {
            T::one() / length
        } else {
            T::zero()
        },
        u,
        coupling,
    })
}

/// All rows.
pub fn combinations<T: Real, const N: usize, const M: usize>(
    staged: &Staged<T, N, M>,
) -> impl Iterator<Item = Combination<T, N>> + '_ {
    (0..staged.rank()).filter_map(|row| combination(staged, row))
}

/// The combination that a state stands for; `None` where it stands for none.
pub fn of_state<T: Real, const N: usize, const M: usize>(
    staged: &Staged<T, N, M>,
    state: usize,
) -> Option<Combination<T, N>> {
    let row = (0..staged.rank()).find(|row| staged.pivot(*row) == Some(state))?;
    combination(staged, row)
}

/// The closed form of order and degree of one state, for one segment.
///
/// ```text
/// order  = least k with e_j in the row space of [ T ; H ; H F ; … ; H Fᵏ ]
/// degree = 1 / ‖p_k‖,  p_k the shortest part of order k
/// ```
///
/// * `given`: kinds of states (one word of bits for each kind) of which the unobservable combinations are taken as known
///   (T): usually the gyro biases and the accelerometer biases, for "how well is heading seen if the bias combination
///   that nobody can see is as the prior says?". Empty for the strict form
/// * `staged`: the elimination of the same F and H, for T, scale and tolerance
///
/// Returns `None` where the state is not observable then. Independent of the elimination but for T: rows are made
/// orthogonal order by order, and the shortest p comes from singular values.
pub fn min_norm_degree<T: Real, const N: usize, const M: usize>(
    f: &SMatrix<T, N, N>,
    h: &SMatrix<T, M, N>,
    staged: &Staged<T, N, M>,
    given: &[u64],
    state: usize,
) -> Option<(u8, T)> {
    let scale = staged.scale();
    let mut basis = Basis::<T, N>::new();
    for row in known(staged, given).iter() {
        if dot(row, row) > T::zero() {
            basis.add(row, scale.tolerance);
        }
    }
    let unit = *scale.unit.get(state)?;
    let mut target = [T::zero(); N];
    *target.get_mut(state)? = T::one();
    let mut block = [[T::zero(); N]; M];
    for (row, source) in block.iter_mut().zip(h.row_iter()) {
        for ((x, entry), unit) in row.iter_mut().zip(source.iter()).zip(&scale.unit) {
            *x = *entry * *unit;
        }
    }
    // What the rows of this order have been divided by, and the unit of time to that power.
    let mut divided = T::one();
    let mut time = T::one();
    for order in 0..N {
        let mut rest = target;
        basis.project_out(&mut rest);
        let mut new = block;
        for row in &mut new {
            let length = dot(row, row);
            basis.project_out(row);
            if dot(row, row) <= scale.tolerance * scale.tolerance * length {
                *row = [T::zero(); N];
            }
        }
        // Columns of newᵀ are rotated until they are orthogonal: then column i is σ_i v_i.
        one_sided::rotate(&mut new, None);
        let mut largest = T::zero();
        for row in &new {
            let square = dot(row, row);
            if square > largest {
                largest = square;
            }
        }
        let mut left = rest;
        let mut p2 = T::zero();
        // Rows of one order may differ in unit by any factor: only rounding of the largest is nothing.
        let noise = T::of(4.0 * N as f64) * T::EPSILON;
        let small = noise * noise * largest;
        for row in &new {
            let square = dot(row, row);
            if square > small && square > T::zero() {
                let along = dot(&rest, row) / square;
                p2 += along * along;
                for (x, y) in left.iter_mut().zip(row) {
                    *x -= along * *y;
                }
            }
        }
        // e_j has length 1: what is left of it is rounding, or it is not in the row space.
        if p2 > T::zero() && dot(&left, &left) <= scale.tolerance * scale.tolerance {
            return Some((order as u8, T::one() / (p2.root() * unit * time * divided)));
        }
        let mut added = false;
        for row in &new {
            if dot(row, row) > small {
                added |= basis.add(row, scale.tolerance);
            }
        }
        if !added {
            return None;
        }
        let mut next = [[T::zero(); N]; M];
        let mut size = T::zero();
        for (row, into) in block.iter().zip(&mut next) {
            for ((sum, column), own) in into.iter_mut().zip(f.column_iter()).zip(&scale.unit) {
                for ((x, entry), unit) in row.iter().zip(column.iter()).zip(&scale.unit) {
                    *sum += *x * *entry / *unit;
                }
                *sum *= scale.time * *own;
                if sum.abs() > size {
                    size = sum.abs();
                }
            }
        }
        if size > T::zero() {
            let inverse = T::one() / size;
            for x in next.iter_mut().flatten() {
                *x *= inverse;
            }
            divided *= inverse;
        }
        block = next;
        time *= scale.time;
    }
    None
}

/// The unobservable combinations of some states, kind by kind: null space of Q seen in these coordinates, reduced until
/// every row has a state of its own, and then without the parts of other kinds. (An accelerometer bias that hides a tilt
/// takes the gyros along by the earth rate of that tilt; nobody means these when he speaks of that combination.)
fn known<T: Real, const N: usize, const M: usize>(
    staged: &Staged<T, N, M>,
    given: &[u64],
) -> [[T; N]; N] {
    let scale = staged.scale();
    let mask = given.iter().fold(0, |all, kind| all | kind);
    let mut rows = [[T::zero(); N]; N];
    for (free, row) in rows.iter_mut().enumerate() {
        if let Some(null) = null_vector(staged, free) {
            for (j, (x, y)) in row.iter_mut().zip(&null).enumerate() {
                if mask >> (j & 63) & 1 == 1 {
                    *x = *y;
                }
            }
        }
    }
    let mut done = 0u64;
    for _ in 0..N {
        let mut best = (T::zero(), 0, 0);
        for (i, row) in rows.iter().enumerate() {
            for (j, ((x, unit), sigma)) in row.iter().zip(&scale.unit).zip(&scale.sigma).enumerate()
            {
                let size = (*x * *unit / *sigma).abs();
                if done >> (i & 63) & 1 == 0 && size > best.0 {
                    best = (size, i, j);
                }
            }
        }
        let (size, at, pivot) = best;
        let Some(mut own) = rows.get(at).copied().filter(|_| size > T::zero()) else {
            break;
        };
        done |= 1 << (at & 63);
        let lead = own.get(pivot).copied().unwrap_or(T::one());
        for x in &mut own {
            *x /= lead;
        }
        for (i, row) in rows.iter_mut().enumerate() {
            if i == at {
                *row = own;
                continue;
            }
            let factor = row.get(pivot).copied().unwrap_or(T::zero());
            // What cancels is nothing: a dependent row must not come back as rounding.
            let length = dot(row, row);
            for (x, y) in row.iter_mut().zip(&own) {
                *x -= factor * *y;
            }
            if dot(row, row) <= scale.tolerance * scale.tolerance * length {
                *row = [T::zero(); N];
            }
            if let Some(x) = row.get_mut(pivot) {
                *x = T::zero();
            }
        }
        for row in rows.iter_mut().skip(at).take(1) {
            let kind = given.iter().find(|kind| *kind >> (pivot & 63) & 1 == 1);
            for (j, x) in row.iter_mut().enumerate() {
                if kind.is_none_or(|kind| kind >> (j & 63) & 1 == 0) {
                    *x = T::zero();
                }
            }
        }
    }
    rows
}

/// The unobservable vector that belongs to a state which is no pivot, in canonical units; `None` for a pivot.
pub(super) fn null_vector<T: Real, const N: usize, const M: usize>(
    staged: &Staged<T, N, M>,
    free: usize,
) -> Option<[T; N]> {
    if free >= N || staged.pivots() >> (free & 63) & 1 == 1 {
        return None;
    }
    let unit = &staged.scale().unit;
    let mut null = [T::zero(); N];
    for row in 0..staged.rank() {
        let (pivot, u) = (staged.pivot(row)?, staged.reduced(row)?);
        // Back to canonical units: u_can = u unit_j / unit_pivot.
        let x = *u.get(free)? * *unit.get(free)? / *unit.get(pivot)?;
        *null.get_mut(pivot)? = -x;
    }
    *null.get_mut(free)? = T::one();
    Some(null)
}
