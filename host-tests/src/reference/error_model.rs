//! Errors of a navigator, from first principles: two navigators in an earth-fixed frame, and what one is wrong against
//! the other, in the words of the psi-angle and of the phi-angle model.
//!
//! Nothing here knows a transport rate, a radius of curvature or a turn of the level frame: position, velocity and
//! attitude are earth-fixed (e), and the level frame appears only where errors are read. So every term that the models
//! have because the level frame moves is checked against equations that do not have it.
//!
//! ```text
//! ṙ_e = v_e
//! v̇_e = C_b^e f_b − 2 ω_ie × v_e + g(r_e)
//! Ċ_b^e = C_b^e [ω_ib^b ×] − [ω_ie ×] C_b^e
//! ```

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Position, velocity, attitude, and the biases it leaves uncompensated (zero for the truth).
#[derive(Clone, Copy, Debug)]
pub struct Nav {
    /// [m]
    pub r_e: Vector3<f64>,
    /// Against the earth [m/s]
    pub v_e: Vector3<f64>,
    pub c_b_e: Matrix3<f64>,
    /// Added to the true angular rate [rad/s]
    pub b_g: Vector3<f64>,
    /// Added to the true specific force [m/s²]
    pub b_a: Vector3<f64>,
}

/// The earth that both navigators fly over.
#[derive(Clone, Copy, Debug)]
pub enum Earth {
    Wgs84,
    /// Gravity falls with the square of the distance, without centrifugal part.
    Sphere {
        /// [m]
        radius: f64,
        /// At the radius [m/s²]
        gravity: f64,
        /// [rad/s]
        omega_ie: f64,
    },
}

/// Geodetic latitude, longitude [rad], height [m].
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub lat: f64,
    pub lon: f64,
    pub height: f64,
}

impl Earth {
    /// Semi-major axis and squared eccentricity.
    fn figure(&self) -> (f64, f64) {
        const F: f64 = 1.0 / 298.257_223_563;
        match self {
            Self::Wgs84 => (6_378_137.0, 2.0 * F - F * F),
            Self::Sphere { radius, .. } => (*radius, 0.0),
        }
    }

    pub fn omega_ie(&self) -> f64 {
        match self {
            Self::Wgs84 => 7.292_115e-5,
            Self::Sphere { omega_ie, .. } => *omega_ie,
        }
    }

    pub fn r_e(&self, at: &Place) -> Vector3<f64> {
        let (a, e2) = self.figure();
        let (s, c) = at.lat.sin_cos();
        let n = a / (1.0 - e2 * s * s).sqrt();
        let p = (n + at.height) * c;
        Vector3::new(
            p * at.lon.cos(),
            p * at.lon.sin(),
            (n * (1.0 - e2) + at.height) * s,
        )
    }

    /// By iteration to the last place.
    pub fn place(&self, r_e: &Vector3<f64>) -> Place {
        let (a, e2) = self.figure();
        let p = r_e.x.hypot(r_e.y);
        let mut lat = r_e.z.atan2(p * (1.0 - e2));
        for _ in 0..8 {
            let s = lat.sin();
            let n = a / (1.0 - e2 * s * s).sqrt();
            lat = (r_e.z + e2 * n * s).atan2(p);
        }
        let (s, c) = lat.sin_cos();
        let w = (1.0 - e2 * s * s).sqrt();
        Place {
            lat,
            lon: r_e.y.atan2(r_e.x),
            // along the normal, good at every latitude
            height: p * c + r_e.z * s - a * w,
        }
    }

    /// Gravity, positive down along the ellipsoid's normal [m/s²].
    pub fn gravity(&self, at: &Place) -> f64 {
        match self {
            Self::Wgs84 => {
                let (f, s2) = (1.0 / 298.257_223_563, at.lat.sin().powi(2));
                let (a, b) = (6_378_137.0, 6_378_137.0 * (1.0 - f));
                let m = (7.292_115e-5_f64 * a).powi(2) * b / 3.986_004_418e14;
                let (gamma_a, gamma_b) = (9.780_325_335_9, 9.832_184_937_8);
                let (c2, h) = (1.0 - s2, at.height);
                // Somigliana in its symmetric form, then to second order in height
                let on_ellipsoid =
                    (a * gamma_a * c2 + b * gamma_b * s2) / (a * a * c2 + b * b * s2).sqrt();
                on_ellipsoid
                    * (1.0 - 2.0 / a * (1.0 + f + m - 2.0 * f * s2) * h + 3.0 * h * h / (a * a))
            }
            Self::Sphere {
                radius, gravity, ..
            } => gravity * (radius / (radius + at.height)).powi(2),
        }
    }
}

