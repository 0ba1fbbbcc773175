//! Generic dimension d: states covered by disjoint output stems and cycles.

use super::bits::{at, bit, put, Bits};
use super::Pattern;

/// Nobody.
const NONE: u8 = u8::MAX;
/// Outputs follow the 32 state copies among the right nodes.
const OUTPUT: usize = 32;
/// Right nodes.
const RIGHT: usize = 64;

/// A largest cover of the output-reachable states by disjoint stems (paths that end in an output) and cycles.
///
/// Its size d is the generic rank of the observability matrix [C; CA; …; CAⁿ⁻¹] (Hosoe 1980), and with span n the
/// linking of the dynamic graph. Solved as an assignment in which every state takes a right node, its successor (weight
/// 1) or itself (weight 0, not covered): one state after the other is inserted along the best alternating path.
#[derive(Clone, Copy, Debug)]
pub struct Cover<const N: usize> {
    reach: u32,
    covered: u32,
    right: [u8; N],
    owner: [u8; RIGHT],
}

/// What comes after a state in the cover.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// It is not covered.
    Nothing,
    /// This state.
    State(usize),
    /// This output: the stem ends.
    Output(usize),
}

/// Successors of a state as bits of the right nodes.
fn real<const N: usize>(pattern: &Pattern<N>, reach: u32, j: usize) -> u64 {
    u64::from(pattern.to(j) & reach) | u64::from(pattern.out(j)) << OUTPUT
}

struct Bits64(u64);

impl Iterator for Bits64 {
    type Item = usize;
    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        if self.0 == 0 {
            return None;
        }
        let at = self.0.trailing_zeros();
        self.0 &= self.0 - 1;
        Some(at as usize)
    }
}

impl<const N: usize> Cover<N> {
    /// The largest cover.
    pub fn new(pattern: &Pattern<N>) -> Self {
        let mut cover = Self {
            reach: pattern.reach(),
            covered: 0,
            right: [NONE; N],
            owner: [NONE; RIGHT],
        };
        for j in Bits(cover.reach) {
            cover.insert(pattern, j);
        }
        cover
    }

    /// Generic dimension d of the observable subspace.
    pub const fn size(&self) -> usize {
        self.covered.count_ones() as usize
    }

    /// States that are covered: one basis of the observable subspace, a choice and no property.
    pub const fn states(&self) -> u32 {
        self.covered
    }

    /// Output-reachable states.
    pub const fn reach(&self) -> u32 {
        self.reach
    }

    /// What comes after a state in its stem or cycle.
    pub fn next(&self, j: usize) -> Next {
        if self.covered & bit(j) == 0 {
            return Next::Nothing;
        }
        match usize::from(at(&self.right, j, NONE)) {
            k @ OUTPUT..RIGHT => Next::Output(k - OUTPUT),
            i => Next::State(i),
        }
    }

    fn weight(&self, j: usize) -> i8 {
        i8::from(self.covered & bit(j) != 0)
    }

    /// Gives state `new` a right node along the path that gains most; the weight rises by 0 or 1.
    fn insert(&mut self, pattern: &Pattern<N>, new: usize) {
        let mut best = [i8::MIN; RIGHT];
        let mut from = [NONE; RIGHT];
        let mut is_real = 0u64;
        let mut dirty = bit(new);
        // The matching so far is optimal, so no cycle gains and the passes end: each raises a gain, none above 1.
        while dirty != 0 {
            let j = dirty.trailing_zeros() as usize;
            dirty &= dirty - 1;
            let base = if j == new {
                0
            } else {
                at(&best, usize::from(at(&self.right, j, NONE)), 0) - self.weight(j)
            };
            let edges = real(pattern, self.reach, j);
            for r in Bits64(edges | 1 << j) {
                let covers = edges >> r & 1;
                let gain = base + covers as i8;
                if gain <= at(&best, r, 0) {
                    continue;
                }
                put(&mut best, r, gain);
                put(&mut from, r, j as u8);
                is_real = is_real & !(1 << r) | covers << r;
                let owner = at(&self.owner, r, NONE);
                if owner != NONE {
                    dirty |= bit(usize::from(owner));
                } else if gain > 0 {
                    self.apply(&from, is_real, new, r);
                    return;
                }
            }
        }
        let mut end = usize::from(NONE);
        let mut most = i8::MIN;
        for (r, (gain, owner)) in best.iter().zip(&self.owner).enumerate() {
            if *owner == NONE && *gain > most {
                (end, most) = (r, *gain);
            }
        }
        self.apply(&from, is_real, new, end);
    }

    /// Moves the states along the path that ends in the free right node `r`.
    fn apply(&mut self, from: &[u8; RIGHT], is_real: u64, new: usize, mut r: usize) {
        // A path visits no right node twice.
        for _ in 0..RIGHT {
            let j = usize::from(at(from, r, NONE));
            let old = at(&self.right, j, NONE);
            put(&mut self.right, j, r as u8);
            put(&mut self.owner, r, j as u8);
            if is_real >> (r & 63) & 1 == 1 {
                self.covered |= bit(j);
            } else {
                self.covered &= !bit(j);
            }
            if j == new || old == NONE {
                return;
            }
            r = usize::from(old);
        }
    }

    /// States that can be reconstructed alone: d does not grow when one of them gets an output of its own.
    ///
    /// One pass finds what every right node would be worth if it became free; a covered state whose successor nobody
    /// could use is in every largest linking.
    pub fn unique(&self, pattern: &Pattern<N>) -> u32 {
        let mut gain = [0i8; RIGHT];
        let mut dirty = self.reach;
        while dirty != 0 {
            let j = dirty.trailing_zeros() as usize;
            dirty &= dirty - 1;
            let base = at(&gain, usize::from(at(&self.right, j, NONE)), 0) - self.weight(j);
            let edges = real(pattern, self.reach, j);
            for r in Bits64(edges | 1 << j) {
                let worth = base + (edges >> r & 1) as i8;
                if worth > at(&gain, r, i8::MAX) {
                    put(&mut gain, r, worth);
                    let owner = at(&self.owner, r, NONE);
                    if owner != NONE {
                        dirty |= bit(usize::from(owner));
                    }
                }
            }
        }
        let mut unique = 0;
        for j in Bits(self.covered) {
            if at(&gain, usize::from(at(&self.right, j, NONE)), 1) == 0 {
                unique |= bit(j);
            }
        }
        unique
    }
}
