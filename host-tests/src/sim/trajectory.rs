//! Motions given by formulas, with their derivatives.

use nalgebra::Vector3;
use navsight::earth::Geodetic;

use super::DEG;

/// What a motion is at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    /// Heading clockwise from north, pitch, roll [rad].
    pub euler: Vector3<f64>,
    /// Their derivatives [rad/s].
    pub euler_rate: Vector3<f64>,
    /// Velocity over the ground, east-north-up [m/s].
    pub v_n: Vector3<f64>,
    /// Its derivative, component by component [m/s²].
    pub a_n: Vector3<f64>,
}

impl Pose {
    /// A level vehicle that moves along its heading [rad]: turn rate [rad/s], speed [m/s] and its derivative [m/s²].
    pub fn along(heading: f64, rate: f64, speed: f64, acceleration: f64) -> Self {
        let (sin, cos) = heading.sin_cos();
        let (along, right) = (Vector3::new(sin, cos, 0.0), Vector3::new(cos, -sin, 0.0));
        Self {
            euler: Vector3::new(heading, 0.0, 0.0),
            euler_rate: Vector3::new(rate, 0.0, 0.0),
            v_n: along * speed,
            a_n: along * acceleration + right * (speed * rate),
        }
    }
}

/// A motion over the earth.
pub trait Trajectory {
    /// Position at time 0.
    fn start(&self) -> Geodetic;
    /// Attitude and velocity at a time [s].
    fn pose(&self, t: f64) -> Pose;
}

/// Standing still.
#[derive(Clone, Copy, Debug)]
pub struct Static {
    /// Where.
    pub at: Geodetic,
    /// Heading, pitch, roll [rad].
    pub euler: Vector3<f64>,
}

impl Static {
    /// Attitude in degrees.
    pub fn degrees(at: Geodetic, heading: f64, pitch: f64, roll: f64) -> Self {
        Self {
            at,
            euler: Vector3::new(heading, pitch, roll) * DEG,
        }
    }
}

impl Trajectory for Static {
    fn start(&self) -> Geodetic {
        self.at
    }
    fn pose(&self, _: f64) -> Pose {
        let o = Vector3::zeros();
        Pose {
            euler: self.euler,
            euler_rate: o,
            v_n: o,
            a_n: o,
        }
    }
}

/// Standing still, with one turn of the heading on the spot at a constant rate.
#[derive(Clone, Copy, Debug)]
pub struct Turn {
    /// Before the turn.
    pub before: Static,
    /// When it begins [s].
    pub begin: f64,
    /// How long it lasts [s].
    pub duration: f64,
    /// Clockwise positive [rad/s].
    pub rate: f64,
}

impl Trajectory for Turn {
    fn start(&self) -> Geodetic {
        self.before.at
    }
    fn pose(&self, t: f64) -> Pose {
        let mut pose = self.before.pose(t);
        let since = t - self.begin;
        pose.euler.x += self.rate * since.clamp(0.0, self.duration);
        // The nodes of an integration never fall on the corners when the samples do.
        if since > 0.0 && since < self.duration {
            pose.euler_rate.x = self.rate;
        }
        pose
    }
}

/// Rocking in pitch and roll on the spot, a quarter of a period apart: the two-axis swing that cones.
#[derive(Clone, Copy, Debug)]
pub struct Swing {
    /// In the middle of the swing.
    pub middle: Static,
    /// Amplitude of both [rad].
    pub amplitude: f64,
    /// Frequency of both [Hz].
    pub frequency: f64,
}

impl Trajectory for Swing {
    fn start(&self) -> Geodetic {
        self.middle.at
    }
    fn pose(&self, t: f64) -> Pose {
        let mut pose = self.middle.pose(t);
        let w = std::f64::consts::TAU * self.frequency;
        let (s, c) = (w * t).sin_cos();
        pose.euler += Vector3::new(0.0, s, c) * self.amplitude;
        pose.euler_rate = Vector3::new(0.0, c, -s) * (self.amplitude * w);
        pose
    }
}

/// A cone around the up axis with a shaking of the horizontal velocity in step with it: what coning and sculling
/// corrections are for. The body has the angular rate of a fast small swing, and the forces of a vibration.
#[derive(Clone, Copy, Debug)]
pub struct Coning {
    /// The swing.
    pub swing: Swing,
    /// Amplitude of the east and north velocities [m/s].
    pub speed: f64,
}

impl Trajectory for Coning {
    fn start(&self) -> Geodetic {
        self.swing.start()
    }
    fn pose(&self, t: f64) -> Pose {
        let mut pose = self.swing.pose(t);
        let w = std::f64::consts::TAU * self.swing.frequency;
        let (s, c) = (w * t).sin_cos();
        pose.v_n = Vector3::new(s, c, 0.0) * self.speed;
        pose.a_n = Vector3::new(c, -s, 0.0) * (self.speed * w);
        pose
    }
}

/// Turns of an aeroplane that climbs: constant speed, a turn rate between nothing and twice its mean once a minute,
/// banked as a coordinated turn.
#[derive(Clone, Copy, Debug)]
pub struct ClimbingTurns {
    /// Where it begins.
    pub start: Geodetic,
    /// [m/s]
    pub speed: f64,
    /// Heading at the beginning [rad].
    pub heading: f64,
    /// Mean turn rate, clockwise positive [rad/s].
    pub turn_rate: f64,
    /// Mean path angle [rad]; it varies by as much in 100 s, from level to twice the mean.
    pub climb: f64,
}

impl Trajectory for ClimbingTurns {
    fn start(&self) -> Geodetic {
        self.start
    }
    fn pose(&self, t: f64) -> Pose {
        let tau = std::f64::consts::TAU;
        let (w, r, v) = (tau / 60.0, self.turn_rate, self.speed);
        let heading = self.heading + r * (t - (w * t).sin() / w);
        let rate = r * (1.0 - (w * t).cos());
        let rate_dot = r * w * (w * t).sin();
        let wc = tau / 100.0;
        let climb = self.climb * (1.0 - (wc * t).cos());
        let climb_dot = self.climb * wc * (wc * t).sin();
        let bank = v * rate / 9.8;
        let (sh, ch) = heading.sin_cos();
        let (sc, cc) = climb.sin_cos();
        Pose {
            // The nose points along the path plus an angle of attack of 3°.
            euler: Vector3::new(heading, climb + 3.0 * DEG, bank.atan()),
            euler_rate: Vector3::new(rate, climb_dot, v * rate_dot / 9.8 / (1.0 + bank * bank)),
            v_n: Vector3::new(cc * sh, cc * ch, sc) * v,
            a_n: Vector3::new(
                -sc * sh * climb_dot + cc * ch * rate,
                -sc * ch * climb_dot - cc * sh * rate,
                cc * climb_dot,
            ) * v,
        }
    }
}
