//! η: along which directions the filter has learnt most (η2) and is learning fastest (η1).
//!
//! For a direction ν, η2 = ν'P0ν / ν'Pν and η1 = −ν'Ṗν / ν'P0ν (Lu 2009, eqs 5, 6). Their extreme values are the
//! eigenvalues of T = P0⁻¹P (of which η2 is the inverse) and of M = −P0⁻¹Ṗ (eqs 10–16). Neither product is ever
//! formed, because it would not be symmetric: with P0 = L0 L0ᵀ both are the symmetric problem L0⁻¹ X L0⁻ᵀ.
//!
//! # Method
//!
//! A covariance after an alignment spans eight decades, more than single precision can hold in one matrix: a
//! tridiagonal QL on it is right to 6e-8 of the *largest* eigenvalue and says nothing about the small ones, which are
//! the ones asked for. So P is factorised with complete pivoting, P = L Lᵀ, and Jacobi rotations work on Lᵀ L, which
//! has the same eigenvalues and is nearly diagonal already: its small elements are as exact, relatively, as its large
//! ones (Demmel and Veselić 1992; Drmač and Veselić 2008). Twenty to forty rotations finish what takes hundreds
//! without the factor. −Ṗ is not definite and gets plain rotations: its eigenvalues are right to 100 ε of the
//! largest term of Ṗ.
//!
//! # In slices
//!
//! [`Spectrum::start_accuracy`] or [`Spectrum::start_speed`] takes the matrix in; [`Spectrum::step`] then works until
//! its budget is used up, and can be called between filter steps, since it looks at nothing but its own memory. One
//! shot and slices give the same bits.

use super::jacobi::GAP;
use super::riccati::DecreaseRate;
use super::triangle::{copy_rows, dot, oriented, rows, select, solve_transposed};
use crate::covariance::Covariance;
use crate::error::Error;
use crate::linalg::Real;

mod pieces;

pub use super::jacobi::{Axes, Directions, ValuesOnly};

use pieces::Stage;

/// Budget of one slice that keeps it near 3,000 instructions on a Cortex-M4F.
pub const SLICE: u32 = 400;

/// What the initial covariance was, in σ0 units.
#[derive(Clone, Copy, Debug)]
pub enum Prior<'p, T, const N: usize, const L: usize> {
    /// Uncorrelated states.
    Independent,
    /// Correlated states: P0 with its diagonal at 1.
    Correlated(&'p Covariance<T, N, L>),
}

/// What a slice ended with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Progress {
    /// More to do.
    Working,
    /// The values are there.
    Done,
    /// The bound of the iteration was reached first; no values. Seen with no matrix so far.
    NotConverged,
}

/// One eigenvector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction<T, const N: usize> {
    /// ν in σ0 units: component i is ν_i σ0_i. Normalised to ν'P0ν = 1, its largest component positive. States without
    /// prior have 0.
    pub vector: [T; N],
    /// First eigenvalue of the group that this one belongs to.
    pub first: usize,
    /// Size of that group. 1: the vector is the direction. 2: a plane, of which the vectors `first` and `first + 1` are
    /// one basis among many; more: a space of that dimension.
    pub dimension: usize,
}

/// Eigenvalues, and with [`Directions`] all eigenvectors, of T = P0⁻¹P or M = −P0⁻¹Ṗ.
///
/// Memory: 2 L numbers of work, N values, and N² for the directions; 1.1 KB without and 2.0 KB with directions for 15
/// states in f32.
///
/// Accuracy in f32: eigenvalues of T from 1 down to 3e-8 within 2e-3 of f64 (seen: 8e-4). What limits them is the
/// rounding of P, 6e-8 of the condition of its *correlation* matrix; at 2.5e-9 and a condition of 1e5 that is 2e-2.
/// Eigenvalues of M within 1.2e-5 of the largest term of Ṗ. Directions within 1e-3 in σ0 units. In f64 the eigenvalues
/// of T are right to 1e-10, those of M to one rounding of the largest. Asserted in `host-tests/tests/spectrum.rs` and
/// `lu2009.rs`.
#[derive(Clone, Debug)]
pub struct Spectrum<'p, T, const N: usize, const L: usize, A> {
    /// P, its factor, L0⁻¹ L, its Gram matrix, the rotated matrix; then L0 for directions of correlated priors.
    a: [T; L],
    /// L0 or, where directions are kept, L0⁻¹ L.
    b: [T; L],
    /// Diagonal of the rotated matrix: the eigenvalues at last.
    values: [T; N],
    /// State of each row.
    order: [u8; N],
    /// Rows in ascending order of their eigenvalue.
    rank: [u8; N],
    /// Rows in use: states with a prior.
    n: usize,
    axes: A,
    prior: Prior<'p, T, N, L>,
    definite: bool,
    /// One rounding of the largest diagonal element of an indefinite matrix; 0 for a definite one.
    floor: T,
    sweep: u8,
    rotated: bool,
    stage: Stage,
}

