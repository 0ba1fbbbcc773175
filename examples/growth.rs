//! How the cost grows with the number of rows and with the rate of the covariance: counted by `cargo xtask bench --all`
//! on a Cortex-M4F. On the host it does nothing.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!("counted on the target: cargo xtask bench --all");
}

#[cfg(target_os = "none")]
mod firmware;
#[cfg(target_os = "none")]
#[path = "firmware/growing.rs"]
mod growing;
#[cfg(target_os = "none")]
#[path = "firmware/probe.rs"]
mod probe;

#[cfg(target_os = "none")]
use growing::run;
