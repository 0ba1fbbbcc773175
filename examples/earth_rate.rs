//! The earth under a vehicle at a few latitudes: radii of curvature, gravity, earth rate, transport rate.
//!
//! Prints bit patterns: the host and a Cortex-M4F agree in every bit.
#![cfg_attr(target_os = "none", no_std, no_main)]

use nalgebra::Vector3;
use navsight::earth::Local;

fn run(out: &mut impl core::fmt::Write) -> core::fmt::Result {
    let v_n = Vector3::new(200.0, -30.0, 1.0);
    for lat_deg in [-80, -45, 0, 30, 60, 80] {
        let local = Local::at((lat_deg as f32).to_radians(), 1000.0);
        write!(out, "{lat_deg:>3}")?;
        let (ie, en) = (local.omega_ie_n(), local.omega_en_n(&v_n));
        for x in [
            local.r_m,
            local.r_n,
            local.gravity,
            ie.y,
            ie.z,
            en.x,
            en.y,
            en.z,
        ] {
            write!(out, " {:08x}", x.to_bits())?;
        }
        writeln!(out)?;
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
