//! Lu, Zhang & Yan 2009, "A real time estimation method of degree of observability for linear system using Kalman
//! filter": the printed tables, and the configuration that reproduces them.
//!
//! Each array has case 1 (one position, 600 s) first, then case 2 (half a turn from 300 s to 302 s). States in the
//! paper's order: position angles θx, θy, height, velocity E, N, U, attitude E, N, U, gyro bias x, y, z, accelerometer
//! bias x, y, z. Body axes start east-north-up, so gyro x is the east gyro.
//!
//! The row labels of Table 5 in circulating copies ("1. 4. 6. 6. …") are the leading digits of the first column, which
//! are put back here: height, up velocity and up accelerometer then add up to 2.19277e-4, the printed eigenvalue
//! 2.1927e-4 of the vertical block (the trace). Only the tenth row stays odd.

use crate::covariance_analysis::{Config, Constants, Model};

/// Names of the states in the paper's order.
pub const STATES: [&str; 15] = [
    "δθx", "δθy", "δh", "δV E", "δV N", "δV U", "ψ E", "ψ N", "ψ U", "gyro x", "gyro y", "gyro z",
    "acc x", "acc y", "acc z",
];

/// Table 5, ξ1 at 303 s [1/s].
pub const XI1: [[f64; 15]; 2] = [
    [
        1.5882e-6, 4.2873e-9, 6.9101e-8, 6.7902e-6, 6.8273e-6, 6.2778e-6, 5.2762e-8, 4.3999e-8,
        9.3488e-6, 1.6473e-6, 0.003376, 1.4939e-5, 0.0001026, 0.00013653, 0.00021293,
    ],
    [
        7.3496e-7, 1.2643e-7, 1.887e-7, 0.00032568, 0.00032569, 1.5001e-5, 6.2293e-5, 6.2314e-5,
        1.4732e-6, 5.716e-6, 0.00048255, 7.4565e-7, 0.47248, 0.47245, 0.00048245,
    ],
];

/// Table 5, ξ2 at 303 s.
pub const XI2: [[f64; 15]; 2] = [
    [
        1.0005, 1.0001, 5.5855e6, 1.8087e5, 1.8038e5, 1.8813e5, 6260.8, 6255.3, 402.64, 1.0237,
        9.1036, 1.0001, 1.0186, 1.0191, 1362.1,
    ],
    [
        1.0005, 1.0001, 4.4296e6, 26358.0, 26357.0, 1.2519e5, 25742.0, 25739.0, 402.21, 1.0237,
        9.0202, 1.0001, 15.595, 15.587, 1235.9,
    ],
];

/// Table 3, eigenvalues of M at 600 s [1/s], as printed.
pub const M: [[f64; 15]; 2] = [
    [
        0.00092376, 0.0001018, 0.00021927, 1.7946e-6, -1.3375e-6, -1.1548e-6, -5.912e-7, 6.408e-7,
        4.8943e-7, 1.8847e-9, 2.7866e-9, 7.1951e-11, 6.6502e-11, 1.2129e-11, 1.2253e-11,
    ],
    [
        0.0012268,
        0.00098282,
        0.00021927,
        -2.7396e-5,
        -2.7556e-5,
        -3.1746e-6,
        -2.8625e-6,
        2.6928e-6,
        7.2874e-7,
        6.0536e-7,
        2.7866e-9,
        -2.4466e-11,
        6.6709e-11,
        1.2386e-11,
        1.2732e-11,
    ],
];

/// Table 4, eigenvalues of T at 600 s, as printed.
pub const T: [[f64; 15]; 2] = [
    [
        0.056456, 1.0, 0.99998, 0.99881, 0.97761, 0.9821, 0.98022, 0.00073545, 0.00013481,
        5.4225e-6, 5.4254e-6, 4.0571e-6, 1.1503e-7, 7.3561e-8, 7.3562e-8,
    ],
    [
        0.99235, 0.99969, 0.99998, 0.063856, 0.063809, 0.0053952, 0.0011414, 0.00073545, 3.0741e-5,
        4.4689e-6, 4.6153e-6, 4.0571e-6, 3.3844e-8, 3.3893e-8, 1.1503e-7,
    ],
];

/// R of the Riccati equation is R times this in the paper, although the updates come every second [s].
pub const DELTA: f64 = 0.1;

/// The configuration that reproduces the tables: closed loop, biases of 20 h, external height damping, no update from
/// 298 s to 302 s. What the paper's text says, taken literally, does not.
pub fn config() -> Config {
    let arcsec = core::f64::consts::PI / 648_000.0;
    let (deg_h, g) = (arcsec, 9.8);
    let bias = 0.02 * deg_h;
    let accel = 100e-6 * g;
    Config {
        lat_deg: 37.4,
        interval: 1.0,
        qv: (9.7e-6 * g) * (9.7e-6 * g),
        qpsi: (0.002 * deg_h) * (0.002 * deg_h),
        tau_g: Some(72_000.0),
        tau_a: Some(72_000.0),
        r: 9e-7,
        r_height: None,
        model: Model::Psi,
        closed_loop: true,
        phi_order: 12,
        sub: 10,
        gap: [-2.0, 2.0],
        k1: 0.0257,
        k2: -2.8e-5,
        p0: "paper".into(),
        t_end: 600.0,
        sigma0: [
            10.0 * arcsec,
            10.0 * arcsec,
            10.0,
            0.15,
            0.15,
            0.15,
            0.5f64.to_radians(),
            0.5f64.to_radians(),
            2f64.to_radians(),
            bias,
            bias,
            bias,
            accel,
            accel,
            accel,
        ],
        constants: Constants {
            g,
            re: 6_378_137.0,
            wie: 7.292_115e-5,
        },
        pairs: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_printed_numbers_agree_with_each_other() {
        // The vertical block (height, up velocity, up accelerometer) is on its own: its ξ1 add up to its eigenvalues.
        // Five printed digits: 2.19277e-4 against 2.1927e-4 + 2.7866e-9 and a third one near zero.
        let sum = XI1[0][2] + XI1[0][5] + XI1[0][14];
        assert!((sum - (M[0][2] + M[0][10])).abs() < 1e-8, "{sum}");
        // 600 s against 303 s: this block is settled by then.
        assert_eq!(config().check(), Ok(()));
        assert!((config().qv - 9.036_403_6e-9).abs() < 1e-15);
    }
}
