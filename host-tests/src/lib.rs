//! What the claims of navsight are measured with, on a PC: a simulator, independent double-precision twins of the
//! kernels, recorded data, and reports.
#![cfg_attr(target_os = "none", no_std)]

#[cfg(not(target_os = "none"))]
pub mod alignment;
#[cfg(not(target_os = "none"))]
pub mod analysis;
#[cfg(not(target_os = "none"))]
pub mod config;
#[cfg(not(target_os = "none"))]
pub mod covariance_analysis;
#[cfg(not(target_os = "none"))]
pub mod flight;
#[cfg(not(target_os = "none"))]
pub mod input;
#[cfg(not(target_os = "none"))]
pub mod lab;
#[cfg(not(target_os = "none"))]
pub mod paper;
#[cfg(not(target_os = "none"))]
pub mod reference;
#[cfg(not(target_os = "none"))]
pub mod report;
#[cfg(not(target_os = "none"))]
pub mod sim;
#[cfg(not(target_os = "none"))]
pub mod stationary;
#[cfg(not(target_os = "none"))]
pub mod tracking;
