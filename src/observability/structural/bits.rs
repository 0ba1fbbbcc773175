//! Sets of states as bits of a word, and tables that cannot be read out of bounds.

/// The members of a set, smallest first.
pub(super) struct Bits(pub u32);

impl Iterator for Bits {
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

/// The set of one member; empty from 32 on.
#[inline(always)]
pub(super) const fn bit(at: usize) -> u32 {
    if at < 32 {
        1 << at
    } else {
        0
    }
}

/// The first `count` members.
#[inline(always)]
pub(super) const fn first(count: usize) -> u32 {
    if count >= 32 {
        u32::MAX
    } else {
        (1 << count) - 1
    }
}

/// Element of a table; `or` beyond its end, where the algorithms never read.
#[inline(always)]
pub(super) fn at<V: Copy, const N: usize>(table: &[V; N], index: usize, or: V) -> V {
    match table.get(index) {
        Some(value) => *value,
        None => or,
    }
}

/// Writes an element of a table; nothing beyond its end.
#[inline(always)]
pub(super) fn put<V, const N: usize>(table: &mut [V; N], index: usize, value: V) {
    if let Some(place) = table.get_mut(index) {
        *place = value;
    }
}
