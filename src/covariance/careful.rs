//! The update in double words: for the few steps in which a variance collapses, and the place where a step is refused.
//!
//! An update that takes a quarter or less of a variance as it was leaves 2⁻²⁴ of the old one as rounding of what is
//! subtracted, for good where no process noise flows. Here every product and sum is carried in two words instead, and
//! the row and column of a state that is measured by itself are not subtracted at all but multiplied by r/s.
//!
//! It also does the Schmidt (consider) update: states that the rows may not move, whose uncertainty still counts.
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
//! Written in loops and for any number of rows at run time: it is one piece of code for all M.

use super::packed::{at, Covariance};
use super::update::Gate;
use crate::error::Error;
use crate::linalg::{all_finite, looped, looped_mut, rolled, Pair, Real};

/// M rows with M known at run time.
pub(super) struct Lines<'a, T, const N: usize> {
    pub nu: &'a [T],
    pub r: &'a [T],
    pub gate: Option<T>,
    pub h: Pattern<'a, T, N>,
    /// Bit i: the rows may not move state i.
    pub considered: u32,
}

pub(super) enum Pattern<'a, T, const N: usize> {
    /// Row m is −1 on state `first + m`.
    Direct { first: usize },
    /// M × N, column after column; column j is to be multiplied by `unit[j]`.
    Dense { h: &'a [T], unit: &'a [T; N] },
}

/// Where the outcome goes; slices of length M.
pub(super) struct Outcome<'a, T, const N: usize> {
    pub s: &'a mut [T],
    pub nis: &'a mut T,
    pub row_nis: &'a mut [T],
    pub accepted: &'a mut [bool],
    pub dx: &'a mut [T; N],
    pub decrease: &'a mut [T; N],
    pub p_before: &'a mut [T; N],
    pub p_after: &'a mut [T; N],
}

/// Room for the work, sized by the caller.
pub(super) struct Panel<'a, T, const N: usize> {
    /// P h of each row given those before it; the measured state's own entry as [`replace`] leaves it.
    pub c: &'a mut [[Pair<T>; N]],
    /// 1/s of each row given those before it; zero for a row that was gated out.
    pub inverse: &'a mut [Pair<T>],
    /// Variance that a measured state starts from once its row and column have been cleared; zero for the others.
    pub fresh: [T; N],
}

