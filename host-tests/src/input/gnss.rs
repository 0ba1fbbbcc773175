//! `gnss.csv`: position and, where known, velocity and what the receiver says of its accuracy.

use super::{Clock, Table};
use crate::lab::LabError;
use std::path::Path;

/// One fix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Time [s], the clock of `imu.csv`.
    pub t: f64,
    /// Latitude [°].
    pub lat_deg: f64,
    /// Longitude [°].
    pub lon_deg: f64,
    /// Ellipsoidal height [m].
    pub height: f64,
    /// Velocity east, north, up [m/s].
    pub v_n: Option<[f64; 3]>,
    /// What the receiver says of it, 1σ: horizontal, vertical [m], velocity [m/s].
    pub accuracy: [Option<f64>; 3],
    /// Line in the file.
    pub line: usize,
}

/// Reads a whole file (some hertz of fixes, not of samples).
pub fn read(path: &Path) -> Result<Vec<Fix>, LabError> {
    let mut table = Table::open(path)?;
    let time = table.require("t_s")?;
    let [lat, lon, height] = table.require_all(["lat_deg", "lon_deg", "height_m"])?;
    let velocity = match table
        .find("v_e")
        .or(table.find("v_n"))
        .or(table.find("v_u"))
    {
        Some(_) => Some(table.require_all(["v_e", "v_n", "v_u"])?),
        None => None,
    };
    let accuracy = ["h_acc_m", "v_acc_m", "s_acc_m_s"].map(|name| table.find(name));
    let (mut clock, mut fixes) = (Clock::default(), Vec::new());
    while table.next_row()? {
        let mut said = [None; 3];
        for (said, column) in said.iter_mut().zip(accuracy) {
            let Some(column) = column else { continue };
            let sigma = table.number(column)?;
            if sigma <= 0.0 {
                return Err(table.refused(column, &format!("{sigma} is no standard deviation")));
            }
            *said = Some(sigma);
        }
        let fix = Fix {
            t: clock.tick(&table, time)?,
            lat_deg: table.number(lat)?,
            lon_deg: table.number(lon)?,
            height: table.number(height)?,
            v_n: velocity.map(|columns| table.numbers(columns)).transpose()?,
            accuracy: said,
            line: table.line(),
        };
        if fix.lat_deg.abs() > 90.0 {
            return Err(table.refused(lat, &format!("{} is no latitude in degrees", fix.lat_deg)));
        }
        if fix.lon_deg.abs() > 360.0 {
            return Err(table.refused(lon, &format!("{} is no longitude in degrees", fix.lon_deg)));
        }
        fixes.push(fix);
    }
    if fixes.is_empty() {
        return Err(table.refused(time, "there is no fix after the header"));
    }
    Ok(fixes)
}
