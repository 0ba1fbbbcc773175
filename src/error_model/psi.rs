//! F of the psi-angle model, the filter's.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::{put, BiasModel, Environment, ATT, BA, BG, N, POS, VEL};
use crate::linalg::{skew, Real};

/// F of ẋ = F x for the psi-angle errors.
///
/// ```text
/// δṙ = −ω_en × δr + δv
/// δv̇ = diag(−g/R_N, −g/R_M, g/R_M + g/R_N) δr − (2ω_ie + ω_en) × δv + f_n × ψ + C b_a
/// ψ̇  = −ω_in × ψ − C b_g
/// ḃ_g = −b_g/τ_g,    ḃ_a = −b_a/τ_a            R_N, R_M with the height added
/// ```
///
/// * `c_b_n`: body to level frame, as estimated
/// * `f_n`: specific force in the level frame [m/s²]
///
/// All errors are resolved in the level frame at the *estimated* position, where δv compares the estimate with the true
/// velocity seen from that frame. In this frame the equations are exact to first order in the errors, on the ellipsoid
/// as on a sphere, because computed and true motion turn with one frame; the only terms left out are the two of
/// gravity named at [`Environment::gravity_gradient`]. A bias is truth minus estimate, so it adds to what the
/// estimate feels: f̂ = f + b_a, ω̂ = ω + b_g; and Ĉ = (I − [ψ×]) C turns +b_g into −C b_g.
///
/// Source: Benson 1975, "A comparison of two approaches to pure-inertial and Doppler-inertial error analysis"; at rest,
/// with position angles in place of metres, the A₁ and A₂ of Lu 2009, eq. 24.
/// Against finite differences: `host-tests/tests/error_model.rs`.
pub fn f_matrix<T: Real>(
    env: &Environment<T>,
    c_b_n: &Matrix3<T>,
    f_n: &Vector3<T>,
    bias: &BiasModel<T>,
) -> SMatrix<T, N, N> {
    let mut f = SMatrix::<T, N, N>::zeros();
    put::<T, POS, POS>(&mut f, &-skew(&env.omega_en_n));
    put::<T, POS, VEL>(&mut f, &Matrix3::identity());
    put::<T, VEL, POS>(&mut f, &Matrix3::from_diagonal(&env.gravity_gradient()));
    put::<T, VEL, VEL>(&mut f, &-skew(&env.omega_coriolis_n()));
    put::<T, VEL, ATT>(&mut f, &skew(f_n));
    put::<T, VEL, BA>(&mut f, c_b_n);
    put::<T, ATT, ATT>(&mut f, &-skew(&env.omega_in_n()));
    put::<T, ATT, BG>(&mut f, &-c_b_n);
    put::<T, BG, BG>(&mut f, &Matrix3::from_diagonal_element(-bias.rate_g));
    put::<T, BA, BA>(&mut f, &Matrix3::from_diagonal_element(-bias.rate_a));
    f
}
