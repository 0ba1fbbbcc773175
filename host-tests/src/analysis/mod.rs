//! Analysis on paper, in double precision: what a method promises before any filter runs.

pub mod transfer;
