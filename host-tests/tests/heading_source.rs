//! The first heading, from the earth rate or from outside: the criterion, and what the filter makes of either.
#![cfg(not(target_os = "none"))]

use host_tests::sim::{
    error_state, navigation_grade, Sensor, SensorErrors, Simulator, Static, DEG,
};
use nalgebra::Vector3;
use navsight::alignment::coarse::UNKNOWN_HEADING;
use navsight::alignment::heading_source::{
    choose, earth_rate_sigma, HeadingSource, OutsideHeading,
};
use navsight::alignment::levelling::Levelling;
use navsight::alignment::standing::{Plan, Progress, StandingAlignment};
use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{NoiseDensity, ATT, BG};
use navsight::filter::{Prior, Settings};
use navsight::imu::{ImuIncrement, ImuLimits};
use navsight::measurement::ZeroVelocity;

const RAD: f32 = DEG as f32;
const TRUE_DEG: [f64; 3] = [70.0, 12.0, -20.0];

fn still() -> Static {
    let at = Geodetic::from_degrees(47.0, 8.0, 400.0);
    Static::degrees(at, TRUE_DEG[0], TRUE_DEG[1], TRUE_DEG[2])
}

/// 0.006 °/s/√Hz and 300 µg/√Hz, biases of some tenths of a degree per second and some milli-g.
fn mems() -> (SensorErrors, Plan, Prior, Settings) {
    let errors = SensorErrors {
        arw: 0.006 * DEG,
        vrw: 300.0 * 9.806_65e-6,
        ..SensorErrors::NONE
    }
    .with_biases([1400.0, -1000.0, 700.0], [2000.0, -1000.0, 3000.0]);
    let (plan, _, settings) = navigation_grade();
    let prior = Prior {
        position: [1.0; 3],
        velocity: [0.01; 3],
        // 3 mg
        attitude: [0.17 * RAD, 0.17 * RAD, 0.0],
        gyro_bias: [0.5 * RAD; 3],
        accel_bias: [0.03; 3],
    };
    let noise = NoiseDensity::from_random_walks(errors.vrw as f32, errors.arw as f32);
    let plan = Plan {
        zero_velocity: ZeroVelocity::new(0.01, 1.0).unwrap(),
        ..plan
    };
    (errors, plan, prior, Settings { noise, ..settings })
}

#[test]
fn the_criterion() {
    let at_45 = |deg_h: f32| earth_rate_sigma(45.0 * RAD, deg_h * RAD / 3600.0, 0.0, 60.0) / RAD;
    // bias over Ω cos L = 10.635 °/h
    for (bias, sigma) in [(0.02, 0.1077), (1.0, 5.387), (1e4, UNKNOWN_HEADING / RAD)] {
        assert!((at_45(bias) / sigma - 1.0).abs() < 1e-3, "{bias}");
    }
    // 0.003 °/√h alone, over a minute: 0.0232 °/h
    let noise = earth_rate_sigma(45.0 * RAD, 0.0, 0.003 * RAD / 60.0, 60.0) / RAD;
    assert!((noise - 0.1252).abs() < 1e-3, "{noise}");
    let outside = |deg: f32| Some(OutsideHeading::new(1.0, deg * RAD).unwrap());
    for (earth_deg, other, source) in [
        (0.1, None, HeadingSource::EarthRate),
        (0.1, outside(2.0), HeadingSource::EarthRate),
        (5.4, outside(2.0), HeadingSource::Outside),
        (5.4, outside(20.0), HeadingSource::EarthRate),
        (57.0, outside(2.0), HeadingSource::Outside),
        (57.0, outside(20.0), HeadingSource::Nobody),
        (57.0, None, HeadingSource::Nobody),
        (f32::NAN, None, HeadingSource::Nobody),
    ] {
        assert_eq!(choose(earth_deg * RAD, other.as_ref()), source);
    }
}

