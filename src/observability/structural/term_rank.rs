//! Maximum matching of rows to columns, one row at a time: ν, the generalised bipartite graph and the bound D.

use super::bits::{at, bit, put, Bits};

/// Where a search started.
const START: u8 = u8::MAX;

/// Largest number of columns (states) that different rows can hold, for rows that come one after the other.
///
/// This is the size of a maximum matching of the bipartite graph rows – columns, and for independent entries the rank of
/// the matrix. Rows are not stored: only the row that holds a column is, so the number of rows has no bound. One row
/// costs at most one pass over the columns that are held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TermRank<const N: usize> {
    holder: [u32; N],
    matched: u32,
}

impl<const N: usize> Default for TermRank<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> TermRank<N> {
    /// No rows yet.
    pub const fn new() -> Self {
        Self {
            holder: [0; N],
            matched: 0,
        }
    }

    /// Adds a row that may hold any of these columns; true where the rank grew (Kuhn's augmenting path, breadth first).
    pub fn add(&mut self, row: u32) -> bool {
        let mut via = [START; N];
        let (mut seen, mut queue) = (0u32, 0u32);
        let (mut from, mut columns) = (START, row);
        loop {
            let new = columns & !seen;
            for column in Bits(new) {
                put(&mut via, column, from);
            }
            let free = new & !self.matched;
            if free != 0 {
                self.take(&via, free.trailing_zeros() as usize, row);
                return true;
            }
            seen |= new;
            queue |= new;
            if queue == 0 {
                return false;
            }
            let column = queue.trailing_zeros() as usize;
            queue &= queue - 1;
            from = column as u8;
            columns = at(&self.holder, column, 0);
        }
    }

    /// Moves the holders along the path that ends in the free column; each step is one nearer to the start.
    fn take(&mut self, via: &[u8; N], mut column: usize, row: u32) {
        self.matched |= bit(column);
        loop {
            let before = at(via, column, START);
            if before == START {
                put(&mut self.holder, column, row);
                return;
            }
            let moved = at(&self.holder, usize::from(before), 0);
            put(&mut self.holder, column, moved);
            column = usize::from(before);
        }
    }

    /// Size of a maximum matching of the rows so far.
    pub const fn rank(&self) -> usize {
        self.matched.count_ones() as usize
    }

    /// Columns of the matching that was found: *a* choice, not a property (others may be as large).
    pub const fn matched(&self) -> u32 {
        self.matched
    }

    /// Columns that every maximum matching holds (the part of the Dulmage–Mendelsohn decomposition that matters here).
    ///
    /// `columns`: those that exist.
    pub fn always(&self, columns: u32) -> u32 {
        columns & !self.closure(columns & !self.matched)
    }

    /// A free column and the held ones that could be given up for it: they are known only together.
    pub fn circuit(&self, column: usize) -> u32 {
        self.closure(bit(column))
    }

    /// Columns that can be free instead of one of these.
    fn closure(&self, start: u32) -> u32 {
        let mut free = start;
        loop {
            let before = free;
            for column in Bits(self.matched & !free) {
                if at(&self.holder, column, 0) & free != 0 {
                    free |= bit(column);
                }
            }
            if free == before {
                return free;
            }
        }
    }
}
