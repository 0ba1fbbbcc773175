//! Measurements that depend on attitude and rate: lever arms, course, wheels, correlated fixes. Each Jacobian is the
//! derivative of its innovation at a tilted, moving, turning, biased state, and each innovation vanishes where the
//! vehicle is where the sensor says: a wrong sign in a lever arm, a rate or a frame fails here.

use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector3};
use navsight::attitude::{Euler, Frd};
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::N;
use navsight::imu::ImuIncrement;
use navsight::measurement::{
    Accuracy, Antenna, Boresight, Course, Linearized, MeasurementRows, NonHolonomic, Odometer,
    Position, PositionVelocity, Velocity,
};
use navsight::nav::NavState;

const LEVER: Vector3<f32> = Vector3::new(0.7, 2.5, -1.3);
/// What the gyros report: a turn about all three axes [rad/s].
const RATE: Vector3<f32> = Vector3::new(0.3, -0.5, 0.8);
const B_G: Vector3<f32> = Vector3::new(1e-2, -2e-2, 3e-2);

/// Identity attitude, standstill, no turn and no bias would hide signs.
fn turning() -> NavState {
    let mut nav = NavState::new(
        Geodetic::from_degrees(47.3, 8.5, 2_345.678),
        Vector3::new(15.0, -20.0, 4.0),
        Euler::from_degrees(130.0, 20.0, -35.0),
    )
    .and_then(|nav| nav.with_biases(B_G, Vector3::new(0.1, 0.2, -0.3)))
    .unwrap();
    let imu = ImuIncrement::from_rates(RATE, Vector3::new(1.0, -2.0, 9.0), 0.01);
    nav.advance(&imu).unwrap();
    nav
}

/// A step of each kind of state, exact in f32: m, m/s, rad, rad/s, m/s².
const STEPS: [f32; 5] = [16.0, 0.5, 1.0 / 256.0, 1.0 / 64.0, 1.0 / 64.0];

/// Central differences against the rows.
fn rows_are_the_derivative<const M: usize, H: MeasurementRows<M>>(
    linearize: impl Fn(&NavState) -> Linearized<M, H>,
    tolerance: [f64; 5],
) {
    let nav = turning();
    let h = linearize(&nav).dense();
    for j in 0..N {
        let step = STEPS[j / 3];
        let at = |s: f32| linearize(&nav.corrected(&SVector::ith(j, s))).nu;
        let numeric = (at(-step) - at(step)) / (2.0 * step);
        let error = f64::from((numeric - h.column(j)).amax());
        assert!(
            error <= tolerance[j / 3],
            "column {j}: {error:e}, {numeric} for {}",
            h.column(j)
        );
    }
    // The test sees every element: where the measurement depends on a state at all, the row is not small.
    assert!(h.iter().any(|x| x.abs() > 0.05));
}

fn antenna() -> Antenna {
    Antenna::new(LEVER).unwrap()
}

fn correlated() -> Accuracy {
    Accuracy::covariance(&Matrix3::new(
        4.0, -1.0, 0.5, -1.0, 9.0, 2.0, 0.5, 2.0, 25.0,
    ))
    .unwrap()
}

fn place() -> Geodetic {
    Geodetic::from_degrees(47.3 + 1e-5, 8.5 - 1e-5, 2_340.0)
}

fn position() -> Position {
    Position::with_accuracy(place(), correlated(), 0.2)
        .unwrap()
        .of(antenna())
}

fn velocity() -> Velocity {
    Velocity::with_accuracy(Vector3::new(15.0, -19.0, 3.0), correlated(), 0.2)
        .unwrap()
        .of(antenna())
}

// Tolerances. Position: second order (11 + 16) m·tan L/R = 5e-6 and the radii of the corrected place. Velocity: the
// turn of v̂ by a position correction, |v|/R = 4e-6. Attitude: a rotation of 1/256 rad is cubic in central differences,
// |x|·step²/6 = 3e-6|x|, and an ulp of 5 m (of 20 m/s: 1e-6) over 1/128 is 6e-5 (1.5e-4). Gyro bias: an ulp over 1/32.
const POSITION: [f64; 5] = [1e-5, 0.0, 3e-4, 0.0, 0.0];
const VELOCITY: [f64; 5] = [1e-5, 2e-6, 3e-4, 3e-5, 0.0];

#[test]
fn position_of_an_antenna() {
    rows_are_the_derivative(|nav| position().linearize(nav), POSITION);
    rows_are_the_derivative(|nav| position().linearize_horizontal(nav), POSITION);
}

#[test]
fn velocity_of_an_antenna() {
    rows_are_the_derivative(|nav| velocity().linearize(nav), VELOCITY);
    rows_are_the_derivative(|nav| velocity().linearize_horizontal(nav), VELOCITY);
}

