//! What the four ways of looking say about one state, whether they agree, and one plain sentence.
//!
//! | flag | structure, elimination | filter | means |
//! |---|---|---|---|
//! | agree | seen strictly, or seen by nobody | ξ2 accordingly | nothing to explain |
//! | slow | can be learnt (ceiling ≥ 2) | ξ2 < 2 | time, or a lower order by other measurements |
//! | prior only | not seen alone; known as well as its partners' prior | ξ2 up to the ceiling | the prior of the partners decides |
//! | contradiction | cannot be learnt that far | ξ2 above the ceiling by more than 10 % | the filter learns from its own linearisation |
//!
//! The ceiling holds for a model that does not change: after a manoeuvre the elimination has to know the new segment, and
//! a Markov bias lifts it by 2 %, re-linearisation by 5 % (`docs/structural.md`). It is the fault detector that no single
//! metric is: ξ2 alone calls a filter good that convinced itself.

use core::fmt;

use super::ceiling::{ceiling, Unseen, MARGIN};
use super::comprehensive::of_state;
use super::pwcs::{Kind, Staged};
use super::structural::Class;
use crate::linalg::Real;

/// One word for how the methods stand to each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Flag {
    /// All say the same.
    Agree,
    /// It could be learnt and has not been yet.
    Slow,
    /// Not seen alone; its prior-weighted degree lives on the prior of its partners.
    PriorOnly,
    /// The filter knows more than the model allows.
    Contradiction,
}

impl Flag {
    /// `agree`, `slow`, `prior_only`, `contradiction`.
    pub const fn name(self) -> &'static str {
        match self {
            Flag::Agree => "agree",
            Flag::Slow => "slow",
            Flag::PriorOnly => "prior_only",
            Flag::Contradiction => "contradiction",
        }
    }
}

/// Where agreement ends.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits<T> {
    /// Below this ξ2 nothing has been learnt to speak of. Default 2: the variance has halved.
    pub learnt: T,
    /// How far ξ2 may rise above its ceiling, relatively. Default [`MARGIN`], as the verdict's.
    pub margin: T,
    /// Couplings below this are left out. Default 1e-6 of the row, prior-weighted: rounding.
    pub coupling: T,
}

impl<T: Real> Default for Limits<T> {
    fn default() -> Self {
        Self {
            learnt: T::of(2.0),
            margin: T::of(MARGIN),
            coupling: T::of(1e-6),
        }
    }
}

/// What each method says about one state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View<T> {
    /// Number of the state.
    pub state: usize,
    /// Structure: alone, with others, not at all. `None` where no pattern was analysed.
    pub class: Option<Class>,
    /// Comprehensive (Peng), strict: the row of this state holds nothing else.
    pub strict: bool,
    /// Order of its row; `None` where it stands for none.
    pub order: Option<u8>,
    /// Relative degree of its row.
    pub degree: Option<T>,
    /// Share in the unseen space, σ0 units: 0 seen … 1 not seen (Yang, scaled).
    pub share: T,
    /// The state it is tied to most, prior-weighted.
    pub partner: Option<usize>,
    /// ξ2 of the filter (Lu); `None` where not available.
    pub xi2: Option<T>,
}

impl<T: Real> View<T> {
    /// Looks at one state.
    ///
    /// * `staged`: elimination of all segments so far
    /// * `unseen`: what it leaves unseen
    /// * `class`: of [`super::structural::Report::class`], or of the bound D for several segments
    /// * `xi2`: from the filter, or a covariance analysis
    pub fn of<const N: usize, const M: usize>(
        staged: &Staged<T, N, M>,
        unseen: &Unseen<T, N>,
        state: usize,
        class: Option<Class>,
        xi2: Option<T>,
        limits: &Limits<T>,
    ) -> Self {
        let row = row_of(staged, state, limits);
        // In the unseen space: along its own shadow there, which other state is largest?
        let shadow = unseen.shadow(state);
        let share = shadow.get(state).copied().unwrap_or_else(T::zero);
        let mut partner = None;
        let mut largest = limits.coupling * share;
        for (j, x) in shadow.iter().enumerate() {
            if j != state && x.abs() > largest {
                (partner, largest) = (Some(j), x.abs());
            }
        }
        Self {
            state,
            class,
            strict: row.is_some_and(|(strict, ..)| strict),
            order: row.map(|(_, order, _)| order),
            degree: row.map(|(.., degree)| degree),
            share,
            partner,
            xi2,
        }
    }

    /// The ceiling of ξ2, `None` where there is none.
    pub fn ceiling(&self) -> Option<T> {
        ceiling(self.share)
    }

    /// How the methods stand to each other.
    pub fn flag(&self, limits: &Limits<T>) -> Flag {
        let xi2 = self.xi2.unwrap_or(T::one());
        let ceiling = match (self.class, self.ceiling()) {
            // Structure alone is enough to say that nothing can be learnt.
            (Some(Class::Unseen), _) => Some(T::one()),
            (_, ceiling) => ceiling,
        };
        if ceiling.is_some_and(|c| xi2 > c * (T::one() + limits.margin)) {
            return Flag::Contradiction;
        }
        if ceiling.is_some_and(|c| c < limits.learnt) {
            return Flag::Agree;
        }
        if self.xi2.is_some() && xi2 < limits.learnt {
            Flag::Slow
        } else if self.strict {
            Flag::Agree
        } else {
            Flag::PriorOnly
        }
    }

