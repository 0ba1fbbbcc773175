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
    /// Nearest pair to a double: 48 of its 53 places.
    ///
    /// By its bits, which a processor without double precision does in a fifth of the instructions.
    #[inline]
    pub fn of(x: f64) -> Self {
        const PLACES: u32 = 29; // that an f32 has not
        let bits = x.to_bits();
        let exponent = (bits >> 52) as u32 & 0x7ff;
        if !(963..=1149).contains(&exponent) {
            return Self::of_any(x); // 2⁻⁶⁰ and 2¹²⁷: beyond them, a factor below is none
        }
        let up = (bits >> (PLACES - 1)) as u32 & 1;
        let top = ((bits >> PLACES) as u32 & 0x7f_ffff | 0x80_0000) + up;
        let rest = (bits as u32 & 0x1fff_ffff) as i32 - ((up << PLACES) as i32);
        let sign = (bits >> 32) as u32 & 0x8000_0000;
        let factor = |less: u32| f32::from_bits(sign | (exponent - 896 - less) << 23);
        Self {
            hi: top as f32 * factor(23),
            lo: rest as f32 * factor(52),
        }
    }

    /// Nearest pair to zero, to what is as good as zero, and to what no f32 holds.
    #[cold]
    fn of_any(x: f64) -> Self {
        let hi = x as f32;
        Self {
            hi,
            lo: (x - f64::from(hi)) as f32,
        }
    }

    /// This less another, to one word: right to rounding however near they are.
    #[inline(always)]
    pub(crate) fn less(self, other: Self) -> f32 {
        (self.hi - other.hi) + (self.lo - other.lo)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_is_the_double_to_48_places() {
        let mut x = 1e-22_f64;
        while x < 1e40 {
            for x in [x, -x] {
                let Two { hi, lo } = Two::of(x);
                let error = (f64::from(hi) - x) + f64::from(lo);
                if hi.is_finite() {
                    assert!(
                        f64::from(lo).abs() <= f64::from(hi).abs() * 2f64.powi(-24),
                        "{x:e}"
                    );
                    // lo is rounded to a half of its last place, 2⁻²⁴ of what is at most 2⁻²⁴ of x; or is below 2⁻¹⁴⁹
                    assert!(
                        error.abs() <= x.abs() * 2f64.powi(-48) + 1e-45,
                        "{x:e}: {error:e}"
                    );
                } else {
                    assert!(x.abs() > f64::from(f32::MAX));
                }
            }
            x *= 1.000_731;
        }
        for x in [0.0, 1.0, -2.0, 0.1_f32 as f64, f64::from(f32::MIN_POSITIVE)] {
            assert_eq!(Two::of(x).wide(), x);
        }
        assert!(Two::of(f64::NAN).hi.is_nan());
        assert_eq!(Two::of(f64::INFINITY).hi, f32::INFINITY);
    }
}
