//! Verdicts over a replay: what stands, what changed when and why, and the ceilings of a standing vehicle.

use nalgebra::{SMatrix, SVector, Vector3};
use navsight::error::Error;
use navsight::error_model::{psi, Environment, N, VEL};
use navsight::filter::{Filter, UpdateReport};
use navsight::observability::ceiling::{ceiling, unseen_share};
use navsight::observability::pwcs::{Scale, Staged, NAVIGATION};
use navsight::observability::verdict::{Judgement, Limits, Verdicts};
use serde_json::{json, Value};

use super::super::states::STATES;
use crate::config::Required;

/// The verdicts and their history.
pub(super) struct Watch {
    verdicts: Verdicts,
    changes: Vec<Change>,
}

/// A verdict that changed.
struct Change {
    t: f64,
    state: usize,
    from: Judgement,
    to: Judgement,
}

impl Watch {
    /// Beside a filter that has just been started; `standing` knows its ceilings.
    pub(super) fn new(filter: &Filter, required: &Required, standing: bool) -> Result<Self, Error> {
        let mut verdicts = Verdicts::new(filter.sigma0(), &required.sigma(), Limits::DEFAULT)?;
        if standing {
            verdicts.set_ceilings(&ceilings(filter)?);
        }
        Ok(Self {
            verdicts,
            changes: Vec::new(),
        })
    }

    /// The updates of one instant: time of the recording and of the filter [s].
    pub(super) fn take(&mut self, t: f64, filter_time: f64, reports: &[UpdateReport<3>]) {
        for report in reports {
            let before = self.verdicts.all();
            let changed = self.verdicts.take(filter_time, report);
            for (state, (from, to)) in before.into_iter().zip(self.verdicts.all()).enumerate() {
                if changed >> state & 1 != 0 {
                    self.changes.push(Change { t, state, from, to });
                }
            }
        }
    }

    /// The vehicle has begun or ended a turn: the ceilings of one position no longer hold.
    pub(super) fn turned(&mut self) {
        self.verdicts.set_ceilings(&[None; N]);
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
    Ok(unseen_share(&staged).map(|share| ceiling(share).map(|c| c as f32)))
}
