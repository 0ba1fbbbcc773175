//! `lab analyze`: every way of looking at one numeric model, and whether they agree.

use std::path::PathBuf;

use nalgebra::{SMatrix, SVector};
use navsight::covariance::{Covariance, Observation, Rows};
use navsight::error_model::discrete::phi_minus_identity;
use navsight::observability::agreement::{direction, DirectionView, Limits, View};
use navsight::observability::ceiling::{ceiling, unseen_share, Gramian};
use navsight::observability::comprehensive::combinations;
use navsight::observability::eigen_degree::{Eigen, EigenDegree, Form};
use navsight::observability::pwcs::{Kind, Scale, Staged};
use navsight::observability::structural::{
    Changes, Class, Pattern, Report, Segments, MAX_SEGMENTS,
};
use serde::Deserialize;
use serde_json::{json, Map, Value};

use super::json::Source;
use super::{json, print_json, structural, LabError};
use crate::report::{graph, short, Page, Table, Tone};

/// Room for states and for rows; what is not used stays zero and is left out of the output.
const N: usize = 32;
/// Elements of a packed triangle of `N`.
const PACKED: usize = N * (N + 1) / 2;
/// Gravity of the canonical units [m/s²].
const GRAVITY: f64 = 9.80665;
/// Entries below this part of their row, in σ0 units, are no edge: what rounding leaves of cos 90°.
const NO_EDGE: f64 = 1e-9;
/// Couplings below this, prior-weighted, are left out of `couplings`.
const NO_COUPLING: f64 = 1e-6;

type Matrix = SMatrix<f64, N, N>;

/// Flags of the command.
#[derive(clap::Args)]
pub struct Args {
    /// JSON: `states` {name, kind}, `segments` {f, h, duration_s}, `sigma0`, `r_sigma`, `q` (density, optional), `t_update_s`, `time_unit_s`
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Writes report.html with the pictures into this folder
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// One JSON object on standard output instead of tables
    #[arg(long)]
    json: bool,
}

