//! From the present back to the time of a late measurement: what a state error was then.
//!
//! ```text
//! forwards over a segment:    ψ' = ψ − C̄ b_g,   δv' = δv + F × (ψ + ψ')/2 + C̄ b_a,   δr' = δr + T (δv + δv')/2
//! with  C̄ = ∫C dt,  F = ∫f_n dt,  T its length
//! ```
//! This is the psi-angle model without what turns slowly: Coriolis 2Ω, transport v/R and the gravity gradient g/R, each
//! below 3e-4 of the state in a second at 300 m/s.
//!
//! Three numbers at a time, spelled out for opt-level "s".

use crate::error_model::{Interval, NoiseDensity, N};
use crate::linalg::{columns, cross, dot, minus, plus, scaled, transformed};
use crate::measurement::AntennaRows;
use nalgebra::Vector3;

/// Three components of a vector, of a row, or of a column.
type Three = Vector3<f32>;

const NOTHING: Three = Three::new(0.0, 0.0, 0.0);

/// An error of the end of a segment, as it was at its beginning.
#[inline(never)]
pub(super) fn undo(segment: &Interval<f32>, dx: &mut [f32; N]) {
    let Interval { c_dt, f_dt, dt } = segment;
    let [r, v, psi] = motion(dx);
    let (b_g, b_a) = (
        Three::new(dx[9], dx[10], dx[11]),
        Three::new(dx[12], dx[13], dx[14]),
    );
    let psi0 = plus(&psi, &transformed(c_dt, &b_g));
    let by_force = cross(f_dt, &scaled(&plus(&psi, &psi0), 0.5));
    let v0 = minus(&v, &plus(&by_force, &transformed(c_dt, &b_a)));
    let r0 = minus(&r, &scaled(&plus(&v, &v0), 0.5 * dt));
    [dx[0], dx[1], dx[2]] = r0.into();
    [dx[3], dx[4], dx[5]] = v0.into();
    [dx[6], dx[7], dx[8]] = psi0.into();
}

/// The same as a matrix, segment after segment: error then = (this) · error now. Matrices by columns.
///
/// ```text
/// ψ then = ψ + c b_g
/// δv then = δv − f × ψ − w b_g − c b_a
/// δr then = δr − t δv + g × ψ + u b_g + d b_a
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Back {
    t: f32,
    f: Three,
    g: Three,
    c: [Three; 3],
    d: [Three; 3],
    w: [Three; 3],
    u: [Three; 3],
}

impl Back {
    /// No time at all.
    pub const NONE: Self = Self {
        t: 0.0,
        f: NOTHING,
        g: NOTHING,
        c: [NOTHING; 3],
        d: [NOTHING; 3],
        w: [NOTHING; 3],
        u: [NOTHING; 3],
    };

    /// Further back by one segment.
    #[inline(never)]
    pub fn over(&mut self, segment: &Interval<f32>) {
        let (f, t) = (&segment.f_dt, segment.dt);
        let columns = columns(&segment.c_dt);
        macro_rules! column {
            ($k:literal) => {
                // halfway
                let c = plus(&self.c[$k], &scaled(&columns[$k], 0.5));
                let half = scaled(&cross(f, &c), 0.5);
                let w = plus(&self.w[$k], &half);
                self.d[$k] = plus(&self.d[$k], &scaled(&c, t));
                self.u[$k] = plus(&self.u[$k], &scaled(&w, t));
                self.w[$k] = plus(&w, &half);
                self.c[$k] = plus(&self.c[$k], &columns[$k]);
            };
        }
        column!(0);
        column!(1);
        column!(2);
        self.g = plus(&self.g, &scaled(&plus(&self.f, &scaled(f, 0.5)), t));
        self.f = plus(&self.f, f);
        self.t += t;
    }

    /// A row of then becomes a row on the error of now; the variance that the process noise since then has in it.
    #[inline(never)]
    pub fn carry(&self, row: &mut [f32; N], noise: &NoiseDensity<f32>) -> f32 {
        let [r, v, psi] = motion(row);
        [row[3], row[4], row[5]] = minus(&v, &scaled(&r, self.t)).into();
        let turned = minus(&psi, &cross(&v, &self.f));
        [row[6], row[7], row[8]] = plus(&turned, &cross(&r, &self.g)).into();
        macro_rules! bias {
            ($k:literal) => {
                row[9 + $k] += dot(&psi, &self.c[$k]) - dot(&v, &self.w[$k]) + dot(&r, &self.u[$k]);
                row[12 + $k] += dot(&r, &self.d[$k]) - dot(&v, &self.c[$k]);
            };
        }
        bias!(0);
        bias!(1);
        bias!(2);
        self.noise(&[r, v, psi], noise)
    }

