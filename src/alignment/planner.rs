//! Planner: what would help? Candidate manoeuvres are tried on a copy of the covariance, without moving the vehicle.
//!
//! From a running filter, each candidate is flown by the error model alone over a horizon: first the manoeuvre, then
//! standing still. What is left of the variances says which one is best, and in which words to say so:
//! "turning by 180° now gives heading 0.024° in 300 s, staying gives 0.098°".
//!
//! It costs a propagation and an update per second and candidate: in slices of as many steps as the caller has time for
//! ([`Planner::step`]), or of a part of one ([`Planner::slice`]): transition, propagation in two halves, update, result. The
//! dearest slice stays below 3,100 instructions on a Cortex-M4F (`BENCHMARKS.md`).
//! Standing needs steps of a second only: the first-order transition loses terms of T/2 against the time constants of
//! what is learnt, a shift of half a second in three hundred. Turns are cut into steps of [`MAX_ANGLE`]. Updates are made
//! once per step with the information of the updates due in it (R T/dt), none while the vehicle moves unless a velocity is
//! measured then. Against the σ that a filter reaches when the manoeuvre is then flown: within 5 % for every state and
//! candidate (`host-tests/tests/planner.rs`). Left out: transport rate and Coriolis terms of the speed reached.

use core::cmp::Ordering;
use core::fmt;

use nalgebra::{Matrix3, Vector3};

use crate::covariance::{Covariance15, Observation, Rows};
use crate::error::Error;
use crate::error_model::{
    block_transition_into, Environment, Interval, Scaling, ATT, BA, BG, N, VEL,
};
use crate::filter::Filter;
use crate::linalg::BlockTransition;
use crate::measurement::ZeroVelocity;

/// Longest step while standing [s].
pub const MAX_STANDING: f32 = 1.0;
/// Longest step while accelerating [s].
pub const MAX_MOVING: f32 = 0.5;
/// Largest angle turned in a step [rad].
pub const MAX_ANGLE: f32 = 0.15;

/// Something that the vehicle could do now.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Manoeuvre {
    /// Nothing.
    Stay,
    /// Turn on the spot, clockwise positive [rad].
    Yaw(f32),
    /// Pitch the nose up and stay like that [rad].
    Tilt(f32),
    /// Speed up forward [m/s²], slow down again as long, stand.
    Along(f32),
    /// The same to the right [m/s²].
    Across(f32),
}

impl Manoeuvre {
    /// The usual ones: stay, a quarter turn, half a turn, 20° nose up, 1 m/s² along and across. The mirror image of a
    /// quarter turn teaches the same.
    pub const USUAL: [Self; 6] = {
        const RIGHT: f32 = core::f32::consts::FRAC_PI_2;
        [
            Self::Stay,
            Self::Yaw(RIGHT),
            Self::Yaw(2.0 * RIGHT),
            Self::Tilt(RIGHT * 2.0 / 9.0),
            Self::Along(1.0),
            Self::Across(1.0),
        ]
    };

    /// Its one number.
    fn size(self) -> f32 {
        match self {
            Manoeuvre::Stay => 0.0,
            Manoeuvre::Yaw(x) | Manoeuvre::Tilt(x) => x,
            Manoeuvre::Along(x) | Manoeuvre::Across(x) => x,
        }
    }
}

/// How manoeuvres are flown and measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// How far to look [s].
    pub horizon: f32,
    /// Rate of turns and tilts [rad/s].
    pub turn_rate: f32,
    /// How long an acceleration lasts, and the braking after it [s].
    pub acceleration_time: f32,
    /// The update at a standstill.
    pub standing: ZeroVelocity,
    /// σ of a velocity measured while the vehicle moves, as often as at a standstill [m/s]; None: nothing is measured then.
    pub moving_sigma: Option<f32>,
}

impl Rules {
    /// 300 s, turns at 45 °/s, accelerations of 5 s, nothing measured on the move.
    pub fn usual(standing: ZeroVelocity) -> Self {
        Self {
            horizon: 300.0,
            turn_rate: core::f32::consts::FRAC_PI_4,
            acceleration_time: 5.0,
            standing,
            moving_sigma: None,
        }
    }

    fn check(&self) -> Result<(), Error> {
        let sigma = self.moving_sigma.unwrap_or(1.0);
        let numbers = [
            self.horizon,
            self.turn_rate,
            self.acceleration_time,
            self.standing.interval(),
            sigma,
        ];
        if numbers.iter().any(|x| !x.is_finite()) {
            return Err(Error::NonFinite);
        }
        if numbers.iter().all(|x| *x > 0.0) && self.horizon <= 86_400.0 {
            Ok(())
        } else {
            Err(Error::OutOfRange)
        }
    }
}

/// What a slice came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Progress {
    /// There is more to do.
    Working,
    /// All candidates have been tried.
    Done,
}

