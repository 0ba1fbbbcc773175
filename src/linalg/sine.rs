//! Sine and cosine of an angle, together.

/// Beyond this an f32 has no place below a turn [rad].
const LARGEST: f32 = 1e8;

/// (sin x, cos x), rounded from f64; NaN beyond 1e8 rad.
///
/// `libm::sincosf` without its reduction of angles up to 3e38, which is six of its seven kilobytes. Against it:
/// `tests::it_is_that_of_libm`.
///
/// Source: FreeBSD's `k_sinf` and `k_cosf` (error below 2⁻³⁷ and 2⁻³⁴), π/2 in 25 + 53 bits.
#[inline(never)]
pub(crate) fn sin_cos(x: f32) -> (f32, f32) {
    const ROUND: f64 = 1.5 / f64::EPSILON;
    const PIO2_HIGH: f64 = 1.570_796_310_901_641_8;
    const PIO2_LOW: f64 = 1.589_325_477_352_819_6e-8;
    let size = libm::fabsf(x);
    if size < 1.0 / 4096.0 {
        return (x, 1.0);
    }
    if size.is_nan() || size > LARGEST {
        return (f32::NAN, f32::NAN);
    }
    let x = f64::from(x);
    let quarters = (x * core::f64::consts::FRAC_2_PI + ROUND) - ROUND;
    let y = (x - quarters * PIO2_HIGH) - quarters * PIO2_LOW;
    let z = y * y;
    let w = z * z;
    let sin = (y + z * y * (-0.166_666_666_416_265_24 + z * 0.008_333_329_385_889_463))
        + z * y * w * (-0.000_198_393_348_360_966_32 + z * 0.000_002_718_311_493_989_822);
    let cos = ((1.0 + z * -0.499_999_997_251_031) + w * 0.041_666_623_323_739_06)
        + w * z * (-0.001_388_676_377_460_993 + z * 0.000_024_390_448_796_277_41);
    let (sin, cos) = (sin as f32, cos as f32);
    match quarters as i32 & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_that_of_libm() {
        // Both are f64 rounded once; where π/2 is taken off in another way, a last place may differ.
        let (mut x, mut other, mut all) = (1e-6f32, 0, 0);
        while x < 9e7 {
            for x in [x, -x] {
                let ((s, c), (s0, c0)) = (sin_cos(x), libm::sincosf(x));
                assert!((s - s0).abs() <= 6e-8 && (c - c0).abs() <= 6e-8, "{x}");
                other += u32::from(s != s0) + u32::from(c != c0);
                all += 2;
            }
            x *= 1.000_03;
        }
        assert!(other * 100_000 < all, "{other} of {all}");
        assert_eq!(sin_cos(-0.0).0.to_bits(), (-0.0f32).to_bits());
        for none in [f32::NAN, f32::INFINITY, -2e8] {
            assert!(sin_cos(none).0.is_nan() && sin_cos(none).1.is_nan());
        }
    }
}
