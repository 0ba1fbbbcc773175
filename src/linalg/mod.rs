//! Scalars, two-word sums and the small 3-vector algebra that every room uses.
//!
//! Square roots and trigonometry go to `libm` by name on host and target alike, so that both give the same bits.

use core::hint::black_box;
use core::sync::atomic::{compiler_fence, Ordering};

use nalgebra::{Matrix3, Vector3};

/// Calls `$m!(0)` … `$m!(14)`: what is spelled out costs the same at opt-level "s" and 3.
macro_rules! each_state {
    ($m:ident) => {
        $m!(0);
        $m!(1);
        $m!(2);
        $m!(3);
        $m!(4);
        $m!(5);
        $m!(6);
        $m!(7);
        $m!(8);
        $m!(9);
        $m!(10);
        $m!(11);
        $m!(12);
        $m!(13);
        $m!(14);
    };
}

pub(crate) use each_state;

/// What the program reads and writes before this line, it reads and writes before what comes after: otherwise the
/// compiler forms many numbers before it stores one, and has no registers for them. No instruction.
#[inline(always)]
pub(crate) fn in_order() {
    compiler_fence(Ordering::SeqCst);
}

/// All of x, of which the compiler no longer knows how many they are: a loop over them stays a loop. For what runs
/// seldom and should be small.
#[inline(always)]
pub(crate) fn looped<T>(x: &[T]) -> &[T] {
    black_box(x)
}

/// [`looped`], to be changed.
#[inline(always)]
pub(crate) fn looped_mut<T>(x: &mut [T]) -> &mut [T] {
    black_box(x)
}

/// In the body of such a loop: the compiler does not write several rounds of it one after the other. No instruction.
#[inline(always)]
pub(crate) fn rolled() {
    black_box(());
}

/// Whether all are finite.
#[inline(never)]
pub(crate) fn all_finite<T: Real>(x: &[T]) -> bool {
    looped(x).iter().all(|x| {
        rolled();
        x.finite()
    })
}

/// The first that is below zero.
#[inline(never)]
pub(crate) fn first_negative<T: Real>(x: &[T]) -> Option<usize> {
    looped(x).iter().position(|x| {
        rolled();
        *x < T::zero()
    })
}

mod blocks;
mod pair;
mod sine;
mod two;

pub use blocks::BlockTransition;
pub(crate) use pair::Pair;
pub(crate) use sine::sin_cos;
pub use two::{two_add, Two};

/// The scalar of a kernel: f32 on the target, f64 for reference runs of the same code.
pub trait Real: nalgebra::RealField + Copy {
    /// Nearest value of this type, rounded once.
    fn of(x: f64) -> Self;
    /// This value in double precision.
    fn wide(self) -> f64;
    /// Square root, correctly rounded; NaN below zero.
    fn root(self) -> Self;
    /// 1/√x of a normal number above 0 to a few roundings, in a third of the time: for where the error only shortens a
    /// step, as the angle of a rotation that is followed by others.
    fn inverse_root_near(self) -> Self;
    /// e^x.
    fn exponential(self) -> Self;
    /// e^x − 1 without the loss near zero.
    fn exponential_m1(self) -> Self;
    /// Neither NaN nor ±∞.
    fn finite(self) -> bool;
    /// The word of the representation that holds the sign as its top bit: what many numbers have in common is then one
    /// comparison.
    fn sign_word(self) -> u32;
    /// ⌊log₂|x|⌋ of a normal number; 0 for anything else.
    fn exponent(self) -> i16;
    /// 2ⁿ, n taken to the nearest for which that is a normal number.
    fn two_to(n: i16) -> Self;
    /// 0, for an array that is written before it is read: filled with a constant it costs nothing, also at opt-level "s".
    const ZERO: Self;
    /// Distance from 1 to the next larger number.
    const EPSILON: Self;
    /// 2^⌈p/2⌉ + 1 for a mantissa of p bits: what cuts a number into two halves whose products are exact.
    const SPLITTER: Self;
    /// 2^(p − 3) for a mantissa of p bits: takes a rounding error of a number to an eighth of that number at most.
    const CUT: Self;
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
    fn inverse_root_near(self) -> Self {
        // Half the exponent, negative: 3.4 % off at most; each step of Newton squares that and takes 3/2 of it.
        let half = 0.5 * self;
        let closer = |y: f32| y * (1.5 - half * y * y);
        closer(closer(closer(f32::from_bits(
            0x5f37_5a86 - (self.to_bits() >> 1),
        ))))
    }
    #[inline(always)]
    fn exponential(self) -> Self {
        libm::expf(self)
    }
    #[inline(always)]
    fn exponential_m1(self) -> Self {
        libm::expm1f(self)
    }
    #[inline(always)]
    fn finite(self) -> bool {
        f32::is_finite(self)
    }
    #[inline(always)]
    fn sign_word(self) -> u32 {
        self.to_bits()
    }
    #[inline(always)]
    fn exponent(self) -> i16 {
        match (self.to_bits() >> 23) & 0xff {
            0 | 0xff => 0,
            biased => biased as i16 - 127,
        }
    }
    #[inline(always)]
    fn two_to(n: i16) -> Self {
        f32::from_bits(((n.clamp(-126, 127) + 127) as u32) << 23)
    }
    const ZERO: Self = 0.0;
    const EPSILON: Self = f32::EPSILON;
    const SPLITTER: Self = 4097.0;
    const CUT: Self = 2_097_152.0;
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
    fn inverse_root_near(self) -> Self {
        1.0 / libm::sqrt(self)
    }
    #[inline(always)]
    fn exponential(self) -> Self {
        libm::exp(self)
    }
    #[inline(always)]
    fn exponential_m1(self) -> Self {
        libm::expm1(self)
    }
    #[inline(always)]
    fn finite(self) -> bool {
        f64::is_finite(self)
    }
    #[inline(always)]
    fn sign_word(self) -> u32 {
        (self.to_bits() >> 32) as u32
    }
    #[inline(always)]
    fn exponent(self) -> i16 {
        match (self.to_bits() >> 52) & 0x7ff {
            0 | 0x7ff => 0,
            biased => biased as i16 - 1023,
        }
    }
    #[inline(always)]
    fn two_to(n: i16) -> Self {
        f64::from_bits(((n.clamp(-1022, 1023) + 1023) as u64) << 52)
    }
    const ZERO: Self = 0.0;
    const EPSILON: Self = f64::EPSILON;
    const SPLITTER: Self = 134_217_729.0;
    const CUT: Self = 1_125_899_906_842_624.0;
}

