//! WGS-84 against formulas that do not share a line with the library's.

use host_tests::reference::strapdown as twin;
use host_tests::sim::DEG;
use nalgebra::{Matrix3, Vector3};
use navsight::earth::{
    normal_gravity, omega_en_n, omega_ie_n, radii, Geodetic, Local, A, E2, F, GM, MAX_HEIGHT,
    MAX_LATITUDE, MIN_HEIGHT, OMEGA_IE,
};
use navsight::linalg::Two;

/// Latitudes from −80° to 80°, no two of them on nodes of the table.
fn latitudes() -> impl Iterator<Item = f64> {
    (-1600..=1600).map(|i| f64::from(i) * 0.05 * DEG)
}

fn heights() -> [f64; 6] {
    [
        f64::from(MIN_HEIGHT),
        -400.0,
        0.0,
        8848.0,
        20_000.0,
        f64::from(MAX_HEIGHT),
    ]
}

/// The claim in the documentation of [`Local`]: what the mechanization computes at a low rate in f32 against f64.
#[test]
fn local_values() {
    let (mut trig, mut relative) = (0.0_f64, 0.0_f64);
    for lat in latitudes() {
        for h in heights() {
            let local = Local::at_words(Two::of(lat), h as f32);
            let (r_m, r_n) = twin::radii(lat);
            trig = trig.max((f64::from(local.sin_lat) - lat.sin()).abs());
            trig = trig.max((f64::from(local.cos_lat) - lat.cos()).abs());
            for (ours, true_value) in [
                (local.tan_lat, lat.tan()),
                (local.inv_cos_lat, 1.0 / lat.cos()),
                (local.r_m, r_m + h),
                (local.r_n, r_n + h),
                (local.inv_r_m, 1.0 / (r_m + h)),
                (local.inv_r_n, 1.0 / (r_n + h)),
                (local.gravity, twin::gravity(lat, h)),
            ] {
                let error = (f64::from(ours) - true_value).abs();
                relative = relative.max(if true_value == 0.0 {
                    error
                } else {
                    error / true_value.abs()
                });
            }
        }
    }
    println!("sine and cosine {trig:.2e}, relative {relative:.2e}");
    assert!(trig < 6e-8 && relative < 4e-7);
}

/// One word of latitude is enough where 0.4 m do not matter.
#[test]
fn local_values_of_a_single_word() {
    for lat in latitudes() {
        let (one, two) = (
            Local::at(lat as f32, 100.0),
            Local::at_words(Two::of(lat as f32 as f64), 100.0),
        );
        assert_eq!(one, two);
    }
    assert!((f64::from(MAX_LATITUDE) - 80.0 * DEG).abs() < 1e-7);
}

/// Both scalars of the generic functions.
#[test]
fn radii_and_gravity_in_both_precisions() {
    for lat in latitudes() {
        let (r_m, r_n) = twin::radii(lat);
        let (m, n) = radii(lat.sin());
        assert!((m / r_m - 1.0).abs() < 1e-14 && (n / r_n - 1.0).abs() < 1e-14);
        let (m, n) = radii(lat.sin() as f32);
        assert!((f64::from(m) / r_m - 1.0).abs() < 3e-7 && (f64::from(n) / r_n - 1.0).abs() < 3e-7);
        for h in heights() {
            let g = twin::gravity(lat, h);
            // Somigliana's constant k has 12 digits, the gravity at the pole in the twin 13.
            assert!((normal_gravity(lat.sin(), h) / g - 1.0).abs() < 1e-11);
            assert!((f64::from(normal_gravity(lat.sin() as f32, h as f32)) / g - 1.0).abs() < 3e-7);
        }
    }
}

