//! The navigation solution with its standard deviations, in degrees and the like.

use nalgebra::{Matrix3, Vector3};
use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use navsight::error_model::{ATT, BA, BG, POS, VEL};
use navsight::filter::Filter;
use serde_json::{json, Map, Value};

use crate::config::{DEG_PER_H, MICRO_G};
use crate::report::{short, Table};

/// What the filter says at one instant.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Heading, pitch, roll [°].
    pub angles_deg: [f64; 3],
    /// Their standard deviations [°].
    pub angles_deg_sigma: [f64; 3],
    /// Velocity east, north, up [m/s].
    pub v_n: [f64; 3],
    /// Its standard deviation.
    pub v_n_sigma: [f64; 3],
    /// Latitude [°], longitude [°], height [m].
    pub place: [f64; 3],
    /// Their standard deviations.
    pub place_sigma: [f64; 3],
    /// Gyro biases, right, forward, up [°/h].
    pub gyro_bias_deg_h: [f64; 3],
    /// Their standard deviations.
    pub gyro_bias_deg_h_sigma: [f64; 3],
    /// Accelerometer biases [µg].
    pub accel_bias_ug: [f64; 3],
    /// Their standard deviations.
    pub accel_bias_ug_sigma: [f64; 3],
}

/// Heading in 0 … 360°, pitch, roll.
pub fn angles_deg(c_b_n: &Matrix3<f32>) -> [f64; 3] {
    let euler = Euler::from_c_b_n(c_b_n);
    let [heading, pitch, roll] =
        [euler.heading, euler.pitch, euler.roll].map(|a| f64::from(a).to_degrees());
    [heading.rem_euclid(360.0), pitch, roll]
}

/// The shorter way from one angle to another [°].
pub fn turn_deg(from: f64, to: f64) -> f64 {
    (to - from + 180.0).rem_euclid(360.0) - 180.0
}

/// ∂(heading, pitch, roll)/∂φ of Ĉ = (I − [φ×]) C, at this attitude.
///
/// ```text
/// heading: φ_U − tan p (φ_E sin h + φ_N cos h),   pitch: −φ_E cos h + φ_N sin h,
/// roll: −(φ_E sin h + φ_N cos h)/cos p
/// ```
fn angle_rows(angles_deg: &[f64; 3]) -> Matrix3<f64> {
    let (sh, ch) = angles_deg[0].to_radians().sin_cos();
    let (sp, cp) = angles_deg[1].to_radians().sin_cos();
    let cp = if cp.abs() > 1e-6 { cp } else { 1e-6 };
    Matrix3::new(
        -sh * sp / cp,
        -ch * sp / cp,
        1.0,
        -ch,
        sh,
        0.0,
        -sh / cp,
        -ch / cp,
        0.0,
    )
}

impl Solution {
    /// From a running filter.
    pub fn of(filter: &Filter) -> Self {
        let nav = filter.nav();
        let sigma =
            |first: usize| [0, 1, 2].map(|i| filter.sigma(first + i).map_or(f64::NAN, f64::from));
        let angles = angles_deg(&nav.c_b_n());
        let sigma0 = filter.sigma0();
        let p_psi = Matrix3::from_fn(|i, j| {
            let p = f64::from(filter.covariance().element(ATT + i, ATT + j));
            p * f64::from(sigma0[ATT + i]) * f64::from(sigma0[ATT + j])
        });
        let rows = angle_rows(&angles);
        let p_angles = rows * p_psi * rows.transpose();
        let (lat, lon, height) = nav.position().to_degrees();
        let local = nav.local();
        let [east, north, up] = sigma(POS);
        let scaled = |v: [f64; 3], unit: f64| v.map(|x| x / unit);
        let wide = |v: Vector3<f32>| [v.x, v.y, v.z].map(f64::from);
        Self {
            angles_deg: angles,
            angles_deg_sigma: [0, 1, 2].map(|i| p_angles[(i, i)].sqrt().to_degrees()),
            v_n: wide(nav.v_n()),
            v_n_sigma: sigma(VEL),
            place: [lat, lon, height],
            place_sigma: [
                (north * f64::from(local.inv_r_m)).to_degrees(),
                (east * f64::from(local.inv_r_n * local.inv_cos_lat)).to_degrees(),
                up,
            ],
            gyro_bias_deg_h: scaled(wide(nav.b_g()), DEG_PER_H),
            gyro_bias_deg_h_sigma: scaled(sigma(BG), DEG_PER_H),
            accel_bias_ug: scaled(wide(nav.b_a()), MICRO_G),
            accel_bias_ug_sigma: scaled(sigma(BA), MICRO_G),
        }
    }