#[test]
fn both_of_one_epoch() {
    let fix = PositionVelocity::new(position(), velocity(), antenna());
    rows_are_the_derivative(|nav| fix.linearize(nav), [1e-5, 2e-6, 3e-4, 3e-5, 0.0]);
    let (nav, both) = (turning(), fix.linearize(&turning()));
    let (r, v) = (position().linearize(&nav), velocity().linearize(&nav));
    assert_eq!(both.nu.fixed_rows::<3>(0).into_owned(), r.nu);
    assert_eq!(both.nu.fixed_rows::<3>(3).into_owned(), v.nu);
    let h = both.dense();
    assert_eq!(h.fixed_view::<3, N>(0, 0).into_owned(), r.dense());
    assert_eq!(h.fixed_view::<3, N>(3, 0).into_owned(), v.dense());
}

/// Direction of the forward axis: tilted by the boresight as well.
fn mounting() -> Boresight {
    Boresight::new(Euler::from_degrees(25.0, -6.0, 3.0)).unwrap()
}

#[test]
fn course_of_a_tilted_vehicle() {
    let model = Course::new(2.5, mounting(), 0.02, 1.0).unwrap();
    // An angle of up to 3 rad: ulp 2.4e-7 over 1/128 is 3e-5 twice; cubic 3e-6.
    rows_are_the_derivative(|nav| model.linearize(nav), [1e-6, 0.0, 1e-4, 0.0, 0.0]);
}

#[test]
fn wheels_of_a_tilted_vehicle() {
    let sigma = Vector3::new(0.1, 0.05, 0.2);
    let odometer = Odometer::new(18.0, antenna(), mounting(), sigma, 0.1).unwrap();
    // Velocity and attitude of 25 m/s in f32: 2e-6 over 1/128 is 3e-4, over 1 m/s 2e-6 twice.
    let tolerance = [1e-6, 8e-6, 6e-4, 1e-4, 0.0];
    rows_are_the_derivative(|nav| odometer.linearize(nav), tolerance);
    let wheels = NonHolonomic::new(antenna(), mounting(), 0.1, 0.2, 0.1).unwrap();
    rows_are_the_derivative(|nav| wheels.linearize(nav), tolerance);
    let (all, two) = (odometer.linearize(&turning()), wheels.linearize(&turning()));
    assert_eq!([two.nu.x, two.nu.y], [all.nu.x, all.nu.z]);
    assert_eq!([two.r.x, two.r.y], [all.r.x, all.r.z]);
}

/// The truth, in double precision and by another way: the antenna is moved with the vehicle for a short time.
#[test]
fn the_antenna_is_where_the_vehicle_carries_it() {
    let nav = turning();
    let c: Matrix3<f64> = nav.c_b_n().cast();
    let (l, omega) = (LEVER.cast::<f64>(), (RATE - B_G).cast::<f64>());
    let at = |t: f64| c * Rotation3::new(omega * t).into_inner() * l;
    let (offset, motion) = (at(0.0), (at(1e-4) - at(-1e-4)) / 2e-4);
    let local = nav.local();
    let here = nav.position();
    let there = Geodetic {
        lat: here.lat + offset.y / f64::from(local.r_m),
        lon: here.lon + offset.x / f64::from(local.r_n * local.cos_lat),
        height: here.height + offset.z,
    };
    let one = Vector3::repeat(1.0);
    let r = Position::new(there, one, 1.0).unwrap().of(antenna());
    // f32 of 3 m and of the radii
    assert!(
        r.linearize(&nav).nu.amax() < 2e-6,
        "{}",
        r.linearize(&nav).nu
    );
    let v = nav.v_n() + motion.cast();
    let v = Velocity::new(v, one, 1.0).unwrap().of(antenna());
    // f32 of 20 m/s
    assert!(
        v.linearize(&nav).nu.amax() < 6e-6,
        "{}",
        v.linearize(&nav).nu
    );
    // and the lever arm matters, in every component
    assert!(
        offset.abs().min() > 0.01 && motion.abs().min() > 0.01,
        "{offset} {motion}"
    );
    // front-right-down says the same
    let frd = Antenna::new(Frd(Vector3::new(2.5, 0.7, 1.3))).unwrap();
    assert_eq!(frd, antenna());
}

