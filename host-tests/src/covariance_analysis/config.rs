//! What a covariance analysis is told: the keys of the golden runs.

use serde::Deserialize;

use super::N;

/// One configuration. States: position angles θx = −δr_N/R, θy = +δr_E/R [rad], height [m], velocity east, north,
/// up [m/s], attitude east, north, up [rad], gyro bias x, y, z [rad/s], accelerometer bias x, y, z [m/s²].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Latitude [°].
    pub lat_deg: f64,
    /// Step and nominal update interval [s]; the T of ξ1 and of R·T.
    #[serde(rename = "T")]
    pub interval: f64,
    /// Process noise density of velocity, per axis [(m/s)²/s].
    pub qv: f64,
    /// Process noise density of attitude, per axis [rad²/s].
    pub qpsi: f64,
    /// Correlation time of the gyro biases [s]; none = constant.
    pub tau_g: Option<f64>,
    /// Correlation time of the accelerometer biases [s]; none = constant.
    pub tau_a: Option<f64>,
    /// Variance of a velocity row [(m/s)²].
    #[serde(rename = "R")]
    pub r: f64,
    /// Variance of the height row [m²]; none = no such row.
    #[serde(rename = "Rh")]
    pub r_height: Option<f64>,
    /// Which attitude error.
    pub model: Model,
    /// F is built about the attitude estimate that is fed back, wrong by 0.5° at the start.
    pub closed_loop: bool,
    /// Taylor order of Φ.
    pub phi_order: usize,
    /// Sub-steps of a step inside the turn.
    pub sub: usize,
    /// Case 2: no update for 300 + gap[0] < t ≤ 300 + gap[1] [s].
    pub gap: [f64; 2],
    /// External height damping, ḣ = v_U − k1 h [1/s].
    pub k1: f64,
    /// External height damping, v̇_U gets (2g/R − k2) h [1/s²].
    pub k2: f64,
    /// "paper": diag(σ0²); anything else: with the correlations of `pairs`.
    #[serde(rename = "P0")]
    pub p0: String,
    /// End of the run [s].
    pub t_end: f64,
    /// Prior standard deviations in state order.
    pub sigma0: [f64; N],
    /// The earth of the run.
    pub constants: Constants,
    /// Correlations of P0: two states and the coefficient.
    #[serde(rename = "nondiag_P0_corr_pairs", default)]
    pub pairs: Vec<(usize, usize, f64)>,
}

/// A sphere.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Constants {
    /// Gravity [m/s²].
    pub g: f64,
    /// Radius [m].
    pub re: f64,
    /// Earth rate [rad/s].
    pub wie: f64,
}

/// Psi angle, or phi angle with states 1, 2 = δlat, δlon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Model {
    /// Attitude against the frame at the estimated position.
    Psi,
    /// Attitude against the frame at the true position.
    Phi,
}

impl Config {
    /// The first field that is out of range, and why.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        let positive = |name, x: f64| {
            if x.is_finite() && x > 0.0 {
                Ok(())
            } else {
                Err((name, format!("{x} is not positive")))
            }
        };
        let not_negative = |name, x: f64| {
            if x.is_finite() && x >= 0.0 {
                Ok(())
            } else {
                Err((name, format!("{x} is negative or not finite")))
            }
        };
        if !(-80.0..=80.0).contains(&self.lat_deg) {
            return Err(("lat_deg", format!("{} is outside -80 … 80", self.lat_deg)));
        }
        positive("T", self.interval)?;
        not_negative("qv", self.qv)?;
        not_negative("qpsi", self.qpsi)?;
        self.tau_g.map_or(Ok(()), |tau| positive("tau_g", tau))?;
        self.tau_a.map_or(Ok(()), |tau| positive("tau_a", tau))?;
        positive("R", self.r)?;
        self.r_height.map_or(Ok(()), |r| positive("Rh", r))?;
        if !(1..=40).contains(&self.phi_order) {
            return Err(("phi_order", format!("{} is outside 1 … 40", self.phi_order)));
        }
        if !(1..=10_000).contains(&self.sub) {
            return Err(("sub", format!("{} is outside 1 … 10000", self.sub)));
        }
        if !(self.gap[0].is_finite() && self.gap[1].is_finite() && self.gap[0] <= self.gap[1]) {
            return Err(("gap", "must be two finite numbers in order".into()));
        }
        not_negative("k1", self.k1)?;
        if !self.k2.is_finite() {
            return Err(("k2", format!("{} is not finite", self.k2)));
        }
        positive("t_end", self.t_end)?;
        if self.t_end / self.interval > 1e7 {
            return Err(("t_end", "more than 10 million steps of T".into()));
        }
        for sigma in self.sigma0 {
            not_negative("sigma0", sigma)?;
        }
        positive("constants", self.constants.g)?;
        positive("constants", self.constants.re)?;
        not_negative("constants", self.constants.wie)?;
        for &(i, j, c) in &self.pairs {
            if i >= N || j >= N || i == j || !(-1.0..=1.0).contains(&c) {
                return Err((
                    "nondiag_P0_corr_pairs",
                    format!("[{i}, {j}, {c}] is not two states and a correlation"),
                ));
            }
        }
        Ok(())
    }
}
