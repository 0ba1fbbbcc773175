//! The update of the 15-state triangle in one unrolled sweep: for every step in which no variance collapses but those of
//! the measured states themselves.
//!
//! One word per product. It writes nothing unless every row and every variance passes a check that is stricter than
//! the law; whatever it does not like goes to the careful update, which knows what is an error and what is only rare.
//!
//! Rows that measure states by themselves (FIRST below) need no subtraction in the rows and columns of these states:
//!
//! ```text
//! P⁺_:b = P_:b − P_:b S⁻¹ P_bb = P_:b S⁻¹ R = K R        with S = P_bb + R
//! ```
//!
//! which is a product, right to rounding however far the variance falls, and cheaper than a compensated sum. Their columns
//! hold the panel meanwhile: they are replaced last.

use super::packed::{at, upper, Covariance};
use super::panel::Six;
use super::sequence::{dot, each_row, sequence, times, Sequence};
use super::sweep::{forward, measured, Direct, Panel, NONE};
use super::update::{Lines, Pattern, Slots};
use crate::error::Error;
use crate::linalg::{each_state, in_order, two_add, Real};

/// Number of states this is written for.
const STATES: usize = 15;
/// Where P h is, and c.
enum Place<'a, T, const M: usize, const N: usize> {
    /// In the columns of the states that the rows measure, which the sweep makes to c.
    Columns(&'a Direct<T, M>),
    Panel(&'a mut Panel<T, M, N>),
}

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// Takes in rows that are −1 on the states from FIRST on and says true; or leaves the triangle as it is and says
    /// false.
    #[inline(always)]
    pub(crate) fn update_block<const M: usize, const FIRST: usize>(
        &mut self,
        rows: &Lines<'_, T, M>,
        out: &mut Slots<'_, T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<bool, Error> {
        if N != STATES {
            return Ok(false); // known at compile time: of the constant indices below nothing is left then
        }
        let (mut inverse, mut direct) = (const { [T::ZERO; M] }, Direct::NEW); // written before they are read
        if !self.form_block::<M, FIRST>(rows, out, &mut inverse, &mut direct) {
            return Ok(false);
        }
        accept(out.dx)?;
        self.sweep_block::<M, FIRST>(&inverse, &direct);
        Ok(true)
    }

    /// The same of any rows. `room`: for working, with anything in it.
    #[inline(always)]
    pub(crate) fn update_swiftly<const M: usize>(
        &mut self,
        rows: &Lines<'_, T, M>,
        h: Pattern<'_, T, M, N>,
        room: &mut Panel<T, M, N>,
        out: &mut Slots<'_, T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<bool, Error> {
        if N != STATES {
            return Ok(false);
        }
        self.update_formed(room, out, accept, |p, out, panel, inverse| {
            p.form_any(rows, h, out, panel, inverse)
        })
    }

    /// The same of the six rows of [`Six`].
    #[inline(always)]
    pub(crate) fn update_six<const M: usize>(
        &mut self,
        six: &Six<T>,
        rows: &Lines<'_, T, M>,
        room: &mut Panel<T, M, N>,
        out: &mut Slots<'_, T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<bool, Error> {
        if N != STATES || M != 6 {
            return Ok(false);
        }
        self.update_formed(room, out, accept, |p, out, panel, inverse| {
            p.form_six(six, rows, out, panel, inverse)
        })
    }

    /// The same of rows that measure no state by itself, whose panel `form` makes.
    #[inline(always)]
    fn update_formed<const M: usize>(
        &mut self,
        panel: &mut Panel<T, M, N>,
        out: &mut Slots<'_, T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
        form: impl FnOnce(&Self, &mut Slots<'_, T, M, N>, &mut Panel<T, M, N>, &mut [T; M]) -> bool,
    ) -> Result<bool, Error> {
        let mut inverse = const { [T::ZERO; M] };
        if !form(self, out, panel, &mut inverse) {
            return Ok(false);
        }
        accept(out.dx)?;
        self.sweep_panel(panel, &inverse);
        Ok(true)
    }

    #[inline(never)]
    fn form_six<const M: usize>(
        &self,
        six: &Six<T>,
        rows: &Lines<'_, T, M>,
        out: &mut Slots<'_, T, M, N>,
        panel: &mut Panel<T, M, N>,
        inverse: &mut [T; M],
    ) -> bool {
        let hph = self.six_panel(six, panel);
        match sequence(hph, &turned(rows.nu), rows, out) {
            Some(q) => self.variances::<M, NONE>(&q, Place::Panel(panel), out, inverse),
            None => false,
        }
    }

    /// Direct rows from state FIRST on, FIRST known at compile time, all of which pass their gates.
    #[inline(never)]
    fn form_block<const M: usize, const FIRST: usize>(
        &self,
        rows: &Lines<'_, T, M>,
        out: &mut Slots<'_, T, M, N>,
        inverse: &mut [T; M],
        direct: &mut Direct<T, M>,
    ) -> bool {
        let mut hph = const { [[T::ZERO; M]; M] };
        each_row!(m; { each_row!(k; hph[m][k] = self.hi[at(FIRST + m, FIRST + k)]); });
        match sequence(hph, &turned(rows.nu), rows, out) {
            Some(q) if out.accepted.iter().all(|used| *used) => {
                direct.l = q.l;
                each_row!(m; {
                    direct.shrink[m] = q.inverse[m] * rows.r[m];
                    each_row!(k; if k < m {
                        direct.back[k][m] = q.l[k][m] * (rows.r[k] / rows.r[m]);
                    });
                });
                self.variances::<M, FIRST>(&q, Place::Columns(direct), out, inverse)
            }
            _ => false,
        }
    }

    /// Any rows, each used or gated out.
    #[inline(never)]
    fn form_any<const M: usize>(
        &self,
        rows: &Lines<'_, T, M>,
        h: Pattern<'_, T, M, N>,
        out: &mut Slots<'_, T, M, N>,
        panel: &mut Panel<T, M, N>,
        inverse: &mut [T; M],
    ) -> bool {
        let mut nu = *rows.nu;
        let hph = match h {
            Pattern::Direct { first } => {
                nu = turned(&nu);
                self.direct_panel(first, panel)
            }
            Pattern::Dense { h, unit } => self.dense_panel(h, unit, panel),
        };
        match sequence(hph, &nu, rows, out) {
            Some(q) => self.variances::<M, NONE>(&q, Place::Panel(panel), out, inverse),
            None => false,
        }
    }

    /// Reduces the panel to the sequential rows; δx and every variance after; whether all of them are fit: none but
    /// those of measured states more than halved.
    #[inline(always)]
    fn variances<const M: usize, const FIRST: usize>(
        &self,
        q: &Sequence<T, M>,
        place: Place<'_, T, M, N>,
        out: &mut Slots<'_, T, M, N>,
        inverse: &mut [T; M],
    ) -> bool {
        let mut nowhere = const { [[T::ZERO; N]; M] };
        let (panel, direct) = match place {
            Place::Panel(panel) => (panel, None),
            Place::Columns(direct) => (&mut nowhere, Some(direct)),
        };
        *inverse = q.inverse;
        let mut signs = 0;
        let mut total = T::zero();
        macro_rules! panel {
            ($j:literal) => {{
                let mut c = const { [T::ZERO; M] };
                each_row!(m; c[m] = if FIRST < NONE {
                    self.hi[at($j, FIRST + m)]
                } else {
                    panel[m][$j]
                });
                c
            }};
        }
        macro_rules! one {
            ($j:literal, $c:expr, $d:expr, $dx:expr) => {{
                let (c, d) = ($c, $d);
                if FIRST == NONE {
                    each_row!(m; panel[m][$j] = c[m]);
                }
                let before = self.hi[upper($j, $j)];
                let after = match direct {
                    Some(b) if measured::<M, FIRST>($j) => {
                        b.k_r(&c)[$j - FIRST]
                    }
                    _ => two_add(before, self.lo[upper($j, $j)], -d).0,
                };
                out.dx[$j] = $dx;
                out.decrease[$j] = d;
                out.p_before[$j] = before;
                out.p_after[$j] = after;
                let halved = if measured::<M, FIRST>($j) { after } else { after - d };
                signs |= halved.sign_word();
                total += after;
            }};
        }
        // three states at a time, so that a factor is read once for three: of few rows all factors stay in registers
        macro_rules! three {
            ($a:literal, $b:literal, $c:literal) => {{
                let mut c = [panel!($a), panel!($b), panel!($c)];
                let (mut d, mut dx) = const { ([T::ZERO; 3], [T::ZERO; 3]) };
                each_row!(m; {
                    let mut x = [c[0][m], c[1][m], c[2][m]];
                    each_row!(k; if k < m {
                        let l = q.l[k][m];
                        x = [x[0] - l * c[0][k], x[1] - l * c[1][k], x[2] - l * c[2][k]];
                    });
                    (c[0][m], c[1][m], c[2][m]) = (x[0], x[1], x[2]);
                    let (inverse, gain) = (q.inverse[m], q.gain[m]);
                    if m == 0 {
                        d = [x[0] * (x[0] * inverse), x[1] * (x[1] * inverse), x[2] * (x[2] * inverse)];
                        dx = [x[0] * gain, x[1] * gain, x[2] * gain];
                    } else {
                        d = [d[0] + x[0] * (x[0] * inverse), d[1] + x[1] * (x[1] * inverse), d[2] + x[2] * (x[2] * inverse)];
                        dx = [dx[0] + x[0] * gain, dx[1] + x[1] * gain, dx[2] + x[2] * gain];
                    }
                });
                one!($a, c[0], d[0], dx[0]);
                one!($b, c[1], d[1], dx[1]);
                one!($c, c[2], d[2], dx[2]);
                in_order();
            }};
        }
        macro_rules! single {
            ($j:literal) => {
                let c = forward(&panel!($j), &q.l);
                one!($j, c, dot(&c, &times(&c, &q.inverse)), dot(&c, &q.gain));
                in_order();
            };
        }
        if M > 3 {
            three!(0, 1, 2);
            three!(3, 4, 5);
            three!(6, 7, 8);
            three!(9, 10, 11);
            three!(12, 13, 14);
        } else {
            each_state!(single);
        }
        signs >> 31 == 0 && total.finite()
    }
}

/// Innovations of rows whose signs have been turned.
#[inline(always)]
fn turned<T: Real, const M: usize>(nu: &[T; M]) -> [T; M] {
    let mut x = *nu;
    each_row!(m; x[m] = -x[m]);
    x
}

#[cfg(test)]
mod tests {
    use crate::covariance::{Covariance15, Observation, Rows};
    use nalgebra::{SMatrix, SVector};

    /// Some full covariance with variances of about 1, from a linear congruence.
    fn some() -> SMatrix<f64, 15, 15> {
        let mut seed = 11u64;
        let x = SMatrix::<f64, 15, 15>::from_fn(|_, _| {
            seed = seed
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        });
        x * x.transpose() / 15.0 + SMatrix::identity() * 0.5
    }

    /// h as it is given to the update, and in full.
    fn is_the_textbook_one<const M: usize>(
        given: Observation<f64, M, 15>,
        h: SMatrix<f64, M, 15>,
        r: f64,
    ) {
        let p0 = some();
        let mut p = Covariance15::from_matrix(&p0).unwrap();
        let nu = SVector::<f64, M>::from_fn(|m, _| 0.1 + m as f64);
        let u = p
            .update(&Rows {
                nu: nu.into(),
                h: given,
                r: [r; M],
                gate: None,
            })
            .unwrap();
        let s = h * p0 * h.transpose() + SMatrix::<f64, M, M>::identity() * r;
        let k = p0 * h.transpose() * s.cholesky().unwrap().inverse();
        let joseph = SMatrix::<f64, 15, 15>::identity() - k * h;
        let after = joseph * p0 * joseph.transpose() + k * k.transpose() * r;
        for i in 0..15 {
            for j in 0..15 {
                // relative to the two variances: what collapsed is as right as the rest
                let scale = (after[(i, i)] * after[(j, j)]).sqrt();
                let error = (p.element(i, j) - after[(i, j)]).abs() / scale;
                assert!(error < 1e-12, "({i}, {j}): {error:e}, r {r}");
            }
        }
        assert!((SVector::from(u.dx) - k * nu).amax() < 1e-13);
        assert_eq!(u.p_after, p.diagonal());
        for (d, (a, b)) in u.decrease.iter().zip(u.p_after.iter().zip(&u.p_before)) {
            assert!((d - (b - a)).abs() < 1e-14);
        }
    }

    fn of_states<const M: usize>(first: usize, r: f64) {
        let h = SMatrix::from_fn(|m, j| if j == first + m { -1.0 } else { 0.0 });
        is_the_textbook_one::<M>(Observation::Direct { first }, h, r);
    }

    #[test]
    fn rows_of_single_states_are_the_textbook_update_however_far_the_variance_falls() {
        for r in [1.0, 1e-2, 1e-6] {
            of_states::<3>(3, r); // K R
            of_states::<1>(2, r);
            of_states::<3>(0, r); // the general sweep, or double words where it collapses
            of_states::<2>(7, r);
        }
    }

    #[test]
    fn any_rows_are_the_textbook_update_zero_blocks_or_not() {
        fn rows<const M: usize>() {
            // some 3×3 blocks of zeros, and zeros inside the others
            let h = SMatrix::<f64, M, 15>::from_fn(|m, j| match (m / 3 + j / 3) % 2 {
                0 if m != j => (m as f64 - 0.3 * j as f64).sin(),
                _ => 0.0,
            });
            for r in [10.0, 1e-3] {
                is_the_textbook_one(Observation::Dense(h), h, r);
            }
        }
        rows::<1>();
        rows::<3>();
        rows::<4>();
        rows::<6>();
        rows::<7>();
    }
}
