//! −Ṗ by the Riccati equation, what ξ1 and η1 of Lu 2009 are made from.

use nalgebra::{SMatrix, SVector};

use super::triangle::{row, start};
use crate::covariance::{Covariance, Covariance15, Observation};
use crate::linalg::{BlockTransition, Real};
use crate::measurement::{Kind, Linearized, MeasurementRows};

/// What M measurement rows know per second: their Jacobian in σ0 units and R·T.
///
/// A measurement with variance R every T seconds is worth a continuous one of density R·T (Lu 2009 evaluates with
/// 0.1 s in place of T, which overstates the measurement ten-fold where T is 1 s).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Information<T, const M: usize, const N: usize> {
    /// ∂ν/∂δx in σ0 units.
    pub h: Observation<T, M, N>,
    /// R·T of each row, in the unit of the row squared, times seconds.
    pub r_t: [T; M],
}

impl<const M: usize> Information<f32, M, 15> {
    /// From a measurement as the filter gets it and the unit of each state. `None` when its interval is unknown (≤ 0 or
    /// not finite) or a variance is not positive.
    pub fn of<H: MeasurementRows<M>>(
        measurement: &Linearized<M, H>,
        sigma0: &[f32; 15],
    ) -> Option<Self> {
        let t = measurement.interval;
        let known = t > 0.0 && t.is_finite();
        if !known || measurement.r.iter().any(|r| *r <= 0.0) {
            return None;
        }
        let mut r_t = [0.0; M];
        for (to, r) in r_t.iter_mut().zip(measurement.r.iter()) {
            *to = *r * t;
        }
        let h = match measurement.h.kind() {
            Kind::Direct { first } => {
                for (r_t, sigma) in r_t.iter_mut().zip(sigma0.iter().skip(first)) {
                    *r_t /= *sigma * *sigma;
                }
                Observation::Direct { first }
            }
            _ => {
                let mut h = measurement.dense();
                for (mut column, sigma) in h.column_iter_mut().zip(sigma0) {
                    column *= *sigma;
                }
                Observation::Dense(h)
            }
        };
        Some(Self { h, r_t })
    }
}

/// −Ṗ in σ0 units [1/s], packed as a [`Covariance`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecreaseRate<T, const N: usize, const L: usize> {
    pub(super) packed: [T; L],
}

/// −Ṗ of the 15-state filter.
pub type DecreaseRate15<T> = DecreaseRate<T, 15, 120>;

impl<T: Real, const N: usize, const L: usize> DecreaseRate<T, N, L> {
    const SIZE: () = assert!(L == N * (N + 1) / 2, "L must be N(N+1)/2");

    /// −Ṗ = −(F P + P Fᵀ + Q) + P Hᵀ (R T)⁻¹ H P (Lu 2009, eq. 17), with P just after an update.
    ///
    /// * `f` — F in σ0 units [1/s]
    /// * `q` — diagonal of the noise density G Q Gᵀ in σ0 units [1/s]
    /// * `information` — the measurement
    pub fn riccati<const M: usize>(
        p: &Covariance<T, N, L>,
        f: &SMatrix<T, N, N>,
        q: &SVector<T, N>,
        information: &Information<T, M, N>,
    ) -> Self {
        const { Self::SIZE };
        let mut rate = Self {
            packed: [T::zero(); L],
        };
        for j in 0..N {
            // column j of F P
            let column = column(p, j);
            let mut fp = [T::zero(); N];
            for (f, x) in f.column_iter().zip(&column) {
                for (y, f) in fp.iter_mut().zip(f.iter()) {
                    *y += *f * *x;
                }
            }
            rate.subtract_both(j, &fp);
        }
        rate.noise(q.iter());
        rate.learn(p, information);
        rate
    }

