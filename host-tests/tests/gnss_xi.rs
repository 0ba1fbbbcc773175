//! What straight flight, a change of speed and a turn teach, in ξ, and what velocities add to positions: the claim of
//! Fang 1998 (velocities raise the degree of observability) in the measure of Lu 2009, for the 15-state filter.

use host_tests::sim::{Patrol, Sensor, SensorErrors, Simulator, DEG};
use nalgebra::Vector3;
use navsight::attitude::RfuToEnu;
use navsight::earth::Geodetic;
use navsight::error_model::{ATT, BA, BG, N, POS, VEL};
use navsight::filter::{Filter, Prior, UpdateReport};
use navsight::measurement::{Position, Velocity};
use navsight::nav::NavState;
use navsight::observability::diagonal::{xi1, Xi};
use navsight::observability::verdict::{Limits, Verdict, Verdicts};

const DT: f64 = 0.01;

/// One second: ξ1 of the second's updates and ξ2 after them.
struct Second {
    xi1: [f32; N],
    xi2: [f32; N],
    heading: Verdict,
}

/// Two rounds of the patrol with a fix a second. P hardly depends on the noise that was drawn; the verdicts do look at it.
fn fly(with_velocity: bool, turn_deg: f64) -> Vec<Second> {
    let patrol = Patrol {
        start: Geodetic::from_degrees(48.0, 9.0, 500.0),
        speed: 40.0,
        faster: 15.0,
        heading: 0.4,
        turn: turn_deg * DEG,
    };
    let mut simulator = Simulator::new(patrol, DT);
    let truth = simulator.truth();
    let q = truth.q;
    let nav = NavState::new(
        patrol.start,
        truth.v_n.cast::<f32>(),
        RfuToEnu([q.w, q.i, q.j, q.k].map(|x| x as f32)),
    )
    .unwrap();
    let rad = DEG as f32;
    let prior = Prior {
        position: [3.0; 3],
        velocity: [0.3; 3],
        attitude: [0.5 * rad, 0.5 * rad, 5.0 * rad],
        gyro_bias: [10.0 * rad / 3600.0; 3],
        accel_bias: [0.03; 3],
    };
    let noise = SensorErrors::TACTICAL;
    let settings = noise.settings();
    let mut filter = Filter::new(nav, &prior, settings).unwrap();
    let mut required = [None; N];
    required[ATT + 2] = Some(0.5 * rad);
    let mut verdicts = Verdicts::new(filter.sigma0(), &required, Limits::DEFAULT).unwrap();
    let mut sensor = Sensor::new(noise, 1);
    let mut seconds = Vec::new();
    for _ in 0..200 {
        let mut truth = truth;
        for _ in 0..100 {
            let (now, ideal) = simulator.next().unwrap();
            filter.propagate(&sensor.sample(&ideal)).unwrap();
            truth = now;
        }
        let e = sensor.normal() * 2.0;
        let local = filter.nav().local();
        let at = Geodetic {
            lat: truth.lat + e.y / f64::from(local.r_m),
            lon: truth.lon + e.x / f64::from(local.r_n * local.cos_lat),
            height: truth.height + e.z,
        };
        let mut reports: Vec<UpdateReport<3>> = Vec::new();
        let r = Position::new(at, Vector3::repeat(2.0), 1.0).unwrap();
        reports.push(filter.update(&r.linearize(filter.nav())).unwrap());
        if with_velocity {
            let v = (truth.v_n + sensor.normal() * 0.1).cast::<f32>();
            let v = Velocity::new(v, Vector3::repeat(0.1), 1.0).unwrap();
            reports.push(filter.update(&v.linearize(filter.nav())).unwrap());
        }
        let mut decrease = [0.0; N];
        for report in &reports {
            verdicts.take(filter.time(), report);
            for (sum, d) in decrease.iter_mut().zip(&report.decrease) {
                *sum += d;
            }
        }
        let last = reports.last().unwrap();
        let rate = xi1(&decrease, 1.0, u32::MAX).unwrap();
        let xi = Xi::of(last).unwrap();
        seconds.push(Second {
            xi1: std::array::from_fn(|i| rate.get(i).unwrap()),
            xi2: std::array::from_fn(|i| xi.xi2.get(i).unwrap()),
            heading: verdicts.of(ATT + 2).unwrap().verdict,
        });
    }
    seconds
}

