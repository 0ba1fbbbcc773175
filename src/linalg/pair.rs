//! Double-word arithmetic: about twice the digits of T out of plain additions and multiplications.
//!
//! For the rare step in which single words would lose what matters; an operation costs 10 to 30 plain ones. No fused
//! multiply-add is needed, and host and target give the same bits.
//!
//! Source: Dekker 1971; Joldes, Muller & Popescu 2017 (algorithms 6, 12 and the sloppy sum, whose relative error is
//! bounded here because the operands that nearly cancel do so by design, against an absolute size that is known).

use super::Real;

/// The unevaluated sum of two words, the second below half a unit in the last place of the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pair<T> {
    pub hi: T,
    pub lo: T,
}

/// Operations for rare paths: small code matters there, speed does not.
#[allow(clippy::should_implement_trait)] // no generic code needs the operators, and the names say the cost
impl<T: Real> Pair<T> {
    /// One word.
    #[inline(always)]
    pub fn of(hi: T) -> Self {
        Self { hi, lo: T::zero() }
    }

    /// A constant, for the same reason as [`Real::ZERO`].
    pub const ZERO: Self = Self {
        hi: T::ZERO,
        lo: T::ZERO,
    };

    /// a + b exactly.
    #[inline(always)]
    pub fn sum(a: T, b: T) -> Self {
        let hi = a + b;
        let c = hi - a;
        Self {
            hi,
            lo: (a - (hi - c)) + (b - c),
        }
    }

    /// a · b exactly, short of overflow and underflow.
    #[inline(always)]
    pub fn product(a: T, b: T) -> Self {
        let hi = a * b;
        let (a1, a0) = split(a);
        let (b1, b0) = split(b);
        Self {
            hi,
            lo: ((a1 * b1 - hi) + a1 * b0 + a0 * b1) + a0 * b0,
        }
    }

    /// Makes the first word the nearest to the sum of both.
    #[inline(always)]
    fn settled(self) -> Self {
        let hi = self.hi + self.lo;
        Self {
            hi,
            lo: self.lo - (hi - self.hi),
        }
    }

    #[inline(never)]
    pub fn add(self, other: Self) -> Self {
        let s = Self::sum(self.hi, other.hi);
        Self {
            hi: s.hi,
            lo: s.lo + (self.lo + other.lo),
        }
        .settled()
    }

    #[inline(always)]
    pub fn sub(self, other: Self) -> Self {
        self.add(Self {
            hi: -other.hi,
            lo: -other.lo,
        })
    }

    /// self − a b
    #[inline(never)]
    pub fn less_product(self, a: Self, b: Self) -> Self {
        self.sub(a.mul(b))
    }

    #[inline(never)]
    pub fn mul(self, other: Self) -> Self {
        let p = Self::product(self.hi, other.hi);
        Self {
            hi: p.hi,
            lo: p.lo + (self.hi * other.lo + self.lo * other.hi),
        }
        .settled()
    }

    /// self + a x: the product exact, the sum to two words, which only the next [`Pair::add`] settles.
    #[inline]
    pub fn add_product(self, x: Self, a: T) -> Self {
        let p = Self::product(x.hi, a);
        let s = Self::sum(self.hi, p.hi);
        Self {
            hi: s.hi,
            lo: self.lo + (s.lo + (p.lo + x.lo * a)),
        }
    }

    /// 1/self: one Newton step on the single-word reciprocal. Not finite at zero.
    #[inline(never)]
    pub fn reciprocal(self) -> Self {
        let x = T::one() / self.hi;
        let residual = Self::of(T::one()).sub(self.mul(Self::of(x)));
        Self {
            hi: x,
            lo: x * residual.hi,
        }
        .settled()
    }
}

/// Halves of the mantissa: their products are exact.
#[inline(always)]
fn split<T: Real>(x: T) -> (T, T) {
    let t = x * T::SPLITTER;
    let high = t - (t - x);
    (high, x - high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against f64, whose 53 bits hold every intermediate of the exact operations on f32.
    #[test]
    fn products_and_sums_are_exact_and_a_reciprocal_has_twice_the_digits() {
        let mut x = 0.713_f32;
        let mut y = -1.377_f32;
        for _ in 0..1000 {
            x = (x * 3.999).fract() + 0.01;
            y = (y * 2.773).fract() * 8.0 - 3.9;
            let p = Pair::product(x, y);
            assert_eq!(
                f64::from(p.hi) + f64::from(p.lo),
                f64::from(x) * f64::from(y)
            );
            let s = Pair::sum(x, y);
            assert_eq!(
                f64::from(s.hi) + f64::from(s.lo),
                f64::from(x) + f64::from(y)
            );
            let r = Pair::sum(x, y * 1e-9).reciprocal();
            let exact = 1.0 / (f64::from(x) + f64::from(y * 1e-9));
            let error = (f64::from(r.hi) + f64::from(r.lo)) / exact - 1.0;
            assert!(
                error.abs() < 4.0 / f64::from(1u32 << 24).powi(2),
                "{error:e}"
            );
        }
    }
}
