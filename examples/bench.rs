//! The work that `cargo xtask bench` counts on a Cortex-M4F. On the host it does nothing.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!("counted on the target: cargo xtask bench");
}

#[cfg(target_os = "none")]
#[path = "firmware/advice.rs"]
mod advice;
#[cfg(target_os = "none")]
#[path = "firmware/aiding.rs"]
mod aiding;
#[cfg(target_os = "none")]
#[path = "firmware/alignment.rs"]
mod alignment;
#[cfg(target_os = "none")]
mod firmware;
#[cfg(target_os = "none")]
#[path = "firmware/probe.rs"]
mod probe;
#[cfg(target_os = "none")]
#[path = "firmware/rows.rs"]
mod rows;
#[cfg(target_os = "none")]
#[path = "firmware/ways.rs"]
mod ways;

#[cfg(target_os = "none")]
use rows::run;
