//! The true state along a trajectory and the increments of an ideal sensor.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::trajectory::{Pose, Trajectory};
use crate::reference::strapdown::{frame_rates, gravity, radii};

/// The true state at the end of a sample.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    /// Since the beginning [s].
    pub time: f64,
    /// Body to east-north-up.
    pub q: UnitQuaternion<f64>,
    /// Heading, pitch, roll [rad].
    pub euler: Vector3<f64>,
    /// Velocity, east-north-up [m/s].
    pub v_n: Vector3<f64>,
    /// Latitude [rad].
    pub lat: f64,
    /// Longitude, not wrapped [rad].
    pub lon: f64,
    /// Ellipsoidal height [m].
    pub height: f64,
}

/// What a sensor without errors reports for one sample.
#[derive(Clone, Copy, Debug)]
pub struct Ideal {
    /// ∫ω_ib^b dt [rad].
    pub delta_theta_b: Vector3<f64>,
    /// ∫f^b dt [m/s].
    pub delta_v_b: Vector3<f64>,
    /// Length of the sample [s].
    pub dt: f64,
}

/// C_b^n from heading, pitch and roll: R_z(−heading)·R_x(pitch)·R_y(roll).
pub fn c_b_n(euler: &Vector3<f64>) -> Matrix3<f64> {
    let about = |axis: Vector3<f64>, angle: f64| Rotation3::new(axis * angle).into_inner();
    about(Vector3::z(), -euler.x) * about(Vector3::x(), euler.y) * about(Vector3::y(), euler.z)
}

/// (latitude, longitude, height)
type Position = Vector3<f64>;

fn position_rate(p: &Position, v_n: &Vector3<f64>) -> Vector3<f64> {
    let (r_m, r_n) = radii(p.x);
    Vector3::new(
        v_n.y / (r_m + p.z),
        v_n.x / ((r_n + p.z) * p.x.cos()),
        v_n.z,
    )
}

/// Angular rate and specific force that the body feels.
fn felt(pose: &Pose, p: &Position) -> (Vector3<f64>, Vector3<f64>) {
    let c_n_b = c_b_n(&pose.euler).transpose();
    let (heading_rate, pitch_rate, roll_rate) =
        (pose.euler_rate.x, pose.euler_rate.y, pose.euler_rate.z);
    // Heading turns about −up of n, pitch about the right axis before the roll, roll about the forward axis.
    let roll = Rotation3::new(Vector3::y() * pose.euler.z).into_inner();
    let omega_nb_b = c_n_b * Vector3::new(0.0, 0.0, -heading_rate)
        + roll.transpose() * Vector3::new(pitch_rate, 0.0, 0.0)
        + Vector3::new(0.0, roll_rate, 0.0);
    let (omega_ie, omega_en) = frame_rates(p.x, p.z, &pose.v_n);
    let omega_ib_b = omega_nb_b + c_n_b * (omega_ie + omega_en);
    let g_n = Vector3::new(0.0, 0.0, -gravity(p.x, p.z));
    let f_n = pose.a_n + (2.0 * omega_ie + omega_en).cross(&pose.v_n) - g_n;
    (omega_ib_b, c_n_b * f_n)
}

/// Iterator over samples: the truth at the end of each and the ideal increments over it.
///
/// Rate and force are integrated by Gauss–Legendre quadrature with three nodes, the position between the nodes by
/// Runge–Kutta of fourth order. An endless iterator of samples of one length; [`Simulator::sample`] gives any other.
#[derive(Clone, Copy, Debug)]
pub struct Simulator<T> {
    trajectory: T,
    dt: f64,
    time: f64,
    position: Position,
}

impl<T: Trajectory> Simulator<T> {
    /// Samples of length `dt` [s].
    pub fn new(trajectory: T, dt: f64) -> Self {
        let at = trajectory.start();
        Self {
            trajectory,
            dt,
            time: 0.0,
            position: Vector3::new(at.lat, at.lon, at.height),
        }
    }

    /// The true state now.
    pub fn truth(&self) -> Truth {
        let time = self.time;
        let pose = self.trajectory.pose(time);
        let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(c_b_n(
            &pose.euler,
        )));
        let (lat, lon, height) = (self.position.x, self.position.y, self.position.z);
        Truth {
            time,
            q,
            euler: pose.euler,
            v_n: pose.v_n,
            lat,
            lon,
            height,
        }
    }

    fn drift(&self, p: Position, t: f64, h: f64) -> Position {
        let v = |t| self.trajectory.pose(t).v_n;
        let (v0, v1, v2) = (v(t), v(t + 0.5 * h), v(t + h));
        if [v0, v1, v2].iter().all(|v| *v == Vector3::zeros()) {
            return p;
        }
        let k1 = position_rate(&p, &v0);
        let k2 = position_rate(&(p + k1 * (0.5 * h)), &v1);
        let k3 = position_rate(&(p + k2 * (0.5 * h)), &v1);
        let k4 = position_rate(&(p + k3 * h), &v2);
        p + (k1 + 2.0 * k2 + 2.0 * k3 + k4) * (h / 6.0)
    }

    /// The next sample, `dt` long [s]: the truth at its end and the ideal increments over it.
    pub fn sample(&mut self, dt: f64) -> (Truth, Ideal) {
        let begin = self.time;
        let node = 0.5 * 0.6_f64.sqrt();
        let (mut p, mut at) = (self.position, 0.0);
        let (mut delta_theta_b, mut delta_v_b) = (Vector3::zeros(), Vector3::zeros());
        for (x, weight) in [
            (0.5 - node, 5.0 / 18.0),
            (0.5, 8.0 / 18.0),
            (0.5 + node, 5.0 / 18.0),
        ] {
            p = self.drift(p, begin + at * dt, (x - at) * dt);
            at = x;
            let (omega, f) = felt(&self.trajectory.pose(begin + x * dt), &p);
            delta_theta_b += omega * (weight * dt);
            delta_v_b += f * (weight * dt);
        }
        self.position = self.drift(p, begin + at * dt, (1.0 - at) * dt);
        self.time += dt;
        (
            self.truth(),
            Ideal {
                delta_theta_b,
                delta_v_b,
                dt,
            },
        )
    }
}

impl<T: Trajectory> Iterator for Simulator<T> {
    type Item = (Truth, Ideal);

    fn next(&mut self) -> Option<(Truth, Ideal)> {
        Some(self.sample(self.dt))
    }
}
