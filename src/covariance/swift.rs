//! The update of the 15-state triangle in one unrolled sweep: for every step in which no variance collapses.
//!
//! One word per product. It writes nothing unless every row and every variance passes a check that is stricter than
//! the law; whatever it does not like goes to the careful update, which knows what is an error and what is only rare.

use super::packed::{at, column, upper, Covariance};
use super::update::{Gate, Observation, Rows, Update};
use crate::error::Error;
use crate::linalg::{two_add, Real};
use nalgebra::SMatrix;

/// Number of states this is written for.
const STATES: usize = 15;

/// Calls `$m!(0)` … `$m!(14)`.
macro_rules! each_state {
    ($m:ident) => {
        $m!(0);
        $m!(1);
        $m!(2);
        $m!(3);
        $m!(4);
        $m!(5);
        $m!(6);
        $m!(7);
        $m!(8);
        $m!(9);
        $m!(10);
        $m!(11);
        $m!(12);
        $m!(13);
        $m!(14);
    };
}

/// Repeats a line for the rows that there are.
macro_rules! each_row {
    ($m:ident; $line:expr) => {
        each_row!(@ $m; $line; 0 1 2 3 4 5);
        for $m in 6..M { $line }
    };
    (@ $m:ident; $line:expr; $($n:literal)*) => {
        $(if $n < M { const fn row() -> usize { $n } let $m = row(); $line })*
    };
}

/// The rows made uncorrelated, each given those before it.
struct Sequence<T, const M: usize> {
    /// How much of row k is in row m > k: l[m][k].
    l: [[T; M]; M],
    /// 1/s; zero for a row that was gated out.
    inverse: [T; M],
    /// Innovation over s; zero for a row that was gated out.
    gain: [T; M],
}