/// The spectrum of the 15-state filter.
pub type Spectrum15<'p, T, A> = Spectrum<'p, T, 15, 120, A>;

impl<T: Real, const N: usize, const L: usize, A: Axes<T> + Default> Default
    for Spectrum<'_, T, N, L, A>
{
    fn default() -> Self {
        Self::new()
    }
}

impl<'p, T: Real, const N: usize, const L: usize, A: Axes<T>> Spectrum<'p, T, N, L, A> {
    const SIZE: () = assert!(
        L == N * (N + 1) / 2 && N > 0 && N <= 32,
        "L must be N(N+1)/2"
    );

    /// The smallest budget that [`Spectrum::step`] takes: its largest piece of work.
    pub const SMALLEST_BUDGET: u32 = (N * N + 4 * N + 8) as u32;

    /// Empty; nothing is started.
    pub fn new() -> Self
    where
        A: Default,
    {
        const { Self::SIZE };
        Self {
            a: [T::zero(); L],
            b: [T::zero(); L],
            values: [T::zero(); N],
            order: [0; N],
            rank: [0; N],
            n: 0,
            axes: A::default(),
            prior: Prior::Independent,
            definite: true,
            floor: T::zero(),
            sweep: 0,
            rotated: false,
            stage: Stage::Idle,
        }
    }

    /// Takes in P for the eigenvalues of T; 1/λ is the η2 of each direction.
    ///
    /// * `p` — covariance in σ0 units
    /// * `prior` — P0 in the same units
    /// * `normalised` — bit i set: state i was started with a variance above zero. The others have no share in η: the
    ///   problem is restricted to the range of P0.
    ///
    /// # Errors
    /// [`Error::Variance`] when a variance of P is not positive and finite (of a state without prior: negative or not
    /// finite). Nothing is started then.
    pub fn start_accuracy(
        &mut self,
        p: &Covariance<T, N, L>,
        prior: Prior<'p, T, N, L>,
        normalised: u32,
    ) -> Result<(), Error> {
        const { Self::SIZE };
        super::diagonal::check_variances(&p.diagonal(), normalised)?;
        self.take(p.words().0, prior, normalised);
        self.definite = true;
        self.stage = Stage::Factor { k: 0 };
        Ok(())
    }

    /// Takes in −Ṗ for the eigenvalues of M; λ [1/s] is the η1 of each direction, negative where process noise wins.
    ///
    /// Arguments as [`Spectrum::start_accuracy`].
    ///
    /// # Errors
    /// [`Error::NonFinite`] when the rate holds NaN or ±∞. Nothing is started then.
    pub fn start_speed(
        &mut self,
        rate: &DecreaseRate<T, N, L>,
        prior: Prior<'p, T, N, L>,
        normalised: u32,
    ) -> Result<(), Error> {
        const { Self::SIZE };
        if rate.packed.iter().any(|x| !x.finite()) {
            return Err(Error::NonFinite);
        }
        self.take(&rate.packed, prior, normalised);
        self.definite = false;
        self.stage = match prior {
            Prior::Independent => self.first_sweep(),
            Prior::Correlated(p0) => {
                self.load_prior(p0);
                Stage::Prior { k: 0 }
            }
        };
        Ok(())
    }

