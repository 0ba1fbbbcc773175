//! `ref.csv`: the attitude that somebody else measured or estimated.

use super::{Clock, Table};
use crate::lab::LabError;
use std::path::Path;

/// Attitude at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// Time [s], the clock of `imu.csv`.
    pub t: f64,
    /// Body to local frame (z up), scalar first, unit length.
    pub q: [f64; 4],
}

/// Reads the instants at which the reference is there.
pub fn read(path: &Path) -> Result<Vec<Attitude>, LabError> {
    let mut table = Table::open(path)?;
    let time = table.require("t_s")?;
    let columns = table.require_all(["qw", "qx", "qy", "qz"])?;
    let (mut clock, mut attitudes) = (Clock::default(), Vec::new());
    while table.next_row()? {
        let t = clock.tick(&table, time)?;
        let mut q = [0.0; 4];
        for (value, column) in q.iter_mut().zip(columns) {
            *value = table.number_or_nan(column)?;
        }
        if q.iter().any(|v| v.is_nan()) {
            continue; // no reference here, and the file says so
        }
        let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        if (norm - 1.0).abs() > 1e-2 {
            return Err(table.refused(
                columns[0],
                &format!("the quaternion has length {norm}, not 1"),
            ));
        }
        attitudes.push(Attitude {
            t,
            q: q.map(|v| v / norm),
        });
    }
    if attitudes.is_empty() {
        return Err(table.refused(time, "there is no attitude in this file"));
    }
    Ok(attitudes)
}
