//! What the navigator was a little while ago.

use nalgebra::{SVector, Vector3};

use super::past::{undo, Back};
use super::ring::Ring;
use crate::attitude::product;
use crate::error::Error;
use crate::error_model::{Interval, ATT, N, POS, VEL};
use crate::mechanization::Step;
use crate::nav::NavState;

/// The nominal state at one time, how it came there, and what was corrected since.
#[derive(Clone, Debug)]
struct Entry {
    time: f64,
    /// Before any correction of this time.
    nav: NavState,
    /// From the entry before to this one.
    segment: Interval<f32>,
    /// Corrections after this entry and before the next one, as errors of this time.
    dx: SVector<f32, N>,
}

/// The last K states, `spacing` seconds apart; about 290 bytes each. K = 0: none.
#[derive(Clone, Debug)]
pub(super) struct History<const K: usize> {
    entries: Ring<Entry, K>,
    /// Since the newest entry.
    pending: Interval<f32>,
    spacing: f32,
}

impl<const K: usize> History<K> {
    pub fn new(nav: &NavState, time: f64, spacing: f32) -> Self {
        let mut history = Self {
            entries: Ring::new(),
            pending: Interval::empty(),
            spacing,
        };
        history.keep(nav, time);
        history
    }

    /// After a sample: `nav` is the state that it led to.
    pub fn take(&mut self, step: &Step, nav: &NavState, time: f64) {
        if K == 0 {
            return;
        }
        self.pending.accumulate(step);
        if self.pending.dt + 0.5 * step.dt >= self.spacing {
            self.keep(nav, time);
        }
    }

    fn keep(&mut self, nav: &NavState, time: f64) {
        self.entries.keep(Entry {
            time,
            nav: *nav,
            segment: self.pending,
            dx: SVector::zeros(),
        });
        self.pending = Interval::empty();
    }

    /// Remembers that the present state was corrected by `dx`.
    pub fn corrected(&mut self, dx: &SVector<f32, N>) {
        let then = undo(&self.pending, dx);
        if let Some(newest) = self.entries.newest_mut() {
            newest.dx += then;
        }
    }

    /// The state at `time` as it is known now, and the way back to it. `nav`, `now`: the present state.
    ///
    /// # Errors
    /// [`Error::Late`] when that is further back than the history reaches.
    pub fn past(&self, nav: &NavState, now: f64, time: f64) -> Result<(NavState, Back), Error> {
        let mut back = Back::none();
        // What was corrected since the state at hand was stored, as an error of the time reached.
        let mut dx = SVector::<f32, N>::zeros();
        let (mut state, mut end, mut segment) = (nav, now, &self.pending);
        for age in 0..=K {
            let Some(before) = self.entries.back(age) else {
                return Err(Error::Late);
            };
            if time >= before.time && segment.dt > 0.0 {
                let share = ((end - time) as f32 / segment.dt).clamp(0.0, 1.0);
                let part = Interval {
                    c_dt: segment.c_dt * share,
                    f_dt: segment.f_dt * share,
                    dt: segment.dt * share,
                };
                back.over(&part);
                let mut then = *state;
                then.correct(&motion(before, state, share, part.dt)?)?;
                then.correct(&undo(&part, &dx))?;
                return Ok((then, back));
            }
            back.over(segment);
            dx = undo(segment, &dx) + before.dx;
            (state, end, segment) = (&before.nav, before.time, &before.segment);
        }
        Err(Error::Late)
    }
}

/// The motion over the last `share` of the way from an entry to `state`, `dt` seconds, as a correction that undoes it.
///
/// Velocity and rotation are taken to change evenly between the two: of a jerk j it leaves j T²/8.
fn motion(before: &Entry, state: &NavState, share: f32, dt: f32) -> Result<SVector<f32, N>, Error> {
    let mut start = before.nav;
    start.correct(&before.dx)?;
    let v = state.v_n();
    let delta_v = (v - start.v_n()) * share;
    // q = Δ ∘ q_start, Δ = (cos |ρ|/2, sin |ρ|/2 …): twice the vector part, which is short of ρ by |ρ|²/24
    let [w, x, y, z] = start.quaternion();
    let [c, x, y, z] = product(&state.quaternion(), &[w, -x, -y, -z]);
    let sign = if c < 0.0 { -2.0 } else { 2.0 };
    let rho = Vector3::new(x, y, z) * sign;
    let rho = rho * (1.0 + rho.norm_squared() * (1.0 / 24.0));
    let mut dx = SVector::<f32, N>::zeros();
    dx.fixed_rows_mut::<3>(POS)
        .copy_from(&((v - delta_v * 0.5) * dt));
    dx.fixed_rows_mut::<3>(VEL).copy_from(&delta_v);
    dx.fixed_rows_mut::<3>(ATT).copy_from(&(rho * -share));
    Ok(dx)
}
