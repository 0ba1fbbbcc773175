//! Degree of observability: what the measurements have taught the filter, how fast, and along which directions.
//!
//! Metrics look from outside: they read reports and matrices and never touch the filter. States are in σ0 units
//! throughout (each divided by its standard deviation at the start), so that they can be compared with each other.
//!
//! | metric | paper | needs | when it runs | cost on a Cortex-M4F, 15 states |
//! |---|---|---|---|---|
//! | [`diagonal::xi2`] | Lu 2009 (23) | p⁺ | every update | 15 ratios |
//! | [`diagonal::xi1`] | Lu 2009 (22), exact over an update | p⁻ − p⁺, T | every update | 15 products |
//! | [`diagonal::xi1_riccati`], [`diagonal::xi1_riccati_blocks`] | Lu 2009 (17), (22) | P⁺, F, Q, H, R·T | an update of interest | see `BENCHMARKS.md` |
//! | [`spectrum::Spectrum`] η2 | Lu 2009 (6), (16) | P⁺, P0 | on demand, in slices | see `BENCHMARKS.md` |
//! | [`spectrum::Spectrum`] η1 | Lu 2009 (5), (15) | −Ṗ, P0 | on demand, in slices | see `BENCHMARKS.md` |
//! | [`extreme::Extremes`] largest and smallest η2 alone | Lu 2009 (6) | P⁺ | on demand, bounded | see `BENCHMARKS.md` |
//! | [`structural::Report`] | graph paper 2020 | zero pattern of F, H | a change of segment | see `BENCHMARKS.md` |
//! | [`pwcs::Staged`] rank | Goshen-Meskin 1992, Peng 2016 | F, H per segment, σ0 | a change of segment, in slices | see `BENCHMARKS.md` |
//! | [`comprehensive`] order, degree | Peng 2016 | `Staged` | after it | a table look-up |
//! | [`eigen_degree`] λ, orders | Yang and Yin | F, H, `Staged` | on demand, in slices | see `BENCHMARKS.md` |
//! | [`ceiling`] of ξ2, information | links of the three | `Staged`; A and rows of the filter | after it; every propagation and update | see `BENCHMARKS.md` |
//! | [`agreement`] flag and sentence | all of them | the above and ξ2 | when somebody asks | a few products |
//! | [`verdict`] word and reason per state | all of them | reports; ceilings where known | every update | see `BENCHMARKS.md` |
//!
//! ξ and η are *prior-weighted*: they say what is left of an initial variance, so a state that was known well at
//! the start shows little, and a state whose prior was wide shows much. Strict observability is another question.

pub mod agreement;
mod basis;
pub mod ceiling;
pub mod comprehensive;
pub mod diagonal;
pub mod eigen_degree;
pub mod extreme;
mod jacobi;
mod one_sided;
pub mod pwcs;
pub mod riccati;
pub mod spectrum;
pub mod structural;
mod triangle;
mod vector;
pub mod verdict;
