//! The two ends of the spectrum of T alone: the direction the filter has learnt most about, and the one it has learnt
//! least about. One end with its direction takes two thirds of what all fifteen take with theirs, and a quarter of the
//! memory.
//!
//! Both are the maximum of a Rayleigh quotient, of P for the least and of P⁻¹ for the most, climbed by conjugate
//! gradients (Bradbury and Fletcher 1966): one product with the matrix a step, and the best point of the plane of the
//! present vector and the new direction in closed form. P⁻¹ is never formed; its product is two substitutions with a
//! pivoted factor of P, which keeps the small end exact relative to itself.
//!
//! What comes back is never beyond the true end, whether or not the climb has reached the top, and [`End::residual`] says
//! how near the top is. For correlated priors and for η1 there is [`super::spectrum`].

use super::diagonal::check_variances;
use super::triangle::{
    at, copy_rows, dot, factor_column, oriented, pivot, rows, select, solve, solve_transposed,
};
use crate::covariance::Covariance;
use crate::error::Error;
use crate::linalg::Real;

/// Most products with the matrix. Covariances of alignments and flights need 3 to 12.
const STEPS: usize = 24;
/// Residual at which the climb ends: the quotient is then off by less than this share, by its square where the extreme
/// eigenvalue stands apart.
const ENOUGH: f64 = 1.0 / 1024.0;

/// One end of the spectrum of T = P0⁻¹P, P0 diagonal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct End<T, const N: usize> {
    /// ν'P0ν/ν'Pν (Lu 2009, eq. 6): of the least, along `vector`; of the most, ν'P⁻¹ν/ν'P0⁻¹ν, which is the same at the
    /// top.
    pub eta2: T,
    /// ν in σ0 units, its length 1, its largest component positive. States without prior have 0.
    pub vector: [T; N],
    /// ‖A ν − ρ ν‖/ρ with A = P or P⁻¹ and ρ its quotient: some eigenvalue is within this share of ρ, and the extreme
    /// one, where it stands apart from the next by a share g, within residual²/g.
    pub residual: T,
}

