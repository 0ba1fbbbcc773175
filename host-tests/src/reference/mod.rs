//! Double-precision twins, written from the equations and not from the library's code.

pub mod error_model;
pub mod kalman;
pub mod lu2009;
pub mod random;
pub mod strapdown;
pub mod structural;
