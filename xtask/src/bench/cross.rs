//! Cross-checks of the counting plugin by what the firmware sees without it: a timer, and a painted stack.

use anyhow::{bail, Result};

use super::measure::{Firmware, Region, PLAIN};
use crate::toolchain::Toolchain;

/// An instruction takes 2¹⁰ ns of the machine's time.
pub const ICOUNT: [&str; 2] = ["-icount", "shift=10"];
/// SysTick of the mps2 boards runs at 25 MHz.
const TICKS: f64 = 1.024 * 25.0;
/// It has 24 bits; longer work is compared modulo their range.
const RANGE: f64 = (1 << 24) as f64;
/// Half an instruction: a tick is a twenty-fifth of one, so the timer tells instructions apart, and both counts have to be
/// the same whole number.
const TOLERANCE: f64 = TICKS / 2.0;

/// Runs a firmware again without the plugin; every piece of work has to take as many instructions by the timer.
pub fn timed(toolchain: &Toolchain, regions: &[Region]) -> Result<()> {
    let firmware: Firmware = PLAIN;
    let wrong = disagreements(regions, &firmware.timed(toolchain)?);
    if !wrong.is_empty() {
        bail!("the plugin and the timer disagree:\n{}", wrong.join("\n"));
    }
    Ok(())
}

/// The first region is empty: what the timer counts of it is what reading the timer takes.
fn disagreements(regions: &[Region], ticks: &[u64]) -> Vec<String> {
    if ticks.len() != regions.len() {
        let (counted, timed) = (regions.len(), ticks.len());
        return vec![format!("{counted} pieces of work counted, {timed} timed")];
    }
    let empty = ticks.first().copied().unwrap_or(0) as f64;
    let mut wrong = Vec::new();
    for (region, &ticks) in regions.iter().zip(ticks) {
        let apart = ticks as f64 - empty - region.instructions as f64 * TICKS;
        let apart = (apart + RANGE / 2.0).rem_euclid(RANGE) - RANGE / 2.0;
        if apart.abs() > TOLERANCE {
            wrong.push(format!(
                "{}: {} instructions by the plugin, {:+.1} more by the timer",
                region.work,
                region.instructions,
                apart / TICKS
            ));
        }
    }
    wrong
}

/// Both see what is written, not what is reserved, so they differ by less than the word that is painted at a time. The
/// smallest depth that paint can show is the word that the marker itself pushes.
pub fn painted(regions: &[Region]) -> Result<()> {
    for region in regions {
        let stack = region.stack_bytes.max(4).next_multiple_of(4);
        if region.painted != stack {
            bail!(
                "{}: {} bytes of stack by the plugin, {} by painting",
                region.work,
                region.stack_bytes,
                region.painted
            );
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(instructions: u64, stack_bytes: u64, painted: u64) -> Region {
        Region {
            work: String::new(),
            scalar: String::new(),
            instructions,
            stack_bytes,
            painted,
        }
    }

    #[test]
    fn one_instruction_is_a_disagreement_and_a_wrapped_timer_is_none() {
        let long = 10_820_757;
        let regions = [region(0, 0, 4), region(103, 0, 4), region(long, 0, 4)];
        let ticks = |more: u64| {
            let wrapped = (307.0 + (long + more) as f64 * TICKS).rem_euclid(RANGE);
            [307, 307 + 2637, wrapped.round() as u64]
        };
        assert!(disagreements(&regions, &ticks(0)).is_empty());
        assert_eq!(disagreements(&regions, &ticks(1)).len(), 1);
        assert_eq!(
            disagreements(&regions, &[307, 307 + 2637 + 26, ticks(0)[2]]).len(),
            1
        );
        assert_eq!(disagreements(&regions, &[307]).len(), 1);
    }

    #[test]
    fn a_word_is_a_disagreement() {
        assert!(painted(&[region(0, 0, 4), region(0, 64, 64), region(0, 61, 64)]).is_ok());
        assert!(painted(&[region(0, 64, 60)]).is_err());
        assert!(painted(&[region(0, 64, 68)]).is_err());
    }
}
