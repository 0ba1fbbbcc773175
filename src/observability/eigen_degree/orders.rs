//! Orders by containment: the least order whose rows hold a combination.
//!
//! In the space of one eigenvalue any basis is as good: the one is taken whose first vectors lie in the lowest orders.

use nalgebra::SMatrix;

use super::{gap, get, EigenDegree, NONE};
use crate::linalg::Real;
use crate::observability::vector::dot;

/// What a slice does for one order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Settling {
    /// Row `m` of the block, if it is new: one of the two passes that take away what the basis holds.
    Project { m: usize, second: bool },
    /// The next eigenvalue's space from combination `from` on.
    Group { from: usize },
    /// Parts of combination `i` inside the basis.
    Inside { start: usize, end: usize, i: usize },
    /// A pair of combinations of one space.
    Turn { start: usize, end: usize },
    /// Those inside have this order.
    Mark { start: usize, end: usize },
    /// Row `m` of the next block.
    Advance { m: usize },
}

impl Settling {
    pub(super) const START: Self = Settling::Project {
        m: 0,
        second: false,
    };
}

impl<T: Real, const N: usize, const M: usize> EigenDegree<T, N, M> {
    /// One slice, and the next; `None` after the last.
    pub(super) fn settle(&mut self, slice: Settling, f: &SMatrix<T, N, N>) -> Option<Settling> {
        Some(match slice {
            Settling::Project { m, second } => self.project(m, second)?,
            Settling::Group { from } => self.group(from),
            Settling::Inside { start, end, i } => {
                let axis = get_row(&self.axes, i);
                if let Some(parts) = self.triangle.rows.get_mut(i) {
                    *parts = [T::zero(); N];
                    for (part, v) in parts
                        .iter_mut()
                        .zip(self.basis.vectors.iter().take(self.basis.len))
                    {
                        *part = dot(v, &axis);
                    }
                }
                if i + 1 < end {
                    Settling::Inside {
                        start,
                        end,
                        i: i + 1,
                    }
                } else if end - start > 1 {
                    self.at = (start, start + 1);
                    Settling::Turn { start, end }
                } else {
                    Settling::Mark { start, end }
                }
            }
            Settling::Turn { start, end } => {
                if self.rotate(start, end) {
                    Settling::Mark { start, end }
                } else {
                    slice
                }
            }
            Settling::Mark { start, end } => {
                let most = T::of(0.99);
                for (parts, order) in self
                    .triangle
                    .rows
                    .iter()
                    .zip(&mut self.minimal)
                    .take(end)
                    .skip(start)
                {
                    if dot(parts, parts) >= most {
                        *order = self.blocks.order;
                    }
                }
                Settling::Group { from: end }
            }
            Settling::Advance { m } => {
                if self.blocks.advance(m, f, &self.form) {
                    Settling::START
                } else {
                    Settling::Advance { m: m + 1 }
                }
            }
        })
    }

    /// One pass over a new row of this order. `None` where the order has no new row, nor has any above.
    fn project(&mut self, m: usize, second: bool) -> Option<Settling> {
        let order = usize::from(self.blocks.order);
        let accepted = self.accepted.get(order).copied().unwrap_or(0);
        if accepted == 0 {
            return None;
        }
        if m >= M {
            return Some(Settling::Group { from: 0 });
        }
        let next = Settling::Project {
            m: m + 1,
            second: false,
        };
        if accepted >> (m & 63) & 1 == 0 {
            return Some(next);
        }
        let row = get_row(&self.blocks.rows, m);
        Some(if self.basis.add_in_two(&row, second) {
            next
        } else {
            Settling::Project { m, second: true }
        })
    }

    /// The combinations of the next eigenvalue that have no order yet.
    fn group(&mut self, from: usize) -> Settling {
        if from >= self.rank {
            return Settling::Advance { m: 0 };
        }
        let end = self.group_end(from);
        let mut start = from;
        while start < end && self.minimal.get(start).is_some_and(|order| *order != NONE) {
            start += 1;
        }
        if start < end {
            Settling::Inside {
                start,
                end,
                i: start,
            }
        } else {
            Settling::Group { from: end }
        }
    }

    /// One past the last eigenvalue that equals the one at `from`.
    fn group_end(&self, from: usize) -> usize {
        let gap = gap::<T>();
        let mut end = from + 1;
        while end < self.rank {
            let (a, b) = (get(&self.lambda, end - 1), get(&self.lambda, end));
            if a - b > gap * a {
                break;
            }
            end += 1;
        }
        end
    }
}

fn get_row<T: Real, const N: usize>(table: &[[T; N]], i: usize) -> [T; N] {
    table.get(i).copied().unwrap_or([T::zero(); N])
}
