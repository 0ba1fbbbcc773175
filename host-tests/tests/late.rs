//! Measurements that arrive late, gates and resets: the memory of the filter gives the state of a past time as it is
//! known now, a late fix does what it would have done in time, and a source that is refused for too long wins.

use host_tests::sim::{ClimbingTurns, Sensor, SensorErrors, Simulator, Truth, DEG};
use nalgebra::{SVector, Vector3};
use navsight::attitude::RfuToEnu;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{N, POS};
use navsight::filter::{Filter, Gate, Handling, LateFilter, Prior, Source, States};
use navsight::measurement::{Position, Velocity};
use navsight::nav::NavState;

const DT: f64 = 0.01;

fn motion() -> ClimbingTurns {
    ClimbingTurns {
        start: Geodetic::from_degrees(-35.0, 20.0, 1000.0),
        speed: 60.0,
        heading: 1.0,
        turn_rate: 6.0 * DEG,
        climb: 2.0 * DEG,
    }
}

fn filter(truth: &Truth, noise: &SensorErrors) -> Filter {
    let q = truth.q;
    let at = Geodetic {
        lat: truth.lat,
        lon: truth.lon,
        height: truth.height,
    };
    let nav = NavState::new(
        at,
        truth.v_n.cast::<f32>(),
        RfuToEnu([q.w, q.i, q.j, q.k].map(|x| x as f32)),
    )
    .unwrap();
    let prior = Prior {
        position: [2.0; 3],
        velocity: [0.2; 3],
        attitude: [0.01, 0.01, 0.03],
        gyro_bias: [1e-4; 3],
        accel_bias: [0.02; 3],
    };
    let settings = noise.settings();
    Filter::new(nav, &prior, settings).unwrap()
}

fn place(truth: &Truth) -> Geodetic {
    Geodetic {
        lat: truth.lat,
        lon: truth.lon,
        height: truth.height,
    }
}

fn open() -> Source {
    Source::new(Gate::OPEN).unwrap()
}

#[test]
fn the_past_is_what_was_there() {
    // Perfect samples: every remembered state is the truth of its time, between entries too; and after a correction it
    // is corrected the way the present was.
    for spacing in [0.0f32, 0.05] {
        let mut simulator = Simulator::new(motion(), DT);
        let mut ideal = Sensor::new(SensorErrors::NONE, 1);
        let noise = SensorErrors::TACTICAL;
        let mut late = LateFilter::<32>::new(filter(&simulator.truth(), &noise), spacing).unwrap();
        let mut truths = Vec::new();
        for _ in 0..2000 {
            let (truth, sample) = simulator.next().unwrap();
            late.propagate(&ideal.sample(&sample)).unwrap();
            truths.push(truth);
        }
        for back in [0usize, 3, 17, 25] {
            for part in [0.0, 0.3] {
                let truth = &truths[2000 - 1 - back];
                let before = &truths[2000 - 2 - back];
                let t = truth.time - part * DT;
                let there = late.state_at(t).unwrap();
                let v = truth.v_n * (1.0 - part) + before.v_n * part;
                let e = (there.v_n().cast() - v).norm();
                // Centimetres a second from 20 s of f32 steps; a jerk of 60 m/s · (0.2 rad/s)² over 0.05 s, squared, eighth.
                assert!(e < 5e-3, "velocity {back} {part}: {e}");
                let mut at = place(truth);
                at.lat = at.lat * (1.0 - part) + before.lat * part;
                at.lon = at.lon * (1.0 - part) + before.lon * part;
                at.height = at.height * (1.0 - part) + before.height * part;
                let d = there.displacement_to(&at).unwrap().norm();
                assert!(d < 0.05, "position {back} {part}: {d}"); // 60 m/s · 3 ms would be 0.18
                let q = truth.q.slerp(&before.q, part);
                let m = there.c_b_n().cast::<f64>() * q.to_rotation_matrix().matrix().transpose();
                let turned = (m - nalgebra::Matrix3::identity()).amax();
                // 0.2 rad/s · 3 ms would be 6e-4
                assert!(turned < 6e-5, "attitude {back} {part}: {turned}");
            }
        }
        // One correction by a fix that is far off, then the same of the past.
        let now = late.filter().time();
        let (past, present) = (late.state_at(now - 0.2).unwrap(), *late.filter().nav());
        let off = Vector3::new(0.5, -0.3, 0.2) + present.v_n();
        let z = Velocity::new(off, Vector3::repeat(0.05), 1.0).unwrap();
        late.update(&mut open(), now, |nav| z.linearize(nav))
            .unwrap();
        let moved = late.filter().nav().v_n() - present.v_n();
        let moved_then = late.state_at(now - 0.2).unwrap().v_n() - past.v_n();
        assert!(moved.norm() > 0.3);
        // What ψ and b_a did to the velocity in 0.2 s, f × ψ: at most 2 m/s · 0.02 rad.
        assert!((moved - moved_then).norm() < 0.05, "{moved} {moved_then}");
    }
}

