//! Transfer functions of the tracker with steady gains: Fang 1998, section 4.
//!
//! ```text
//! x̂' = F₁ x̂ + K (H x − H x̂),   F₁ the triple integrator (the adaptive mean cancels −1/τ)
//! X̂(s) = (sI − F₁ + K H)⁻¹ K H X(s),   X = [1, s, s²]ᵀ X(s)
//! ```
//! The printed polynomials of the second and third row of (25), (26), (30), (31), (37), (38) are relative to the true
//! velocity s X(s) and acceleration s² X(s); the dots over X were lost in print.

use nalgebra::{Complex, Matrix2, Matrix3, Matrix3x2, SMatrix, SVector, Vector3};

/// Gains of a steady filter: a row per state; the second column, of velocity, is 0 for position alone.
pub type Gain = Matrix3x2<f64>;

/// Coefficients in falling powers of s, s³ first.
pub type Cubic = [f64; 4];

/// Value of a polynomial.
pub fn value(c: &Cubic, s: Complex<f64>) -> Complex<f64> {
    c.iter().fold(Complex::new(0.0, 0.0), |sum, c| sum * s + c)
}

/// What the printed equations say of a filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transfer {
    /// D(s), (25) and (32).
    pub denominator: Cubic,
    /// N₁ … N₃, (25) and (33)–(35): estimate over truth of position, velocity, acceleration.
    pub follows: [Cubic; 3],
    /// N′₁ … N′₃, (26) and (39)–(41): error over truth.
    pub misses: [Cubic; 3],
}

impl Transfer {
    /// From the gains; with position alone (32)–(41) become (25) and (26).
    pub fn of(k: &Gain) -> Self {
        let [[k11, k21, k31], [k12, k22, k32]] = k.data.0;
        let a = k11 + k22;
        let b = k32 + k21 + k11 * k22 - k12 * k21;
        let c = k11 * k32 - k12 * k31 + k31;
        Self {
            denominator: [1.0, a, b, c],
            follows: [[k12, a, b, c], [0.0, k22, b, c], [0.0, 0.0, k32, c]],
            misses: [
                [1.0 - k12, 0.0, 0.0, 0.0],
                [1.0, k11, 0.0, 0.0],
                [1.0, a, k21 + k11 * k22 - k12 * k21, 0.0],
            ],
        }
    }

    /// Highest ω [rad/s] at which the estimate of state i still follows the truth to −3 dB; infinite where it follows
    /// at any.
    pub fn bandwidth(&self, i: usize) -> f64 {
        let gain = |omega: f64| {
            let s = Complex::new(0.0, omega);
            (value(&self.follows[i], s) / value(&self.denominator, s)).norm_sqr()
        };
        if gain(1e6) >= 0.5 {
            return f64::INFINITY;
        }
        // from above to the last crossing, then bisection
        let mut high = 1e6;
        while high > 1e-9 && gain(high * 0.99) < 0.5 {
            high *= 0.99;
        }
        let mut low = high * 0.99;
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            *if gain(middle) < 0.5 {
                &mut high
            } else {
                &mut low
            } = middle;
        }
        low
    }

    /// Steady position error per jerk [m per m/s³].
    pub fn jerk_error(&self) -> f64 {
        self.misses[0][0] / self.denominator[3]
    }
}

/// Position in the local frame and its derivatives by the differential equation: estimate over truth at one s, the
/// truth being [1, s, s²]; `rate` is 1/τ with a fixed mean, 0 with the adaptive one.
pub fn response(k: &Gain, rate: f64, s: Complex<f64>) -> Option<Vector3<Complex<f64>>> {
    let h = nalgebra::Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    let f = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -rate);
    let complex = |x: f64| Complex::new(x, 0.0);
    let left = Matrix3::from_diagonal_element(s) - (f - k * h).map(complex);
    let truth = Vector3::new(complex(1.0), s, s * s);
    Some(left.try_inverse()? * (k * h).map(complex) * truth)
}

/// Largest error of position [m], velocity [m/s] and acceleration [m/s²] while a vehicle accelerates by `a` for
/// `lasts` [s] and for `after` [s] beyond; by the error's differential equation, free of noise.
pub fn pulse(k: &Gain, a: f64, lasts: f64, after: f64) -> Vector3<f64> {
    let h = nalgebra::Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    let f = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0) - k * h;
    let dt = 2e-3;
    // four terms of the exponential: (2e-3 · 3)⁵/5! is nothing
    let x = f * dt;
    let step =
        Matrix3::identity() + x * (Matrix3::identity() + x / 2.0 * (Matrix3::identity() + x / 3.0));
    let (mut e, mut peak) = (Vector3::new(0.0, 0.0, a), Vector3::zeros());
    let turn = (lasts / dt) as usize;
    for i in 1..=((lasts + after) / dt) as usize {
        e = step * e;
        peak = peak.sup(&e.abs());
        if i == turn {
            e.z -= a;
        }
    }
    peak
}

/// Steady gain of the continuous filter on Singer's F: noise 2σ²/τ, measurement densities `r_c` [m² s, m²/s];
/// `None` = no velocity.
///
/// The algebraic Riccati equation by Newton's method (Kleinman), each step a Lyapunov equation of nine unknowns.
pub fn continuous_gain(tau: f64, sigma2: f64, r_c: [f64; 2], velocity: bool) -> Option<Gain> {
    let f = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0 / tau);
    let h = nalgebra::Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    let inverse_r = Matrix2::new(
        1.0 / r_c[0],
        0.0,
        0.0,
        if velocity { 1.0 / r_c[1] } else { 0.0 },
    );
    let r = Matrix2::from_diagonal(&r_c.into());
    let mut q = Matrix3::zeros();
    q.m33 = 2.0 * sigma2 / tau;
    // any gain that is stable: three poles at −1 rad/s
    let mut k = Gain::new(3.0, 0.0, 3.0, 0.0, 1.0, 0.0);
    for _ in 0..80 {
        let closed = f - k * h;
        let right = q + k * r * k.transpose();
        // closed·P + P·closedᵀ = −right, stacked by columns
        let mut system = SMatrix::<f64, 9, 9>::zeros();
        let mut known = SVector::<f64, 9>::zeros();
        for i in 0..3 {
            for j in 0..3 {
                let row = i + 3 * j;
                known[row] = -right[(i, j)];
                for l in 0..3 {
                    system[(row, l + 3 * j)] += closed[(i, l)];
                    system[(row, i + 3 * l)] += closed[(j, l)];
                }
            }
        }
        let p = system.full_piv_lu().solve(&known)?;
        let p = Matrix3::from_column_slice(p.as_slice());
        k = 0.5 * (p + p.transpose()) * h.transpose() * inverse_r;
    }
    Some(k)
}
