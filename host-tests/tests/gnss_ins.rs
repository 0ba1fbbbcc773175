//! A simulated flight with satellite fixes, judged by the filter's own covariance: MEMS and tactical sensors, ten minutes
//! with turns and changes of speed, fixes that come 0.2 s late from an antenna a metre away, a minute without any.

use std::sync::OnceLock;

use host_tests::sim::{
    covariance, error_state, Ideal, Patrol, Sensor, SensorErrors, Simulator, Truth, DEG,
};
use nalgebra::{SVector, UnitQuaternion, Vector3};
use navsight::attitude::RfuToEnu;
use navsight::earth::Geodetic;
use navsight::error_model::{ATT, BG, N};
use navsight::filter::{Filter, Gate, LateFilter, Prior, Source};
use navsight::measurement::{Antenna, Position, PositionVelocity, Velocity};
use navsight::nav::NavState;
use rayon::prelude::*;

const DT: f64 = 0.01;
const SECONDS: usize = 600;
const OUTAGE: std::ops::Range<usize> = 440..500;
/// Errors are judged from this sample on, every 2.2 s: at five phases of the interval between fixes, so that a late fix
/// is still under way at one of them.
const CONVERGED: usize = 6000;
const EVERY: usize = 220;
const SIGMA_R: [f64; 3] = [1.5, 1.5, 3.0];
const SIGMA_V: f64 = 0.1;
/// 1.0 m
const LEVER: Vector3<f64> = Vector3::new(0.36, 0.8, 0.48);

struct Grade {
    noise: SensorErrors,
    prior: Prior,
}

fn prior(gyro_deg_h: f64, accel_ug: f64, level_deg: f64, heading_deg: f64) -> Prior {
    let (level, heading) = ((level_deg * DEG) as f32, (heading_deg * DEG) as f32);
    Prior {
        position: [3.0; 3],
        velocity: [0.3; 3],
        attitude: [level, level, heading],
        gyro_bias: [(gyro_deg_h * DEG / 3600.0) as f32; 3],
        accel_bias: [(accel_ug * 9.80665e-6) as f32; 3],
    }
}

/// 1 °/h, 1 mg, 0.1 °/√h, 100 µg/√Hz
fn tactical() -> Grade {
    Grade {
        noise: SensorErrors::TACTICAL,
        prior: prior(1.0, 1000.0, 0.3, 2.0),
    }
}

/// 100 °/h, 5 mg, 0.3 °/√h, 300 µg/√Hz
fn mems() -> Grade {
    Grade {
        noise: SensorErrors {
            arw: 0.3 * DEG / 60.0,
            vrw: 300.0 * 9.80665e-6,
            ..SensorErrors::NONE
        },
        prior: prior(100.0, 5000.0, 0.5, 3.0),
    }
}

/// The flight: truth at the end of every sample, the ideal sample, and the velocity of the antenna against the IMU.
fn flight() -> &'static (Truth, Vec<(Truth, Ideal)>) {
    static FLIGHT: OnceLock<(Truth, Vec<(Truth, Ideal)>)> = OnceLock::new();
    FLIGHT.get_or_init(|| {
        let patrol = Patrol {
            start: Geodetic::from_degrees(48.0, 9.0, 500.0),
            speed: 40.0,
            faster: 15.0,
            heading: 0.4,
            turn: 100.0 * DEG,
        };
        let simulator = Simulator::new(patrol, DT);
        let begin = simulator.truth();
        (begin, simulator.take(SECONDS * 100 + 1).collect())
    })
}

fn place(truth: &Truth, offset: &Vector3<f64>) -> Geodetic {
    // radii to a part in 10⁴ are enough for a metre of lever arm and three of noise
    let radius = 6.378e6 * (1.0 + truth.lat.sin().powi(2) / 298.26) + truth.height;
    let meridian = 6.3354e6 * (1.0 + 0.01007 * truth.lat.sin().powi(2)) + truth.height;
    Geodetic {
        lat: truth.lat + offset.y / meridian,
        lon: truth.lon + offset.x / radius / truth.lat.cos(),
        height: truth.height + offset.z,
    }
}

/// What is told to the filter and what is true.
#[derive(Clone, Copy)]
struct Case {
    /// Fixes come so late [s],
    delay: f64,
    /// the filter believes so late,
    told: f64,
    /// and the antenna there.
    lever: Vector3<f64>,
}

const IN_TIME: Case = Case {
    delay: 0.0,
    told: 0.0,
    lever: LEVER,
};
const LATE: Case = Case {
    delay: 0.2,
    told: 0.2,
    lever: LEVER,
};

