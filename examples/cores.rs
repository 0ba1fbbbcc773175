//! The work of a navigator that `cargo xtask bench --all` counts on other cores, and on a 64-bit PC with its kernels in both
//! scalars. Run by itself it shows nothing of use.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod firmware;
#[cfg(all(not(target_os = "none"), target_arch = "x86_64"))]
#[path = "firmware/kernels.rs"]
mod kernels;
#[cfg(target_os = "none")]
#[path = "firmware/probe.rs"]
mod probe;
#[cfg(all(not(target_os = "none"), target_arch = "x86_64"))]
#[path = "firmware/probe_host.rs"]
mod probe;
#[cfg(any(target_os = "none", target_arch = "x86_64"))]
#[path = "firmware/rows.rs"]
mod rows;

#[cfg(target_os = "none")]
fn run(out: &mut cortex_m_semihosting::hio::HostStream) -> core::fmt::Result {
    rows::usual(&mut rows::Table(out)).map(drop)
}

#[cfg(all(not(target_os = "none"), target_arch = "x86_64"))]
fn main() {
    let mut text = String::new();
    let table = &mut rows::Table(&mut text);
    let (filter, imu) = rows::usual(table).expect("no work is refused");
    kernels::run::<f32>(table, "f32", &filter, imu).expect("no work is refused");
    kernels::run::<f64>(table, "f64", &filter, imu).expect("no work is refused");
    print!("{text}");
}

#[cfg(not(any(target_os = "none", target_arch = "x86_64")))]
fn main() {
    println!("counted on microcontrollers and on x86-64: cargo xtask bench --all");
}