/// What a candidate leads to at the horizon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// The candidate.
    pub manoeuvre: Manoeuvre,
    /// Standard deviations, SI.
    pub sigma: [f32; N],
    /// ξ2; meaningless for a state that was started without variance.
    pub xi2: [f32; N],
}

/// Tries K candidates on a copy of the covariance.
#[derive(Clone, Debug)]
pub struct Planner<const K: usize> {
    start: Covariance15<f32>,
    p: Covariance15<f32>,
    c_b_n: Matrix3<f32>,
    environment: Environment<f32>,
    scaling: Scaling<f32>,
    sigma0: [f32; N],
    rules: Rules,
    /// R T of the standing and of the moving update, σ0 units.
    r_t: [f32; 3],
    r_t_moving: Option<[f32; 3]>,
    candidates: [Manoeuvre; K],
    outcomes: [Outcome; K],
    /// Candidate at work, and its steps.
    at: usize,
    phase: Phase,
    part: Part,
    transition: BlockTransition<f32>,
}

/// What comes next of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// The candidate is put at the start.
    Begin,
    Transition,
    /// Rows of position and velocity.
    Propagation,
    /// Rows of attitude and biases.
    Rest,
    Update,
    /// The candidate is through.
    Result,
}

/// Where a candidate stands.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Phase {
    /// Steps of the manoeuvre and of the standing after it.
    moving: u16,
    standing: u32,
    /// Lengths of the two [s].
    dt_moving: f32,
    dt_standing: f32,
    /// Steps made.
    done: u32,
}

impl<const K: usize> Planner<K> {
    /// Takes a copy of what the filter knows now; call [`Filter::synchronize`] before if samples have come in since the
    /// last update. Looks at every candidate with the same rules.
    ///
    /// # Errors
    /// [`Error::NonFinite`], [`Error::OutOfRange`] for rules and candidates that cannot be: a manoeuvre longer than the
    /// horizon or of more than 10 000 steps.
    pub fn new(filter: &Filter, candidates: [Manoeuvre; K], rules: Rules) -> Result<Self, Error> {
        rules.check()?;
        let sigma0 = *filter.sigma0();
        let standing = rules.standing.linearize(filter.nav());
        let interval = rules.standing.interval();
        let mut r_t = [0.0; 3];
        for ((r_t, r), sigma) in r_t
            .iter_mut()
            .zip(standing.r.iter())
            .zip(sigma0.iter().skip(VEL))
        {
            *r_t = *r * interval / (*sigma * *sigma);
        }
        let r_t_moving = rules.moving_sigma.map(|moving| {
            let mut r_t = [0.0; 3];
            for (r_t, sigma) in r_t.iter_mut().zip(sigma0.iter().skip(VEL)) {
                *r_t = moving * moving * interval / (*sigma * *sigma);
            }
            r_t
        });
        let mut planner = Self {
            start: *filter.covariance(),
            p: *filter.covariance(),
            c_b_n: filter.nav().c_b_n(),
            environment: Environment::from_local(&filter.nav().local(), &Vector3::zeros()),
            scaling: *filter.scaling(),
            sigma0,
            rules,
            r_t,
            r_t_moving,
            candidates,
            outcomes: candidates.map(|manoeuvre| Outcome {
                manoeuvre,
                sigma: [0.0; N],
                xi2: [0.0; N],
            }),
            at: 0,
            phase: Phase {
                moving: 0,
                standing: 0,
                dt_moving: 0.0,
                dt_standing: 0.0,
                done: 0,
            },
            part: Part::Begin,
            transition: BlockTransition::identity(),
        };
        // whether all of them can be flown
        for candidate in candidates {
            planner.begin(candidate)?;
        }
        Ok(planner)
    }

    /// Makes up to `steps` steps of the covariance, of which a candidate needs one per second and some for its turn.
    ///
    /// # Errors
    /// As [`Planner::slice`].
    pub fn step(&mut self, steps: u16) -> Result<Progress, Error> {
        let mut left = steps;
        while left > 0 {
            if self.part == Part::Update {
                left -= 1;
            }
            if self.slice()? == Progress::Done {
                return Ok(Progress::Done);
            }
        }
        // what belongs to the last step
        if self.part == Part::Result {
            return self.slice();
        }
        Ok(Progress::Working)
    }

