//! What the vehicle did, second by second, by the filter's own solution: what teaches it shows in the pictures.

use serde_json::{json, Value};

use super::super::solution::turn_deg;

/// What it did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Slower than [`SLOW`] and neither of the others.
    Still,
    /// Faster round than [`TURNING`].
    Turn,
    /// Changing its velocity by more than [`CHANGING`].
    Acceleration,
}

impl Kind {
    pub(super) fn name(self) -> &'static str {
        match self {
            Kind::Still => "hover or rest",
            Kind::Turn => "turn",
            Kind::Acceleration => "acceleration",
        }
    }

    /// Of its band in a picture.
    pub(super) fn color(self) -> &'static str {
        match self {
            Kind::Still => "#e0e7ff",
            Kind::Turn => "#fef3c7",
            Kind::Acceleration => "#dcfce7",
        }
    }
}

/// [m/s]
const SLOW: f64 = 1.0;
/// [°/s]
const TURNING: f64 = 5.0;
/// [m/s²]
const CHANGING: f64 = 1.0;
/// Interruptions as short as this do not end a manoeuvre [s],
const PAUSE: f64 = 3.5;
/// and what is shorter than this is none.
const SHORTEST: f64 = 2.5;

/// From, to [s].
type Span = (f64, f64);

/// Gathers them.
#[derive(Default)]
pub(super) struct Manoeuvres {
    /// Time, heading [°], velocity east and north [m/s] a second ago.
    last: Option<(f64, f64, [f64; 2])>,
    spans: Vec<(Kind, Span)>,
}

impl Manoeuvres {
    /// The solution at a time; looked at once a second.
    pub(super) fn take(&mut self, t: f64, heading_deg: f64, v: [f64; 2]) {
        let Some((before, heading, v_before)) = self.last else {
            self.last = Some((t, heading_deg, v));
            return;
        };
        let dt = t - before;
        if dt < 1.0 {
            return;
        }
        self.last = Some((t, heading_deg, v));
        let rate = turn_deg(heading, heading_deg) / dt;
        let change = (v[0] - v_before[0]).hypot(v[1] - v_before[1]) / dt;
        let kind = match () {
            () if rate.abs() > TURNING => Kind::Turn,
            () if change > CHANGING => Kind::Acceleration,
            () if v[0].hypot(v[1]) < SLOW => Kind::Still,
            () => return,
        };
        let same = self.spans.iter_mut().rev().find(|(k, _)| *k == kind);
        match same {
            Some((_, (_, to))) if before - *to <= PAUSE => *to = t,
            _ => self.spans.push((kind, (before, t))),
        }
    }

    /// Those that last, in order of their beginning.
    pub(super) fn all(&self) -> impl Iterator<Item = (Kind, Span)> + '_ {
        let lasts = |(from, to): Span| to - from >= SHORTEST;
        self.spans
            .iter()
            .copied()
            .filter(move |(_, span)| lasts(*span))
    }

    pub(super) fn json(&self) -> Value {
        self.all()
            .map(|(kind, (from, to))| json!({ "what": kind.name(), "from_s": from, "to_s": to }))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_changes_of_speed_and_rest_are_told_apart() {
        let mut m = Manoeuvres::default();
        let (mut heading, mut speed) = (350.0f64, 0.0);
        for k in 0..1200 {
            let t = f64::from(k) * 0.1;
            match t {
                20.0..30.0 => speed += 0.2,
                60.0..70.0 => heading += 1.0,
                // as short as this it is none
                90.0..91.0 => heading += 1.0,
                _ => {}
            }
            m.take(t, heading.rem_euclid(360.0), [0.0, speed]);
        }
        let all: Vec<_> = m.all().collect();
        let kinds: Vec<_> = all.iter().map(|(kind, _)| *kind).collect();
        assert_eq!(kinds, [Kind::Still, Kind::Acceleration, Kind::Turn]);
        for ((_, (from, to)), wanted) in all.iter().zip([(0.0, 20.0), (20.0, 30.0), (60.0, 70.0)]) {
            // looked at once a second
            assert!(
                (from - wanted.0).abs() < 1.3 && (to - wanted.1).abs() < 1.3,
                "{all:?}"
            );
        }
    }
}
