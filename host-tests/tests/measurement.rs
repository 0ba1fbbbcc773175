//! Each measurement: its Jacobian is the derivative of its innovation at a tilted, moving, biased state; its innovation
//! is exact where f32 alone would not be; and what cannot be is refused.

use core::f32::consts::TAU;

use nalgebra::{SMatrix, SVector, Vector3};
use navsight::attitude::{Euler, Ned};
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::error_model::{N, POS, VEL};
use navsight::measurement::{
    Heading, Height, Jacobian, Linearized, MeasurementRows, Position, Velocity, ZeroRotation,
    ZeroVelocity, MAX_SIGMA, MIN_SIGMA,
};
use navsight::nav::NavState;

const LAT_DEG: f64 = 47.3;
const SPEED: f64 = 250.0;
/// Smallest radius, for bounds [m]
const R: f64 = 6_356_752.0;

/// Identity attitude, standstill and zero biases would hide signs.
fn tilted_and_moving() -> NavState {
    NavState::new(
        Geodetic::from_degrees(LAT_DEG, 8.5, 2_345.678),
        Vector3::new(150.0, -200.0, 4.0),
        Euler::from_degrees(130.0, 20.0, -35.0),
    )
    .and_then(|nav| {
        nav.with_biases(
            Vector3::new(1e-3, -2e-3, 3e-3),
            Vector3::new(0.1, 0.2, -0.3),
        )
    })
    .unwrap()
}

/// A step of each kind of state, exact in f32 and large enough that its effect is not rounding: m, m/s, rad, rad/s,
/// m/s².
const STEPS: [f32; 5] = [16.0, 0.5, 1.0 / 64.0, 1.0 / 64.0, 1.0 / 64.0];

fn worst_column_error<const M: usize, H: MeasurementRows<M>>(
    linearize: impl Fn(&NavState) -> Linearized<M, H>,
    tolerance: [f64; 5],
) {
    let nav = tilted_and_moving();
    let here = linearize(&nav);
    let h = here.dense();
    for j in 0..N {
        let step = STEPS[j / 3];
        let moved = linearize(&nav.corrected(&SVector::ith(j, step)));
        let numeric = (here.nu - moved.nu) / step;
        let error = f64::from((numeric - h.column(j)).amax());
        assert!(
            error <= tolerance[j / 3],
            "column {j}: {error:e}, {numeric}"
        );
    }
}

/// The turn of v̂ with a position correction, which the velocity rows leave out: |v| tanL'/R with the level part 1.
fn relevelling() -> f64 {
    SPEED / R * (1.0 + LAT_DEG.to_radians().tan().powi(2)).sqrt()
}

#[test]
fn zero_velocity_rows_are_the_derivative() {
    let model = ZeroVelocity::new(0.01, 1.0).unwrap();
    // an ulp of 200 m/s is 1.5e-5, two of them over a step of 0.5 m/s or 1/64
    let ulp = 1.6e-5;
    worst_column_error(
        |nav| model.linearize(nav),
        [relevelling() + 2.0 * ulp / 16.0, 4.0 * ulp, 0.0, 0.0, 0.0],
    );
}

#[test]
fn velocity_rows_are_the_derivative() {
    let model =
        Velocity::new(Vector3::new(151.0, -200.5, 3.75), Vector3::repeat(0.1), 1.0).unwrap();
    // ν near 1 m/s: the second word of v is used, an ulp is 1e-7
    worst_column_error(
        |nav| model.linearize(nav),
        [relevelling() + 1e-7, 1e-6, 0.0, 0.0, 0.0],
    );
}

#[test]
fn what_the_velocity_rows_leave_out_is_there() {
    let nav = tilted_and_moving();
    let model = Velocity::new(nav.v_n(), Vector3::repeat(0.1), 1.0).unwrap();
    let moved = model.linearize(&nav.corrected(&SVector::ith(POS, 16.0)));
    let largest = f64::from((moved.nu / 16.0).norm());
    assert!(largest > 0.5 * relevelling(), "{largest:e}");
}

#[test]
fn position_rows_are_the_derivative() {
    let there = Geodetic::from_degrees(LAT_DEG + 1e-4, 8.5 - 1e-4, 2_340.0);
    let model = Position::new(there, Vector3::new(3.0, 3.0, 5.0), 1.0).unwrap();
    // ν of 11 m and f32 radii: 1e-6 m over 16 m, 2e-7 of the value; second order (11 + 16) m tanL/R = 5e-6
    worst_column_error(|nav| model.linearize(nav), [6e-6, 0.0, 0.0, 0.0, 0.0]);
}