    /// The rows of an antenna, carried, into `h`, which holds zeros and of which M is 6; and their [`Back::noise`].
    pub fn antenna<const M: usize>(
        &self,
        rows: &AntennaRows,
        noise: &NoiseDensity<f32>,
        h: &mut [[f32; M]; N],
    ) -> [f32; M] {
        let (o, m, [of_r, of_v]) = (&rows.offset, &rows.motion, &rows.lower);
        let mut q = [0.0; M];
        if M != 6 {
            return q;
        }
        macro_rules! set {
            ($j:expr, $row:literal, $lower:ident, $x:expr) => {{
                let x: Three = $x;
                let north = x.y - $lower[0] * x.x;
                h[$j][$row] = x.x;
                h[$j][$row + 1] = north;
                h[$j][$row + 2] = x.z - $lower[1] * x.x - $lower[2] * north;
            }};
        }
        // x times I, and [x ×]
        macro_rules! three {
            ($j:literal, $row:literal, $lower:ident, $x:expr) => {
                set!($j, $row, $lower, Three::new($x, 0.0, 0.0));
                set!($j + 1, $row, $lower, Three::new(0.0, $x, 0.0));
                set!($j + 2, $row, $lower, Three::new(0.0, 0.0, $x));
            };
            (skew, $row:literal, $lower:ident, $x:expr) => {
                let x: Three = $x;
                set!(6, $row, $lower, Three::new(0.0, x.z, -x.y));
                set!(7, $row, $lower, Three::new(-x.z, 0.0, x.x));
                set!(8, $row, $lower, Three::new(x.y, -x.x, 0.0));
            };
        }
        // as they were then
        three!(0, 0, of_r, -1.0);
        three!(3, 3, of_v, -1.0);
        three!(skew, 0, of_r, scaled(o, -1.0));
        three!(skew, 3, of_v, scaled(m, -1.0));
        macro_rules! noise {
            ($($row:literal)*) => {
                $(q[$row] = self.noise(
                    &[
                        Three::new(h[0][$row], h[1][$row], h[2][$row]),
                        Three::new(h[3][$row], h[4][$row], h[5][$row]),
                        Three::new(h[6][$row], h[7][$row], h[8][$row]),
                    ],
                    noise,
                );)*
            };
        }
        noise!(0 1 2 3 4 5);
        three!(3, 0, of_r, self.t);
        three!(skew, 0, of_r, scaled(&plus(o, &self.g), -1.0));
        three!(skew, 3, of_v, minus(&self.f, m));
        let turned = columns(&rows.turned);
        macro_rules! bias {
            ($k:literal) => {
                let c = &self.c[$k];
                set!(9 + $k, 0, of_r, minus(&cross(c, o), &self.u[$k]));
                set!(
                    9 + $k,
                    3,
                    of_v,
                    plus(&plus(&turned[$k], &cross(c, m)), &self.w[$k])
                );
                set!(12 + $k, 0, of_r, scaled(&self.d[$k], -1.0));
                set!(12 + $k, 3, of_v, *c);
            };
        }
        bias!(0);
        bias!(1);
        bias!(2);
        q
    }

    /// Variance that the process noise since then has in a row of then: its elements on δr, δv and ψ.
    #[inline(always)]
    fn noise(&self, [r, v, psi]: &[Three; 3], noise: &NoiseDensity<f32>) -> f32 {
        let (on_v, on_psi) = (noise.velocity * self.t, noise.attitude * self.t);
        let on_r = on_v * self.t * self.t * (1.0 / 3.0);
        dot(r, r) * on_r + dot(v, v) * on_v + dot(psi, psi) * on_psi
    }
}

