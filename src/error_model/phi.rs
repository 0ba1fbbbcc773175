//! F of the phi-angle model, for analysis.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::{put, BiasModel, Environment, ATT, BA, BG, N, POS, VEL};
use crate::linalg::{skew, Real};

/// F of ẋ = F x for the phi-angle errors: components of the estimate minus components of the truth, each in its own
/// level frame. φ and ψ are tied by φ = ψ + δθ (front page of the crate), and δv here is the psi model's minus δθ × v.
///
/// ```text
/// δṙ_E = δv_E + (v_U − v_N tanL)/R_N δr_E + v_E tanL/R_N δr_N − v_E/R_N δh
/// δṙ_N = δv_N + v_U/R_M δr_N − v_N/R_M δh
/// δḣ   = δv_U
/// δv̇   = (0, 0, g/R_M + g/R_N) δh − (2ω_ie + ω_en) × δv − (2δω_ie + δω_en) × v + f_n × φ + C b_a
/// φ̇    = −ω_in × φ + δω_ie + δω_en − C b_g
///
/// δω_ie = (0, −ω_ie,U, ω_ie,N) δr_N/R_M                                  R_N, R_M with the height added
/// δω_en = (−δv_N/R_M, δv_E/R_N, δv_E tanL/R_N) − (ω_en,E/R_M, ω_en,N/R_N, ω_en,U/R_N) δh
///         + (0, 0, v_E/(R_N cos²L)) δr_N/R_M
/// ```
///
/// The states are metres, δr_N = (R_M+h) δL and δr_E = (R_N+h) cosL δλ; the rows of δṙ are exact for that definition, the
/// radii's change with latitude included. Left out in δω_en: ∂R_M/∂L and ∂R_N/∂L, at most 1.0e-2 R and 3.4e-3 R, hence
/// at most 1.0e-2·|v|/R² rad/s per metre of δr_N (7e-14 at 300 m/s); and the two terms of gravity named at
/// [`Environment::gravity_gradient`]. On a sphere with gravity towards its centre nothing is left
/// out.
///
/// Arguments as [`psi::f_matrix`](super::psi::f_matrix). Source: Benson 1975 and Groves 2013 section 14.2.4,
/// re-derived for metres in east-north-up. Against finite differences: `host-tests/tests/error_model.rs`.
pub fn f_matrix<T: Real>(
    env: &Environment<T>,
    c_b_n: &Matrix3<T>,
    f_n: &Vector3<T>,
    bias: &BiasModel<T>,
) -> SMatrix<T, N, N> {
    let o = T::zero();
    let (ie, en, v, tan) = (&env.omega_ie_n, &env.omega_en_n, &env.v_n, env.tan_lat);
    let (m, n) = (T::one() / env.r_m, T::one() / env.r_n);
    let sec2 = T::one() + tan * tan;

    // δω = … δr and … δv
    let ie_r = Matrix3::new(o, o, o, o, -ie.z * m, o, o, ie.y * m, o);
    let en_r = Matrix3::new(
        o,
        o,
        -en.x * m,
        o,
        o,
        -en.y * n,
        o,
        v.x * sec2 * n * m,
        -en.z * n,
    );
    let en_v = Matrix3::new(o, -m, o, n, o, o, tan * n, o, o);
    let v_cross = skew(v);

    let mut f = SMatrix::<T, N, N>::zeros();
    put::<T, POS, POS>(
        &mut f,
        &Matrix3::new(
            (v.z - v.y * tan) * n,
            v.x * tan * n,
            -v.x * n,
            o,
            v.z * m,
            -v.y * m,
            o,
            o,
            o,
        ),
    );
    put::<T, POS, VEL>(&mut f, &Matrix3::identity());
    let gravity = Matrix3::from_diagonal(&Vector3::new(o, o, env.gravity_gradient().z));
    put::<T, VEL, POS>(&mut f, &(gravity + v_cross * (ie_r + ie_r + en_r)));
    put::<T, VEL, VEL>(&mut f, &(v_cross * en_v - skew(&env.omega_coriolis_n())));
    put::<T, VEL, ATT>(&mut f, &skew(f_n));
    put::<T, VEL, BA>(&mut f, c_b_n);
    put::<T, ATT, POS>(&mut f, &(ie_r + en_r));
    put::<T, ATT, VEL>(&mut f, &en_v);
    put::<T, ATT, ATT>(&mut f, &-skew(&env.omega_in_n()));
    put::<T, ATT, BG>(&mut f, &-c_b_n);
    put::<T, BG, BG>(&mut f, &Matrix3::from_diagonal_element(-bias.rate_g));
    put::<T, BA, BA>(&mut f, &Matrix3::from_diagonal_element(-bias.rate_a));
    f
}