/// One epoch of one seed.
struct Epoch {
    /// eᵀP⁻¹e
    nees: f64,
    e: SVector<f64, N>,
    sigma: SVector<f64, N>,
}

fn fly(grade: &Grade, case: Case, seed: u64) -> Vec<Epoch> {
    let (begin, samples) = flight();
    let Grade { noise, prior } = grade;
    let draw = |sensor: &mut Sensor, sigma: &[f32; 3]| {
        sensor
            .normal()
            .component_mul(&Vector3::from(*sigma).cast::<f64>())
    };
    let mut sensor = Sensor::new(*noise, 7000 + seed);
    sensor.errors.gyro_bias = draw(&mut sensor, &prior.gyro_bias);
    sensor.errors.accel_bias = draw(&mut sensor, &prior.accel_bias);
    let psi = draw(&mut sensor, &prior.attitude);
    let q = UnitQuaternion::from_scaled_axis(-psi) * begin.q;
    let dr = draw(&mut sensor, &prior.position);
    let dv = draw(&mut sensor, &prior.velocity);
    let nav = NavState::new(
        place(begin, &dr),
        (begin.v_n + dv).cast::<f32>(),
        RfuToEnu([q.w, q.i, q.j, q.k].map(|x| x as f32)),
    )
    .unwrap();
    let settings = noise.settings();
    let filter = Filter::new(nav, prior, settings).unwrap();
    let mut filter = LateFilter::<16>::new(filter, 0.03).unwrap();
    let mut source = Source::new(Gate::OPEN).unwrap();
    let antenna = Antenna::new(case.lever.cast::<f32>()).unwrap();
    // The noise of the fixes is the same for every case: what differs is what the filter makes of them.
    let mut receiver = Sensor::new(SensorErrors::NONE, 90_000 + seed);
    let mut epochs = Vec::new();
    let mut waiting = None;
    for k in 0..SECONDS * 100 {
        let (truth, ideal) = &samples[k];
        filter.propagate(&sensor.sample(ideal)).unwrap();
        if (k + 1) % 100 == 0 {
            let arm = |k: usize| samples[k].0.q * LEVER;
            let e_r = receiver.normal().component_mul(&Vector3::from(SIGMA_R));
            let e_v = receiver.normal() * SIGMA_V;
            let v = truth.v_n + (arm(k + 1) - arm(k - 1)) / (2.0 * DT) + e_v;
            waiting = Some((truth.time, place(truth, &(arm(k) + e_r)), v));
        }
        let due = |(t, _, _): &(f64, Geodetic, Vector3<f64>)| truth.time > t + case.delay - 1e-6;
        if let Some((t, at, v)) = waiting.take_if(|w| due(w)) {
            if !OUTAGE.contains(&(t.round() as usize)) {
                let r = Position::new(at, Vector3::from(SIGMA_R).cast(), 1.0).unwrap();
                let s_v = Vector3::repeat(SIGMA_V as f32);
                let v = Velocity::new(v.cast::<f32>(), s_v, 1.0).unwrap();
                let fix = PositionVelocity::new(r, v, antenna);
                let time = t + case.delay - case.told;
                filter
                    .update(&mut source, time, |nav| fix.linearize(nav))
                    .unwrap();
            }
        }
        if k + 1 >= CONVERGED && (k + 1 - CONVERGED).is_multiple_of(EVERY) {
            filter.synchronize();
            let e = SVector::from(error_state(filter.filter(), truth, &sensor.errors));
            let p = covariance(filter.filter());
            epochs.push(Epoch {
                nees: e.dot(&p.cholesky().expect("positive").solve(&e)),
                e,
                sigma: p.diagonal().map(f64::sqrt),
            });
        }
    }
    epochs
}

/// All seeds, on all cores.
fn fleet(grade: &Grade, case: Case, seeds: u64) -> Vec<Vec<Epoch>> {
    (0..seeds)
        .into_par_iter()
        .map(|seed| fly(grade, case, seed))
        .collect()
}

/// χ² band of `n` degrees of freedom at ± `z` normal deviates (Wilson–Hilferty, better than 1 % for n ≥ 30).
fn band(n: f64, z: f64) -> (f64, f64) {
    let a = 2.0 / (9.0 * n);
    let at = |z: f64| n * (1.0 - a + z * a.sqrt()).powi(3);
    (at(-z), at(z))
}

/// Root mean square of position, velocity and attitude.
fn rms(runs: &[Vec<Epoch>]) -> [f64; 3] {
    let all: Vec<&Epoch> = runs.iter().flatten().collect();
    [0, 3, ATT].map(|first| {
        let sum: f64 = all
            .iter()
            .map(|epoch| epoch.e.fixed_rows::<3>(first).norm_squared())
            .sum();
        (sum / all.len() as f64).sqrt()
    })
}

