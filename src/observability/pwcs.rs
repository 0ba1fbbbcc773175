//! Rank of the observability matrices of a piecewise constant system, by staged elimination.
//!
//! ```text
//! stripped  [ Q_1 ; Q_2 ; … ; Q_r ],    total  [ Q_1 ; Q_2 Φ_1 ; Q_3 Φ_2 Φ_1 ; … ],    Q_k = [ H ; H F_k ; … ; H F_kⁿ⁻¹ ]
//! ```
//!
//! Neither is formed. Rows H Fᵏ come one at a time, lowest order first, in canonical units and with their length kept
//! near 1 by a power of two; each is reduced by those before it, and what is left is a new row or nothing. A chain of
//! rows ends where it adds nothing to its own segment, so the orders used are 0 … 3 for an inertial navigator.
//!
//! Sources: Goshen-Meskin and Bar-Itzhack 1992 (both matrices); Peng 2016 Fig. 3, rebuilt (the elimination). Ranks,
//! f32 and f64: `host-tests/tests/pwcs.rs`.

use nalgebra::{SMatrix, SVector};

use crate::error::Error;
use crate::linalg::Real;

/// Largest number of states, so that an index fits the tables.
const MOST: usize = 64;

/// What a state is, for its canonical unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Kind {
    /// Position [m]
    Position,
    /// Velocity [m/s]
    Velocity,
    /// Attitude [rad]
    Attitude,
    /// Gyro bias [rad/s]
    GyroBias,
    /// Accelerometer bias [m/s²]
    AccelBias,
    /// Anything else, taken as it is.
    Other,
}

impl Kind {
    /// The unit in which one radian of tilt acts with entries near 1 on everything: gτ², gτ, 1, 1/τ, g.
    pub fn unit<T: Real>(self, time: T, gravity: T) -> T {
        match self {
            Kind::Position => gravity * time * time,
            Kind::Velocity => gravity * time,
            Kind::Attitude | Kind::Other => T::one(),
            Kind::GyroBias => T::one() / time,
            Kind::AccelBias => gravity,
        }
    }
}

/// The 15 states of the filter, in their order.
pub const NAVIGATION: [Kind; 15] = [
    Kind::Position,
    Kind::Position,
    Kind::Position,
    Kind::Velocity,
    Kind::Velocity,
    Kind::Velocity,
    Kind::Attitude,
    Kind::Attitude,
    Kind::Attitude,
    Kind::GyroBias,
    Kind::GyroBias,
    Kind::GyroBias,
    Kind::AccelBias,
    Kind::AccelBias,
    Kind::AccelBias,
];

/// Canonical units and how small is nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale<T, const N: usize> {
    /// Unit of time τ [s].
    pub time: T,
    /// Unit of each state.
    pub unit: [T; N],
    /// Prior standard deviation of each state, in its own unit; decides which state stands for a row.
    pub sigma: [T; N],
    /// A row of which less than this part is new is dependent.
    pub tolerance: T,
}

impl<T: Real, const N: usize> Scale<T, N> {
    /// τ = 300 s, tolerance 1e-4, gravity [m/s²], for states of these kinds.
    ///
    /// With these the full 15-state model has f32 ranks that are right with a margin of more than 100 on both sides
    /// (`host-tests/tests/pwcs.rs`); 1/ω_ie as unit of time fails in f32.
    pub fn canonical(kinds: &[Kind; N], sigma: &SVector<T, N>, gravity: T) -> Self {
        let time = T::of(300.0);
        let mut scale = Self {
            time,
            unit: [T::one(); N],
            sigma: [T::one(); N],
            tolerance: T::of(1e-4),
        };
        for ((unit, weight), (kind, s)) in scale
            .unit
            .iter_mut()
            .zip(&mut scale.sigma)
            .zip(kinds.iter().zip(sigma.iter()))
        {
            *unit = kind.unit(time, gravity);
            *weight = *s;
        }
        scale
    }

