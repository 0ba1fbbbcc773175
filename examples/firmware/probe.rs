//! Marks a piece of work for the counting plugin of `cargo xtask bench`.

use core::arch::asm;
use core::hint::black_box;

use navsight::error::Error;

/// Runs `work(state)` between the two marker instructions that the plugin looks for.
///
/// A plain `fn` behind `black_box` keeps the compiler from moving work across the markers. The call and the return
/// are counted, too: subtract an empty function measured the same way.
#[inline(never)]
pub fn region<S, R>(state: &mut S, work: fn(&mut S) -> R) -> R {
    let work = black_box(work);
    // SAFETY: 0xbf80 is an unallocated hint, which every Cortex-M executes as a no-op; push and pop are balanced and
    // show the plugin where the stack pointer is.
    unsafe { asm!("push {{r7}}", "pop {{r7}}", ".inst.n 0xbf80") };
    let result = work(black_box(state));
    // SAFETY: an unallocated hint again.
    unsafe { asm!(".inst.n 0xbf90") };
    black_box(state);
    result
}

/// Work whose count is known: 103 instructions more than an empty function, 64 bytes of stack.
pub fn calibration(_: &mut ()) -> Result<(), Error> {
    // SAFETY: moves the stack pointer and back, stores one word between, and 100 times does nothing.
    unsafe {
        asm!(
            "sub sp, #64",
            "str r0, [sp]",
            ".rept 100",
            "nop",
            ".endr",
            "add sp, #64"
        );
    }
    Ok(())
}
