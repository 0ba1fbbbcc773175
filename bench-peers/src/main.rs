//! Other filters beside ours on the same work. On the host: what each says after a minute. On a Cortex-M4F in QEMU:
//! what a sample and an update cost. `cargo xtask peers` runs both and writes the table.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "../../examples/firmware/mod.rs"]
mod firmware;
mod fusion;
mod kinavis;
mod linear;
mod ours;
mod scenario;
#[cfg(target_os = "none")]
mod target;
#[cfg(target_os = "none")]
use target::run;

use core::fmt::Write;

use scenario::{gravity, heading_deg, sample, time, Peer, PITCH_DEG, ROLL_DEG, SAMPLES, UPDATE};

/// Calls `$m!(type)` for every peer.
macro_rules! each_peer {
    ($m:ident) => {
        $m!(ours::EverySample);
        $m!(ours::TenHertz);
        $m!(fusion::Fusion);
        $m!(kinavis::Kinavis);
        $m!(linear::Dense);
        $m!(linear::Mini);
        $m!(linear::Ads);
        $m!(linear::Kfilter);
    };
}
#[allow(unused_imports)] // one of the two machines does not need it
use each_peer;

/// Runs a peer for so many samples; None when it refuses one.
fn drive<P: Peer>(samples: u32) -> Option<P> {
    let mut peer = P::start()?;
    let g = gravity();
    for k in 0..samples {
        if !peer.predict(&sample(k, g)) || ((k + 1) % UPDATE == 0 && !peer.update(k + 1)) {
            return None;
        }
    }
    Some(peer)
}

/// `result`, name, velocity variance, heading error, tilt error.
#[cfg_attr(target_os = "none", allow(dead_code))]
fn result<P: Peer>(out: &mut impl Write) -> core::fmt::Result {
    let Some(peer) = drive::<P>(SAMPLES) else {
        return writeln!(out, "result\t{}\trefused\t\t", P::NAME);
    };
    write!(out, "result\t{}\t{:e}", P::NAME, peer.velocity_variance())?;
    match peer.attitude_deg() {
        Some([heading, pitch, roll]) => {
            let e = heading - heading_deg(time(SAMPLES));
            let turns = libm::round(e / 360.0);
            let tilt = libm::hypot(pitch - PITCH_DEG, roll - ROLL_DEG);
            writeln!(out, "\t{}\t{}", e - 360.0 * turns, tilt)
        }
        None => writeln!(out, "\t\t"),
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    let mut text = String::new();
    macro_rules! one {
        ($peer:ty) => {
            result::<$peer>(&mut text).expect("a String takes all")
        };
    }
    each_peer!(one);
    print!("{text}");
}
