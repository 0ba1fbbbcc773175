//! Maximum matchings of the bipartite graph BG(A, C): one of them, all of them, how many.

use super::bits::{at, bit, put, Bits};
use super::Pattern;
use super::TermRank;

/// A matching of states to what they act on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Matching<const N: usize> {
    /// Per state: the right node it is matched to; below 32 a state, from 32 on an output, 255 none.
    pub right: [u8; N],
}

impl<const N: usize> Matching<N> {
    /// Matched states.
    pub fn states(&self) -> u32 {
        let mut set = 0;
        for (j, right) in self.right.iter().enumerate() {
            if *right != u8::MAX {
                set |= bit(j);
            }
        }
        set
    }
}

/// Size ν of a maximum matching: generic rank of [C; A], and no more than that. It bounds the rank of the observability
/// matrix from above and differs from it where cycles or dilations are not seen (`branch_dilation`: ν 4, rank 3).
pub fn matching_size<const N: usize>(pattern: &Pattern<N>) -> usize {
    stack(pattern).rank()
}

/// Rows of C, then of A.
pub(super) fn stack<const N: usize>(pattern: &Pattern<N>) -> TermRank<N> {
    let mut rank = TermRank::new();
    for k in 0..pattern.outputs() {
        rank.add(pattern.output_row(k));
    }
    for i in 0..pattern.states() {
        rank.add(pattern.row(i));
    }
    rank
}

/// What one slice of an enumeration came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found<const N: usize> {
    /// The next maximum matching.
    Matching(Matching<N>),
    /// The budget is spent; call again.
    Pending,
    /// There is no other.
    End,
}

/// All maximum matchings, one after the other, in bounded slices.
///
/// Depth-first over the states; a branch ends where more states went unmatched than a maximum matching allows.
#[derive(Clone, Copy, Debug)]
pub struct Matchings<const N: usize> {
    pattern: Pattern<N>,
    right: [u8; N],
    /// Right nodes not tried yet, per state; bit 64 does not exist, so "unmatched" is remembered apart.
    left: [u64; N],
    may_skip: u32,
    used: u64,
    depth: usize,
    allowed: usize,
    skipped: usize,
    entered: bool,
    done: bool,
}

impl<const N: usize> Matchings<N> {
    /// Before the first one.
    pub fn new(pattern: &Pattern<N>) -> Self {
        Self {
            pattern: *pattern,
            right: [u8::MAX; N],
            left: [0; N],
            may_skip: 0,
            used: 0,
            depth: 0,
            allowed: pattern.states() - matching_size(pattern).min(pattern.states()),
            skipped: 0,
            entered: false,
            done: false,
        }
    }

    /// Goes on until the next matching or for `budget` steps; a step is one edge of the search.
    pub fn next(&mut self, budget: usize) -> Found<N> {
        for _ in 0..budget {
            if self.done {
                return Found::End;
            }
            if self.depth == self.pattern.states() {
                let found = Matching { right: self.right };
                self.back();
                return Found::Matching(found);
            }
            if !self.entered {
                let edges = u64::from(self.pattern.to(self.depth))
                    | u64::from(self.pattern.out(self.depth)) << 32;
                put(&mut self.left, self.depth, edges);
                self.may_skip |= bit(self.depth);
                self.entered = true;
            }
            let open = at(&self.left, self.depth, 0);
            let free = open & !self.used;
            if free != 0 {
                let r = free.trailing_zeros();
                // Those below are used and may be free again only after going back, where they are set anew.
                put(&mut self.left, self.depth, open & !(1 << r));
                put(&mut self.right, self.depth, r as u8);
                self.used |= 1 << r;
                self.depth += 1;
                self.entered = false;
            } else if self.may_skip & bit(self.depth) != 0 && self.skipped < self.allowed {
                self.may_skip &= !bit(self.depth);
                put(&mut self.left, self.depth, 0);
                put(&mut self.right, self.depth, u8::MAX);
                self.skipped += 1;
                self.depth += 1;
                self.entered = false;
            } else {
                self.back();
            }
        }
        if self.done {
            Found::End
        } else {
            Found::Pending
        }
    }

    /// Gives back what the state before has.
    fn back(&mut self) {
        if self.depth == 0 {
            self.done = true;
            return;
        }
        self.depth -= 1;
        self.entered = true;
        match at(&self.right, self.depth, u8::MAX) {
            u8::MAX => self.skipped -= self.skipped.min(1),
            r => self.used &= !(1 << (r & 63)),
        }
        put(&mut self.right, self.depth, u8::MAX);
    }

    /// How many there are, up to `most`, within `budget` steps; `None` where the budget did not suffice.
    pub fn count(mut self, most: usize, budget: usize) -> Option<usize> {
        let mut count = 0;
        for _ in 0..budget {
            match self.next(1) {
                Found::Matching(_) => count += 1,
                Found::End => return Some(count),
                Found::Pending => {}
            }
            if count >= most {
                return Some(count);
            }
        }
        None
    }
}

/// Outputs and states of a set, for drawing: pairs (state, right node) of one maximum matching.
pub fn maximum_matching<const N: usize>(pattern: &Pattern<N>) -> Matching<N> {
    let mut right = [u8::MAX; N];
    let mut owner = [u8::MAX; 64];
    for start in Bits(pattern.all()) {
        let mut from = [u8::MAX; 64];
        let (mut seen, mut queue) = (0u64, bit(start));
        'search: while queue != 0 {
            let j = queue.trailing_zeros() as usize;
            queue &= queue - 1;
            let mut edges = (u64::from(pattern.to(j)) | u64::from(pattern.out(j)) << 32) & !seen;
            seen |= edges;
            while edges != 0 {
                let mut r = edges.trailing_zeros() as usize;
                edges &= edges - 1;
                put(&mut from, r, j as u8);
                match at(&owner, r, u8::MAX) {
                    u8::MAX => {
                        for _ in 0..64 {
                            let j = usize::from(at(&from, r, u8::MAX));
                            let old = at(&right, j, u8::MAX);
                            put(&mut right, j, r as u8);
                            put(&mut owner, r, j as u8);
                            if old == u8::MAX {
                                break;
                            }
                            r = usize::from(old);
                        }
                        break 'search;
                    }
                    next => queue |= bit(usize::from(next)),
                }
            }
        }
    }
    Matching { right }
}
