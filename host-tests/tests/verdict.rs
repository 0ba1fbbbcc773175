//! Verdicts on systems whose answer is known on paper: one state that is fed by hand, the others at rest.
#![cfg(not(target_os = "none"))]

use navsight::error::Error;
use navsight::error_model::N;
use navsight::filter::UpdateReport;
use navsight::observability::verdict::{Judgement, Limits, Reason, Verdict, Verdicts};

/// The state that is looked at: which one makes no difference.
const AT: usize = 8;

/// A scalar state, measured once a second.
struct Scalar {
    verdicts: Verdicts,
    t: f64,
    p: f32,
    changes: Vec<(f64, Verdict, Reason)>,
}

impl Scalar {
    fn new(required: Option<f32>) -> Self {
        let mut wanted = [None; N];
        wanted[AT] = required;
        Self {
            verdicts: Verdicts::new(&[1.0; N], &wanted, Limits::DEFAULT).unwrap(),
            t: 0.0,
            p: 1.0,
            changes: Vec::new(),
        }
    }

    /// A second: noise `q` comes in, a measurement of information `i` (1/R), innovation ν²/s, correction δx.
    fn second(&mut self, q: f32, i: f32, nis: f32, dx: f32) {
        let before = self.p + q;
        let after = before / (1.0 + before * i);
        let put = |x: f32, other: f32| std::array::from_fn(|k| if k == AT { x } else { other });
        let report = UpdateReport {
            nu: [nis.sqrt()],
            s: [1.0],
            row_nis: [nis],
            nis,
            accepted: [true],
            p_before: put(before, 1.0),
            p_after: put(after, 1.0),
            decrease: put(before * before * i / (1.0 + before * i), 0.0),
            correction: put(dx, 0.0),
            normalised: (1 << N) - 1,
            interval: 1.0,
        };
        self.p = after;
        self.t += 1.0;
        let changed = self.verdicts.take(self.t, &report);
        assert_eq!(changed & !(1 << AT), 0, "the others are at rest");
        if changed != 0 {
            let Judgement { verdict, reason } = self.now();
            self.changes.push((self.t, verdict, reason));
        }
    }

    fn seconds(&mut self, n: usize, q: f32, i: f32) {
        (0..n).for_each(|_| self.second(q, i, 1.0, 0.0));
    }

    fn now(&self) -> Judgement {
        self.verdicts.of(AT).unwrap()
    }

    fn reason(&self) -> Reason {
        self.now().reason
    }
}

#[test]
fn what_is_not_measured_is_unseen() {
    let mut s = Scalar::new(Some(0.5));
    assert_eq!(s.reason(), Reason::NotYet);
    s.seconds(100, 0.0, 0.0);
    assert_eq!(s.reason(), Reason::NothingSeen);
    // 1 % a second for 100 s: the variance doubles.
    s.seconds(100, 0.01, 0.0);
    assert_eq!(s.reason(), Reason::Drifts);
    assert!(s.changes.is_empty(), "unseen all along: {:?}", s.changes);
}

#[test]
fn averaging_is_learning_until_it_is_done_or_useless() {
    // p = 1/(1 + t): at rest from t = 1200 s on by its rate, σ there 0.0289.
    let mut free = Scalar::new(None);
    free.seconds(1500, 0.0, 1.0);
    let at: Vec<_> = free.changes.iter().map(|c| (c.1, c.2)).collect();
    assert_eq!(
        at,
        [
            (Verdict::Learning, Reason::Falling),
            (Verdict::Settled, Reason::AtRest)
        ]
    );
    // Easier to hold than to get: 1200 s / 0.9, then two blocks.
    let t = free.changes[1].0;
    assert!((1333.0..=1361.0).contains(&t), "{t}");

    // A requirement within reach: σ 0.1 at t = 99 s, seen at the second block end after it.
    let mut done = Scalar::new(Some(0.1));
    done.seconds(200, 0.0, 1.0);
    let (t, verdict, reason) = done.changes[1];
    assert_eq!((verdict, reason), (Verdict::Settled, Reason::Required));
    assert!((101.0..=121.0).contains(&t), "{t}");

    // One that is not: at rest above it.
    let mut vain = Scalar::new(Some(0.001));
    vain.seconds(1500, 0.0, 1.0);
    assert_eq!(vain.now().verdict, Verdict::Limited);

    // Noise and measurements in balance: p∞² = q/i, σ = 0.1.
    let mut balance = Scalar::new(Some(0.05));
    balance.seconds(1500, 1e-4, 1.0);
    assert_eq!(balance.reason(), Reason::Balance);

    // Started better than wanted.
    let mut known = Scalar::new(Some(2.0));
    known.seconds(20, 0.0, 0.0);
    assert_eq!(known.reason(), Reason::PriorSuffices);
}

