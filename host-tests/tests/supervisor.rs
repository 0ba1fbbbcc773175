//! The supervisor: a navigation-grade sensor that gets there, or not, and a recorded MEMS sensor that cannot.
//!
//! Reads `../shared/data/mems_static/imu.csv` beside the repository; says so and passes where it is not there.
#![cfg(not(target_os = "none"))]

use std::path::Path;

use host_tests::input::ImuReader;
use host_tests::sim::{navigation_grade, Sensor, SensorErrors, Simulator, Static};
use nalgebra::Vector3;
use navsight::alignment::gate::{Gate, Plan};
use navsight::alignment::heading_source::HeadingSource;
use navsight::alignment::levelling::{self, Levelling};
use navsight::alignment::standing::{self, Progress, StandingAlignment};
use navsight::alignment::supervisor::{Status, Supervisor};
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{BiasModel, NoiseDensity, ATT, N};
use navsight::filter::{Prior, Settings};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::ZeroVelocity;
use navsight::observability::verdict::{Limits, Verdict};

const HEADING: usize = ATT + 2;

fn required(level_deg: f32, heading_deg: f32) -> [Option<f32>; N] {
    let mut required = [None; N];
    required[ATT] = Some(level_deg.to_radians());
    required[ATT + 1] = required[ATT];
    required[HEADING] = Some(heading_deg.to_radians());
    required
}

/// Time, status, time to go and progress after an update.
type Said = (f64, Status, Option<f32>, f32);

/// An alignment in one position; what the supervisor says after each update.
fn align(required: &[Option<f32>; N], seconds: f64) -> (Supervisor, Vec<Said>) {
    let (plan, prior, settings) = navigation_grade();
    let at = Geodetic::from_degrees(40.0, 116.0, 50.0);
    let errors = SensorErrors::NAVIGATION.with_biases([0.01, -0.015, 0.01], [60.0, -40.0, 50.0]);
    let mut sensor = Sensor::new(errors, 7);
    let mut alignment = StandingAlignment::new(at, plan, prior, settings).unwrap();
    let mut supervisor = None;
    let mut said = Vec::new();
    let still = Static::degrees(at, 30.0, 1.0, -2.0);
    for (_, ideal) in Simulator::new(still, 0.02).take((seconds / 0.02) as usize) {
        let progress = alignment.take(&sensor.sample(&ideal)).unwrap();
        let Some(filter) = alignment.filter() else {
            continue;
        };
        let supervisor = supervisor.get_or_insert_with(|| {
            Supervisor::new(filter.sigma0(), required, Limits::DEFAULT).unwrap()
        });
        if let Progress::Updated(report) = progress {
            let status = supervisor.take(filter.time(), &report);
            let go = supervisor.time_to_go();
            said.push((filter.time(), status, go, supervisor.progress()));
        }
    }
    (supervisor.unwrap(), said)
}

#[test]
fn an_alignment_that_gets_there_is_called_done_once() {
    let (supervisor, said) = align(&required(0.01, 0.3), 900.0);
    let done = supervisor.latched().unwrap();
    println!("aligned at {:.0} s: {}", done.time, supervisor.sentence());
    assert_eq!(said[0].1, Status::Starting);
    assert_eq!(supervisor.status(), Status::Aligned);
    // Both conditions held then: σ, and less than a fifth a minute.
    assert!(done.sigma[HEADING] <= 0.3f32.to_radians());
    let first = said.iter().position(|s| s.1 == Status::Aligned).unwrap();
    assert_eq!(said[first].0, done.time);
    // σ came first: it was waiting for ξ to rest.
    let reached = said.iter().position(|s| s.2 == Some(0.0)).unwrap();
    assert!(reached < first);
    assert!(said[reached..first]
        .iter()
        .all(|s| matches!(s.1, Status::Settling { .. } | Status::Learning { .. })));
    // Never taken back, and the progress ends at 1.
    assert!(said[first..].iter().all(|s| s.1 == Status::Aligned));
    assert_eq!(supervisor.progress(), 1.0);
    // Half-way, the time to go is right within a factor of 2: it follows a power law, and the fall is steeper at first.
    let half = said[reached].0 * 0.6;
    let (t, _, go, progress) = *said.iter().find(|s| s.0 >= half).unwrap();
    let truly = said[reached].0 - t;
    let told = f64::from(go.unwrap());
    println!("at {t:.0} s: {told:.0} s to go, it took {truly:.0} s; progress {progress:.2}");
    assert!((0.5..2.0).contains(&(told / truly)));
    assert!((0.3..1.0).contains(&progress));
}

#[test]
fn a_requirement_beyond_the_sensor_is_told_so() {
    // The east gyro's 0.02 °/h allow 0.1° at best.
    let (supervisor, said) = align(&required(0.01, 0.05), 2400.0);
    assert!(supervisor.latched().is_none());
    assert!(said.iter().all(|s| s.1 != Status::Aligned));
    let text = supervisor.sentence().to_string();
    println!("{text}");
    assert_eq!(
        supervisor.status(),
        Status::Limited {
            state: HEADING as u8
        }
    );
    assert!(text.starts_with("Not aligned, and time does not help, heading: "));
    assert_eq!(supervisor.time_to_go(), None);
    // The levels are there long since.
    assert!(supervisor.verdicts().reached(ATT) && supervisor.verdicts().reached(ATT + 1));
}