/// Position, velocity and attitude of an error or a row.
#[inline(always)]
fn motion(x: &[f32; N]) -> [Three; 3] {
    [
        Three::new(x[0], x[1], x[2]),
        Three::new(x[3], x[4], x[5]),
        Three::new(x[6], x[7], x[8]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Euler;
    use crate::earth::Geodetic;
    use crate::imu::ImuIncrement;
    use crate::measurement::{Accuracy, Antenna, Position, PositionVelocity, Velocity};
    use crate::nav::NavState;
    use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

    fn undone(segment: &Interval<f32>, dx: SVector<f32, N>) -> SVector<f32, N> {
        let mut dx: [f32; N] = dx.into();
        undo(segment, &mut dx);
        dx.into()
    }

    #[test]
    fn rows_are_the_way_back_of_the_error() {
        // Two different segments; the row of each state is that component of what `undo` gives.
        let segment = |k: f32| Interval {
            c_dt: Matrix3::new(0.3, -0.2, 0.1, 0.4, 0.5, -0.6, 0.7, 0.1, 0.2) * k,
            f_dt: Vector3::new(1.0, -2.0, 9.0) * k,
            dt: 0.5 * k,
        };
        let (old, new) = (segment(0.7), segment(0.4));
        let mut back = Back::NONE;
        back.over(&new);
        back.over(&old);
        let mut h = SMatrix::<f32, N, N>::identity();
        for mut row in h.row_iter_mut() {
            let mut now: [f32; N] = core::array::from_fn(|j| row[j]);
            back.carry(&mut now, &NoiseDensity::zero());
            row.copy_from_slice(&now);
        }
        for j in 0..N {
            let dx = SVector::<f32, N>::ith(j, 1.0);
            let then = undone(&old, undone(&new, dx));
            // a dozen products of order one
            assert!((h.column(j) - then).amax() < 2e-6, "column {j}");
        }
        assert!((back.t - 0.55).abs() < 1e-6);
    }

    #[test]
    fn the_rows_of_an_antenna_are_carried_like_any_rows() {
        let mut back = Back::NONE;
        back.over(&Interval {
            c_dt: Matrix3::new(0.3, -0.2, 0.1, 0.4, 0.5, -0.6, 0.7, 0.1, 0.2),
            f_dt: Vector3::new(1.0, -2.0, 9.0),
            dt: 0.3,
        });
        let place = Geodetic::from_degrees(47.3, 8.5, 500.0);
        let (v, angles) = (
            Vector3::new(15.0, -20.0, 4.0),
            Euler::from_degrees(130.0, 20.0, -35.0),
        );
        let mut nav = NavState::new(place, v, angles).unwrap();
        let turn = Vector3::new(0.3, -0.5, 0.8);
        nav.advance(&ImuIncrement::from_rates(turn, v, 0.01))
            .unwrap();
        let r = Matrix3::new(4.0, -1.0, 0.5, -1.0, 9.0, 2.0, 0.5, 2.0, 25.0);
        let fix = PositionVelocity::new(
            Position::with_accuracy(place, Accuracy::covariance(&r).unwrap(), 1.0).unwrap(),
            Velocity::with_accuracy(v, Accuracy::covariance(&(r * 0.1)).unwrap(), 1.0).unwrap(),
            Antenna::new(Vector3::new(0.5, -1.0, 1.2)).unwrap(),
        );
        let rows = fix.linearize(&nav).h;
        let noise = NoiseDensity::from_random_walks(0.1, 0.2);
        let mut h = [[0.0; 6]; N];
        let q = back.antenna(&rows, &noise, &mut h);
        let then: SMatrix<f32, 6, N> = rows.elements();
        for m in 0..6 {
            let mut row: [f32; N] = core::array::from_fn(|j| then[(m, j)]);
            let noise = back.carry(&mut row, &noise);
            // a dozen products of order one to ten
            assert!((noise - q[m]).abs() < 1e-6 * noise, "row {m}");
            for j in 0..N {
                assert!((row[j] - h[j][m]).abs() < 5e-6, "row {m}, column {j}");
            }
        }
    }

    /// Two navigators with the same samples, one of them wrong from the start: `undo` of what is between them at the end
    /// is what was between them at the beginning, for an error of every state.
    #[test]
    fn what_is_undone_is_what_the_navigator_did() {
        let start = NavState::new(
            Geodetic::from_degrees(47.3, 8.5, 500.0),
            Vector3::new(15.0, -20.0, 4.0),
            Euler::from_degrees(130.0, 20.0, -35.0),
        )
        .unwrap();
        let imu = ImuIncrement::from_rates(
            Vector3::new(0.3, -0.5, 0.8),
            Vector3::new(1.0, -2.0, 9.0),
            0.01,
        );
        let mut segment = Interval::empty();
        let mut end = start;
        for _ in 0..50 {
            segment.accumulate(&end.advance(&imu).unwrap());
        }
        // the way forwards is the inverse
        let mut back = SMatrix::<f32, N, N>::zeros();
        for j in 0..N {
            back.set_column(j, &undone(&segment, SVector::ith(j, 1.0)));
        }
        let forwards = back.try_inverse().unwrap();
        // m, m/s, rad, rad/s, m/s²
        for (j, size) in [10.0, 1.0, 0.01, 0.02, 0.5]
            .iter()
            .enumerate()
            .flat_map(|(k, s)| [(3 * k, s), (3 * k + 1, s), (3 * k + 2, s)])
        {
            let dx = SVector::<f32, N>::ith(j, *size);
            let mut other = start.corrected(&dx);
            for _ in 0..50 {
                other.advance(&imu).unwrap();
            }
            let ours = end.corrected(&(forwards * dx));
            // Products of the error and an even turn of 0.5 rad that is taken for its chord: 1.8e-3 m/s for a gyro bias of
            // 0.02 rad/s, 4e-3 m for an accelerometer bias of 0.5 m/s². A wrong sign is twice the effect: 0.1 m/s, 0.12 m,
            // 0.02 rad.
            let r = ours.displacement_to(&other.position()).unwrap();
            let v = ours.v_n() - other.v_n();
            let turned = (ours.c_b_n() * other.c_b_n().transpose() - Matrix3::identity()).amax();
            assert!(r.amax() < 5e-3, "{j}: {r}");
            assert!(v.amax() < 5e-3, "{j}: {v}");
            assert!(turned < 5e-4, "{j}: {turned}");
        }
    }
}