#[test]
fn wheels_and_course_where_the_vehicle_goes() {
    // A vehicle whose own axes stand at a boresight to the IMU's moves along them, seen from the wheel.
    let nav = turning();
    let c_n_m = (nav.c_b_n() * mounting().c_m_b()).transpose();
    let at_wheel = nav.v_n() + nav.c_b_n() * (RATE - B_G).cross(&LEVER);
    let v_m = c_n_m * at_wheel;
    let model = Odometer::new(7.0, antenna(), mounting(), Vector3::repeat(1.0), 0.0).unwrap();
    let expected = Vector3::new(0.0, 7.0, 0.0) - v_m;
    assert!((model.linearize(&nav).nu - expected).amax() < 1e-5);
    // forward axis of the vehicle in n
    let u = nav.c_b_n() * mounting().c_m_b() * Vector3::y();
    let heading = f64::from(u.x).atan2(f64::from(u.y)) as f32;
    for (z, nu) in [
        (heading + 0.1, 0.1),
        (heading - 0.2, -0.2),
        (heading - 6.0, core::f32::consts::TAU - 6.0),
    ] {
        let course = Course::new(z, mounting(), 0.02, 1.0).unwrap();
        assert!((course.linearize(&nav).nu.x - nu).abs() < 1e-6);
    }
    // 25° to the right of the IMU's forward axis when level: heading 130° + 25°
    let level = NavState::new(
        place(),
        Vector3::zeros(),
        Euler::from_degrees(130.0, 0.0, 0.0),
    )
    .unwrap();
    let right = Boresight::new(Euler::from_degrees(25.0, 0.0, 0.0)).unwrap();
    let course = Course::new(155f32.to_radians(), right, 0.02, 1.0).unwrap();
    assert!(course.linearize(&level).nu.x.abs() < 1e-6);
}

#[test]
fn course_of_a_velocity_has_its_accuracy() {
    let make = |v: Vector3<f32>| Course::of_velocity(v, 0.1, 0.03, Boresight::NONE, 1.0);
    let nav = NavState::new(
        place(),
        Vector3::zeros(),
        Euler::from_degrees(0.0, 0.0, 0.0),
    )
    .unwrap();
    let lin = make(Vector3::new(2.0, 0.0, 5.0)).unwrap().linearize(&nav);
    assert!((lin.nu.x - core::f32::consts::FRAC_PI_2).abs() < 1e-6);
    assert!((lin.r.x - (0.05 * 0.05 + 0.03 * 0.03)).abs() < 1e-8);
    // no course below 5 σ
    assert_eq!(make(Vector3::new(0.0, 0.4, 9.0)), Err(Error::OutOfRange));
    assert_eq!(
        make(Vector3::new(f32::NAN, 1.0, 0.0)),
        Err(Error::NonFinite)
    );
}

#[test]
fn decorrelated_rows_carry_the_same_information() {
    // Hᵀ R⁻¹ H and Hᵀ R⁻¹ ν of the correlated measurement and of the rows.
    let nav = turning();
    let plain = Position::new(place(), Vector3::repeat(1.0), 0.2)
        .unwrap()
        .of(antenna())
        .linearize(&nav);
    let r = Matrix3::new(4.0, -1.0, 0.5, -1.0, 9.0, 2.0, 0.5, 2.0, 25.0);
    let inverse = r.try_inverse().unwrap();
    let rows = position().linearize(&nav);
    let (h, g) = (plain.dense(), rows.dense());
    let d = Matrix3::from_diagonal(&rows.r.map(|x| 1.0 / x));
    let information: SMatrix<f32, N, N> = h.transpose() * inverse * h - g.transpose() * d * g;
    // elements up to 3: f32
    assert!(information.amax() < 1e-5);
    let state = h.transpose() * inverse * plain.nu - g.transpose() * d * rows.nu;
    assert!(state.amax() < 1e-5);
}

#[test]
fn what_cannot_be_is_refused() {
    for bad in [f32::NAN, f32::INFINITY] {
        let v = Vector3::new(0.0, bad, 0.0);
        assert_eq!(Antenna::new(v), Err(Error::NonFinite));
        let b = Boresight::new(Euler {
            heading: bad,
            pitch: 0.0,
            roll: 0.0,
        });
        assert_eq!(b, Err(Error::NonFinite));
        assert_eq!(
            Course::new(bad, Boresight::NONE, 0.1, 1.0),
            Err(Error::NonFinite)
        );
        let one = Vector3::repeat(1.0);
        assert_eq!(
            Odometer::new(bad, antenna(), Boresight::NONE, one, 1.0),
            Err(Error::NonFinite)
        );
        assert!(Odometer::new(1.0, antenna(), Boresight::NONE, v, 1.0).is_err());
        assert!(NonHolonomic::new(antenna(), Boresight::NONE, bad, 1.0, 1.0).is_err());
    }
    assert_eq!(
        Antenna::new(Vector3::new(0.0, 500.0, 0.0)),
        Err(Error::OutOfRange)
    );
    assert_eq!(
        Course::new(7.0, Boresight::NONE, 0.1, 1.0),
        Err(Error::OutOfRange)
    );
}
