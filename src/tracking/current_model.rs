//! The 'current' statistical model of one axis (Zhou and Kumar 1984), and Singer's, over any interval.
//!
//! ```text
//! ẋ = v,  v̇ = a,  ȧ = −(a − ā)/τ + w,   E[w w] = 2σ²/τ
//! ```
//! The 'current' model takes for the mean ā the acceleration that is estimated now, and for σ² the variance of a
//! Rayleigh distribution between that acceleration and the limit on its side. Singer's has ā = 0 and a fixed σ².

use crate::error::Error;
use crate::linalg::Real;

/// (4 − π)/π, the variance of a Rayleigh distribution whose mean is 1.
pub const RAYLEIGH: f64 = (4.0 - core::f64::consts::PI) / core::f64::consts::PI;

/// Terms of the series: what double precision needs below x = 1.5.
const TERMS: usize = 26;
/// Terms that single precision needs there: the first one left out is below 1e-8 of the sum.
const TERMS_SINGLE: usize = 14;
/// Up to this T/τ the series, from here on the closed forms. Chosen for single precision.
const SPLIT: f64 = 1.5;

/// 1/n!
const fn inverse_factorial(n: usize) -> f64 {
    let mut y = 1.0;
    let mut k = 2;
    while k <= n {
        y /= k as f64;
        k += 1;
    }
    y
}

/// Coefficients (a 2ⁿ)/(n+i)! − b/(n+j)! of a series in −x.
const fn series(a: f64, i: usize, b: f64, j: usize) -> [f64; TERMS] {
    let mut c = [0.0; TERMS];
    let mut power = 1.0;
    let mut n = 0;
    while n < TERMS {
        c[n] = a * power * inverse_factorial(n + i) - b * inverse_factorial(n + j);
        power *= 2.0;
        n += 1;
    }
    c
}

const PHI3: [f64; TERMS] = series(0.0, 0, -1.0, 3);
const PSI11: [f64; TERMS] = series(16.0, 5, 2.0, 4);
const PSI13: [f64; TERMS] = series(4.0, 3, 1.0, 2);
const PSI22: [f64; TERMS] = series(4.0, 3, 2.0, 3);

/// Σ cₙ (−x)ⁿ
fn horner<T: Real>(c: &[f64; TERMS], x: T) -> T {
    let terms = if T::EPSILON < T::of(1e-10) {
        TERMS
    } else {
        TERMS_SINGLE
    };
    c.iter()
        .take(terms)
        .rev()
        .fold(T::zero(), |sum, c| T::of(*c) - sum * x)
}

/// Φ, U and Q of one axis over an interval T, for one correlation time τ.
///
/// ```text
/// x = T/τ,   φₖ(y) = Σ (−y)ⁿ/(n+k)!
/// Φ column 3 = [T² φ₂(x), T φ₁(x), e^−x]        U = [T² x φ₃(x), T x φ₂(x), x φ₁(x)]
/// q₁₁ = T⁵ (16 φ₅(2x) − 2 φ₄(x))   q₁₂ = T⁴ φ₂(x)²/2             q₁₃ = T³ (4 φ₃(2x) − φ₂(x))
/// q₂₂ = T³ (4 φ₃(2x) − 2 φ₃(x))    q₂₃ = T² φ₁(x)²/2             q₃₃ = T φ₁(2x)
/// ```
///
/// Source: Fang 1998, (2), rewritten so that nothing cancels: the printed formulas in single precision give an
/// indefinite Q below T/τ ≈ 0.5. Exact, not a series in T: every x from 1e-6 to 10 and beyond. Single precision
/// against double: 2e-6 relative in each element (`host-tests/tests/current_model.rs`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transition<T> {
    /// T [s].
    pub dt: T,
    /// τ [s].
    pub tau: T,
    /// φ₁₃ [s²], φ₂₃ [s] and φ₃₃ − 1. The rest of Φ is that of a constant velocity.
    pub phi: [T; 3],
    /// U: what the mean ā adds to position [s²], velocity [s] and acceleration.
    pub u: [T; 3],
    /// q₁₁, q₁₂, q₁₃, q₂₂, q₂₃, q₃₃ of Q = (2σ²/τ) q [s⁵ … s].
    pub q: [T; 6],
}

