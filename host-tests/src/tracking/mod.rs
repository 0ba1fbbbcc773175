//! The library's tracker on a PC: a run of one axis with everything a table or a golden file asks for, and the
//! vehicle and receiver of Fang 1998.

mod run;
pub mod scenario;
pub mod twin;

pub use run::{run, Config, Flag, Step};
