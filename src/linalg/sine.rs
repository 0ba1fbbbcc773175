//! Sine and cosine of an angle, together.

/// Bits of the angle from which on libm reduces it in another way: 2²⁸ π/2 rad.
const TOO_LARGE: u32 = 0x4dc9_0fdb;

/// (sin x, cos x) of libm; NaN beyond 4e8 rad, where an f32 has no place below a turn.
///
/// The bound is asked as libm asks it. So the compiler sees that its reduction of larger angles is never reached, and five
/// kilobytes less are linked.
#[inline(never)]
pub(crate) fn sin_cos(x: f32) -> (f32, f32) {
    if x.to_bits() & 0x7fff_ffff >= TOO_LARGE {
        return (f32::NAN, f32::NAN);
    }
    libm::sincosf(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_that_of_libm_as_far_as_an_angle_means_something() {
        for x in [0.0, -0.0, 1e-30, 0.5, -2.0, 7.0, -4e8, 4.2e8] {
            assert_eq!(sin_cos(x), libm::sincosf(x));
        }
        for none in [f32::NAN, f32::INFINITY, 4.3e8, -5e8] {
            assert!(sin_cos(none).0.is_nan() && sin_cos(none).1.is_nan());
        }
    }
}
