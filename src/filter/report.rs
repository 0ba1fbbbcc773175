//! What one measurement update shows from outside.

use crate::covariance::Slots;
use crate::error_model::N;

/// One measurement update of M rows, as the filter saw it.
///
/// Everything that observability, verdicts and logs need is in here; none of them looks into the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpdateReport<const M: usize> {
    /// Innovation z − h(x̂) of each row as it was given, unit of z.
    pub nu: [f32; M],
    /// Its variance h P hᵀ + R before any row of this update was used, unit of z squared.
    pub s: [f32; M],
    /// Normalised innovation squared of each row after the rows before it, dimensionless: χ² with one degree of freedom.
    pub row_nis: [f32; M],
    /// Normalised innovation squared of the accepted rows together: χ² with as many degrees of freedom as rows.
    pub nis: f32,
    /// Whether each row passed its gate. A row that did not taught the filter nothing.
    pub accepted: [bool; M],
    /// Variances just before the update, as a fraction of those that the filter was started with.
    pub p_before: [f32; N],
    /// Variances just after the update, likewise.
    pub p_after: [f32; N],
    /// What the update took from each variance, likewise; to f32 precision of its own size, which the difference of the
    /// two above is not when little was learnt.
    pub decrease: [f32; N],
    /// What the update took for the error of each state (estimate minus truth for position, velocity and attitude,
    /// truth minus estimate for biases) and corrected, likewise in units of σ0. Where the filter's model holds it is
    /// white, with `decrease` for its variance.
    pub correction: [f32; N],
    /// Bit `i` is set when state `i` was started with a variance above zero; the others have no ξ.
    pub normalised: u16,
    /// Nominal interval of this measurement [s], the T of ξ1; zero or less when unknown.
    pub interval: f32,
}

impl<const M: usize> UpdateReport<M> {
    /// Room for a report ([`crate::filter::Filter::update_into`]); what it holds before means nothing.
    #[inline(always)]
    pub const fn empty() -> Self {
        Self {
            nu: [0.0; M],
            s: [0.0; M],
            row_nis: [0.0; M],
            nis: 0.0,
            accepted: [false; M],
            p_before: [1.0; N],
            p_after: [1.0; N],
            decrease: [1.0; N],
            correction: [1.0; N],
            normalised: 0,
            interval: 0.0,
        }
    }

    /// Where the covariance writes what it did.
    #[inline(always)]
    pub(super) fn slots(&mut self) -> Slots<'_, f32, M, N> {
        Slots {
            s: &mut self.s,
            nis: &mut self.nis,
            row_nis: &mut self.row_nis,
            accepted: &mut self.accepted,
            dx: &mut self.correction,
            decrease: &mut self.decrease,
            p_before: &mut self.p_before,
            p_after: &mut self.p_after,
        }
    }

    /// Number of rows that were used.
    pub fn rows_accepted(&self) -> usize {
        self.accepted.iter().filter(|&&used| used).count()
    }
}