/// C x, spelled out: at opt-level "s" nalgebra's products are loops.
#[inline(always)]
pub(crate) fn transformed(c: &Matrix3<f32>, x: &Vector3<f32>) -> Vector3<f32> {
    Vector3::new(
        c.m11 * x.x + c.m12 * x.y + c.m13 * x.z,
        c.m21 * x.x + c.m22 * x.y + c.m23 * x.z,
        c.m31 * x.x + c.m32 * x.y + c.m33 * x.z,
    )
}

/// a × b, likewise. aᵀ[b×] is its transpose.
#[inline(always)]
pub(crate) fn cross(a: &Vector3<f32>, b: &Vector3<f32>) -> Vector3<f32> {
    Vector3::new(
        a.y * b.z - a.z * b.y,
        a.z * b.x - a.x * b.z,
        a.x * b.y - a.y * b.x,
    )
}

/// aᵀ b, likewise.
#[inline(always)]
pub(crate) fn dot(a: &Vector3<f32>, b: &Vector3<f32>) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

/// a + b, likewise.
#[inline(always)]
pub(crate) fn plus(a: &Vector3<f32>, b: &Vector3<f32>) -> Vector3<f32> {
    Vector3::new(a.x + b.x, a.y + b.y, a.z + b.z)
}

/// a − b, likewise.
#[inline(always)]
pub(crate) fn minus(a: &Vector3<f32>, b: &Vector3<f32>) -> Vector3<f32> {
    Vector3::new(a.x - b.x, a.y - b.y, a.z - b.z)
}

/// a s, likewise.
#[inline(always)]
pub(crate) fn scaled(a: &Vector3<f32>, s: f32) -> Vector3<f32> {
    Vector3::new(a.x * s, a.y * s, a.z * s)
}

/// a / s, likewise.
#[inline(always)]
pub(crate) fn divided(a: &Vector3<f32>, s: f32) -> Vector3<f32> {
    Vector3::new(a.x / s, a.y / s, a.z / s)
}

/// A B, likewise.
#[inline]
pub(crate) fn product(a: &Matrix3<f32>, b: &Matrix3<f32>) -> Matrix3<f32> {
    let [x, y, z] = columns(b);
    of_columns(transformed(a, &x), transformed(a, &y), transformed(a, &z))
}

/// A Bᵀ, likewise.
#[inline]
pub(crate) fn product_transposed(a: &Matrix3<f32>, b: &Matrix3<f32>) -> Matrix3<f32> {
    let [x, y, z] = rows(b);
    of_columns(transformed(a, &x), transformed(a, &y), transformed(a, &z))
}

/// The matrix of these columns, likewise.
#[inline(always)]
fn of_columns(x: Vector3<f32>, y: Vector3<f32>, z: Vector3<f32>) -> Matrix3<f32> {
    Matrix3::new(x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z)
}

/// Columns of a matrix, likewise.
#[inline(always)]
pub(crate) fn columns(c: &Matrix3<f32>) -> [Vector3<f32>; 3] {
    [
        Vector3::new(c.m11, c.m21, c.m31),
        Vector3::new(c.m12, c.m22, c.m32),
        Vector3::new(c.m13, c.m23, c.m33),
    ]
}

/// Rows of a matrix, likewise.
#[inline(always)]
pub(crate) fn rows(c: &Matrix3<f32>) -> [Vector3<f32>; 3] {
    [
        Vector3::new(c.m11, c.m12, c.m13),
        Vector3::new(c.m21, c.m22, c.m23),
        Vector3::new(c.m31, c.m32, c.m33),
    ]
}

/// The matrix [v×] with `[v×] w = v × w`.
#[inline(always)]
pub fn skew<T: Real>(v: &Vector3<T>) -> Matrix3<T> {
    let o = T::zero();
    Matrix3::new(o, -v.z, v.y, v.z, o, -v.x, -v.y, v.x, o)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_near_inverse_root_is_near() {
        let mut x = 1e-37f32;
        while x < 1e38 {
            let exact = 1.0 / libm::sqrt(f64::from(x));
            let off = f64::from(x.inverse_root_near()) / exact - 1.0;
            assert!(off.abs() < 3e-7, "{x:e}: {off:e}");
            x *= 1.0137;
        }
    }

    #[test]
    fn powers_of_two_are_exact_and_stay_normal() {
        for n in -126..=127i16 {
            assert_eq!(f32::two_to(n), libm::exp2f(f32::from(n)));
            assert_eq!((1.75 * f32::two_to(n)).exponent(), n);
            assert_eq!((-f64::two_to(8 * n)).exponent(), 8 * n);
        }
        assert_eq!(f32::two_to(-200), f32::MIN_POSITIVE);
        assert_eq!(f64::two_to(2000), 2f64.powi(1023));
        for none in [0.0, f32::NAN, f32::INFINITY, 1e-40] {
            assert_eq!(none.exponent(), 0);
        }
    }
}
