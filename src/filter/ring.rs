//! The last K of something.

use heapless::Vec;

/// A ring: what is kept when it is full takes the place of the oldest. K = 0 keeps nothing.
#[derive(Clone, Debug)]
pub(crate) struct Ring<T, const K: usize> {
    items: Vec<T, K>,
    newest: usize,
}

impl<T, const K: usize> Ring<T, K> {
    pub const fn new() -> Self {
        Self {
            items: Vec::new(),
            newest: 0,
        }
    }

    /// Keeps one more.
    pub fn keep(&mut self, item: T) {
        let next = if self.newest + 1 < K {
            self.newest + 1
        } else {
            0
        };
        match self.items.push(item) {
            Ok(()) => self.newest = self.items.len() - 1,
            Err(item) => {
                if let Some(oldest) = self.items.get_mut(next) {
                    *oldest = item;
                    self.newest = next;
                }
            }
        }
    }

    /// The one `age` places before the newest.
    pub fn back(&self, age: usize) -> Option<&T> {
        let len = self.items.len();
        if age >= len {
            return None;
        }
        let index = if age <= self.newest {
            self.newest - age
        } else {
            self.newest + len - age
        };
        self.items.get(index)
    }

    /// The newest, to be changed.
    pub fn newest_mut(&mut self) -> Option<&mut T> {
        self.items.get_mut(self.newest)
    }
}

#[cfg(test)]
mod tests {
    use super::Ring;

    #[test]
    fn it_remembers_the_last_ones_newest_first() {
        let mut ring = Ring::<u8, 3>::new();
        assert_eq!(ring.back(0), None);
        assert_eq!(ring.newest_mut(), None);
        for kept in 1..=7u8 {
            ring.keep(kept);
            for age in 0..4u8 {
                let expected = kept.checked_sub(age).filter(|x| *x > 0 && age < 3);
                assert_eq!(ring.back(usize::from(age)).copied(), expected);
            }
            assert_eq!(ring.newest_mut().copied(), Some(kept));
        }
        let mut none = Ring::<u8, 0>::new();
        none.keep(1);
        assert_eq!(none.back(0), None);
        assert_eq!(none.newest_mut(), None);
    }
}
