//! Alignment in several positions, simulated: the ways of carrying what one position has taught into the next, over
//! many seeds.
//!
//! | file | does |
//! |---|---|
//! | [`scenario`] | what is simulated, and Peng's section 3 |
//! | [`variant`] | the ways, each through the library's own filter in f32 |
//! | [`tally`] | sums over seeds that parts of a run can be added from |

pub mod scenario;
pub mod tally;
pub mod variant;

pub use scenario::Scenario;
pub use tally::{Cell, Tally};
pub use variant::Variant;

use navsight::error::Error;
use rayon::prelude::*;

/// Runs many seeds on all cores; the sum does not depend on how they were spread, but for the last bits.
///
/// # Errors
/// Those of the filter.
pub fn monte_carlo(
    scenario: &Scenario,
    variants: &[Variant],
    seeds: impl IntoParallelIterator<Item = u64>,
    done: impl Fn() + Sync,
) -> Result<Tally, Error> {
    let track = scenario.track();
    seeds
        .into_par_iter()
        .map(|seed| {
            let mut tally = Tally::default();
            variant::run(scenario, &track, variants, seed, &mut tally)?;
            done();
            Ok(tally)
        })
        .try_reduce(Tally::default, |mut a, b| {
            a.merge(&b);
            Ok(a)
        })
}
