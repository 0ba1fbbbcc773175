//! The two ends of the spectrum of T alone: the direction the filter has learnt most about, and the one it has learnt
//! least about, for a quarter of what all fifteen eigenvalues take.
//!
//! Both are the largest eigenvalue of a positive definite matrix, of P for the least and of P⁻¹ for the most, found by
//! the recurrence of Lanczos (1950): k products with the matrix span the Krylov space of a start vector, in which the
//! matrix is tridiagonal; the largest eigenvalue of that small matrix is the maximum of the Rayleigh quotient over the
//! space, and converges faster than any other way of using the products (Kaniel 1966, Paige 1971). Where the room for
//! the space is used up, a new one begins from the best vector so far. P⁻¹ is never formed; its product is two
//! substitutions with the factor of P = L D Lᵀ, whose rounding stays relative to the variance of each state, so that the
//! small end is as exact as P allows (Demmel and Veselić 1992).
//!
//! # What is certain
//!
//! The quotient is measured with the vector that comes back, not taken from the recurrence, and so is
//! [`End::residual`]. Two things hold for any P: the true end is not surpassed, and some eigenvalue is within `residual`
//! of the quotient, relatively (both to rounding, which for the most is that of the factor: 6e-8 of the condition of the
//! *correlation* matrix). That this is the *extreme* eigenvalue is not certain: a start vector may miss a direction. The
//! start is fixed and has a share in every state; over alignments, random, crowded and ill-conditioned matrices no end was
//! missed by more than 2e-3 beside the rounding (`host-tests/tests/extreme.rs`). Who must know takes
//! [`super::spectrum`], which finds all of them; it also knows correlated priors and η1.

use super::diagonal::{check_variances, mask};
use super::triangle::{self, at, row, row_mut, set, start};
use super::vector::{self, dot};
use crate::covariance::Covariance;
use crate::error::Error;
use crate::linalg::{each_state, in_order, Real};

/// Vectors of a Krylov space that there is room for.
const ROOM: usize = 6;
/// Most products with the matrix. Covariances of alignments and flights need 3 to 10, evenly spread eigenvalues up to 32.
const STEPS: usize = 48;
/// Most steps of Newton's rule for a new root.
const NEWTON: usize = 8;
/// Share of the root below which a step of that rule is the last: it squares what is left.
const NEAR: f64 = 1e-6;
/// Largest residual that is handed out.
const ENOUGH: f64 = 1.0 / 2048.0;
/// Share of it at which the recurrence, which only foretells it, may end.
const FORETOLD: f64 = 0.75 * ENOUGH;

/// One end of the spectrum of T = P0⁻¹P, P0 diagonal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct End<T, const N: usize> {
    /// ν'P0ν/ν'Pν (Lu 2009, eq. 6): of the least, along `vector`; of the most, ν'P⁻¹ν/ν'P0⁻¹ν, which is the same at the
    /// top.
    pub eta2: T,
    /// ν in σ0 units, its length 1, its largest component positive. States without prior have 0.
    pub vector: [T; N],
    /// ‖A ν − ρ ν‖/ρ with A = P or P⁻¹ and ρ its quotient, at most 1/2048: some eigenvalue is within this share of ρ, and
    /// the extreme one, where it stands apart from the next by a share g, within residual²/g.
    pub residual: T,
}

/// Room for the work: just under 1 KB for 15 states in f32.
#[derive(Clone, Debug)]
pub struct Extremes<T, const N: usize, const L: usize> {
    /// Unit lower triangle of the factor of P, the inverse of D in place of the ones.
    factor: [T; L],
    space: Space<T, N>,
}

/// A Krylov space.
#[derive(Clone, Debug)]
struct Space<T, const N: usize> {
    /// Orthonormal vectors, and the product with the last of them.
    basis: [[T; N]; ROOM + 1],
    ritz: Ritz<T>,
}

