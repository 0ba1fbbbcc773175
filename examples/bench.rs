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
#[path = "firmware/kernels.rs"]
mod kernels;
#[cfg(target_os = "none")]
#[path = "firmware/probe.rs"]
mod probe;
#[cfg(target_os = "none")]
#[path = "firmware/rows.rs"]
mod rows;
#[cfg(target_os = "none")]
#[path = "firmware/states.rs"]
mod states;
#[cfg(target_os = "none")]
#[path = "firmware/ways.rs"]
mod ways;

/// All rows, in the order of the table, and the states.
#[cfg(target_os = "none")]
fn run(out: &mut cortex_m_semihosting::hio::HostStream) -> core::fmt::Result {
    let table = &mut rows::Table(out);
    let (filter, imu) = rows::usual(table)?;
    aiding::run(table, &filter, imu)?;
    ways::run(table)?;
    advice::run(table, &filter)?;
    alignment::run(table, &filter, imu)?;
    kernels::run::<f32>(table, "f32", &filter, imu)?;
    kernels::run::<f64>(table, "f64", &filter, imu)?;
    states::list(table)
}