#[test]
fn between_two_entries_the_motion_is_even() {
    // Entries half a second apart, in a banked turn: the state between them against the filter's own of that time.
    let mut simulator = Simulator::new(motion(), DT);
    let mut ideal = Sensor::new(SensorErrors::NONE, 1);
    let start = filter(&simulator.truth(), &SensorErrors::TACTICAL);
    let mut late = LateFilter::<4>::new(start, 0.5).unwrap();
    let mut own = Vec::new();
    for _ in 0..3020 {
        let (_, sample) = simulator.next().unwrap();
        late.propagate(&ideal.sample(&sample)).unwrap();
        own.push((late.filter().time(), *late.filter().nav()));
    }
    for (time, then) in own.iter().rev().skip(1).take(150) {
        let there = late.state_at(*time).unwrap();
        // a = 60 m/s · 0.21 rad/s in a turn of 0.21 rad/s that grows by 0.02 rad/s²: a jerk of 2.6 m/s³ over 0.5 s, T²/8 of
        // it in velocity, twice that where the turn changes too, and T³/16 in position
        let v = (there.v_n() - then.v_n()).norm();
        let d = there.displacement_to(&then.position()).unwrap().norm();
        let turned =
            (there.c_b_n() * then.c_b_n().transpose() - nalgebra::Matrix3::identity()).amax();
        // The wrong sign of any part of the way: velocity 3 m/s, position 0.3 m, attitude 0.05 rad.
        assert!(
            v < 0.16 && d < 0.06 && turned < 2e-3,
            "{time}: {v} {d} {turned}"
        );
    }
}

#[test]
fn too_late_and_too_early_are_told_apart() {
    let mut simulator = Simulator::new(motion(), DT);
    let mut sensor = Sensor::new(SensorErrors::TACTICAL, 1);
    let start = filter(&simulator.truth(), &SensorErrors::TACTICAL);
    let mut none = LateFilter::<0>::new(start.clone(), 0.0).unwrap();
    let mut some = LateFilter::<8>::new(start.clone(), 0.0).unwrap();
    for _ in 0..100 {
        let sample = sensor.sample(&simulator.next().unwrap().1);
        none.propagate(&sample).unwrap();
        some.propagate(&sample).unwrap();
    }
    let z = Velocity::new(Vector3::zeros(), Vector3::repeat(1.0), 1.0).unwrap();
    let mut source = open();
    let now = some.filter().time();
    let before = some.filter().clone();
    let mut at = |t: f64| {
        some.update(&mut source, t, |nav| z.linearize(nav))
            .map(|_| ())
    };
    assert_eq!(at(now - 0.085), Err(Error::Late));
    assert_eq!(at(now + 0.1), Err(Error::Time));
    assert_eq!(at(f64::NAN), Err(Error::NonFinite));
    // A refused call leaves the filter bit for bit as it was, and the record of the source too.
    assert_eq!((some.filter(), source), (&before, open()));
    assert_eq!(
        some.update(&mut source, now - 0.065, |nav| z.linearize(nav))
            .map(|a| a.handling),
        Ok(Handling::Used)
    );
    assert_eq!(
        none.update(&mut source, now - 0.01, |nav| z.linearize(nav))
            .map(|_| ()),
        Err(Error::Late)
    );
    assert!(none
        .update(&mut source, now, |nav| z.linearize(nav))
        .is_ok());
    assert!(LateFilter::<4>::new(start.clone(), f32::NAN).is_err());
    assert!(LateFilter::<4>::new(start, 1.0).is_err());
    assert!(core::mem::size_of::<LateFilter<0>>() < core::mem::size_of::<Filter>() + 128);
}

