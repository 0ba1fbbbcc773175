//! Groups of coupled states: what is known only jointly.

use super::bits::{at, bit, put, Bits};
use super::{Linking, TermRank};

/// Disjoint sets of states that are coupled with each other, smallest member first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Groups<const N: usize> {
    sets: [u32; N],
    len: usize,
}

impl<const N: usize> Groups<N> {
    /// Joins circuits that share a state. A circuit of one state alone is not seen, and coupled with nobody.
    fn join(circuits: impl Iterator<Item = u32>) -> Self {
        let mut groups = Self {
            sets: [0; N],
            len: 0,
        };
        for circuit in circuits.filter(|circuit| circuit & (circuit - 1) != 0) {
            let mut joined = circuit;
            let mut kept = 0;
            for at_set in 0..groups.len {
                let set = at(&groups.sets, at_set, 0);
                if set & joined != 0 {
                    joined |= set;
                } else {
                    put(&mut groups.sets, kept, set);
                    kept += 1;
                }
            }
            put(&mut groups.sets, kept, joined);
            groups.len = kept + 1;
        }
        let len = groups.len;
        if let Some(sets) = groups.sets.get_mut(..len) {
            // A handful of sets: an insertion sort without recursion.
            for _ in 0..sets.len() {
                let mut before: Option<&mut u32> = None;
                for set in sets.iter_mut() {
                    if let Some(before) = before {
                        if before.trailing_zeros() > set.trailing_zeros() {
                            core::mem::swap(before, set);
                        }
                    }
                    before = Some(set);
                }
            }
        }
        groups
    }

    /// Groups of one segment, by exchange: a state outside a largest linking, and those that could be given up for it.
    ///
    /// `linking`: of all states, within n steps. Costs one search for each state outside it.
    pub fn of_linking<const L: usize>(linking: &Linking<'_, N, L>) -> Self {
        Self::join(Bits(linking.outside()).map(|j| linking.circuit(j)))
    }

    /// Groups of columns of a matching, among `columns`.
    pub(super) fn of_columns(rank: &TermRank<N>, columns: u32) -> Self {
        let outside = columns & !rank.matched();
        Self::join(Bits(outside).map(|j| rank.circuit(j)))
    }

    /// The sets.
    pub fn sets(&self) -> &[u32] {
        self.sets.get(..self.len).unwrap_or(&[])
    }

    /// The group of a state, if it has one.
    pub fn of(&self, state: usize) -> Option<u32> {
        self.sets()
            .iter()
            .copied()
            .find(|set| set & bit(state) != 0)
    }
}