#[test]
fn height_row_is_the_derivative() {
    let model = Height::new(2_340.0, 1.0, 1.0).unwrap();
    // ν of 6 m: 5e-7 m over 16 m
    worst_column_error(|nav| model.linearize(nav), [1e-7, 0.0, 0.0, 0.0, 0.0]);
}

/// Central differences, for rows that are not linear: their error is of third order in the step.
fn worst_central_error<const M: usize, H: MeasurementRows<M>>(
    linearize: impl Fn(&NavState) -> Linearized<M, H>,
    steps: [f32; 5],
    tolerance: [f64; 5],
) {
    let nav = tilted_and_moving();
    let h = linearize(&nav).dense();
    for j in 0..N {
        let step = steps[j / 3];
        let at = |step| linearize(&nav.corrected(&SVector::ith(j, step))).nu;
        let numeric = (at(-step) - at(step)) / (2.0 * step);
        let error = f64::from((numeric - h.column(j)).amax());
        assert!(
            error <= tolerance[j / 3],
            "column {j}: {error:e}, {numeric} {}",
            h.column(j)
        );
    }
}

#[test]
fn heading_row_is_the_derivative() {
    // The forward axis is 20° steep; the others are a baseline across and a field that points far down.
    for (axis, azimuth) in [
        (Vector3::new(0.0, 1.0, 0.0), 2.2),
        (Vector3::new(0.9, -0.3, 0.1), -3.0),
        (Vector3::new(-10.0, 12.0, -45.0), 0.1),
    ] {
        let model = Heading::of_axis(axis, azimuth, 0.01, 1.0).unwrap();
        let steep = {
            let l = tilted_and_moving().c_b_n() * axis.normalize();
            f64::from(l.z / l.x.hypot(l.y))
        };
        // third order: step² times the cube of 1/ρ; an ulp of ν up to π is 2.4e-7 over a difference of 1/32. A position
        // step of 30 km turns the frame by 5 mrad, and the radii by 1e-3 of themselves.
        let third = (1.0 / 64f64).powi(2) * (1.0 + steep * steep).powf(1.5);
        worst_central_error(
            |nav| model.linearize(nav),
            [30_000.0, 0.5, 1.0 / 64.0, 1.0 / 64.0, 1.0 / 64.0],
            [
                1e-3 * (2.0 + steep.abs()) / R,
                0.0,
                third + 1.6e-5,
                0.0,
                0.0,
            ],
        );
    }
}

#[test]
fn heading_of_the_vehicle_is_the_euler_angle_and_wraps() {
    let nav = tilted_and_moving();
    let heading = nav.euler().heading;
    for (z, nu) in [
        (heading, 0.0),
        (heading + 3.0, 3.0),
        (heading - 6.0, TAU - 6.0),
    ] {
        let found = Heading::new(z, 0.01, 1.0).unwrap().linearize(&nav).nu.x;
        assert!((found - nu).abs() < 1e-6, "{found} {nu}");
    }
    // an axis that stands on end has no azimuth
    let up = nav.c_b_n().transpose() * Vector3::new(0.001, 0.0, 1.0);
    let lost = Heading::of_axis(up, 0.0, 0.01, 1.0)
        .unwrap()
        .linearize(&nav);
    assert!(lost.nu.x.is_nan());
}

#[test]
fn zero_rotation_rows_are_the_derivative() {
    let nav = tilted_and_moving();
    let model = ZeroRotation::new(Vector3::new(2e-3, -1e-3, 3e-3), 1e-4, 1.0).unwrap();
    let earth = nav.c_b_n().transpose() * nav.local().omega_ie_n();
    let expected = Vector3::new(2e-3, -1e-3, 3e-3) - nav.b_g() - earth;
    // an ulp of 3e-3
    assert!((model.linearize(&nav).nu - expected).amax() < 3e-10);
    // The earth rate is 7.3e-5: with steps of 1/2 rad its change is seen to 2e-9 and the third order takes a part of
    // step²/6; 600 km of position move it by a tenth.
    let rate = navsight::earth::OMEGA_IE;
    worst_central_error(
        |nav| model.linearize(nav),
        [600e3, 0.5, 0.5, 1.0 / 64.0, 1.0 / 64.0],
        [
            0.05 * rate / R,
            0.0,
            rate * (0.25 / 6.0) * 1.2 + 2e-9,
            1e-6,
            0.0,
        ],
    );
    // What is there at all stands well above that tolerance: the earth rate itself.
    let h = model.linearize(&nav).dense();
    assert!(f64::from(h.column(6).norm()) > 0.9 * rate);
}

