//! What `lab align` shows: answers, tables, pictures.

use std::ops::Range;

use navsight::error_model::{ATT, BA, BG, N};

use super::super::states::STATES;
use super::{Along, Case, Moment, Paper, Scenario};
use crate::config::DEG_PER_H;
use crate::report::{digits, short, Band, Cell, Chart, Page, Scale, Series, Table, Tone};

const BLUE: &str = "#2563eb";
const ORANGE: &str = "#ea580c";
const COLORS: [&str; 2] = [BLUE, ORANGE];
const HEADING: usize = ATT + 2;

/// Both cases.
pub(super) struct Outcome<'a> {
    pub scenario: &'a Scenario,
    pub cases: [&'a Case; 2],
    pub paper: &'a Paper,
}

impl Outcome<'_> {
    /// Everything for a terminal.
    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        for table in self.paper.tables() {
            text += &format!("{}\n", table.to_text());
        }
        text += &format!("{}\n", self.directions().to_text());
        for (_, question, answer) in self.answers() {
            text += &format!("{question}\n  {answer}\n");
        }
        text + "\n" + &self.table().to_text()
    }

    /// Everything for a browser.
    pub(super) fn page(&self) -> Page {
        let s = self.scenario;
        let lead = format!(
            "A standing vehicle at latitude {}° aligns itself with a sensor of {} °/h and {} µg: {} s in one position, \
             and the same with a turn of {}° after {} s. Simulated samples at {} Hz went through the library in single \
             precision, as firmware would feed it.",
            s.lat_deg,
            s.alignment.sensor.gyro_bias_deg_h,
            s.alignment.sensor.accel_bias_ug,
            s.duration_s,
            s.turned_deg(),
            s.turn_at_s,
            s.rate_hz,
        );
        let mut page = Page::new("One position or two: what the alignment can see", &lead);
        for (tone, question, answer) in self.answers() {
            page.verdict(tone, question, &answer);
        }
        let turn = format!("case 2: turned by {}° at {} s", s.turned_deg(), s.turn_at_s);
        let key = [(BLUE, "case 1: one position"), (ORANGE, turn.as_str())];
        page.section("Heading");
        page.key(&key);
        page.figures(2, &[self.heading_error(), self.heading_sigma()],
            "Left: what the heading estimate was wrong by, which only a simulation knows, inside ±3σ of the filter (thin lines). \
             Right: σ; the dashed level is what the east gyro's bias alone leaves, σ_g/(Ω cos L).");
        page.section("Where it ends");
        page.table(&self.table());
        for (title, caption, pick) in [
            ("ξ2: how much has been learnt", "Variance at the start over variance now. 1: nothing learnt; 10⁴: σ down to a hundredth. The tinted stretch is the turn.", (|m: &Moment, i: usize| m.xi2[i]) as Pick),
            ("ξ1: how fast it is being learnt", "Share of the initial variance that an update removes, per second [1/s].", |m, i| m.xi1[i]),
            ("σ: how well it is known", "Standard deviation of each state, in the unit of its title.", |m, i| m.sigma[i] / STATES[i].in_si),
        ] {
            page.section(title);
            page.key(&key);
            let with_unit = title.starts_with('σ');
            // A state that nothing was learnt of is a line at 1, not a picture of its last digits.
            let floor = title.starts_with("ξ2").then_some(0.8..10.0);
            let pictures: Vec<String> = (0..N).map(|i| self.state(i, pick, with_unit, floor.clone())).collect();
            page.figures(3, &pictures, &format!("{caption} Time in seconds."));
        }
        page.section("η: directions");
        page.figures(
            2,
            &[
                self.spectrum(0, "case 1: η2 of all directions", 0.5..1e9, |m| m.eta2),
                self.spectrum(1, "case 2: η2 of all directions", 0.5..1e9, |m| m.eta2),
                self.spectrum(0, "case 1: η1 of all directions [1/s]", 1e-8..1.0, |m| m.eta1),
                self.spectrum(1, "case 2: η1 of all directions [1/s]", 1e-8..1.0, |m| m.eta1),
            ],
            "States mix; the eigenvalues of T = P0⁻¹P and M = −P0⁻¹Ṗ do not. η2 = 1/λ(T): a line at 1 is a direction of which \
             nothing has been learnt. η1 = λ(M): negative values, where process noise wins, and values below the resolution of the sum are not drawn. Time in seconds.",
        );
        page.table(&self.directions());
        page.section("Beside Lu, Zhang and Yan 2009");
        page.text(
            "The paper's own two cases, by covariance analysis in double precision with the library's general kernel: the \
             configuration that reproduces its tables (closed loop, biases of 20 h, height damping from outside, no update \
             from 298 s to 302 s, R·0.1 s in the Riccati equation). Green: within 1 % of the printed number; grey: within 3 %; \
             amber: within 30 %; red: further off.",
        );
        page.figures(2, &self.paper.figures(), "The paper's figures: how fast (left) and how well (right) the heading is learnt around the turn. The gain is delayed: eight seconds after the turn ξ2 has not moved yet.");
        for table in self.paper.tables() {
            page.table(&table);
        }
        page.text(
            "Not reproduced, and known why: the smallest eigenvalues of M are cancellation, not physics; ξ1 of tilt, gyros and \
             level accelerometers in the far columns follows the course of an estimate that the paper does not give; the \
             printed ξ1 of gyro x in case 1 does not fit its neighbours.",
        );
        page
    }

    /// The pictures of the README: file names and SVG.
    pub(super) fn pictures(&self) -> [(&'static str, String); 2] {
        let lines = vec![
            self.line(0, |m| m.xi2[HEADING]),
            self.line(1, |m| m.xi2[HEADING]),
        ];
        let chart = self.chart("ξ2 of the heading", Scale::Logarithmic, lines);
        let xi2 = Chart {
            x_label: "time [s]".into(),
            size: (520, 260),
            ..chart
        };
        [
            ("heading_sigma.svg", self.heading_sigma()),
            ("heading_xi2.svg", xi2.svg()),
        ]
    }

    fn answers(&self) -> Vec<(Tone, &'static str, String)> {
        let [one, two] = self.cases.map(|c| &c.last);
        let heading = |m: &Moment| m.sigma[HEADING].to_degrees();
        let east = |c: &Case| self.east_gyro(c);
        let (e1, e2) = (east(self.cases[0]), east(self.cases[1]));
        let floor = self.floor_deg(one.sigma[e1]);
        let mut answers = Vec::new();
        answers.push((
            Tone::Note,
            "Is alignment finished?",
            format!(
                "In one position heading ends at ±{:.3}° (1σ), and {:.3}° of that is the bias of the gyro that points east \
                 (still ±{:.4} °/h): more waiting cannot help. After the turn it is ±{:.3}°, {}.",
                heading(one), floor, one.sigma[e1] / DEG_PER_H, heading(two), self.trend(),
            ),
        ));
        answers.push((
            Tone::Note,
            "Why does heading not converge in one position?",
            format!(
                "A heading error and an east gyro bias tilt the level in the same way. ξ2 of that bias is {} after {} s \
                 (1: nothing learnt), while the north gyro has {}.",
                digits(one.xi2[e1], 4), self.scenario.duration_s, digits(one.xi2[self.north_gyro(self.cases[0])], 3),
            ),
        ));
        let gain = heading(one) / heading(two);
        answers.push((
            if gain > 1.5 { Tone::Good } else { Tone::Note },
            "What does the turn buy?",
            format!(
                "Heading {} times better (ξ2 {} → {}), east gyro ξ2 {} → {}, level accelerometers ξ2 {} → {}.",
                digits(gain, 2), digits(one.xi2[HEADING], 3), digits(two.xi2[HEADING], 3),
                digits(one.xi2[e1], 3), digits(two.xi2[e2], 3), digits(one.xi2[BA], 3), digits(two.xi2[BA], 3),
            ),
        ));
        let ratios: Vec<f64> = [one, two]
            .iter()
            .flat_map(|m| m.error.iter().zip(&m.sigma).map(|(e, s)| (e / s).abs()))
            .filter(|r| r.is_finite())
            .collect();
        let (worst, outside) = (
            ratios.iter().copied().fold(0.0, f64::max),
            ratios.iter().filter(|r| **r > 3.0).count(),
        );
        answers.push((
            if outside == 0 { Tone::Good } else { Tone::Bad },
            "Can σ be believed here?",
            if outside == 0 {
                format!(
                    "All {} final errors lie within 3σ; the largest is {} σ.",
                    ratios.len(),
                    digits(worst, 2)
                )
            } else {
                format!(
                    "{outside} of {} final errors lie beyond 3σ; the largest is {} σ.",
                    ratios.len(),
                    digits(worst, 2)
                )
            },
        ));
        answers.push(self.paper.answer());
        answers
    }

    /// How the heading of case 2 went over the last tenth of the run.
    fn trend(&self) -> String {
        let [_, two] = self.cases;
        let since = 0.9 * self.scenario.duration_s;
        let before = two.history.snapshots().iter().find(|m| m.t >= since);
        let change = before.map_or(f64::NAN, |m| {
            1.0 - two.last.sigma[HEADING] / m.sigma[HEADING]
        });
        if change > 0.01 {
            format!(
                "and still falling: by {:.0} % in the last {:.0} s",
                100.0 * change,
                0.1 * self.scenario.duration_s
            )
        } else {
            format!(
                "and steady over the last {:.0} s",
                0.1 * self.scenario.duration_s
            )
        }
    }

    /// What a gyro bias leaves of the heading [°].
    fn floor_deg(&self, sigma: f64) -> f64 {
        let lat = self.scenario.lat_deg.to_radians();
        (sigma / (navsight::earth::OMEGA_IE * lat.cos())).to_degrees()
    }

    /// The level gyro that points east most at the end of a case.
    fn east_gyro(&self, case: &Case) -> usize {
        let (s, c) = case.solution.angles_deg[0].to_radians().sin_cos();
        if c.abs() >= s.abs() {
            BG
        } else {
            BG + 1
        }
    }

    fn north_gyro(&self, case: &Case) -> usize {
        2 * BG + 1 - self.east_gyro(case)
    }

    fn table(&self) -> Table {
        let mut table = Table::new(
            format!(
                "After {} s: actual error, σ, and what was learnt",
                self.scenario.duration_s
            ),
            [
                "state",
                "unit",
                "σ0",
                "error",
                "σ",
                "ξ1 [1/s]",
                "ξ2",
                "error",
                "σ",
                "ξ1 [1/s]",
                "ξ2",
            ],
        )
        .groups([("", 3), ("case 1: one position", 4), ("case 2: turned", 4)]);
        for (i, state) in STATES.iter().enumerate() {
            let mut cells: Vec<Cell> = vec![
                state.name.into(),
                state.unit.into(),
                digits(self.cases[0].sigma0[i] / state.in_si, 3).into(),
            ];
            for case in self.cases {
                let m = &case.last;
                let tone = if (m.error[i] / m.sigma[i]).abs() > 3.0 {
                    Tone::Bad
                } else {
                    Tone::Plain
                };
                cells.push(Cell::toned(digits(m.error[i] / state.in_si, 3), tone));
                cells.push(digits(m.sigma[i] / state.in_si, 3).into());
                cells.push(digits(m.xi1[i], 3).into());
                cells.push(short(m.xi2[i]).into());
            }
            table.row(cells);
        }
        table
    }

    fn directions(&self) -> Table {
        let mut table = Table::new(
            "Best and worst known directions at the end, in units of σ0",
            ["direction", "case", "η2"],
        );
        for (name, case) in ["1", "2"].iter().zip(self.cases) {
            let groups = groups(&case.directions);
            let shown = groups.len().min(6);
            let (best, worst) = (
                &groups[..shown / 2],
                &groups[groups.len() - (shown - shown / 2)..],
            );
            for group in best.iter().chain(worst) {
                table.row([describe(group), (*name).to_owned(), short(group[0].eta2)]);
            }
        }
        table
    }

    fn line(&self, case: usize, value: impl Fn(&Moment) -> f64) -> Series {
        Series {
            label: String::new(),
            color: COLORS[case],
            width: 2,
            points: self.cases[case].history.line(|m| (m.t, value(m))),
        }
    }

    fn chart(&self, title: impl Into<String>, scale: Scale, series: Vec<Series>) -> Chart {
        let s = self.scenario;
        Chart {
            bands: vec![Band::plain(s.turn_at_s..s.turn_at_s + s.turn_time_s)],
            ..Chart::new(title, scale, series)
        }
    }

    fn state(
        &self,
        i: usize,
        pick: Pick,
        with_unit: bool,
        y_includes: Option<Range<f64>>,
    ) -> String {
        let state = &STATES[i];
        let title = if with_unit {
            format!("{} [{}]", state.name, state.unit)
        } else {
            state.name.to_owned()
        };
        let lines = vec![self.line(0, |m| pick(m, i)), self.line(1, |m| pick(m, i))];
        Chart {
            y_includes,
            ..self.chart(title, Scale::Logarithmic, lines)
        }
        .svg()
    }

    fn heading_error(&self) -> String {
        let mut lines = Vec::new();
        for case in [0, 1] {
            for side in [3.0, -3.0] {
                lines.push(Series {
                    width: 1,
                    ..self.line(case, move |m| side * m.sigma[HEADING].to_degrees())
                });
            }
            lines.push(self.line(case, |m| m.error[HEADING].to_degrees()));
        }
        let end = self.cases[0].last.sigma[HEADING].to_degrees();
        let chart = self.chart("heading error and ±3σ [°]", Scale::Linear, lines);
        Chart {
            y_range: Some(-8.0 * end..8.0 * end),
            x_label: "time [s]".into(),
            size: (520, 260),
            ..chart
        }
        .svg()
    }

    fn heading_sigma(&self) -> String {
        let lines = vec![
            self.line(0, |m| m.sigma[HEADING].to_degrees()),
            self.line(1, |m| m.sigma[HEADING].to_degrees()),
        ];
        let chart = self.chart("σ of the heading [°]", Scale::Logarithmic, lines);
        let level = self.floor_deg(self.scenario.alignment.sensor.gyro_bias());
        Chart {
            level: Some(level),
            x_label: "time [s]".into(),
            size: (520, 260),
            ..chart
        }
        .svg()
    }

    fn spectrum(
        &self,
        case: usize,
        title: &str,
        range: Range<f64>,
        pick: fn(&Moment) -> [f64; N],
    ) -> String {
        let lines = (0..N)
            .map(|k| Series {
                width: 1,
                ..self.line(case, |m| pick(m)[k])
            })
            .collect();
        let chart = self.chart(title, Scale::Logarithmic, lines);
        Chart {
            y_range: Some(range),
            x_label: "time [s]".into(),
            size: (520, 260),
            ..chart
        }
        .svg()
    }
}

