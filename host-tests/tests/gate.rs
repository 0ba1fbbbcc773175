//! The gate: a multicopter hovers, its velocity aiding is wrong for a while, and an accelerometer bias that a hover cannot
//! tell from tilt pays for it, unless it is held.
#![cfg(not(target_os = "none"))]

use host_tests::sim::{Pose, Sensor, SensorErrors, Simulator, Static, Trajectory, DEG};
use nalgebra::Vector3;
use navsight::alignment::gate::{Gate, Plan};
use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::BA;
use navsight::filter::{Filter, Prior};
use navsight::measurement::Velocity;
use navsight::nav::NavState;

/// Hover until then [s]; then a turn of 90° at 15 °/s; all over a minute after its end and a little.
const TURN: f64 = 300.0;
const TURNED: f64 = 306.0;
const END: f64 = 380.0;
/// Aiding is wrong from here to here [s].
const WRONG: (f64, f64) = (120.0, 280.0);
const DT: f64 = 0.02;
/// The level accelerometer biases, as bits.
const LEVEL: u16 = 0b011 << BA;

#[derive(Clone, Copy)]
struct Hover;

impl Hover {
    fn still() -> Static {
        Static::degrees(Geodetic::from_degrees(47.0, 8.0, 500.0), 20.0, 0.0, 0.0)
    }
}

impl Trajectory for Hover {
    fn start(&self) -> Geodetic {
        Self::still().at
    }
    fn pose(&self, t: f64) -> Pose {
        let mut pose = Self::still().pose(t);
        let rate = 15.0 * DEG;
        pose.euler.x += rate * (t.clamp(TURN, TURNED) - TURN);
        if t > TURN && t < TURNED {
            pose.euler_rate.x = rate;
        }
        pose
    }
}

/// What a run came to.
struct Run {
    /// Largest |bias error|/σ of the level accelerometers over the hover.
    worst: f64,
    /// σ of the level accelerometer biases a minute after release, or after the turn where nothing is held.
    sigma: [f32; 2],
    /// States held when the aiding began to be wrong.
    held: u16,
    released: f64,
}

fn run(gated: bool, seed: u64) -> Run {
    let sigma_a = 0.02; // 2 mg
    let truth_a = [0.012, -0.018, 0.01];
    let errors = SensorErrors {
        accel_bias: Vector3::from(truth_a),
        gyro_bias: Vector3::new(1e-5, -2e-5, 1e-5),
        arw: 0.15 * DEG / 60.0,
        vrw: 1e-3,
    };
    let prior = Prior {
        position: [1.0; 3],
        velocity: [0.1; 3],
        attitude: [0.02, 0.02, 0.005],
        gyro_bias: [3e-5; 3],
        accel_bias: [sigma_a; 3],
    };
    let settings = errors.settings();
    let start = Hover::still();
    let euler = Euler {
        heading: (start.euler.x + 0.003) as f32,
        pitch: 0.01,
        roll: -0.015,
    };
    let nav = NavState::new(start.at, Vector3::zeros(), euler).unwrap();
    let mut filter = Filter::new(nav, &prior, settings).unwrap();
    let mut gate = Gate::new(Plan::BIASES).unwrap();
    let mut sensor = Sensor::new(errors, seed);
    let mut out = Run {
        worst: 0.0,
        sigma: [0.0; 2],
        held: 0,
        released: f64::NAN,
    };
    let steps = (END / DT).round() as usize;
    for (k, (truth, ideal)) in Simulator::new(Hover, DT).take(steps).enumerate() {
        filter.propagate(&sensor.sample(&ideal)).unwrap();
        if (k + 1) % 10 != 0 {
            continue;
        }
        // 5 Hz of velocity, 5 cm/s; while it is wrong it swings by four σ in 40 s
        let t = truth.time;
        let error = if t > WRONG.0 && t < WRONG.1 {
            let phase = std::f64::consts::TAU * (t - WRONG.0) / 40.0;
            Vector3::new(phase.sin(), phase.cos() - 1.0, 0.0) * 0.2
        } else {
            Vector3::zeros()
        };
        let z = (truth.v_n + error + sensor.normal() * 0.05).cast::<f32>();
        let measured = Velocity::new(z, Vector3::repeat(0.05), 0.2).unwrap();
        let measured = measured.linearize(filter.nav());
        if gated {
            gate.update(&mut filter, &measured).unwrap();
        } else {
            filter.update(&measured).unwrap();
        }
        let held = gate.held() & LEVEL;
        if t < WRONG.0 {
            out.held = gate.held();
        }
        if t > TURN && out.released.is_nan() && held == 0 {
            out.released = t;
        }
        if t <= TURN {
            for (i, truth) in truth_a.iter().enumerate().take(2) {
                let error = f64::from(filter.nav().b_a()[i]) - truth;
                let sigma = f64::from(filter.sigma(BA + i).unwrap());
                out.worst = out.worst.max(error.abs() / sigma);
            }
        }
        if (t - (out.released + 60.0)).abs() < 0.1 {
            out.sigma = [0, 1].map(|i| filter.sigma(BA + i).unwrap());
        }
    }
    out
}

#[test]
fn a_bias_that_a_hover_cannot_see_is_not_carried_away() {
    for seed in 1..=3 {
        let (free, held) = (run(false, seed), run(true, seed));
        println!(
            "seed {seed}: without gate {:.2} σ, with {:.2} σ; released at {:.1} s; σ a minute later {:?} against {:?}",
            free.worst, held.worst, held.released, held.sigma, free.sigma
        );
        // The failure: 3.4 to 3.9 σ.
        assert!(free.worst > 3.0);
        // Held at 0.9 σ, where the start was: the truth is 0.6 and 0.9 σ away.
        assert!(held.worst < 1.1);
        assert_eq!((free.held, held.held & LEVEL), (0, LEVEL));
        // Released by the turn, not by the clock.
        assert!((TURN..TURNED).contains(&held.released));
        for (held, free) in held.sigma.iter().zip(free.sigma) {
            // The figure; 3 to 5 %.
            assert!((0.9..1.1).contains(&(held / free)), "{held} against {free}");
        }
    }
}

#[test]
fn nonsense_is_refused() {
    let new = |change: fn(&mut Plan)| {
        let mut plan = Plan::BIASES;
        change(&mut plan);
        Gate::new(plan).map(|_| ())
    };
    assert_eq!(new(|_| ()), Ok(()));
    assert_eq!(new(|p| p.dwell = 0.0), Err(Error::OutOfRange));
    assert_eq!(new(|p| p.release = 0.5 * p.hold), Err(Error::OutOfRange));
    assert_eq!(new(|p| p.hold = f32::NAN), Err(Error::NonFinite));
}
