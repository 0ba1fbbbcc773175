//! M rows one after the other: H P Hᵀ + R factorised, each row gated given those before it, and the small products over
//! rows that the sweep is made of.

use super::update::{Gate, Lines, Slots};
use crate::linalg::Real;

/// Repeats a line for the rows that there are.
macro_rules! each_row {
    ($m:ident; $line:expr) => {
        $crate::covariance::each_row!(@ $m; $line; 0 1 2 3 4 5);
        for $m in 6..M { $line }
    };
    (@ $m:ident; $line:expr; $($n:literal)*) => {
        $(if $n < M { const fn row() -> usize { $n } let $m = row(); $line })*
    };
}

pub(crate) use each_row;

/// The rows made uncorrelated, each given those before it.
pub(super) struct Sequence<T, const M: usize> {
    /// How much of row k is in row m > k: l[k][m]. Below the diagonal working room, which is not the stack's twice.
    pub l: [[T; M]; M],
    /// 1/s; zero for a row that was gated out.
    pub inverse: [T; M],
    /// Innovation over s; zero for a row that was gated out.
    pub gain: [T; M],
}

/// Factorises H P Hᵀ + R, of which `hph` need hold only the diagonal and what is below, row after row and gates each; None
/// when a row is not fit.
#[inline(always)]
pub(super) fn sequence<T: Real, const M: usize, const N: usize>(
    hph: [[T; M]; M],
    nu: &[T; M],
    rows: &Lines<'_, T, M>,
    out: &mut Slots<'_, T, M, N>,
) -> Option<Sequence<T, M>> {
    let zero = T::zero();
    let mut l = hph;
    let mut inverse = const { [T::ZERO; M] };
    let mut gain = const { [T::ZERO; M] };
    let mut sum = zero;
    each_row!(m; {
        let r = rows.r[m];
        let alone = l[m][m] + r;
        let mut s = alone;
        let mut e = nu[m];
        out.s[m] = alone;
        each_row!(k; if k < m {
            s -= l[m][k] * l[k][m];
            e -= l[m][k] * gain[k];
        });
        let one_over_s = T::one() / s;
        let nis = e * e * one_over_s;
        // 0 < r ≤ s, all finite: holds for every sound row. And s is no small difference of large numbers.
        if !(r > zero && s >= r && s >= alone * T::of(1.0 / 16.0) && nis.finite()) {
            return None;
        }
        out.row_nis[m] = nis;
        let used = Gate(rows.gate).passes(nis).ok()?;
        out.accepted[m] = used;
        if used {
            sum += nis;
            inverse[m] = one_over_s;
            gain[m] = e * one_over_s;
        }
        each_row!(n; if n > m {
            let mut x = l[n][m];
            each_row!(k; if k < m {
                x -= l[n][k] * l[k][m];
            });
            l[n][m] = x; // l[m][n] s_m, with s_m as it is without a gate
            l[m][n] = x * inverse[m];
        });
    });
    *out.nis = sum;
    Some(Sequence { l, inverse, gain })
}

/// Whether there are only zeros.
#[inline(always)]
pub(super) fn all_zero<T: Real, const M: usize>(x: &[T; M]) -> bool {
    let mut any = 0;
    each_row!(m; any |= x[m].abs().sign_word());
    any == 0
}

#[inline(always)]
pub(super) fn dot<T: Real, const M: usize>(a: &[T; M], b: &[T; M]) -> T {
    let mut d = a[0] * b[0];
    each_row!(m; if m > 0 { d += a[m] * b[m] });
    d
}

#[inline(always)]
pub(super) fn times<T: Real, const M: usize>(a: &[T; M], b: &[T; M]) -> [T; M] {
    let mut x = *a;
    each_row!(m; x[m] *= b[m]);
    x
}

/// L⁻ᵀ g. With g = D⁻¹ L⁻¹ P_bj this is the gain K of state j; with R taken into g and L, K R.
#[inline(always)]
pub(super) fn back<T: Real, const M: usize>(g: &[T; M], l: &[[T; M]; M]) -> [T; M] {
    let mut x = *g;
    each_row!(n; {
        let from = M - 1 - n;
        each_row!(k; if k < from { x[k] -= l[k][from] * x[from] });
    });
    x
}
