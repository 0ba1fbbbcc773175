//! What a correction of the nominal state means: the signs of the conventions, checked in the earth-fixed frame.

use host_tests::sim::DEG;
use nalgebra::{Matrix3, Rotation3, SVector, Vector3};
use navsight::attitude::Euler;
use navsight::earth::{radii, Geodetic};
use navsight::error::Error;
use navsight::linalg::Two;
use navsight::nav::NavState;

type Dx = SVector<f32, 15>;

fn dx(parts: &[(usize, f32)]) -> Dx {
    let mut dx = Dx::zeros();
    for &(i, x) in parts {
        dx[i] = x;
    }
    dx
}

fn tilted() -> NavState {
    let at = Geodetic::from_degrees(47.0, -170.0, 1200.0);
    NavState::new(
        at,
        Vector3::new(120.0, -80.0, 5.0),
        Euler::from_degrees(130.0, 25.0, -40.0),
    )
    .unwrap()
}

fn v_n(nav: &NavState) -> Vector3<f64> {
    Vector3::from(nav.strapdown().v_n.map(Two::wide))
}

fn c_b_n(nav: &NavState) -> Matrix3<f64> {
    navsight::attitude::c_b_n(nav.strapdown().q.map(Two::wide))
}

/// East-north-up to earth-fixed axes.
fn c_n_e(p: &Geodetic) -> Matrix3<f64> {
    let ((sl, cl), (so, co)) = (p.lat.sin_cos(), p.lon.sin_cos());
    Matrix3::new(-so, -sl * co, cl * co, co, -sl * so, cl * so, 0.0, cl, sl)
}

/// Each single correction against the conventions of the crate, to second order of the step.
#[test]
fn one_state_at_a_time() {
    let nav = tilted();
    let (r_m, r_n) = radii(nav.position().lat.sin());
    let (r_m, r_n) = (r_m + 1200.0, r_n + 1200.0);
    let (lat, lon) = (nav.position().lat, nav.position().lon);
    // Steps of metres and m/s. 1e-6: rounding to f32 of the step; for angles 3e-14 is a tenth of a micrometre.
    let p = nav.corrected(&dx(&[(0, 3.0)])).position();
    assert!((p.lon - (lon - 3.0 / (r_n * lat.cos()))).abs() < 1e-13 && p.lat == lat);
    let p = nav.corrected(&dx(&[(1, 3.0)])).position();
    assert!((p.lat - (lat - 3.0 / r_m)).abs() < 1e-13 && p.lon == lon);
    let p = nav.corrected(&dx(&[(2, 3.0)])).position();
    assert!((p.height - 1197.0).abs() < 1e-6);
    for axis in 0..3 {
        let moved = nav.corrected(&dx(&[(3 + axis, 0.25)]));
        let expected = v_n(&nav) - Vector3::ith(axis, 0.25);
        assert!((v_n(&moved) - expected).amax() < 1e-9);
        assert_eq!(moved.quaternion(), nav.quaternion());

        let moved = nav.corrected(&dx(&[(9 + axis, 1e-3), (12 + axis, 2e-3)]));
        assert_eq!(moved.b_g(), Vector3::ith(axis, 1e-3));
        assert_eq!(moved.b_a(), Vector3::ith(axis, 2e-3));

        // Ĉ = (I − [ψ×]) C, so that the truth is (I + [ψ×]) Ĉ: a proper rotation, small or large.
        for angle in [1e-6_f64, 1e-3, 20.0 * DEG, 170.0 * DEG, 350.0 * DEG] {
            let moved = nav.corrected(&dx(&[(6 + axis, angle as f32)]));
            let turn = Rotation3::new(Vector3::ith(axis, f64::from(angle as f32)));
            let error = (c_b_n(&moved) - turn.matrix() * c_b_n(&nav)).amax();
            // The increment of the quaternion in f32, a few of its roundings: relative to the angle, or to 2π where
            // the series is long.
            assert!(
                error < 3e-7 * angle.min(1.0) + 1e-6 * (angle > 1.0) as u8 as f64,
                "{angle}: {error:e}"
            );
            assert_eq!(moved.v_n(), nav.v_n());
        }
    }
}

/// A position error does not turn the vehicle: its attitude and velocity against the earth stay, and so must change in
/// the level frame of the corrected position.
#[test]
fn a_position_correction_turns_the_level_frame() {
    let nav = tilted();
    for (east, north) in [(1000.0, 0.0), (0.0, 1000.0), (-700.0, 400.0)] {
        let moved = nav.corrected(&dx(&[(0, east), (1, north)]));
        let (before, after) = (c_n_e(&nav.position()), c_n_e(&moved.position()));
        // Second order: (1 km/R)² tan L = 3e-8, of the velocity as well.
        let turned = (before * c_b_n(&nav) - after * c_b_n(&moved)).amax();
        assert!(turned < 1e-7, "{turned:e}");
        let bent = (before * v_n(&nav) - after * v_n(&moved)).amax();
        assert!(bent < 144.0 * 1e-7, "{bent:e}");
        // The frame itself has turned by 1e-4: the check can fail.
        assert!((c_b_n(&nav) - c_b_n(&moved)).amax() > 5e-5);
    }
}

