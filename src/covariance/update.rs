//! The measurement update: M rows in one sweep over the triangle.
#![allow(clippy::needless_range_loop)] // small matrices, read as in the equations

use super::packed::{upper, Covariance};
use crate::error::Error;
use crate::linalg::{two_add, Real};
use nalgebra::SMatrix;

/// What M rows measure, as the derivative of the innovation by the state error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Observation<T, const M: usize, const N: usize> {
    /// Row m is −1 on state `first + m` and 0 elsewhere: the state itself is measured, its error being estimate minus
    /// truth.
    Direct {
        /// State of row 0.
        first: usize,
    },
    /// Any rows.
    Dense(SMatrix<T, M, N>),
}

/// M uncorrelated measurement rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rows<T, const M: usize, const N: usize> {
    /// Innovation ν = z − h(x̂) of each row.
    pub nu: [T; M],
    /// ∂ν/∂δx.
    pub h: Observation<T, M, N>,
    /// Noise variance of each row, above 0.
    pub r: [T; M],
    /// Largest ν²/s a row may have, s being its variance given the rows accepted before it; `None` accepts all.
    pub gate: Option<T>,
}

/// What an update did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update<T, const M: usize, const N: usize> {
    /// The innovations as given.
    pub nu: [T; M],
    /// Innovation variance H P Hᵀ + R of each row by itself, before any row was used.
    pub s: [T; M],
    /// Normalised innovation squared of all accepted rows together: Σ of their `row_nis`, χ² with that many degrees.
    pub nis: T,
    /// ν²/s of each row given the accepted rows before it; what the gate looked at.
    pub row_nis: [T; M],
    /// Which rows were used.
    pub accepted: [bool; M],
    /// Estimated state error: subtract it from the estimate.
    pub dx: [T; N],
    /// p⁻ − p⁺ of each state, summed from the update's own terms: right where the difference of the two variances
    /// would be rounding. Never negative.
    pub decrease: [T; N],
    /// Variances before.
    pub p_before: [T; N],
    /// Variances after.
    pub p_after: [T; N],
}

