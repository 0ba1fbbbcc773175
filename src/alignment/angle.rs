//! By what angle to turn between two positions: the closed forms of Peng 2016, and why they do not answer for every way
//! of using the turn.
//!
//! | what is carried over the turn | heading and the level gyros are separated by | best angle |
//! |---|---|---|
//! | the biases only ([`super::carry`], [`super::north_bias`]) | two north gyros that are different gyros | ±90°, nothing at 180° |
//! | biases **and** attitude (the filter runs on) | the east gyro's share of the level changing sign against a heading that stays known | 180° |
//!
//! With the biases only, each position observes the gyro that points north there: hᵢᵀb = z_i with hᵢ = (sin ψᵢ, cos ψᵢ).
//! Two such rows are the matrix A; their condition is best where they are orthogonal and at 180° they are one row twice.
//!
//! With the attitude carried through, the position adds a second equation of another kind. At rest the level shows
//! Ω cos L·δψ − ε_E, heading error and east gyro bias together. Turned by α the heading error is the same (the gyros have
//! counted the turn) and ε_E has become ε_E cos α + ε_N sin α, ε_N being known. The difference of the two positions is
//! ε_E (1 − cos α): largest at 180°, where twice the bias is seen; half of it at 90°. The accelerometers follow the same
//! way: their biases turn against the tilt by 1 − cos α. Filter σ over the angle: `cargo lab align --sweep`.

/// Degree of the heading in the second of two positions, the paper's Fig. 4 [m/s³]: how strongly δψ drives the level
/// velocity once the east gyro is known from both positions.
///
/// ```text
/// degree(φ_U) = g Ω cos L |sin α|                     order 2
/// ```
/// * `gravity` [m/s²], `lat` [rad], `alpha`: angle of the turn [rad]
///
/// 0: heading comes only together with a gyro bias (α = 0, 180°). A degree is in units of the measurement: comparable
/// between angles, not between states. Rebuilt from the paper's Fig. 4 and checked against the staged elimination in
/// `host-tests/tests/peng2016.rs` to 1e-6.
pub fn heading_degree(gravity: f32, lat: f32, alpha: f32) -> f32 {
    let sin = libm::fabsf(libm::sinf(alpha));
    gravity * crate::earth::OMEGA_IE as f32 * libm::cosf(lat) * sin
}

/// cond₂ of the two north-gyro rows, the paper's eq. (13) and Fig. 5: 1 at ±90°, ∞ at 0 and 180°.
///
/// ```text
/// A = [sin ψ₁ cos ψ₁; sin ψ₂ cos ψ₂],   cond₂(A) = √((1 + |cos α|)/(1 − |cos α|)),   α = ψ₂ − ψ₁
/// ```
/// Roughly: by how much more the worse of the two level gyro biases is uncertain than the better one.
///
/// Accuracy 1e-5 of its value up to a condition of 100. ∞ at exactly 0.
pub fn condition(alpha: f32) -> f32 {
    // √((1 + c)/(1 − c)) = (1 + c)/√(1 − c²): keeps its digits at small angles.
    let (sin, cos) = libm::sincosf(alpha);
    (1.0 + libm::fabsf(cos)) / libm::fabsf(sin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::PI;

    #[test]
    fn a_quarter_turn_is_best_for_biases_alone() {
        assert!((condition(0.5 * PI) - 1.0).abs() < 1e-6);
        assert!(condition(0.0).is_infinite());
        // the paper's 2°: 57.29
        assert!((condition(2.0 / 180.0 * PI) - 57.289_96).abs() < 1e-3);
        let at = |deg: f32| heading_degree(9.80665, 40.0 / 180.0 * PI, deg / 180.0 * PI);
        // g Ω cos 40°
        assert!((at(90.0) - 5.478_077e-4).abs() < 1e-9);
        assert!(at(180.0) < 1e-9 && (at(30.0) - 0.5 * at(90.0)).abs() < 1e-9);
    }
}
