//! Lu 2009 beside us: the covariance analysis of the paper's two cases, its tables and its two figures.

use navsight::error_model::N;
use serde_json::{json, Value};

use super::super::LabError;
use crate::covariance_analysis::{self, Instant};
use crate::paper::lu2009;
use crate::report::{digits, Band, Cell, Chart, Scale, Series, Table, Tone};

/// Step of the paper's filter [s], and how long it runs.
pub(super) const STEPS: u64 = 600;
const HEADING: usize = 8;
const COLORS: [&str; 2] = ["#2563eb", "#ea580c"];
/// A cell of ξ2 or of T counts as reproduced within this, the paper's own scatter of printed digits and of the
/// quantities that had to be inferred.
const CLOSE: f64 = 0.01;
const NEAR: f64 = 0.03;

/// Both cases, one instant per step.
pub(super) struct Paper {
    cases: [Vec<Instant>; 2],
}

impl Paper {
    /// Runs both cases in double precision with the library's general kernel.
    pub(super) fn run(tick: impl Fn()) -> Result<Self, LabError> {
        let config = lu2009::config();
        let times: Vec<f64> = (1..=STEPS).map(|k| k as f64).collect();
        let case = |case| {
            covariance_analysis::run::<f64>(&config, case, &times, &tick).map_err(|(t, error)| {
                LabError::plain(format!(
                    "the covariance analysis stopped at {t} s: {error:?}"
                ))
            })
        };
        Ok(Self {
            cases: [case(1)?, case(2)?],
        })
    }

    fn at(&self, case: usize, t: f64) -> Option<&Instant> {
        self.cases[case].iter().find(|i| i.t == t)
    }

    /// Ours at 303 s.
    fn indices(&self, case: usize, pick: fn(&Instant) -> &[Option<f64>; N]) -> [f64; N] {
        self.at(case, 303.0)
            .map_or([f64::NAN; N], |i| pick(i).map(|x| x.unwrap_or(f64::NAN)))
    }

    /// Ours at the end, descending.
    fn eigenvalues(
        &self,
        case: usize,
        pick: fn(&Instant) -> &Option<covariance_analysis::Eigen>,
    ) -> Vec<f64> {
        let end = self.cases[case].last();
        let eigen = end.and_then(|i| pick(i).as_ref());
        eigen.map_or(vec![f64::NAN; N], |e| {
            e.values.iter().rev().copied().collect()
        })
    }

    /// Table 5: ξ1 and ξ2 of every state at 303 s, printed and ours.
    fn table5(&self) -> Table {
        let mut table = Table::new(
            "Table 5: ξ1 [1/s] and ξ2 at 303 s",
            [
                "state", "paper", "ours", "paper", "ours", "paper", "ours", "paper", "ours",
            ],
        )
        .groups([
            ("", 1),
            ("ξ1, case 1", 2),
            ("ξ1, case 2", 2),
            ("ξ2, case 1", 2),
            ("ξ2, case 2", 2),
        ]);
        let xi1 = [0, 1].map(|c| self.indices(c, |i| &i.xi1_paper));
        let xi2 = [0, 1].map(|c| self.indices(c, |i| &i.xi2));
        for (i, name) in lu2009::STATES.iter().enumerate() {
            let mut cells: Vec<Cell> = vec![(*name).into()];
            for (printed, ours) in [(&lu2009::XI1, &xi1), (&lu2009::XI2, &xi2)] {
                for case in 0..2 {
                    cells.extend(pair(printed[case][i], ours[case][i]));
                }
            }
            table.row(cells);
        }
        table
    }

    /// Tables 3 and 4: eigenvalues at the end, printed and ours, both in descending order.
    fn table_of_eigenvalues(
        &self,
        caption: &str,
        printed: &[[f64; N]; 2],
        pick: fn(&Instant) -> &Option<covariance_analysis::Eigen>,
    ) -> Table {
        let mut table = Table::new(caption, ["", "paper", "ours", "paper", "ours"]).groups([
            ("", 1),
            ("case 1", 2),
            ("case 2", 2),
        ]);
        let printed = printed.map(descending);
        let ours = [0, 1].map(|case| self.eigenvalues(case, pick));
        for k in 0..N {
            let mut cells: Vec<Cell> = vec![format!("λ{}", k + 1).into()];
            for case in 0..2 {
                cells.extend(pair(printed[case][k], ours[case][k]));
            }
            table.row(cells);
        }
        table
    }