/// Rows east, north, up in e: takes e to the level frame at this place.
pub fn c_e_n(at: &Place) -> Matrix3<f64> {
    let ((sl, cl), (so, co)) = (at.lat.sin_cos(), at.lon.sin_cos());
    Matrix3::new(
        -so,
        co,
        0.0, //
        -sl * co,
        -sl * so,
        cl, //
        cl * co,
        cl * so,
        sl,
    )
}

fn cross(v: &Vector3<f64>) -> Matrix3<f64> {
    v.cross_matrix()
}

/// What the axes would read: angular rate [rad/s] and specific force [m/s²], body axes, as functions of time.
pub trait Motion: Fn(f64) -> (Vector3<f64>, Vector3<f64>) {}
impl<F: Fn(f64) -> (Vector3<f64>, Vector3<f64>)> Motion for F {}

impl Nav {
    /// From what a navigator in the level frame would call its state.
    pub fn new(earth: &Earth, at: &Place, v_n: &Vector3<f64>, c_b_n: &Matrix3<f64>) -> Self {
        let to_e = c_e_n(at).transpose();
        Self {
            r_e: earth.r_e(at),
            v_e: to_e * v_n,
            c_b_e: to_e * c_b_n,
            b_g: Vector3::zeros(),
            b_a: Vector3::zeros(),
        }
    }

    /// Level frame here, e to n.
    pub fn c_e_n(&self, earth: &Earth) -> Matrix3<f64> {
        c_e_n(&earth.place(&self.r_e))
    }

    /// Time derivative under the true angular rate and specific force; constant biases.
    pub fn rate(&self, earth: &Earth, omega_ib_b: &Vector3<f64>, f_b: &Vector3<f64>) -> Nav {
        let at = earth.place(&self.r_e);
        let up_e = c_e_n(&at).row(2).transpose();
        let omega_e = Vector3::new(0.0, 0.0, earth.omega_ie());
        Nav {
            r_e: self.v_e,
            v_e: self.c_b_e * (f_b + self.b_a)
                - 2.0 * omega_e.cross(&self.v_e)
                - up_e * earth.gravity(&at),
            c_b_e: self.c_b_e * cross(&(omega_ib_b + self.b_g)) - cross(&omega_e) * self.c_b_e,
            b_g: Vector3::zeros(),
            b_a: Vector3::zeros(),
        }
    }

    /// self + rate · dt
    pub fn along(&self, rate: &Nav, dt: f64) -> Nav {
        Nav {
            r_e: self.r_e + rate.r_e * dt,
            v_e: self.v_e + rate.v_e * dt,
            c_b_e: self.c_b_e + rate.c_b_e * dt,
            b_g: self.b_g + rate.b_g * dt,
            b_a: self.b_a + rate.b_a * dt,
        }
    }

    /// One Runge-Kutta step of fourth order.
    pub fn step(&self, earth: &Earth, motion: &impl Motion, t: f64, dt: f64) -> Nav {
        let rate = |nav: &Nav, t| {
            let (omega, f) = motion(t);
            nav.rate(earth, &omega, &f)
        };
        let k1 = rate(self, t);
        let k2 = rate(&self.along(&k1, dt / 2.0), t + dt / 2.0);
        let k3 = rate(&self.along(&k2, dt / 2.0), t + dt / 2.0);
        let k4 = rate(&self.along(&k3, dt), t + dt);
        self.along(&k1, dt / 6.0)
            .along(&k2, dt / 3.0)
            .along(&k3, dt / 3.0)
            .along(&k4, dt / 6.0)
    }
}

/// Which words the errors are in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Angle {
    /// Everything in the level frame at the estimate; the truth is looked at from there.
    Psi,
    /// Components of each in its own level frame.
    Phi,
}

/// δr, δv, ψ or φ, b_g, b_a: estimate minus truth (front page of the crate), from the two navigators.
pub fn errors(earth: &Earth, angle: Angle, estimate: &Nav, truth: &Nav) -> SVector<f64, 15> {
    let at_estimate = estimate.c_e_n(earth);
    let seen_from = match angle {
        Angle::Psi => at_estimate,
        Angle::Phi => truth.c_e_n(earth),
    };
    let delta_r = at_estimate * (estimate.r_e - truth.r_e);
    let delta_v = at_estimate * estimate.v_e - seen_from * truth.v_e;
    // Ĉ Cᵀ = I − [ψ×]: the antisymmetric part is −[ψ×]
    let m = (at_estimate * estimate.c_b_e) * (seen_from * truth.c_b_e).transpose();
    let psi = Vector3::new(m.m23 - m.m32, m.m31 - m.m13, m.m12 - m.m21) / 2.0;
    let mut x = SVector::<f64, 15>::zeros();
    let biases = [estimate.b_g - truth.b_g, estimate.b_a - truth.b_a];
    let parts = [delta_r, delta_v, psi, biases[0], biases[1]];
    for (k, part) in parts.iter().enumerate() {
        x.fixed_rows_mut::<3>(3 * k).copy_from(part);
    }
    x
}