/// Room for the work: 0.5 KB for 15 states in f32.
#[derive(Clone, Debug)]
pub struct Extremes<T, const N: usize, const L: usize> {
    /// P, or its factor.
    a: [T; L],
    /// State of each row.
    order: [u8; N],
    /// Rows in use: states with a prior.
    n: usize,
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
            a: [T::zero(); L],
            order: [0; N],
            n: 0,
        }
    }

    /// The direction of the smallest η2. `None` when no state has a prior.
    ///
    /// * `p` — covariance in σ0 units
    /// * `normalised` — bit i set: state i was started with a variance above zero. The others have no share.
    ///
    /// At most 24 products of 15 × 15.
    ///
    /// # Errors
    /// [`Error::Variance`] when a variance of P is not positive and finite (of a state without prior: negative or not
    /// finite); [`Error::NonFinite`] when P holds NaN or ±∞, or is not positive along the way.
    pub fn least(
        &mut self,
        p: &Covariance<T, N, L>,
        normalised: u32,
    ) -> Result<Option<End<T, N>>, Error> {
        self.take(p, normalised)?;
        let end = self.climb(|x| self.product(x))?;
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
        self.take(p, normalised)?;
        self.factor()?;
        self.climb(|x| {
            let mut y = *x;
            solve(&self.a, self.n, &mut y);
            solve_transposed(&self.a, self.n, &mut y);
            y
        })
    }

    /// Copies the rows of the states that have a prior.
    fn take(&mut self, p: &Covariance<T, N, L>, normalised: u32) -> Result<(), Error> {
        check_variances(&p.diagonal(), normalised)?;
        self.n = select(&mut self.order, normalised);
        copy_rows(&mut self.a, p.words().0, &self.order, self.n);
        Ok(())
    }

    /// P = L Lᵀ with complete pivoting.
    fn factor(&mut self) -> Result<(), Error> {
        let mut left = [T::zero(); N];
        for (i, left) in left.iter_mut().enumerate().take(self.n) {
            *left = at(&self.a, i, i);
        }
        for k in 0..self.n {
            pivot(&mut self.a, self.n, k, &mut left, &mut self.order);
            if !factor_column(&mut self.a, self.n, k, &mut left) {
                let row = self.order.get(k).copied().unwrap_or(0);
                return Err(Error::NotPositive { row });
            }
        }
        Ok(())
    }

    /// P x
    fn product(&self, x: &[T; N]) -> [T; N] {
        let mut y = [T::zero(); N];
        for (i, a) in rows(&self.a).enumerate().take(self.n) {
            let (Some((_, left)), Some(x_i)) = (a.split_last(), x.get(i)) else {
                break;
            };
            let sum = dot(a, x);
            for (y, a) in y.iter_mut().zip(left) {
                *y += *a * *x_i;
            }
            if let Some(y) = y.get_mut(i) {
                *y += sum;
            }
        }
        y
    }

    /// Climbs the Rayleigh quotient of the matrix behind `times`; `eta2` is the quotient.
    fn climb(&self, times: impl Fn(&[T; N]) -> [T; N]) -> Result<Option<End<T, N>>, Error> {
        if self.n == 0 {
            return Ok(None);
        }
        let mut x: [T; N] = irregular(self.n);
        let scale = T::one() / dot(&x, &x).root();
        x = x.map(|x| x * scale);
        let mut ax = times(&x);
        // the direction of the last step, its product and its gradient
        let (mut d, mut ad, mut last) = ([T::zero(); N], [T::zero(); N], [T::zero(); N]);
        let mut steps = 0;
        let (rho, residual) = loop {
            let rho = dot(&x, &ax);
            let g = sum(T::one(), &ax, -rho, &x);
            let square = dot(&g, &g);
            let residual = square.root() / rho;
            if !(rho > T::zero() && residual.finite()) {
                return Err(Error::NonFinite);
            }
            if residual <= T::of(ENOUGH) || steps == STEPS {
                break (rho, residual);
            }
            steps += 1;
            // Polak and Ribière: begins anew by itself where the climb stalls
            let before = dot(&last, &last);
            let again = match before > T::zero() {
                true => ((square - dot(&g, &last)) / before).max(T::zero()),
                false => before,
            };
            last = g;
            d = sum(T::one(), &g, again, &d);
            ad = sum(T::one(), &times(&g), again, &ad);
            // the part of d across x, of length 1
            let along = dot(&d, &x);
            let scale = T::one() / (dot(&d, &d) - along * along).root();
            let e = sum(scale, &d, -along * scale, &x);
            let ae = sum(scale, &ad, -along * scale, &ax);
            // the larger eigenvalue of [[ρ, b], [b, c]] belongs to x + t e
            let (b, c) = (dot(&x, &ae), dot(&e, &ae));
            let half = T::of(0.5) * (c - rho);
            let root = (half * half + b * b).root();
            let t = match half > T::zero() {
                true => (half + root) / b,
                false => b / (root - half),
            };
            if !t.finite() {
                break (rho, residual);
            }
            x = sum(T::one(), &x, t, &e);
            ax = sum(T::one(), &ax, t, &ae);
            let scale = T::one() / dot(&x, &x).root();
            (x, ax) = (x.map(|x| x * scale), ax.map(|x| x * scale));
        };
        Ok(Some(End {
            eta2: rho,
            vector: oriented(&x, &self.order, self.n),
            residual,
        }))
    }
}

/// n elements between −1/2 and 1/2, none of them alike: a start that is no eigenvector by symmetry, and has a share in
/// every one.
fn irregular<T: Real, const N: usize>(n: usize) -> [T; N] {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let mut x = [T::zero(); N];
    let mut factor = 0.0;
    for x in x.iter_mut().take(n) {
        factor += GOLDEN;
        if factor > 0.5 {
            factor -= 1.0;
        }
        *x = T::of(factor);
    }
    x
}

/// a x + b y
fn sum<T: Real, const N: usize>(a: T, x: &[T; N], b: T, y: &[T; N]) -> [T; N] {
    let mut z = *x;
    for (z, y) in z.iter_mut().zip(y) {
        *z = a * *z + b * *y;
    }
    z
}