/// For the 15-state filter.
pub type Extremes15<T> = Extremes<T, 15, 120>;

impl<T: Real, const N: usize, const L: usize> Default for Extremes<T, N, L> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const N: usize, const L: usize> Extremes<T, N, L> {
    const SIZE: () = assert!(
        L == N * (N + 1) / 2 && N > 0 && N <= 32,
        "L must be N(N+1)/2"
    );

    /// Empty.
    pub fn new() -> Self {
        const { Self::SIZE };
        Self {
            factor: [T::zero(); L],
            space: Space {
                basis: [[T::zero(); N]; ROOM + 1],
                ritz: Ritz::new(),
            },
        }
    }

    /// The direction of the smallest η2. `None` when no state has a prior.
    ///
    /// * `p` — covariance in σ0 units
    /// * `normalised` — bit i set: state i was started with a variance above zero. The others have no share.
    ///
    /// At most 48 products of 15 × 15.
    ///
    /// # Errors
    /// [`Error::Variance`] when a variance of P is not positive and finite (of a state without prior: negative or not
    /// finite); [`Error::NonFinite`] when P holds NaN or ±∞, or is not positive along the way;
    /// [`Error::NotConverged`] when no residual below 1/2048 was found.
    pub fn least(
        &mut self,
        p: &Covariance<T, N, L>,
        normalised: u32,
    ) -> Result<Option<End<T, N>>, Error> {
        check_variances(&p.diagonal(), normalised)?;
        let end = climb(&mut self.space, normalised, |x, y| {
            product(p.words().0, x, y)
        })?;
        Ok(end.map(|end| End {
            eta2: T::one() / end.eta2,
            ..end
        }))
    }

    /// The direction of the largest η2; otherwise as [`Extremes::least`], with a factor of P to be formed and two
    /// substitutions in place of a product.
    ///
    /// # Errors
    /// Those of [`Extremes::least`]; [`Error::NotPositive`] when P is not positive definite to the precision of T.
    pub fn most(
        &mut self,
        p: &Covariance<T, N, L>,
        normalised: u32,
    ) -> Result<Option<End<T, N>>, Error> {
        check_variances(&p.diagonal(), normalised)?;
        self.factor = *p.words().0;
        factorise::<T, N, L>(&mut self.factor, normalised)?;
        let factor = &self.factor;
        climb(&mut self.space, normalised, |x, y| substitute(factor, x, y))
    }
}

/// Whether state i has a prior.
#[inline(always)]
fn has(normalised: u32, i: usize) -> bool {
    normalised & (1 << (i & 31)) != 0
}

/// Calls `$m!(i; 0 … i − 1; i + 1 … 14)` for i = 0 … 14: rows of a symmetric matrix, spelled out. A loop costs three times
/// as much at opt-level "s".
macro_rules! each_row {
    ($m:ident) => {
        $m!(0;; 1 2 3 4 5 6 7 8 9 10 11 12 13 14);
        $m!(1; 0; 2 3 4 5 6 7 8 9 10 11 12 13 14);
        $m!(2; 0 1; 3 4 5 6 7 8 9 10 11 12 13 14);
        $m!(3; 0 1 2; 4 5 6 7 8 9 10 11 12 13 14);
        $m!(4; 0 1 2 3; 5 6 7 8 9 10 11 12 13 14);
        $m!(5; 0 1 2 3 4; 6 7 8 9 10 11 12 13 14);
        $m!(6; 0 1 2 3 4 5; 7 8 9 10 11 12 13 14);
        $m!(7; 0 1 2 3 4 5 6; 8 9 10 11 12 13 14);
        $m!(8; 0 1 2 3 4 5 6 7; 9 10 11 12 13 14);
        $m!(9; 0 1 2 3 4 5 6 7 8; 10 11 12 13 14);
        $m!(10; 0 1 2 3 4 5 6 7 8 9; 11 12 13 14);
        $m!(11; 0 1 2 3 4 5 6 7 8 9 10; 12 13 14);
        $m!(12; 0 1 2 3 4 5 6 7 8 9 10 11; 13 14);
        $m!(13; 0 1 2 3 4 5 6 7 8 9 10 11 12; 14);
        $m!(14; 0 1 2 3 4 5 6 7 8 9 10 11 12 13;);
    };
}