#[test]
fn a_heading_from_outside_starts_a_consistent_filter() {
    let (errors, plan, prior, settings) = mems();
    let attitude = Euler::from_degrees(70.0, 12.0, -20.0).c_b_n();
    // A vehicle heading, a baseline across the vehicle, and a field that points 65° down at a declination of 3°.
    let baseline = Vector3::new(0.8, 0.1, 0.0);
    let l = attitude * baseline;
    let (sin, cos) = libm::sincosf(3.0 * RAD);
    let (dip, level) = libm::sincosf(65.0 * RAD);
    let field = attitude.transpose() * Vector3::new(sin * level, cos * level, -dip) * 48.0;
    let sigma = 1.5 * RAD;
    let off = 1.0 * RAD;
    for outside in [
        OutsideHeading::new(70.0 * RAD + off, sigma),
        OutsideHeading::of_axis(baseline, libm::atan2f(l.x, l.y) + off, sigma),
        OutsideHeading::of_axis(field, 3.0 * RAD + off, sigma),
    ] {
        let (outside, at) = (outside.unwrap(), still().at);
        let mut alignment =
            StandingAlignment::with_heading(at, plan, prior, settings, Some(outside)).unwrap();
        assert_eq!(alignment.heading_source(), HeadingSource::Outside);
        let mut sensor = Sensor::new(errors, 5);
        let (mut started, mut last) = (None, None);
        for (truth, ideal) in Simulator::new(still(), 0.01).take(12_000) {
            match alignment.take(&sensor.sample(&ideal)).unwrap() {
                Progress::Started(solution) => started = Some(solution),
                Progress::Turning => panic!("the bias is no turn"),
                _ => {}
            }
            last = Some(truth);
        }
        let (started, truth) = (started.unwrap(), last.unwrap());
        assert_eq!(
            (started.sigma_heading, started.earth_rate_ratio),
            (sigma, 0.0)
        );
        let filter = alignment.filter().unwrap();
        let error = error_state(filter, &truth, &sensor.errors);
        // In tilt the accelerometer bias is left, 2 and 1 mg of 3 told; in heading the degree that it was wrong by.
        for i in [ATT, ATT + 1, ATT + 2, BG, BG + 1, BG + 2] {
            let sigma = f64::from(filter.sigma(i).unwrap());
            assert!(error[i].abs() < 3.0 * sigma, "{i}: {} {sigma}", error[i]);
        }
        assert!((error[ATT + 2] / DEG - 1.0).abs() < 0.3);
        // The plain mean of half a minute leaves 0.0011 °/s per axis.
        assert!(filter.sigma(BG).unwrap() < 0.002 * RAD);
    }
}

#[test]
fn a_sensor_that_feels_the_earth_turn_needs_nobody() {
    let (plan, prior, settings) = navigation_grade();
    let errors = SensorErrors::NAVIGATION.with_biases([0.02, -0.02, 0.02], [100.0, -100.0, 100.0]);
    let run = |outside: Option<OutsideHeading>, shaking: f64| {
        let mut alignment =
            StandingAlignment::with_heading(still().at, plan, prior, settings, outside).unwrap();
        assert_eq!(alignment.heading_source(), HeadingSource::EarthRate);
        let mut sensor = Sensor::new(errors, 6);
        for (_, ideal) in Simulator::new(still(), 0.01) {
            let mut imu = sensor.sample(&ideal);
            imu.delta_v_b += (sensor.normal() * shaking).cast::<f32>();
            if let Progress::Started(solution) = alignment.take(&imu).unwrap() {
                return (alignment.heading_source(), solution);
            }
        }
        unreachable!("a simulator does not end")
    };
    // A compass of 2° that is wrong by 3° is not asked.
    let compass = OutsideHeading::new(73.0 * RAD, 2.0 * RAD).ok();
    for outside in [None, compass] {
        let (source, solution) = run(outside, 0.0);
        assert_eq!(source, HeadingSource::EarthRate);
        assert!((solution.euler().heading / RAD - 70.0).abs() < 0.6);
    }
    // Shaken by 5 mm/s a sample, half a minute of earth rate is worth less than the compass.
    let (source, solution) = run(compass, 0.005);
    assert_eq!(source, HeadingSource::Outside);
    assert!((solution.euler().heading / RAD - 73.0).abs() < 0.01);
    assert_eq!(solution.sigma_heading, 2.0 * RAD);
    let (source, solution) = run(None, 0.005);
    assert_eq!(source, HeadingSource::EarthRate);
    assert!(solution.sigma_heading > 2.0 * RAD);
}

#[test]
fn without_anybody_the_vehicle_is_levelled_and_heading_is_unknown() {
    let (errors, plan, prior, settings) = mems();
    let mut alignment =
        StandingAlignment::with_heading(still().at, plan, prior, settings, None).unwrap();
    assert_eq!(alignment.heading_source(), HeadingSource::Nobody);
    assert!(alignment.level().is_none());
    let mut sensor = Sensor::new(errors, 7);
    let mut simulator = Simulator::new(still(), 0.01);
    for (_, ideal) in simulator.by_ref().take(7000) {
        assert_eq!(alignment.take(&sensor.sample(&ideal)), Ok(Progress::Coarse));
    }
    let level = *alignment.level().unwrap();
    // 2, 1 and 3 mg of accelerometer bias tilt by up to 0.2°
    assert!((level.pitch / RAD - 12.0).abs() < 0.25 && (level.roll / RAD + 20.0).abs() < 0.25);
    assert!(alignment.filter().is_none());
    // A compass of 30° is no help; a receiver with two antennas is.
    alignment.set_heading(OutsideHeading::new(1.0, 30.0 * RAD).unwrap());
    assert_eq!(alignment.heading_source(), HeadingSource::Nobody);
    alignment.set_heading(OutsideHeading::new(70.5 * RAD, 1.0 * RAD).unwrap());
    assert_eq!(alignment.heading_source(), HeadingSource::Outside);
    for (_, ideal) in simulator.take(3000) {
        alignment.take(&sensor.sample(&ideal)).unwrap();
    }
    let filter = alignment.filter().unwrap();
    assert!((filter.nav().euler().heading / RAD - 70.5).abs() < 0.5);
    assert!(filter.sigma(ATT + 2).unwrap() < 1.01 * RAD);
}

