//! What the navigator was a little while ago.

use super::past::{undo, Back};
use super::ring::Ring;
use crate::attitude::product;
use crate::error::Error;
use crate::error_model::{Interval, ATT, N, POS, VEL};
use crate::linalg::{each_state, looped, looped_mut, rolled};
use crate::mechanization::Step;
use crate::nav::NavState;

/// An error of the nominal state, SI.
type Correction = [f32; N];

/// The unit of its states.
const SI: &Correction = &[1.0; N];

/// The nominal state at one time, how it came there, and what was corrected since.
#[derive(Clone, Debug)]
struct Entry {
    time: f64,
    /// Before any correction of this time.
    nav: NavState,
    /// From the entry before to this one.
    segment: Interval<f32>,
    /// Corrections after this entry and before the next one, as errors of this time.
    dx: Correction,
}

/// The last K states, `spacing` seconds apart; about 290 bytes each. K = 0: none.
#[derive(Clone, Debug)]
pub(super) struct History<const K: usize> {
    entries: Ring<Entry, K>,
    /// Since the newest entry.
    pending: Interval<f32>,
    spacing: f32,
}

/// A time in the past: within the segment that ends `age` entries ago.
pub(super) struct Place {
    age: usize,
    /// How much of that segment lies after it.
    share: f32,
    /// What lies after it.
    part: Interval<f32>,
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
            dx: [0.0; N],
        });
        self.pending = Interval::empty();
    }

    /// Remembers that the present state was corrected by `dx`, which is changed.
    pub fn corrected(&mut self, dx: &mut Correction) {
        undo(&self.pending, dx);
        if let Some(newest) = self.entries.newest_mut() {
            add(&mut newest.dx, dx);
        }
    }

    /// Where `time` is; `now`: that of the present.
    ///
    /// # Errors
    /// [`Error::Late`] when that is further back than the history reaches.
    #[inline(never)]
    pub fn find(&self, now: f64, time: f64) -> Result<Place, Error> {
        if time < 0.0 {
            return Err(Error::Late);
        }
        let mut end = now;
        for age in 0..=K {
            let (Some(before), Some(segment)) = (self.entries.back(age), self.segment(age)) else {
                break;
            };
            // numbers from 0 on are in the order of their bits
            if time.abs().to_bits() >= before.time.to_bits() && segment.dt > 0.0 {
                let share = ((end - time) as f32 / segment.dt).clamp(0.0, 1.0);
                let part = Interval {
                    c_dt: segment.c_dt * share,
                    f_dt: segment.f_dt * share,
                    dt: segment.dt * share,
                };
                return Ok(Place { age, share, part });
            }
            end = before.time;
        }
        Err(Error::Late)
    }

    /// The segment that ends `age` entries ago: the pending one, the one of the newest entry, …
    fn segment(&self, age: usize) -> Option<&Interval<f32>> {
        match age.checked_sub(1) {
            None => Some(&self.pending),
            Some(newer) => self.entries.back(newer).map(|entry| &entry.segment),
        }
    }

    /// Goes back to a place; `back` starts as [`Back::NONE`].
    pub fn way_back(&self, place: &Place, back: &mut Back) {
        for age in 0..place.age {
            if let Some(segment) = self.segment(age) {
                back.over(segment);
            }
        }
        back.over(&place.part);
    }

    /// Makes the present state what it was at a place, as it is known now.
    ///
    /// # Errors
    /// Those of [`NavState::correct`]; the state is then any.
    #[inline(never)]
    pub fn rewind(&self, nav: &mut NavState, place: &Place) -> Result<(), Error> {
        // What was corrected since the state at hand was stored, as an error of the time reached.
        let (mut dx, mut any) = ([0.0; N], false);
        for age in 0..place.age {
            let (Some(before), Some(segment)) = (self.entries.back(age), self.segment(age)) else {
                return Err(Error::Late);
            };
            if any {
                undo(segment, &mut dx);
            }
            if any_in(&before.dx) {
                add(&mut dx, &before.dx);
                any = true;
            }
        }
        if let Some(after) = place.age.checked_sub(1) {
            *nav = self.entries.back(after).ok_or(Error::Late)?.nav;
        }
        let before = self.entries.back(place.age).ok_or(Error::Late)?;
        nav.correct_in_units(&motion(before, nav, place)?, SI)?;
        if any {
            undo(&place.part, &mut dx);
            nav.correct_in_units(&dx, SI)?;
        }
        Ok(())
    }
}

/// dx + more
#[inline(never)]
fn add(dx: &mut Correction, more: &Correction) {
    for (x, more) in looped_mut(dx).iter_mut().zip(looped(more)) {
        rolled();
        *x += *more;
    }
}

/// Whether there is anything in it, be it a zero with a sign.
#[inline(always)]
fn any_in(dx: &Correction) -> bool {
    let mut bits = 0;
    macro_rules! one {
        ($i:literal) => {
            bits |= dx[$i].to_bits();
        };
    }
    each_state!(one);
    bits != 0
}

/// The motion from a place to `state`, the end of its segment, as a correction that undoes it. `before`: the beginning.
///
/// Velocity and rotation are taken to change evenly between the two: of a jerk j it leaves j T²/8.
#[inline(never)]
fn motion(before: &Entry, state: &NavState, place: &Place) -> Result<Correction, Error> {
    let (share, dt) = (place.share, place.part.dt);
    let mut start = before.nav;
    start.correct_in_units(&before.dx, SI)?;
    let (v, v_start) = (state.v_n(), start.v_n());
    // q = Δ ∘ q_start, Δ = (cos |ρ|/2, sin |ρ|/2 …): twice the vector part, which is short of ρ by |ρ|²/24
    let [w, x, y, z] = start.quaternion();
    let [c, x, y, z] = product(&state.quaternion(), &[w, -x, -y, -z]);
    let twice = if c < 0.0 { -2.0 } else { 2.0 };
    let rho = twice * (1.0 + (x * x + y * y + z * z) * (4.0 / 24.0));
    let mut dx = [0.0; N];
    macro_rules! axis {
        ($i:literal, $v:ident, $rho:ident) => {
            let delta_v = (v.$v - v_start.$v) * share;
            dx[POS + $i] = (v.$v - delta_v * 0.5) * dt;
            dx[VEL + $i] = delta_v;
            dx[ATT + $i] = $rho * rho * -share;
        };
    }
    axis!(0, x, x);
    axis!(1, y, y);
    axis!(2, z, z);
    Ok(dx)
}