type Pick = fn(&Moment, usize) -> f64;

/// Directions that cannot be told apart stand together.
fn groups(directions: &[Along]) -> Vec<&[Along]> {
    let (mut groups, mut rest) = (Vec::new(), directions);
    while !rest.is_empty() {
        let (group, after) = rest.split_at(rest[0].dimension.clamp(1, rest.len()));
        groups.push(group);
        rest = after;
    }
    groups
}

/// A direction in words: the states that make up most of it. Of a plane or more, the states that lie in it.
fn describe(group: &[Along]) -> String {
    let share = |i: usize| match group {
        [along] => along.vector[i],
        _ => group
            .iter()
            .map(|a| a.vector[i] * a.vector[i])
            .sum::<f64>()
            .sqrt(),
    };
    let mut parts: Vec<(usize, f64)> = (0..N).map(|i| (i, share(i))).collect();
    parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let named: Vec<String> = parts
        .iter()
        .filter(|(_, x)| x.abs() >= 0.1)
        .take(5)
        .map(|(i, x)| match group {
            [_] => format!("{x:+.2} {}", STATES[*i].name),
            _ => STATES[*i].name.to_owned(),
        })
        .collect();
    match group {
        [_] => named.join("  "),
        _ => format!("any mixture of {}", named.join(", ")),
    }
}
