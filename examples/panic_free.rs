//! Proof that no panic path survives: calls every public function, and its panic handler calls a function that nobody
//! defines. `cargo xtask panic-free` links it at opt-level 3 and "s". It is never run, and prints nothing.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![allow(unexpected_cfgs)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!("linked for the target: cargo xtask panic-free");
}

#[cfg(all(target_os = "none", not(panic_control)))]
#[path = "firmware/every_function.rs"]
mod every_function;

#[cfg(target_os = "none")]
mod target {
    extern "C" {
        fn navsight_panic_path_survived() -> !;
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo) -> ! {
        // SAFETY: never defined, so a program in which this call is left does not link.
        unsafe { navsight_panic_path_survived() }
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        #[cfg(not(panic_control))]
        crate::every_function::call();
        // The control: an index that the optimizer cannot check must keep the program from linking.
        #[cfg(panic_control)]
        core::hint::black_box([1, 2, 3][core::hint::black_box(7)]);
        loop {
            cortex_m::asm::wfi();
        }
    }
}
