//! A vehicle tracked by satellite fixes alone: it drives north at 5 m/s, accelerates east by 1 m/s² from 20 s to 30 s,
//! and is without fixes from 40 s to 50 s.
//!
//! Prints time, estimate and σ of east, and how much was learnt of it (ξ2). What to see: σ of velocity falls to its
//! 0.1 m/s at once, σ of position slowly; both grow in the outage, and ξ2 says so. Host and Cortex-M4F print the same
//! bits.
#![cfg_attr(target_os = "none", no_std, no_main)]

use navsight::observability::diagonal::xi2;
use navsight::tracking::{CurrentModel, Fix, Kinematics, Limits, LocalTracker, Reading, Settings};

fn run(out: &mut impl core::fmt::Write) -> core::fmt::Result {
    let start = Kinematics {
        position: [0.0; 3],
        velocity: [0.0; 3],
        acceleration: [0.0; 3],
    };
    let sigma = Kinematics {
        position: [20.0; 3],
        velocity: [10.0; 3],
        acceleration: [1.0; 3],
    };
    let settings = Settings::new(CurrentModel::current(20.0, Limits::new(3.0, -3.0)));
    let Ok(mut tracker) = LocalTracker::<f32>::new(&start, &sigma, settings) else {
        return writeln!(out, "the settings were refused");
    };
    writeln!(
        out,
        "  t  east     sigma    v_east   sigma    xi2      xi2 of v_east"
    )?;
    // what a receiver would report, with an error of 3 m and 0.05 m/s that changes its sign every second
    let (mut east, mut speed, mut sign) = (0.0, 0.0, 1.0);
    for t in 1..=60_u16 {
        let (dt, acceleration) = (1.0, if (21..=30).contains(&t) { 1.0 } else { 0.0 });
        east += speed * dt + 0.5 * acceleration;
        speed += acceleration * dt;
        sign = -sign;
        let outage = (41..=50).contains(&t);
        let position = [east + 3.0 * sign, 5.0 * f32::from(t), 0.0];
        let velocity = [speed + 0.05 * sign, 5.0, 0.0];
        let fix = Fix {
            position: (!outage).then(|| Reading::new(position, 5.0)),
            velocity: (!outage).then(|| Reading::new(velocity, 0.1)),
        };
        let done = tracker.predict(dt).and_then(|()| tracker.update(&fix));
        let learnt = done.and_then(|report| xi2(&report.p_after, LocalTracker::<f32>::NORMALISED));
        let Ok(learnt) = learnt else {
            return writeln!(out, "{t:>3} refused: {}", done.is_err());
        };
        if t % 5 == 0 {
            let (x, s) = (tracker.state(), tracker.sigma());
            write!(out, "{t:>3}")?;
            let numbers = [
                x.position[0],
                s.position[0],
                x.velocity[0],
                s.velocity[0],
                learnt.get(0).unwrap_or(0.0),
                learnt.get(3).unwrap_or(0.0),
            ];
            for x in numbers {
                write!(out, " {x:8.2}")?;
            }
            writeln!(out)?;
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