/// Root mean square of velocity [m/s], position [m] and attitude [rad] errors in the last 100 s of 200, over seeds, and
/// their mean square over the filter's own variance.
fn flown(delay: f64, told: f64, noise: SensorErrors, seeds: u64) -> ([f64; 3], [f64; 3]) {
    let (mut square, mut normalised, mut count) = ([0.0; 3], [0.0; 3], 0.0);
    for seed in 0..seeds {
        let mut sensor = Sensor::new(noise, 900 + seed);
        let mut simulator = Simulator::new(motion(), DT);
        let start = filter(&simulator.truth(), &noise);
        let mut late = LateFilter::<32>::new(start, 0.02).unwrap();
        let (mut positions, mut velocities) = (open(), open());
        let mut waiting = Vec::new();
        for k in 1..=20_000 {
            let (truth, ideal) = simulator.next().unwrap();
            late.propagate(&sensor.sample(&ideal)).unwrap();
            if k % 20 == 0 {
                let v = truth.v_n.cast::<f32>() + sensor.normal().cast() * 0.1;
                let local = late.filter().nav().local();
                let e = sensor.normal() * 1.0;
                let at = Geodetic {
                    lat: truth.lat + e.y / f64::from(local.r_m),
                    lon: truth.lon + e.x / f64::from(local.r_n * local.cos_lat),
                    height: truth.height + e.z,
                };
                waiting.push((truth.time, v, at));
            }
            if waiting
                .first()
                .is_some_and(|(t, _, _)| truth.time >= t + delay - 1e-6)
            {
                let (t, v, at) = waiting.remove(0);
                let time = t + delay - told;
                let z = Velocity::new(v, Vector3::repeat(0.1), 0.2).unwrap();
                late.update(&mut velocities, time, |nav| z.linearize(nav))
                    .unwrap();
                let z = Position::new(at, Vector3::repeat(1.0), 0.2).unwrap();
                late.update(&mut positions, time, |nav| z.linearize(nav))
                    .unwrap();
            }
            if k >= 10_000 && k % 20 == 11 {
                late.synchronize();
                let filter = late.filter();
                let nav = filter.nav();
                let c: nalgebra::Matrix3<f64> = nav.c_b_n().cast();
                let m = c * truth.q.to_rotation_matrix().matrix().transpose();
                let psi = Vector3::new(m.m23 - m.m32, m.m31 - m.m13, m.m12 - m.m21) * 0.5;
                let v = nav.v_n().cast::<f64>() - truth.v_n;
                let r = nav.displacement_to(&place(&truth)).unwrap().cast::<f64>();
                for (g, (e, first)) in [(v, 3), (r, 0), (psi, 6)].iter().enumerate() {
                    square[g] += e.norm_squared();
                    for i in 0..3 {
                        let sigma = f64::from(filter.sigma(first + i).unwrap());
                        normalised[g] += e[i] * e[i] / sigma / sigma / 3.0;
                    }
                }
                count += 1.0;
            }
        }
    }
    (
        square.map(|s: f64| (s / count).sqrt()),
        normalised.map(|s: f64| s / count),
    )
}

#[test]
fn a_late_fix_is_as_good_as_one_in_time() {
    // 0.2 s late, and the same noise: nothing but the latest fifth of a second may be missing. Ignored, it is 12 m.
    let noise = SensorErrors::TACTICAL;
    let (in_time, _) = flown(0.0, 0.0, noise, 4);
    let (late, _) = flown(0.2, 0.2, noise, 4);
    let (ignored, _) = flown(0.2, 0.0, noise, 1);
    println!("velocity, position, attitude: {in_time:.5?} in time, {late:.5?} late, {ignored:.4?} ignored");
    for (a, b) in in_time.iter().zip(&late) {
        assert!(b < &(1.1 * a), "{late:?} {in_time:?}");
    }
    assert!(ignored[1] > 5.0 * in_time[1]);
}

#[test]
fn a_noisy_sensor_does_not_make_a_late_fix_boast() {
    // Every error over its σ, squared: 1 is honest. Without the wider row of a late measurement the velocity has 1.6; with
    // it the position is a quarter too careful, 0.73, because less is taken from the velocities. Scatter of 16 seeds: 0.1.
    // The noise of a quadrotor's accelerometer under its propellers, 0.1 m/s²/√Hz: a quarter of the velocity's own noise
    // gathers within the delay.
    let noise = SensorErrors {
        arw: 3e-3,
        vrw: 0.1,
        ..SensorErrors::NONE
    };
    let (_, in_time) = flown(0.0, 0.0, noise, 16);
    let (_, late) = flown(0.3, 0.3, noise, 16);
    println!("normalised, velocity, position, attitude: {in_time:.3?} in time, {late:.3?} late");
    for x in in_time.iter().chain(&late) {
        assert!((0.6..1.2).contains(x), "{in_time:?} {late:?}");
    }
}

