//! `lab analyze`: every way of looking at one numeric model, and whether they agree.

mod model;
mod pages;

use std::path::PathBuf;

use nalgebra::{SMatrix, SVector};
use navsight::covariance::{Covariance, Observation, Rows};
use navsight::error_model::discrete::phi_minus_identity;
use navsight::observability::agreement::{direction, DirectionView, Limits, View};
use navsight::observability::ceiling::{Gramian, Unseen};
use navsight::observability::eigen_degree::{Eigen, EigenDegree, Form};
use navsight::observability::pwcs::{Kind, Scale, Staged};
use navsight::observability::structural::{Changes, Class, Pattern, Report, Segments};

use super::{json, print_json, LabError};
use model::{Fixed, Model};

/// Room for states and for rows; what is not used stays zero and is left out of the output.
const N: usize = 32;
/// Elements of a packed triangle of `N`.
const PACKED: usize = N * (N + 1) / 2;
/// Gravity of the canonical units [m/s²].
const GRAVITY: f64 = 9.80665;
/// Entries below this part of their row, in σ0 units, are no edge: what rounding leaves of cos 90°.
const NO_EDGE: f64 = 1e-9;

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
            let mut degree = EigenDegree::new(f, h, &form, &own).map_err(refused)?;
            degree.run(f);
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
        let unseen = Unseen::of(&staged);
        let (xi2, directions) = self.filter(&unseen)?;
        let limits = Limits::default();
        let views: Vec<View<f64>> = (0..n)
            .map(|j| View::of(&staged, &unseen, j, Some(class(j)), Some(xi2[j]), &limits))
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
            share: unseen.shares(),
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
        unseen: &Unseen<f64, N>,
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
        let mut directions: Vec<_> = information
            .directions
            .iter()
            .filter(|v| v[..n].iter().any(|x| *x != 0.0))
            .map(|v| {
                let column = SVector::<f64, N>::from(*v);
                let eta2 = 1.0 / (column.transpose() * left * column).x;
                (*v, direction(unseen, v, eta2, &limits))
            })
            .collect();
        directions.sort_by(|(_, a), (_, b)| b.eta2.total_cmp(&a.eta2));
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
