//! Scalars, two-word sums and the small 3-vector algebra that every room uses.
//!
//! Square roots and trigonometry go to `libm` by name on host and target alike, so that both give the same bits.

use nalgebra::{Matrix3, Vector3};

/// The scalar of a kernel: f32 on the target, f64 for reference runs of the same code.
pub trait Real: nalgebra::RealField + Copy {
    /// Nearest value of this type, rounded once.
    fn of(x: f64) -> Self;
    /// This value in double precision.
    fn wide(self) -> f64;
    /// Square root, correctly rounded; NaN below zero.
    fn root(self) -> Self;
    /// Neither NaN nor ±∞.
    fn finite(self) -> bool;
    /// Distance from 1 to the next larger number.
    const EPSILON: Self;
}

impl Real for f32 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x as f32
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn root(self) -> Self {
        libm::sqrtf(self)
    }
    #[inline(always)]
    fn finite(self) -> bool {
        f32::is_finite(self)
    }
    const EPSILON: Self = f32::EPSILON;
}

impl Real for f64 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }
    #[inline(always)]
    fn root(self) -> Self {
        libm::sqrt(self)
    }
    #[inline(always)]
    fn finite(self) -> bool {
        f64::is_finite(self)
    }
    const EPSILON: Self = f64::EPSILON;
}

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
#[derive(Clone, Copy, Debug, PartialEq)]
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

/// The matrix [v×] with `[v×] w = v × w`.
#[inline(always)]
pub fn skew<T: Real>(v: &Vector3<T>) -> Matrix3<T> {
    let o = T::zero();
    Matrix3::new(o, -v.z, v.y, v.z, o, -v.x, -v.y, v.x, o)
}
