//! A strapdown navigator with a 15-state error-state Kalman filter that measures, while it runs, its own degree of
//! observability. No allocation, no `std`, no panic path, f32 throughout the hot path.
//!
//! # Conventions
//!
//! Written here once; every room relies on them. None of them can be switched at run time.
//!
//! | subject | convention |
//! |---|---|
//! | frame n | local level, east-north-up (ENU), at the estimated position |
//! | frame b | body, right-forward-up (RFU) |
//! | `c_b_n` | takes body vectors to n: `v_n = c_b_n * v_b` |
//! | heading | clockwise from north, [rad]; pitch: nose up positive; roll: right side down positive |
//! | `omega_xy_z` | angular rate of frame y against frame x, resolved in z, [rad/s] |
//! | units | SI and radians inside; degrees, °/h, µg only at the edges, with the unit in the name |
//! | position, velocity errors | estimate minus truth: δr_n [m], δv_n [m/s] |
//! | attitude error | psi angle ψ_n [rad], estimate minus truth: Ĉ = (I − [ψ×]) C |
//! | bias states | what is left uncompensated, truth minus estimate: b_g [rad/s], b_a [m/s²], body axes |
//! | innovation | ν = z − h(x̂); the row h is ∂ν/∂δx, so correcting by δx leaves ν − h·δx |
//!
//! Psi-angle model: Ĉ and v̂ refer to the level frame at the *estimated* position. The angle against the frame at the
//! true position is φ = ψ + δθ with δθ = (−δr_N/(R_M+h), δr_E/(R_N+h), δr_E·tan L/(R_N+h)); a correction of the position
//! by δr therefore turns Ĉ and v̂ by δθ as well.
//!
//! State order: δr_n (0–2), δv_n (3–5), ψ_n (6–8), b_g (9–11), b_a (12–14).
#![no_std]
#![forbid(unsafe_code)]
#![warn(missing_docs)]
// Units stand in brackets, as in [m], and are no links; `cargo xtask thumb` finds links that lead nowhere.
#![allow(rustdoc::broken_intra_doc_links)]

#[cfg(test)]
extern crate std;

pub mod alignment;
pub mod attitude;
pub mod covariance;
pub mod earth;
pub mod error;
pub mod error_model;
pub mod filter;
pub mod imu;
pub mod linalg;
pub mod measurement;
pub mod mechanization;
pub mod nav;
pub mod observability;
pub mod sensor;
pub mod tracking;

/// The code of the README is compiled with the tests of the library.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