    /// The object of the lab's JSON; a number that is not available is null.
    pub fn json(&self) -> Value {
        let mut object = Map::new();
        let mut put = |name: &str, value: Value, sigma: Value| {
            object.insert(name.to_owned(), value);
            object.insert(format!("{name}_sigma"), sigma);
        };
        for (i, name) in ["heading_deg", "pitch_deg", "roll_deg"].iter().enumerate() {
            put(
                name,
                json!(self.angles_deg[i]),
                json!(self.angles_deg_sigma[i]),
            );
        }
        put("v_n_m_s", json!(self.v_n), json!(self.v_n_sigma));
        for (i, name) in ["lat_deg", "lon_deg", "height_m"].iter().enumerate() {
            put(name, json!(self.place[i]), json!(self.place_sigma[i]));
        }
        put(
            "gyro_bias_deg_h",
            json!(self.gyro_bias_deg_h),
            json!(self.gyro_bias_deg_h_sigma),
        );
        put(
            "accel_bias_ug",
            json!(self.accel_bias_ug),
            json!(self.accel_bias_ug_sigma),
        );
        Value::Object(object)
    }

    /// Where the vehicle is.
    pub fn position(&self) -> Geodetic {
        let [lat, lon, height] = self.place;
        Geodetic::from_degrees(lat, lon, height)
    }
}

/// Several solutions side by side, each value with its ±1σ.
pub fn table(caption: &str, solutions: &[(&str, &Solution)]) -> Table {
    let mut table = Table::new(
        caption,
        ["quantity", "unit"]
            .into_iter()
            .chain(solutions.iter().flat_map(|(name, _)| [*name, "± 1σ"])),
    );
    type Get = fn(&Solution) -> (f64, f64);
    let rows: [(&str, &str, Get); 15] = [
        ("heading", "°", |s| {
            (s.angles_deg[0], s.angles_deg_sigma[0])
        }),
        ("pitch", "°", |s| (s.angles_deg[1], s.angles_deg_sigma[1])),
        ("roll", "°", |s| (s.angles_deg[2], s.angles_deg_sigma[2])),
        ("velocity east", "m/s", |s| (s.v_n[0], s.v_n_sigma[0])),
        ("velocity north", "m/s", |s| (s.v_n[1], s.v_n_sigma[1])),
        ("velocity up", "m/s", |s| (s.v_n[2], s.v_n_sigma[2])),
        ("latitude", "°", |s| (s.place[0], s.place_sigma[0])),
        ("longitude", "°", |s| (s.place[1], s.place_sigma[1])),
        ("height", "m", |s| (s.place[2], s.place_sigma[2])),
        ("gyro bias right", "°/h", |s| {
            (s.gyro_bias_deg_h[0], s.gyro_bias_deg_h_sigma[0])
        }),
        ("gyro bias forward", "°/h", |s| {
            (s.gyro_bias_deg_h[1], s.gyro_bias_deg_h_sigma[1])
        }),
        ("gyro bias up", "°/h", |s| {
            (s.gyro_bias_deg_h[2], s.gyro_bias_deg_h_sigma[2])
        }),
        ("accelerometer bias right", "µg", |s| {
            (s.accel_bias_ug[0], s.accel_bias_ug_sigma[0])
        }),
        ("accelerometer bias forward", "µg", |s| {
            (s.accel_bias_ug[1], s.accel_bias_ug_sigma[1])
        }),
        ("accelerometer bias up", "µg", |s| {
            (s.accel_bias_ug[2], s.accel_bias_ug_sigma[2])
        }),
    ];
    for (name, unit, get) in rows {
        let mut cells = vec![name.to_owned(), unit.to_owned()];
        for (_, solution) in solutions {
            let (value, sigma) = get(solution);
            cells.push(beside(value, sigma));
            cells.push(short(sigma));
        }
        table.row(cells);
    }
    table
}

/// A value with as many places as its standard deviation deserves, two digits of it.
fn beside(value: f64, sigma: f64) -> String {
    if !(value.is_finite() && sigma.is_finite() && sigma > 0.0) {
        return short(value);
    }
    let places = (1.0 - sigma.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.places$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angle_rows_are_the_derivative_of_the_angles() {
        // Central differences of 1e-3 rad in f32: rounding 2e-4, curvature 1e-6 times tan² and more of the pitch.
        let c = Euler::from_degrees(50.0, 20.0, -35.0).c_b_n();
        let rows = angle_rows(&angles_deg(&c));
        for j in 0..3 {
            let angles = |step: f32| {
                let psi = Vector3::<f32>::ith(j, step);
                let turned = nalgebra::Rotation3::new(-psi).matrix() * c;
                angles_deg(&turned)
            };
            let (plus, minus) = (angles(1e-3), angles(-1e-3));
            for i in 0..3 {
                let slope = turn_deg(minus[i], plus[i]).to_radians() / 2e-3;
                assert!(
                    (slope - rows[(i, j)]).abs() < 3e-4,
                    "{i} {j}: {slope} {}",
                    rows[(i, j)]
                );
            }
        }
    }

    #[test]
    fn values_show_two_digits_of_their_sigma() {
        assert_eq!(beside(90.58765, 0.0998), "90.588");
        assert_eq!(beside(-3.2159, 12.0), "-3");
        assert_eq!(beside(3.2159, f64::NAN), "3.216");
    }
}
