//! What papers print, as numbers to stand beside ours.

pub mod cells;
pub mod lu2009;
