//! Sums over seeds: errors, the filter's own variances, and normalised errors. Parts of a run add up to the whole.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use navsight::error_model::{ATT, BA, BG, N};
use navsight::filter::Filter;
use serde::{Deserialize, Serialize};

use super::Variant;

/// Groups whose normalised errors are added up, and their degrees of freedom.
pub const GROUPS: [(&str, f64); 3] = [
    ("heading", 1.0),
    ("gyro bias", 3.0),
    ("accelerometer bias", 3.0),
];

/// What one variant came to at one time of one position, summed over seeds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cell {
    /// Runs.
    pub runs: u64,
    /// Σ heading error, counter-clockwise as in the papers: estimate minus truth of the yaw [rad].
    pub heading: f64,
    /// Its squares, rad².
    pub heading2: f64,
    /// The filter's own variance of it, rad².
    pub variance: f64,
    /// Squares of the gyro bias errors [rad²/s²].
    pub gyro2: [f64; 3],
    /// Squares of the accelerometer bias errors [m²/s⁴].
    pub accel2: [f64; 3],
    /// The filter's own variances of them [m²/s⁴].
    pub accel_variance: [f64; 3],
    /// Σ eᵀP⁻¹e of [`GROUPS`].
    pub nees: [f64; 3],
    /// How many errors of [`GROUPS`], component by component, lie within 1σ and 3σ.
    pub inside: [[u64; 2]; 3],
    /// Σ normalised innovation squared of the updates in this position so far.
    pub nis: f64,
    /// Rows of these updates.
    pub rows: u64,
}

impl Cell {
    fn mean(&self, sum: f64) -> f64 {
        sum / self.runs as f64
    }

    /// Mean heading error [°].
    pub fn heading_mean_deg(&self) -> f64 {
        self.mean(self.heading).to_degrees()
    }

    /// Root mean square heading error [°].
    pub fn heading_rms_deg(&self) -> f64 {
        self.mean(self.heading2).sqrt().to_degrees()
    }

    /// What the filter believes it to be, 1σ [°].
    pub fn heading_sigma_deg(&self) -> f64 {
        self.mean(self.variance).sqrt().to_degrees()
    }

    /// Root mean square error of both level accelerometer biases [µg].
    pub fn level_accel_rms_ug(&self) -> f64 {
        (self.mean(self.accel2[0] + self.accel2[1]) / 2.0).sqrt() / 9.806_65e-6
    }

    /// What the filter believes it to be, 1σ [µg].
    pub fn level_accel_sigma_ug(&self) -> f64 {
        let sum = self.accel_variance[0] + self.accel_variance[1];
        (self.mean(sum) / 2.0).sqrt() / 9.806_65e-6
    }

    /// Root mean square error of both level gyro biases [°/h].
    pub fn level_gyro_rms_deg_h(&self) -> f64 {
        (self.mean(self.gyro2[0] + self.gyro2[1]) / 2.0)
            .sqrt()
            .to_degrees()
            * 3600.0
    }

    /// Normalised innovation squared per row: 1 for a filter that knows its errors.
    pub fn nis_per_row(&self) -> f64 {
        self.nis / self.rows as f64
    }

    /// Part of the errors of a group within 1σ and 3σ: 0.683 and 0.9973 of a normal error.
    pub fn coverage(&self, group: usize) -> [f64; 2] {
        let all = self.runs as f64 * GROUPS[group].1;
        self.inside[group].map(|n| n as f64 / all)
    }

    /// Average normalised error squared per degree of freedom of a group: 1 for a filter that knows its errors.
    pub fn anees(&self, group: usize) -> f64 {
        self.mean(self.nees[group]) / GROUPS[group].1
    }

    /// χ² band of [`Cell::anees`] at ± `z` normal deviates.
    pub fn band(&self, group: usize, z: f64) -> (f64, f64) {
        band(GROUPS[group].1 * self.runs as f64, z)
    }
}

