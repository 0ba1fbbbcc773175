//! Sums of many small increments: a two-word number against a plain one. Prints the bits of both after every decade.
//!
//! Expect the plain sum to stop growing, and the same bits on the host and on a Cortex-M4F.
#![cfg_attr(target_os = "none", no_std, no_main)]

use navsight::linalg::Two;

fn run(out: &mut impl core::fmt::Write) -> core::fmt::Result {
    let increment = 7.292115e-7_f32; // the earth's rotation in 10 ms [rad]
    let mut two = Two::of(1.0);
    let mut plain = 1.0_f32;
    for n in 1..=100_000 {
        two.add(increment);
        plain += increment;
        if [10, 100, 1_000, 10_000, 100_000].contains(&n) {
            writeln!(
                out,
                "{n:>6} {:08x} {:08x} {:08x}",
                two.hi.to_bits(),
                two.lo.to_bits(),
                plain.to_bits()
            )?;
        }
    }
    Ok(())
}

#[cfg(not(target_os = "none"))]
fn main() {
    let mut s = String::new();
    run(&mut s).unwrap();
    print!("{s}");
}

#[cfg(target_os = "none")]
mod firmware;
