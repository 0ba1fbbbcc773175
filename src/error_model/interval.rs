//! The filter's way through an interval: collect ∫C dt and ∫f dt sample by sample, then build Φ − I block by block.

use core::sync::atomic::compiler_fence;
use core::sync::atomic::Ordering::SeqCst;

use nalgebra::{Matrix3, Vector3};

use super::{BiasModel, Environment, NoiseDensity, ATT, BA, BG, POS, VEL};
use crate::error::Error;
use crate::linalg::{
    all_finite, first_negative, looped, looped_mut, rolled, BlockTransition, Real,
};
use crate::mechanization::Step;

/// What the covariance needs to know of the motion since it was last propagated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval<T> {
    /// ∫ C_b_n dt [s]
    pub c_dt: Matrix3<T>,
    /// ∫ f_n dt [m/s]
    pub f_dt: Vector3<T>,
    /// Length [s]
    pub dt: T,
}

impl<T: Real> Default for Interval<T> {
    fn default() -> Self {
        Self::empty()
    }
}

impl<T: Real> Interval<T> {
    /// An interval of no length.
    #[inline]
    pub fn empty() -> Self {
        Self {
            c_dt: Matrix3::zeros(),
            f_dt: Vector3::zeros(),
            dt: T::zero(),
        }
    }

    /// Adds one sample: attitude during the sample, ∫f_n dt over it [m/s], its length [s].
    #[inline(always)]
    pub fn add(&mut self, c_b_n: &Matrix3<T>, delta_v_n: &Vector3<T>, dt: T) {
        let (m, c) = (&mut self.c_dt, c_b_n);
        m.m11 += c.m11 * dt;
        m.m21 += c.m21 * dt;
        m.m31 += c.m31 * dt;
        m.m12 += c.m12 * dt;
        m.m22 += c.m22 * dt;
        m.m32 += c.m32 * dt;
        m.m13 += c.m13 * dt;
        m.m23 += c.m23 * dt;
        m.m33 += c.m33 * dt;
        self.f_dt.x += delta_v_n.x;
        self.f_dt.y += delta_v_n.y;
        self.f_dt.z += delta_v_n.z;
        self.dt += dt;
    }
}

impl Interval<f32> {
    /// Adds one step of the mechanization.
    #[inline(always)]
    pub fn accumulate(&mut self, step: &Step) {
        self.add(&step.c_b_n, &step.delta_v_n, step.dt);
    }
}

/// Ratios σ0_j/σ0_i, decay rates and noise of the σ0-normalised states: what [`block_transition`] needs and what does
/// not change while a filter runs.
///
/// A state with σ0 = 0 is normalised by 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scaling<T> {
    pos_pos: Matrix3<T>,
    pos_vel: Vector3<T>,
    vel_pos: Vector3<T>,
    vel_vel: Matrix3<T>,
    vel_att: Matrix3<T>,
    vel_ba: Matrix3<T>,
    att_att: Matrix3<T>,
    minus_att_bg: Matrix3<T>,
    bias: BiasModel<T>,
    q: [T; 12],
}

impl<T: Real> Scaling<T> {
    /// From the standard deviations that normalise the states (SI, state order), the bias model and the noise.
    ///
    /// [`Error::NonFinite`] or [`Error::OutOfRange`] when one of them is not finite or below zero.
    pub fn new(
        sigma0: &[T; 15],
        bias: &BiasModel<T>,
        noise: &NoiseDensity<T>,
    ) -> Result<Self, Error> {
        bias.check()?;
        noise.check()?;
        if !all_finite(sigma0) {
            return Err(Error::NonFinite);
        }
        if first_negative(sigma0).is_some() {
            return Err(Error::OutOfRange);
        }
        let mut unit = *sigma0;
        for unit in looped_mut(&mut unit) {
            if *unit <= T::zero() {
                *unit = T::one();
            }
        }
        Ok(Self::of(&unit, bias, noise))
    }

