//! The filter judged by its own covariance: over many seeds the normalised errors and innovations must stay inside
//! their χ² bands. A small error with a boasting covariance fails here, and so does a timid one.
//!
//! Truth is drawn from what the filter is told: initial errors and biases from the prior, sensor and measurement noise
//! from their densities.

use host_tests::sim::{
    error_state, ClimbingTurns, Sensor, SensorErrors, Simulator, Static, Trajectory, Turn, DEG,
};
use nalgebra::{Matrix3, SVector, UnitQuaternion, Vector3};
use navsight::attitude::RfuToEnu;
use navsight::earth::Geodetic;
use navsight::error_model::{ATT, BA, BG, POS, VEL};
use navsight::filter::{Filter, Prior};
use navsight::measurement::{Position, Velocity};
use navsight::nav::NavState;

const DT: f64 = 0.01;
const GROUPS: [(&str, usize); 5] = [
    ("position", POS),
    ("velocity", VEL),
    ("attitude", ATT),
    ("gyro bias", BG),
    ("accelerometer bias", BA),
];

/// One kind of run.
struct Scenario<T> {
    motion: T,
    seconds: usize,
    prior: Prior,
    noise: SensorErrors,
    sigma_velocity: f32,
    /// None: velocities only.
    sigma_position: Option<f32>,
    /// No measurement is made within these seconds.
    blind: std::ops::Range<usize>,
    /// When the normalised errors are taken [s].
    times: &'static [usize],
}

/// What the seeds of a scenario added up to.
struct Sums {
    /// Σ eᵀP⁻¹e per time and group, each χ² with 3 degrees of freedom per seed.
    nees: Vec<[f64; 5]>,
    nis: f64,
    rows: usize,
    outside: usize,
    judged: usize,
}

/// χ² band of `n` degrees of freedom at ± `z` normal deviates (Wilson–Hilferty, better than 1 % for n ≥ 30).
fn band(n: f64, z: f64) -> (f64, f64) {
    let a = 2.0 / (9.0 * n);
    let at = |z: f64| n * (1.0 - a + z * a.sqrt()).powi(3);
    (at(-z), at(z))
}

fn run<T: Trajectory + Copy>(scenario: &Scenario<T>, seeds: u64) -> Sums {
    let Scenario { prior, noise, .. } = scenario;
    let draw = |sensor: &mut Sensor, sigma: &[f32; 3]| {
        sensor.normal().component_mul(&Vector3::from(*sigma).cast())
    };
    let mut sums = Sums {
        nees: vec![[0.0; 5]; scenario.times.len()],
        nis: 0.0,
        rows: 0,
        outside: 0,
        judged: 0,
    };
    for seed in 0..seeds {
        let mut sensor = Sensor::new(*noise, 5000 + seed);
        sensor.errors.gyro_bias = draw(&mut sensor, &prior.gyro_bias);
        sensor.errors.accel_bias = draw(&mut sensor, &prior.accel_bias);
        let mut simulator = Simulator::new(scenario.motion, DT);
        let truth = simulator.truth();
        let psi = draw(&mut sensor, &prior.attitude);
        let q = UnitQuaternion::from_scaled_axis(-psi) * truth.q;
        let dr = draw(&mut sensor, &prior.position);
        let v = truth.v_n + draw(&mut sensor, &prior.velocity);
        let radius = 6.37e6 + truth.height;
        let at = Geodetic {
            lat: truth.lat + dr.y / radius,
            lon: truth.lon + dr.x / radius / truth.lat.cos(),
            height: truth.height + dr.z,
        };
        let attitude = RfuToEnu([q.w, q.i, q.j, q.k].map(|x| x as f32));
        let settings = noise.settings();
        let mut filter = Filter::new(
            NavState::new(at, v.cast::<f32>(), attitude).unwrap(),
            prior,
            settings,
        )
        .unwrap();
        for second in 1..=scenario.seconds {
            let mut truth = truth;
            for _ in 0..100 {
                let (now, ideal) = simulator.next().unwrap();
                filter.propagate(&sensor.sample(&ideal)).unwrap();
                truth = now;
            }
            if !scenario.blind.contains(&second) {
                let z = truth.v_n.cast() + sensor.normal().cast::<f32>() * scenario.sigma_velocity;
                let z = Velocity::new(z, Vector3::repeat(scenario.sigma_velocity), 1.0).unwrap();
                let report = filter.update(&z.linearize(filter.nav())).unwrap();
                sums.nis += f64::from(report.nis);
                sums.rows += 3;
                if let Some(sigma) = scenario.sigma_position {
                    let e = sensor.normal() * f64::from(sigma);
                    let local = filter.nav().local();
                    let z = Geodetic {
                        lat: truth.lat + e.y / f64::from(local.r_m),
                        lon: truth.lon + e.x / f64::from(local.r_n * local.cos_lat),
                        height: truth.height + e.z,
                    };
                    let z = Position::new(z, Vector3::repeat(sigma), 1.0).unwrap();
                    let report = filter.update(&z.linearize(filter.nav())).unwrap();
                    sums.nis += f64::from(report.nis);
                    sums.rows += 3;
                }
            }
            if let Some(k) = scenario.times.iter().position(|&t| t == second) {
                let e = SVector::from(error_state(&filter, &truth, &sensor.errors));
                assert!(e.iter().all(|x| x.is_finite()), "{e}");
                let p = filter.covariance().to_matrix().cast::<f64>();
                for (g, (_, first)) in GROUPS.iter().enumerate() {
                    let s = Vector3::from_fn(|i, _| f64::from(filter.sigma0()[first + i]));
                    let e = e.fixed_rows::<3>(*first).component_div(&s);
                    let block = Matrix3::from_fn(|i, j| p[(first + i, first + j)]);
                    sums.nees[k][g] += e.dot(&(block.cholesky().expect("positive").solve(&e)));
                    for i in 0..3 {
                        sums.judged += 1;
                        sums.outside += usize::from(e[i].abs() > 3.0 * block[(i, i)].sqrt());
                    }
                }
            }
        }
    }
    sums
}