#[test]
fn a_source_refused_for_too_long_resets_the_filter_and_says_so() {
    let mut simulator = Simulator::new(motion(), DT);
    let mut sensor = Sensor::new(SensorErrors::TACTICAL, 5);
    let start = filter(&simulator.truth(), &SensorErrors::TACTICAL);
    let mut late = LateFilter::<32>::new(start, 0.0).unwrap();
    let gate = |lock_out| {
        Source::new(Gate {
            limit: Some(16.0),
            lock_out,
        })
        .unwrap()
    };
    let mut positions = gate(Some((2.9, States::POSITION)));
    let mut deaf = gate(None);
    let (mut handled, mut history) = (Vec::new(), Vec::new());
    for k in 1..=3000 {
        let (truth, ideal) = simulator.next().unwrap();
        late.propagate(&sensor.sample(&ideal)).unwrap();
        history.push(truth);
        if k % 100 == 0 {
            // 0.1 s old; after 10 s the receiver is somewhere else for good, 300 m to the north
            let t = &history[k - 11];
            let mut at = place(t);
            at.lat += if k > 1000 { 300.0 / 6.37e6 } else { 0.0 };
            let z = Position::new(at, Vector3::repeat(1.0), 1.0).unwrap();
            let refused = deaf;
            let mut probe = late.clone();
            let alone = probe
                .update(&mut deaf, t.time, |nav| z.linearize(nav))
                .unwrap();
            let done = late
                .update(&mut positions, t.time, |nav| z.linearize(nav))
                .unwrap();
            if k > 1300 {
                assert!(refused.refused() > 0);
            }
            handled.push((k / 100, done.handling, alone.handling));
            assert!((done.age - 0.1).abs() < 1e-3);
        }
    }
    // seconds 11, 12 and 13: one row of three beyond the gate; at 14 s the lock-out of 2.9 s is over
    for (second, handling, _) in &handled {
        let expected = match second {
            11..=13 => Handling::Partly,
            14 => Handling::Reset,
            _ => Handling::Used,
        };
        assert_eq!((second, handling), (second, &expected));
    }
    assert_eq!((positions.resets(), positions.refused()), (1, 3));
    assert_eq!((positions.refused_in_a_row(), positions.used()), (0, 27));
    assert_eq!(deaf.resets(), 0);
    let truth = history.last().unwrap();
    let d = late.filter().nav().displacement_to(&place(truth)).unwrap();
    assert!((d.y + 300.0).abs() < 3.0, "{d}");
    assert!(late.filter().sigma(POS + 1).unwrap() < 1.0);
}

#[test]
fn after_a_reset_the_filter_is_where_the_measurement_says() {
    let mut simulator = Simulator::new(motion(), DT);
    let truth = simulator.truth();
    let mut sensor = Sensor::new(SensorErrors::TACTICAL, 6);
    let mut late = LateFilter::<8>::new(filter(&truth, &SensorErrors::TACTICAL), 0.0).unwrap();
    let mut source = Source::new(Gate {
        limit: Some(16.0),
        lock_out: Some((0.0, States::POSITION)),
    })
    .unwrap();
    // 3 m to the east, within the gate, and 300 m to the north, beyond it: the second time it is due
    for wanted in [Handling::Partly, Handling::Reset] {
        let (truth, ideal) = simulator.next().unwrap();
        late.propagate(&sensor.sample(&ideal)).unwrap();
        let mut at = place(&truth);
        at.lat += 300.0 / 6.37e6;
        at.lon += 3.0 / 6.37e6 / at.lat.cos();
        let z = Position::new(at, Vector3::repeat(1.0), 1.0).unwrap();
        let now = late.filter().time();
        let done = late.update(&mut source, now, |nav| z.linearize(nav));
        assert_eq!(done.unwrap().handling, wanted);
        if wanted == Handling::Reset {
            // East was used twice, before the opening and after it: what the first time had moved is off the second. 3 km
            // of σ against 1 m; twice that move would be 0.5 m.
            let d = late.filter().nav().displacement_to(&at).unwrap();
            assert!(d.amax() < 0.02, "{d}");
        }
    }
}

#[test]
fn opening_forgets_and_nothing_else() {
    let simulator = Simulator::new(motion(), DT);
    let mut f = filter(&simulator.truth(), &SensorErrors::TACTICAL);
    let z = Velocity::new(Vector3::zeros(), Vector3::repeat(0.1), 1.0).unwrap();
    f.update(&z.linearize(f.nav())).unwrap();
    let before: SVector<f32, N> = SVector::from_fn(|i, _| f.sigma(i).unwrap());
    f.open(States::HEIGHT, 50.0).unwrap();
    f.open(States::VELOCITY, 1e-6).unwrap();
    for i in 0..N {
        let expected = if i == POS + 2 { 50.0 } else { before[i] };
        assert!((f.sigma(i).unwrap() / expected - 1.0).abs() < 1e-6, "{i}");
    }
    assert_eq!(f.open(States::VELOCITY, f32::NAN), Err(Error::NonFinite));
    assert_eq!(f.open(States::VELOCITY, -1.0), Err(Error::OutOfRange));
    for bad in [
        Gate {
            limit: Some(0.0),
            ..Gate::OPEN
        },
        Gate {
            limit: Some(f32::NAN),
            ..Gate::OPEN
        },
        Gate {
            lock_out: Some((-1.0, States::POSITION)),
            ..Gate::OPEN
        },
    ] {
        assert!(Source::new(bad).is_err());
    }
}