/// The rows reduced to sequential ones: row m of the panel is uncorrelated with the rows before it.
struct Sequence<T, const M: usize> {
    /// l[m][k], k < m: how much of row k is in row m.
    l: [[T; M]; M],
    /// 1/s of each row given those before; 0 for a row that was gated out.
    inverse: [T; M],
    /// Innovation of each row given those before, over its s.
    gain: [T; M],
}

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// Takes in M rows: K = P Hᵀ S⁻¹, δx = K ν, P ← P − K S Kᵀ, the rows one after the other in exact sequence, the
    /// triangle swept once.
    ///
    /// # Errors
    /// * [`Error::NonFinite`] — ν, R, H or the gate is NaN or infinite
    /// * [`Error::OutOfRange`] — a noise variance is not positive, a gate is negative, a direct row has no state, or an
    ///   ungated innovation is so large that ν²/s overflows
    /// * [`Error::InnovationVariance`] — an innovation variance is not finite and positive
    /// * [`Error::Variance`] — a variance would not be finite and positive afterwards
    ///
    /// After any of these the covariance is bit-identical to what it was.
    pub fn update<const M: usize>(
        &mut self,
        rows: &Rows<T, M, N>,
    ) -> Result<Update<T, M, N>, Error> {
        self.update_if(rows, |_| Ok(()))
    }

    /// As [`Covariance::update`], and `accept` has the last word: it is handed δx when everything else has been
    /// checked and nothing has been written yet. Its error is returned, the covariance then bit-identical.
    ///
    /// # Errors
    /// Those of [`Covariance::update`] and of `accept`.
    pub fn update_if<const M: usize>(
        &mut self,
        rows: &Rows<T, M, N>,
        accept: impl FnOnce(&[T; N]) -> Result<(), Error>,
    ) -> Result<Update<T, M, N>, Error> {
        const { Self::SIZE };
        check(rows)?;
        // c[m] = P h_mᵀ (its negative for direct rows, whose innovation then changes sign as well), g = H P Hᵀ
        let mut c = [[T::zero(); N]; M];
        let mut g = [[T::zero(); M]; M];
        let mut nu = rows.nu;
        match &rows.h {
            Observation::Direct { first } => {
                for (m, (c, g)) in c.iter_mut().zip(&mut g).enumerate() {
                    *c = self.column(first + m);
                    for (g, x) in g.iter_mut().zip(c.iter().skip(*first)) {
                        *g = *x;
                    }
                }
                nu = nu.map(|x| -x);
            }
            Observation::Dense(h) => {
                for (m, (c, g)) in c.iter_mut().zip(&mut g).enumerate() {
                    for (j, x) in h.row(m).iter().enumerate() {
                        if *x != T::zero() {
                            for (c, p) in c.iter_mut().zip(self.column(j)) {
                                *c += *x * p;
                            }
                        }
                    }
                    for (g, h) in g.iter_mut().zip(h.row_iter()) {
                        for (h, c) in h.iter().zip(c.iter()) {
                            *g += *h * *c;
                        }
                    }
                }
            }
        }
        let mut u = Update {
            nu: rows.nu,
            s: [T::zero(); M],
            nis: T::zero(),
            row_nis: [T::zero(); M],
            accepted: [false; M],
            dx: [T::zero(); N],
            decrease: [T::zero(); N],
            p_before: [T::zero(); N],
            p_after: [T::zero(); N],
        };
        let q = sequence(&g, &nu, rows, &mut u)?;
        // panel of the sequential rows
        for m in 1..M {
            for k in 0..m {
                let l = q.l[m][k];
                for i in 0..N {
                    c[m][i] -= l * c[k][i];
                }
            }
        }
        // variances and correction first: they decide whether the rest happens
        for j in 0..N {
            let mut d = T::zero();
            let mut x = T::zero();
            for m in 0..M {
                d += c[m][j] * (c[m][j] * q.inverse[m]);
                x += c[m][j] * q.gain[m];
            }
            let (Some(hi), Some(lo)) = (self.hi.get(upper(j, j)), self.lo.get(upper(j, j))) else {
                continue;
            };
            u.dx[j] = x;
            u.decrease[j] = d;
            u.p_before[j] = *hi;
            u.p_after[j] = two_add(*hi, *lo, -d).0;
            // a state known exactly stays so: 0 − 0
            let known = *hi == T::zero() && d == T::zero();
            if !((u.p_after[j] > T::zero() && u.p_after[j].finite()) || known) {
                return Err(Error::Variance { state: j as u8 });
            }
        }
        accept(&u.dx)?;
        if u.accepted.iter().any(|a| *a) {
            self.sweep(&c, &q.inverse);
        }
        Ok(u)
    }

    /// P ← P − Σ c cᵀ/s.
    fn sweep<const M: usize>(&mut self, c: &[[T; N]; M], inverse: &[T; M]) {
        for j in 0..N {
            for i in 0..=j {
                let mut d = T::zero();
                for m in 0..M {
                    d += c[m][i] * (c[m][j] * inverse[m]);
                }
                self.add(upper(i, j), -d);
            }
        }
    }
}

/// Everything that can be refused without looking at P.
fn check<T: Real, const M: usize, const N: usize>(rows: &Rows<T, M, N>) -> Result<(), Error> {
    if rows.nu.iter().chain(&rows.r).any(|x| !x.finite()) {
        return Err(Error::NonFinite);
    }
    if rows.r.iter().any(|r| *r <= T::zero()) {
        return Err(Error::OutOfRange);
    }
    match rows.gate {
        Some(g) if !g.finite() => return Err(Error::NonFinite),
        Some(g) if g < T::zero() => return Err(Error::OutOfRange),
        _ => {}
    }
    match &rows.h {
        Observation::Direct { first } if *first > N || *first + M > N => Err(Error::OutOfRange),
        Observation::Dense(h) if h.iter().any(|x| !x.finite()) => Err(Error::NonFinite),
        _ => Ok(()),
    }
}

