//! The system digraph: which states act on which, and which outputs see which.

use nalgebra::{SMatrix, SVector};

use super::bits::{at, bit, first, Bits};
use crate::error::Error;
use crate::linalg::Real;
use crate::observability::vector::each_element;

/// Most states that a pattern holds, and most outputs.
pub const MAX_STATES: usize = 32;

/// Zero pattern of (A, C) as a digraph: x_j → x_i where A[i][j] ≠ 0, x_j → y_k where C[k][j] ≠ 0.
///
/// `N` is the room (at most 32 states); a pattern may have fewer states than that. Sets of states are words, bit 0 the
/// first state. Source: "system digraph" of the graph-theoretic analysis, section 2.1 (edges run from cause to effect;
/// its Lemma 2 prints them the other way round).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pattern<const N: usize> {
    to: [u32; N],
    out: [u32; N],
    states: u8,
    outputs: u8,
}

impl<const N: usize> Pattern<N> {
    /// A graph without edges.
    ///
    /// [`Error::Size`] where there is no state or no output, more than 32 of either, or more states than room.
    pub const fn new(states: usize, outputs: usize) -> Result<Self, Error> {
        if states == 0 || outputs == 0 || states > N || states > MAX_STATES || outputs > MAX_STATES
        {
            return Err(Error::Size);
        }
        Ok(Self {
            to: [0; N],
            out: [0; N],
            states: states as u8,
            outputs: outputs as u8,
        })
    }

    /// From one word per state: bit i < n says that it acts on state i, bit n + k that output k sees it.
    ///
    /// [`Error::OutOfRange`] where a word has a bit beyond the outputs; sizes as in [`Pattern::new`].
    pub fn from_adjacency(words: &[u64], outputs: usize) -> Result<Self, Error> {
        let mut pattern = Self::new(words.len(), outputs)?;
        let n = words.len() as u32;
        for ((word, to), out) in words.iter().zip(&mut pattern.to).zip(&mut pattern.out) {
            let seen = word.checked_shr(n).unwrap_or(0);
            if seen > u64::from(first(outputs)) {
                return Err(Error::OutOfRange);
            }
            *to = *word as u32 & first(words.len());
            *out = seen as u32;
        }
        Ok(pattern)
    }

    /// From numbers: an entry is an edge where its size in σ0 units exceeds `relative` times the largest of its row.
    ///
    /// * `f`, `h`: the model in any units
    /// * `sigma`: prior standard deviation of each state, so that entries of one row can be compared
    /// * `relative`: 0 takes every entry that is not exactly zero; 1e-9 drops what rounding leaves of cos 90°
    /// * `markov`: states whose self-loop is a Gauss-Markov decay −1/τ. It counts as zero: as free parameters five such
    ///   loops would make every bias "observable" (structural rank 10 of the 10-state alignment model, true rank 7)
    ///
    /// [`Error::NonFinite`] for NaN or ∞ anywhere, [`Error::OutOfRange`] for σ ≤ 0 or a negative threshold.
    pub fn from_model<T: Real, const M: usize>(
        f: &SMatrix<T, N, N>,
        h: &SMatrix<T, M, N>,
        sigma: &SVector<T, N>,
        relative: T,
        markov: u32,
    ) -> Result<Self, Error> {
        let mut pattern = Self::new(N, M)?;
        let finite = |x: &T| x.finite();
        if !(f.iter().all(finite) && h.iter().all(finite) && sigma.iter().all(finite)) {
            return Err(Error::NonFinite);
        }
        if sigma.iter().any(|s| *s <= T::zero()) || relative < T::zero() || !relative.finite() {
            return Err(Error::OutOfRange);
        }
        for (i, row) in f.row_iter().enumerate() {
            for (j, to) in Edges::of(row.iter(), sigma, relative).zip(&mut pattern.to) {
                if j {
                    *to |= bit(i);
                }
            }
        }
        for (k, row) in h.row_iter().enumerate() {
            for (j, out) in Edges::of(row.iter(), sigma, relative).zip(&mut pattern.out) {
                if j {
                    *out |= bit(k);
                }
            }
        }
        Ok(pattern.without_self_loops(markov))
    }

