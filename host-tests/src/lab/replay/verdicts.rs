//! Verdicts over a replay: what stands, what changed when and why, and the ceilings of a standing vehicle.

use nalgebra::{SMatrix, SVector, Vector3};
use navsight::error::Error;
use navsight::error_model::{psi, Environment, ATT, BA, N, VEL};
use navsight::filter::{Filter, UpdateReport};
use navsight::observability::ceiling::{ceiling, tilt_excess, Unseen, MARGIN};
use navsight::observability::pwcs::{Scale, Staged, NAVIGATION};
use navsight::observability::verdict::{Judgement, Limits, Verdict, Verdicts};
use serde_json::{json, Value};

use super::super::states::STATES;
use super::evidence::{Evidence, History};
use crate::config::Required;

/// The vertical is felt as the mean of so many seconds: shaking has gone from it.
const TILT_BLOCK: f32 = 10.0;

/// The verdicts and their history.
pub(super) struct Watch {
    verdicts: Verdicts,
    changes: Vec<Change>,
    history: History,
    sigma0: [f64; N],
    required: [Option<f32>; N],
    ceilings: [Option<f32>; N],
    /// Σ of the specific force [m/s] since that many seconds, and its direction in the body when the ceilings were made.
    force: (Vector3<f32>, f32),
    up: Option<Vector3<f32>>,
    /// Seconds since then.
    stood: f32,
    accel_bias: f32,
    walk: f32,
}

/// A verdict that changed.
struct Change {
    t: f64,
    state: usize,
    from: Judgement,
    to: Judgement,
    evidence: Evidence,
    sigma: f64,
    required: Option<f32>,
    ceiling: Option<f32>,
}

impl Watch {
    /// Beside a filter that has just been started; `standing` knows its ceilings.
    pub(super) fn new(filter: &Filter, required: &Required, standing: bool) -> Result<Self, Error> {
        let required = required.sigma();
        let mut verdicts = Verdicts::new(filter.sigma0(), &required, Limits::DEFAULT)?;
        let ceilings = match standing {
            true => ceilings(filter)?,
            false => [None; N],
        };
        verdicts.set_ceilings(&ceilings);
        Ok(Self {
            verdicts,
            changes: Vec::new(),
            history: History::default(),
            sigma0: filter.sigma0().map(f64::from),
            required,
            ceilings,
            force: (Vector3::zeros(), 0.0),
            up: None,
            stood: 0.0,
            accel_bias: filter.sigma0()[BA..].iter().copied().fold(0.0, f32::max),
            walk: filter.settings().noise.velocity.sqrt(),
        })
    }

    /// The updates of one instant: time of the recording and of the filter [s].
    pub(super) fn take<const M: usize>(
        &mut self,
        t: f64,
        filter_time: f64,
        reports: &[UpdateReport<M>],
    ) {
        for report in reports {
            self.history.take(filter_time, report);
            let before = self.verdicts.all();
            let changed = self.verdicts.take(filter_time, report);
            self.changed(t, before, changed);
        }
    }

    /// No update for a while: the variances of the filter now, σ0 units.
    pub(super) fn pass(&mut self, t: f64, filter_time: f64, p: &[f32; N]) {
        self.history.pass(filter_time, p);
        let before = self.verdicts.all();
        let changed = self.verdicts.pass(filter_time, p);
        self.changed(t, before, changed);
    }

    /// Bit i of `changed`: the verdict about state i is another one than before.
    fn changed(&mut self, t: f64, before: [Judgement; N], changed: u16) {
        for (state, (from, to)) in before.into_iter().zip(self.verdicts.all()).enumerate() {
            if changed >> state & 1 != 0 {
                let evidence = self.history.of(state);
                self.changes.push(Change {
                    t,
                    state,
                    from,
                    to,
                    evidence,
                    sigma: self.sigma0[state] * evidence.xi2.recip().sqrt(),
                    required: self.required[state],
                    ceiling: self.ceilings[state],
                });
            }
        }
    }

