//! The marks of `probe.rs` on a 64-bit PC, for the same plugin in `qemu-x86_64`. There is no second way of looking here.

use core::arch::asm;
use core::fmt;
use core::hint::black_box;

use navsight::error::Error;

/// Nothing.
pub struct Second;

impl fmt::Display for Second {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("0\t0")
    }
}

/// Runs `work(state)` between the two markers, no-ops with a number that no compiler writes.
#[inline(never)]
pub fn region<S, R>(state: &mut S, work: fn(&mut S) -> R) -> (R, Second) {
    let (state, work) = (black_box(state), black_box(work));
    // SAFETY: push and pop are balanced and show the plugin where the stack pointer is; the other is a no-op.
    unsafe { asm!("push rax", "pop rax", "nop dword ptr [rax + 0xbf80]") };
    let result = work(state);
    // SAFETY: a no-op.
    unsafe { asm!("nop dword ptr [rax + 0xbf90]") };
    black_box(state);
    (result, Second)
}

/// Work that is none: its count is taken off.
pub fn empty(_: &mut ()) -> Result<(), Error> {
    Ok(())
}

/// Work whose count is known: 103 instructions more than an empty function, 64 bytes of stack.
pub fn calibration(_: &mut ()) -> Result<(), Error> {
    // SAFETY: moves the stack pointer and back, stores one word between, and 100 times does nothing. `nostack` keeps the
    // function as bare as the empty one; it has nothing on the stack.
    unsafe {
        asm!(
            "sub rsp, 64",
            "mov [rsp], rax",
            ".rept 100",
            "nop",
            ".endr",
            "add rsp, 64",
            options(nostack)
        );
    }
    Ok(())
}
