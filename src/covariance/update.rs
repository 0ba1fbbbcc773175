//! The measurement update: M rows, each with its gate, refused as a whole or done.

use super::careful::{self, Outcome, Panel};
use super::packed::Covariance;
use crate::error::Error;
use crate::linalg::{Pair, Real};
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

/// The numbers of M rows as the kernels read them.
pub(crate) struct Lines<'a, T, const M: usize> {
    pub nu: &'a [T; M],
    pub r: &'a [T; M],
    pub gate: Option<T>,
}

/// [`Observation`], borrowed.
#[derive(Clone, Copy)]
pub(crate) enum Pattern<'a, T, const M: usize, const N: usize> {
    Direct {
        first: usize,
    },
    /// H, and the unit of each state: column j is h times `unit[j]`.
    Dense {
        h: &'a SMatrix<T, M, N>,
        unit: &'a [T; N],
    },
}

/// Where the kernels write what [`Update`] says.
pub(crate) struct Slots<'a, T, const M: usize, const N: usize> {
    pub s: &'a mut [T; M],
    pub nis: &'a mut T,
    pub row_nis: &'a mut [T; M],
    pub accepted: &'a mut [bool; M],
    pub dx: &'a mut [T; N],
    pub decrease: &'a mut [T; N],
    pub p_before: &'a mut [T; N],
    pub p_after: &'a mut [T; N],
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
    #[inline(always)]
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
    #[inline(always)] // so that the outcome is built where the caller wants it, not copied there
    pub fn update_if<const M: usize>(
        &mut self,
        rows: &Rows<T, M, N>,
        accept: impl FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<Update<T, M, N>, Error> {
        self.update_considering(rows, 0, accept)
    }

    /// As [`Covariance::update_if`], but the states of which a bit is set in `considered` are not moved: their δx and
    /// their decrease are 0, and their variances and the covariances among them stay as they are (Schmidt).
    ///
    /// # Errors
    /// Those of [`Covariance::update_if`], the covariance then bit-identical.
    #[inline(always)]
    pub fn update_considering<const M: usize>(
        &mut self,
        rows: &Rows<T, M, N>,
        considered: u32,
        mut accept: impl FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<Update<T, M, N>, Error> {
        let one = [T::one(); N];
        let any = const { [T::ZERO; N] }; // written before it is seen
        let mut out = Update {
            nu: rows.nu,
            s: rows.r,
            nis: T::zero(),
            row_nis: rows.r,
            accepted: [false; M],
            dx: any,
            decrease: any,
            p_before: any,
            p_after: any,
        };
        let lines = Lines {
            nu: &rows.nu,
            r: &rows.r,
            gate: rows.gate,
        };
        let h = match &rows.h {
            Observation::Direct { first } => Pattern::Direct { first: *first },
            Observation::Dense(h) => Pattern::Dense { h, unit: &one },
        };
        let mut slots = Slots {
            s: &mut out.s,
            nis: &mut out.nis,
            row_nis: &mut out.row_nis,
            accepted: &mut out.accepted,
            dx: &mut out.dx,
            decrease: &mut out.decrease,
            p_before: &mut out.p_before,
            p_after: &mut out.p_after,
        };
        self.update_into(&lines, h, considered, &mut slots, &mut accept)?;
        Ok(out)
    }

    /// The update with its outcome written where the caller has room for it; after an error there may be anything.
    #[inline(always)]
    fn update_into<const M: usize>(
        &mut self,
        rows: &Lines<'_, T, M>,
        h: Pattern<'_, T, M, N>,
        considered: u32,
        out: &mut Slots<'_, T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        const { assert!(M > 0, "an update has rows") };
        const { Self::SIZE };
        let done = considered == 0
            && match h {
                Pattern::Direct { first: 2 } if M == 1 => {
                    self.update_block::<M, 2>(rows, out, accept)?
                }
                Pattern::Direct { first: 3 } if M == 3 => {
                    self.update_block::<M, 3>(rows, out, accept)?
                }
                _ => {
                    let mut room = const { [[T::ZERO; N]; M] };
                    self.update_swiftly(rows, h, &mut room, out, accept)?
                }
            };
        if done {
            return Ok(());
        }
        self.update_carefully_by(rows, h, considered, None, out, accept)
    }

    /// The same in double words from the start. `room`: for working, with anything in it; `None` where the stack has it.
    #[inline(always)]
    pub(crate) fn update_carefully_by<const M: usize>(
        &mut self,
        rows: &Lines<'_, T, M>,
        h: Pattern<'_, T, M, N>,
        considered: u32,
        room: Option<&mut [[Pair<T>; N]; M]>,
        out: &mut Slots<'_, T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let h = match h {
            Pattern::Direct { first } => careful::Pattern::Direct { first },
            Pattern::Dense { h, unit } => careful::Pattern::Dense {
                h: h.as_slice(),
                unit,
            },
        };
        match room {
            Some(room) => self.carefully(rows, h, considered, room, out, accept),
            None => self.carefully_on_the_stack(rows, h, considered, out, accept),
        }
    }

    #[cold]
    #[inline(never)]
    fn carefully_on_the_stack<const M: usize>(
        &mut self,
        rows: &Lines<'_, T, M>,
        h: careful::Pattern<'_, T, N>,
        considered: u32,
        out: &mut Slots<'_, T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let mut room = [[Pair::ZERO; N]; M];
        self.carefully(rows, h, considered, &mut room, out, accept)
    }

    /// Slices of the right size around the careful update.
    #[cold]
    #[inline(never)]
    fn carefully<const M: usize>(
        &mut self,
        rows: &Lines<'_, T, M>,
        h: careful::Pattern<'_, T, N>,
        considered: u32,
        room: &mut [[Pair<T>; N]; M],
        out: &mut Slots<'_, T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let lines = careful::Lines {
            nu: rows.nu,
            r: rows.r,
            gate: rows.gate,
            h,
            considered,
        };
        let mut outcome = Outcome {
            s: out.s,
            nis: out.nis,
            row_nis: out.row_nis,
            accepted: out.accepted,
            dx: out.dx,
            decrease: out.decrease,
            p_before: out.p_before,
            p_after: out.p_after,
        };
        let mut panel = Panel {
            c: room,
            inverse: &mut [Pair::ZERO; M],
            fresh: [T::ZERO; N],
        };
        self.take_carefully(&lines, &mut outcome, &mut panel, accept)?;
        self.commit::<M>(considered, &panel);
        Ok(())
    }
}

/// Limit on a row's ν²/s.
pub(super) struct Gate<T>(pub Option<T>);

impl<T: Real> Gate<T> {
    /// Whether the row may be used. Without a gate, a ν²/s that overflows is refused: nothing in P can explain it.
    #[inline(always)]
    pub fn passes(&self, nis: T) -> Result<bool, Error> {
        match self.0 {
            Some(gate) => Ok(nis <= gate),
            None if nis.finite() => Ok(true),
            None => Err(Error::OutOfRange),
        }
    }
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