    /// Numbers as they are (unit of time 1 s, units and priors 1), dependent below this tolerance.
    pub fn plain(tolerance: T) -> Self {
        Self {
            time: T::one(),
            unit: [T::one(); N],
            sigma: [T::one(); N],
            tolerance,
        }
    }

    fn check(&self) -> Result<(), Error> {
        let mut good = self.time > T::zero() && self.tolerance > T::zero();
        let mut finite = self.time.finite() && self.tolerance.finite();
        for (unit, sigma) in self.unit.iter().zip(&self.sigma) {
            good &= *unit > T::zero() && *sigma > T::zero();
            finite &= unit.finite() && sigma.finite();
        }
        match (finite, good && N > 0 && N <= MOST) {
            (false, _) => Err(Error::NonFinite),
            (true, false) => Err(Error::OutOfRange),
            (true, true) => Ok(()),
        }
    }
}

/// Where an accepted row H Fᵏ comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Origin {
    /// Segment, from 0.
    pub segment: u8,
    /// Order k: derivatives of the measurement.
    pub order: u8,
    /// Row of H.
    pub row: u8,
    /// The row was stored divided by two to this power.
    exponent: i16,
}

const NOWHERE: Origin = Origin {
    segment: 0,
    order: 0,
    row: 0,
    exponent: 0,
};

/// What a slice came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Progress {
    /// There is more to do.
    Working,
    /// This segment is finished.
    Done,
}

/// Reduced rows, and how each is put together from rows H Fᵏ.
#[derive(Clone, Copy, Debug)]
struct Rows<T, const N: usize> {
    /// Accepted rows, canonical units, reduced: its own pivot column is 1, those of the others 0.
    u: [[T; N]; N],
    /// Pivot column per row.
    pivot: [u8; N],
    /// Pivot columns.
    taken: u64,
    len: usize,
}

/// Drops what cancellation leaves: a difference below 32 ε of its parts is nothing.
#[inline(always)]
fn subtract<T: Real>(row: &mut [T], factor: T, other: &[T]) {
    let noise = T::of(32.0) * T::EPSILON;
    for (x, y) in row.iter_mut().zip(other) {
        let part = factor * *y;
        let rest = *x - part;
        *x = if rest.abs() <= noise * part.abs() {
            T::zero()
        } else {
            rest
        };
    }
}

fn square<T: Real>(row: &[T]) -> T {
    let mut sum = T::zero();
    for x in row {
        sum += *x * *x;
    }
    sum
}

fn get<V: Copy>(table: &[V], index: usize, or: V) -> V {
    match table.get(index) {
        Some(value) => *value,
        None => or,
    }
}

impl<T: Real, const N: usize> Rows<T, N> {
    fn new() -> Self {
        Self {
            u: [[T::zero(); N]; N],
            pivot: [0; N],
            taken: 0,
            len: 0,
        }
    }

    /// Reduces a row by the accepted ones, and `p` with it; true where something new is left.
    fn reduce(&self, row: &mut [T; N], tolerance: T, mut each: impl FnMut(usize, T)) -> bool {
        let length = square(row);
        for (a, (u, pivot)) in self.u.iter().zip(&self.pivot).take(self.len).enumerate() {
            let factor = get(row, usize::from(*pivot), T::zero());
            if factor != T::zero() {
                subtract(row, factor, u);
                if let Some(x) = row.get_mut(usize::from(*pivot)) {
                    *x = T::zero();
                }
                each(a, factor);
            }
        }
        square(row) > tolerance * tolerance * length
    }