/// The same from the last row up.
macro_rules! each_row_upwards {
    ($m:ident) => {
        $m!(14; 0 1 2 3 4 5 6 7 8 9 10 11 12 13;);
        $m!(13; 0 1 2 3 4 5 6 7 8 9 10 11 12; 14);
        $m!(12; 0 1 2 3 4 5 6 7 8 9 10 11; 13 14);
        $m!(11; 0 1 2 3 4 5 6 7 8 9 10; 12 13 14);
        $m!(10; 0 1 2 3 4 5 6 7 8 9; 11 12 13 14);
        $m!(9; 0 1 2 3 4 5 6 7 8; 10 11 12 13 14);
        $m!(8; 0 1 2 3 4 5 6 7; 9 10 11 12 13 14);
        $m!(7; 0 1 2 3 4 5 6; 8 9 10 11 12 13 14);
        $m!(6; 0 1 2 3 4 5; 7 8 9 10 11 12 13 14);
        $m!(5; 0 1 2 3 4; 6 7 8 9 10 11 12 13 14);
        $m!(4; 0 1 2 3; 5 6 7 8 9 10 11 12 13 14);
        $m!(3; 0 1 2; 4 5 6 7 8 9 10 11 12 13 14);
        $m!(2; 0 1; 3 4 5 6 7 8 9 10 11 12 13 14);
        $m!(1; 0; 2 3 4 5 6 7 8 9 10 11 12 13 14);
        $m!(0;; 1 2 3 4 5 6 7 8 9 10 11 12 13 14);
    };
}

/// Sum without a zero to begin with.
macro_rules! sum {
    ($first:expr $(, $more:expr)*) => { $first $(+ $more)* };
}

/// Element i; zero beyond the end.
#[inline(always)]
fn of<T: Real, const N: usize>(x: &[T; N], i: usize) -> T {
    x.get(i).copied().unwrap_or_else(T::zero)
}

/// P = L D Lᵀ in place, row by row: column i of P, divided by the rows of L above, is D times row i of L. States without
/// prior are taken as independent of the others, with variance 1.
fn factorise<T: Real, const N: usize, const L: usize>(
    a: &mut [T; L],
    normalised: u32,
) -> Result<(), Error> {
    if normalised & mask::<N>() != mask::<N>() {
        for i in 0..N {
            for (j, a) in row_mut(a, i).iter_mut().enumerate() {
                if !has(normalised, i) || !has(normalised, j) {
                    *a = if i == j { T::one() } else { T::zero() };
                }
            }
        }
    }
    macro_rules! row_of_factor {
        ($i:literal; $($j:literal)*; $($below:literal)*) => {
            if $i < N {
                let mut x = [T::zero(); N];
                $(
                    if let Some(x) = x.get_mut($j) {
                        *x = of(a, const { start($i) + $j });
                    }
                )*
                divide_above(a, &mut x, $i);
                #[allow(unused_mut)]
                let mut pivot = of(a, const { start($i) + $i });
                $(
                    let l = of(&x, $j) * of(a, const { start($j) + $j });
                    pivot -= l * of(&x, $j);
                    set(a, $i, $j, l);
                )*
                invert_pivot::<T, L>(a, $i, pivot)?;
            }
        };
    }
    each_row!(row_of_factor);
    for i in 15..N {
        let mut x = [T::zero(); N];
        for (x, a) in x.iter_mut().zip(row(a, i)) {
            *x = *a;
        }
        divide_above(a, &mut x, i);
        let mut pivot = at(a, i, i);
        for (j, x) in x.iter().enumerate().take(i) {
            let l = *x * at(a, j, j);
            pivot -= l * *x;
            set(a, i, j, l);
        }
        invert_pivot::<T, L>(a, i, pivot)?;
    }
    Ok(())
}

