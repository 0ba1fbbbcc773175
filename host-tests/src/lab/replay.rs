//! `lab replay`: the filter on recorded data.

use std::path::PathBuf;

use super::LabError;
use crate::input::{gnss, reference, rest, Axes, ImuReader};

/// Flags of the command.
#[derive(clap::Args)]
pub struct Args {
    /// Inertial samples: t_s, dtheta_x,y,z [rad], dvel_x,y,z [m/s], or gyro_x,y,z [rad/s], acc_x,y,z [m/s²]
    #[arg(long, value_name = "FILE")]
    imu: PathBuf,
    /// Satellite fixes: t_s, lat_deg, lon_deg, height_m, and v_e, v_n, v_u [m/s] where known
    #[arg(long, value_name = "FILE")]
    gnss: Option<PathBuf>,
    /// Somebody else's attitude to compare with: t_s, qw, qx, qy, qz (body to local, z up)
    #[arg(long = "ref", value_name = "FILE")]
    reference: Option<PathBuf>,
    /// When the sensor stood still: t_s, at_rest (0 or 1); without it, always
    #[arg(long, value_name = "FILE")]
    rest: Option<PathBuf>,
    /// Sensor axes that point right, forward, up, as in y,x,-z
    #[arg(
        long,
        value_name = "X,Y,Z",
        default_value = "x,y,z",
        allow_hyphen_values = true
    )]
    axes: Axes,
    /// One JSON object on standard output instead of tables
    #[arg(long)]
    json: bool,
}

/// Reads, runs, prints.
pub fn run(args: &Args) -> Result<(), LabError> {
    let _fixes = args.gnss.as_deref().map(gnss::read).transpose()?;
    let _attitudes = args.reference.as_deref().map(reference::read).transpose()?;
    let _flags = args.rest.as_deref().map(rest::read).transpose()?;
    let _ = (args.axes, args.json);
    for sample in ImuReader::open(&args.imu)? {
        sample?;
    }
    Err(LabError::plain("the replay is not built yet"))
}