    /// Subtracts column j of a matrix and the same as row j.
    #[inline(always)]
    fn subtract_both(&mut self, j: usize, x: &[T; N]) {
        let mut at = start(j);
        for (i, x) in x.iter().enumerate() {
            if let Some(to) = self.packed.get_mut(at) {
                *to -= if i == j { *x + *x } else { *x };
            }
            at += if i < j { 1 } else { i + 1 };
        }
    }

    #[inline(always)]
    fn noise<'q>(&mut self, q: impl Iterator<Item = &'q T>) {
        for (i, q) in q.enumerate() {
            if let Some(to) = self.packed.get_mut(start(i) + i) {
                *to -= *q;
            }
        }
    }

    #[inline(always)]
    fn learn<const M: usize>(
        &mut self,
        p: &Covariance<T, N, L>,
        information: &Information<T, M, N>,
    ) {
        for_each_row(p, information, |x, weight| {
            let mut rest = self.packed.as_mut_slice();
            for (length, x_i) in (1..).zip(x) {
                let Some((row, below)) = rest.split_at_mut_checked(length) else {
                    return;
                };
                let scaled = *x_i * weight;
                for (to, x_j) in row.iter_mut().zip(x) {
                    *to += scaled * *x_j;
                }
                rest = below;
            }
        });
    }

    /// Element (i, j) [1/s]; NaN when there is none.
    pub fn element(&self, i: usize, j: usize) -> T {
        let (i, j) = (i.max(j), i.min(j));
        if i >= N {
            return T::of(f64::NAN);
        }
        self.packed
            .get(start(i) + j)
            .copied()
            .unwrap_or_else(T::zero)
    }

    /// The diagonal: ξ1 by the Riccati equation, of every state.
    pub fn diagonal(&self) -> [T; N] {
        let mut i = 0;
        [(); N].map(|()| {
            i += 1;
            self.element(i - 1, i - 1)
        })
    }
}

impl<T: Real> DecreaseRate15<T> {
    /// As [`DecreaseRate::riccati`] for the pattern of the 15-state filter: `rates` is F and the noise densities by
    /// blocks, per second ([`crate::error_model::block_rates`]).
    pub fn blocks<const M: usize>(
        p: &Covariance15<T>,
        rates: &BlockTransition<T>,
        information: &Information<T, M, 15>,
    ) -> Self {
        let mut rate = Self {
            packed: [T::zero(); 120],
        };
        for j in 0..15 {
            rate.subtract_both(j, &product(rates, &column(p, j)));
        }
        rate.noise([T::zero(); 3].iter().chain(&rates.q));
        rate.learn(p, information);
        rate
    }
}

/// The diagonal of −Ṗ alone, general.
pub(super) fn diagonal<T: Real, const M: usize, const N: usize, const L: usize>(
    p: &Covariance<T, N, L>,
    f: &SMatrix<T, N, N>,
    q: &SVector<T, N>,
    information: &Information<T, M, N>,
) -> [T; N] {
    let mut rate = [T::zero(); N];
    // `row_iter`: at opt-level "s" the bounds check of `row(i)` would stay
    let rows = rate.iter_mut().zip(q.iter()).zip(f.row_iter());
    for (i, ((rate, q), f)) in rows.enumerate() {
        let mut sum = T::zero();
        for (f, x) in f.iter().zip(&column(p, i)) {
            sum += *f * *x;
        }
        *rate = -(sum + sum + *q);
    }
    learn_diagonal(&mut rate, p, information);
    rate
}

