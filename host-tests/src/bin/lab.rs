//! `cargo lab COMMAND`: simulation, covariance analysis and replay of recorded data on a PC.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    host_tests::lab::main()
}