    /// A sample of a standing vehicle. One that tilts is in another position: tilts and accelerometers have no ceiling any
    /// more, but for those that stood above it before. The tilt is what the accelerometers feel, so that no correction of the filter is taken for one.
    pub(super) fn stands(&mut self, delta_v: &Vector3<f32>, dt: f32) {
        self.stood += dt;
        self.force.0 += delta_v;
        self.force.1 += dt;
        if self.force.1 < TILT_BLOCK {
            return;
        }
        let up = self.force.0.normalize();
        self.force = (Vector3::zeros(), 0.0);
        let tilt = up.cross(self.up.get_or_insert(up)).norm();
        let excess = tilt_excess(tilt, self.accel_bias, self.walk, self.stood);
        if excess > MARGIN as f32 {
            for i in [ATT, ATT + 1, BA, BA + 1, BA + 2] {
                let judgement = self.verdicts.of(i);
                if judgement.is_some_and(|j| j.verdict != Verdict::Inconsistent) {
                    self.ceilings[i] = None;
                }
            }
            self.verdicts.set_ceilings(&self.ceilings);
        }
    }

    /// The vehicle has begun or ended a turn: the ceilings of one position no longer hold.
    pub(super) fn turned(&mut self) {
        self.ceilings = [None; N];
        self.verdicts.set_ceilings(&self.ceilings);
    }

    /// One word about a state.
    pub(super) fn word(&self, state: usize) -> &'static str {
        self.verdicts.of(state).map_or("", |j| j.verdict.name())
    }

    /// One word per state.
    pub(super) fn words(&self) -> Value {
        json!(self.verdicts.all().map(|j| j.verdict.name()))
    }

    /// One sentence per state.
    pub(super) fn reasons(&self) -> Value {
        json!(self.verdicts.all().map(|j| j.reason.sentence()))
    }

    /// All changes, in order of time.
    pub(super) fn changes(&self) -> Value {
        let one = |c: &Change| {
            json!({
                "t_s": c.t,
                "state": STATES[c.state].name,
                "from": c.from.verdict.name(),
                "to": c.to.verdict.name(),
                "reason": format!("{:?}", c.to.reason),
                "sentence": c.to.reason.sentence(),
                "sigma": c.sigma,
                "required": c.required,
                "xi2": c.evidence.xi2,
                "ceiling": c.ceiling,
                "learnt_per_s": c.evidence.learnt,
                "net_per_s": c.evidence.net,
                "grown": c.evidence.grown,
                "innovations": c.evidence.innovations,
                "moved": c.evidence.moved,
            })
        };
        self.changes.iter().map(one).collect()
    }
}

/// Ceilings of ξ2 for a vehicle that stands as this one does and measures its velocity.
fn ceilings(filter: &Filter) -> Result<[Option<f32>; N], Error> {
    let local = filter.nav().local();
    let env = Environment::<f64>::wgs84(
        filter.nav().position().lat,
        filter.nav().position().height,
        Vector3::zeros(),
    );
    let c_b_n = filter.nav().c_b_n().cast::<f64>();
    let f_n = Vector3::new(0.0, 0.0, f64::from(local.gravity));
    let bias = filter.settings().bias;
    let bias = navsight::error_model::BiasModel {
        rate_g: f64::from(bias.rate_g),
        rate_a: f64::from(bias.rate_a),
    };
    let f = psi::f_matrix(&env, &c_b_n, &f_n, &bias);
    let mut h = SMatrix::<f64, 3, N>::zeros();
    h.fixed_view_mut::<3, 3>(0, VEL).fill_diagonal(-1.0);
    let sigma = SVector::<f64, N>::from(filter.sigma0().map(f64::from));
    let mut staged = Staged::new(&Scale::canonical(&NAVIGATION, &sigma, env.gravity))?;
    staged.segment(&f, &h, None)?;
    Ok(Unseen::of(&staged)
        .shares()
        .map(|share| ceiling(share).map(|c| c as f32)))
}
