//! ξ: degree of observability of each state by itself, at every update (Lu 2009, eqs 22, 23).

use nalgebra::{SMatrix, SVector};

use super::riccati::{diagonal, diagonal_blocks, Information};
use crate::covariance::{Covariance, Covariance15};
use crate::error::Error;
use crate::filter::UpdateReport;
use crate::linalg::{each_state, looped, looped_mut, BlockTransition, Real};

/// One index per state, available or not.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Index<T, const N: usize> {
    value: [T; N],
    available: u32,
}

impl<T: Real, const N: usize> Index<T, N> {
    const SIZE: () = assert!(N <= 32, "one bit per state");

    fn new(value: [T; N], available: u32) -> Self {
        const { Self::SIZE };
        Self { value, available }
    }

    /// The index of state i; `None` when it is not available: the state had no variance at the start, or the interval
    /// of the measurement is unknown.
    pub fn get(&self, i: usize) -> Option<T> {
        if i < N && self.available & (1 << i) != 0 {
            self.value.get(i).copied()
        } else {
            None
        }
    }

    /// The indices of all states.
    pub fn all(&self) -> [Option<T>; N] {
        let mut i = 0;
        [(); N].map(|()| {
            i += 1;
            self.get(i - 1)
        })
    }

    /// Bit i set: state i has an index.
    pub fn available(&self) -> u32 {
        self.available
    }
}

/// ξ1 and ξ2 of an update of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Xi<T, const N: usize> {
    /// How fast each state is being learnt [1/s].
    pub xi1: Index<T, N>,
    /// How much of each state has been learnt.
    pub xi2: Index<T, N>,
}

impl Xi<f32, 15> {
    /// Both indices of an update that succeeded: it has left no variance that is not positive, and no negative decrease.
    ///
    /// # Errors
    /// [`Error::Variance`] as [`xi2`], for a report that no update has written.
    #[inline(never)]
    pub fn of<const M: usize>(report: &UpdateReport<M>) -> Result<Self, Error> {
        let available = u32::from(report.normalised);
        let mut xi = Self {
            xi1: Index::new([1.0; 15], 0),
            xi2: Index::new([1.0; 15], available),
        };
        let (mut per_second, mut sum) = (0.0, 0.0);
        if (f32::MIN_POSITIVE..=f32::MAX).contains(&report.interval) {
            per_second = 1.0 / report.interval;
            xi.xi1.available = available;
        }
        // spelled out: at opt-level "s" a loop over arrays costs five times as much
        macro_rules! fill {
            ($i:literal) => {
                let (decrease, inverse) = (report.decrease[$i], 1.0 / report.p_after[$i]);
                xi.xi1.value[$i] = decrease * per_second;
                xi.xi2.value[$i] = inverse;
                sum += decrease * inverse;
            };
        }
        each_state!(fill);
        if sum.finite() {
            Ok(xi)
        } else {
            Self::of_any(report) // a variance of zero, which may be legal
        }
    }

    /// [`Xi::of`] where something is rare: a fault to be named, or a state without prior.
    #[cold]
    #[inline(never)]
    fn of_any<const M: usize>(report: &UpdateReport<M>) -> Result<Self, Error> {
        let normalised = u32::from(report.normalised);
        Ok(Self {
            xi1: xi1(&report.decrease, report.interval, normalised)?,
            xi2: xi2(&report.p_after, normalised)?,
        })
    }
}

/// ξ2 = p(0)/p (Lu 2009, eq. 23): how many times smaller the variance of a state has become.
///
/// * `p` — variances in σ0 units, that is p/p(0)
/// * `normalised` — bit i set: state i was started with a variance above zero; the others have no ξ
///
/// 1: nothing was learnt. 10⁴: the standard deviation is down to a hundredth. Below 1: process noise has won, the state
/// is known worse than at the start. It has no unit, but it is relative to the prior: a wide prior makes it large. It
/// does not tell along which combination of states something was learnt ([`super::spectrum`]).
///
/// # Errors
/// [`Error::Variance`] naming the first state whose variance is not positive and finite: the filter is broken. (Of a
/// state without prior 0 is legal.)
pub fn xi2<T: Real, const N: usize>(p: &[T; N], normalised: u32) -> Result<Index<T, N>, Error> {
    check_variances(p, normalised)?;
    // infinite for a state that started at 0 and is still there: it has no ξ
    let mut value = *p;
    for value in looped_mut(&mut value) {
        *value = T::one() / *value;
    }
    Ok(Index::new(value, normalised & mask::<N>()))
}