/// Keeps 1/d_i in place of d_i.
fn invert_pivot<T: Real, const L: usize>(a: &mut [T; L], i: usize, pivot: T) -> Result<(), Error> {
    if !(pivot > T::zero() && pivot.finite()) {
        return Err(Error::NotPositive { row: i as u8 });
    }
    set(a, i, i, T::one() / pivot);
    Ok(())
}

/// The first n elements of x divided by the unit lower triangle.
#[inline(never)]
fn divide_above<T: Real, const N: usize, const L: usize>(l: &[T; L], x: &mut [T; N], n: usize) {
    macro_rules! element {
        (0;; $($below:literal)*) => {};
        ($i:literal; $($j:literal)+; $($below:literal)*) => {
            if $i >= n {
                return;
            }
            let known = sum!($(of(l, const { start($i) + $j }) * of(x, $j)),+);
            if let Some(x) = x.get_mut($i) {
                *x -= known;
            }
        };
    }
    each_row!(element);
    for i in 15..n {
        let (above, _) = x.split_at_checked(i).unwrap_or_default();
        let known = triangle::dot(row(l, i), above);
        if let Some(x) = x.get_mut(i) {
            *x -= known;
        }
    }
}

/// y = P⁻¹ x by the factor.
#[inline(never)] // so that its registers are not the caller's
fn substitute<T: Real, const N: usize, const L: usize>(l: &[T; L], x: &[T; N], y: &mut [T; N]) {
    *y = *x;
    divide_above(l, y, N);
    macro_rules! weigh {
        ($i:literal) => {
            if let Some(y) = y.get_mut($i) {
                *y *= of(l, const { start($i) + $i });
            }
        };
    }
    each_state!(weigh);
    for (i, y) in y.iter_mut().enumerate().skip(15) {
        *y *= at(l, i, i);
    }
    for i in (15..N).rev() {
        let y_i = of(y, i);
        for (y, l) in y.iter_mut().zip(row(l, i)).take(i) {
            *y -= *l * y_i;
        }
    }
    // column by column the elements that are known are taken off those above
    macro_rules! element {
        ($i:literal; $($j:literal)*; $($below:literal)*) => {
            if $i < N {
                #[allow(unused_variables)] // in the first row
                let y_i = of(y, $i);
                $(
                    if let Some(y) = y.get_mut($j) {
                        *y -= of(l, const { start($i) + $j }) * y_i;
                    }
                )*
            }
        };
    }
    each_row_upwards!(element);
}

/// y = A x
#[inline(never)] // as above
fn product<T: Real, const N: usize, const L: usize>(a: &[T; L], x: &[T; N], y: &mut [T; N]) {
    let x = *x; // in registers, row after row: at opt-level "s" it would be read again for each element
    macro_rules! element {
        ($i:literal; $($j:literal)*; $($k:literal)*) => {
            if let Some(y) = y.get_mut($i) {
                *y = of(a, const { start($i) + $i }) * of(&x, $i)
                    $(+ of(a, const { start($i) + $j }) * of(&x, $j))*
                    $(+ of(a, const { start($k) + $i }) * of(&x, $k))*;
            }
            in_order();
        };
    }
    each_row!(element);
    for i in 15..N {
        let x_i = of(&x, i);
        let mut sum = at(a, i, i) * x_i;
        for ((a, x), y) in row(a, i).iter().zip(&x).zip(y.iter_mut()).take(i) {
            *y += *a * x_i;
            sum += *a * *x;
        }
        if let Some(y) = y.get_mut(i) {
            *y = sum;
        }
    }
}