#[test]
fn a_state_that_is_no_longer_seen_is_not_settled() {
    // Learnt in a manoeuvre, then a hover in which nothing comes in and noise takes σ from 0.05 up.
    let mut s = Scalar::new(Some(0.2));
    s.seconds(100, 1e-5, 4.0);
    assert_eq!(s.now().verdict, Verdict::Settled);
    let hover = s.t;
    s.seconds(160, 1e-3, 1e-4);
    let (t, verdict, reason) = *s.changes.last().unwrap();
    assert_eq!((verdict, reason), (Verdict::Weak, Reason::Fading));
    // The first block that lies in the hover.
    assert!(t - hover <= 20.0, "left settled {} s after", t - hover);
    // The next manoeuvre.
    s.seconds(60, 1e-5, 4.0);
    assert_eq!(s.now().verdict, Verdict::Settled);
    // An outage: no report at all, and the filter's variance grows.
    let mut p = [1.0; N];
    for k in 1..=30 {
        p[AT] = s.p + 1e-3 * k as f32;
        s.verdicts.pass(s.t + f64::from(k), &p);
    }
    assert_eq!(s.reason(), Reason::Fading);
}

#[test]
fn a_short_disturbance_changes_nothing() {
    let mut s = Scalar::new(None);
    s.seconds(202, 0.0, 1.0);
    let count = s.changes.len();
    s.seconds(5, 1e-3, 0.0); // inside one block
    s.seconds(60, 0.0, 1.0);
    assert_eq!(s.changes.len(), count, "{:?}", s.changes);
}

#[test]
fn innovations_contradict_what_was_learnt_from_them() {
    let mut s = Scalar::new(Some(0.1));
    s.seconds(150, 1e-4, 4.0);
    assert_eq!(s.now().verdict, Verdict::Settled);
    // One outlier, however large, is for the gate.
    s.second(1e-4, 4.0, 1e6, 0.0);
    s.seconds(30, 1e-4, 4.0);
    assert_eq!(s.now().verdict, Verdict::Settled);
    // σ of the measurement three times too small.
    for _ in 0..150 {
        s.second(1e-4, 4.0, 9.0, 0.0);
    }
    assert_eq!(s.reason(), Reason::InnovationsLarge);
    // Well again: the memory of ten blocks has to fade first.
    s.seconds(300, 1e-4, 4.0);
    assert_eq!(s.now().verdict, Verdict::Settled);
    // A frozen sensor: down from 1 to 1e-4 takes 90 blocks of a memory of 0.9.
    for _ in 0..1000 {
        s.second(1e-4, 4.0, 0.0, 0.0);
    }
    assert_eq!(s.reason(), Reason::InnovationsSilent);
    // What was never learnt from them is not contradicted.
    let mut unseen = Scalar::new(None);
    (0..150).for_each(|_| unseen.second(0.0, 1e-6, 9.0, 0.0));
    assert_eq!(unseen.reason(), Reason::NothingSeen);
}

#[test]
fn a_state_that_moves_without_information_is_inconsistent() {
    let mut s = Scalar::new(None);
    // Each second the measurements take 1e-6 of the variance, so 1e-3 σ is what one may move it; it moves by that
    // every time, and always the same way: after 200 s 0.1 … 0.2 σ, nothing to speak of,
    for _ in 0..200 {
        s.second(0.0, 1e-6, 1.0, 1e-3);
    }
    assert_eq!(s.reason(), Reason::NothingSeen);
    // and after another minute of ten times that 0.5 σ, of which the measurements justify 0.02.
    for _ in 0..100 {
        s.second(0.0, 1e-6, 1.0, 1e-2);
    }
    assert_eq!(s.reason(), Reason::MovesAlone);

    // The same movement back and forth is what corrections do.
    let mut white = Scalar::new(None);
    for k in 0..300 {
        white.second(0.0, 1e-6, 1.0, if k % 2 == 0 { 1e-2 } else { -1e-2 });
    }
    assert_eq!(white.reason(), Reason::NothingSeen);
}

#[test]
fn a_ceiling_is_where_learning_ends_and_boasting_begins() {
    let run = |ceiling: f32, seconds: usize| {
        let mut s = Scalar::new(None);
        let mut ceilings = [None; N];
        ceilings[AT] = Some(ceiling);
        s.verdicts.set_ceilings(&ceilings);
        s.seconds(seconds, 0.0, 1.0);
        s.reason() // ξ2 = 1 + t
    };
    assert_eq!(run(404.0, 301), Reason::Falling);
    assert_eq!(run(404.0, 401), Reason::AtCeiling);
    // An honest loop that re-linearises: 404 → 424.
    assert_eq!(run(404.0, 424), Reason::AtCeiling);
    // More than the two honest reasons explain.
    assert_eq!(run(404.0, 480), Reason::AboveCeiling);
}

#[test]
fn nonsense_is_refused() {
    let new = |sigma0: f32, required: f32, limits| {
        Verdicts::new(&[sigma0; N], &[Some(required); N], limits).map(|_| ())
    };
    let good = Limits::DEFAULT;
    assert_eq!(new(1.0, 1.0, good), Ok(()));
    assert_eq!(new(1.0, 0.0, good), Err(Error::OutOfRange));
    assert_eq!(new(1.0, f32::NAN, good), Err(Error::NonFinite));
    let bad = |change: fn(&mut Limits)| {
        let mut limits = good;
        change(&mut limits);
        new(1.0, 1.0, limits)
    };
    assert_eq!(bad(|l| l.block = 0.0), Err(Error::OutOfRange));
    assert_eq!(bad(|l| l.memory = 1.0), Err(Error::OutOfRange));
    assert_eq!(bad(|l| l.nis = f32::INFINITY), Err(Error::NonFinite));
}
