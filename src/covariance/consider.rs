//! The Schmidt (consider) update: states that the rows may not move, whose uncertainty still counts.
//!
//! ```text
//! c = P hᵀ,  s = h c + r,  k_e = c_e/s,  k_c = 0
//! P_ee ← P_ee − c_e c_eᵀ/s,    P_ec ← P_ec − c_e c_cᵀ/s,    P_cc stays
//! ```
//!
//! e: estimated, c: considered states. The gain of the estimated states is the optimal one for an estimator that leaves
//! the others alone, so P is the true covariance of what it does: the correlations grow as they must, and when a state
//! is released its next update starts from an honest P. Source: Schmidt 1966; Bierman 1977, chapter VIII.
//!
//! In double words and loops throughout: it is meant for a filter whose gate is closed, not for the fast path.

use super::careful::inner;
use super::packed::{at, Covariance};
use super::update::{Gate, Lines, Slots};
use crate::error::Error;
use crate::linalg::{Pair, Real};

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// [`Covariance::update_considering`], with its outcome written where the caller has room for it; after an error there
    /// may be anything.
    #[cold]
    #[inline(never)]
    pub(super) fn consider<const M: usize>(
        &mut self,
        rows: &Lines<'_, T, M, N>,
        considered: u32,
        out: &mut Slots<'_, T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        const { Self::SIZE };
        let scaled = rows.scaled();
        let lines = rows.plain(&scaled);
        lines.check()?;
        let held = |i: usize| i < 32 && considered >> i & 1 != 0;
        let mut work = *self;
        *out.p_before = self.diagonal();
        (*out.dx, *out.decrease) = ([T::zero(); N], [T::zero(); N]);
        *out.nis = T::zero();
        let outcome = out.s.iter_mut().zip(out.row_nis.iter_mut());
        for (m, ((s_alone, row_nis), accepted)) in outcome.zip(out.accepted.iter_mut()).enumerate()
        {
            let (h, nu, r) = lines.row(m);
            let alone = inner(&h, &self.times(&h)).hi + r;
            let c = work.times(&h);
            let s = inner(&h, &c).add(Pair::of(r));
            if !(s.hi > T::zero() && s.hi.finite() && alone.finite()) {
                return Err(Error::InnovationVariance { row: m as u8 });
            }
            let inverse = s.reciprocal();
            let mut e = nu;
            for (h, x) in h.iter().zip(out.dx.iter()) {
                e -= *h * *x;
            }
            let nis = e * e * inverse.hi;
            let used = Gate(rows.gate).passes(nis)?;
            (*s_alone, *row_nis, *accepted) = (alone, nis, used);
            if !used {
                continue;
            }
            *out.nis += nis;
            let mut k = 0;
            for (j, c_j) in c.iter().enumerate() {
                let gain = c_j.mul(inverse);
                if !held(j) {
                    if let (Some(x), Some(d)) = (out.dx.get_mut(j), out.decrease.get_mut(j)) {
                        *x += gain.hi * e;
                        *d += gain.mul(*c_j).hi;
                    }
                }
                for (i, c_i) in c.iter().enumerate().take(j + 1) {
                    if !(held(i) && held(j)) {
                        if let (Some(hi), Some(lo)) = (work.hi.get_mut(k), work.lo.get_mut(k)) {
                            let p = Pair { hi: *hi, lo: *lo }.sub(c_i.mul(gain));
                            (*hi, *lo) = (p.hi, p.lo);
                        }
                    }
                    k += 1;
                }
            }
        }
        *out.p_after = work.diagonal();
        for (i, (before, after)) in out.p_before.iter().zip(out.p_after.iter()).enumerate() {
            let known = *before == T::zero() && *after == T::zero();
            if !(*after > T::zero() && after.finite() || known) {
                return Err(Error::Variance { state: i as u8 });
            }
        }
        accept(out.dx)?;
        *self = work;
        Ok(())
    }

    /// P h.
    fn times(&self, h: &[T; N]) -> [Pair<T>; N] {
        let mut c = [Pair::zero(); N];
        for (j, h) in h.iter().enumerate() {
            if *h == T::zero() {
                continue;
            }
            for (i, c) in c.iter_mut().enumerate() {
                let k = at(i, j);
                if let (Some(hi), Some(lo)) = (self.hi.get(k), self.lo.get(k)) {
                    *c = c.add(Pair { hi: *hi, lo: *lo }.mul(Pair::of(*h)));
                }
            }
        }
        c
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::covariance::{Observation, Rows};
    use nalgebra::{Matrix3, SMatrix, Vector3};

    fn p0() -> Matrix3<f64> {
        Matrix3::new(2.0, 0.5, 0.1, 0.5, 1.0, -0.2, 0.1, -0.2, 0.7)
    }

    /// Any gain K: P⁺ = (I − K H) P (I − K H)ᵀ + K R Kᵀ. With the rows of K that belong to considered states set to
    /// zero after the optimal gain of each single row, this is the update.
    #[test]
    fn it_is_joseph_with_the_gain_of_the_considered_states_at_zero() {
        let h = SMatrix::<f64, 2, 3>::new(0.4, -1.0, 0.3, 0.0, 0.5, -1.0);
        let (nu, r) = ([0.3, -0.4], [0.1, 0.2]);
        for considered in [0b000u32, 0b100, 0b011] {
            let mut dense = p0();
            let mut dx = Vector3::zeros();
            for m in 0..2 {
                let row = h.row(m);
                let s = (row * dense * row.transpose()).x + r[m];
                let mut gain = dense * row.transpose() / s;
                for i in 0..3 {
                    if considered >> i & 1 != 0 {
                        gain[i] = 0.0;
                    }
                }
                dx += gain * (nu[m] - (row * dx).x);
                let left = Matrix3::identity() - gain * row;
                dense = left * dense * left.transpose() + gain * gain.transpose() * r[m];
            }
            let mut p = Covariance::<f64, 3, 6>::from_matrix(&p0()).unwrap();
            let rows = Rows {
                nu,
                h: Observation::Dense(h),
                r,
                gate: None,
            };
            let update = p.update_considering(&rows, considered, |_| Ok(())).unwrap();
            assert!((p.to_matrix() - dense).amax() < 1e-15, "{considered:b}");
            assert!((Vector3::from(update.dx) - dx).amax() < 1e-15);
            for i in 0..3 {
                let decrease = p0()[(i, i)] - dense[(i, i)];
                assert!((update.decrease[i] - decrease).abs() < 1e-15);
                if considered >> i & 1 != 0 {
                    // not one bit
                    assert_eq!((update.dx[i], p.variance(i)), (0.0, p0()[(i, i)]));
                }
            }
        }
    }

    #[test]
    fn a_refused_update_changes_nothing() {
        let mut p = Covariance::<f64, 3, 6>::from_matrix(&p0()).unwrap();
        let before = p;
        let rows = |nu, r| Rows {
            nu: [nu],
            h: Observation::Direct { first: 1 },
            r: [r],
            gate: None,
        };
        let mut with = |rows, accept: Result<(), Error>| {
            p.update_considering(&rows, 1, |_| accept).map(|_| ())
        };
        assert_eq!(with(rows(f64::NAN, 1.0), Ok(())), Err(Error::NonFinite));
        assert_eq!(with(rows(1.0, 0.0), Ok(())), Err(Error::OutOfRange));
        assert_eq!(with(rows(1.0, 1.0), Err(Error::Polar)), Err(Error::Polar));
        assert_eq!(p, before);
    }
}