#[test]
fn an_alignment_without_requirement_has_no_end() {
    let new = Supervisor::new(&[1.0; N], &[None; N], Limits::DEFAULT);
    assert_eq!(new.map(|_| ()), Err(Error::Size));
}

/// Samples of the recording, its sensor axes turned to right-forward-up.
fn mems(path: &Path, seconds: f64) -> Vec<ImuIncrement> {
    let turned = |v: [f64; 3]| Vector3::new(v[0], -v[1], -v[2]).cast::<f32>();
    let samples = ImuReader::open(path).unwrap().map(Result::unwrap);
    samples
        .take_while(|s| s.t <= seconds)
        .map(|s| ImuIncrement {
            delta_theta_b: turned(s.delta_theta),
            delta_v_b: turned(s.delta_v),
            dt: s.dt as f32,
        })
        .collect()
}

#[test]
fn a_sensor_that_cannot_feel_the_earth_turn_never_claims_heading() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/mems_static/imu.csv");
    if !path.exists() {
        eprintln!("skipped: {} is not there", path.display());
        return;
    }
    let samples = mems(&path, 900.0);
    let rad = 1f32.to_radians();
    let sigma_a = 0.01 * 9.8; // 10 mg
    let prior = Prior {
        position: [10.0; 3],
        velocity: [0.1; 3],
        attitude: [5.0 * rad, 5.0 * rad, 0.0],
        gyro_bias: [0.6 * rad; 3],
        accel_bias: [sigma_a; 3],
    };
    // Allan deviations of the recording at 1 s; its gyro biases wander by 27 °/h in 100 s, the others by 0.5 mg.
    let mut noise = NoiseDensity::from_random_walks(7e-3, 7e-4);
    noise.gyro_bias = [1e-10; 3];
    noise.accel_bias = [1.6e-7; 3];
    let settings = Settings {
        limits: ImuLimits::DEFAULT,
        noise,
        bias: BiasModel::constant(),
        propagation_interval: 0.1,
        gate: None,
    };
    let at = Geodetic::from_degrees(40.0, 0.0, 0.0);
    // The library says by itself that it takes a heading from somebody else, and levels in the first minute.
    let plan = standing::Plan {
        coarse_duration: 60.0,
        zero_velocity: ZeroVelocity::new(0.01, 1.0).unwrap(),
        turning: rad,
    };
    let told = StandingAlignment::with_heading(at, plan, prior, settings, None).unwrap();
    assert_eq!(told.heading_source(), HeadingSource::Nobody);
    let (window, rest) = samples.split_at(6000);
    let mut levelling = Levelling::new(settings.limits);
    window.iter().for_each(|s| levelling.take(s).unwrap());
    let (_, mut filter) = levelling.start(at, None, &prior, settings).unwrap();
    let mut gate = Gate::new(Plan {
        always: levelling::HEADING,
        ..Plan::BIASES
    })
    .unwrap();
    let mut supervisor =
        Supervisor::new(filter.sigma0(), &required(1.0, 2.0), Limits::DEFAULT).unwrap();
    let standing = ZeroVelocity::new(0.01, 1.0).unwrap();
    let mut reasons = Vec::new();
    for (k, sample) in rest.iter().enumerate() {
        filter.propagate(sample).unwrap();
        if (k + 1) % 100 != 0 {
            continue;
        }
        let measured = standing.linearize(filter.nav());
        let report = gate.update(&mut filter, &measured).unwrap();
        let status = supervisor.take(filter.time(), &report);
        assert_ne!(status, Status::Aligned);
        let heading = supervisor.verdicts().of(HEADING).unwrap();
        assert!(
            matches!(heading.verdict, Verdict::Unseen | Verdict::Weak),
            "{} s: {heading:?}",
            filter.time()
        );
        if reasons.last() != Some(&status) {
            reasons.push(status);
        }
    }
    println!("{reasons:?}: {}", supervisor.sentence());
    assert_eq!(
        supervisor.status(),
        Status::Unseen {
            state: HEADING as u8
        }
    );
    assert!(supervisor.latched().is_none() && supervisor.time_to_go().is_none());
    let text = supervisor.sentence().to_string();
    assert!(text.contains("heading: No"), "{text}");

    // The level it found is that of the mean specific force of the whole span, 900 s,
    let force: Vector3<f64> = samples.iter().map(|s| s.delta_v_b.cast::<f64>()).sum();
    let c = filter.nav().c_b_n().cast::<f64>();
    let tilt = force.normalize().angle(&c.row(2).transpose()).to_degrees();
    println!("level within {tilt:.4}° of the mean specific force");
    assert!(tilt < 0.1);
    // and as uncertain as the accelerometers: nothing at rest tells a bias from a tilt.
    for i in [ATT, ATT + 1] {
        let ratio = filter.sigma(i).unwrap() / (sigma_a / 9.8);
        println!("σ of the tilt over σ_ba/g: {ratio:.3}");
        assert!((0.8..1.2).contains(&ratio));
    }
}
