//! The model as it is written in JSON, and in fixed size once it makes sense.

use nalgebra::SVector;
use navsight::observability::pwcs::Kind;
use navsight::observability::structural::MAX_SEGMENTS;
use serde::Deserialize;

use super::{Matrix, N};
use crate::lab::json::Source;
use crate::lab::LabError;

#[derive(Deserialize)]
pub struct Model {
    states: Vec<State>,
    segments: Vec<Segment>,
    sigma0: Vec<f64>,
    r_sigma: Vec<f64>,
    q: Option<Vec<f64>>,
    t_update_s: f64,
    #[serde(default = "three_hundred")]
    time_unit_s: f64,
}

fn three_hundred() -> f64 {
    300.0
}

#[derive(Deserialize)]
struct State {
    name: String,
    kind: Word,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Word {
    Position,
    Velocity,
    Attitude,
    GyroBias,
    AccelBias,
    Other,
}

#[derive(Deserialize)]
struct Segment {
    f: Vec<Vec<f64>>,
    h: Vec<Vec<f64>>,
    duration_s: f64,
}

/// The model in fixed size.
pub struct Fixed {
    pub names: Vec<String>,
    pub outputs: usize,
    pub segments: Vec<(Matrix, Matrix, f64)>,
    pub sigma: SVector<f64, N>,
    pub kinds: [Kind; N],
    pub r_sigma: [f64; N],
    pub q: SVector<f64, N>,
    pub t: f64,
    pub time_unit: f64,
}

impl Model {
    /// Refuses what is no model, with line and field.
    pub fn fix(self, source: &Source) -> Result<Fixed, LabError> {
        let n = self.states.len();
        let wrong = |key: &str, field: String, what: String| Err(source.wrong(key, field, what));
        if n == 0 || n > N {
            return wrong(
                "states",
                "states".into(),
                format!("{n} states; 1 to {N} are possible"),
            );
        }
        if self.segments.is_empty() || self.segments.len() > MAX_SEGMENTS {
            let what = format!("{}; 1 to {MAX_SEGMENTS} are possible", self.segments.len());
            return wrong("segments", "segments".into(), what);
        }
        let m = self.r_sigma.len();
        if m == 0 || m > N {
            return wrong(
                "r_sigma",
                "r_sigma".into(),
                format!("{m} rows; 1 to {N} are possible"),
            );
        }
        for (key, list, size, least) in [
            ("sigma0", Some(&self.sigma0), n, f64::MIN_POSITIVE),
            ("r_sigma", Some(&self.r_sigma), m, f64::MIN_POSITIVE),
            ("q", self.q.as_ref(), n, 0.0),
        ] {
            let Some(list) = list else { continue };
            if list.len() != size {
                return wrong(
                    key,
                    key.into(),
                    format!("{} numbers, not {size}", list.len()),
                );
            }
            if let Some(i) = list.iter().position(|x| !x.is_finite() || *x < least) {
                return wrong(
                    key,
                    format!("{key}[{i}]"),
                    format!("{} is not possible", list[i]),
                );
            }
        }
        for (key, x) in [
            ("t_update_s", self.t_update_s),
            ("time_unit_s", self.time_unit_s),
        ] {
            if !(x.is_finite() && x > 0.0) {
                return wrong(key, key.into(), format!("{x} is not a time above 0"));
            }
        }
        let table = |rows: &[Vec<f64>], count: usize, key: &str, field: String| {
            if rows.len() != count {
                let what = format!("{} rows, not {count}", rows.len());
                return Err(source.wrong(key, field, what));
            }
            let mut matrix = Matrix::zeros();
            for (i, row) in rows.iter().enumerate() {
                if row.len() != n {
                    let what = format!("row {i} has {} numbers, not {n}", row.len());
                    return Err(source.wrong(key, field, what));
                }
                for (j, x) in row.iter().enumerate() {
                    if !x.is_finite() {
                        return Err(source.wrong(key, field, format!("[{i}][{j}] is not finite")));
                    }
                    matrix[(i, j)] = *x;
                }
            }
            Ok(matrix)
        };
        let mut segments = Vec::new();
        for (k, s) in self.segments.iter().enumerate() {
            let f = table(&s.f, n, "f", format!("segments[{k}].f"))?;
            let h = table(&s.h, m, "h", format!("segments[{k}].h"))?;
            if !(s.duration_s.is_finite() && s.duration_s > 0.0 && s.duration_s <= 1e7) {
                let what = format!("{} is not a duration above 0 and below 1e7", s.duration_s);
                return wrong("duration_s", format!("segments[{k}].duration_s"), what);
            }
            if s.duration_s / self.t_update_s > 1e6 {
                let what = "more than a million updates in a segment".into();
                return wrong("t_update_s", "t_update_s".into(), what);
            }
            segments.push((f, h, s.duration_s));
        }
        let mut kinds = [Kind::Other; N];
        for (kind, state) in kinds.iter_mut().zip(&self.states) {
            *kind = match state.kind {
                Word::Position => Kind::Position,
                Word::Velocity => Kind::Velocity,
                Word::Attitude => Kind::Attitude,
                Word::GyroBias => Kind::GyroBias,
                Word::AccelBias => Kind::AccelBias,
                Word::Other => Kind::Other,
            };
        }
        let mut fixed = Fixed {
            names: self.states.into_iter().map(|s| s.name).collect(),
            outputs: m,
            segments,
            sigma: SVector::repeat(1.0),
            kinds,
            r_sigma: [1.0; N],
            q: SVector::zeros(),
            t: self.t_update_s,
            time_unit: self.time_unit_s,
        };
        fixed.sigma.as_mut_slice()[..n].copy_from_slice(&self.sigma0);
        fixed.r_sigma[..m].copy_from_slice(&self.r_sigma);
        if let Some(q) = self.q {
            fixed.q.as_mut_slice()[..n].copy_from_slice(&q);
        }
        Ok(fixed)
    }
}
