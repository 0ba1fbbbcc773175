//! Rank of the observability matrices of a piecewise constant system, by staged elimination.
//!
//! ```text
//! stripped  [ Q_1 ; Q_2 ; … ; Q_r ],    total  [ Q_1 ; Q_2 Φ_1 ; Q_3 Φ_2 Φ_1 ; … ],    Q_k = [ H ; H F_k ; … ; H F_kⁿ⁻¹ ]
//! ```
//!
//! Neither is formed. Rows H Fᵏ come one at a time, lowest order first, in canonical units and with their length kept
//! near 1 by a power of two; each is reduced by those before it, and what is left is a new row or nothing. A chain of
//! rows ends where it adds nothing to its own segment, so the orders used are 0 … 3 for an inertial navigator.
//!
//! Sources: Goshen-Meskin and Bar-Itzhack 1992 (both matrices); Peng 2016 Fig. 3, rebuilt (the elimination). Ranks,
//! f32 and f64: `host-tests/tests/pwcs.rs`.

mod rows;
mod scale;

pub use scale::{Kind, Scale, NAVIGATION};

use nalgebra::SMatrix;

use crate::error::Error;
use crate::linalg::Real;
use crate::observability::vector::{self, dot};
use rows::{get, normalise, subtract, Rows};

/// Largest number of states, so that an index fits the tables.
const MOST: usize = 64;

/// Where an accepted row H Fᵏ comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Origin {
    /// Segment, from 0.
    pub segment: u8,
    /// Order k: derivatives of the measurement.
    pub order: u8,
    /// Row of H.
    pub row: u8,
    /// The row was stored divided by two to this power.
    exponent: i16,
}

const NOWHERE: Origin = Origin {
    segment: 0,
    order: 0,
    row: 0,
    exponent: 0,
};

/// What a slice came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Progress {
    /// There is more to do.
    Working,
    /// This segment is finished.
    Done,
}

/// Staged elimination of a growing observability matrix of `N` states and measurements of `M` rows.
///
/// Memory for N = 15, M = 6 in f32: see `BENCHMARKS.md`. Segments are added as the vehicle manoeuvres, and a long
/// elimination may be cut into slices with [`Staged::step`]: one row operation each.
#[derive(Clone, Copy, Debug)]
pub struct Staged<T: Real, const N: usize, const M: usize> {
    scale: Scale<T, N>,
    weight: [T; N],
    rows: Rows<T, N>,
    /// How each row is put together from the accepted H Fᵏ.
    p: [[T; N]; N],
    origin: [Origin; N],
    /// Rows of this segment alone: they say when its chains end.
    own: Rows<T, N>,
    chain: [[T; N]; M],
    exponent: [i16; M],
    alive: u64,
    order: u8,
    next: usize,
    segments: u8,
    work: Work<T, N>,
}

/// The row under work and what comes next for it.
#[derive(Clone, Copy, Debug)]
struct Work<T, const N: usize> {
    phase: Phase,
    /// Row of H.
    m: usize,
    /// The row, partly reduced.
    row: [T; N],
    /// How it is put together from the accepted H Fᵏ.
    q: [T; N],
    /// Its length squared before the reduction.
    length: T,
    /// Next accepted row of the current operation.
    at: usize,
    /// It was new to its segment.
    fresh: bool,
}

/// What a slice does: the matrices are looked at once a segment; then each row is taken, reduced and cleared among all
/// segments' rows, likewise among this segment's own, and followed by the next of its chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    CheckModel,
    CheckTransition,
    Next,
    Reduce,
    Clear { pivot: u8 },
    ReduceOwn,
    ClearOwn { pivot: u8 },
    Derive,
}

