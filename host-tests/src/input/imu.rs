//! `imu.csv`: increments over the interval that ends at `t_s`, or rates there.

use super::{Clock, Column, Table};
use crate::lab::LabError;
use nalgebra::Vector3;
use navsight::imu::ImuIncrement;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// One sample in double precision, axes as in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// End of the interval [s].
    pub t: f64,
    /// Length of the interval [s].
    pub dt: f64,
    /// Angular increment [rad].
    pub delta_theta: [f64; 3],
    /// Velocity increment [m/s].
    pub delta_v: [f64; 3],
    /// Line in the file, for messages about this sample.
    pub line: usize,
}

impl ImuSample {
    /// As the library takes it.
    pub fn increment(&self) -> ImuIncrement {
        let narrow = |v: [f64; 3]| Vector3::from(v.map(|x| x as f32));
        ImuIncrement {
            delta_theta_b: narrow(self.delta_theta),
            delta_v_b: narrow(self.delta_v),
            dt: self.dt as f32,
        }
    }
}

/// Reads samples one by one.
///
/// The length of an interval is the distance to the sample before it; the first sample has none and takes the length
/// of the second. Rates are multiplied by the length.
pub struct ImuReader<R> {
    table: Table<R>,
    time: Column,
    angular: [Column; 3],
    linear: [Column; 3],
    rates: bool,
    clock: Clock,
    /// The second sample, read together with the first.
    second: Option<ImuSample>,
    started: bool,
}

impl ImuReader<BufReader<File>> {
    /// Opens a file and reads its header.
    pub fn open(path: &Path) -> Result<Self, LabError> {
        Self::new(Table::open(path)?)
    }
}

impl<R: BufRead> ImuReader<R> {
    /// Finds the columns.
    pub fn new(table: Table<R>) -> Result<Self, LabError> {
        let time = table.require("t_s")?;
        let rates = table.find("dtheta_x").is_none() && table.find("gyro_x").is_some();
        let (angular, linear) = if rates {
            (["gyro_x", "gyro_y", "gyro_z"], ["acc_x", "acc_y", "acc_z"])
        } else {
            (
                ["dtheta_x", "dtheta_y", "dtheta_z"],
                ["dvel_x", "dvel_y", "dvel_z"],
            )
        };
        let (angular, linear) = (table.require_all(angular)?, table.require_all(linear)?);
        Ok(Self {
            table,
            time,
            angular,
            linear,
            rates,
            clock: Clock::default(),
            second: None,
            started: false,
        })
    }

    /// File name for messages.
    pub fn file(&self) -> &Path {
        self.table.file()
    }

    /// Bytes read so far, for a progress bar.
    pub fn bytes(&self) -> u64 {
        self.table.bytes()
    }

    fn row(&mut self) -> Result<Option<ImuSample>, LabError> {
        if !self.table.next_row()? {
            return Ok(None);
        }
        let before = self.clock.last;
        let t = self.clock.tick(&self.table, self.time)?;
        let sample = ImuSample {
            t,
            dt: before.map_or(0.0, |before| t - before),
            delta_theta: self.table.numbers(self.angular)?,
            delta_v: self.table.numbers(self.linear)?,
            line: self.table.line(),
        };
        Ok(Some(sample))
    }

    fn finish(&self, mut sample: ImuSample) -> ImuSample {
        if self.rates {
            for v in sample.delta_theta.iter_mut().chain(&mut sample.delta_v) {
                *v *= sample.dt;
            }
        }
        sample
    }

    fn advance(&mut self) -> Result<Option<ImuSample>, LabError> {
        if self.started {
            let next = match self.second.take() {
                Some(second) => Some(second),
                None => self.row()?,
            };
            return Ok(next.map(|s| self.finish(s)));
        }
        self.started = true;
        let (Some(mut first), Some(second)) = (self.row()?, self.row()?) else {
            return Err(self
                .table
                .refused(self.time, "the file is over before the second sample"));
        };
        first.dt = second.dt;
        self.second = Some(second);
        Ok(Some(self.finish(first)))
    }
}

impl<R: BufRead> Iterator for ImuReader<R> {
    type Item = Result<ImuSample, LabError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.advance().transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<ImuSample>, LabError> {
        ImuReader::new(Table::new(Path::new("imu.csv"), text.as_bytes())?)?.collect()
    }

    #[test]
    fn rates_become_increments() {
        let increments = "t_s,dtheta_x,dtheta_y,dtheta_z,dvel_x,dvel_y,dvel_z\n\
                          0.5,1,2,3,4,5,6\n1.0,1,2,3,4,5,6\n1.25,1,2,3,4,5,6\n";
        let rates = "acc_z,acc_y,acc_x,gyro_z,gyro_y,gyro_x,temperature,t_s\n\
                     12,10,8,6,4,2,warm,0.5\n12,10,8,6,4,2,warm,1.0\n24,20,16,12,8,4,warm,1.25\n";
        let (a, b) = (read(increments).unwrap(), read(rates).unwrap());
        assert_eq!(a, b);
        assert_eq!(a.iter().map(|s| s.dt).collect::<Vec<_>>(), [0.5, 0.5, 0.25]);
    }

    #[test]
    fn half_a_set_of_columns_is_refused_by_name() {
        let refused = read("t_s,gyro_x,gyro_y,gyro_z,acc_x,acc_z\n").unwrap_err();
        assert_eq!(
            refused.to_string(),
            "imu.csv:1: acc_y: the header has no such column"
        );
        let refused = read("t_s,a,b\n").unwrap_err();
        assert_eq!(refused.field.as_deref(), Some("dtheta_x"));
    }
}