#[derive(Deserialize)]
struct Model {
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
struct Fixed {
    names: Vec<String>,
    outputs: usize,
    segments: Vec<(Matrix, Matrix, f64)>,
    sigma: SVector<f64, N>,
    kinds: [Kind; N],
    r_sigma: [f64; N],
    q: SVector<f64, N>,
    t: f64,
    time_unit: f64,
}

/// Reads, runs, prints.
pub fn run(args: &Args) -> Result<(), LabError> {
    let (model, source) = json::read::<Model>(&args.model)?;
    let model = model.fix(&source)?;
    let found = model.analyse()?;
    if let Some(folder) = &args.report {
        eprintln!("{}", found.page(&model).write(folder)?.display());
    }
    if args.json {
        print_json(&found.json(&model))
    } else {
        println!("{}", found.table(&model).to_text());
        for sentence in &found.sentences {
            println!("{sentence}.");
        }
        Ok(())
    }
}

impl Model {
    fn fix(self, source: &Source) -> Result<Fixed, LabError> {
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

/// What was found.
struct Found {
    staged: Staged<f64, N, N>,
    rank_total: usize,
    eigen: Vec<Vec<Eigen<f64, N>>>,
    patterns: Vec<Pattern<N>>,
    reports: Vec<Report>,
    bound: navsight::observability::structural::Bound<N>,
    share: [f64; N],
    xi2: Vec<f64>,
    views: Vec<View<f64>>,
    sentences: Vec<String>,
    directions: Vec<([f64; N], DirectionView<f64>)>,
    limits: Limits<f64>,
}

impl Fixed {
    fn n(&self) -> usize {
        self.names.len()
    }

    fn scale(&self) -> Scale<f64, N> {
        let mut scale = Scale::canonical(&self.kinds, &self.sigma, GRAVITY);
        scale.time = self.time_unit;
        for (unit, kind) in scale.unit.iter_mut().zip(&self.kinds) {
            *unit = kind.unit(self.time_unit, GRAVITY);
        }
        scale
    }

    fn analyse(&self) -> Result<Found, LabError> {
        let refused = |e| LabError::plain(format!("the model is refused: {e:?}"));
        let n = self.n();
        let new = || Staged::<f64, N, N>::new(&self.scale()).map_err(refused);
        let (mut staged, mut total) = (new()?, new()?);
        let mut before = Matrix::identity();
        let mut eigen = Vec::new();
        for (k, (f, h, duration)) in self.segments.iter().enumerate() {
            staged.segment(f, h, None).map_err(refused)?;
            total
                .segment(f, h, (k > 0).then_some(&before))
                .map_err(refused)?;
            before = transition(f, *duration) * before;
            let mut own = new()?;
            own.segment(f, h, None).map_err(refused)?;
            let mut form = Form::scaled(self.sigma.data.0[0], self.r_sigma, *duration);
            form.blocks = n;
            let degree = EigenDegree::new(f, h, &form, &own).map_err(refused)?.run(f);
            // Room that no state uses comes out as combinations of nothing.
            eigen.push(
                degree
                    .all()
                    .filter(|e| e.vector[..n].iter().any(|x| *x != 0.0))
                    .collect(),
            );
        }
        let mut patterns = Vec::new();
        let mut segments: Option<Segments<N>> = None;
        for (f, h, _) in &self.segments {
            let p = self.pattern(f, h).map_err(refused)?;
            match &mut segments {
                None => segments = Some(Segments::new(&p)),
                Some(all) => {
                    let changes =
                        Changes::between(f, &self.segments[0].0, 1e-9).map_err(refused)?;
                    all.add(&p, &changes).map_err(refused)?;
                }
            }
            patterns.push(p);
        }
        let reports: Vec<Report> = patterns.iter().map(Report::new).collect();
        let bound = segments
            .map(|s| s.bound(&patterns))
            .ok_or_else(|| LabError::plain("no segment"))?;
        let class = |j: usize| match reports.as_slice() {
            [one] => one.class(j),
            _ if bound.always >> j & 1 == 1 => Class::Unique,
            _ if bound.reach >> j & 1 == 1 => Class::Coupled,
            _ => Class::Unseen,
        };
        let (xi2, directions) = self.filter(&staged)?;
        let limits = Limits::default();
        let views: Vec<View<f64>> = (0..n)
            .map(|j| View::of(&staged, j, Some(class(j)), Some(xi2[j]), &limits))
            .collect();
        let mut names = [""; N];
        for (slot, name) in names.iter_mut().zip(&self.names) {
            *slot = name;
        }
        let sentences = views
            .iter()
            .map(|v| v.sentence(&limits, &names, &self.kinds).to_string())
            .collect();
        Ok(Found {
            share: unseen_share(&staged),
            rank_total: total.rank(),
            staged,
            eigen,
            patterns,
            reports,
            bound,
            xi2,
            views,
            sentences,
            directions,
            limits,
        })
    }

    /// Pattern of one segment: self-loops of biases are Markov decays and count as zero.
    fn pattern(&self, f: &Matrix, h: &Matrix) -> Result<Pattern<N>, navsight::error::Error> {
        let n = self.n();
        let mut markov = 0;
        for (j, kind) in self.kinds.iter().enumerate() {
            if matches!(kind, Kind::GyroBias | Kind::AccelBias) {
                markov |= 1 << j;
            }
        }
        let wide = Pattern::from_model(f, h, &self.sigma, NO_EDGE, markov)?;
        let mut pattern = Pattern::new(n, self.outputs)?;
        for j in 0..n {
            for i in 0..n {
                if wide.to(j) >> i & 1 == 1 {
                    pattern.connect(j, i)?;
                }
            }
            for k in 0..self.outputs {
                if wide.out(j) >> k & 1 == 1 {
                    pattern.observe(j, k)?;
                }
            }
        }
        Ok(pattern)
    }

    /// Covariance analysis over all segments with the library's kernel: ξ2 at the end, and every direction of the
    /// information with what the filter says along it.
    #[allow(clippy::type_complexity)]
    fn filter(
        &self,
        staged: &Staged<f64, N, N>,
    ) -> Result<(Vec<f64>, Vec<([f64; N], DirectionView<f64>)>), LabError> {
        let refused = |e| LabError::plain(format!("the covariance analysis stopped: {e:?}"));
        let n = self.n();
        let mut p = Covariance::<f64, N, PACKED>::from_diagonal(&[1.0; N]).map_err(refused)?;
        let mut gramian = Gramian::<f64, N>::new();
        let steps = |duration: f64| ((duration / self.t).round() as u64).max(1);
        let all: u64 = self.segments.iter().map(|s| steps(s.2)).sum();
        let bar = super::progress(all, "covariance analysis");
        for (f, h, duration) in &self.segments {
            let a = phi_minus_identity(f, self.t, 8);
            let a = Matrix::from_fn(|i, j| a[(i, j)] * self.sigma[j] / self.sigma[i]);
            let q = SVector::<f64, N>::from_fn(|i, _| {
                self.q[i] * self.t / (self.sigma[i] * self.sigma[i])
            });
            for _ in 0..steps(*duration) {
                p.propagate(&a, &q);
                gramian.propagate(&a);
                for (m, r) in self.r_sigma.iter().take(self.outputs).enumerate() {
                    let row = SVector::<f64, N>::from_fn(|j, _| h[(m, j)] * self.sigma[j] / r);
                    gramian.observe(&row);
                    p.update(&Rows {
                        nu: [0.0],
                        h: Observation::Dense(row.transpose()),
                        r: [1.0],
                        gate: None,
                    })
                    .map_err(refused)?;
                }
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        let xi2 = p.diagonal().iter().take(n).map(|p| 1.0 / p).collect();
        let information = gramian.information();
        let left = p.to_matrix();
        let limits = Limits::default();
        let directions = information
            .directions
            .iter()
            .filter(|v| v[..n].iter().any(|x| *x != 0.0))
            .map(|v| {
                let column = SVector::<f64, N>::from(*v);
                let eta2 = 1.0 / (column.transpose() * left * column).x;
                (*v, direction(staged, v, eta2, &limits))
            })
            .collect();
        Ok((xi2, directions))
    }
}

/// exp(F t) by scaling and squaring.
fn transition(f: &Matrix, t: f64) -> Matrix {
    let halvings = ((f.abs().max() * t).log2().ceil() + 3.0).clamp(0.0, 40.0) as i32;
    let mut phi = Matrix::identity() + phi_minus_identity(f, t / 2f64.powi(halvings), 12);
    for _ in 0..halvings {
        phi = phi * phi;
    }
    phi
}

/// A number, or null where it is none.
fn number(x: f64) -> Value {
    if x.is_finite() {
        json!(x)
    } else {
        Value::Null
    }
}

const fn word(class: Class) -> &'static str {
    match class {
        Class::Unique => "unique",
        Class::Coupled => "coupled",
        Class::Unseen => "unseen",
    }
}

impl Found {
    fn json(&self, model: &Fixed) -> Value {
        let n = model.n();
        let named = |v: &[f64; N], least: f64| {
            let mut map = Map::new();
            for (name, x) in model.names.iter().zip(v).filter(|(_, x)| x.abs() > least) {
                map.insert(name.clone(), number(*x));
            }
            Value::Object(map)
        };
        let rows: Vec<Value> = combinations(&self.staged)
            .map(|c| {
                let mut couplings = c.coupling;
                couplings[c.pivot] = 0.0;
                json!({
                    "pivot": model.names[c.pivot], "order": c.order, "degree": number(c.degree),
                    "couplings": named(&couplings, NO_COUPLING),
                    "strict": c.kept(NO_COUPLING) == 1 << c.pivot,
                })
            })
            .collect();
        let eigen = |list: &[Eigen<f64, N>]| {
            list.iter()
                .map(|e| {
                    json!({
                        "lambda": number(e.lambda), "naive_order": e.naive_order,
                        "min_order": e.min_order, "combination": named(&e.vector, 1e-6),
                    })
                })
                .collect::<Vec<_>>()
        };
        let mut agreement = Map::new();
        for (view, sentence) in self.views.iter().zip(&self.sentences) {
            agreement.insert(
                model.names[view.state].clone(),
                json!({ "flag": view.flag(&self.limits).name(), "sentence": sentence }),
            );
        }
        json!({
            "states": model.names,
            "rank": self.staged.rank(),
            "rank_total": self.rank_total,
            "rows": rows,
            "eigen": eigen(&self.eigen[0]),
            "eigen_segments": self.eigen.iter().map(|list| eigen(list)).collect::<Vec<_>>(),
            "ceilings": model.names.iter().zip(&self.share).zip(&self.xi2).map(|((name, s), xi2)| {
                (name.clone(), json!({
                    "unseen_share": s, "ceiling": ceiling(*s), "saturation": number(s * xi2),
                }))
            }).collect::<Map<_, _>>(),
            "structural": {
                "is_upper_bound": true,
                "segments": self.reports.iter().map(|r| json!({
                    "reach": r.reach, "nu": r.nu, "d": r.d, "unique": r.unique, "coupled": r.coupled,
                    "unseen": r.unseen, "premise": r.premise, "structurally_observable": r.observable,
                })).collect::<Vec<_>>(),
                "diff_bound": self.bound.bound, "diff_dm_always": self.bound.always,
                "class": model.names.iter().zip(&self.views)
                    .map(|(name, v)| (name.clone(), json!(v.class.map(word)))).collect::<Map<_, _>>(),
            },
            "xi2": self.xi2[..n].iter().map(|x| number(*x)).collect::<Vec<_>>(),
            "agreement": agreement,
            "directions": self.directions.iter().map(|(v, d)| json!({
                "combination": named(v, 1e-6), "eta2": number(d.eta2), "unseen_share": d.share,
                "flag": d.flag.name(),
            })).collect::<Vec<_>>(),
        })
    }

    fn table(&self, model: &Fixed) -> Table {
        let caption = format!(
            "rank {} of {} (stripped), {} (total); structural bound {}",
            self.staged.rank(),
            model.n(),
            self.rank_total,
            self.bound.bound
        );
        let mut table = Table::new(
            caption,
            [
                "state",
                "structure",
                "order",
                "degree",
                "strict",
                "ceiling",
                "ξ2",
                "flag",
            ],
        );
        for v in &self.views {
            table.row([
                model.names[v.state].clone(),
                v.class.map_or("", word).into(),
                v.order.map_or("–".into(), |k| k.to_string()),
                v.degree.map_or("–".into(), short),
                if v.strict { "yes" } else { "no" }.into(),
                v.ceiling()
                    .filter(|c| *c < 1e12)
                    .map_or("none".into(), short),
                short(self.xi2[v.state]),
                v.flag(&self.limits).name().into(),
            ]);
        }
        table
    }

    fn page(&self, model: &Fixed) -> Page {
        let mut page = Page::new(
            "What can be learnt, and why not",
            "One model, every way of looking at its observability, and where they disagree.",
        );
        for (view, sentence) in self.views.iter().zip(&self.sentences) {
            let tone = match view.flag(&self.limits).name() {
                "agree" => Tone::Good,
                "contradiction" => Tone::Bad,
                _ => Tone::Note,
            };
            page.verdict(tone, &model.names[view.state], &format!("{sentence}."));
        }
        page.section("State by method");
        page.table(&self.table(model));
        page.figures(
            1,
            &[self.heat(model)],
            "Full: seen. Pale: not seen. Saturation is ξ2 over its ceiling.",
        );
        for (k, p) in self.patterns.iter().enumerate() {
            page.section(&format!("Structure of segment {}", k + 1));
            let outputs: Vec<String> = (1..=model.outputs).map(|i| format!("z{i}")).collect();
            page.figures(
                2,
                &structural::pictures(p, &model.names, &outputs),
                "Left: states and what they act on, a maximum matching marked. Right: disjoint paths from the initial \
                 states to the outputs, one column for each derivative.",
            );
        }
        page.section("Directions, most informed first (σ0 units)");
        let bars: Vec<String> = self
            .directions
            .iter()
            .map(|(v, d)| {
                let title = format!("η2 {} ({})", short(d.eta2), d.flag.name());
                graph::bars(&title, &model.names, &v[..model.n()])
            })
            .collect();
        page.figures(
            3,
            &bars,
            "Eigen-directions of the information; η2 is what the filter has left along them.",
        );
        page
    }

    fn heat(&self, model: &Fixed) -> String {
        let cells: Vec<Vec<(f64, String)>> = self
            .views
            .iter()
            .map(|v| {
                let class = match v.class {
                    Some(Class::Unique) => 1.0,
                    Some(Class::Coupled) => 0.5,
                    _ => 0.0,
                };
                let order = v.order.map_or(0.0, |k| 1.0 - f64::from(k) / 5.0);
                let xi2 = self.xi2[v.state];
                let saturation = if v.share > 1e-12 { v.share * xi2 } else { 1.0 };
                vec![
                    (class, v.class.map_or("", word).into()),
                    (order, v.order.map_or("–".into(), |k| format!("order {k}"))),
                    (1.0 - v.share, short(1.0 - v.share)),
                    (xi2.log10() / 6.0, short(xi2)),
                    (saturation, short(saturation)),
                ]
            })
            .collect();
        graph::heat_map(
            &model.names,
            &[
                "structure",
                "Peng order",
                "Yang seen share",
                "ξ2",
                "saturation",
            ],
            &cells,
        )
    }
}
