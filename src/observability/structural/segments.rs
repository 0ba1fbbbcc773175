//! Several segments: a piecewise constant system and what a manoeuvre can add.

use super::bits::{at, bit, put, Bits};
use super::cover::Cover;
use super::groups::Groups;
use super::linking::MAX_SEGMENTS;
use super::matching::stack;
use super::{Pattern, TermRank};
use crate::error::Error;

use nalgebra::SMatrix;

use crate::linalg::Real;

/// Rows of A that a later segment changes, and at which columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Changes<const N: usize> {
    /// Per row: the columns whose entry differs from that of the first segment.
    pub rows: [u32; N],
}

impl<const N: usize> Changes<N> {
    /// Where two matrices differ by more than `relative` of the larger of the two entries.
    ///
    /// [`Error::NonFinite`] for NaN or ∞.
    pub fn between<T: Real>(
        a: &SMatrix<T, N, N>,
        first: &SMatrix<T, N, N>,
        relative: T,
    ) -> Result<Self, Error> {
        let mut rows = [0; N];
        for ((row, ours), theirs) in rows.iter_mut().zip(a.row_iter()).zip(first.row_iter()) {
            for (j, (x, y)) in ours.iter().zip(theirs.iter()).enumerate() {
                if !(x.finite() && y.finite()) {
                    return Err(Error::NonFinite);
                }
                let size = if x.abs() > y.abs() { x.abs() } else { y.abs() };
                if (*x - *y).abs() > relative * size {
                    *row |= bit(j);
                }
            }
        }
        Ok(Self { rows })
    }
}

/// The structural bound D of a piecewise constant system, segment by segment.
///
/// ```text
/// D = term rank of [ C ; A_1 ; A_2 − A_1 ; … ; A_r − A_1 ]   on the states reachable in the union graph
/// ```
///
/// A new row counts only where the matrix really changed, so gravity and earth rate are not counted again; and a change
/// of value counts although the zero pattern stays (a turn, or the fifth segment of the alignment example). A vector
/// that C and all A_k take to zero is never seen, therefore D is *an upper bound* for the rank of the stripped and of
/// the total observability matrix; it is the rank where the premise holds and entries are independent.
#[derive(Clone, Copy, Debug)]
pub struct Segments<const N: usize> {
    union: Pattern<N>,
    first: Pattern<N>,
    changes: [Changes<N>; MAX_SEGMENTS],
    len: usize,
}

/// What the bound says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bound<const N: usize> {
    /// States from which a path leads to an output in some segment.
    pub reach: u32,
    /// D, an upper bound for the rank.
    pub bound: usize,
    /// States in every matching of that size: individually observable where the premise holds.
    pub always: u32,
    /// What is coupled within the bound.
    pub groups: Groups<N>,
    /// Whether null(Q_k) ⊂ null(A_k) generically in every segment, on the reachable states (Lemma 4). Where it fails, the
    /// bound still holds, and the total matrix may see more than the stripped one.
    pub premise: bool,
}

impl<const N: usize> Segments<N> {
    /// The first segment.
    pub fn new(first: &Pattern<N>) -> Self {
        Self {
            union: *first,
            first: *first,
            changes: [Changes { rows: [0; N] }; MAX_SEGMENTS],
            len: 1,
        }
    }

    /// A later segment and where its A differs from the first one's.
    ///
    /// [`Error::Size`] for a ninth segment or another number of states or outputs; nothing is changed then.
    pub fn add(&mut self, pattern: &Pattern<N>, changes: &Changes<N>) -> Result<(), Error> {
        let fits = pattern.states() == self.first.states()
            && pattern.outputs() == self.first.outputs()
            && self.len < MAX_SEGMENTS;
        if !fits {
            return Err(Error::Size);
        }
        put(&mut self.changes, self.len, *changes);
        self.len += 1;
        self.union = self.union.union(pattern);
        Ok(())
    }

    /// Number of segments.
    pub const fn count(&self) -> usize {
        self.len
    }

    /// All edges of all segments.
    pub const fn union(&self) -> &Pattern<N> {
        &self.union
    }

    /// The bound D. `patterns`: the segments as they were added, for the premise.
    pub fn bound(&self, patterns: &[Pattern<N>]) -> Bound<N> {
        let reach = self.union.reach();
        let mut rank = stack(&self.first.without(!reach));
        for changes in self.changes.iter().take(self.len) {
            for i in Bits(reach) {
                let row = at(&changes.rows, i, 0) & reach;
                if row != 0 {
                    rank.add(row);
                }
            }
        }
        Bound {
            reach,
            bound: rank.rank(),
            always: rank.always(reach),
            groups: Groups::of_columns(&rank, reach),
            premise: patterns
                .iter()
                .all(|p| stack(&p.without(!reach)).rank() == Cover::new(p).size()),
        }
    }
}

/// Maximum matching of the generalised bipartite graph, right copies shared by all segments: how the paper's text
/// defines it. No more than the rows with an edge, so it cannot see what a manoeuvre adds.
pub fn matching_shared<const N: usize>(segments: &[Pattern<N>]) -> usize {
    let mut all = segments.iter();
    let Some(first) = all.next() else {
        return 0;
    };
    stack(&all.fold(*first, |union, p| union.union(p))).rank()
}

/// The same with right copies of its own for each segment; an over-estimate where segments repeat parameters.
pub fn matching_separate<const N: usize>(segments: &[Pattern<N>]) -> usize {
    let mut rank = TermRank::<N>::new();
    for pattern in segments {
        for k in 0..pattern.outputs() {
            rank.add(pattern.output_row(k));
        }
        for i in 0..pattern.states() {
            rank.add(pattern.row(i));
        }
    }
    rank.rank()
}

/// The states of a set with their numbers, smallest first.
pub fn members(set: u32) -> impl Iterator<Item = usize> {
    Bits(set)
}

/// Whether a set holds a state.
pub fn holds(set: u32, state: usize) -> bool {
    set & bit(state) != 0
}