/// Whether bit i of `considered` is set.
fn held(considered: u32, i: usize) -> bool {
    i < 32 && considered >> i & 1 != 0
}

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// All that can refuse the rows, `accept` included; they are then in `panel`, to be committed.
    #[cold]
    #[inline(never)]
    pub(super) fn take_carefully(
        &self,
        lines: &Lines<'_, T, N>,
        out: &mut Outcome<'_, T, N>,
        panel: &mut Panel<'_, T, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        lines.check()?;
        *out.dx = [T::zero(); N];
        *out.nis = T::zero();
        for m in 0..lines.nu.len() {
            self.row(m, lines, out, panel)?;
        }
        self.check_variances(lines, out, panel)?;
        accept(out.dx)
    }

    /// Forms row m given the rows before it, gates it and takes its share of δx. For itself, as the other two: nothing of
    /// it lies below the correction of the nominal state.
    #[inline(never)]
    fn row(
        &self,
        m: usize,
        lines: &Lines<'_, T, N>,
        out: &mut Outcome<'_, T, N>,
        panel: &mut Panel<'_, T, N>,
    ) -> Result<(), Error> {
        // rooms, until there is something to say
        let (h, none) = (&mut *out.p_after, &mut *out.p_before);
        (*h, *none) = const { ([T::ZERO; N], [T::ZERO; N]) };
        let (nu, r) = lines.row(m, h);
        let (earlier, rest) = panel.c.split_at_mut_checked(m).unwrap_or_default();
        let (Some(c), Some(inverse)) = (rest.first_mut(), panel.inverse.get_mut(..=m)) else {
            return Ok(());
        };

        // the row by itself
        *c = [Pair::ZERO; N];
        self.add_product(c, h, none);
        let alone = inner(h, c, 0).hi + r;
        // given the rows before it
        *c = [Pair::ZERO; N];
        self.add_product(c, h, &panel.fresh);
        for (c_k, inverse) in earlier.iter().zip(inverse.iter()) {
            // what row k took from a pair of states, and from a pair of which one is held
            let l = inner(h, c_k, 0).mul(*inverse);
            let l_held = match lines.considered {
                0 => l,
                considered => inner(h, c_k, considered).mul(*inverse),
            };
            for (i, (c, c_k)) in looped_mut(c).iter_mut().zip(c_k).enumerate() {
                rolled();
                let held = held(lines.considered, i);
                *c = c.less_product(*c_k, if held { l_held } else { l });
            }
        }
        let s = inner(h, c, 0).add(Pair::of(r));
        if !(s.hi > T::zero() && s.hi.finite() && alone.finite()) {
            return Err(Error::InnovationVariance { row: m as u8 });
        }
        let one_over_s = s.reciprocal();
        let mut e = nu;
        for (h, x) in looped(h).iter().zip(out.dx.iter()) {
            rolled();
            e -= *h * *x;
        }
        let nis = e * e * one_over_s.hi;
        let used = Gate(lines.gate).passes(nis)?;
        if let (Some(s), Some(n), Some(a)) = (
            out.s.get_mut(m),
            out.row_nis.get_mut(m),
            out.accepted.get_mut(m),
        ) {
            (*s, *n, *a) = (alone, nis, used);
        }
        let Some(inverse) = inverse.last_mut() else {
            return Ok(());
        };
        if !used {
            *inverse = Pair::ZERO;
            *c = [Pair::ZERO; N];
            return Ok(());
        }
        *inverse = one_over_s;
        *out.nis += nis;
        let gain = e * one_over_s.hi;
        for (i, (x, c)) in looped_mut(out.dx).iter_mut().zip(c.iter()).enumerate() {
            rolled();
            if !held(lines.considered, i) {
                *x += c.hi * gain;
            }
        }
        if r + r < s.hi && lines.considered == 0 {
            replace(h, r, earlier, c, &mut panel.fresh);
        }
        Ok(())
    }

    /// c ← c + P h, with P of cleared states diagonal.
    #[inline(never)]
    fn add_product(&self, c: &mut [Pair<T>; N], h: &[T; N], fresh: &[T; N]) {
        for (j, (h, fresh_j)) in looped(h).iter().zip(fresh).enumerate() {
            rolled();
            if *h == T::zero() {
                continue;
            }
            for (i, (c, fresh_i)) in looped_mut(c).iter_mut().zip(fresh).enumerate() {
                rolled();
                let p = self.base(i, j, *fresh_i, *fresh_j);
                *c = c.add(p.mul(Pair::of(*h)));
            }
        }
    }

    /// Element (i, j) before any row, rows and columns of cleared states left out.
    #[inline(always)]
    fn base(&self, i: usize, j: usize, fresh_i: T, fresh_j: T) -> Pair<T> {
        if fresh_i > T::zero() || fresh_j > T::zero() {
            return if i == j {
                Pair::of(fresh_j)
            } else {
                Pair::ZERO
            };
        }
        let k = at(i, j);
        match (self.hi.get(k), self.lo.get(k)) {
            (Some(hi), Some(lo)) => Pair { hi: *hi, lo: *lo },
            _ => Pair::ZERO,
        }
    }

    /// Every variance after the update, all of which must be finite and positive; a state known exactly stays so.
    #[inline(never)]
    fn check_variances(
        &self,
        lines: &Lines<'_, T, N>,
        out: &mut Outcome<'_, T, N>,
        panel: &Panel<'_, T, N>,
    ) -> Result<(), Error> {
        let states = looped_mut(out.p_before)
            .iter_mut()
            .zip(out.p_after.iter_mut());
        let states = states.zip(out.decrease.iter_mut()).enumerate();
        for (j, ((before, after), decrease)) in states {
            rolled();
            let fresh = panel.fresh.get(j).copied().unwrap_or_else(T::zero);
            let mut d = Pair::ZERO;
            let used = panel.c.iter().zip(panel.inverse.iter());
            for (c, inverse) in used.filter(|_| !held(lines.considered, j)) {
                rolled();
                if let Some(c) = c.get(j) {
                    d = d.add(c.mul(c.mul(*inverse)));
                }
            }
            let p = self.base(j, j, fresh, fresh).sub(d).hi;
            (*before, *after) = (self.variance(j), p);
            *decrease = if fresh > T::zero() { *before - p } else { d.hi };
            let known = *before == T::zero() && d.hi == T::zero();
            if !(p > T::zero() && p.finite() || known) {
                return Err(Error::Variance { state: j as u8 });
            }
        }
        Ok(())
    }

    /// P ← P − Σ c cᵀ/s of M rows, but for pairs of considered states.
    #[inline(never)]
    pub(super) fn commit<const M: usize>(&mut self, considered: u32, panel: &Panel<'_, T, N>) {
        self.commit_rows(considered, panel, &mut [Pair::ZERO; M]);
    }

    /// `gain`: room for c/s of one column of the triangle.
    #[inline(never)]
    fn commit_rows(&mut self, considered: u32, panel: &Panel<'_, T, N>, gain: &mut [Pair<T>]) {
        let mut k = 0;
        for (j, fresh_j) in looped(&panel.fresh).iter().enumerate() {
            let columns = panel.c.iter().zip(panel.inverse.iter());
            for (g, (c, inverse)) in gain.iter_mut().zip(columns) {
                rolled();
                *g = c.get(j).map_or(Pair::ZERO, |c| c.mul(*inverse));
            }
            for (i, fresh_i) in panel.fresh.iter().enumerate().take(j + 1) {
                rolled();
                if held(considered, i) && held(considered, j) {
                    k += 1;
                    continue;
                }
                let mut p = self.base(i, j, *fresh_i, *fresh_j);
                for (g, c) in gain.iter().zip(panel.c.iter()) {
                    rolled();
                    if let Some(c) = c.get(i) {
                        p = p.less_product(*c, *g);
                    }
                }
                if let (Some(hi), Some(lo)) = (self.hi.get_mut(k), self.lo.get_mut(k)) {
                    (*hi, *lo) = (p.hi, p.lo);
                }
                k += 1;
            }
        }
    }
}