/// Mean ξ1 of a state over some seconds.
fn speed(seconds: &[Second], state: usize, from: usize, to: usize) -> f32 {
    seconds[from..to].iter().map(|s| s.xi1[state]).sum::<f32>() / (to - from) as f32
}

#[test]
fn each_leg_teaches_what_it_can() {
    let f = fly(true, 100.0);
    let heading = ATT + 2;
    for t in [29, 49, 59, 69, 79, 89, 149, 199] {
        let x = &f[t].xi2;
        println!(
            "{:4} s  ξ2: r {:.0} v {:.0} level {:.0} heading {:.2} gyro up {:.3} accel right {:.2}  {:?}",
            t + 1, x[POS], x[VEL], x[ATT], x[heading], x[BG + 2], x[BA], f[t].heading
        );
    }
    // Straight and level: heading is not seen, while position, velocity and level are.
    let straight = &f[29].xi2;
    assert!(straight[heading] < 1.1 && straight[VEL] > 10.0 && straight[ATT] > 2.0);
    // The turn: its centripetal acceleration points along the heading error; ξ1 rises by a factor, ξ2 by a hundred.
    let (before, turn) = (speed(&f, heading, 20, 30), speed(&f, heading, 32, 40));
    assert!(turn > 20.0 * before, "{turn} {before}");
    assert!(f[49].xi2[heading] > 100.0 * straight[heading]);
    // Straight again: nothing more comes in.
    let after = speed(&f, heading, 51, 60);
    assert!(after < 1e-2 * turn, "{after} {turn}");
    // The next turn teaches again; in between, the noise of the gyros takes.
    let (quiet, busy) = (speed(&f, heading, 121, 130), speed(&f, heading, 130, 150));
    println!("ξ1 of heading {quiet:.1e} before the second turn, {busy:.1e} in it");
    assert!(busy > 2.0 * quiet, "{quiet} {busy}");
    assert!(f[149].xi2[heading] > 1.5 * f[129].xi2[heading]);
    // The verdict follows: not settled before the turn, settled after it.
    assert_ne!(f[29].heading, Verdict::Settled);
    assert_eq!(f[59].heading, Verdict::Settled);
}

#[test]
fn a_change_of_speed_teaches_heading_too() {
    // The same patrol straight on: nothing until it speeds up at 60 s, and heading is found in those ten seconds.
    let f = fly(true, 0.0);
    let at = |t: usize| f[t - 1].xi2[ATT + 2];
    println!(
        "ξ2 of heading: {:.2} {:.2} {:.1} {:.1}",
        at(30),
        at(60),
        at(70),
        at(90)
    );
    assert!(at(60) < 1.5 && at(70) > 50.0 * at(60) && at(90) > at(70));
    let (before, faster) = (speed(&f, ATT + 2, 40, 60), speed(&f, ATT + 2, 61, 69));
    assert!(faster > 10.0 * before, "{faster} {before}");
}

#[test]
fn velocities_raise_the_degree_of_observability() {
    let (alone, both) = (fly(false, 100.0), fly(true, 100.0));
    let (a, b) = (&alone[199].xi2, &both[199].xi2);
    println!("state: positions alone, with velocities");
    for i in 0..N {
        println!("{i:2}: {:12.3} {:12.3}", a[i], b[i]);
        // More measurements never leave less known; f32 rounding of what both know equally.
        assert!(b[i] > 0.999 * a[i], "{i}");
    }
    // The level velocities gain a factor of three, what lies behind them more than two, heading nearly four; the vertical
    // channel is held by gravity and gains least.
    for i in [VEL, VEL + 1, ATT + 2] {
        assert!(b[i] > 2.5 * a[i], "{i}: {} {}", b[i], a[i]);
    }
    for i in [POS, VEL + 2, ATT, ATT + 1, BG + 1] {
        assert!(b[i] > 1.3 * a[i], "{i}: {} {}", b[i], a[i]);
    }
    // After the first turn heading is better seen by a factor.
    let (a, b) = (alone[49].xi2[ATT + 2], both[49].xi2[ATT + 2]);
    println!("heading after the first turn: {a:.1} {b:.1}");
    assert!(b > 3.0 * a);
}