#[test]
fn a_centimetre_is_seen_far_from_the_origin() {
    // f32 radians are 0.4 m apart at 160°, f32 metres 1 mm at 9 km; the two words keep what the receiver says.
    let at = Geodetic::from_degrees(-37.123_456_789, 160.987_654_321, 9_123.456_7);
    let nav = NavState::new(at, Vector3::zeros(), Euler::from_degrees(0.0, 0.0, 0.0)).unwrap();
    let there = Geodetic {
        lat: at.lat + 0.01 / 6.366e6,
        lon: at.lon - 0.02 / 5.1e6,
        height: at.height + 0.003,
    };
    let nu = Position::new(there, Vector3::repeat(0.01), 0.1)
        .unwrap()
        .linearize(&nav)
        .nu;
    // 1 % for the round radii of this test; the second words end at 4e-15 rad and 3e-11 m
    assert!(
        (nu - Vector3::new(-0.02, 0.01, 0.003))
            .component_div(&nu)
            .amax()
            < 0.01,
        "{nu}"
    );
    let nu = Height::new(there.height, 0.01, 0.1)
        .unwrap()
        .linearize(&nav)
        .nu
        .x;
    assert!((nu - 0.003).abs() < 1e-8, "{nu}");
}

#[test]
fn a_velocity_below_the_last_place_is_seen() {
    let nav = tilted_and_moving();
    let z = Velocity::new(nav.v_n(), Vector3::repeat(0.1), 1.0).unwrap();
    for i in 0..3 {
        // less than a half of the last place: it goes into the second word
        let d = nav.v_n()[i].abs() / 2f32.powi(26);
        let moved = nav.corrected(&SVector::ith(VEL + i, d));
        assert_eq!(moved.v_n(), nav.v_n());
        let change = z.linearize(&moved).nu - z.linearize(&nav).nu;
        assert!(
            d > 0.0 && (change - Vector3::ith(i, d)).amax() < 1e-3 * d,
            "{change}"
        );
    }
}

#[test]
fn the_short_way_is_taken_across_the_180th_meridian() {
    let nav = NavState::new(
        Geodetic::from_degrees(0.0, 179.999_99, 0.0),
        Vector3::zeros(),
        Euler::from_degrees(0.0, 0.0, 0.0),
    )
    .unwrap();
    let z = Geodetic::from_degrees(0.0, -179.999_99, 0.0);
    let nu = Position::new(z, Vector3::repeat(1.0), 1.0)
        .unwrap()
        .linearize(&nav)
        .nu;
    assert!((nu.x - 2.226).abs() < 1e-3 && nu.y == 0.0, "{nu}"); // 2e-5° of 111.32 km
}

#[test]
fn signs_of_the_innovation_are_measured_minus_estimated() {
    let nav = tilted_and_moving();
    let v = Velocity::new(
        nav.v_n() + Vector3::new(1.0, 2.0, 3.0),
        Vector3::repeat(0.5),
        2.0,
    )
    .unwrap();
    let lin = v.linearize(&nav);
    assert_eq!(lin.nu, Vector3::new(1.0, 2.0, 3.0));
    assert_eq!((lin.r, lin.interval), (Vector3::repeat(0.25), 2.0));
    assert_eq!(lin.h, Jacobian::Direct { first: VEL });
    let ned = Velocity::new(
        Ned(Vector3::new(-199.0, 150.0, -3.0)),
        Vector3::repeat(0.5),
        2.0,
    )
    .unwrap();
    assert_eq!(ned.linearize(&nav).nu, Vector3::new(0.0, 1.0, -1.0));
    assert_eq!(
        ZeroVelocity::new(0.1, 0.0).unwrap().linearize(&nav).nu,
        -nav.v_n()
    );
}