impl<T: Real, const N: usize> Lines<'_, T, N> {
    /// Everything that can be refused without looking at P.
    fn check(&self) -> Result<(), Error> {
        let gate = self.gate.unwrap_or_else(T::zero);
        let rows = self.nu.len();
        match self.h {
            Pattern::Dense { h, unit } => {
                let columns = h.chunks_exact(rows.max(1)).zip(unit);
                if !columns.fold(true, |good, (h, u)| {
                    good & h.iter().all(|h| {
                        rolled();
                        (*h * *u).finite()
                    })
                }) {
                    return Err(Error::NonFinite);
                }
            }
            Pattern::Direct { first } if first > N || rows > N - first => {
                return Err(Error::OutOfRange)
            }
            _ => {}
        }
        if !(all_finite(self.nu) && all_finite(self.r) && gate.finite()) {
            return Err(Error::NonFinite);
        }
        if gate < T::zero() || self.r.iter().any(not_positive) {
            return Err(Error::OutOfRange);
        }
        Ok(())
    }

    /// ν and r of row m, and its h into `row`, which holds zeros. The sign of a direct row is turned, and that of its
    /// innovation with it: nothing changes.
    fn row(&self, m: usize, row: &mut [T; N]) -> (T, T) {
        let get = |x: &[T]| x.get(m).copied().unwrap_or_else(T::zero);
        let (nu, r) = (get(self.nu), get(self.r));
        match self.h {
            Pattern::Direct { first } => {
                if let Some(x) = row.get_mut(first + m) {
                    *x = T::one();
                }
                (-nu, r)
            }
            Pattern::Dense { h, unit } => {
                let columns = h.chunks_exact(self.nu.len().max(1)).zip(unit);
                for (x, (column, unit)) in looped_mut(row).iter_mut().zip(columns) {
                    rolled();
                    *x = get(column) * *unit;
                }
                (nu, r)
            }
        }
    }
}

fn not_positive<T: Real>(r: &T) -> bool {
    rolled();
    *r <= T::zero()
}

/// hᵀ c, states of which a bit is set in `without` left out.
#[inline(never)]
fn inner<T: Real, const N: usize>(h: &[T; N], c: &[Pair<T>; N], without: u32) -> Pair<T> {
    let mut sum = Pair::ZERO;
    for (i, (h, c)) in looped(h).iter().zip(c).enumerate() {
        rolled();
        if *h != T::zero() && !held(without, i) {
            sum = sum.add(c.mul(Pair::of(*h)));
        }
    }
    sum
}

/// For a row h that measures one state alone, x h: writes the update of that state's row and column as a product.
///
/// ```text
/// P⁺ₖᵢ = Pₖᵢ − Pₖₖ x² Pₖᵢ/s = Pₖᵢ r/s        with s = x² Pₖₖ + r
/// ```
///
/// The sweep P − Σ c cᵀ/s gives just that when row and column k of P are cleared, its variance is set to r/x², cₖ of
/// this row is set to −r/x and cₖ of the rows before it to zero. Nothing is subtracted from Pₖₖ then, and what is
/// subtracted from r/x² is less than half of it. Later rows go on from there like from any other P.
fn replace<T: Real, const N: usize>(
    h: &[T; N],
    r: T,
    earlier: &mut [[Pair<T>; N]],
    c: &mut [Pair<T>; N],
    fresh: &mut [T; N],
) {
    let mut measured = looped(h).iter().enumerate().filter(|(_, x)| {
        rolled();
        **x != T::zero()
    });
    let (Some((k, x)), None) = (measured.next(), measured.next()) else {
        return;
    };
    let root = r / *x;
    let variance = root / *x;
    if !(variance > T::zero() && variance.finite()) {
        return;
    }
    if let (Some(c), Some(fresh)) = (c.get_mut(k), fresh.get_mut(k)) {
        // r/x in one word: P̃ₖₖ and cₖ only have to agree with each other
        *c = Pair::of(-root);
        *fresh = variance;
    }
    for c in earlier.iter_mut().filter_map(|c| c.get_mut(k)) {
        rolled();
        *c = Pair::ZERO;
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
