//! What `lab replay` shows: JSON, tables, answers, pictures.

use std::path::Path;

use navsight::alignment::coarse::CoarseSolution;
use navsight::error_model::N;
use serde_json::{json, Value};

use super::super::history::Snapshot;
use super::super::solution::{table, turn_deg, Solution};
use super::super::states::STATES;
use super::manoeuvres::Kind;
use super::tally::{Last, Tally};
use super::verdicts::Watch;
use crate::report::{digits, short, Band, Chart, Page, Scale, Series, Table, Tone};

/// What came out.
pub(super) struct Outcome {
    /// None for a vehicle whose attitude was found in motion.
    pub(super) coarse: Option<(CoarseSolution, Solution)>,
    pub(super) solution: Solution,
    pub(super) sigma0: [f64; N],
    pub(super) sigma: [f64; N],
    pub(super) tally: Tally,
    /// Times without fixes [s].
    pub(super) outages: Vec<(f64, f64)>,
}

/// Colour of times without fixes.
const NO_FIXES: &str = "#fecaca";

impl Outcome {
    pub(super) fn json(&self) -> Value {
        let per_row = self.tally.nis.per_row();
        let events: Vec<Value> = self
            .tally
            .events
            .iter()
            .map(|(t, what)| json!({ "t_s": t, "event": what }))
            .collect();
        let mut object = json!({
            "coarse": self.coarse.as_ref().map(|(_, solution)| solution.json()),
            "final": self.solution.json(),
            "states": STATES.map(|s| s.name),
            "xi1": self.tally.last.as_ref().map(|l| l.xi1),
            "xi2": self.tally.last.as_ref().map(|l| l.xi2),
            "sigma0": self.sigma0,
            "sigma": self.sigma,
            "verdicts": self.tally.watch.as_ref().map(Watch::words),
            "verdict_reasons": self.tally.watch.as_ref().map(Watch::reasons),
            "verdict_changes": self.tally.watch.as_ref().map(Watch::changes),
            "nis": { "mean_per_row": per_row, "last_per_row": self.tally.nis.last, "updates": self.tally.nis.updates },
            "rejected": self.tally.rejected,
            "rms_vs_ref": self.rms_json(),
            "manoeuvres": self.tally.manoeuvres.json(),
            "events": events,
            "t_end_s": self.tally.time,
            "samples": self.tally.samples,
        });
        if let (Some((window, _)), Some(Value::Object(coarse))) =
            (&self.coarse, object.get_mut("coarse"))
        {
            let window = json!({
                "sigma_heading_deg": f64::from(window.sigma_heading).to_degrees(),
                "gravity_ratio": f64::from(window.gravity_ratio),
                "earth_rate_ratio": f64::from(window.earth_rate_ratio),
            });
            coarse.insert("window".into(), window);
        }
        object
    }

    /// Root mean square of the differences to the reference, heading, pitch, roll [°].
    fn rms(&self) -> Option<[f64; 3]> {
        let n = self.tally.compared.count as f64;
        (n > 0.0).then(|| self.tally.compared.square.map(|s| (s / n).sqrt()))
    }

    fn rms_json(&self) -> Value {
        let Some(rms) = self.rms() else {
            return Value::Null;
        };
        let mean = self.tally.compared.sum[0] / self.tally.compared.count as f64;
        json!({
            "heading_deg": rms[0], "pitch_deg": rms[1], "roll_deg": rms[2],
            // a reference whose local frame does not point north differs by a constant
            "heading_mean_deg": mean,
            "heading_without_mean_deg": (rms[0] * rms[0] - mean * mean).max(0.0).sqrt(),
            "instants": self.tally.compared.count,
        })
    }

    fn states(&self) -> Table {
        let mut table = Table::new(
            "What the recording taught the filter",
            [
                "state",
                "unit",
                "σ at the start",
                "σ now",
                "ξ1 now [1/s]",
                "ξ2 now",
                "verdict",
            ],
        );
        for (i, state) in STATES.iter().enumerate() {
            let xi = |pick: fn(&Last) -> &[f64; N]| {
                self.tally.last.as_ref().map_or(f64::NAN, |l| pick(l)[i])
            };
            table.row([
                state.name.to_owned(),
                state.unit.to_owned(),
                short(self.sigma0[i] / state.in_si),
                short(self.sigma[i] / state.in_si),
                short(xi(|l| &l.xi1)),
                short(xi(|l| &l.xi2)),
                self.tally
                    .watch
                    .as_ref()
                    .map_or("", |w| w.word(i))
                    .to_owned(),
            ]);
        }
        table
    }