    /// [`Scaling::new`] of units above zero and of a bias model and noise that have been checked.
    #[inline(never)] // so that a caller who puts it into something has none of it on the stack
    pub(crate) fn of(unit: &[T; 15], bias: &BiasModel<T>, noise: &NoiseDensity<T>) -> Self {
        let mut scaling = Self::blank(bias);
        scaling.fill(unit, noise);
        scaling
    }

    /// Room for one, which is still to be [filled](Scaling::fill).
    #[inline(always)]
    pub(crate) fn blank(bias: &BiasModel<T>) -> Self {
        Self {
            pos_pos: Matrix3::zeros(),
            pos_vel: Vector3::zeros(),
            vel_pos: Vector3::zeros(),
            vel_vel: Matrix3::zeros(),
            vel_att: Matrix3::zeros(),
            vel_ba: Matrix3::zeros(),
            att_att: Matrix3::zeros(),
            minus_att_bg: Matrix3::zeros(),
            bias: *bias,
            q: [T::zero(); 12],
        }
    }

    /// What follows from the units and the noise.
    #[inline(never)]
    pub(crate) fn fill(&mut self, unit: &[T; 15], noise: &NoiseDensity<T>) {
        let density = noise.diagonal();
        let states = looped(&density.data.0[0]).iter().zip(unit).skip(VEL);
        for (q, (density, s)) in self.q.iter_mut().zip(states) {
            rolled();
            *q = *density / *s / *s;
        }
        ratios(&mut self.pos_pos, unit, POS, POS);
        ratios(&mut self.vel_vel, unit, VEL, VEL);
        ratios(&mut self.vel_att, unit, VEL, ATT);
        ratios(&mut self.vel_ba, unit, VEL, BA);
        ratios(&mut self.att_att, unit, ATT, ATT);
        ratios(&mut self.minus_att_bg, unit, ATT, BG);
        for x in looped_mut(self.minus_att_bg.data.0.as_flattened_mut()) {
            rolled();
            *x = -*x;
        }
        let states = unit.iter().zip(unit.iter().skip(VEL));
        let to = self.pos_vel.iter_mut().zip(self.vel_pos.iter_mut());
        for ((pos_vel, vel_pos), (pos, vel)) in to.zip(states) {
            rolled();
            (*pos_vel, *vel_pos) = (*vel / *pos, *pos / *vel);
        }
    }
}

/// Unit of each of three states, `columns` on, over that of each of three, `rows` on.
#[inline(never)]
fn ratios<T: Real>(ratios: &mut Matrix3<T>, unit: &[T; 15], rows: usize, columns: usize) {
    let Some([x, y, z]) = unit.get(rows..).and_then(<[T]>::first_chunk) else {
        return;
    };
    let columns = unit.iter().skip(columns);
    for (to, column) in looped_mut(&mut ratios.data.0).iter_mut().zip(columns) {
        rolled();
        *to = [*column / *x, *column / *y, *column / *z];
    }
}

/// A = Φ − I and Q over an interval for the psi-angle model, first order, in σ0-normalised states:
/// a_ij = (∫F dt)_ij · σ0_j/σ0_i, q_i = q_c,i T/σ0_i².
///
/// The blocks are position, velocity, attitude, gyro bias, accelerometer bias. For intervals up to 0.1 s; what first
/// order costs is in the design's row "kernels" (6e-5 in ξ2 at 0.1 s for constant biases).
///
/// `env` holds over the whole interval; C and f come as integrals, so that a turn within it is seen.
#[inline(always)]
pub fn block_transition<T: Real>(
    env: &Environment<T>,
    interval: &Interval<T>,
    scaling: &Scaling<T>,
) -> BlockTransition<T> {
    let mut t = BlockTransition::identity();
    block_transition_into(env, interval, scaling, &mut t);
    t
}

