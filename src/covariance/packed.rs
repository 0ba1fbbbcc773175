//! The packed triangle: how a covariance is stored, made and read.

use crate::error::Error;
use crate::linalg::{all_finite, first_negative, looped, rolled, Real};
use nalgebra::SMatrix;

/// Position of element (i, j), i ≤ j, in the packed upper triangle, column after column.
#[inline(always)]
pub(super) const fn upper(i: usize, j: usize) -> usize {
    j * (j + 1) / 2 + i
}

/// Position of element (i, j) or (j, i), whichever is stored.
#[inline(always)]
pub(super) const fn at(i: usize, j: usize) -> usize {
    if i <= j {
        upper(i, j)
    } else {
        upper(j, i)
    }
}

/// A symmetric N × N covariance: upper triangle, column after column (element (i, j), i ≤ j, at j(j+1)/2 + i), every
/// element the sum of a high and a low word. L = N(N+1)/2, checked when the type is used.
///
/// Whoever fills it divides the states by their initial σ0 first, so that every diagonal element starts at 1 and says
/// what is left of the initial variance. That is also what single precision needs: unscaled, the worst error of the
/// same kernels is three to four times larger.
///
/// The high word is the covariance to the precision of T; the low word is what the additions so far could not fit in
/// and offer again. Symmetry is exact because one number stands for both halves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance<T, const N: usize, const L: usize> {
    pub(super) hi: [T; L],
    pub(super) lo: [T; L],
}

/// The covariance of the 15-state filter.
pub type Covariance15<T> = Covariance<T, 15, 120>;

impl<T: Real, const N: usize, const L: usize> Covariance<T, N, L> {
    /// Holds at compile time: the length of the triangle belongs to the number of states.
    pub(super) const SIZE: () = assert!(L == N * (N + 1) / 2, "L must be N(N+1)/2");

    /// Independent states with these variances.
    ///
    /// A variance of 0 is legal (a state known exactly); negative, NaN or infinite is refused.
    ///
    /// # Errors
    /// [`Error::NonFinite`], or [`Error::Variance`] naming the first negative state.
    pub fn from_diagonal(variance: &[T; N]) -> Result<Self, Error> {
        const { Self::SIZE };
        if !all_finite(variance) {
            return Err(Error::NonFinite);
        }
        if let Some(state) = first_negative(variance) {
            return Err(Error::Variance { state: state as u8 });
        }
        let mut p = Self::zero();
        Self::pack_variances(variance, &mut p.hi);
        Ok(p)
    }

    /// Everything known exactly.
    pub(crate) fn zero() -> Self {
        Self {
            hi: [T::zero(); L],
            lo: [T::zero(); L],
        }
    }

    /// Of a covariance fresh from [`Covariance::zero`]; nothing is checked.
    #[inline(always)]
    pub(crate) fn set_variance(&mut self, j: usize, variance: T) {
        if let Some(e) = self.hi.get_mut(upper(j, j)) {
            *e = variance;
        }
    }

    /// A full covariance, correlations included.
    ///
    /// Accepted when it is finite, symmetric to rounding (8 ε of the geometric mean of the two variances) and positive
    /// semi-definite by its Cholesky factorisation: a pivot may fall to zero, or below it by no more than N·8 ε of its
    /// diagonal element, provided nothing is left in its column. The mean of the two halves is stored.
    ///
    /// # Errors
    /// [`Error::NonFinite`], or [`Error::NotPositive`] naming the row where symmetry or the factorisation failed.
    pub fn from_matrix(p: &SMatrix<T, N, N>) -> Result<Self, Error> {
        const { Self::SIZE };
        let p = |i: usize, j: usize| p.get((i, j)).copied().unwrap_or_else(T::zero);
        Self::check(&p)?;
        Ok(Self::of(&p))
    }

    /// Whether [`Covariance::from_matrix`] accepts the matrix with these elements.
    #[inline(never)]
    pub(crate) fn check(p: &impl Fn(usize, usize) -> T) -> Result<(), Error> {
        if !(0..N).all(|j| (0..N).all(|i| p(i, j).finite())) {
            return Err(Error::NonFinite);
        }
        check_positive::<T, N>(p, &mut [T::ZERO; L])
    }

    /// Of the matrix with these elements, the mean of its two halves; nothing is checked. Written where the caller wants it:
    /// of a triangle that is filled through a reference the stack would have two.
    #[inline(never)]
    pub(crate) fn of(p: &impl Fn(usize, usize) -> T) -> Self {
        let (mut i, mut j) = (0, 0);
        Self {
            hi: [(); L].map(|()| {
                let word = T::of(0.5) * (p(i, j) + p(j, i));
                (i, j) = if i < j { (i + 1, j) } else { (0, j + 1) };
                word
            }),
            lo: [T::ZERO; L],
        }
    }