    /// Makes one part of a step: the least that can be done at a time.
    ///
    /// # Errors
    /// Those of [`Covariance15::update`]: the covariance is broken. The candidate at work is then tried again.
    pub fn slice(&mut self) -> Result<Progress, Error> {
        let Some(&candidate) = self.candidates.get(self.at) else {
            return Ok(Progress::Done);
        };
        let Phase {
            moving,
            standing,
            dt_moving,
            dt_standing,
            done,
        } = self.phase;
        let moves = done < u32::from(moving);
        let dt = if moves { dt_moving } else { dt_standing };
        self.part = match self.part {
            Part::Begin => {
                self.begin(candidate)?;
                Part::Transition
            }
            Part::Transition => {
                self.turn(candidate, moves, dt);
                Part::Propagation
            }
            Part::Propagation => {
                self.p.propagate_motion(&self.transition);
                Part::Rest
            }
            Part::Rest => {
                self.p.propagate_rest(&self.transition);
                Part::Update
            }
            Part::Update => {
                if let Err(error) = self.measure(moves, dt) {
                    self.part = Part::Begin;
                    return Err(error);
                }
                let done = done + 1;
                self.phase.done = done;
                // Standing, every step is the same.
                if done >= u32::from(moving) + standing {
                    Part::Result
                } else if done <= u32::from(moving) {
                    Part::Transition
                } else {
                    Part::Propagation
                }
            }
            Part::Result => {
                self.note();
                self.at += 1;
                Part::Begin
            }
        };
        Ok(match self.at < K {
            true => Progress::Working,
            false => Progress::Done,
        })
    }

    /// What the candidate at work has led to.
    #[inline(never)]
    fn note(&mut self) {
        if let Some(outcome) = self.outcomes.get_mut(self.at) {
            let p = self.p.diagonal();
            for ((sigma, p), sigma0) in outcome.sigma.iter_mut().zip(&p).zip(&self.sigma0) {
                *sigma = libm::sqrtf(*p) * *sigma0;
            }
            outcome.xi2 = p.map(|p| 1.0 / p);
        }
    }

    /// Puts a candidate at the start.
    #[inline(never)] // as the other parts of a step: what one has on the stack, the next has not
    fn begin(&mut self, candidate: Manoeuvre) -> Result<(), Error> {
        let (rules, size) = (&self.rules, candidate.size());
        let (length, steps) = match candidate {
            Manoeuvre::Stay => (0.0, 0.0),
            Manoeuvre::Yaw(_) | Manoeuvre::Tilt(_) => {
                let angle = libm::fabsf(size);
                (angle / rules.turn_rate, libm::ceilf(angle / MAX_ANGLE))
            }
            Manoeuvre::Along(_) | Manoeuvre::Across(_) => {
                let each = libm::ceilf(rules.acceleration_time / MAX_MOVING);
                (2.0 * rules.acceleration_time, 2.0 * each)
            }
        };
        let steps = steps.max(libm::ceilf(length / MAX_STANDING));
        let rest = rules.horizon - length;
        if !(size.is_finite() && rest.is_finite()) {
            return Err(Error::NonFinite);
        }
        if rest < 0.0 || steps > 1e4 {
            return Err(Error::OutOfRange);
        }
        let standing = libm::ceilf(rest / MAX_STANDING);
        let share = |length: f32, steps: f32| if steps > 0.0 { length / steps } else { 0.0 };
        self.phase = Phase {
            moving: steps as u16,
            standing: standing as u32,
            dt_moving: share(length, steps),
            dt_standing: share(rest, standing),
            done: 0,
        };
        self.p = self.start;
        Ok(())
    }

    /// The transition of the step at work.
    #[inline(never)]
    fn turn(&mut self, candidate: Manoeuvre, moves: bool, dt: f32) {
        let part = if moves {
            (self.phase.done as f32 + 0.5) / f32::from(self.phase.moving)
        } else {
            1.0
        };
        let (c_b_n, a_n) = self.pose(candidate, part);
        let f_n = Vector3::new(a_n.x, a_n.y, self.environment.gravity);
        let interval = Interval {
            c_dt: c_b_n * dt,
            f_dt: f_n * dt,
            dt,
        };
        block_transition_into(
            &self.environment,
            &interval,
            &self.scaling,
            &mut self.transition,
        );
    }

    /// The update of the step at work, if anything is measured in it.
    #[inline(never)]
    fn measure(&mut self, moves: bool, dt: f32) -> Result<(), Error> {
        let r_t = if moves {
            self.r_t_moving
        } else {
            Some(self.r_t)
        };
        if let Some(r_t) = r_t {
            self.p.update(&Rows {
                nu: [0.0; 3],
                h: Observation::Direct { first: VEL },
                r: r_t.map(|r_t| r_t / dt),
                gate: None,
            })?;
        }
        Ok(())
    }

