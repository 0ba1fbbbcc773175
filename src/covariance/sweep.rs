//! P ← P − Σ c cᵀ/s over the whole triangle of 15 states, spelled out: the part of the swift update that writes.

use core::hint::black_box;

use super::packed::{at, upper, Covariance};
use super::sequence::{back, dot, each_row, times};
use crate::linalg::{each_state, in_order, two_add, Real};

/// FIRST of rows that measure no state by itself.
pub(super) const NONE: usize = 15;

/// Of rows that measure states by themselves: K R of a state is B c.
pub(super) struct Direct<T, const M: usize> {
    /// What makes c of a column of P ([`forward`]).
    pub l: [[T; M]; M],
    /// The diagonal of B's first factor …
    pub shrink: [T; M],
    /// … and what [`back`] takes off, both with R inside.
    pub back: [[T; M]; M],
}

/// P h of each row, and then c: less what the rows before it explain.
pub(super) type Panel<T, const M: usize, const N: usize> = [[T; N]; M];

impl<T: Real, const M: usize> Direct<T, M> {
    /// Any numbers: all are written before they are read. As a constant they cost next to nothing, also at opt-level "z".
    pub const NEW: Self = Self {
        l: [[T::ZERO; M]; M],
        shrink: [T::ZERO; M],
        back: [[T::ZERO; M]; M],
    };

    /// K R of the state with this c.
    #[inline(always)]
    pub(super) fn k_r(&self, c: &[T; M]) -> [T; M] {
        back(&times(c, &self.shrink), &self.back)
    }
}

/// All elements of P but those of measured states: several columns at a time, so that an entry of c is read once for all
/// of them. Up to three rows leave registers for six columns, of which 3, 4, 5 stand alone: they are the velocity, of which
/// a sweep by its own columns has nothing to do.
macro_rules! tiles {
    ($p:ident, $m:ident, $first:ident, $c:ident, $inverse:ident) => {
        if $m > 3 {
            tiles!(@ $p, $m, $first, $c, $inverse; 0 0, 1 1, 2 2);
            tiles!(@ $p, $m, $first, $c, $inverse; 0 3, 1 4, 2 5);
            tiles!(@ $p, $m, $first, $c, $inverse; 0 6, 1 7, 2 8);
            tiles!(@ $p, $m, $first, $c, $inverse; 0 9, 1 10, 2 11);
            tiles!(@ $p, $m, $first, $c, $inverse; 0 12, 1 13, 2 14);
        } else {
            tiles!(@ $p, $m, $first, $c, $inverse; 0 0, 1 1, 2 2, 3 6, 4 7, 5 8);
            tiles!(@ $p, $m, $first, $c, $inverse; 0 3, 1 4, 2 5);
            tiles!(@ $p, $m, $first, $c, $inverse; 0 9, 1 10, 2 11, 3 12, 4 13, 5 14);
        }
    };
    (@ $p:ident, $m:ident, $first:ident, $c:ident, $inverse:ident; $($n:literal $j:literal),*) => {{
        let g = [$(times(&$c!($j), $inverse)),*];
        macro_rules! row {
            ($i:literal) => {
                let c = $c!($i);
                $($p.lower::<$m, $first, $i, $j>(&c, &g[$n]);)*
                if $m > 1 {
                    in_order();
                }
            };
        }
        each_state!(row);
    }};
}

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// P ← P − Σ c cᵀ/s by the panel.
    #[inline(never)]
    pub(super) fn sweep_panel<const M: usize>(&mut self, panel: &Panel<T, M, N>, inverse: &[T; M]) {
        let (panel, inverse) = match M {
            1 => (panel, inverse),
            _ => black_box((panel, inverse)), // read where it is each time: the compiler would copy it first
        };
        macro_rules! c {
            ($state:literal) => {{
                let mut c = const { [T::ZERO; M] };
                each_row!(m; c[m] = panel[m][$state]);
                c
            }};
        }
        tiles!(self, M, NONE, c, inverse);
    }

    /// The same by the columns of the measured states, which are formed to c first and to K R at the end.
    #[inline(never)]
    pub(super) fn sweep_block<const M: usize, const FIRST: usize>(
        &mut self,
        inverse: &[T; M],
        direct: &Direct<T, M>,
    ) {
        macro_rules! c {
            ($state:literal) => {{
                let mut c = const { [T::ZERO; M] };
                each_row!(m; c[m] = self.hi[at($state, FIRST + m)]);
                c
            }};
        }
        macro_rules! form {
            ($i:literal) => {
                if M > 1 && !measured::<M, FIRST>($i) {
                    let x = forward(&c!($i), &direct.l);
                    each_row!(m; if m > 0 { self.hi[at($i, FIRST + m)] = x[m] });
                    in_order();
                }
            };
        }
        each_state!(form);
        tiles!(self, M, FIRST, c, inverse);
        // of the measured states themselves, all from P as it was
        let mut block = const { [[T::ZERO; M]; M] };
        each_row!(n; {
            let mut c = const { [T::ZERO; M] };
            each_row!(m; c[m] = self.hi[at(FIRST + n, FIRST + m)]);
            block[n] = direct.k_r(&forward(&c, &direct.l));
        });
        macro_rules! replace {
            ($i:literal) => {
                if !measured::<M, FIRST>($i) {
                    let x = direct.k_r(&c!($i));
                    each_row!(m; {
                        let k = at($i, FIRST + m);
                        (self.hi[k], self.lo[k]) = (x[m], T::zero());
                    });
                }
            };
        }
        each_state!(replace);
        each_row!(n; {
            each_row!(m; if n <= m {
                let k = upper(FIRST + n, FIRST + m);
                (self.hi[k], self.lo[k]) = (block[n][m], T::zero());
            });
        });
    }

    /// Element (I, J) of the upper triangle, unless its row or column belongs to a measured state.
    #[inline(always)]
    fn lower<const M: usize, const FIRST: usize, const I: usize, const J: usize>(
        &mut self,
        c: &[T; M],
        g: &[T; M],
    ) {
        if I <= J && !measured::<M, FIRST>(I) && !measured::<M, FIRST>(J) {
            let k = upper(I, J);
            (self.hi[k], self.lo[k]) = two_add(self.hi[k], self.lo[k], -dot(c, g));
        }
    }
}

/// c of P h: less what the rows before explain.
#[inline(always)]
pub(super) fn forward<T: Real, const M: usize>(ph: &[T; M], l: &[[T; M]; M]) -> [T; M] {
    let mut c = *ph;
    each_row!(m; { each_row!(k; if k < m { c[m] -= l[k][m] * c[k] }); });
    c
}

/// Whether a row measures this state by itself.
#[inline(always)]
pub(super) const fn measured<const M: usize, const FIRST: usize>(state: usize) -> bool {
    FIRST < NONE && state >= FIRST && state < FIRST + M
}