/// A navigator that is wrong by x (to first order) against the truth.
pub fn estimate(earth: &Earth, angle: Angle, truth: &Nav, x: &SVector<f64, 15>) -> Nav {
    let part = |k: usize| x.fixed_rows::<3>(3 * k).into_owned();
    let true_n = truth.c_e_n(earth);
    let r_e = truth.r_e + true_n.transpose() * part(0);
    let est_n = c_e_n(&earth.place(&r_e));
    let seen_from = match angle {
        Angle::Psi => est_n,
        Angle::Phi => true_n,
    };
    let to_e = est_n.transpose();
    Nav {
        r_e,
        v_e: to_e * (seen_from * truth.v_e + part(1)),
        c_b_e: to_e * (Matrix3::identity() - cross(&part(2))) * seen_from * truth.c_b_e,
        b_g: part(3),
        b_a: part(4),
    }
}

/// Sizes of the errors for finite differences, per kind of state: as large as their third-order terms allow. A gyro
/// bias is small because a minute makes an angle of it.
const SIZES: [f64; 5] = [200.0, 1.0, 1e-3, 1e-5, 1e-1];

fn perturbation(j: usize, sign: f64) -> SVector<f64, 15> {
    SVector::ith(j, sign * SIZES[j / 3])
}

/// F by finite differences: central in the error, fourth order in time along the tangents, no integration.
///
/// Returns F and, element by element, what rounding can do to it: that of the errors read (2e-9 m,
/// 2e-13 m/s, 5e-16 rad).
pub fn f_by_differences(
    earth: &Earth,
    angle: Angle,
    truth: &Nav,
    omega_ib_b: &Vector3<f64>,
    f_b: &Vector3<f64>,
) -> (SMatrix<f64, 15, 15>, SMatrix<f64, 15, 15>) {
    const H: f64 = 1.0 / 64.0;
    const ROUNDING: [f64; 5] = [2e-9, 2e-13, 5e-16, 0.0, 0.0];
    let truth_rate = truth.rate(earth, omega_ib_b, f_b);
    let error_rate = |x: &SVector<f64, 15>| {
        let est = estimate(earth, angle, truth, x);
        let est_rate = est.rate(earth, omega_ib_b, f_b);
        let at = |dt| {
            errors(
                earth,
                angle,
                &est.along(&est_rate, dt),
                &truth.along(&truth_rate, dt),
            )
        };
        ((at(H) - at(-H)) * 8.0 - (at(2.0 * H) - at(-2.0 * H))) / (12.0 * H)
    };
    let (mut f, mut doubt) = (SMatrix::<f64, 15, 15>::zeros(), SMatrix::zeros());
    for j in 0..15 {
        let (up, down) = (
            error_rate(&perturbation(j, 1.0)),
            error_rate(&perturbation(j, -1.0)),
        );
        let column = (up - down) / (2.0 * SIZES[j / 3]);
        f.set_column(j, &column);
        for i in 0..15 {
            doubt[(i, j)] = ROUNDING[i / 3] / (H * SIZES[j / 3]);
        }
    }
    (f, doubt)
}

/// Φ over an interval by finite differences of two integrated navigators.
pub fn transition_by_differences(
    earth: &Earth,
    angle: Angle,
    truth: &Nav,
    motion: &impl Motion,
    steps: usize,
    dt: f64,
) -> SMatrix<f64, 15, 15> {
    let run =
        |start: &Nav| (0..steps).fold(*start, |nav, k| nav.step(earth, motion, k as f64 * dt, dt));
    let end = run(truth);
    let mut phi = SMatrix::<f64, 15, 15>::zeros();
    for j in 0..15 {
        let at = |sign| {
            let start = estimate(earth, angle, truth, &perturbation(j, sign));
            errors(earth, angle, &run(&start), &end)
        };
        phi.set_column(j, &((at(1.0) - at(-1.0)) / (2.0 * SIZES[j / 3])));
    }
    phi
}