impl<T: Real> Transition<T> {
    /// Φ, U, q for an interval `dt` [s] and a correlation time `tau` [s].
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] when `tau` or `dt` is not positive, or so extreme that T⁵ leaves
    /// the range of the scalar (in single precision: T from about 1e-7 s to 1e7 s).
    pub fn new(dt: T, tau: T) -> Result<Self, Error> {
        if !dt.finite() || !tau.finite() {
            return Err(Error::NonFinite);
        }
        if dt <= T::zero() || tau <= T::zero() {
            return Err(Error::OutOfRange);
        }
        let half = T::of(0.5);
        let one = T::one();
        let two = T::of(2.0);
        let x = dt / tau;
        let (phi1, phi2, phi3, psi11, psi13, psi22, decay);
        if x < T::of(SPLIT) {
            phi3 = horner(&PHI3, x);
            phi2 = half - x * phi3;
            phi1 = one - x * phi2;
            psi11 = horner(&PSI11, x);
            psi13 = horner(&PSI13, x);
            psi22 = horner(&PSI22, x);
            decay = one - x * phi1;
        } else {
            decay = (-x).exponential();
            let em = -(-x).exponential_m1();
            let em2 = em * (one + decay); // 1 − e^−2x
            phi1 = em / x;
            phi2 = (one - phi1) / x;
            phi3 = (half - phi2) / x;
            let x2 = x * x;
            let x3 = x2 * x;
            psi22 = (two * (x - em) - em * em) / (two * x3);
            psi13 = (em2 - two * x * decay) / (two * x3);
            psi11 = (x * (x2 / T::of(3.0) - x + one) - two * x * decay + half * em2) / (x3 * x2);
        }
        let t2 = dt * dt;
        let t3 = t2 * dt;
        let q = [
            t3 * t2 * psi11,
            t2 * t2 * (half * phi2 * phi2),
            t3 * psi13,
            t3 * psi22,
            t2 * (half * phi1 * phi1),
            dt * (half * phi1 * (one + decay)),
        ];
        let u = [t2 * (x * phi3), dt * (x * phi2), x * phi1];
        if q.iter().any(|q| !q.finite() || *q <= T::zero()) {
            return Err(Error::OutOfRange);
        }
        Ok(Self {
            dt,
            tau,
            phi: [t2 * phi2, dt * phi1, -(x * phi1)],
            u,
            q,
        })
    }

    /// Q for an acceleration variance σ² [m²/s⁴]: elements 11, 12, 13, 22, 23, 33 [m² … m²/s⁴].
    pub fn noise(&self, sigma2: T) -> [T; 6] {
        let density = T::of(2.0) * sigma2 / self.tau;
        let [q11, q12, q13, q22, q23, q33] = self.q;
        [
            density * q11,
            density * q12,
            density * q13,
            density * q22,
            density * q23,
            density * q33,
        ]
    }
}

/// What the variance rule does with an acceleration beyond its limit, where the headroom h is negative.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Beyond {
    /// |h|: the paper's formula as it stands, which squares h.
    Abs,
    /// The whole headroom: the limit was wrong, so anything may follow. Tracks best.
    Full,
    /// The floor alone. Slow to follow a vehicle that exceeds its limits.
    Clamp,
}

/// Limits of a vehicle's acceleration along one axis, and the variance rule of the 'current' model.
///
/// ```text
/// σ² = (4−π)/π · max(h, floor · full)²,   h = a_max − a  for a ≥ 0,   a − a_min  for a < 0,   full = max(a_max, −a_min)
/// ```
/// Source: Fang 1998, after (10). The second case is printed with a_max, which makes the variance grow while braking
/// and leaves a_min unused; it is repaired here. The floor is ours: at its limit the paper's σ² goes to 0 and the
/// filter freezes (measured with a vehicle that holds its limit: 3.2 m/s of velocity error with floor 0.01, 0.5 m/s
/// with `Full` and 0.3; the accuracy in cruise is the same).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits<T> {
    /// Largest acceleration, above 0 [m/s²].
    pub a_max: T,
    /// Smallest acceleration, below 0 [m/s²].
    pub a_min: T,
    /// Smallest headroom, as a part of the larger limit: 0 … 1.
    pub floor: T,
    /// The rule beyond a limit.
    pub beyond: Beyond,
    /// Half width of the transition between unequal limits about a = 0 [m/s²], 0 for none.
    ///
    /// Without it σ² jumps there by the square of the limits' ratio whenever a cruising vehicle's estimate changes its
    /// sign. Equal limits do not notice it.
    pub blend: T,
}