/// Columns P h of the rows, state after state.
type Panel<T, const M: usize, const N: usize> = [[T; M]; N];

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// Updates the triangle and says true, or leaves it as it is and says false.
    #[inline(always)]
    pub(super) fn update_swiftly<const M: usize>(
        &mut self,
        rows: &Rows<T, M, N>,
        out: &mut Update<T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<bool, Error> {
        if N != STATES {
            return Ok(false); // known at compile time: of the constant indices below nothing is left then
        }
        match &rows.h {
            Observation::Direct { first: 0 } => self.take_block::<M, 0>(rows, out, accept),
            Observation::Direct { first: 3 } => self.take_block::<M, 3>(rows, out, accept),
            Observation::Direct { first } => self.take_states(*first, rows, out, accept),
            Observation::Dense(h) => self.take_dense(h, rows, out, accept),
        }
    }

    /// Direct rows from state FIRST on, FIRST known at compile time.
    #[inline(never)]
    fn take_block<const M: usize, const FIRST: usize>(
        &mut self,
        rows: &Rows<T, M, N>,
        out: &mut Update<T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<bool, Error> {
        let mut c = [[T::zero(); M]; N];
        macro_rules! one {
            ($i:literal) => {
                each_row!(m; if FIRST + m < N {
                    c[$i][m] = self.hi[at($i, FIRST + m)];
                });
            };
        }
        each_state!(one);
        let mut hph = [[T::zero(); M]; M];
        each_row!(m; if FIRST + m < N {
            hph[m] = c[FIRST + m];
        });
        // both signs turned, of the rows and of their innovations
        self.take(rows, &rows.nu.map(|x| -x), &mut c, &hph, out, accept)
    }

    /// Direct rows from any state on; zeros where there is no such state.
    #[inline(never)]
    fn take_states<const M: usize>(
        &mut self,
        first: usize,
        rows: &Rows<T, M, N>,
        out: &mut Update<T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<bool, Error> {
        let mut c = [[T::zero(); M]; N];
        for m in 0..M {
            if first + m < N {
                for (c, p) in c.iter_mut().zip(column::<T, N>(&self.hi, first + m)) {
                    c[m] = p;
                }
            }
        }
        let mut hph = [[T::zero(); M]; M];
        for (g, c) in hph.iter_mut().zip(c.iter().skip(first)) {
            *g = *c;
        }
        self.take(rows, &rows.nu.map(|x| -x), &mut c, &hph, out, accept)
    }

    /// Any rows.
    #[inline(never)]
    fn take_dense<const M: usize>(
        &mut self,
        h: &SMatrix<T, M, N>,
        rows: &Rows<T, M, N>,
        out: &mut Update<T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<bool, Error> {
        let mut c = [[T::zero(); M]; N];
        for (j, h) in h.column_iter().enumerate() {
            if h.iter().all(|h| *h == T::zero()) {
                continue;
            }
            for (c, p) in c.iter_mut().zip(column::<T, N>(&self.hi, j)) {
                for (c, h) in c.iter_mut().zip(h.iter()) {
                    *c += *h * p;
                }
            }
        }
        let mut hph = [[T::zero(); M]; M];
        for (h, c) in h.column_iter().zip(c.iter()) {
            for (g, h) in hph.iter_mut().zip(h.iter()) {
                if *h != T::zero() {
                    for (g, c) in g.iter_mut().zip(c) {
                        *g += *h * *c;
                    }
                }
            }
        }
        self.take(rows, &rows.nu, &mut c, &hph, out, accept)
    }

    /// The rows of this panel: one piece of code for direct and dense ones.
    #[inline(never)]
    fn take<const M: usize>(
        &mut self,
        rows: &Rows<T, M, N>,
        nu: &[T; M],
        c: &mut Panel<T, M, N>,
        hph: &[[T; M]; M],
        out: &mut Update<T, M, N>,
        accept: &mut dyn FnMut(&[T; N]) -> Result<(), Error>,
    ) -> Result<bool, Error> {
        let Some(q) = sequence(hph, nu, rows, out) else {
            return Ok(false);
        };
        if !self.variances(c, &q, out) {
            return Ok(false);
        }
        accept(&out.dx)?;
        if out.accepted.iter().any(|used| *used) {
            self.sweep(c, &q.inverse);
        } else {
            out.p_after = out.p_before;
        }
        Ok(true)
    }

    /// Reduces the panel to the sequential rows; δx and every variance after; whether none of them is more than halved.
    #[inline(always)]
    fn variances<const M: usize>(
        &self,
        c: &mut Panel<T, M, N>,
        q: &Sequence<T, M>,
        out: &mut Update<T, M, N>,
    ) -> bool {
        let mut fit = true;
        let mut total = T::zero();
        macro_rules! one {
            ($j:literal) => {{
                let c = &mut c[$j];
                reduce(c, &q.l);
                let d = dot(c, &times(c, &q.inverse));
                let before = self.hi[upper($j, $j)];
                let after = two_add(before, self.lo[upper($j, $j)], -d).0;
                out.dx[$j] = dot(c, &q.gain);
                out.decrease[$j] = d;
                out.p_before[$j] = before;
                out.p_after[$j] = after;
                fit &= after >= d;
                total += after;
            }};
        }
        each_state!(one);
        fit && total.finite()
    }

    /// P ← P − Σ c cᵀ/s, three columns at a time, so that a panel entry is read once for three elements.
    #[inline(always)]
    fn sweep<const M: usize>(&mut self, c: &Panel<T, M, N>, inverse: &[T; M]) {
        macro_rules! tile {
            ($a:literal, $b:literal, $c:literal) => {{
                let g = [
                    times(&c[$a], inverse),
                    times(&c[$b], inverse),
                    times(&c[$c], inverse),
                ];
                macro_rules! one {
                    ($i:literal) => {
                        self.lower::<M, $i, $a>(&c[$i], &g[0]);
                        self.lower::<M, $i, $b>(&c[$i], &g[1]);
                        self.lower::<M, $i, $c>(&c[$i], &g[2]);
                    };
                }
                each_state!(one);
            }};
        }
        tile!(0, 1, 2);
        tile!(3, 4, 5);
        tile!(6, 7, 8);
        tile!(9, 10, 11);
        tile!(12, 13, 14);
    }

    /// Element (I, J) of the upper triangle.
    #[inline(always)]
    fn lower<const M: usize, const I: usize, const J: usize>(&mut self, c: &[T; M], g: &[T; M]) {
        if I <= J {
            let k = upper(I, J);
            (self.hi[k], self.lo[k]) = two_add(self.hi[k], self.lo[k], -dot(c, g));
        }
    }
}

/// Factorises H P Hᵀ + R row after row and gates each; None when a row is not fit.
#[inline(always)]
fn sequence<T: Real, const M: usize, const N: usize>(
    hph: &[[T; M]; M],
    nu: &[T; M],
    rows: &Rows<T, M, N>,
    out: &mut Update<T, M, N>,
) -> Option<Sequence<T, M>> {
    let zero = T::zero();
    let mut q = Sequence {
        l: [[zero; M]; M],
        inverse: [zero; M],
        gain: [zero; M],
    };
    let mut w = [[zero; M]; M]; // w[m][k] = l[m][k] s_k
    out.nis = zero;
    each_row!(m; {
        let r = rows.r[m];
        let mut s = hph[m][m] + r;
        let mut e = nu[m];
        out.s[m] = s;
        each_row!(k; if k < m {
            s -= w[m][k] * q.l[m][k];
            e -= w[m][k] * q.gain[k];
        });
        let inverse = T::one() / s;
        let nis = e * e * inverse;
        // 0 < r ≤ s, all finite: holds for every sound row
        if !(r > zero && s >= r && nis.finite()) {
            return None;
        }
        out.row_nis[m] = nis;
        let used = Gate(rows.gate).passes(nis).ok()?;
        out.accepted[m] = used;
        if used {
            out.nis += nis;
            q.inverse[m] = inverse;
            q.gain[m] = e * inverse;
        }
        each_row!(n; if n > m {
            let mut x = hph[n][m];
            each_row!(k; if k < m {
                x -= w[n][k] * q.l[m][k];
            });
            w[n][m] = x;
            q.l[n][m] = x * q.inverse[m];
        });
    });
    Some(q)
}

#[inline(always)]
fn dot<T: Real, const M: usize>(a: &[T; M], b: &[T; M]) -> T {
    let mut d = a[0] * b[0];
    each_row!(m; if m > 0 { d += a[m] * b[m] });
    d
}

#[inline(always)]
fn times<T: Real, const M: usize>(a: &[T; M], b: &[T; M]) -> [T; M] {
    let mut x = *a;
    each_row!(m; x[m] *= b[m]);
    x
}

/// c ← L⁻¹ c
#[inline(always)]
fn reduce<T: Real, const M: usize>(c: &mut [T; M], l: &[[T; M]; M]) {
    each_row!(m; {
        let mut x = c[m];
        each_row!(k; if k < m { x -= l[m][k] * c[k] });
        c[m] = x;
    });
}