/// ξ1 = (p⁻ − p⁺)/(T p(0)) [1/s]: what the update took from the variance of a state, per second of its interval.
///
/// This is −ṗ/p(0) of the measurement (Lu 2009, eq. 22), exact over the update instead of differential: never negative,
/// and right also where the variance collapses in one step, where the Riccati form is out by p⁻/R.
///
/// * `decrease` — p⁻ − p⁺ in σ0 units, as the update reports it (not the difference of the two, which is rounding where
///   little is learnt)
/// * `interval` — T, the nominal interval of that measurement [s]; zero, negative or not finite means unknown, and no
///   state has a ξ1
///
/// 0: this measurement taught nothing about the state. Rows of one update share one ξ1.
///
/// # Errors
/// [`Error::Variance`] naming the first state whose decrease is negative or not finite: the filter is broken.
pub fn xi1<T: Real, const N: usize>(
    decrease: &[T; N],
    interval: T,
    normalised: u32,
) -> Result<Index<T, N>, Error> {
    let (mut sum, mut fine) = (T::zero(), true);
    for d in looped(decrease) {
        fine &= *d >= T::zero();
        sum += *d;
    }
    if !(fine && sum.finite()) {
        let broken = |d: &T| !(*d >= T::zero() && d.finite());
        let state = looped(decrease).iter().position(broken).unwrap_or(0);
        return Err(Error::Variance { state: state as u8 });
    }
    let known = interval > T::zero() && interval.finite();
    let per_second = if known {
        T::one() / interval
    } else {
        T::zero()
    };
    let available = if known { normalised & mask::<N>() } else { 0 };
    let mut value = *decrease;
    for value in looped_mut(&mut value) {
        *value *= per_second;
    }
    Ok(Index::new(value, available))
}

/// ξ1 = −ṗ/p(0) [1/s] with Ṗ of the Riccati equation just after an update (Lu 2009, eqs 17, 22) and the measurement
/// noise R·T.
///
/// Propagation and process noise are in it, so it may be negative: noise wins then. Against [`xi1`] the measurement
/// term is smaller by R/(R + p⁻) for a scalar row, up to twenty-fold at a first update; the paper used 0.1 s in place of
/// T. Resolution: ε of the largest term of its sum.
///
/// * `p` — P just after the update, `f`, `q` — F and the diagonal of the noise density [1/s], all in σ0 units
/// * `information` — the measurement; `None` (interval unknown) makes the index not available
pub fn xi1_riccati<T: Real, const M: usize, const N: usize, const L: usize>(
    p: &Covariance<T, N, L>,
    f: &SMatrix<T, N, N>,
    q: &SVector<T, N>,
    information: Option<&Information<T, M, N>>,
    normalised: u32,
) -> Index<T, N> {
    match information {
        Some(information) => Index::new(diagonal(p, f, q, information), normalised & mask::<N>()),
        None => Index::new([T::zero(); N], 0),
    }
}

/// As [`xi1_riccati`] for the 15-state filter: `rates` is F and the noise densities by blocks, per second
/// ([`crate::error_model::block_rates`]).
pub fn xi1_riccati_blocks<T: Real, const M: usize>(
    p: &Covariance15<T>,
    rates: &BlockTransition<T>,
    information: Option<&Information<T, M, 15>>,
    normalised: u32,
) -> Index<T, 15> {
    match information {
        Some(information) => Index::new(
            diagonal_blocks(p, rates, information),
            normalised & mask::<15>(),
        ),
        None => Index::new([T::zero(); 15], 0),
    }
}

/// One bit per state.
pub(super) const fn mask<const N: usize>() -> u32 {
    if N >= 32 {
        u32::MAX
    } else {
        (1 << N) - 1
    }
}

/// Refuses variances that a working filter cannot have: of a state with prior not positive, of any state negative or
/// not finite.
pub(super) fn check_variances<T: Real, const N: usize>(
    p: &[T; N],
    normalised: u32,
) -> Result<(), Error> {
    let (mut sum, mut positive) = (T::zero(), true);
    for p in looped(p) {
        positive &= *p > T::zero();
        sum += *p;
    }
    if positive && sum.finite() {
        return Ok(());
    }
    // rare: a state without prior, or a fault
    for (i, p) in looped(p).iter().enumerate() {
        let zero_is_legal = i < 32 && normalised & (1 << i) == 0;
        let fine = *p > T::zero() || (zero_is_legal && *p == T::zero());
        if !(fine && p.finite()) {
            return Err(Error::Variance { state: i as u8 });
        }
    }
    Ok(())
}
