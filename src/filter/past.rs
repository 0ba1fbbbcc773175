//! From the present back to the time of a late measurement: what a state error was then.
//!
//! ```text
//! forwards over a segment:    ψ' = ψ − C̄ b_g,   δv' = δv + F × (ψ + ψ')/2 + C̄ b_a,   δr' = δr + T (δv + δv')/2
//! with  C̄ = ∫C dt,  F = ∫f_n dt,  T its length
//! ```
//! This is the psi-angle model without what turns slowly: Coriolis 2Ω, transport v/R and the gravity gradient g/R, each
//! below 3e-4 of the state in a second at 300 m/s.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::error_model::{Interval, NoiseDensity, ATT, BA, BG, N, POS, VEL};
use crate::linalg::skew;

/// An error of the end of a segment, as it was at its beginning.
pub(super) fn undo(segment: &Interval<f32>, dx: &SVector<f32, N>) -> SVector<f32, N> {
    let part = |first: usize| dx.fixed_rows::<3>(first).into_owned();
    let (r, v, psi) = (part(POS), part(VEL), part(ATT));
    let (c, f, t) = (&segment.c_dt, &segment.f_dt, segment.dt);
    let psi0 = psi + c * part(BG);
    let v0 = v - f.cross(&((psi + psi0) * 0.5)) - c * part(BA);
    let r0 = r - (v + v0) * (0.5 * t);
    let mut then = *dx;
    then.fixed_rows_mut::<3>(POS).copy_from(&r0);
    then.fixed_rows_mut::<3>(VEL).copy_from(&v0);
    then.fixed_rows_mut::<3>(ATT).copy_from(&psi0);
    then
}

/// The same as a matrix, segment after segment: error then = (this) · error now.
///
/// ```text
/// ψ then = ψ + c b_g
/// δv then = δv − f × ψ − w b_g − c b_a
/// δr then = δr − t δv + g × ψ + u b_g + d b_a
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Back {
    t: f32,
    f: Vector3<f32>,
    g: Vector3<f32>,
    c: Matrix3<f32>,
    d: Matrix3<f32>,
    w: Matrix3<f32>,
    u: Matrix3<f32>,
}

impl Back {
    /// No time at all.
    pub fn none() -> Self {
        Self {
            t: 0.0,
            f: Vector3::zeros(),
            g: Vector3::zeros(),
            c: Matrix3::zeros(),
            d: Matrix3::zeros(),
            w: Matrix3::zeros(),
            u: Matrix3::zeros(),
        }
    }

    /// Further back by one segment.
    pub fn over(&mut self, segment: &Interval<f32>) {
        let half = 0.5 * segment.dt;
        let (f0, c0, w0) = (self.f, self.c, self.w);
        self.w += skew(&segment.f_dt) * (self.c + segment.c_dt * 0.5);
        self.c += segment.c_dt;
        self.f += segment.f_dt;
        self.g += (f0 + self.f) * half;
        self.d += (c0 + self.c) * half;
        self.u += (w0 + self.w) * half;
        self.t += segment.dt;
    }

    /// Rows of then, as rows on the error of now.
    pub fn rows<const M: usize>(&self, h: &SMatrix<f32, M, N>) -> SMatrix<f32, M, N> {
        let part = |first: usize| h.fixed_columns::<3>(first).into_owned();
        let (r, v, psi, bg, ba) = (part(POS), part(VEL), part(ATT), part(BG), part(BA));
        let mut now = *h;
        now.fixed_columns_mut::<3>(VEL).copy_from(&(v - r * self.t));
        now.fixed_columns_mut::<3>(ATT)
            .copy_from(&(psi - v * skew(&self.f) + r * skew(&self.g)));
        now.fixed_columns_mut::<3>(BG)
            .copy_from(&(bg + psi * self.c - v * self.w + r * self.u));
        now.fixed_columns_mut::<3>(BA)
            .copy_from(&(ba - v * self.c + r * self.d));
        now
    }

