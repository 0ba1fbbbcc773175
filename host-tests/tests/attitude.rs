//! Euler angles, quaternions and direction cosines: conventions, round trips at every attitude, and the typed edges.

use host_tests::sim::DEG;
use nalgebra::{Matrix3, Rotation3, Vector3};
use navsight::attitude::{
    c_b_n, normalized, product, quaternion_of, rotation_minus_one, Enu, Euler, Frd, FrdToNed, Ned,
    Rfu, RfuToEnu,
};
use navsight::error::Error;
use proptest::prelude::*;

/// Some roundings of f32 of numbers up to 1.
const ROUNDING: f32 = 8e-7;

fn close(a: &Matrix3<f32>, b: &Matrix3<f32>) -> bool {
    (a - b).amax() < ROUNDING
}

/// In words: heading 90° looks east; pitch lifts the nose; roll drops the right wing.
#[test]
fn conventions() {
    let right = Vector3::x();
    let forward = Vector3::y();
    let east = Euler::from_degrees(90.0, 0.0, 0.0).c_b_n();
    assert!(
        (east * forward - Vector3::x()).amax() < ROUNDING
            && (east * right + Vector3::y()).amax() < ROUNDING
    );
    let climbing = Euler::from_degrees(0.0, 30.0, 0.0).c_b_n();
    assert!((climbing * forward).z > 0.49 && (climbing * right - right).amax() < ROUNDING);
    let banked = Euler::from_degrees(0.0, 0.0, 30.0).c_b_n();
    assert!((banked * right).z < -0.49 && (banked * forward - forward).amax() < ROUNDING);
    // The matrix as a product of elementary rotations.
    let (h, p, r) = (1.0_f64, -0.4, 2.5);
    let about = |axis: Vector3<f64>, angle: f64| Rotation3::new(axis * angle).into_inner();
    let c = about(Vector3::z(), -h) * about(Vector3::x(), p) * about(Vector3::y(), r);
    let ours = Euler {
        heading: h as f32,
        pitch: p as f32,
        roll: r as f32,
    };
    assert!(close(&ours.c_b_n(), &c.cast()));
}

/// Every 5° of all three, the poles of the pitch included: matrix, quaternion and angles say the same.
#[test]
fn round_trips_everywhere() {
    for heading in (-180..=180).step_by(5) {
        for pitch in (-90_i32..=90).step_by(5) {
            for roll in (-180..=180).step_by(15) {
                let euler = Euler::from_degrees(heading as f32, pitch as f32, roll as f32);
                let c = euler.c_b_n();
                assert!((c.transpose() * c - Matrix3::identity()).amax() < ROUNDING);
                let q = euler.quaternion();
                assert!(close(&c_b_n(q), &c), "{euler:?}");
                let back = quaternion_of(&c).unwrap();
                assert!(close(&c_b_n(back), &c), "{euler:?}");
                let again = Euler::from_c_b_n(&c);
                assert!(close(&again.c_b_n(), &c), "{euler:?} {again:?}");
                assert!(again.pitch.abs() <= std::f32::consts::FRAC_PI_2);
                if pitch.abs() < 90 {
                    // Angles themselves: rounding grows as 1/cos pitch, 11 at 85°.
                    let error = (again.pitch - euler.pitch).abs();
                    assert!(error < 11.0 * ROUNDING, "{euler:?} {again:?}");
                    let turn = |x: f32| (x / std::f32::consts::TAU).round() * std::f32::consts::TAU;
                    for d in [again.heading - euler.heading, again.roll - euler.roll] {
                        assert!((d - turn(d)).abs() < 22.0 * ROUNDING, "{euler:?} {again:?}");
                    }
                }
            }
        }
    }
}

/// Straight up and straight down exactly, and a matrix of zeros: no NaN.
#[test]
fn vertical() {
    for sign in [1.0_f32, -1.0] {
        let c = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -sign, 0.0, sign, 0.0);
        let e = Euler::from_c_b_n(&c);
        assert_eq!((e.heading, e.roll), (0.0, 0.0));
        assert!((e.pitch - sign * std::f32::consts::FRAC_PI_2).abs() < ROUNDING);
    }
    let e = Euler::from_c_b_n(&Matrix3::zeros());
    assert!(e.heading.is_finite() && e.pitch.is_finite() && e.roll.is_finite());
    assert_eq!(
        quaternion_of(&Matrix3::<f32>::zeros()),
        Err(Error::OutOfRange)
    );
    assert_eq!(
        quaternion_of(&(-Matrix3::<f64>::identity())),
        Err(Error::OutOfRange)
    );
    assert_eq!(
        quaternion_of(&Matrix3::repeat(f32::NAN)),
        Err(Error::NonFinite)
    );
    assert_eq!(normalized([0.0_f32; 4]), Err(Error::OutOfRange));
    assert_eq!(
        normalized([f32::INFINITY, 0.0, 0.0, 0.0]),
        Err(Error::NonFinite)
    );
}