/// Factorises H P Hᵀ + R row after row, gating each.
#[inline(always)]
fn sequence<T: Real, const M: usize, const N: usize>(
    g: &[[T; M]; M],
    nu: &[T; M],
    rows: &Rows<T, M, N>,
    u: &mut Update<T, M, N>,
) -> Result<Sequence<T, M>, Error> {
    let zero = T::zero();
    let mut q = Sequence {
        l: [[zero; M]; M],
        inverse: [zero; M],
        gain: [zero; M],
    };
    let mut w = [[zero; M]; M]; // w[m][k] = l[m][k] s_k
    for m in 0..M {
        let mut s = g[m][m] + rows.r[m];
        let mut e = nu[m];
        u.s[m] = s;
        for k in 0..m {
            s -= w[m][k] * q.l[m][k];
            e -= w[m][k] * q.gain[k];
        }
        if !(s > zero && s.finite()) {
            return Err(Error::InnovationVariance { row: m as u8 });
        }
        let nis = e * e / s;
        if !nis.finite() && rows.gate.is_none() {
            return Err(Error::OutOfRange); // nothing in P can explain it, and δx would overflow
        }
        u.row_nis[m] = nis;
        u.accepted[m] = match rows.gate {
            Some(gate) => nis <= gate,
            None => true,
        };
        if u.accepted[m] {
            u.nis += nis;
            q.inverse[m] = T::one() / s;
            q.gain[m] = e * q.inverse[m];
        }
        for n in m + 1..M {
            let mut x = g[n][m];
            for k in 0..m {
                x -= w[n][k] * q.l[m][k];
            }
            w[n][m] = x;
            q.l[n][m] = x * q.inverse[m];
        }
    }
    Ok(q)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, SVector, Vector3};

    #[test]
    fn one_step_and_one_update_are_the_textbook_ones() {
        let p0 = Matrix3::new(2.0, 0.5, 0.1, 0.5, 1.0, -0.2, 0.1, -0.2, 0.7);
        let a = Matrix3::new(0.1, 0.02, 0.0, 0.0, -0.3, 0.2, 0.05, 0.0, 0.0);
        let q = Vector3::new(0.01, 0.0, 0.2);
        let mut p = Covariance::<f64, 3, 6>::from_matrix(&p0).unwrap();
        p.propagate(&a, &q);
        let phi = Matrix3::identity() + a;
        let dense = phi * p0 * phi.transpose() + Matrix3::from_diagonal(&q);
        assert!((p.to_matrix() - dense).amax() < 1e-15);

        let h = SMatrix::<f64, 2, 3>::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0);
        let s = h * dense * h.transpose() + SMatrix::<f64, 2, 2>::from_diagonal_element(0.1);
        let gain = dense * h.transpose() * s.try_inverse().unwrap();
        let nu = SVector::<f64, 2>::new(0.3, -0.4);
        let after = dense - gain * h * dense;
        for h in [Observation::Direct { first: 1 }, Observation::Dense(h)] {
            let mut p = p;
            let u = p
                .update(&Rows {
                    nu: nu.into(),
                    h,
                    r: [0.1; 2],
                    gate: None,
                })
                .unwrap();
            assert!((p.to_matrix() - after).amax() < 1e-15);
            assert!((Vector3::from(u.dx) - gain * nu).amax() < 1e-15);
            assert!((u.nis - (nu.transpose() * s.try_inverse().unwrap() * nu).x).abs() < 1e-14);
            assert!((u.s[0] - s.m11).abs() < 1e-15 && (u.s[1] - s.m22).abs() < 1e-15);
            assert_eq!(u.p_after, p.diagonal());
        }
    }
}