    /// Variance that the process noise since then has in each row of then.
    pub fn noise<const M: usize>(
        &self,
        h: &SMatrix<f32, M, N>,
        noise: &NoiseDensity<f32>,
    ) -> SVector<f32, M> {
        let (on_v, on_psi) = (noise.velocity * self.t, noise.attitude * self.t);
        let on_r = noise.velocity * self.t * self.t * self.t * (1.0 / 3.0);
        let square = |first: usize| {
            let part = h.fixed_columns::<3>(first);
            part.component_mul(&part).column_sum()
        };
        square(POS) * on_r + square(VEL) * on_v + square(ATT) * on_psi
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Euler;
    use crate::earth::Geodetic;
    use crate::imu::ImuIncrement;
    use crate::nav::NavState;

    #[test]
    fn rows_are_the_way_back_of_the_error() {
        // Two different segments; the row of each state is that component of what `undo` gives.
        let segment = |k: f32| Interval {
            c_dt: Matrix3::new(0.3, -0.2, 0.1, 0.4, 0.5, -0.6, 0.7, 0.1, 0.2) * k,
            f_dt: Vector3::new(1.0, -2.0, 9.0) * k,
            dt: 0.5 * k,
        };
        let (old, new) = (segment(0.7), segment(0.4));
        let mut back = Back::none();
        back.over(&new);
        back.over(&old);
        let h = back.rows(&SMatrix::<f32, N, N>::identity());
        for j in 0..N {
            let dx = SVector::<f32, N>::ith(j, 1.0);
            let then = undo(&old, &undo(&new, &dx));
            // a dozen products of order one
            assert!((h.column(j) - then).amax() < 2e-6, "column {j}");
        }
        assert!((back.t - 0.55).abs() < 1e-6);
    }

    /// Two navigators with the same samples, one of them wrong from the start: `undo` of what is between them at the end
    /// is what was between them at the beginning, for an error of every state.
    #[test]
    fn what_is_undone_is_what_the_navigator_did() {
        let start = NavState::new(
            Geodetic::from_degrees(47.3, 8.5, 500.0),
            Vector3::new(15.0, -20.0, 4.0),
            Euler::from_degrees(130.0, 20.0, -35.0),
        )
        .unwrap();
        let imu = ImuIncrement::from_rates(
            Vector3::new(0.3, -0.5, 0.8),
            Vector3::new(1.0, -2.0, 9.0),
            0.01,
        );
        let mut segment = Interval::empty();
        let mut end = start;
        for _ in 0..50 {
            segment.accumulate(&end.advance(&imu).unwrap());
        }
        // the way forwards is the inverse
        let mut back = SMatrix::<f32, N, N>::zeros();
        for j in 0..N {
            back.set_column(j, &undo(&segment, &SVector::ith(j, 1.0)));
        }
        let forwards = back.try_inverse().unwrap();
        // m, m/s, rad, rad/s, m/s²
        for (j, size) in [10.0, 1.0, 0.01, 0.02, 0.5]
            .iter()
            .enumerate()
            .flat_map(|(k, s)| [(3 * k, s), (3 * k + 1, s), (3 * k + 2, s)])
        {
            let dx = SVector::<f32, N>::ith(j, *size);
            let mut other = start.corrected(&dx);
            for _ in 0..50 {
                other.advance(&imu).unwrap();
            }
            let ours = end.corrected(&(forwards * dx));
            // Products of the error and an even turn of 0.5 rad that is taken for its chord: 1.8e-3 m/s for a gyro bias of
            // 0.02 rad/s, 4e-3 m for an accelerometer bias of 0.5 m/s². A wrong sign is twice the effect: 0.1 m/s, 0.12 m,
            // 0.02 rad.
            let r = ours.displacement_to(&other.position()).unwrap();
            let v = ours.v_n() - other.v_n();
            let turned = (ours.c_b_n() * other.c_b_n().transpose() - Matrix3::identity()).amax();
            assert!(r.amax() < 5e-3, "{j}: {r}");
            assert!(v.amax() < 5e-3, "{j}: {v}");
            assert!(turned < 5e-4, "{j}: {turned}");
        }
    }
}