/// Prints the table and holds it against the bands.
fn judge<T>(scenario: &Scenario<T>, sums: &Sums, seeds: u64) {
    let n = 3.0 * seeds as f64;
    // 99.9 % for every single cell and 95 % for nine cells of ten, as the χ² of that many draws allows.
    let (wide, narrow) = (band(n, 3.29), band(n, 1.96));
    let mut beyond = 0;
    println!(
        "ANEES over {seeds} seeds, 99.9 % band {:.2}..{:.2}",
        wide.0 / n,
        wide.1 / n
    );
    for (time, row) in scenario.times.iter().zip(&sums.nees) {
        for ((name, _), x) in GROUPS.iter().zip(row) {
            println!("{time:5} s  {name:20} {:.3}", x / n);
            assert!(wide.0 < *x && *x < wide.1, "{name} at {time} s: {}", x / n);
            beyond += usize::from(*x < narrow.0 || *x > narrow.1);
        }
    }
    let rows = sums.rows as f64;
    println!(
        "NIS per row {:.4} over {rows} rows; beyond 3σ {} of {}",
        sums.nis / rows,
        sums.outside,
        sums.judged
    );
    let cells = 5 * scenario.times.len();
    assert!(
        10 * beyond <= 2 * cells,
        "{beyond} of {cells} outside the 95 % band"
    );
    let nis = band(rows, 3.29);
    assert!(
        nis.0 < sums.nis && sums.nis < nis.1,
        "NIS per row {}",
        sums.nis / rows
    );
    // 0.27 % expected; the errors of one seed hang together, so the count scatters more than a binomial's.
    assert!(sums.outside as f64 <= 0.01 * sums.judged as f64);
}

#[test]
fn two_positions() {
    let ug = 9.80665e-6;
    let scenario = Scenario {
        motion: Turn {
            before: Static::degrees(Geodetic::from_degrees(40.0, 116.0, 100.0), 25.0, 2.0, -3.0),
            begin: 150.0,
            duration: 2.0,
            rate: 90.0 * DEG,
        },
        seconds: 300,
        // Small enough angles for the second-order terms, g·ψ², to stay below the noise of the velocity.
        prior: Prior {
            position: [1.0; 3],
            velocity: [0.05; 3],
            attitude: [0.05, 0.05, 0.5].map(|deg: f32| deg * DEG as f32),
            gyro_bias: [(0.02 * DEG / 3600.0) as f32; 3],
            accel_bias: [100.0 * ug; 3],
        },
        noise: SensorErrors::NAVIGATION,
        sigma_velocity: 0.002,
        sigma_position: None,
        blind: 151..154,
        times: &[10, 60, 150, 170, 300],
    };
    let seeds = 40;
    let sums = run(&scenario, seeds);
    judge(&scenario, &sums, seeds);
}

#[test]
fn climbing_turns_with_position_and_velocity() {
    let ug = 9.80665e-6;
    let scenario = Scenario {
        motion: ClimbingTurns {
            start: Geodetic::from_degrees(-35.0, 20.0, 1000.0),
            speed: 60.0,
            heading: 1.0,
            turn_rate: 3.0 * DEG,
            climb: 2.0 * DEG,
        },
        seconds: 200,
        prior: Prior {
            position: [5.0; 3],
            velocity: [0.3; 3],
            attitude: [0.3, 0.3, 1.0].map(|deg: f32| deg * DEG as f32),
            gyro_bias: [(5.0 * DEG / 3600.0) as f32; 3],
            accel_bias: [1000.0 * ug; 3],
        },
        noise: SensorErrors::TACTICAL,
        sigma_velocity: 0.1,
        sigma_position: Some(2.0),
        blind: 120..140,
        times: &[10, 60, 119, 139, 200],
    };
    let seeds = 40;
    let sums = run(&scenario, seeds);
    judge(&scenario, &sums, seeds);
}