    /// Questions and answers.
    fn answers(&self) -> Vec<(Tone, &'static str, String)> {
        let s = &self.solution;
        let start = self.sigma0[8] / STATES[8].in_si;
        let (heading, sigma) = (s.angles_deg[0], s.angles_deg_sigma[0]);
        let mut answers = vec![(
            Tone::Plain,
            "Where does it point?",
            format!(
                "Heading {heading:.3}° ± {} (1σ), pitch {:.4}°, roll {:.4}°. At the start of the filter the heading was known to {}°.",
                degrees(sigma), s.angles_deg[1], s.angles_deg[2], short(start),
            ),
        )];
        if let Some(last) = &self.tally.last {
            let named = |test: &dyn Fn(f64) -> bool| {
                let names: Vec<&str> = (0..N)
                    .filter(|&i| test(last.xi2[i]))
                    .map(|i| STATES[i].name)
                    .collect();
                if names.is_empty() {
                    "none".to_owned()
                } else {
                    names.join(", ")
                }
            };
            answers.push((
                Tone::Plain,
                "What has been learnt?",
                format!(
                    "Variance down by ten or more (ξ2 ≥ 10): {}.",
                    named(&|x| x >= 10.0)
                ),
            ));
            if last.xi2.iter().all(|x| *x >= 1.1) {
                answers.push((
                    Tone::Good,
                    "What is still a guess?",
                    "Nothing: the variance of every state is down by a tenth and more.".into(),
                ));
            } else {
                answers.push((
                Tone::Note,
                "What is still a guess?",
                format!(
                    "Variance down by less than a tenth (ξ2 < 1.1), so these are what was assumed at the start: {}.{}",
                    named(&|x| x < 1.1),
                    if self.tally.fixes.snapshots().is_empty() {
                        " More time in the same position does not help them."
                    } else {
                        ""
                    }
                ),
            ));
            }
        }
        let per_row = self.tally.nis.per_row();
        if per_row.is_finite() {
            answers.push((
                if (0.05..2.0).contains(&per_row) { Tone::Plain } else { Tone::Note },
                "Do the data fit the model?",
                format!(
                    "{} updates, ν²/s {} per row on average (1 where the noise settings are exact, less where they are cautious); {} rows refused.",
                    self.tally.nis.updates, digits(per_row, 2), self.tally.rejected
                ),
            ));
        }
        if let Some([heading, pitch, roll]) = self.rms() {
            let n = self.tally.compared.count as f64;
            answers.push((
                Tone::Plain,
                "Does it agree with the reference?",
                format!(
                    "Differences at {} instants, rms: heading {}°, pitch {}°, roll {}°; the mean difference in heading is {}°.",
                    self.tally.compared.count, digits(heading, 3), digits(pitch, 3), digits(roll, 3),
                    digits(self.tally.compared.sum[0] / n, 3),
                ),
            ));
        }
        answers
    }

    pub(super) fn text(&self) -> String {
        let mut text = format!(
            "{}\n{}\n",
            self.solutions().to_text(),
            self.states().to_text()
        );
        for (_, question, answer) in self.answers() {
            text += &format!("{question} {answer}\n");
        }
        for (t, what) in self.tally.events.iter().take(20) {
            text += &format!("{t:>10.2} s  {what}\n");
        }
        text
    }

    fn solutions(&self) -> Table {
        let mut columns = Vec::new();
        if let Some((_, coarse)) = &self.coarse {
            columns.push(("coarse", coarse));
        }
        columns.push(("final", &self.solution));
        let caption = format!(
            "Navigation solution after {} samples, at {:.2} s",
            self.tally.samples, self.tally.time
        );
        table(&caption, &columns)
    }

    /// Where it flew, and the innovations of the fixes between their bounds.
    fn flight(&self, page: &mut Page) {
        if self.tally.fixes.snapshots().is_empty() {
            return;
        }
        let (blue, grey) = ("#2563eb", "#94a3b8");
        let plain = |color, points| Series {
            label: String::new(),
            color,
            width: 2,
            points,
        };
        page.section("Trajectory and speed");
        let track = plain(blue, self.tally.track.line(|(_, p)| (p[0], p[1])));
        let speed = plain(blue, self.tally.track.line(|(t, p)| (*t, p[2])));
        let pictures = [
            Chart {
                x_label: "east of the first fix [m]".into(),
                path: true,
                size: (340, 300),
                ..Chart::new("north [m]", Scale::Linear, vec![track])
            },
            Chart {
                x_label: "time [s]".into(),
                size: (340, 300),
                ..self.over_time("speed [m/s]", Scale::Linear, vec![speed])
            },
        ];
        page.figures(2, &pictures.map(|chart| chart.svg()), "");
        page.section("Innovations of the fixes");
        let names = [
            "position east [m]",
            "position north [m]",
            "position up [m]",
            "velocity east [m/s]",
            "velocity north [m/s]",
            "velocity up [m/s]",
        ];
        let pictures: Vec<String> = names
            .iter()
            .enumerate()
            .map(|(i, name)| {
                let bound = |k: f64| plain(grey, self.tally.fixes.line(|(t, x)| (*t, k * x[i][1])));
                let line = plain(blue, self.tally.fixes.line(|(t, x)| (*t, x[i][0])));
                // the first fix after an outage would flatten all others
                let mut usual: Vec<f64> = self
                    .tally
                    .fixes
                    .line(|(t, x)| (*t, x[i][1]))
                    .iter()
                    .map(|p| p.1)
                    .collect();
                usual.sort_by(f64::total_cmp);
                let y_range = usual
                    .get(usual.len() / 2)
                    .filter(|s| **s > 0.0)
                    .map(|s| -6.0 * s..6.0 * s);
                Chart {
                    y_range,
                    ..self.over_time(name, Scale::Linear, vec![bound(3.0), bound(-3.0), line])
                }
                .svg()
            })
            .collect();
        page.figures(
            3,
            &pictures,
            "Between ± 3σ of the filter (grey); a line that leaves the picture comes back. Over time [s].",
        );
    }

