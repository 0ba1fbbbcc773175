//! The Cortex-M4F face of an example: start-up, output by semihosting, a panic that ends the run.
//!
//! An example calls its work `run` and includes this file as `mod firmware` on the target; its first line is
//! `#![cfg_attr(target_os = "none", no_std, no_main)]`.

use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hio};

#[entry]
fn main() -> ! {
    // Without a host that answers there is nowhere to print to, and the exit status says so.
    let printed = hio::hstdout().is_ok_and(|mut out| crate::run(&mut out).is_ok());
    debug::exit(if printed {
        debug::EXIT_SUCCESS
    } else {
        debug::EXIT_FAILURE
    });
    loop {
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    if let Ok(mut out) = hio::hstdout() {
        let _ = core::fmt::write(&mut out, format_args!("{info}\n"));
    }
    debug::exit(debug::EXIT_FAILURE);
    loop {
        cortex_m::asm::wfi();
    }
}