/// The symmetric tridiagonal matrix of the recurrence and its largest eigenvalue.
#[derive(Clone, Debug)]
struct Ritz<T> {
    /// Diagonal.
    alpha: [T; ROOM],
    /// Next to it.
    beta: [T; ROOM],
    /// Rows in use.
    len: usize,
    /// Largest eigenvalue.
    theta: T,
    /// 1/s², s the last component of its vector of length 1.
    inverse_square: T,
}

impl<T: Real> Ritz<T> {
    fn new() -> Self {
        Self {
            alpha: [T::zero(); ROOM],
            beta: [T::zero(); ROOM],
            len: 0,
            theta: T::zero(),
            inverse_square: T::one(),
        }
    }

    /// Takes in a row and column: the element on the diagonal, and the one that the next row will have beside it.
    ///
    /// False, and nothing is taken in, where rounding hides the new root: the one before is then as good.
    fn grow(&mut self, alpha: T, beta: T) -> bool {
        if let (Some(a), Some(b)) = (self.alpha.get_mut(self.len), self.beta.get_mut(self.len)) {
            (*a, *b) = (alpha, beta);
        }
        let before = self.len.wrapping_sub(1);
        let Some(beta) = self.beta.get(before) else {
            (self.theta, self.inverse_square, self.len) = (alpha, T::one(), 1);
            return true;
        };
        // the plane of the best vector so far and the new one: below the root, and above those before
        let half = T::of(0.5) * (alpha - self.theta);
        let square = *beta * *beta / self.inverse_square;
        let sum = half * half + square;
        let root = sum * sum.inverse_root_near();
        let mut theta = self.theta
            + match half > T::zero() {
                true => half + root,
                false => square / (root - half),
            };
        // Newton's rule for q_k = θ − α_k − β²_{k−1}/q_{k−1}, which is concave there: from below it comes closer
        // without passing. 1/s² is its derivative.
        for _ in 0..NEWTON {
            let (mut q, mut dq) = (theta - self.alpha[0], T::one());
            macro_rules! row {
                ($before:literal, $k:literal) => {
                    if $k <= self.len {
                        if q <= T::zero() {
                            return false;
                        }
                        let over = self.beta[$before] / q;
                        dq = T::one() + over * over * dq;
                        q = theta - self.alpha[$k] - over * self.beta[$before];
                    }
                };
            }
            row!(0, 1);
            row!(1, 2);
            row!(2, 3);
            row!(3, 4);
            row!(4, 5);
            const _: () = assert!(ROOM == 6);
            let step = q / dq;
            theta -= step;
            self.inverse_square = dq;
            if step.abs() <= T::of(NEAR) * theta {
                break;
            }
        }
        self.theta = theta;
        self.len += 1;
        true
    }

    /// The vector of the largest eigenvalue, in the space of which `basis` holds the axes; any length.
    fn vector<const N: usize>(&self, basis: &[[T; N]; ROOM + 1]) -> [T; N] {
        let mut v = [T::zero(); N];
        let (mut s, mut off) = (T::one(), T::zero());
        let elements = self.alpha.iter().zip(&self.beta);
        for ((alpha, beta), u) in elements.zip(basis).take(self.len) {
            vector::add(&mut v, s, u);
            let over = *beta / (self.theta - *alpha - off);
            s /= over;
            off = over * *beta;
        }
        v
    }
}