impl<T: Real> Limits<T> {
    /// The product's rule: `Full` beyond the limits, floor 0.3, no jump between unequal limits.
    pub fn new(a_max: T, a_min: T) -> Self {
        Self {
            a_max,
            a_min,
            floor: T::of(0.3),
            beyond: Beyond::Full,
            blend: T::of(0.25) * a_max.min(-a_min),
        }
    }

    /// The paper's rule: the formula as it stands, with a floor of 0.1 so that it cannot freeze.
    pub fn paper(a_max: T, a_min: T) -> Self {
        Self {
            a_max,
            a_min,
            floor: T::of(0.1),
            beyond: Beyond::Abs,
            blend: T::zero(),
        }
    }

    /// Variance σ² of the acceleration about its mean [m²/s⁴] when it is estimated as `acceleration` [m/s²].
    pub fn variance(&self, acceleration: T) -> T {
        let up = if self.blend > T::zero() {
            let share = T::of(0.5) * (T::one() + acceleration / self.blend);
            share.max(T::zero()).min(T::one())
        } else if acceleration >= T::zero() {
            T::one()
        } else {
            T::zero()
        };
        // equal limits: exactly that limit, whatever the share
        let limit = if up >= T::one() {
            self.a_max
        } else {
            up * (self.a_max + self.a_min) - self.a_min
        };
        let full = self.a_max.max(-self.a_min);
        let h = limit - acceleration.abs();
        let h = if h >= T::zero() {
            h
        } else {
            match self.beyond {
                Beyond::Abs => -h,
                Beyond::Full => full,
                Beyond::Clamp => T::zero(),
            }
        };
        let h = h.max(self.floor * full);
        T::of(RAYLEIGH) * (h * h)
    }

    fn check(&self) -> Result<(), Error> {
        let all = [self.a_max, self.a_min, self.floor, self.blend];
        if all.iter().any(|x| !x.finite()) {
            return Err(Error::NonFinite);
        }
        let zero = T::zero();
        let fits = self.a_max > zero
            && self.a_min < zero
            && self.floor > zero
            && self.floor <= T::one()
            && self.blend >= zero
            && self.blend <= self.a_max.min(-self.a_min);
        fits.then_some(()).ok_or(Error::OutOfRange)
    }
}

/// Mean ā of the acceleration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Mean {
    /// The predicted acceleration itself, Fang 1998 (10): Φ + U [0 0 1] is then Newton's matrix, and the acceleration
    /// is kept where Singer's would die out.
    Current,
    /// Zero: Singer's model.
    Zero,
}

/// Variance σ² of the acceleration about its mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Variance<T> {
    /// From the headroom between the predicted acceleration and its limits.
    Current(Limits<T>),
    /// Always the same [m²/s⁴].
    Fixed(T),
}

/// The motion model of one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurrentModel<T> {
    /// Correlation time τ of the acceleration [s].
    pub tau: T,
    /// Its mean.
    pub mean: Mean,
    /// Its variance.
    pub variance: Variance<T>,
}

impl<T: Real> CurrentModel<T> {
    /// The 'current' model: mean and variance follow the estimate.
    pub fn current(tau: T, limits: Limits<T>) -> Self {
        Self {
            tau,
            mean: Mean::Current,
            variance: Variance::Current(limits),
        }
    }

    /// Singer's model: mean 0, variance `sigma2` [m²/s⁴].
    pub fn singer(tau: T, sigma2: T) -> Self {
        Self {
            tau,
            mean: Mean::Zero,
            variance: Variance::Fixed(sigma2),
        }
    }

    /// Refuses a model that cannot be: [`Error::NonFinite`], [`Error::OutOfRange`].
    pub fn check(&self) -> Result<(), Error> {
        if !self.tau.finite() {
            return Err(Error::NonFinite);
        }
        if self.tau <= T::zero() {
            return Err(Error::OutOfRange);
        }
        match &self.variance {
            Variance::Current(limits) => limits.check(),
            Variance::Fixed(sigma2) if !sigma2.finite() => Err(Error::NonFinite),
            Variance::Fixed(sigma2) if *sigma2 < T::zero() => Err(Error::OutOfRange),
            Variance::Fixed(_) => Ok(()),
        }
    }

