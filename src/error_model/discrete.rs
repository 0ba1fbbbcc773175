//! Φ − I and Q over an interval, for any F.

use nalgebra::{SMatrix, SVector};

use crate::linalg::Real;

/// A = Φ − I = F·T + (F·T)²/2! + … up to the given order, for an F that is constant over the interval.
///
/// One plus a small number is never formed, so the rate of a slow Markov bias (10⁻⁶ over an interval) keeps all its
/// digits in f32. Evaluated from the highest term inwards: A_k = (X + X·A_{k+1})/k with X = F·T. Order 0 gives zero.
/// Truncation: the first term left out is (F·T)^(order+1)/(order+1)!. Cost: order − 1 products of N × N.
pub fn phi_minus_identity<T: Real, const N: usize>(
    f: &SMatrix<T, N, N>,
    dt: T,
    order: usize,
) -> SMatrix<T, N, N> {
    let x = f * dt;
    let mut a = SMatrix::zeros();
    let mut k = order;
    while k > 0 {
        // exact for every order that makes sense
        let inverse = T::one() / T::of(k as f64);
        a = if k == order {
            x * inverse
        } else {
            (x + x * a) * inverse
        };
        k -= 1;
    }
    a
}

/// A of two intervals in a row: (I + later)(I + earlier) − I, without forming 1 + small.
pub fn chain<T: Real, const N: usize>(
    later: &SMatrix<T, N, N>,
    earlier: &SMatrix<T, N, N>,
) -> SMatrix<T, N, N> {
    later + earlier + later * earlier
}

/// Q over an interval: the densities times the interval [s], diagonal.
///
/// First order, as the filter and the golden runs of Lu 2009 do: the noise that has reached other states by the end of
/// the interval (q T²/2 and q T³/3, of relative weight T against the time over which such states move) is left out.
pub fn process_noise<T: Real, const N: usize>(density: &SVector<T, N>, dt: T) -> SVector<T, N> {
    density * dt
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix2;

    #[test]
    fn a_rotation_is_reached_to_the_truncated_term() {
        let angle = 0.3f64;
        let f = Matrix2::new(0.0, -1.0, 1.0, 0.0);
        let exact = Matrix2::new(
            libm::cos(angle) - 1.0,
            -libm::sin(angle),
            libm::sin(angle),
            libm::cos(angle) - 1.0,
        );
        let mut first_left_out = 1.0;
        for order in 0..12 {
            first_left_out *= angle / (order + 1) as f64;
            let error = (phi_minus_identity(&f, angle, order) - exact).amax();
            // An alternating series errs by less than its first missing term, and by nearly all of it (the next
            // one is 0.3/(order+2) of it, in the other element).
            assert!(error <= first_left_out + 1e-17, "order {order}: {error:e}");
            assert!(
                error >= 0.8 * first_left_out - 1e-16,
                "order {order}: {error:e}"
            );
        }
    }

    #[test]
    fn slow_rates_keep_their_digits() {
        // 1 − T/τ in f32 would leave 10⁻⁶ with 6 % of error.
        let f = SMatrix::<f32, 1, 1>::new(-1.0 / 72_000.0);
        let a = phi_minus_identity(&f, 0.1, 12).x;
        let exact = libm::expm1(-0.1 / 72_000.0);
        // three roundings: 1/τ, dt, and their product; the other terms are below the last place
        assert!(
            (f64::from(a) / exact - 1.0).abs() < 3.0 * f64::from(f32::EPSILON) / 2.0,
            "{a:e}"
        );
    }

    #[test]
    fn two_halves_chain_to_the_whole() {
        let f = SMatrix::<f64, 3, 3>::new(0.1, 0.5, -0.3, 0.2, -0.4, 0.6, 0.7, 0.1, -0.2);
        let (half, whole) = (
            phi_minus_identity(&f, 0.5, 20),
            phi_minus_identity(&f, 1.0, 20),
        );
        // 1/21! is far below f64; what remains is rounding of numbers below 1.
        assert!((chain(&half, &half) - whole).amax() < 1e-15);
    }
}