    /// The finding as one sentence.
    pub fn sentence<'a, const N: usize>(
        &self,
        limits: &Limits<T>,
        names: &'a [&'a str; N],
        kinds: &'a [Kind; N],
    ) -> Sentence<'a> {
        let name = |j: usize| names.get(j).copied().unwrap_or("this state");
        let kind = |j: usize| kinds.get(j).copied().unwrap_or(Kind::Other);
        let ceiling = self.ceiling().map(T::wide);
        Sentence {
            name: name(self.state),
            partner: self.partner.map(name),
            advice: self.partner.and_then(|p| advice(kind(self.state), kind(p))),
            flag: self.flag(limits),
            order: self.order,
            ceiling,
            xi2: self.xi2.map(T::wide),
            learnt: limits.learnt.wide(),
        }
    }
}

/// Of the row of a state: whether it holds nothing else, its order and its degree.
fn row_of<T: Real, const N: usize, const M: usize>(
    staged: &Staged<T, N, M>,
    state: usize,
    limits: &Limits<T>,
) -> Option<(bool, u8, T)> {
    let row = of_state(staged, state)?;
    let strict = row.kept(limits.coupling) == 1 << (state & 63);
    Some((strict, row.order, row.degree))
}

/// What would tell two states apart.
fn advice(own: Kind, partner: Kind) -> Option<&'static str> {
    let either = |a, b| (own, partner) == (a, b) || (own, partner) == (b, a);
    if either(Kind::Attitude, Kind::GyroBias)
        || either(Kind::Attitude, Kind::AccelBias)
        || (own, partner) == (Kind::GyroBias, Kind::GyroBias)
        || (own, partner) == (Kind::AccelBias, Kind::AccelBias)
        || either(Kind::GyroBias, Kind::AccelBias)
    {
        Some("turn the vehicle")
    } else if own == Kind::Position || partner == Kind::Position {
        Some("take a position fix")
    } else if own == Kind::Velocity || partner == Kind::Velocity {
        Some("take a velocity measurement")
    } else {
        None
    }
}

/// One plain sentence; written with `Display`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sentence<'a> {
    name: &'a str,
    partner: Option<&'a str>,
    advice: Option<&'a str>,
    flag: Flag,
    order: Option<u8>,
    ceiling: Option<f64>,
    xi2: Option<f64>,
    learnt: f64,
}

impl Sentence<'_> {
    fn tie(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.partner {
            Some(partner) => write!(f, "it is tied to {partner}")?,
            None => f.write_str("no measurement sees it")?,
        }
        match self.advice {
            Some(advice) => write!(f, "; {advice}"),
            None => Ok(()),
        }
    }
}

impl fmt::Display for Sentence<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let saturated = match (self.xi2, self.ceiling) {
            (Some(xi2), Some(ceiling)) => xi2 > 0.9 * ceiling,
            _ => false,
        };
        match self.flag {
            Flag::Contradiction => write!(
                f,
                "{} is claimed to be known better than the model allows: the filter learns from its own linearisation, \
                 do not trust its sigma",
                self.name
            ),
            Flag::Slow => match self.order {
                Some(order) => write!(
                    f,
                    "{} can be learnt but has not been yet: it shows only in derivative {order} of the measurement; give \
                     it time",
                    self.name
                ),
                None => write!(f, "{} can be learnt but has not been yet; give it time", self.name),
            },
            Flag::PriorOnly if saturated => {
                write!(f, "{} cannot improve further: ", self.name)?;
                self.tie(f)
            }
            Flag::PriorOnly => {
                write!(f, "{} improves only as far as the prior of its partners allows: ", self.name)?;
                self.tie(f)
            }
            Flag::Agree if self.ceiling.is_some_and(|c| c < self.learnt) => {
                write!(f, "{} cannot be learnt here: ", self.name)?;
                self.tie(f)
            }
            Flag::Agree => write!(f, "{} is seen", self.name),
        }
    }
}

/// A direction in σ0 units, and what the model and the filter say about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionView<T> {
    /// State with the largest part.
    pub main: usize,
    /// State with the next largest part, where that is above a tenth of it.
    pub next: Option<usize>,
    /// Part of the direction that the model cannot see: 0 … 1.
    pub share: T,
    /// η2 along it: variance at the start over variance left.
    pub eta2: T,
    /// How the two stand to each other.
    pub flag: Flag,
}

/// Looks along one direction (σ0 units, any length), for instance an eigenvector of the filter's spectrum.
///
/// `eta2`: 1/(vᵀ P v) of the filter for the unit vector, P in σ0 units. A direction in the unseen space keeps η2 = 1.
pub fn direction<T: Real, const N: usize>(
    unseen: &Unseen<T, N>,
    v: &[T; N],
    eta2: T,
    limits: &Limits<T>,
) -> DirectionView<T> {
    let (mut main, mut next) = ((0, T::zero()), (None, T::zero()));
    for (j, x) in v.iter().enumerate() {
        if x.abs() > main.1 {
            next = (Some(main.0).filter(|_| main.1 > T::zero()), main.1);
            main = (j, x.abs());
        } else if x.abs() > next.1 {
            next = (Some(j), x.abs());
        }
    }
    let share = unseen.share(v);
    let ceiling = ceiling(share);
    let flag = if ceiling.is_some_and(|c| eta2 > c * (T::one() + limits.margin)) {
        Flag::Contradiction
    } else if eta2 < limits.learnt && ceiling.is_none_or(|c| c >= limits.learnt) {
        Flag::Slow
    } else {
        Flag::Agree
    };
    DirectionView {
        main: main.0,
        next: next.0.filter(|_| next.1 > T::of(0.1) * main.1),
        share,
        eta2,
        flag,
    }
}
