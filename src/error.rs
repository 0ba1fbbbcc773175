//! Why a call was refused. Whatever was called is bit-identical to what it was before.

/// Why a call was refused. The object that refused it is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Error {
    /// A sample, a measurement or a setting held NaN or ±∞.
    NonFinite,
    /// A number is finite and impossible: outside what its documentation allows.
    OutOfRange,
    /// Time went backwards, stood still, or jumped beyond the configured gap.
    Time,
    /// A measurement is older than the history reaches.
    Late,
    /// The innovation variance of this row was not positive: R or P is broken.
    InnovationVariance {
        /// Row of the measurement, from 0.
        row: u8,
    },
    /// The variance of this state would not have stayed positive: the covariance is broken.
    Variance {
        /// State, from 0.
        state: u8,
    },
    /// A covariance handed in is not symmetric positive semi-definite.
    NotPositive {
        /// First row at which the factorisation failed, from 0.
        row: u8,
    },
    /// Sizes that do not fit together or exceed the room there is: no state, no output, too many of them.
    Size,
    /// An iteration reached its bound before its result was good enough; there is none.
    NotConverged,
    /// The latitude is too close to a pole for a north-slaved local level frame (|L| > 80°).
    Polar,
}