impl<T: Real, const N: usize, const M: usize> Staged<T, N, M> {
    /// Nothing measured yet.
    ///
    /// [`Error::NonFinite`], or [`Error::OutOfRange`] for a unit, σ or tolerance that is not positive, or more than 64
    /// states or rows, or none.
    pub fn new(scale: &Scale<T, N>) -> Result<Self, Error> {
        scale.check()?;
        if M == 0 || M > MOST {
            return Err(Error::OutOfRange);
        }
        let mut weight = [T::one(); N];
        for (w, (sigma, unit)) in weight.iter_mut().zip(scale.sigma.iter().zip(&scale.unit)) {
            *w = *sigma / *unit;
        }
        Ok(Self {
            scale: *scale,
            weight,
            rows: Rows::new(),
            p: [[T::zero(); N]; N],
            origin: [NOWHERE; N],
            own: Rows::new(),
            chain: [[T::zero(); N]; M],
            exponent: [0; M],
            alive: 0,
            order: 0,
            next: 0,
            segments: 0,
            work: Work {
                phase: Phase::CheckModel,
                m: 0,
                row: [T::zero(); N],
                q: [T::zero(); N],
                length: T::zero(),
                at: 0,
                fresh: false,
            },
        })
    }

    /// Starts a segment with measurement matrix `h`, M × N, in the units of the states.
    ///
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] after 255 segments. Nothing is changed then.
    pub fn begin(&mut self, h: &SMatrix<T, M, N>) -> Result<(), Error> {
        if !h.data.0.iter().all(vector::finite) {
            return Err(Error::NonFinite);
        }
        if self.segments == u8::MAX {
            return Err(Error::OutOfRange);
        }
        self.segments += 1;
        self.own.clear();
        self.order = 0;
        self.next = 0;
        self.work.phase = Phase::CheckModel;
        self.alive = if M >= 64 { u64::MAX } else { (1 << M) - 1 };
        for (m, (row, exponent)) in self.chain.iter_mut().zip(&mut self.exponent).enumerate() {
            *row = vector::row(h, m);
            vector::combine(row, &self.scale.unit, |entry, unit| entry * unit);
            *exponent = normalise(row);
            if dot(row, row) == T::zero() {
                self.alive &= !(1 << (m & 63));
            }
        }
        Ok(())
    }

    /// One slice of the segment that was begun: one row operation, at most N² products.
    ///
    /// * `f`: F of this segment, the same at every step
    /// * `before`: Φ from the start of the first segment to the start of this one, for the total matrix; `None` for the
    ///   stripped matrix, and in the first segment
    ///
    /// [`Error::NonFinite`] where a number of F or Φ is; the elimination is unchanged then.
    pub fn step(
        &mut self,
        f: &SMatrix<T, N, N>,
        before: Option<&SMatrix<T, N, N>>,
    ) -> Result<Progress, Error> {
        match self.work.phase {
            Phase::CheckModel => {
                finite(f)?;
                self.work.phase = match before {
                    Some(_) => Phase::CheckTransition,
                    None => Phase::Next,
                };
            }
            Phase::CheckTransition => {
                before.map_or(Ok(()), finite)?;
                self.work.phase = Phase::Next;
            }
            Phase::Next => {
                if self.alive == 0 {
                    return Ok(Progress::Done);
                }
                self.take(before);
            }
            Phase::Reduce => self.reduce(),
            Phase::Clear { pivot } => self.clear(usize::from(pivot)),
            Phase::ReduceOwn => self.reduce_own(),
            Phase::ClearOwn { pivot } => self.clear_own(usize::from(pivot)),
            Phase::Derive => self.derive(f),
        }
        Ok(if self.alive == 0 {
            Progress::Done
        } else {
            Progress::Working
        })
    }

    /// A whole segment in one call. Errors as [`Staged::begin`] and [`Staged::step`].
    pub fn segment(
        &mut self,
        f: &SMatrix<T, N, N>,
        h: &SMatrix<T, M, N>,
        before: Option<&SMatrix<T, N, N>>,
    ) -> Result<(), Error> {
        finite(f)?;
        before.map_or(Ok(()), finite)?;
        self.begin(h)?;
        self.work.phase = Phase::Next;
        // Every chain has at most N rows, and every row four passes over at most N others.
        for _ in 0..N * M * (4 * N + 6) {
            if self.step(f, before)? == Progress::Done {
                break;
            }
        }
        Ok(())
    }

    /// The next row H Fᵏ comes under work, moved to the start by `before`.
    fn take(&mut self, before: Option<&SMatrix<T, N, N>>) {
        // A living chain is found within two rounds.
        for _ in 0..=2 * M {
            if self.next >= M {
                self.next = 0;
                self.order = self.order.saturating_add(1);
            }
            self.work.m = self.next;
            self.next += 1;
            if self.alive >> (self.work.m & 63) & 1 == 1 {
                break;
            }
        }
        if let Some(row) = self.chain.get(self.work.m) {
            match before {
                None => self.work.row.copy_from_slice(row),
                Some(phi) => self.work.row = self.times(row, phi, T::one()),
            }
        }
        self.work.q = [T::zero(); N];
        if let Some(own) = self.work.q.get_mut(self.rows.len) {
            *own = T::one();
        }
        self.work.length = dot(&self.work.row, &self.work.row);
        self.work.at = 0;
        self.work.fresh = false;
        self.work.phase = Phase::Reduce;
        if self.rows.len >= N {
            self.go_on_own();
        }
    }

    /// The row less one of the accepted ones; after the last, whether something new is left.
    fn reduce(&mut self) {
        let work = &mut self.work;
        if let Some((a, factor)) = self.rows.next_factor(&work.row, work.at) {
            self.rows.reduce_by(&mut work.row, a, factor);
            if let Some(p) = self.p.get(a) {
                subtract(&mut work.q, factor, p);
            }
            work.at = a + 1;
            return;
        }
        let tolerance = self.scale.tolerance;
        work.fresh = dot(&work.row, &work.row) > tolerance * tolerance * work.length;
        work.at = 0;
        if !work.fresh {
            return self.go_on_own();
        }
        let (pivot, inverse) = Rows::choose(&mut work.row, &self.weight);
        vector::scale(&mut work.q, inverse);
        work.phase = Phase::Clear { pivot: pivot as u8 };
    }

    /// Clears the new pivot's column in one of the accepted rows; after the last, takes the row in.
    fn clear(&mut self, pivot: usize) {
        let work = &mut self.work;
        if let Some((a, factor)) = self.rows.next_to_clear(pivot, work.at) {
            self.rows.clear_in(a, factor, &work.row, pivot);
            if let Some(p) = self.p.get_mut(a) {
                subtract(p, factor, &work.q);
            }
            work.at = a + 1;
            return;
        }
        let place = (
            self.p.get_mut(self.rows.len),
            self.origin.get_mut(self.rows.len),
        );
        if let (Some(p), Some(origin)) = place {
            p.copy_from_slice(&work.q);
            *origin = Origin {
                segment: self.segments - 1,
                order: self.order,
                row: work.m as u8,
                exponent: get(&self.exponent, work.m, 0),
            };
        }
        self.rows.push(&work.row, pivot);
        self.go_on_own();
    }

    /// What follows the work on all segments' rows. In the first segment these are its own.
    fn go_on_own(&mut self) {
        if self.segments == 1 {
            self.work.phase = Phase::Derive;
            return;
        }
        if let Some(row) = self.chain.get(self.work.m) {
            self.work.row.copy_from_slice(row);
            self.work.length = dot(row, row);
        }
        self.work.at = 0;
        self.work.phase = Phase::ReduceOwn;
    }

    fn reduce_own(&mut self) {
        let work = &mut self.work;
        if let Some((a, factor)) = self.own.next_factor(&work.row, work.at) {
            self.own.reduce_by(&mut work.row, a, factor);
            work.at = a + 1;
            return;
        }
        let tolerance = self.scale.tolerance;
        work.fresh = dot(&work.row, &work.row) > tolerance * tolerance * work.length;
        work.at = 0;
        work.phase = if work.fresh {
            let (pivot, _) = Rows::choose(&mut work.row, &self.weight);
            Phase::ClearOwn { pivot: pivot as u8 }
        } else {
            Phase::Derive
        };
    }

    fn clear_own(&mut self, pivot: usize) {
        let work = &mut self.work;
        if let Some((a, factor)) = self.own.next_to_clear(pivot, work.at) {
            self.own.clear_in(a, factor, &work.row, pivot);
            work.at = a + 1;
        } else {
            self.own.push(&work.row, pivot);
            work.phase = Phase::Derive;
        }
    }

    /// The next row of the chain, where this one was new to its segment; otherwise the chain ends.
    fn derive(&mut self, f: &SMatrix<T, N, N>) {
        let m = self.work.m;
        self.work.phase = Phase::Next;
        let last = usize::from(self.order) + 1 >= N;
        if let Some(row) = self.chain.get(m).filter(|_| self.work.fresh && !last) {
            let mut next = self.times(row, f, self.scale.time);
            let more = normalise(&mut next);
            if let (Some(chain), Some(e)) = (self.chain.get_mut(m), self.exponent.get_mut(m)) {
                *chain = next;
                *e = e.saturating_add(more);
            }
            if dot(&next, &next) != T::zero() {
                return;
            }
        }
        self.alive &= !(1 << (m & 63));
    }

    /// A row in canonical units times a matrix in the states' own, times a factor.
    fn times(&self, row: &[T; N], matrix: &SMatrix<T, N, N>, factor: T) -> [T; N] {
        let mut product = vector::times(row, &self.scale.unit, matrix);
        vector::combine(&mut product, &self.scale.unit, |x, unit| {
            x * (factor * unit)
        });
        product
    }

    /// Rank so far.
    pub const fn rank(&self) -> usize {
        self.rows.len
    }

    /// Scale it was made with.
    pub const fn scale(&self) -> &Scale<T, N> {
        &self.scale
    }

    /// States that stand for a row (pivots), as bits.
    pub const fn pivots(&self) -> u64 {
        self.rows.taken
    }

    /// Where the accepted rows come from, in the order of acceptance.
    pub fn origins(&self) -> impl Iterator<Item = Origin> + '_ {
        self.origin.iter().copied().take(self.rows.len)
    }

    /// Pivot state of a reduced row.
    pub fn pivot(&self, row: usize) -> Option<usize> {
        (row < self.rows.len).then(|| usize::from(get(&self.rows.pivot, row, 0)))
    }

    /// A reduced row in the states' own units, its pivot 1: what is known jointly with that state.
    pub fn reduced(&self, row: usize) -> Option<[T; N]> {
        let pivot = self.pivot(row)?;
        let mut out = *self.rows.u.get(row)?;
        let own = get(&self.scale.unit, pivot, T::one());
        vector::combine(&mut out, &self.scale.unit, |x, unit| x * own / unit);
        Some(out)
    }

    /// Highest order in a reduced row, and how long its part of that order is: ‖p‖ in the units of the measurements, for
    /// the row with pivot 1 in the state's own unit.
    pub fn highest_order(&self, row: usize) -> Option<(u8, T)> {
        let pivot = self.pivot(row)?;
        let p = self.p.get(row)?;
        let mut order = 0;
        for (x, origin) in p.iter().zip(&self.origin) {
            if *x != T::zero() && origin.order > order {
                order = origin.order;
            }
        }
        let mut sum = T::zero();
        for (x, origin) in p.iter().zip(&self.origin) {
            if origin.order == order {
                // in two steps: an exponent may be beyond those of T
                let half = origin.exponent / 2;
                let part = *x * T::two_to(-half) * T::two_to(half - origin.exponent);
                sum += part * part;
            }
        }
        let mut length = sum.root();
        for _ in 0..order {
            length *= self.scale.time;
        }
        Some((order, length * get(&self.scale.unit, pivot, T::one())))
    }
}

fn finite<T: Real, const N: usize>(matrix: &SMatrix<T, N, N>) -> Result<(), Error> {
    if matrix.data.0.iter().all(vector::finite) {
        Ok(())
    } else {
        Err(Error::NonFinite)
    }
}
