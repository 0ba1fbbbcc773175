//! Self-alignment of a standing vehicle: from no attitude at all to the filter's own.
//!
//! | file | does |
//! |---|---|
//! | [`coarse`] | attitude from a window of samples that resists disturbance: level and gyrocompass |
//! | [`standing`] | coarse window, then the filter with zero-velocity updates, through turns to further positions |

pub mod coarse;
pub mod standing;
