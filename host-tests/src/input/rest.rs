//! `rest.csv`: when the recorder says that the sensor stood still.

use super::{Clock, Table};
use crate::lab::LabError;
use std::path::Path;

/// From `t` on, until the next line, the sensor stood still or not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flag {
    /// Time [s], the clock of `imu.csv`.
    pub t: f64,
    /// It stood still.
    pub at_rest: bool,
}

/// Reads a whole file, keeping only the changes.
pub fn read(path: &Path) -> Result<Vec<Flag>, LabError> {
    let mut table = Table::open(path)?;
    let [time, at_rest] = table.require_all(["t_s", "at_rest"])?;
    let (mut clock, mut flags) = (Clock::default(), Vec::<Flag>::new());
    while table.next_row()? {
        let t = clock.tick(&table, time)?;
        let value = table.number(at_rest)?;
        if value != 0.0 && value != 1.0 {
            return Err(table.refused(at_rest, &format!("{value} is neither 0 nor 1")));
        }
        let flag = Flag {
            t,
            at_rest: value == 1.0,
        };
        if flags.last().is_none_or(|last| last.at_rest != flag.at_rest) {
            flags.push(flag);
        }
    }
    if flags.is_empty() {
        return Err(table.refused(time, "there is no flag after the header"));
    }
    Ok(flags)
}

/// Whether the sensor stood still at `t`: `false` before the first flag.
pub fn at(flags: &[Flag], t: f64) -> bool {
    let after = flags.partition_point(|f| f.t <= t);
    after
        .checked_sub(1)
        .and_then(|i| flags.get(i))
        .is_some_and(|f| f.at_rest)
}