#[test]
fn a_correction_and_its_opposite_cancel() {
    let nav = tilted();
    let step = Dx::from_fn(|i, _| {
        [
            30.0, -20.0, 10.0, 0.3, -0.2, 0.1, 1e-3, -2e-3, 3e-3, 1e-4, 2e-4, -1e-4, 1e-3, -1e-3,
            2e-3,
        ][i]
    });
    let back = nav.corrected(&step).corrected(&-step);
    // Rotations about different axes commute to second order, 3e-3 · 5e-6; positions to (30 m)²/R, 1e-4 m.
    assert!((c_b_n(&back) - c_b_n(&nav)).amax() < 1e-7);
    assert!((v_n(&back) - v_n(&nav)).amax() < 1e-5);
    assert!(nav.displacement_to(&back.position()).unwrap().amax() < 1e-3);
    assert!((back.b_g() - nav.b_g()).amax() < 1e-11 && (back.b_a() - nav.b_a()).amax() < 1e-9);
}

#[test]
fn a_refused_correction_changes_no_bit() {
    let nav = tilted();
    let zero = nav.corrected(&Dx::zeros());
    assert_eq!(format!("{zero:?}"), format!("{nav:?}"));
    for i in 0..15 {
        for bad in [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::MAX,
            f32::MIN,
            1e10,
            -1e10,
        ] {
            let mut refused = nav;
            let outcome = refused.correct(&dx(&[(i, bad)]));
            assert!(outcome.is_err(), "{i} {bad}");
            if !bad.is_finite() {
                assert_eq!(outcome, Err(Error::NonFinite));
            }
            assert_eq!(format!("{refused:?}"), format!("{nav:?}"));
            assert_eq!(
                format!("{:?}", nav.corrected(&dx(&[(i, bad)]))),
                format!("{nav:?}")
            );
        }
    }
    let mut to_the_pole = nav;
    assert_eq!(to_the_pole.correct(&dx(&[(1, -4.0e6)])), Err(Error::Polar));
}

#[test]
fn the_start_is_checked() {
    let level = Euler::from_degrees(0.0, 0.0, 0.0);
    let start = |lat, lon, h, v| {
        NavState::new(
            Geodetic::from_degrees(lat, lon, h),
            Vector3::new(v, 0.0, 0.0),
            level,
        )
        .err()
    };
    assert_eq!(start(45.0, 0.0, 0.0, 0.0), None);
    assert_eq!(start(80.1, 0.0, 0.0, 0.0), Some(Error::Polar));
    assert_eq!(start(f64::NAN, 0.0, 0.0, 0.0), Some(Error::NonFinite));
    assert_eq!(start(0.0, f64::INFINITY, 0.0, 0.0), Some(Error::NonFinite));
    assert_eq!(start(0.0, 361.0, 0.0, 0.0), Some(Error::OutOfRange));
    assert_eq!(start(0.0, 0.0, 2e5, 0.0), Some(Error::OutOfRange));
    assert_eq!(start(0.0, 0.0, 0.0, f32::NAN), Some(Error::NonFinite));
    assert_eq!(start(0.0, 0.0, 0.0, 1e5), Some(Error::OutOfRange));
    // A longitude may be given from 0 to 360°.
    let nav = NavState::new(
        Geodetic::from_degrees(0.0, 270.0, 0.0),
        Vector3::zeros(),
        level,
    )
    .unwrap();
    assert!((nav.position().lon + 90.0 * DEG).abs() < 1e-12);
    let broken = Euler {
        heading: f32::NAN,
        ..level
    };
    let at = Geodetic::from_degrees(0.0, 0.0, 0.0);
    assert_eq!(
        NavState::new(at, Vector3::zeros(), broken).err(),
        Some(Error::NonFinite)
    );
    assert!(nav
        .with_biases(Vector3::repeat(2.0), Vector3::zeros())
        .is_err());
    assert!(nav
        .with_biases(Vector3::zeros(), Vector3::repeat(f32::NAN))
        .is_err());
}

/// z − ĥ of a position fix, over the 180° meridian and with the longitude given from 0 to 360°.
#[test]
fn displacement() {
    let nav = tilted();
    let here = nav.position();
    let (r_m, r_n) = radii(here.lat.sin());
    for (e, n, u) in [
        (0.001, -0.002, 0.003),
        (30.0, 40.0, -50.0),
        (1500.0, -900.0, 20.0),
    ] {
        for turn in [0.0, std::f64::consts::TAU] {
            let there = Geodetic {
                lat: here.lat + n / (r_m + here.height),
                lon: here.lon + e / ((r_n + here.height) * here.lat.cos()) + turn,
                height: here.height + u,
            };
            let d = nav.displacement_to(&there).unwrap().cast::<f64>();
            // f32 rounding of the displacement, and 1 ulp of a double longitude of 2π: 6 nm.
            assert!(
                (d - Vector3::new(e, n, u)).amax()
                    < 3e-7 * e.abs().max(n.abs()).max(u.abs()) + 1e-8,
                "{d:?}"
            );
        }
    }
    let west = NavState::new(
        Geodetic::from_degrees(0.0, -179.999, 0.0),
        Vector3::zeros(),
        Euler::from_degrees(0.0, 0.0, 0.0),
    )
    .unwrap();
    let d = west
        .displacement_to(&Geodetic::from_degrees(0.0, 179.999, 0.0))
        .unwrap();
    assert!((d.x + 222.64).abs() < 0.01 && d.y == 0.0, "{d:?}");
    assert_eq!(
        nav.displacement_to(&Geodetic {
            lat: f64::NAN,
            ..here
        }),
        Err(Error::NonFinite)
    );
}
