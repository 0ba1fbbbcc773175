//! The tracker once more, in double precision and from the equations of Fang 1998, (2)–(10): three axes as one dense
//! filter of nine states in SI units, Joseph form, all channels of an instant jointly with their full R.

use nalgebra::{SMatrix, SVector};

/// States: position, velocity, acceleration of three axes.
pub type Vector = SVector<f64, 9>;
/// Their covariance.
pub type Matrix = SMatrix<f64, 9, 9>;

/// The filter.
#[derive(Clone, Debug)]
pub struct Twin {
    /// Correlation time [s].
    pub tau: f64,
    /// Limit of the acceleration on both sides [m/s²]; variance by the paper's rule with floor 0.3, full beyond.
    pub limit: f64,
    /// Estimate.
    pub x: Vector,
    /// Covariance.
    pub p: Matrix,
}

impl Twin {
    /// Predicts: the state with Newton's matrix, P with Φ and Q.
    pub fn predict(&mut self, t: f64) {
        let (tau, d) = (self.tau, (-t / self.tau).exp());
        let (mut newton, mut phi, mut q) =
            (Matrix::identity(), Matrix::identity(), Matrix::zeros());
        for axis in 0..3 {
            let (i, j, k) = (axis, axis + 3, axis + 6);
            newton[(i, j)] = t;
            newton[(i, k)] = 0.5 * t * t;
            newton[(j, k)] = t;
            phi[(i, j)] = t;
            phi[(i, k)] = tau * tau * (-1.0 + t / tau + d);
            phi[(j, k)] = tau * (1.0 - d);
            phi[(k, k)] = d;
            let mut h = self.limit - self.x[k].abs();
            if h < 0.0 {
                h = self.limit;
            }
            let sigma2 = (4.0 - std::f64::consts::PI) / std::f64::consts::PI
                * h.max(0.3 * self.limit).powi(2);
            // ∫ g gᵀ by Simpson's rule: g is smooth, 200 parts leave 1e-12
            let parts = 1000;
            for n in 0..=parts {
                let s = t * f64::from(n) / f64::from(parts);
                let weight = match n {
                    0 => 1.0,
                    n if n == parts => 1.0,
                    n if n % 2 == 1 => 4.0,
                    _ => 2.0,
                };
                let e = -(-s / tau).exp_m1();
                // φ13 in series where it cancels
                let y = s / tau;
                let g1 = if y < 0.1 {
                    s * s
                        * (0.5 - y / 6.0 + y * y / 24.0 - y.powi(3) / 120.0 + y.powi(4) / 720.0
                            - y.powi(5) / 5040.0
                            + y.powi(6) / 40320.0
                            - y.powi(7) / 362_880.0)
                } else {
                    tau * tau * (y - e)
                };
                let g = [(i, g1), (j, tau * e), (k, 1.0 - e)];
                for (row, a) in g {
                    for (column, b) in g {
                        q[(row, column)] +=
                            2.0 * sigma2 / tau * weight * t / (3.0 * f64::from(parts)) * a * b;
                    }
                }
            }
        }
        self.x = newton * self.x;
        self.p = phi * self.p * phi.transpose() + q;
    }

    /// Takes in the channels of `used` (0–2 position, 3–5 velocity) with their covariance.
    pub fn update(&mut self, z: &SVector<f64, 6>, r: &SMatrix<f64, 6, 6>, used: &[bool; 6]) -> f64 {
        let mut h = SMatrix::<f64, 6, 9>::zeros();
        let mut noise = SMatrix::<f64, 6, 6>::identity();
        let mut nu = SVector::<f64, 6>::zeros();
        for i in 0..6 {
            if used[i] {
                h[(i, i)] = 1.0;
                nu[i] = z[i] - self.x[i];
                for j in 0..6 {
                    noise[(i, j)] = if used[j] { r[(i, j)] } else { 0.0 };
                }
            }
        }
        let s = h * self.p * h.transpose() + noise;
        let inverse = s.try_inverse().expect("R is positive");
        let k = self.p * h.transpose() * inverse;
        self.x += k * nu;
        let left = Matrix::identity() - k * h;
        let p = left * self.p * left.transpose() + k * noise * k.transpose();
        self.p = 0.5 * (p + p.transpose());
        nu.dot(&(inverse * nu))
    }
}
