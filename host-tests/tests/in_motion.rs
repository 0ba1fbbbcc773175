//! Attitude found in motion on a simulated flight whose truth is known: heading of a banked, climbing, turning vehicle
//! from velocities that come late, and the filter that starts from it. A wrong sign or a wrong delay fails here.

use host_tests::flight::{Aids, Flight, Setup};
use host_tests::input::gnss::Fix;
use host_tests::input::ImuSample;
use host_tests::sim::{ClimbingTurns, Ideal, Sensor, SensorErrors, Simulator, Truth, DEG};
use nalgebra::{Matrix3, Vector3};
use navsight::alignment::in_motion::InMotion;
use navsight::attitude::Euler;
use navsight::earth::{normal_gravity, Geodetic};
use navsight::error::Error;
use navsight::error_model::NoiseDensity;
use navsight::filter::{Handling, Settings};
use navsight::imu::ImuLimits;
use navsight::measurement::Antenna;

const DT: f64 = 0.02;
/// Of the receiver [s].
const LATE: f64 = 0.25;
/// From the IMU to the antenna, right-forward-up [m].
const LEVER: Vector3<f64> = Vector3::new(0.7, 2.5, -1.3);

/// A turn of 24°/s at most, half a radian of bank.
fn motion() -> ClimbingTurns {
    ClimbingTurns {
        start: Geodetic::from_degrees(-35.0, 20.0, 1000.0),
        speed: 25.0,
        heading: 2.0,
        turn_rate: 12.0 * DEG,
        climb: 4.0 * DEG,
    }
}

fn flown(seconds: f64) -> Vec<(Truth, Ideal)> {
    let steps = (seconds / DT) as usize;
    Simulator::new(motion(), DT).take(steps).collect()
}

/// What a sensor that is mounted in another way feels.
fn turned(ideal: &Ideal, c_m_b: &Matrix3<f64>) -> Ideal {
    Ideal {
        delta_theta_b: c_m_b * ideal.delta_theta_b,
        delta_v_b: c_m_b * ideal.delta_v_b,
        ..*ideal
    }
}

/// Angles between two attitudes about east, north, up.
fn between(a: &Matrix3<f32>, truth: &Truth) -> Vector3<f64> {
    let m = a.cast::<f64>() * truth.q.to_rotation_matrix().matrix().transpose();
    Vector3::new(m.m32 - m.m23, m.m13 - m.m31, m.m21 - m.m12) * 0.5
}

/// The same vehicle with its sensor mounted in all ways: heading, pitch and roll of the vehicle in the axes of the sensor.
#[test]
fn attitude_from_velocities_is_the_truth() {
    let flight = flown(45.0);
    // Headings so close that a first guess on the wrong side is the opposite one for some of them, from which the last steps
    // do not come back.
    let around = (0..180u8).step_by(3).map(|h| (f32::from(h), 0.0, 0.0));
    let tilted = [(30.0, 70.0, 0.0), (0.0, 0.0, 180.0), (120.0, -50.0, 100.0)];
    for (heading, pitch, roll) in around.chain(tilted) {
        mounted(&flight, Euler::from_degrees(heading, pitch, roll));
    }
}

fn mounted(flight: &[(Truth, Ideal)], mount: Euler) {
    let c_m_b: Matrix3<f64> = mount.c_b_n().cast();
    let gravity = normal_gravity((-35f32).to_radians().sin(), 1000.0);
    let mut finder = InMotion::<64>::new(gravity, 0.9, ImuLimits::DEFAULT).unwrap();
    let mut ideal = Sensor::new(SensorErrors::NONE, 1);
    let (mut next, mut refused) = (0.5, 0);
    for (k, (truth, sample)) in flight.iter().enumerate() {
        finder.take(&ideal.sample(&turned(sample, &c_m_b))).unwrap();
        // once in 0.97 s, so between samples at every phase, and a quarter of a second ago
        if truth.time >= next + LATE {
            let before = &flight[..=k];
            let at = before.partition_point(|(t, _)| t.time <= next);
            let ((a, _), (b, _)) = (&before[at - 1], &before[at]);
            let share = (next - a.time) / DT;
            let v = a.v_n * (1.0 - share) + b.v_n * share;
            assert!(finder.velocity(next, v.cast::<f32>()).is_ok());
            refused += u32::from(finder.velocity(next - 2.0, v.cast::<f32>()) == Err(Error::Late));
            next += 0.97;
        }
    }
    assert!(refused > 40);
    let found = finder.solve(0.01).unwrap();
    let (truth, _) = flight.last().unwrap();
    let c_m_n = found.c_b_n * c_m_b.cast::<f32>();
    let e = between(&c_m_n, truth);
    // Left out are the turn of the earth, 15°/h · 60 s · half, 2e-3 rad, and that of the level frame with the vehicle;
    // velocities interpolated over 20 ms, 1e-4 m/s. Every wrong sign is a matter of radians.
    assert!(e.amax() < 4e-3, "{e}");
    // what the samples say since the last velocity
    assert!((f64::from(found.age) - (truth.time - (next - 0.97))).abs() < 1e-4);
    let at = flight.partition_point(|(t, _)| t.time <= next - 0.97);
    let since = truth.v_n - flight[at].0.v_n;
    // one sample of 10 m/s², and e of the gravity over a second
    let wrong = (found.delta_v_n.cast::<f64>() - since).norm();
    assert!(wrong < 0.3 && since.norm() > 2.0, "{wrong} {since}");
}