    /// Tables 5, 3 and 4.
    pub(super) fn tables(&self) -> [Table; 3] {
        [
            self.table5(),
            self.table_of_eigenvalues(
                "Table 3: eigenvalues of M = −P0⁻¹Ṗ at 600 s [1/s], in order of size",
                &lu2009::M,
                |i| &i.speed_paper,
            ),
            self.table_of_eigenvalues(
                "Table 4: eigenvalues of T = P0⁻¹P at 600 s, in order of size",
                &lu2009::T,
                |i| &i.accuracy,
            ),
        ]
    }

    /// Relative differences of the 60 cells that the paper allows to compare: ξ2 of Table 5 and Table 4.
    fn cells(&self) -> Vec<f64> {
        let mut cells = Vec::new();
        for case in 0..2 {
            let xi2 = self.indices(case, |i| &i.xi2);
            cells.extend(lu2009::XI2[case].iter().zip(xi2).map(|(p, o)| off(*p, o)));
            let t = self.eigenvalues(case, |i| &i.accuracy);
            cells.extend(
                descending(lu2009::T[case])
                    .iter()
                    .zip(t)
                    .map(|(p, o)| off(*p, o)),
            );
        }
        cells
    }

    /// Whether the tables are reproduced, in a sentence.
    pub(super) fn answer(&self) -> (Tone, &'static str, String) {
        let cells = self.cells();
        let within = |limit: f64| cells.iter().filter(|d| **d <= limit).count();
        let worst = cells.iter().copied().fold(0.0, f64::max);
        let (close, near) = (within(CLOSE), within(NEAR));
        (
            if near == cells.len() && close >= 45 { Tone::Good } else { Tone::Bad },
            "Does the analysis reproduce Lu 2009?",
            format!(
                "Of the {} cells of Table 5 ξ2 and Table 4, {close} are within 1 % of the printed number and {near} within 3 %; the worst is off by {:.1} %.",
                cells.len(), 100.0 * worst
            ),
        )
    }

    fn figure(&self, title: &str, scale: Scale, value: impl Fn(&Instant) -> Option<f64>) -> String {
        let series = [0, 1]
            .map(|case| Series {
                label: format!("case {}", case + 1),
                color: COLORS[case],
                width: 2,
                points: self.cases[case]
                    .iter()
                    .filter(|i| (300.0..=550.0).contains(&i.t))
                    .map(|i| (i.t, value(i).unwrap_or(f64::NAN)))
                    .collect(),
            })
            .into();
        let chart = Chart::new(title, scale, series);
        Chart {
            bands: vec![Band::plain(300.0..302.0)],
            x_label: "time [s]".into(),
            size: (520, 280),
            ..chart
        }
        .svg()
    }

    /// Figs 1 and 2: ξ1 and ξ2 of the heading from 300 s to 550 s.
    pub(super) fn figures(&self) -> [String; 2] {
        [
            // The paper has a ξ1 only where a measurement arrived.
            self.figure("Fig. 1: ξ1 of the heading [1/s]", Scale::Linear, |i| {
                let measured = i.xi1_meas.iter().flatten().any(|x| *x > 0.0);
                i.xi1_paper[HEADING].filter(|_| measured)
            }),
            self.figure("Fig. 2: ξ2 of the heading", Scale::Linear, |i| {
                i.xi2[HEADING]
            }),
        ]
    }

    /// The numbers for JSON.
    pub(super) fn json(&self) -> Value {
        let case = |case: usize| {
            json!({
                "xi1_303": self.indices(case, |i| &i.xi1_paper),
                "xi2_303": self.indices(case, |i| &i.xi2),
                "eig_m_600": self.eigenvalues(case, |i| &i.speed_paper),
                "eig_t_600": self.eigenvalues(case, |i| &i.accuracy),
            })
        };
        let cells = self.cells();
        json!({
            "case1": case(0),
            "case2": case(1),
            "cells": cells.len(),
            "cells_within_1_percent": cells.iter().filter(|d| **d <= CLOSE).count(),
            "cells_within_3_percent": cells.iter().filter(|d| **d <= NEAR).count(),
            "worst_cell": cells.iter().copied().fold(0.0, f64::max),
        })
    }
}

fn descending(mut values: [f64; N]) -> [f64; N] {
    values.sort_by(|a, b| b.total_cmp(a));
    values
}

/// Relative difference.
fn off(printed: f64, ours: f64) -> f64 {
    (ours / printed - 1.0).abs()
}

/// The printed cell and ours, coloured by how far it is off.
fn pair(printed: f64, ours: f64) -> [Cell; 2] {
    let tone = match off(printed, ours) {
        d if d <= CLOSE => Tone::Good,
        d if d <= NEAR => Tone::Plain,
        d if d <= 0.3 => Tone::Note,
        _ => Tone::Bad,
    };
    [
        digits(printed, 5).into(),
        Cell::toned(digits(ours, 5), tone),
    ]
}