    /// What a step makes of an acceleration a [m/s²]: what position [m], velocity [m/s] and acceleration [m/s²] gain
    /// by it, the mean included. Position gains T v besides.
    pub fn gain(&self, over: &Transition<T>, acceleration: T) -> [T; 3] {
        let [p, v, a] = over.phi;
        match self.mean {
            Mean::Current => {
                let velocity = over.dt * acceleration;
                [T::of(0.5) * over.dt * velocity, velocity, T::zero()]
            }
            Mean::Zero => [p * acceleration, v * acceleration, a * acceleration],
        }
    }

    /// σ² for a predicted acceleration [m²/s⁴].
    pub fn sigma2(&self, acceleration: T) -> T {
        match &self.variance {
            Variance::Current(limits) => limits.variance(acceleration),
            Variance::Fixed(sigma2) => *sigma2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_intervals_are_those_of_a_jerk() {
        let t = Transition::<f64>::new(2.0, 2e7).unwrap();
        let want = [
            32.0 / 20.0,
            16.0 / 8.0,
            8.0 / 6.0,
            8.0 / 3.0,
            4.0 / 2.0,
            2.0,
        ];
        for (q, w) in t.q.iter().zip(want) {
            assert!((q / w - 1.0).abs() < 2e-7, "{q} {w}"); // next term: x = 1e-7
        }
    }

    #[test]
    fn the_current_mean_makes_newtons_matrix() {
        for x in [1e-4, 0.3, 1.4999, 1.5001, 7.0] {
            let t = Transition::<f64>::new(x, 1.0).unwrap();
            let newton = [0.5 * x * x, x, 0.0];
            for ((phi, u), newton) in t.phi.iter().zip(t.u).zip(newton) {
                // to rounding of the larger of the two
                assert!((phi + u - newton).abs() < 1e-14 * (1.0 + newton));
            }
            let gain = CurrentModel::current(1.0, Limits::new(2.0, -2.0)).gain(&t, 1.0);
            assert_eq!(gain, newton);
        }
    }

    #[test]
    fn unequal_limits_meet_without_a_jump() {
        let limits = Limits::<f64>::new(2.0, -1.0);
        let (mut before, mut jump) = (limits.variance(-0.9), 0.0f64);
        for i in -900..=900 {
            let now = limits.variance(f64::from(i) * 1e-3);
            jump = jump.max((now - before).abs());
            before = now;
        }
        // slope at most 2·RAYLEIGH·h·(1 + 1/(2·blend)), h ≤ 2, blend 0.25, over 1e-3
        assert!(jump < 4e-3, "{jump}");
        let switched = Limits {
            blend: 0.0,
            ..limits
        };
        assert!((switched.variance(1e-9) - switched.variance(-1e-9)).abs() > 0.8);
        for a in [-0.9, -0.25, 0.25, 1.9] {
            assert_eq!(limits.variance(a), switched.variance(a));
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        assert_eq!(Transition::<f32>::new(f32::NAN, 1.0), Err(Error::NonFinite));
        assert_eq!(Transition::<f32>::new(0.0, 1.0), Err(Error::OutOfRange));
        assert_eq!(Transition::<f32>::new(1.0, -1.0), Err(Error::OutOfRange));
        assert_eq!(Transition::<f32>::new(1e-9, 1.0), Err(Error::OutOfRange));
        assert_eq!(Transition::<f32>::new(1e9, 1.0), Err(Error::OutOfRange));
        let ok = CurrentModel::current(20.0f32, Limits::new(2.0, -1.0));
        assert_eq!(ok.check(), Ok(()));
        for limits in [
            Limits::new(0.0, -1.0),
            Limits::new(2.0, 1.0),
            Limits {
                floor: 0.0,
                ..Limits::new(2.0, -1.0)
            },
            Limits {
                blend: 1.5,
                ..Limits::new(2.0, -1.0)
            },
        ] {
            let model = CurrentModel::current(20.0, limits);
            assert_eq!(model.check(), Err(Error::OutOfRange));
        }
        assert_eq!(
            CurrentModel::singer(f32::INFINITY, 1.0).check(),
            Err(Error::NonFinite)
        );
        assert_eq!(
            CurrentModel::singer(1.0, -1.0f32).check(),
            Err(Error::OutOfRange)
        );
    }
}
