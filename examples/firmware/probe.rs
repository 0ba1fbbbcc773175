//! Marks a piece of work for the counting plugin of `cargo xtask bench`, and looks at it a second way that needs no
//! plugin: the SysTick timer, which counts instructions where QEMU runs with `-icount`, and a painted stack.

use core::arch::asm;
use core::fmt;
use core::hint::black_box;
use core::ptr::addr_of;

use navsight::error::Error;

/// The stack is painted this far down [bytes]: each word with the complement of its address, which nobody else holds.
const REACH: usize = 8192;

/// What the timer and the paint say.
pub struct Second {
    ticks: u32,
    bytes: u32,
}

impl fmt::Display for Second {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}\t{}", self.ticks, self.bytes)
    }
}

/// The timer's value, at 0xe000_e018, into {t}: five instructions, wherever it is read.
macro_rules! read_timer {
    () => {
        "movs {t}, #0xe0\nlsls {t}, {t}, #16\nadds {t}, #0xe0\nlsls {t}, {t}, #8\nldr {t}, [{t}, #0x18]"
    };
}

/// Runs `work(state)` between the two marker instructions that the plugin looks for.
///
/// A plain `fn` behind `black_box` keeps the compiler from moving work across the markers. The call and the return
/// are counted, too: subtract an empty function measured the same way. The timer is read in the same blocks as the
/// markers, so that what it counts besides is the same for all work.
#[inline(never)]
pub fn region<S, R>(state: &mut S, work: fn(&mut S) -> R) -> (R, Second) {
    let (state, work) = (black_box(state), black_box(work));
    start_timer();
    let reach = reach();
    // SAFETY: writes between the end of the statics and the stack pointer, where nothing lives.
    unsafe {
        asm!(
            "mov {end}, sp",
            "subs {at}, {end}, {reach}",
            "2:",
            "mvns {paint}, {at}",
            "str {paint}, [{at}]",
            "adds {at}, #4",
            "cmp {at}, {end}",
            "bne 2b",
            end = out(reg) _,
            at = out(reg) _,
            paint = out(reg) _,
            reach = in(reg) reach,
        );
    }
    let mut before = 0u32;
    // SAFETY: reads the timer into `before`. 0xbf80 is an unallocated hint, which every Cortex-M
    // executes as a no-op; push and pop are balanced and show the plugin where the stack pointer is.
    unsafe {
        asm!(
            read_timer!(),
            "str {t}, [{before}]",
            "push {{r7}}",
            "pop {{r7}}",
            ".inst.n 0xbf80",
            t = out(reg) _,
            before = in(reg) &mut before,
        );
    }
    let result = work(state);
    let (after, bytes): (u32, u32);
    // SAFETY: an unallocated hint again, and the timer.
    unsafe {
        asm!(
            ".inst.n 0xbf90",
            read_timer!(),
            t = out(reg) after,
        );
    }
    // SAFETY: reads what was painted.
    unsafe {
        asm!(
            "mov {end}, sp",
            "subs {at}, {end}, {reach}",
            "2:",
            "ldr {word}, [{at}]",
            "mvns {paint}, {at}",
            "cmp {word}, {paint}",
            "bne 3f",
            "adds {at}, #4",
            "cmp {at}, {end}",
            "bne 2b",
            "3:",
            "subs {at}, {end}, {at}",
            end = out(reg) _,
            at = out(reg) bytes,
            word = out(reg) _,
            paint = out(reg) _,
            reach = in(reg) reach,
        );
    }
    black_box(state);
    let ticks = before.wrapping_sub(after) & 0xff_ffff; // it counts down, 24 bits
    (result, Second { ticks, bytes })
}

/// How far down the stack may be painted [bytes]: a small machine has less of it.
fn reach() -> usize {
    extern "C" {
        /// The end of the statics, from the linker.
        static __sheap: u32;
    }
    let here: usize;
    // SAFETY: reads the stack pointer.
    unsafe { asm!("mov {}, sp", out(reg) here) };
    // A frame of this function or its caller lies between.
    let free = here.saturating_sub(addr_of!(__sheap) as usize + 256);
    REACH.min(free & !3)
}

/// Lets SysTick run through all of its 24 bits, at the clock of the core and without interrupt.
fn start_timer() {
    const CONTROL: *mut u32 = 0xe000_e010 as *mut u32;
    const RELOAD: *mut u32 = 0xe000_e014 as *mut u32;
    // SAFETY: registers that every Cortex-M in QEMU has, and that nothing else in these programs uses.
    unsafe {
        if CONTROL.read_volatile() & 5 != 5 {
            RELOAD.write_volatile(0xff_ffff);
            CONTROL.write_volatile(5);
        }
    }
}

/// Work that is none: its count is taken off.
pub fn empty(_: &mut ()) -> Result<(), Error> {
    Ok(())
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
