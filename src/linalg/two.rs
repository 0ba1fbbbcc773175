//! Numbers held as the unevaluated sum of two words, and the compensated addition that keeps them.

use super::Real;

/// Adds `d` to the two-word number `hi + lo` and returns the new words.
///
/// The classic compensated sum: what the rounding of `hi + d` lost is kept in `lo` and offered again with the next
/// addition, so a long sum of small numbers is as exact as in twice the precision. `|d|` must not exceed `|hi|` by
/// much for the recovery to be exact; where it does, the result is no worse than a plain addition.
#[inline(always)]
pub fn two_add<T: Real>(hi: T, lo: T, d: T) -> (T, T) {
    let y = d + lo;
    let t = hi + y;
    (t, y - (t - hi))
}

/// A number held as the sum of two f32 words, for states that grow by increments far below their last place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Two {
    /// The number to f32 precision.
    pub hi: f32,
    /// What `hi` lacks.
    pub lo: f32,
}

impl Two {
    /// Nearest pair to a double.
    #[inline]
    pub fn of(x: f64) -> Self {
        let hi = x as f32;
        Self {
            hi,
            lo: (x - f64::from(hi)) as f32,
        }
    }

    /// The value in double precision.
    #[inline]
    pub fn wide(self) -> f64 {
        f64::from(self.hi) + f64::from(self.lo)
    }

    /// Adds an increment (see [`two_add`]).
    #[inline(always)]
    pub fn add(&mut self, d: f32) {
        (self.hi, self.lo) = two_add(self.hi, self.lo, d);
    }
}