/// χ²/n of `n` degrees of freedom at ± `z` normal deviates (Wilson–Hilferty, better than 1 % for n ≥ 30).
pub fn band(n: f64, z: f64) -> (f64, f64) {
    let a = 2.0 / (9.0 * n);
    let at = |z: f64| (1.0 - a + z * a.sqrt()).powi(3);
    (at(-z), at(z))
}

/// Normalised innovations of one run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Innovations {
    /// Their sum.
    pub sum: f64,
    /// Rows in it.
    pub rows: u64,
}

/// A variant, the position from 0, and the second into it.
pub type Place = (Variant, usize, u32);

/// All sums of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    /// Seeds done.
    pub seeds: u64,
    /// By variant, position and second.
    pub cells: BTreeMap<Place, Cell>,
}

impl Tally {
    /// Adds the errors of one filter.
    pub fn add(
        &mut self,
        variant: Variant,
        position: usize,
        second: f64,
        filter: &Filter,
        error: &[f64; N],
        innovations: Innovations,
    ) {
        let p = filter.covariance().to_matrix().cast::<f64>();
        let unit = filter.sigma0().map(f64::from);
        let three = |first: usize| {
            let e = Vector3::from_fn(|i, _| error[first + i] / unit[first + i]);
            let block = Matrix3::from_fn(|i, j| p[(first + i, first + j)]);
            block.cholesky().map_or(f64::NAN, |c| e.dot(&c.solve(&e)))
        };
        let heading = ATT + 2;
        let variance = p[(heading, heading)] * unit[heading] * unit[heading];
        let square = |first: usize| [0, 1, 2].map(|i| error[first + i] * error[first + i]);
        let inside = |first: usize, count: usize| {
            [1.0, 3.0].map(|times: f64| {
                let within = |i: &usize| {
                    let sigma2 = p[(*i, *i)] * unit[*i] * unit[*i];
                    error[*i] * error[*i] <= times * times * sigma2
                };
                (first..first + count).filter(within).count() as u64
            })
        };
        let cell = Cell {
            runs: 1,
            heading: -error[heading],
            heading2: error[heading] * error[heading],
            variance,
            gyro2: square(BG),
            accel2: square(BA),
            accel_variance: [BA, BA + 1, BA + 2].map(|i| p[(i, i)] * unit[i] * unit[i]),
            nees: [error[heading].powi(2) / variance, three(BG), three(BA)],
            inside: [inside(heading, 1), inside(BG, 3), inside(BA, 3)],
            nis: innovations.sum,
            rows: innovations.rows,
        };
        self.cell((variant, position, second.round() as u32), &cell);
    }

    /// Adds another part of the same run.
    pub fn merge(&mut self, other: &Self) {
        self.seeds += other.seeds;
        for (place, cell) in &other.cells {
            self.cell(*place, cell);
        }
    }

    fn cell(&mut self, place: Place, more: &Cell) {
        let to = self.cells.entry(place).or_default();
        to.runs += more.runs;
        to.heading += more.heading;
        to.heading2 += more.heading2;
        to.variance += more.variance;
        to.nis += more.nis;
        to.rows += more.rows;
        for (to, more) in to
            .inside
            .iter_mut()
            .flatten()
            .zip(more.inside.iter().flatten())
        {
            *to += more;
        }
        let pairs = [
            (&mut to.gyro2, &more.gyro2),
            (&mut to.accel2, &more.accel2),
            (&mut to.accel_variance, &more.accel_variance),
            (&mut to.nees, &more.nees),
        ];
        for (to, more) in pairs {
            for (to, more) in to.iter_mut().zip(more) {
                *to += more;
            }
        }
    }

    /// The last cell of a variant: the end of its last position.
    pub fn end(&self, variant: Variant) -> Option<&Cell> {
        self.cells
            .range((variant, 0, 0)..=(variant, usize::MAX, u32::MAX))
            .next_back()
            .map(|(_, cell)| cell)
    }
}