#[test]
fn straight_flight_has_no_heading() {
    let straight = ClimbingTurns {
        turn_rate: 0.0,
        climb: 0.0,
        ..motion()
    };
    let mut finder = InMotion::<64>::new(9.79, 0.9, ImuLimits::DEFAULT).unwrap();
    let mut sensor = Sensor::new(SensorErrors::TACTICAL, 1);
    for (k, (truth, sample)) in Simulator::new(straight, DT).take(1500).enumerate() {
        finder.take(&sensor.sample(&sample)).unwrap();
        if k % 50 == 49 {
            let v = truth.v_n + sensor.normal() * 0.1;
            finder.velocity(truth.time, v.cast::<f32>()).unwrap();
        }
    }
    // noise of 0.1 m/s against changes of nothing: half a radian at the least, if there is a solution at all
    let sigma = finder.solve(0.1).map_or(9.0, |found| found.sigma.z);
    assert!(sigma > 0.2, "{sigma}");
}

/// What a filter made of the flight.
struct Outcome {
    /// rms of the attitude about east, north, up from 60 s on [rad].
    attitude: Vector3<f64>,
    /// rms of the velocity from 60 s on [m/s].
    velocity: f64,
    /// Whether the first fix was within 5 σ of the filter, in all six rows.
    first: bool,
}

/// The whole of `lab replay --in-motion` on this flight.
fn replayed(told: Setup) -> Outcome {
    let flight = flown(120.0);
    let mut sensor = Sensor::new(SensorErrors::TACTICAL, 3);
    let arm = |k: usize| flight[k].0.q * LEVER;
    let mut fixes = Vec::new();
    for k in (10..flight.len() - 1).step_by(10) {
        let truth = &flight[k].0;
        let (r_m, r_n) = (6.352e6 + 1000.0, 6.385e6 + 1000.0);
        let e = arm(k) + sensor.normal();
        let v = truth.v_n + (arm(k + 1) - arm(k - 1)) / (2.0 * DT) + sensor.normal() * 0.05;
        fixes.push(Fix {
            t: truth.time + LATE,
            lat_deg: (truth.lat + e.y / r_m).to_degrees(),
            lon_deg: (truth.lon + e.x / r_n / truth.lat.cos()).to_degrees(),
            height: truth.height + e.z,
            v_n: Some(v.into()),
            accuracy: [None; 3],
            line: k,
        });
    }
    let aids = Aids {
        fixes,
        ..Aids::default()
    };
    let (mut running, mut first) = (None, None);
    let (mut square, mut speed, mut count) = (Vector3::zeros(), 0.0, 0.0);
    for (k, (truth, ideal)) in flight.iter().enumerate() {
        let noisy = sensor.sample(ideal);
        let sample = ImuSample {
            t: truth.time,
            dt: DT,
            delta_theta: noisy.delta_theta_b.cast().into(),
            delta_v: noisy.delta_v_b.cast().into(),
            line: k,
        };
        let flight = running.get_or_insert_with(|| Flight::new(told, &sample, &aids).unwrap());
        let fixed = flight.take(&sample, &aids).unwrap().fixes;
        if let (None, Some(fix)) = (first, fixed.first()) {
            let used = [fix.position.handling, fix.velocity.unwrap().handling];
            first = Some(used == [Handling::Used; 2]);
        }
        if let Some(filter) = flight.filter().filter(|_| truth.time > 60.0) {
            let e = between(&filter.nav().c_b_n(), truth);
            square += e.component_mul(&e);
            speed += (filter.nav().v_n().cast::<f64>() - truth.v_n).norm_squared();
            count += 1.0;
        }
    }
    assert!(count > 1000.0, "the filter never started");
    let outcome = Outcome {
        attitude: (square / count).map(f64::sqrt),
        velocity: (speed / count).sqrt(),
        first: first.unwrap(),
    };
    println!(
        "attitude {:.5?} rad, velocity {:.3} m/s, first fix used: {}",
        outcome.attitude.as_slice(),
        outcome.velocity,
        outcome.first
    );
    outcome
}

fn setup() -> Setup {
    let SensorErrors { vrw, arw, .. } = SensorErrors::TACTICAL;
    Setup {
        settings: Settings {
            noise: NoiseDensity::from_random_walks(vrw as f32, arw as f32),
            ..Setup::QUAD.settings
        },
        sigma: [1.0, 1.0, 0.05],
        latency: LATE,
        antenna: Antenna::new(LEVER.cast::<f32>()).unwrap(),
        start: [0.02, 1e-4, 0.01],
        ..Setup::QUAD
    }
}

#[test]
fn the_filter_goes_on_from_there() {
    let good = replayed(setup());
    // A velocity of 0.05 m/s in turns of 5 m/s² is 10 mrad at each of 300 fixes.
    assert!(good.attitude.amax() < 2e-3 && good.velocity < 0.05);
    // The filter starts where the vehicle is now, not where it was: a quarter of a second is 6 m and 1.5 m/s.
    assert!(good.first);
    // The delay forgotten or too long, the antenna on the other side: all are worse by far.
    let lever = Antenna::new(-LEVER.cast::<f32>()).unwrap();
    for wrong in [
        Setup {
            latency: 0.0,
            ..setup()
        },
        Setup {
            latency: 0.4,
            ..setup()
        },
        Setup {
            antenna: lever,
            ..setup()
        },
    ] {
        let bad = replayed(wrong);
        assert!(bad.attitude.amax() > 3.0 * good.attitude.amax());
        assert!(bad.velocity > 3.0 * good.velocity);
    }
}