    /// Takes a reduced row in: chooses its pivot, and clears that column in the others.
    fn accept(&mut self, row: &mut [T; N], weight: &[T; N], mut each: impl FnMut(usize, T)) -> T {
        let mut best = (0usize, T::zero());
        for (j, (x, w)) in row.iter().zip(weight).enumerate() {
            let size = x.abs() * *w;
            if self.taken >> (j & 63) & 1 == 0 && size > best.1 {
                best = (j, size);
            }
        }
        let pivot = best.0;
        let inverse = T::one() / get(row, pivot, T::one());
        for x in row.iter_mut() {
            *x *= inverse;
        }
        for (a, u) in self.u.iter_mut().take(self.len).enumerate() {
            let factor = get(u, pivot, T::zero());
            if factor != T::zero() {
                subtract(u, factor, row);
                if let Some(x) = u.get_mut(pivot) {
                    *x = T::zero();
                }
                each(a, factor);
            }
        }
        if let (Some(u), Some(p)) = (self.u.get_mut(self.len), self.pivot.get_mut(self.len)) {
            *u = *row;
            *p = pivot as u8;
            self.taken |= 1 << (pivot & 63);
            self.len += 1;
        }
        inverse
    }
}

/// Staged elimination of a growing observability matrix of `N` states and measurements of `M` rows.
///
/// Memory for N = 15, M = 6 in f32: see `BENCHMARKS.md`. Segments are added as the vehicle manoeuvres, and a long
/// elimination may be cut into slices of one row each with [`Staged::step`].
#[derive(Clone, Copy, Debug)]
pub struct Staged<T: Real, const N: usize, const M: usize> {
    scale: Scale<T, N>,
    weight: [T; N],
    rows: Rows<T, N>,
    /// How each row is put together from the accepted H Fᵏ.
    p: [[T; N]; N],
    origin: [Origin; N],
    /// Rows of this segment alone: they say when its chains end.
    own: Rows<T, N>,
    chain: [[T; N]; M],
    exponent: [i16; M],
    alive: u64,
    order: u8,
    next: usize,
    segments: u8,
}

impl<T: Real, const N: usize, const M: usize> Staged<T, N, M> {
    /// Nothing measured yet.
    ///
    /// [`Error::NonFinite`], or [`Error::OutOfRange`] for a unit, σ or tolerance that is not positive, or more than 64
    /// states or rows, or none.
    pub fn new(scale: &Scale<T, N>) -> Result<Self, Error> {
        scale.check()?;
        if M == 0 || M > MOST {
            return Err(Error::OutOfRange);
        }
        let mut weight = [T::one(); N];
        for (w, (sigma, unit)) in weight.iter_mut().zip(scale.sigma.iter().zip(&scale.unit)) {
            *w = *sigma / *unit;
        }
        Ok(Self {
            scale: *scale,
            weight,
            rows: Rows::new(),
            p: [[T::zero(); N]; N],
            origin: [NOWHERE; N],
            own: Rows::new(),
            chain: [[T::zero(); N]; M],
            exponent: [0; M],
            alive: 0,
            order: 0,
            next: 0,
            segments: 0,
        })
    }