/// Normal gravity is the gradient of the potential of a level ellipsoid: its zonal terms J2, J4, J6 and the
/// centrifugal force, in geocentric coordinates. (up, north) [m/s²]
fn gravity_of_the_potential(lat: f64, h: f64) -> (f64, f64) {
    let (s, c) = lat.sin_cos();
    let n = A / (1.0 - E2 * s * s).sqrt();
    let (x, z) = ((n + h) * c, (n * (1.0 - E2) + h) * s);
    let r = x.hypot(z);
    let t = z / r;
    // (J, P_n, dP_n/dt)
    let terms = [
        (2, 1.082_629_821_313e-3, 1.5 * t * t - 0.5, 3.0 * t),
        (
            4,
            -2.370_911_200_53e-6,
            (35.0 * t.powi(4) - 30.0 * t * t + 3.0) / 8.0,
            (35.0 * t.powi(3) - 15.0 * t) / 2.0,
        ),
        (
            6,
            6.083_464_988_82e-9,
            (231.0 * t.powi(6) - 315.0 * t.powi(4) + 105.0 * t * t - 5.0) / 16.0,
            (693.0 * t.powi(5) - 630.0 * t.powi(3) + 105.0 * t) / 8.0,
        ),
    ];
    let (mut radial, mut along) = (-GM / (r * r), 0.0);
    for (n, j, p, dp) in terms {
        let q = GM / (r * r) * (A / r).powi(n) * j;
        radial += q * f64::from(n + 1) * p;
        along -= q * dp * (1.0 - t * t).sqrt();
    }
    // radial and northward of geocentric latitude to the axes of the meridian plane, then to up and north
    let (sg, cg) = (t, x / r);
    let gx = radial * cg - along * sg + OMEGA_IE * OMEGA_IE * x;
    let gz = radial * sg + along * cg;
    (gx * c + gz * s, gz * c - gx * s)
}

/// Somigliana and the height term against the potential: 1e-6 m/s² at the ellipsoid (the truncated series),
/// [`MAX_HEIGHT`]'s documented 2e-5, and the horizontal component that is left out.
#[test]
fn gravity_is_the_gradient_of_the_normal_potential() {
    for lat in latitudes().step_by(40) {
        for (h, bound) in [
            (0.0, 1e-7),
            (-20_000.0, 1e-6),
            (10_000.0, 1e-6),
            (100_000.0, 2e-5),
        ] {
            let (up, north) = gravity_of_the_potential(lat, h);
            let g = normal_gravity(lat.sin(), h);
            assert!(
                (-up / g - 1.0).abs() < bound,
                "{lat} {h}: {:e}",
                -up / g - 1.0
            );
            let left_out = -8.1e-9 * h * (2.0 * lat).sin();
            assert!(
                (north - left_out).abs() < 0.05 * left_out.abs() + 1e-6,
                "{lat} {h}: {north:e} {left_out:e}"
            );
        }
    }
}

fn c_n_e(lat: f64, lon: f64) -> Matrix3<f64> {
    let ((sl, cl), (so, co)) = (lat.sin_cos(), lon.sin_cos());
    Matrix3::new(-so, -sl * co, cl * co, co, -sl * so, cl * so, 0.0, cl, sl)
}

/// Earth rate is the axis of the earth seen in n; transport rate is how C_n^e turns while the vehicle moves.
#[test]
fn rates_of_the_local_level_frame() {
    for lat in latitudes().step_by(97) {
        let (lon, h) = (2.0, 9000.0);
        let axis = c_n_e(lat, lon).transpose() * Vector3::new(0.0, 0.0, OMEGA_IE);
        assert!((omega_ie_n(lat.sin(), lat.cos()) - axis).amax() < 1e-19);

        let v = Vector3::new(230.0, -150.0, 10.0);
        let (r_m, r_n) = twin::radii(lat);
        let (r_m, r_n) = (r_m + h, r_n + h);
        // Central difference over ±1 s: its error is the third derivative, 1e-12 of the rate.
        let at = |t: f64| c_n_e(lat + v.y / r_m * t, lon + v.x / (r_n * lat.cos()) * t);
        let dot = (at(1.0) - at(-1.0)) / 2.0;
        let skew = c_n_e(lat, lon).transpose() * dot;
        let numeric = Vector3::new(skew.m32, skew.m13, skew.m21);
        let ours = omega_en_n(&v, r_m, r_n, lat.tan());
        assert!(
            (ours - numeric).amax() < 1e-12 * 300.0,
            "{lat}: {ours:?} {numeric:?}"
        );
        let local = Local::at_words(Two::of(lat), h as f32);
        assert!((local.omega_en_n(&v.cast()).cast() - ours).amax() < 3e-7 * ours.amax());
        assert!((local.omega_ie_n().cast() - axis).amax() < 1.3e-7 * OMEGA_IE);
    }
}

#[test]
fn degrees_in_and_out() {
    let p = Geodetic::from_degrees(-33.25, 151.5, 12.0);
    let (lat, lon, h) = p.to_degrees();
    assert!((lat + 33.25).abs() < 1e-14 && (lon - 151.5).abs() < 1e-13 && h == 12.0);
    assert!((F - 1.0 / 298.257_223_563).abs() < 1e-18);
}
