//! The two-position scenario of Lu, Zhang and Yan 2009 in double precision, written from the equations of the paper
//! in the paper's own states and units, with dense matrices and Joseph updates. It shares no kernel with the library.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::covariance_analysis::{Config, Model, N};

/// Dense matrix of all states.
pub type Dense = SMatrix<f64, N, N>;

/// One step of the run, just after the update (or after the prediction where there is none).
pub struct Step {
    /// Time at the end of the step [s].
    pub t: f64,
    /// P before the update.
    pub p_before: Dense,
    /// P after it.
    pub p: Dense,
    /// F of the step's rates.
    pub f: Dense,
    /// Φ − I of the step.
    pub a: Dense,
    /// Process noise density, diagonal.
    pub q: SVector<f64, N>,
    /// Measured states and the variance of their rows.
    pub rows: Vec<(usize, f64)>,
    /// Whether the step had an update.
    pub updated: bool,
}

/// P0 of a configuration.
pub fn p0(config: &Config) -> Dense {
    let mut corr = Dense::identity();
    if config.p0 != "paper" {
        for &(i, j, c) in &config.pairs {
            corr[(i, j)] = c;
            corr[(j, i)] = c;
        }
    }
    let sigma = Dense::from_diagonal(&SVector::from(config.sigma0));
    sigma * corr * sigma
}

/// Runs `case` (1 or 2) and hands every step to `each`.
pub fn run(config: &Config, case: u8, mut each: impl FnMut(&Step)) {
    let t_step = config.interval;
    let steps = (config.t_end / t_step).round() as usize;
    let mut p = p0(config);
    let mut error = SVector::<f64, N>::zeros();
    for i in 6..9 {
        error[i] = 0.5_f64.to_radians();
    }
    let q = noise(config);
    let mut rows: Vec<(usize, f64)> = (3..6).map(|i| (i, config.r)).collect();
    rows.extend(config.r_height.map(|r| (2, r)));

    for k in 1..=steps {
        let t = k as f64 * t_step;
        let psi = if config.closed_loop {
            error.fixed_rows::<3>(6).into_owned()
        } else {
            Vector3::zeros()
        };
        let turning = case == 2 && t > 300.0 && t - t_step < 302.0;
        let sub = if turning { config.sub } else { 1 };
        let (mut phi, mut phi_true) = (Dense::identity(), Dense::identity());
        for s in 0..sub {
            let mid = t - t_step + t_step * (s as f64 + 0.5) / sub as f64;
            let c = turned(case, mid);
            let dt = t_step / sub as f64;
            phi = taylor(&f_matrix(config, &c, &psi), dt, config.phi_order) * phi;
            phi_true = taylor(
                &f_matrix(config, &c, &Vector3::zeros()),
                dt,
                config.phi_order,
            ) * phi_true;
        }
        p = phi * p * phi.transpose() + Dense::from_diagonal(&(q * t_step));
        error = phi_true * error;
        let p_before = p;
        let updated = !(case == 2 && t > 300.0 + config.gap[0] && t <= 300.0 + config.gap[1]);
        if updated {
            for &(state, r) in &rows {
                let gain = p.column(state) / (p[(state, state)] + r);
                let mut left = Dense::identity();
                left.column_mut(state).zip_apply(&gain, |x, g| *x -= g);
                p = left * p * left.transpose() + gain * gain.transpose() * r;
                error -= gain * error[state];
            }
        }
        let f = f_matrix(config, &turned(case, t), &psi);
        let a = phi - Dense::identity();
        each(&Step {
            a,
            t,
            p_before,
            p,
            f,
            q,
            rows: rows.clone(),
            updated,
        });
    }
}

/// Eq. 17 with the measurement noise R·`interval`.
pub fn p_dot(step: &Step, interval: f64) -> Dense {
    let fp = step.f * step.p;
    let mut rate = fp + fp.transpose() + Dense::from_diagonal(&step.q);
    for &(state, r) in &step.rows {
        rate -= step.p.column(state) * step.p.column(state).transpose() / (r * interval);
    }
    rate
}

/// Attitude at time `t`: identity, then 90 °/s counter-clockwise from 300 s to 302 s in case 2.
fn turned(case: u8, t: f64) -> Matrix3<f64> {
    let yaw = if case == 2 {
        (t - 300.0).clamp(0.0, 2.0) * core::f64::consts::FRAC_PI_2
    } else {
        0.0
    };
    let (s, c) = yaw.sin_cos();
    Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
}

fn noise(config: &Config) -> SVector<f64, N> {
    SVector::from_fn(|i, _| match i {
        3..=5 => config.qv,
        6..=8 => config.qpsi,
        9..=11 => config
            .tau_g
            .map_or(0.0, |tau| 2.0 * config.sigma0[i].powi(2) / tau),
        12..=14 => config
            .tau_a
            .map_or(0.0, |tau| 2.0 * config.sigma0[i].powi(2) / tau),
        _ => 0.0,
    })
}

/// F about the attitude estimate C_est = (I − [ψ×]) C.
fn f_matrix(config: &Config, c_true: &Matrix3<f64>, psi: &Vector3<f64>) -> Dense {
    let (re, g) = (config.constants.re, config.constants.g);
    let (sin, cos) = config.lat_deg.to_radians().sin_cos();
    let w = Vector3::new(0.0, cos, sin) * config.constants.wie;
    let c = c_true - psi.cross_matrix() * c_true;
    let f_n = c * c_true.transpose() * Vector3::new(0.0, 0.0, g);
    let mut f = Dense::zeros();
    let mut block = |row: usize, column: usize, value: Matrix3<f64>| {
        f.view_mut((row, column), (3, 3)).copy_from(&value);
    };
    block(3, 3, -(w * 2.0).cross_matrix());
    // f × ψ = [f×] ψ
    block(3, 6, f_n.cross_matrix());
    block(3, 12, c);
    block(6, 6, -w.cross_matrix());
    block(6, 9, -c);
    f[(0, 4)] = -1.0 / re;
    f[(1, 3)] = 1.0 / re;
    f[(2, 5)] = 1.0;
    f[(2, 2)] = -config.k1;
    f[(5, 2)] = 2.0 * g / re - config.k2;
    match config.model {
        Model::Psi => {
            f[(3, 1)] = -g;
            f[(4, 0)] = g;
        }
        // states 0, 1 are δlat, δlon; φ̇ = −ω × φ + δω_ie + δω_en − C b
        Model::Phi => {
            (f[(0, 3)], f[(0, 4)]) = (0.0, 1.0 / re);
            (f[(1, 3)], f[(1, 4)]) = (1.0 / (re * cos), 0.0);
            (f[(7, 0)], f[(8, 0)]) = (-w.z, w.y);
            (f[(6, 4)], f[(7, 3)], f[(8, 3)]) = (-1.0 / re, 1.0 / re, sin / cos / re);
        }
    }
    for i in 0..3 {
        f[(9 + i, 9 + i)] = -config.tau_g.map_or(0.0, |tau| 1.0 / tau);
        f[(12 + i, 12 + i)] = -config.tau_a.map_or(0.0, |tau| 1.0 / tau);
    }
    f
}

fn taylor(f: &Dense, dt: f64, order: usize) -> Dense {
    let a = f * dt;
    let (mut term, mut sum) = (Dense::identity(), Dense::identity());
    for k in 1..=order {
        term = term * a / k as f64;
        sum += term;
    }
    sum
}