/// The diagonal of −Ṗ alone, by blocks.
pub(super) fn diagonal_blocks<T: Real, const M: usize>(
    p: &Covariance15<T>,
    rates: &BlockTransition<T>,
    information: &Information<T, M, 15>,
) -> [T; 15] {
    let x = p.words().0;
    let t = rates;
    // velocity measured directly, the common case, is learnt from state by state; for others these weights are 0
    let velocity = match (&information.h, information.r_t.as_slice()) {
        (Observation::Direct { first: 3 }, [e, n, u]) => Some([e, n, u].map(|r_t| T::one() / *r_t)),
        _ => None,
    };
    let [e, n, u] = velocity.unwrap_or([T::zero(); 3]);
    let mut rate = const { [T::ZERO; 15] };
    macro_rules! sum {
        ($first:expr $(, $more:expr)*) => { $first $(+ $more)* };
    }
    // row i of the pattern of F times column i of P; a macro because constant indices need no check
    macro_rules! state {
        ($i:literal, $q:expr; $($f:expr, $j:literal);+) => {
            let fp = sum!($($f * x[const { upper($j, $i) }]),+);
            let lost = fp + fp;
            let [v_e, v_n, v_u] = [x[const { upper(3, $i) }], x[const { upper(4, $i) }], x[const { upper(5, $i) }]];
            let learnt = v_e * v_e * e + v_n * v_n * n + v_u * v_u * u;
            rate[$i] = -lost - $q + learnt;
        };
    }
    state!(0, T::zero(); t.a00.m12, 1; t.a00.m13, 2; t.a01.x, 3);
    state!(1, T::zero(); t.a00.m21, 0; t.a00.m23, 2; t.a01.y, 4);
    state!(2, T::zero(); t.a00.m31, 0; t.a00.m32, 1; t.a01.z, 5);
    state!(3, t.q[0]; t.a10.x, 0; t.a11.m12, 4; t.a11.m13, 5; t.a12.m12, 7; t.a12.m13, 8; t.a14.m11, 12; t.a14.m12, 13; t.a14.m13, 14);
    state!(4, t.q[1]; t.a10.y, 1; t.a11.m21, 3; t.a11.m23, 5; t.a12.m21, 6; t.a12.m23, 8; t.a14.m21, 12; t.a14.m22, 13; t.a14.m23, 14);
    state!(5, t.q[2]; t.a10.z, 2; t.a11.m31, 3; t.a11.m32, 4; t.a12.m31, 6; t.a12.m32, 7; t.a14.m31, 12; t.a14.m32, 13; t.a14.m33, 14);
    state!(6, t.q[3]; t.a22.m12, 7; t.a22.m13, 8; t.a23.m11, 9; t.a23.m12, 10; t.a23.m13, 11);
    state!(7, t.q[4]; t.a22.m21, 6; t.a22.m23, 8; t.a23.m21, 9; t.a23.m22, 10; t.a23.m23, 11);
    state!(8, t.q[5]; t.a22.m31, 6; t.a22.m32, 7; t.a23.m31, 9; t.a23.m32, 10; t.a23.m33, 11);
    state!(9, t.q[6]; t.a33, 9);
    state!(10, t.q[7]; t.a33, 10);
    state!(11, t.q[8]; t.a33, 11);
    state!(12, t.q[9]; t.a44, 12);
    state!(13, t.q[10]; t.a44, 13);
    state!(14, t.q[11]; t.a44, 14);
    if velocity.is_none() {
        learn_diagonal(&mut rate, p, information);
    }
    rate
}

#[inline(always)]
fn learn_diagonal<T: Real, const M: usize, const N: usize, const L: usize>(
    rate: &mut [T; N],
    p: &Covariance<T, N, L>,
    information: &Information<T, M, N>,
) {
    let Observation::Direct { first } = &information.h else {
        for_each_row(p, information, |x, weight| {
            for (rate, x) in rate.iter_mut().zip(x) {
                *rate += *x * (*x * weight);
            }
        });
        return;
    };
    // as above, without a copy of the column
    let words = p.words().0;
    for (j, r_t) in (*first..).zip(&information.r_t) {
        let weight = T::one() / *r_t;
        let (above, below) = rate.split_at_mut_checked(j).unwrap_or_default();
        for (rate, x) in above.iter_mut().zip(row(words, j)) {
            *rate += *x * (*x * weight);
        }
        let mut at = start(j) + j;
        for (step, rate) in (j + 1..).zip(below) {
            if let Some(x) = words.get(at) {
                *rate += *x * (*x * weight);
            }
            at += step;
        }
    }
}

