//! The vehicle and the receiver of Fang 1998, section 5: 5 m/s, then an acceleration of 20 s, then steady again.

use rand::{rngs::StdRng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// Seeded random numbers.
#[derive(Debug)]
pub struct Noise(StdRng);

impl Noise {
    /// The same seed gives the same numbers.
    pub fn new(seed: u64) -> Self {
        Self(StdRng::seed_from_u64(seed))
    }

    /// Evenly from 0 to 1.
    pub fn uniform(&mut self) -> f64 {
        self.0.random()
    }

    /// Mean 0, variance 1.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
}

/// A straight drive with one acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Speed at the start [m/s].
    pub speed: f64,
    /// When the acceleration begins [s].
    pub from: f64,
    /// How long it lasts [s].
    pub lasts: f64,
    /// The acceleration [m/s²].
    pub acceleration: f64,
}

impl Drive {
    /// The paper's, its "t = 500 × 20 s" read as the 500th point of an axis in steps of 20 s.
    pub fn paper(acceleration: f64) -> Self {
        Self {
            speed: 5.0,
            from: 10_000.0,
            lasts: 20.0,
            acceleration,
        }
    }

    /// Position [m], velocity [m/s] and acceleration [m/s²] at a time.
    pub fn at(&self, t: f64) -> [f64; 3] {
        let inside = (t - self.from).clamp(0.0, self.lasts);
        let after = (t - self.from - self.lasts).max(0.0);
        let gained = self.acceleration * inside;
        let now = t >= self.from && t < self.from + self.lasts;
        [
            self.speed * t + 0.5 * gained * inside + gained * after,
            self.speed + gained,
            if now { self.acceleration } else { 0.0 },
        ]
    }
}

/// What a receiver adds to the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// White noise of position [m].
    pub sigma_position: f64,
    /// White noise of velocity [m/s].
    pub sigma_velocity: f64,
    /// A position error that lasts, like that of selective availability: σ [m] and correlation time [s].
    pub slow: Option<(f64, f64)>,
    /// Outliers: share of all measurements, size in position [m] and in velocity [m/s].
    pub outliers: Option<(f64, f64, f64)>,
}

impl Receiver {
    /// The paper's: 100 m and 0.1 m/s, white.
    pub const PAPER: Self = Self {
        sigma_position: 100.0,
        sigma_velocity: 0.1,
        slow: None,
        outliers: None,
    };

    /// Measurements of position and velocity at every `step` [s] from 0 on.
    pub fn measure(&self, drive: &Drive, step: f64, count: usize, seed: u64) -> Vec<[f64; 2]> {
        let mut noise = Noise::new(seed);
        let mut slow = self.slow.map_or(0.0, |(sigma, _)| sigma * noise.normal());
        (0..count)
            .map(|k| {
                let [p, v, _] = drive.at(k as f64 * step);
                let mut z = [
                    p + self.sigma_position * noise.normal() + slow,
                    v + self.sigma_velocity * noise.normal(),
                ];
                if let Some((sigma, tau)) = self.slow {
                    let keep = (-step / tau).exp();
                    slow = keep * slow + sigma * (1.0 - keep * keep).sqrt() * noise.normal();
                }
                if let Some((share, position, velocity)) = self.outliers {
                    for (z, size) in z.iter_mut().zip([position, velocity]) {
                        let sign = if noise.uniform() < 0.5 { -1.0 } else { 1.0 };
                        if noise.uniform() < share {
                            *z += sign * size;
                        }
                    }
                }
                z
            })
            .collect()
    }
}