    /// The same without x_j → x_j for these states.
    pub fn without_self_loops(mut self, states: u32) -> Self {
        for (j, to) in self.to.iter_mut().enumerate() {
            *to &= !(bit(j) & states);
        }
        self
    }

    /// The same without these states: their edges vanish, their numbers stay.
    pub fn without(mut self, states: u32) -> Self {
        for (j, (to, out)) in self.to.iter_mut().zip(&mut self.out).enumerate() {
            if bit(j) & states != 0 {
                (*to, *out) = (0, 0);
            }
            *to &= !states;
        }
        self
    }

    /// All edges of either; sizes are those of `self`.
    pub fn union(mut self, other: &Self) -> Self {
        for (to, more) in self.to.iter_mut().zip(&other.to) {
            *to |= more;
        }
        for (out, more) in self.out.iter_mut().zip(&other.out) {
            *out |= more;
        }
        self
    }

    /// x_from acts on x_to. [`Error::OutOfRange`] for a state that is not there.
    pub fn connect(&mut self, from: usize, to: usize) -> Result<(), Error> {
        let there = from < self.states() && to < self.states();
        match self.to.get_mut(from) {
            Some(edges) if there => {
                *edges |= bit(to);
                Ok(())
            }
            _ => Err(Error::OutOfRange),
        }
    }

    /// Output sees x_state. [`Error::OutOfRange`] for a state or an output that is not there.
    pub fn observe(&mut self, state: usize, output: usize) -> Result<(), Error> {
        let there = state < self.states() && output < self.outputs();
        match self.out.get_mut(state) {
            Some(edges) if there => {
                *edges |= bit(output);
                Ok(())
            }
            _ => Err(Error::OutOfRange),
        }
    }

    /// Number of states, n.
    pub const fn states(&self) -> usize {
        self.states as usize
    }

    /// Number of outputs, m.
    pub const fn outputs(&self) -> usize {
        self.outputs as usize
    }

    /// All states.
    pub const fn all(&self) -> u32 {
        first(self.states as usize)
    }

    /// States that x_j acts on.
    pub fn to(&self, j: usize) -> u32 {
        at(&self.to, j, 0)
    }

    /// Outputs that see x_j.
    pub fn out(&self, j: usize) -> u32 {
        at(&self.out, j, 0)
    }

    /// States that act on x_i: row i of A.
    pub fn row(&self, i: usize) -> u32 {
        column(&self.to, i)
    }

    /// States that output k sees: row k of C.
    pub fn output_row(&self, k: usize) -> u32 {
        column(&self.out, k)
    }

    /// States from which a directed path leads to an output.
    pub fn reach(&self) -> u32 {
        let mut reach = 0;
        for (j, out) in self.out.iter().enumerate() {
            if *out != 0 {
                reach |= bit(j);
            }
        }
        loop {
            let before = reach;
            for j in Bits(self.all() & !reach) {
                if self.to(j) & reach != 0 {
                    reach |= bit(j);
                }
            }
            if reach == before {
                return reach;
            }
        }
    }
}

/// Bit i of every word, the first word's first.
fn column<const N: usize>(words: &[u32; N], i: usize) -> u32 {
    let mut column = 0;
    macro_rules! element {
        ($j:expr) => {
            if let Some(word) = words.get($j) {
                column |= (word >> (i & 31) & 1) << $j;
            }
        };
    }
    each_element!(N, element);
    column
}

/// Which entries of a row are edges.
struct Edges;

impl Edges {
    fn of<'a, T: Real, const N: usize>(
        row: impl Iterator<Item = &'a T> + Clone + 'a,
        sigma: &'a SVector<T, N>,
        relative: T,
    ) -> impl Iterator<Item = bool> + 'a {
        let size = row.zip(sigma.iter()).map(|(x, s)| (*x * *s).abs());
        let mut largest = T::zero();
        for x in size.clone() {
            if x > largest {
                largest = x;
            }
        }
        size.map(move |x| x > relative * largest)
    }
}