    /// Into packed words that are zero: the variances of independent states.
    #[inline(always)]
    pub(crate) fn pack_variances(variance: &[T; N], words: &mut [T; L]) {
        for (j, variance) in looped(variance).iter().enumerate() {
            rolled();
            if let Some(word) = words.get_mut(upper(j, j)) {
                *word = *variance;
            }
        }
    }

    /// Variance of state `i`; NaN when there is no such state.
    #[must_use]
    pub fn variance(&self, i: usize) -> T {
        self.element(i, i)
    }

    /// Element (i, j); NaN when there is no such element.
    #[must_use]
    pub fn element(&self, i: usize, j: usize) -> T {
        if i < N && j < N {
            if let Some(p) = self.hi.get(at(i, j)) {
                return *p;
            }
        }
        T::of(f64::NAN)
    }

    /// Makes state `i` independent of all others, with this variance. A state that does not exist is left out.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::Variance`] for a negative one. The covariance is then bit-identical.
    pub fn isolate(&mut self, i: usize, variance: T) -> Result<(), Error> {
        if !variance.finite() {
            return Err(Error::NonFinite);
        }
        if variance < T::zero() {
            return Err(Error::Variance { state: i as u8 });
        }
        for j in 0..N {
            let k = if i < N { at(i, j) } else { L };
            let value = if i == j { variance } else { T::zero() };
            if let (Some(hi), Some(lo)) = (self.hi.get_mut(k), self.lo.get_mut(k)) {
                (*hi, *lo) = (value, T::zero());
            }
        }
        Ok(())
    }

    /// All variances.
    #[must_use]
    pub fn diagonal(&self) -> [T; N] {
        let mut k = 0;
        let mut step = 1;
        [(); N].map(|()| {
            let p = self.hi.get(k).copied().unwrap_or_else(T::zero);
            step += 1;
            k += step;
            p
        })
    }

    /// The stored words, high and low: upper triangle, column after column.
    #[must_use]
    pub fn words(&self) -> (&[T; L], &[T; L]) {
        (&self.hi, &self.lo)
    }

    /// The full symmetric matrix, high words only.
    #[must_use]
    pub fn to_matrix(&self) -> SMatrix<T, N, N> {
        SMatrix::from_fn(|i, j| self.element(i, j))
    }

    /// First state whose variance is not finite and positive, if there is one.
    #[must_use]
    pub fn broken(&self) -> Option<usize> {
        self.diagonal()
            .iter()
            .position(|p| !(p.finite() && *p > T::zero()))
    }
}

/// Column j of the symmetric matrix of which `words` is the packed triangle.
#[inline(always)]
pub(super) fn column<T: Real, const N: usize>(words: &[T], j: usize) -> [T; N] {
    let mut k = j * (j + 1) / 2;
    let mut i = 0;
    [(); N].map(|()| {
        let p = words.get(k).copied().unwrap_or_else(T::zero);
        k += if i < j { 1 } else { i + 1 };
        i += 1;
        p
    })
}

/// Symmetric and positive semi-definite to rounding, by Cholesky without pivoting. `room`: as many words as a packed
/// triangle has, for the transposed factor.
#[inline(always)]
fn check_positive<T: Real, const N: usize>(
    p: &impl Fn(usize, usize) -> T,
    room: &mut [T],
) -> Result<(), Error> {
    let slack = T::of(8.0) * T::EPSILON;
    let deep = slack * T::of(N as f64);
    let get = |l: &[T], i: usize, k: usize| l.get(upper(k, i)).copied().unwrap_or_else(T::zero);
    for j in 0..N {
        let refuse = Err(Error::NotPositive { row: j as u8 });
        let p_jj = p(j, j);
        if p_jj < T::zero() {
            return refuse;
        }
        let mut pivot = p_jj;
        for k in 0..j {
            pivot -= get(room, j, k) * get(room, j, k);
        }
        let zero = pivot <= deep * p_jj;
        if pivot < -deep * p_jj {
            return refuse;
        }
        let root = pivot.max(T::zero()).root();
        for i in j + 1..N {
            let (lower, upper_half) = (p(i, j), p(j, i));
            let scale = (p_jj * p(i, i).max(T::zero())).root();
            if (lower - upper_half).abs() > slack * scale {
                return refuse;
            }
            let mut x = T::of(0.5) * (lower + upper_half);
            for k in 0..j {
                x -= get(room, i, k) * get(room, j, k);
            }
            let x = if zero {
                if x.abs() > deep.root() * scale {
                    return refuse;
                }
                T::zero()
            } else {
                x / root
            };
            if let Some(to) = room.get_mut(upper(j, i)) {
                *to = x;
            }
        }
    }
    Ok(())
}
