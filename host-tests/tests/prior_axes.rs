//! A prior is given about east, north, up, and why: on a tilted vehicle whose heading is unknown, what levelling corrects
//! must not turn the heading. About body axes the unknown rotation about the vehicle's own vertical axis is in part a
//! tilt, and the correction of the tilt is taken for it.

use host_tests::sim::{Sensor, SensorErrors, Simulator, Static};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use navsight::alignment::coarse::UNKNOWN_HEADING;
use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use navsight::error_model::{ATT, N};
use navsight::filter::{Filter, Prior, Settings};
use navsight::measurement::ZeroVelocity;
use navsight::nav::NavState;

const DEG: f32 = core::f32::consts::PI / 180.0;
/// Latitude [°].
const LAT: f64 = 48.0;
/// The vehicle stands with its nose up by this.
const TILT: f32 = 3.0 * DEG;
/// 1σ of the level [rad].
const LEVEL: f32 = DEG;
/// How long it is levelled [s], with an update every 0.1 s.
const SECONDS: f32 = 1.0;

fn at() -> Geodetic {
    Geodetic::from_degrees(LAT, 9.0, 500.0)
}

/// Heading of the vehicle, the axis that its nose points along when it is level, and its attitude turned about that axis.
fn start(heading_deg: f32, error: f32) -> (NavState, Vector3<f32>) {
    let heading = heading_deg * DEG;
    let forward = Vector3::new(heading.sin(), heading.cos(), 0.0);
    let truth = Euler::from_degrees(heading_deg, 3.0, 0.0);
    let nav = NavState::new(at(), Vector3::zeros(), truth).unwrap();
    let mut dx = SVector::<f32, N>::zeros();
    dx.fixed_rows_mut::<3>(ATT).copy_from(&(forward * error));
    (nav.corrected(&dx), forward)
}

fn prior() -> Prior {
    Prior {
        position: [1.0; 3],
        velocity: [1e-3; 3],
        attitude: [LEVEL, LEVEL, UNKNOWN_HEADING],
        // both small beside the level that is to be corrected: 1e-5 rad
        gyro_bias: [1e-6; 3],
        accel_bias: [1e-4; 3],
    }
}

fn settings() -> Settings {
    SensorErrors::NAVIGATION.settings()
}

/// The same standard deviations about right, forward and up of the vehicle.
fn about_body_axes(nav: &NavState) -> Filter {
    let sigma = SVector::<f32, N>::from(prior().sigma0().unwrap());
    let mut p0 = SMatrix::<f32, N, N>::from_diagonal(&sigma.component_mul(&sigma));
    let body: Matrix3<f32> = p0.fixed_view::<3, 3>(ATT, ATT).into_owned();
    let c = nav.c_b_n();
    let turned = c * body * c.transpose();
    p0.fixed_view_mut::<3, 3>(ATT, ATT)
        .copy_from(&((turned + turned.transpose()) * 0.5));
    Filter::with_covariance(*nav, &p0, settings()).unwrap()
}

/// What levelling made of heading and of the tilt about the forward axis [rad].
fn levelled(mut filter: Filter, heading_deg: f32, forward: &Vector3<f32>) -> (f32, f32) {
    let before = filter.nav().euler().heading;
    let zero = ZeroVelocity::new(1e-3, 0.1).unwrap();
    let truth = Static::degrees(at(), f64::from(heading_deg), 3.0, 0.0);
    let mut sensor = Sensor::new(SensorErrors::NONE, 1);
    let samples = (SECONDS * 100.0) as usize;
    for (k, (_, ideal)) in Simulator::new(truth, 0.01).take(samples).enumerate() {
        filter.propagate(&sensor.sample(&ideal)).unwrap();
        if k % 10 == 9 {
            filter.update(&zero.linearize(filter.nav())).unwrap();
        }
    }
    let c = Euler::from_degrees(heading_deg, 3.0, 0.0).c_b_n() * filter.nav().c_b_n().transpose();
    let left = Vector3::new(c.m32 - c.m23, c.m13 - c.m31, c.m21 - c.m12) * 0.5;
    let tau = core::f32::consts::TAU;
    let turned = (filter.nav().euler().heading - before + 0.5 * tau).rem_euclid(tau) - 0.5 * tau;
    (turned, left.dot(forward))
}

#[test]
fn levelling_leaves_an_unknown_heading_alone() {
    // What the east-north-up prior may move: a rotation about a horizontal axis changes the heading of a tilted nose by
    // its tangent; and with the earth's rate an unknown heading drives the tilts, so that in a second some of the tilt
    // is rightly taken for heading: covariance σ_U² Ω cos L T over the variance of the level.
    let earth = 7.292e-5 * (LAT.to_radians().cos() as f32) * SECONDS;
    let rightly = TILT.tan() + UNKNOWN_HEADING.powi(2) * earth / LEVEL.powi(2);
    // What the body-axis prior makes of it: the axis of the unknown rotation leans by the tilt, so
    // σ_forward² = σ_l² + (σ_y² − σ_l²) sin², covariance with up (σ_y² − σ_l²) sin cos.
    let wide = UNKNOWN_HEADING.powi(2) - LEVEL.powi(2);
    let leak = wide * TILT.sin() * TILT.cos() / (LEVEL.powi(2) + wide * TILT.sin().powi(2));
    // Larger errors leak in proportion, until the heading is off by so much that the correction is no longer linear.
    for heading in [0.0, 40.0, 130.0, 250.0] {
        for error in [0.04 * DEG, -0.04 * DEG] {
            let (nav, forward) = start(heading, error);
            let enu = Filter::new(nav, &prior(), settings()).unwrap();
            let (moved, left) = levelled(enu, heading, &forward);
            // levelled indeed: to the velocity noise and what an unknown bias leaves
            assert!(left.abs() < 0.05 * error.abs(), "{left} of {error}");
            // and the rounding of the heading in f32, of 1e-6 rad
            assert!(moved.abs() < rightly * error.abs() + 2e-6, "{moved}");
            let (turned, _) = levelled(about_body_axes(&nav), heading, &forward);
            println!(
                "heading {heading}°, tilt off by {:.2}°: heading moved by {:.4}° about east, north, up; by {:.3}° about body axes",
                error / DEG,
                moved / DEG,
                turned / DEG
            );
            // 0.7° of 0.04°: as computed, but for what is right
            let expected = leak * error.abs();
            assert!((turned.abs() - expected).abs() < rightly * error.abs() + 0.02 * expected);
            assert!(turned.abs() > 0.6 * DEG && turned.abs() > 15.0 * moved.abs());
        }
    }
}
