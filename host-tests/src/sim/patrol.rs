//! A flight with straight legs, turns and changes of speed, to show what each of them teaches.

use nalgebra::Vector3;
use navsight::earth::Geodetic;

use super::trajectory::{Pose, Trajectory};

/// A small aeroplane on patrol. Every [`Patrol::CYCLE`] seconds: straight, a turn, straight, faster, straight, slower.
///
/// Every change is a pulse sin² in its rate, so that attitude and velocity have continuous derivatives; turns are banked
/// as coordinated ones.
#[derive(Clone, Copy, Debug)]
pub struct Patrol {
    /// Where it begins.
    pub start: Geodetic,
    /// On the slow legs [m/s].
    pub speed: f64,
    /// How much faster on the fast ones [m/s].
    pub faster: f64,
    /// Heading at the beginning [rad].
    pub heading: f64,
    /// Angle of one turn, clockwise positive [rad].
    pub turn: f64,
}

impl Patrol {
    /// Seconds of one round.
    pub const CYCLE: f64 = 100.0;
    /// Begin and end of the turn in it.
    pub const TURN: (f64, f64) = (30.0, 50.0);
    /// Of the acceleration.
    pub const FASTER: (f64, f64) = (60.0, 70.0);
    /// Of the deceleration.
    pub const SLOWER: (f64, f64) = (80.0, 90.0);
}

/// A pulse that moves something by 1 in all: how far it is, its rate, the derivative of that.
fn pulse(t: f64, (from, to): (f64, f64)) -> [f64; 3] {
    let length = to - from;
    let x = (t - from) / length;
    if x <= 0.0 {
        return [0.0; 3];
    }
    if x >= 1.0 {
        return [1.0, 0.0, 0.0];
    }
    let w = std::f64::consts::TAU;
    let (s, c) = (w * x).sin_cos();
    [x - s / w, (1.0 - c) / length, w * s / (length * length)]
}

impl Trajectory for Patrol {
    fn start(&self) -> Geodetic {
        self.start
    }
    fn pose(&self, t: f64) -> Pose {
        let (round, t) = ((t / Self::CYCLE).floor(), t.rem_euclid(Self::CYCLE));
        let [turned, rate, rate_dot] = pulse(t, Self::TURN).map(|x| x * self.turn);
        let (up, down) = (pulse(t, Self::FASTER), pulse(t, Self::SLOWER));
        let v = self.speed + self.faster * (up[0] - down[0]);
        let a = self.faster * (up[1] - down[1]);
        let a_dot = self.faster * (up[2] - down[2]);
        let heading = self.heading + round * self.turn + turned;
        let (sh, ch) = heading.sin_cos();
        // Bank of a coordinated turn; the nose a little up, and up a little more while it speeds up.
        const G: f64 = 9.8;
        let bank = v * rate / G;
        let bank_dot = (v * rate_dot + a * rate) / G / (1.0 + bank * bank);
        const NOSE: f64 = 0.05;
        const PER_A: f64 = 0.02;
        Pose {
            euler: Vector3::new(heading, NOSE + PER_A * a, bank.atan()),
            euler_rate: Vector3::new(rate, PER_A * a_dot, bank_dot),
            v_n: Vector3::new(sh, ch, 0.0) * v,
            a_n: Vector3::new(sh, ch, 0.0) * a + Vector3::new(ch, -sh, 0.0) * (v * rate),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_derivatives() {
        let patrol = Patrol {
            start: Geodetic::from_degrees(48.0, 9.0, 500.0),
            speed: 40.0,
            faster: 15.0,
            heading: 0.4,
            turn: 1.6,
        };
        for t in [10.0, 33.0, 41.0, 62.0, 66.0, 83.0, 99.99, 135.0, 588.0] {
            const H: f64 = 1e-5;
            let (a, b, now) = (patrol.pose(t - H), patrol.pose(t + H), patrol.pose(t));
            // third derivatives of order one, times H²; and the last places of 55 m/s over H
            assert!(((b.euler - a.euler) / (2.0 * H) - now.euler_rate).amax() < 1e-8);
            assert!(((b.v_n - a.v_n) / (2.0 * H) - now.a_n).amax() < 1e-8);
        }
    }
}