/// Finds the largest eigenvalue of the matrix behind `times`; `eta2` is that.
#[inline(always)]
fn climb<T: Real, const N: usize>(
    Space { basis, ritz }: &mut Space<T, N>,
    normalised: u32,
    times: impl Fn(&[T; N], &mut [T; N]),
) -> Result<Option<End<T, N>>, Error> {
    if normalised & mask::<N>() == 0 {
        return Ok(None);
    }
    ritz.len = 0;
    start_with(basis, irregular(normalised));
    for _ in 0..STEPS {
        let (done, rest) = basis.split_at_mut_checked(ritz.len + 1).unwrap_or_default();
        let (Some((v, before)), Some(w)) = (done.split_last(), rest.first_mut()) else {
            break;
        };
        times(v, w);
        if normalised & mask::<N>() != mask::<N>() {
            for (i, w) in w.iter_mut().enumerate() {
                if !has(normalised, i) {
                    *w = T::zero();
                }
            }
        }
        let alpha = dot(v, w);
        match (before.last(), ritz.beta.get(ritz.len.wrapping_sub(1))) {
            (Some(before), Some(beta)) => vector::take_off_two(w, (alpha, v), (*beta, before)),
            _ => vector::add(w, -alpha, v),
        }
        let square = dot(w, w);
        if !(alpha > T::zero() && square.finite()) {
            return Err(Error::NonFinite);
        }
        let inverse = square.inverse_root_near();
        let beta = square * inverse;
        let first = ritz.len == 0;
        let grown = ritz.grow(alpha, beta);
        let allowed = T::of(if first { ENOUGH } else { FORETOLD }) * ritz.theta;
        let near = square <= allowed * allowed * ritz.inverse_square;
        if first && near {
            return Ok(Some(End {
                eta2: alpha,
                vector: facing(v),
                residual: beta / alpha,
            }));
        }
        if near || !grown || ritz.len == ROOM {
            let best = ritz.vector(basis);
            start_with(basis, best);
            ritz.len = 0;
        } else {
            vector::scale(w, inverse);
        }
    }
    Err(Error::NotConverged)
}

/// Begins a space with x.
fn start_with<T: Real, const N: usize>(basis: &mut [[T; N]; ROOM + 1], x: [T; N]) {
    if let Some(to) = basis.first_mut() {
        *to = x;
        vector::scale(to, dot(&x, &x).inverse_root_near());
    }
}

/// Elements between −1/2 and 1/2 for the states with a prior, none of them alike: a start that is no eigenvector by
/// symmetry, and has a share in every one.
fn irregular<T: Real, const N: usize>(normalised: u32) -> [T; N] {
    let mut x = [T::zero(); N];
    macro_rules! element {
        ($i:literal) => {
            if let Some(x) = x.get_mut($i) {
                if has(normalised, $i) {
                    *x = T::of(const { golden($i) });
                }
            }
        };
    }
    each_state!(element);
    for (i, x) in x.iter_mut().enumerate().skip(15) {
        if has(normalised, i) {
            *x = T::of(golden(i));
        }
    }
    x
}

/// i + 1 times the golden ratio, less the nearest integer.
const fn golden(i: usize) -> f64 {
    const RATIO: f64 = 0.618_033_988_749_894_9;
    let (mut left, mut factor) = (i + 1, 0.0);
    while left > 0 {
        factor += RATIO;
        if factor > 0.5 {
            factor -= 1.0;
        }
        left -= 1;
    }
    factor
}

/// x with its largest component positive.
fn facing<T: Real, const N: usize>(x: &[T; N]) -> [T; N] {
    let (mut largest, mut sign) = (T::zero(), T::one());
    for x in x {
        if x.abs() > largest {
            largest = x.abs();
            sign = if *x < T::zero() { -T::one() } else { T::one() };
        }
    }
    x.map(|x| x * sign)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_converge_is_told() {
        // a turn by 45° has no direction of its own
        let mut space = Extremes::<f64, 2, 3>::new().space;
        let end = climb(&mut space, u32::MAX, |x, y| *y = [x[0] - x[1], x[0] + x[1]]);
        assert_eq!(end, Err(Error::NotConverged));
    }

    #[test]
    fn a_root_that_rounding_hides_is_left_out() {
        let mut ritz = Ritz::<f32>::new();
        assert!(ritz.grow(1.0, 1e-6));
        // the new root is 1 + 1e-12
        let grown = ritz.grow(0.5, 1.0);
        assert!(ritz.theta == 1.0 && ritz.len == 1 + usize::from(grown));
    }
}