/// [`block_transition`] written to a place that the caller has.
///
/// Cost on a Cortex-M4F: 244 instructions at opt-level 3 and "s", no branch, no stack (counted in the disassembly, rustc
/// 1.96). By value it is a third more, because the compiler then computes everything before it stores anything; the
/// fences keep it from doing so here and emit nothing. All is spelled out for the sake of opt-level "s".
#[inline(always)]
pub fn block_transition_into<T: Real>(
    env: &Environment<T>,
    interval: &Interval<T>,
    scaling: &Scaling<T>,
    t: &mut BlockTransition<T>,
) {
    let (dt, s) = (interval.dt, scaling);
    let (en, ie) = (times(&env.omega_en_n, dt), times(&env.omega_ie_n, dt));
    let in_ = Vector3::new(en.x + ie.x, en.y + ie.y, en.z + ie.z);
    t.a00 = minus_scaled_skew(&en, &s.pos_pos);
    t.a01 = times(&s.pos_vel, dt);
    compiler_fence(SeqCst);
    let (g, r) = (env.gravity_gradient(), &s.vel_pos);
    t.a10 = Vector3::new(g.x * dt * r.x, g.y * dt * r.y, g.z * dt * r.z);
    compiler_fence(SeqCst);
    t.a22 = minus_scaled_skew(&in_, &s.att_att);
    compiler_fence(SeqCst);
    let coriolis = Vector3::new(in_.x + ie.x, in_.y + ie.y, in_.z + ie.z);
    t.a11 = minus_scaled_skew(&coriolis, &s.vel_vel);
    compiler_fence(SeqCst);
    let f = &interval.f_dt;
    t.a12 = minus_scaled_skew(&Vector3::new(-f.x, -f.y, -f.z), &s.vel_att);
    compiler_fence(SeqCst);
    t.a14 = scaled(&interval.c_dt, &s.vel_ba);
    compiler_fence(SeqCst);
    t.a23 = scaled(&interval.c_dt, &s.minus_att_bg);
    compiler_fence(SeqCst);
    t.a33 = -(s.bias.rate_g * dt);
    t.a44 = -(s.bias.rate_a * dt);
    let [v0, v1, v2, a0, a1, a2, g0, g1, g2, b0, b1, b2] = &s.q;
    t.q = [
        *v0 * dt,
        *v1 * dt,
        *v2 * dt,
        *a0 * dt,
        *a1 * dt,
        *a2 * dt,
        *g0 * dt,
        *g1 * dt,
        *g2 * dt,
        *b0 * dt,
        *b1 * dt,
        *b2 * dt,
    ];
}

/// F itself and the noise densities in the same form (per second), from the attitude and the specific force [m/s²] of
/// one instant: for rates such as ṗ.
#[inline(always)]
pub fn block_rates<T: Real>(
    env: &Environment<T>,
    c_b_n: &Matrix3<T>,
    f_n: &Vector3<T>,
    scaling: &Scaling<T>,
) -> BlockTransition<T> {
    block_transition(
        env,
        &Interval {
            c_dt: *c_b_n,
            f_dt: *f_n,
            dt: T::one(),
        },
        scaling,
    )
}

/// −[v×] times the ratios, element by element; the diagonal is zero.
#[inline(always)]
fn minus_scaled_skew<T: Real>(v: &Vector3<T>, ratio: &Matrix3<T>) -> Matrix3<T> {
    let o = T::zero();
    Matrix3::new(
        o,
        v.z * ratio.m12,
        -(v.y * ratio.m13),
        -(v.z * ratio.m21),
        o,
        v.x * ratio.m23,
        v.y * ratio.m31,
        -(v.x * ratio.m32),
        o,
    )
}

/// The matrix times the ratios, element by element.
#[inline(always)]
fn scaled<T: Real>(m: &Matrix3<T>, ratio: &Matrix3<T>) -> Matrix3<T> {
    Matrix3::new(
        m.m11 * ratio.m11,
        m.m12 * ratio.m12,
        m.m13 * ratio.m13,
        m.m21 * ratio.m21,
        m.m22 * ratio.m22,
        m.m23 * ratio.m23,
        m.m31 * ratio.m31,
        m.m32 * ratio.m32,
        m.m33 * ratio.m33,
    )
}

#[inline(always)]
fn times<T: Real>(v: &Vector3<T>, dt: T) -> Vector3<T> {
    Vector3::new(v.x * dt, v.y * dt, v.z * dt)
}
