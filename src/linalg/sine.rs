//! Sine and cosine of an angle, together.

use core::f64::consts::{FRAC_2_PI, FRAC_PI_2};

/// Beyond this an f32 has no place below a turn: 2²⁸ π/2 rad.
const TOO_LARGE: f32 = f32::from_bits(0x4dc9_0fdb);

/// π/2 in two parts, the first of 25 bits: its products with whole numbers up to 2²⁸ are exact.
const QUARTER: [f64; 2] = [
    f64::from_bits(0x3ff9_21fb_5000_0000),
    f64::from_bits(0x3e51_10b4_611a_6263),
];
/// Up to here, 9π/4 rad, libm takes it as one number.
const NEAR: f32 = f32::from_bits(0x40e2_31d5);
/// 1.5·2⁵²: a number added to it is a whole one, in the last bits.
const WHOLE: f64 = 1.5 / f64::EPSILON;

/// sin y = y + y³ (S₀ + S₁ y² + y⁴ (S₂ + S₃ y²)), |y| ≤ π/4.
const S: [f64; 4] = [
    -0.166_666_666_416_265_24,
    0.008_333_329_385_889_463,
    -0.000_198_393_348_360_966_32,
    0.000_002_718_311_493_989_822,
];
/// cos y = 1 + y² C₀ + y⁴ C₁ + y⁶ (C₂ + C₃ y²), |y| ≤ π/4.
const C: [f64; 4] = [
    -0.499_999_997_251_031,
    0.041_666_623_323_739_06,
    -0.001_388_676_377_460_993,
    0.000_024_390_448_796_277_41,
];

/// (sin x, cos x), bit for bit those of `libm::sincosf`; NaN beyond 4e8 rad.
///
/// The same reduction and series (FreeBSD `k_sinf.c`, `k_cosf.c`, `e_rem_pio2f.c`, which libm follows), standing here
/// once each: libm has a copy of both for every eighth of a turn, and 2.4 KiB more are linked. Compared for every f32: the
/// ignored test below.
#[inline(never)]
pub(crate) fn sin_cos(x: f32) -> (f32, f32) {
    let size = x.abs();
    let (mut y, mut quarter) = (f64::from(size), 0);
    if size > core::f32::consts::FRAC_PI_4 {
        let shifted = y * FRAC_2_PI + WHOLE;
        let n = shifted - WHOLE;
        let [head, tail] = if size <= NEAR {
            [FRAC_PI_2, 0.0]
        } else {
            QUARTER
        };
        y = y - n * head - n * tail;
        quarter = shifted.to_bits() as u32;
    }
    let z = y * y;
    let (w, s) = (z * z, z * y);
    let sin = ((y + s * (S[0] + z * S[1])) + s * w * (S[2] + z * S[3])) as f32;
    let cos = (((1.0 + z * C[0]) + w * C[1]) + (w * z) * (C[2] + z * C[3])) as f32;
    // written as what is good: a NaN is not
    let (sin, cos) = if size < TOO_LARGE {
        (sin, cos)
    } else {
        (f32::NAN, f32::NAN)
    };
    let (sin, cos) = if quarter & 1 == 0 {
        (sin, cos)
    } else {
        (cos, -sin)
    };
    let turned = if quarter & 2 == 0 { 0 } else { 1 << 31 };
    let mirrored = x.to_bits() & 1 << 31;
    (
        f32::from_bits(sin.to_bits() ^ turned ^ mirrored),
        f32::from_bits(cos.to_bits() ^ turned),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn same(bits: u32) {
        let x = f32::from_bits(bits);
        let (ours, theirs) = (sin_cos(x), libm::sincosf(x));
        let equal =
            ours.0.to_bits() == theirs.0.to_bits() && ours.1.to_bits() == theirs.1.to_bits();
        assert!(equal, "{x:e}: {ours:?}, {theirs:?}");
    }

    #[test]
    fn it_is_that_of_libm_as_far_as_an_angle_means_something() {
        // a prime step: every exponent, and mantissas of all kinds
        for bits in (0..TOO_LARGE.to_bits()).step_by(10_007) {
            same(bits);
            same(bits | 1 << 31);
        }
        for x in [0.0, -0.0, 1e-30, 0.5, -2.0, 7.0, -4e8, 4.2e8f32] {
            same(x.to_bits());
        }
        for none in [f32::NAN, f32::INFINITY, 4.3e8, -5e8] {
            assert!(sin_cos(none).0.is_nan() && sin_cos(none).1.is_nan());
        }
    }

    #[test]
    #[ignore = "every f32 takes two minutes: after a change of the series"]
    fn it_is_that_of_libm_everywhere() {
        for bits in 0..TOO_LARGE.to_bits() {
            same(bits);
            same(bits | 1 << 31);
        }
    }
}