/// Position of element (i, j) in a packed triangle.
const fn upper(i: usize, j: usize) -> usize {
    if i <= j {
        start(j) + i
    } else {
        start(i) + j
    }
}

/// Hands every row's P hᵀ (sign as it comes) and 1/(R·T) to `use_row`.
#[inline(always)]
fn for_each_row<T: Real, const M: usize, const N: usize, const L: usize>(
    p: &Covariance<T, N, L>,
    information: &Information<T, M, N>,
    mut use_row: impl FnMut(&[T; N], T),
) {
    match &information.h {
        Observation::Direct { first } => {
            for (m, r_t) in information.r_t.iter().enumerate() {
                use_row(&column(p, first + m), T::one() / *r_t);
            }
        }
        Observation::Dense(h) => {
            for (h, r_t) in h.row_iter().zip(&information.r_t) {
                let mut x = [T::zero(); N];
                for (j, h) in h.iter().enumerate() {
                    if *h != T::zero() {
                        for (x, p) in x.iter_mut().zip(&column(p, j)) {
                            *x += *h * *p;
                        }
                    }
                }
                use_row(&x, T::one() / *r_t);
            }
        }
    }
}

/// Column j of a covariance, high words.
#[inline(always)]
fn column<T: Real, const N: usize, const L: usize>(p: &Covariance<T, N, L>, j: usize) -> [T; N] {
    let words = p.words().0;
    let mut column = [T::zero(); N];
    let (above, below) = column.split_at_mut_checked(j).unwrap_or_default();
    for (to, x) in above.iter_mut().zip(row(words, j)) {
        *to = *x;
    }
    let mut at = start(j) + j;
    for (step, to) in (j + 1..).zip(below) {
        if let Some(x) = words.get(at) {
            *to = *x;
        }
        at += step;
    }
    column
}

/// F x by the pattern of [`BlockTransition`].
#[inline(always)]
fn product<T: Real>(t: &BlockTransition<T>, x: &[T; 15]) -> [T; 15] {
    let [r0, r1, r2, v0, v1, v2, a0, a1, a2, g0, g1, g2, b0, b1, b2] = *x;
    [
        t.a00.m12 * r1 + t.a00.m13 * r2 + t.a01.x * v0,
        t.a00.m21 * r0 + t.a00.m23 * r2 + t.a01.y * v1,
        t.a00.m31 * r0 + t.a00.m32 * r1 + t.a01.z * v2,
        t.a10.x * r0
            + (t.a11.m12 * v1 + t.a11.m13 * v2)
            + (t.a12.m12 * a1 + t.a12.m13 * a2)
            + (t.a14.m11 * b0 + t.a14.m12 * b1 + t.a14.m13 * b2),
        t.a10.y * r1
            + (t.a11.m21 * v0 + t.a11.m23 * v2)
            + (t.a12.m21 * a0 + t.a12.m23 * a2)
            + (t.a14.m21 * b0 + t.a14.m22 * b1 + t.a14.m23 * b2),
        t.a10.z * r2
            + (t.a11.m31 * v0 + t.a11.m32 * v1)
            + (t.a12.m31 * a0 + t.a12.m32 * a1)
            + (t.a14.m31 * b0 + t.a14.m32 * b1 + t.a14.m33 * b2),
        (t.a22.m12 * a1 + t.a22.m13 * a2) + (t.a23.m11 * g0 + t.a23.m12 * g1 + t.a23.m13 * g2),
        (t.a22.m21 * a0 + t.a22.m23 * a2) + (t.a23.m21 * g0 + t.a23.m22 * g1 + t.a23.m23 * g2),
        (t.a22.m31 * a0 + t.a22.m32 * a1) + (t.a23.m31 * g0 + t.a23.m32 * g1 + t.a23.m33 * g2),
        t.a33 * g0,
        t.a33 * g1,
        t.a33 * g2,
        t.a44 * b0,
        t.a44 * b1,
        t.a44 * b2,
    ]
}