/// Fraction of time inside the band, time mean of the ANEES, fraction inside 3σ pooled, and that of the worst component.
fn judge(name: &str, runs: &[Vec<Epoch>]) -> (f64, f64, f64, f64) {
    let seeds = runs.len() as f64;
    let (low, high) = band(N as f64 * seeds, 1.96);
    let epochs = runs[0].len();
    let anees: Vec<f64> = (0..epochs)
        .map(|k| runs.iter().map(|run| run[k].nees).sum())
        .collect();
    let inside = anees.iter().filter(|x| (low..=high).contains(x)).count();
    let mean = anees.iter().sum::<f64>() / (epochs as f64 * seeds * N as f64);
    let within = |i: usize| {
        let count = runs
            .iter()
            .flatten()
            .filter(|epoch| epoch.e[i].abs() <= 3.0 * epoch.sigma[i])
            .count();
        count as f64 / (epochs as f64 * seeds)
    };
    let each: Vec<f64> = (0..BG).map(within).collect();
    let pooled = each.iter().sum::<f64>() / each.len() as f64;
    let worst = each.iter().copied().fold(1.0, f64::min);
    let inside = inside as f64 / epochs as f64;
    println!(
        "{name}: ANEES {mean:.3}, inside its band {:.0} % of {epochs} epochs; 3σ {:.2} %, worst component {:.2} %",
        100.0 * inside,
        100.0 * pooled,
        100.0 * worst
    );
    (inside, mean, pooled, worst)
}

const SEEDS: u64 = 40;

fn consistent(name: &str, grade: &Grade) {
    let late = fleet(grade, LATE, SEEDS);
    let (inside, mean, pooled, worst) = judge(name, &late);
    assert!(inside >= 0.85, "{inside}");
    assert!((0.85..=1.15).contains(&mean), "{mean}");
    assert!(pooled >= 0.99 && worst >= 0.98, "{pooled} {worst}");
    let in_time = fleet(grade, IN_TIME, SEEDS);
    judge(name, &in_time);
    let (a, b) = (rms(&in_time), rms(&late));
    println!("position, velocity, attitude: {a:.4?} in time, {b:.4?} late");
    for (a, b) in a.iter().zip(&b) {
        assert!(*b <= 1.1 * a, "{b} {a}");
    }
}

#[test]
fn tactical_sensor() {
    consistent("tactical", &tactical());
}

#[test]
fn mems_sensor() {
    consistent("MEMS", &mems());
}

#[test]
#[ignore = "a minute and a half: 25 fleets of both grades"]
fn other_fleets_say_the_same() {
    // Errors of a bias last as long as the run, so 40 seeds are 40 draws of it, however many epochs they have: the share of
    // epochs inside the band scatters from fleet to fleet, 0.87 to 1.00, and the fleet of the tests above is the lowest of
    // the MEMS ones.
    for (name, grade) in [("tactical", tactical()), ("MEMS", mems())] {
        let runs = fleet(&grade, LATE, 25 * SEEDS);
        let mut share: Vec<f64> = runs
            .chunks(SEEDS as usize)
            .map(|fleet| judge(name, fleet).0)
            .collect();
        share.sort_by(f64::total_cmp);
        println!("{name}: lowest {:.2}, median {:.2}", share[0], share[12]);
        assert!(share[0] >= 0.85 && share[12] >= 0.93);
        // What is left is of second order: level times heading times bias at the start, 3° and 5 mg. With a tenth of either
        // it is 1.005, with the attitude twice as uncertain 1.073.
        let (_, mean, _, _) = judge(name, &runs);
        assert!((0.98..1.03).contains(&mean), "{mean}");
    }
}

#[test]
fn a_wrong_lever_arm_or_latency_is_seen() {
    // The same judgement refuses a filter that has the antenna on the other side, none at all, or no delay.
    for (name, case) in [
        (
            "mirrored lever arm",
            Case {
                lever: -LEVER,
                ..LATE
            },
        ),
        (
            "no lever arm",
            Case {
                lever: LEVER * 0.0,
                ..LATE
            },
        ),
        ("no delay", Case { told: 0.0, ..LATE }),
        ("delay of the wrong size", Case { told: 0.3, ..LATE }),
    ] {
        let (inside, mean, _, _) = judge(name, &fleet(&tactical(), case, 8));
        assert!(inside < 0.85 && mean > 1.15, "{name}: {inside} {mean}");
    }
}