    /// Attitude and acceleration when this part of the manoeuvre is over, 0 … 1; 1: standing after it.
    fn pose(&self, candidate: Manoeuvre, part: f32) -> (Matrix3<f32>, Vector3<f32>) {
        let c = &self.c_b_n;
        let o = Vector3::zeros();
        let speeding = |a: f32, column: usize| {
            let axis = c.column_iter().nth(column).map_or(o, |axis| axis.into());
            let a = match part {
                p if p < 0.5 => a,
                p if p < 1.0 => -a,
                _ => 0.0,
            };
            (*c, axis * a)
        };
        match candidate {
            Manoeuvre::Stay => (*c, o),
            Manoeuvre::Yaw(angle) => {
                // clockwise seen from above: about the up axis of n backwards
                let (s, k) = libm::sincosf(angle * part);
                let turn = Matrix3::new(k, s, 0.0, -s, k, 0.0, 0.0, 0.0, 1.0);
                (turn * c, o)
            }
            Manoeuvre::Tilt(angle) => {
                let (s, k) = libm::sincosf(angle * part);
                let turn = Matrix3::new(1.0, 0.0, 0.0, 0.0, k, -s, 0.0, s, k);
                (c * turn, o)
            }
            Manoeuvre::Along(a) => speeding(a, 1),
            Manoeuvre::Across(a) => speeding(a, 0),
        }
    }

    /// What a candidate leads to; None beyond the last one or before it has been tried.
    pub fn outcome(&self, candidate: usize) -> Option<&Outcome> {
        self.outcomes.get(candidate).filter(|_| candidate < self.at)
    }

    /// Candidates from best to worst for the σ of one state: their numbers. Of equals, and of those not tried yet, the
    /// first comes first.
    pub fn ranking(&self, state: usize) -> [usize; K] {
        let sigma = |candidate: usize| {
            let outcome = self.outcome(candidate);
            outcome
                .and_then(|o| o.sigma.get(state).copied())
                .unwrap_or(f32::MAX)
        };
        // Its place is the number of those that come before it.
        let mut order = [0; K];
        for i in 0..K {
            let before = |j: &usize| match sigma(*j).total_cmp(&sigma(i)) {
                Ordering::Less => true,
                Ordering::Equal => *j < i,
                Ordering::Greater => false,
            };
            if let Some(place) = order.get_mut((0..K).filter(before).count()) {
                *place = i;
            }
        }
        order
    }

    /// The best candidate for a state beside staying, as a sentence; None before all have been tried.
    pub fn advice(&self, state: usize) -> Option<Advice> {
        let best = self.ranking(state).first().and_then(|i| self.outcome(*i))?;
        let sigma = |outcome: &Outcome| outcome.sigma.get(state).copied();
        let stay = self
            .outcomes
            .iter()
            .take(self.at)
            .find(|o| o.manoeuvre == Manoeuvre::Stay);
        (self.at >= K).then_some(Advice {
            state,
            best: best.manoeuvre,
            sigma: sigma(best)?,
            staying: stay.and_then(sigma),
            horizon: self.rules.horizon,
        })
    }
}

/// What to do, as a sentence; written with `Display`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Advice {
    /// State that it is about.
    pub state: usize,
    /// What is best for it.
    pub best: Manoeuvre,
    /// σ that the best leads to, SI.
    pub sigma: f32,
    /// σ that staying leads to, where that was a candidate.
    pub staying: Option<f32>,
    /// After this time [s].
    pub horizon: f32,
}

/// One degree [rad].
const DEG: f32 = core::f32::consts::PI / 180.0;

impl Advice {
    /// Name of a state, its unit for people, and that unit in SI.
    fn words(state: usize) -> (&'static str, &'static str, f32) {
        match state {
            s if s < VEL => ("position", " m", 1.0),
            s if s < ATT => ("velocity", " m/s", 1.0),
            s if s < ATT + 2 => ("tilt", "°", DEG),
            s if s < BG => ("heading", "°", DEG),
            s if s < BA => ("gyro bias", " °/h", DEG / 3600.0),
            _ => ("accelerometer bias", " mg", 9.806_65e-3),
        }
    }
}

impl fmt::Display for Manoeuvre {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Manoeuvre::Stay => f.write_str("staying"),
            Manoeuvre::Yaw(x) => write!(f, "turning by {:.0}°", x / DEG),
            Manoeuvre::Tilt(x) => write!(f, "tilting by {:.0}°", x / DEG),
            Manoeuvre::Along(x) => write!(f, "accelerating forward with {x:.1} m/s²"),
            Manoeuvre::Across(x) => write!(f, "accelerating sideways with {x:.1} m/s²"),
        }
    }
}

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, unit, si) = Self::words(self.state);
        let (best, sigma, horizon) = (self.best, self.sigma / si, self.horizon);
        write!(
            f,
            "{best} now gives {name} {sigma:.3}{unit} in {horizon:.0} s"
        )?;
        match self.staying {
            Some(_) if best == Manoeuvre::Stay => f.write_str(", and nothing else gives more"),
            Some(staying) => write!(f, "; staying gives {:.3}{unit}", staying / si),
            None => Ok(()),
        }
    }
}