    /// Starts a segment with measurement matrix `h`, M × N, in the units of the states.
    ///
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] after 255 segments. Nothing is changed then.
    pub fn begin(&mut self, h: &SMatrix<T, M, N>) -> Result<(), Error> {
        if !h.iter().all(|x| x.finite()) {
            return Err(Error::NonFinite);
        }
        if self.segments == u8::MAX {
            return Err(Error::OutOfRange);
        }
        self.segments += 1;
        self.own.len = 0;
        self.own.taken = 0;
        self.order = 0;
        self.next = 0;
        self.alive = if M >= 64 { u64::MAX } else { (1 << M) - 1 };
        for (((row, exponent), source), m) in self
            .chain
            .iter_mut()
            .zip(&mut self.exponent)
            .zip(h.row_iter())
            .zip(0..)
        {
            for ((x, entry), unit) in row.iter_mut().zip(source.iter()).zip(&self.scale.unit) {
                *x = *entry * *unit;
            }
            *exponent = normalise(row);
            if square(row) == T::zero() {
                self.alive &= !(1 << (m & 63));
            }
        }
        Ok(())
    }

    /// Handles one row H Fᵏ of the segment that was begun.
    ///
    /// * `f`: F of this segment, the same at every step
    /// * `before`: Φ from the start of the first segment to the start of this one, for the total matrix; `None` for the
    ///   stripped matrix, and in the first segment
    ///
    /// [`Error::NonFinite`] where a number of F or Φ is; the elimination is unchanged then.
    pub fn step(
        &mut self,
        f: &SMatrix<T, N, N>,
        before: Option<&SMatrix<T, N, N>>,
    ) -> Result<Progress, Error> {
        if self.order == 0 && self.next == 0 {
            let broken = |m: &SMatrix<T, N, N>| !m.iter().all(|x| x.finite());
            if broken(f) || before.is_some_and(broken) {
                return Err(Error::NonFinite);
            }
        }
        if self.alive == 0 {
            return Ok(Progress::Done);
        }
        let m = loop {
            let m = self.next;
            self.next += 1;
            if m >= M {
                self.next = 0;
                self.order = self.order.saturating_add(1);
            } else if self.alive >> (m & 63) & 1 == 1 {
                break m;
            }
        };
        let row = get(&self.chain, m, [T::zero(); N]);
        let exponent = get(&self.exponent, m, 0);
        let origin = Origin {
            segment: self.segments - 1,
            order: self.order,
            row: m as u8,
            exponent,
        };
        let fresh = self.offer(&row, before, origin);
        // In the first segment the rows so far are its own.
        let goes_on = if self.segments == 1 {
            fresh
        } else {
            let mut reduced = row;
            let fresh = self
                .own
                .reduce(&mut reduced, self.scale.tolerance, |_, _| {});
            if fresh {
                self.own.accept(&mut reduced, &self.weight, |_, _| {});
            }
            fresh
        };
        if goes_on && usize::from(self.order) + 1 < N {
            let (next, more) = self.derive(&row, f);
            if let (Some(chain), Some(e)) = (self.chain.get_mut(m), self.exponent.get_mut(m)) {
                *chain = next;
                *e = exponent.saturating_add(more);
            }
            if square(&next) > T::zero() {
                return Ok(Progress::Working);
            }
        }
        self.alive &= !(1 << (m & 63));
        Ok(if self.alive == 0 {
            Progress::Done
        } else {
            Progress::Working
        })
    }

    /// A whole segment in one call. Errors as [`Staged::begin`] and [`Staged::step`].
    pub fn segment(
        &mut self,
        f: &SMatrix<T, N, N>,
        h: &SMatrix<T, M, N>,
        before: Option<&SMatrix<T, N, N>>,
    ) -> Result<(), Error> {
        let broken = |m: &SMatrix<T, N, N>| !m.iter().all(|x| x.finite());
        if broken(f) || before.is_some_and(broken) {
            return Err(Error::NonFinite);
        }
        self.begin(h)?;
        // Every chain has at most N rows.
        for _ in 0..=N * M {
            if self.step(f, before)? == Progress::Done {
                break;
            }
        }
        Ok(())
    }

    /// Row times F in canonical units, and the power of two that was taken out.
    fn derive(&self, row: &[T; N], f: &SMatrix<T, N, N>) -> ([T; N], i16) {
        let mut next = [T::zero(); N];
        let tau = self.scale.time;
        for (j, (sum, column)) in next.iter_mut().zip(f.column_iter()).enumerate() {
            for ((x, entry), unit) in row.iter().zip(column.iter()).zip(&self.scale.unit) {
                if *x != T::zero() && *entry != T::zero() {
                    *sum += *x * *entry / *unit;
                }
            }
            *sum *= tau * get(&self.scale.unit, j, T::one());
        }
        let exponent = normalise(&mut next);
        (next, exponent)
    }

    /// Reduces a row, and takes it in where something new is left.
    fn offer(&mut self, row: &[T; N], before: Option<&SMatrix<T, N, N>>, origin: Origin) -> bool {
        let mut reduced = match before {
            None => *row,
            Some(phi) => {
                let mut moved = [T::zero(); N];
                for (j, (sum, column)) in moved.iter_mut().zip(phi.column_iter()).enumerate() {
                    for ((x, entry), unit) in row.iter().zip(column.iter()).zip(&self.scale.unit) {
                        *sum += *x * *entry / *unit;
                    }
                    *sum *= get(&self.scale.unit, j, T::one());
                }
                moved
            }
        };
        if self.rows.len >= N {
            return false;
        }
        let mut q = [T::zero(); N];
        if let Some(own) = q.get_mut(self.rows.len) {
            *own = T::one();
        }
        let p = &mut self.p;
        let fresh = self
            .rows
            .reduce(&mut reduced, self.scale.tolerance, |a, factor| {
                if let Some(p) = p.get(a) {
                    subtract(&mut q, factor, p);
                }
            });
        if !fresh {
            return false;
        }
        // The row is scaled by its pivot first, and p with it, before the others are cleared.
        let at = self.rows.len;
        let mut cleared = [T::zero(); N];
        let inverse = self.rows.accept(&mut reduced, &self.weight, |a, factor| {
            if let Some(c) = cleared.get_mut(a) {
                *c = factor;
            }
        });
        for x in &mut q {
            *x *= inverse;
        }
        for (p, factor) in self.p.iter_mut().zip(&cleared).take(at) {
            if *factor != T::zero() {
                subtract(p, *factor, &q);
            }
        }
        if let (Some(p), Some(o)) = (self.p.get_mut(at), self.origin.get_mut(at)) {
            *p = q;
            *o = origin;
        }
        true
    }

    /// Rank so far.
    pub const fn rank(&self) -> usize {
        self.rows.len
    }

    /// Scale it was made with.
    pub const fn scale(&self) -> &Scale<T, N> {
        &self.scale
    }

    /// States that stand for a row (pivots), as bits.
    pub const fn pivots(&self) -> u64 {
        self.rows.taken
    }

    /// Where the accepted rows come from, in the order of acceptance.
    pub fn origins(&self) -> impl Iterator<Item = Origin> + '_ {
        self.origin.iter().copied().take(self.rows.len)
    }

    /// Pivot state of a reduced row.
    pub fn pivot(&self, row: usize) -> Option<usize> {
        (row < self.rows.len).then(|| usize::from(get(&self.rows.pivot, row, 0)))
    }

    /// A reduced row in the states' own units, its pivot 1: what is known jointly with that state.
    pub fn reduced(&self, row: usize) -> Option<[T; N]> {
        let pivot = self.pivot(row)?;
        let mut out = *self.rows.u.get(row)?;
        let own = get(&self.scale.unit, pivot, T::one());
        for (x, unit) in out.iter_mut().zip(&self.scale.unit) {
            *x = *x * own / *unit;
        }
        Some(out)
    }

    /// Highest order in a reduced row, and how long its part of that order is: ‖p‖ in the units of the measurements, for
    /// the row with pivot 1 in the state's own unit.
    pub fn highest_order(&self, row: usize) -> Option<(u8, T)> {
        let pivot = self.pivot(row)?;
        let p = self.p.get(row)?;
        let mut order = 0;
        for (x, origin) in p.iter().zip(&self.origin) {
            if *x != T::zero() && origin.order > order {
                order = origin.order;
            }
        }
        let mut sum = T::zero();
        for (x, origin) in p.iter().zip(&self.origin) {
            if origin.order == order {
                let part = *x * two_to(-origin.exponent);
                sum += part * part;
            }
        }
        let mut length = sum.root();
        for _ in 0..order {
            length *= self.scale.time;
        }
        Some((order, length * get(&self.scale.unit, pivot, T::one())))
    }
}

/// 2ⁿ.
fn two_to<T: Real>(n: i16) -> T {
    T::of(libm::ldexp(1.0, i32::from(n)))
}

/// Divides a row by the power of two nearest below its largest element; returns that power. Exact.
fn normalise<T: Real>(row: &mut [T]) -> i16 {
    let mut largest = T::zero();
    for x in row.iter() {
        if x.abs() > largest {
            largest = x.abs();
        }
    }
    if !(largest.finite() && largest > T::zero()) {
        return 0;
    }
    let exponent = libm::ilogb(largest.wide()).clamp(-1000, 1000);
    let factor = two_to(-(exponent as i16));
    for x in row {
        *x *= factor;
    }
    exponent as i16
}