#[test]
fn level_of_any_attitude_and_what_is_no_rest() {
    let gravity = 9.81;
    for (pitch, roll) in [(0.0, 0.0), (40.0, -130.0), (-75.0, 10.0), (10.0, 180.0)] {
        let attitude = Euler::from_degrees(0.0, pitch, roll);
        let up = attitude.c_b_n().transpose() * Vector3::new(0.0, 0.0, gravity);
        let rate = Vector3::new(0.01, -0.02, 0.03);
        let imu = ImuIncrement::from_rates(rate, up, 0.005);
        let mut window = Levelling::new(ImuLimits::DEFAULT);
        for _ in 0..700 {
            window.take(&imu).unwrap();
        }
        assert_eq!(window.solve(gravity), Err(Error::Time)); // 3.5 s
        for _ in 700..20_000 {
            window.take(&imu).unwrap();
        }
        let level = window.solve(gravity).unwrap();
        let turn = |a: f32, b: f32| (a / RAD - b + 540.0).rem_euclid(360.0) - 180.0;
        // f32 increments: 6e-8 of themselves
        assert!(turn(level.pitch, pitch).abs() < 2e-4 && turn(level.roll, roll).abs() < 2e-4);
        assert!((level.rate - rate).amax() < 1e-7 && level.sigma < 1e-6);
        assert!((level.force - gravity).abs() < 1e-4);
        assert_eq!(window.solve(0.8 * gravity), Err(Error::OutOfRange));
        let before = window.clone();
        assert!(window.take(&ImuIncrement { dt: -1.0, ..imu }).is_err());
        assert_eq!(window, before);
    }
}

#[test]
fn the_scatter_of_the_level_is_what_its_sigma_says() {
    // 100 windows of 10 s, 1 mg/√Hz: σ = 1e-3/√10 = 0.32 mrad
    let at = still();
    let errors = SensorErrors {
        vrw: 1e-3 * 9.806_65,
        ..SensorErrors::NONE
    };
    let mut sensor = Sensor::new(errors, 8);
    let (mut square, mut variance) = (0.0, 0.0);
    for _ in 0..100 {
        let mut window = Levelling::new(ImuLimits::DEFAULT);
        for (_, ideal) in Simulator::new(at, 0.02).take(500) {
            window.take(&sensor.sample(&ideal)).unwrap();
        }
        let level = window.solve(9.81).unwrap();
        square += (f64::from(level.pitch) - 12.0 * DEG).powi(2);
        variance += f64::from(level.sigma).powi(2);
    }
    let ratio = square / variance;
    // χ²₁₀₀: ±0.42 at 3σ; the larger two of three axes overstate σ² by a tenth or two.
    assert!((0.5..1.3).contains(&ratio), "{ratio}");
    assert!((variance / 100.0).sqrt() < 4.2e-4);
}

#[test]
fn impossible_headings_are_refused() {
    let axis = Vector3::new(0.0, 1.0, 0.0);
    for (axis, azimuth, sigma, error) in [
        (axis, f32::NAN, 0.1, Error::NonFinite),
        (axis, 1.0, f32::INFINITY, Error::NonFinite),
        (axis * f32::NAN, 1.0, 0.1, Error::NonFinite),
        (axis, 70.0, 0.1, Error::OutOfRange),
        (axis, 1.0, 0.0, Error::OutOfRange),
        (axis, 1.0, 4.0, Error::OutOfRange),
        (axis * 0.0, 1.0, 0.1, Error::OutOfRange),
    ] {
        assert_eq!(OutsideHeading::of_axis(axis, azimuth, sigma), Err(error));
    }
    // An antenna above the other has no azimuth.
    let upright = OutsideHeading::of_axis(Vector3::new(0.0, 0.0, 1.0), 1.0, 0.1).unwrap();
    assert_eq!(upright.heading(0.0, 0.0), None);
    assert!(upright.heading(0.5, 0.0).is_some());
}
