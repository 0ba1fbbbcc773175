//! The firmware's side: counted regions as in navsight's own bench.

use core::fmt::Write;

use embedded_alloc::LlffHeap as Heap;

use crate::scenario::{gravity, sample, Peer, Sample};
use crate::{drive, each_peer, fusion, kinavis, linear, ours};

#[path = "../../examples/firmware/probe.rs"]
mod probe;
use probe::{calibration, empty, region};

/// For minikalman's builder, before anything is counted.
#[global_allocator]
static HEAP: Heap = Heap::empty();

/// Samples before the counted ones: two updates, so that no filter is at its first.
const BEFORE: u32 = 205;

fn rows<P: Peer>(out: &mut impl Write) -> core::fmt::Result {
    let (Some(mut steady), Some(mut between)) = (drive::<P>(BEFORE), drive::<P>(BEFORE + 4)) else {
        return writeln!(out, "refused\t{}", P::NAME);
    };
    let kind = if P::ALGEBRA_ONLY {
        "algebra"
    } else {
        "navigator"
    };
    let bytes = core::mem::size_of::<P>();
    writeln!(out, "peer\t{}\t{}\t{kind}\t{bytes}", P::NAME, P::SCALAR)?;
    // a sample that moves no covariance in a filter that gathers, and any sample in one that does not
    let g = gravity();
    let mut state = (&mut steady, sample(BEFORE, g));
    let (done, second) = region(&mut state, |(p, s): &mut (&mut P, Sample)| p.predict(s));
    writeln!(out, "row\t{}\tsample\t{done}\t{second}", P::NAME)?;
    let mut state = (&mut between, sample(BEFORE + 4, g));
    let (done, second) = region(&mut state, |(p, s): &mut (&mut P, Sample)| p.predict(s));
    writeln!(
        out,
        "row\t{}\tsample that moves the covariance\t{done}\t{second}",
        P::NAME
    )?;
    let mut state = (&mut between, BEFORE + 5);
    let (done, second) = region(&mut state, |(p, k): &mut (&mut P, u32)| p.update(*k));
    writeln!(out, "row\t{}\tupdate\t{done}\t{second}", P::NAME)
}

fn all(out: &mut impl Write) -> core::fmt::Result {
    let (_, second) = region(&mut (), empty);
    writeln!(out, "row\tempty\t\t\t{second}")?;
    let (_, second) = region(&mut (), calibration);
    writeln!(out, "row\tcalibration\t\t\t{second}")?;
    macro_rules! one {
        ($peer:ty) => {
            rows::<$peer>(out)?
        };
    }
    each_peer!(one);
    Ok(())
}

/// What the firmware does.
pub fn run(out: &mut impl Write) -> core::fmt::Result {
    const SIZE: usize = 64 * 1024;
    static mut ROOM: [u8; SIZE] = [0; SIZE];
    // SAFETY: done once, before any allocation; nobody else touches the room.
    unsafe { HEAP.init(&raw mut ROOM as usize, SIZE) };
    all(out)
}