#[test]
fn direct_rows_written_out() {
    let mut expected = SMatrix::<f32, 3, N>::zeros();
    for row in 0..3 {
        expected[(row, VEL + row)] = -1.0;
    }
    assert_eq!(
        Jacobian::<3>::Direct { first: VEL }.kind().dense(),
        expected
    );
    assert_eq!(
        Jacobian::<3>::Dense(expected * 2.0).kind().dense(),
        expected * 2.0
    );
    // beyond the states: nothing to see, and no panic; the filter refuses it
    assert_eq!(
        Jacobian::<1>::Direct { first: usize::MAX }.kind().dense(),
        SMatrix::<f32, 1, N>::zeros()
    );
}

#[test]
fn what_cannot_be_is_refused() {
    let zero = Vector3::zeros();
    let one = Vector3::repeat(1.0);
    let place = Geodetic::from_degrees(10.0, 20.0, 30.0);
    for (sigma, error) in [
        (f32::NAN, Error::NonFinite),
        (f32::INFINITY, Error::NonFinite),
        (f32::NEG_INFINITY, Error::NonFinite),
        (0.0, Error::OutOfRange),
        (-0.0, Error::OutOfRange),
        (-1.0, Error::OutOfRange),
        (MIN_SIGMA / 2.0, Error::OutOfRange),
        (MAX_SIGMA * 2.0, Error::OutOfRange),
    ] {
        assert_eq!(ZeroVelocity::new(sigma, 1.0), Err(error));
        assert_eq!(Height::new(0.0, sigma, 1.0), Err(error));
        assert_eq!(Heading::new(0.0, sigma, 1.0), Err(error));
        assert_eq!(ZeroRotation::new(zero, sigma, 1.0), Err(error));
        for axis in 0..3 {
            let mut sigmas = one;
            sigmas[axis] = sigma;
            assert_eq!(Velocity::new(zero, sigmas, 1.0), Err(error));
            assert_eq!(Position::new(place, sigmas, 1.0), Err(error));
        }
    }
    for interval in [f32::NAN, f32::INFINITY] {
        assert_eq!(ZeroVelocity::new(1.0, interval), Err(Error::NonFinite));
        assert_eq!(Height::new(0.0, 1.0, interval), Err(Error::NonFinite));
        assert_eq!(Heading::new(0.0, 1.0, interval), Err(Error::NonFinite));
        assert_eq!(
            ZeroRotation::new(zero, 1.0, interval),
            Err(Error::NonFinite)
        );
        assert_eq!(Velocity::new(zero, one, interval), Err(Error::NonFinite));
        assert_eq!(Position::new(place, one, interval), Err(Error::NonFinite));
    }
    for axis in 0..3 {
        for (value, error) in [
            (f32::NAN, Error::NonFinite),
            (f32::INFINITY, Error::NonFinite),
            (1e5, Error::OutOfRange),
        ] {
            let mut z = zero;
            z[axis] = value;
            assert_eq!(Velocity::new(z, one, 1.0), Err(error));
            assert_eq!(ZeroRotation::new(z, 1.0, 1.0), Err(error));
            assert_eq!(Heading::new(value, 1.0, 1.0), Err(error));
            z[axis] *= 100.0;
            assert_eq!(Heading::of_axis(z, 0.0, 1.0, 1.0), Err(error));
        }
    }
    assert_eq!(
        Heading::of_axis(zero, 0.0, 1.0, 1.0),
        Err(Error::OutOfRange)
    );
    for (z, error) in [
        (f64::NAN, Error::NonFinite),
        (f64::NEG_INFINITY, Error::NonFinite),
        (1e7, Error::OutOfRange),
        (-1e5, Error::OutOfRange),
    ] {
        assert_eq!(Height::new(z, 1.0, 1.0), Err(error));
        assert_eq!(
            Position::new(Geodetic { height: z, ..place }, one, 1.0),
            Err(error)
        );
    }
    for (lat, lon, error) in [
        (f64::NAN, 0.0, Error::NonFinite),
        (0.0, f64::INFINITY, Error::NonFinite),
        (1.5, 0.0, Error::Polar),
        (0.0, 10.0, Error::OutOfRange),
    ] {
        assert_eq!(
            Position::new(Geodetic { lat, lon, ..place }, one, 1.0),
            Err(error)
        );
    }
}