    /// A chart over time, with what the vehicle did.
    fn over_time(&self, title: &str, scale: Scale, series: Vec<Series>) -> Chart {
        let done = self.tally.manoeuvres.all();
        let done = done.map(|(kind, (from, to))| Band {
            range: from..to,
            color: kind.color(),
            label: kind.name().into(),
        });
        let cut = self.outages.iter().map(|(from, to)| Band {
            range: *from..*to,
            color: NO_FIXES,
            label: "outage".into(),
        });
        Chart {
            bands: done.chain(cut).collect(),
            ..Chart::new(title, scale, series)
        }
    }

    /// The colours of the bands.
    fn key(&self, page: &mut Page) {
        let mut entries: Vec<(&str, &str)> = [Kind::Turn, Kind::Acceleration, Kind::Still]
            .into_iter()
            .filter(|kind| self.tally.manoeuvres.all().any(|(k, _)| k == *kind))
            .map(|kind| (kind.color(), kind.name()))
            .collect();
        if !self.outages.is_empty() {
            entries.push((NO_FIXES, "outage of the fixes"));
        }
        page.key(&entries);
    }

    pub(super) fn page(&self, imu: &Path) -> Page {
        let mut page = Page::new(
            "Replay",
            &format!(
                "{} through the filter: {} samples.",
                imu.display(),
                self.tally.samples
            ),
        );
        for (tone, question, answer) in self.answers() {
            page.verdict(tone, question, &answer);
        }
        page.table(&self.solutions());
        page.table(&self.states());
        let blue = "#2563eb";
        let line = |value: &dyn Fn(&Snapshot) -> f64| Series {
            label: String::new(),
            color: blue,
            width: 2,
            points: self.tally.history.line(|s| (s.t, value(s))),
        };
        page.section("Attitude and its standard deviation");
        self.key(&mut page);
        let first = self
            .tally
            .history
            .snapshots()
            .first()
            .map_or(0.0, |s| s.angles_deg[0]);
        let mut pictures = Vec::new();
        for (i, name) in ["heading [°]", "pitch [°]", "roll [°]"].iter().enumerate() {
            // Unwrapped around the first heading, so that 359° to 1° is no jump.
            let value = move |s: &Snapshot| match i {
                0 => first + turn_deg(first, s.angles_deg[0]),
                _ => s.angles_deg[i],
            };
            pictures.push(
                self.over_time(name, Scale::Linear, vec![line(&value)])
                    .svg(),
            );
        }
        for i in [8, 6, 7] {
            let state = &STATES[i];
            let title = format!("σ of {} [{}]", state.name, state.unit);
            pictures.push(
                self.over_time(
                    &title,
                    Scale::Logarithmic,
                    vec![line(&|s: &Snapshot| s.sigma[i] / state.in_si)],
                )
                .svg(),
            );
        }
        page.figures(3, &pictures, "Over time [s].");
        self.flight(&mut page);
        page.section("ξ2: variance at the start over variance now");
        self.key(&mut page);
        let pictures: Vec<String> = STATES
            .iter()
            .enumerate()
            .map(|(i, state)| {
                self.over_time(
                    state.name,
                    Scale::Logarithmic,
                    vec![line(&|s: &Snapshot| s.xi2[i])],
                )
                .svg()
            })
            .collect();
        page.figures(3, &pictures, "1: nothing learnt yet. Over time [s].");
        page.section("ν²/s of the updates, per row");
        let chart = Chart {
            level: Some(1.0),
            size: (690, 190),
            ..self.over_time("", Scale::Logarithmic, vec![line(&|s: &Snapshot| s.nis)])
        };
        page.figures(
            1,
            &[chart.svg()],
            "1 on average (dashed) where the noise settings are exact. Over time [s].",
        );
        page
    }
}

/// An angle in the unit in which people say it.
fn degrees(deg: f64) -> String {
    if deg >= 0.01 {
        format!("{deg:.3}°")
    } else {
        format!("{:.1}″", deg * 3600.0)
    }
}