/// An autopilot's frames: front-right-down against north-east-down has the same three angles, and its matrix is ours
/// with rows and columns exchanged and signed.
#[test]
fn the_north_east_down_world() {
    let t = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let v = Vector3::new(1.0, 2.0, 3.0);
    assert_eq!(Enu::from(Ned(v)).0, t * v);
    assert_eq!(Ned::from(Enu(v)).0, t * v);
    assert_eq!(Rfu::from(Frd(v)).0, t * v);
    assert_eq!(Frd::from(Rfu(v)).0, t * v);
    // Yaw, pitch, roll of the aerospace sequence, from its own textbook matrix.
    let (yaw, pitch, roll) = (130.0 * DEG, -20.0 * DEG, 35.0 * DEG);
    let c_frd_ned = Rotation3::from_euler_angles(roll, pitch, yaw).into_inner();
    let ours = Euler::from_degrees(130.0, -20.0, 35.0);
    assert!(close(
        &ours.c_b_n(),
        &(t.cast::<f64>() * c_frd_ned * t.cast::<f64>()).cast()
    ));
    let q = quaternion_of(&c_frd_ned).unwrap().map(|x| x as f32);
    let RfuToEnu(converted) = FrdToNed(q).into();
    assert!(close(&c_b_n(converted), &ours.c_b_n()));
    let FrdToNed(back) = RfuToEnu(converted).into();
    assert_eq!(back, q);
}

proptest! {
    /// C(a∘b) = C(a)·C(b), and both are rotations.
    #[test]
    fn products(a in prop::array::uniform4(-1.0_f64..1.0), b in prop::array::uniform4(-1.0_f64..1.0)) {
        prop_assume!(a.iter().map(|x| x * x).sum::<f64>() > 0.01 && b.iter().map(|x| x * x).sum::<f64>() > 0.01);
        let (a, b) = (normalized(a).unwrap(), normalized(b).unwrap());
        let c = c_b_n(product(&a, &b));
        prop_assert!((c - c_b_n(a) * c_b_n(b)).amax() < 1e-14);
        prop_assert!((c.determinant() - 1.0).abs() < 1e-14);
    }

    /// The exponential against nalgebra's in f64, up to one turn, and with all its digits when it is small.
    #[test]
    fn exponentials(axis in prop::array::uniform3(-1.0_f64..1.0), exponent in -8.0_f64..0.798) {
        let axis = Vector3::from(axis);
        prop_assume!(axis.norm() > 0.1);
        let phi = (axis.normalize() * 10.0_f64.powf(exponent)).cast::<f32>();
        let q = nalgebra::UnitQuaternion::from_scaled_axis(phi.cast::<f64>());
        let [w, x, y, z] = rotation_minus_one(&phi);
        let angle = f64::from(phi.norm());
        // 3e-7: rounding; beyond a turn's half the alternating series loses another factor of ten.
        let bound = if angle < 1.0 { 3e-7 } else { 3e-6 };
        let w_minus_one = -2.0 * (0.25 * angle).sin().powi(2);
        prop_assert!((f64::from(w) - w_minus_one).abs() < bound * angle.min(1.0).powi(2));
        for (ours, theirs) in [(x, q.i), (y, q.j), (z, q.k)] {
            prop_assert!((f64::from(ours) - theirs).abs() < bound * angle.min(1.0));
        }
    }

    /// No matrix, however wild, makes an angle that is not a number, unless it holds one.
    #[test]
    fn angles_of_anything(m in prop::array::uniform9(-1e3_f32..1e3)) {
        let e = Euler::from_c_b_n(&Matrix3::from_row_slice(&m));
        prop_assert!(e.heading.is_finite() && e.pitch.is_finite() && e.roll.is_finite());
    }
}