    /// Copies the rows of the states that have a prior.
    fn take(&mut self, packed: &[T; L], prior: Prior<'p, T, N, L>, normalised: u32) {
        self.prior = prior;
        self.sweep = 0;
        self.n = select(&mut self.order, normalised);
        if self.n == N {
            self.a = *packed;
        } else {
            copy_rows(&mut self.a, packed, &self.order, self.n);
        }
        self.read_diagonal();
    }

    /// Works until about `budget` multiply-adds are done, never more. [`SLICE`] is a good budget; `u32::MAX` does it
    /// all at once.
    ///
    /// # Errors
    /// * [`Error::OutOfRange`] — the budget is below [`Spectrum::SMALLEST_BUDGET`], or nothing was started; no work was
    ///   done
    /// * [`Error::NotPositive`] — P or P0 is not positive definite to the precision of T; `row` is the state where it
    ///   shows. A new start is needed.
    pub fn step(&mut self, budget: u32) -> Result<Progress, Error> {
        if budget < Self::SMALLEST_BUDGET {
            return Err(Error::OutOfRange);
        }
        let mut left = budget;
        loop {
            let cost = self.cost();
            if cost > left {
                return Ok(Progress::Working);
            }
            left -= cost;
            self.stage = match self.stage {
                Stage::Pair { q, p } => self.pairs(q, p, &mut left),
                Stage::Done => return Ok(Progress::Done),
                Stage::NotConverged => return Ok(Progress::NotConverged),
                Stage::Idle => return Err(Error::OutOfRange),
                stage => match self.piece(stage) {
                    Ok(next) => next,
                    Err(row) => {
                        self.stage = Stage::Idle;
                        return Err(Error::NotPositive { row });
                    }
                },
            };
        }
    }

    /// Number of eigenvalues: states with a prior.
    pub fn len(&self) -> usize {
        self.n
    }

    /// Whether no state had a prior.
    pub fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// Eigenvalue k in ascending order: of T without unit, or of M [1/s]. `None` before [`Progress::Done`].
    pub fn value(&self, k: usize) -> Option<T> {
        if self.stage != Stage::Done || k >= self.n {
            return None;
        }
        self.values.get(usize::from(*self.rank.get(k)?)).copied()
    }

    /// Direction of eigenvalue k. `None` before [`Progress::Done`], and when no directions are kept.
    ///
    /// About 2 N² multiply-adds.
    pub fn direction(&self, k: usize) -> Option<Direction<T, N>> {
        self.value(k)?;
        let axis = self.axes.axis(usize::from(*self.rank.get(k)?));
        if axis.is_empty() {
            return None;
        }
        let mut u = [T::zero(); N];
        if self.definite {
            // u = L0⁻¹ L v to unit length
            let mut length = T::zero();
            for (u, row) in u.iter_mut().zip(rows(&self.b)).take(self.n) {
                *u = dot(row, axis);
                length += *u * *u;
            }
            // squares of a small eigenvalue's vector do not underflow: λ itself is their sum
            let scale = T::one() / length.root();
            for u in &mut u {
                *u *= scale;
            }
            if let Prior::Correlated(_) = self.prior {
                solve_transposed(&self.a, self.n, &mut u);
            }
        } else {
            for (u, v) in u.iter_mut().zip(axis).take(self.n) {
                *u = *v;
            }
            if let Prior::Correlated(_) = self.prior {
                solve_transposed(&self.b, self.n, &mut u);
            }
        }
        let (first, dimension) = self.group(k);
        Some(Direction {
            vector: oriented(&u, &self.order, self.n),
            first,
            dimension,
        })
    }

    /// The eigenvalues around k that differ from their neighbours by less than [`GAP`], relatively, or by less than
    /// the resolution of −Ṗ: first one and count.
    fn group(&self, k: usize) -> (usize, usize) {
        let close = |k: usize| match (self.value(k), self.value(k + 1)) {
            (Some(x), Some(y)) => {
                let size = x.abs().max(y.abs());
                y - x < T::of(GAP) * size || y - x < T::of(8.0) * self.floor
            }
            _ => false,
        };
        let (mut first, mut last) = (k, k);
        while first > 0 && close(first - 1) {
            first -= 1;
        }
        while last + 1 < self.n && close(last) {
            last += 1;
        }
        (first, last + 1 - first)
    }
}
