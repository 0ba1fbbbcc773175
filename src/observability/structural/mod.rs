//! Structural observability: what the zero pattern alone decides, by graphs. Integers and bit sets only.
//!
//! Source: the graph-theoretic analysis of a strapdown alignment as a piecewise constant system (2020), with the
//! corrections of `docs/structural.md`. Numbers are *generic*: true for almost every choice of the non-zero entries, if
//! these are independent. Where entries repeat or depend on each other the structural number is an upper bound, and
//! says nothing about how much is seen. "Observable" is therefore always *structurally* observable here.
//!
//! | file | holds | answers |
//! |---|---|---|
//! | `pattern` | digraph, output reachability | who can be seen at all? |
//! | `matching` | ν, all maximum matchings of BG(A, C) | the rank of [C; A] |
//! | `cover` | d by stems and cycles, unique states | how many dimensions; which states alone? |
//! | `linking` | dynamic graph of a span, PWCS dynamic graph | with how many derivatives? |
//! | `groups` | exchange groups | what is known only jointly? |
//! | `term_rank`, `segments` | generalised bipartite graph, bound D | what can a manoeuvre add? |
//!
//! When: after a change of the pattern or of the segment, never per sample. [`Report::new`] needs no table of layers;
//! groups, linkings and enumerations do, and are apart.

mod bits;
mod cover;
mod groups;
mod linking;
mod matching;
mod pattern;
mod segments;
mod term_rank;

pub use cover::{Cover, Next};
pub use groups::Groups;
pub use linking::{Linking, MAX_SEGMENTS};
pub use matching::{matching_size, maximum_matching, Found, Matching, Matchings};
pub use pattern::{Pattern, MAX_STATES};
pub use segments::{holds, matching_separate, matching_shared, members, Bound, Changes, Segments};
pub use term_rank::TermRank;

/// What one segment's pattern decides. Sets of states are words, bit 0 the first state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Report {
    /// States from which a path leads to an output.
    pub reach: u32,
    /// ν, size of a maximum matching of BG(A, C): generic rank of [C; A].
    pub nu: u8,
    /// d, generic rank of the observability matrix: an upper bound for the rank where entries depend on each other.
    pub d: u8,
    /// States that can be reconstructed alone.
    pub unique: u32,
    /// States known only together with others.
    pub coupled: u32,
    /// States from which no path leads to an output.
    pub unseen: u32,
    /// ν = d: whatever is not seen stays at rest (premise of Lemma 4).
    pub premise: bool,
    /// All states reachable and ν = n (Lemma 1).
    pub observable: bool,
}

impl Report {
    /// Analyses one pattern.
    pub fn new<const N: usize>(pattern: &Pattern<N>) -> Self {
        let nu = matching_size(pattern);
        let cover = Cover::new(pattern);
        let (all, reach) = (pattern.all(), cover.reach());
        let unique = cover.unique(pattern);
        Self {
            reach,
            nu: nu as u8,
            d: cover.size() as u8,
            unique,
            coupled: reach & !unique,
            unseen: all & !reach,
            premise: nu == cover.size(),
            observable: reach == all && nu == pattern.states(),
        }
    }

    /// Which of the three a state is.
    pub fn class(&self, state: usize) -> Class {
        if holds(self.unique, state) {
            Class::Unique
        } else if holds(self.coupled, state) {
            Class::Coupled
        } else {
            Class::Unseen
        }
    }
}

/// What the structure says about one state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Class {
    /// It can be reconstructed alone.
    Unique,
    /// It is known only together with others.
    Coupled,
    /// No path leads from it to an output.
    Unseen,
}
