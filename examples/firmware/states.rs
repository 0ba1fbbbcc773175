//! Bytes of every state that a program keeps, and of what it is handed, for the table of RAM.

use core::mem::size_of;

use navsight::alignment::carry::BiasBlock;
use navsight::alignment::coarse::CoarseAlignment;
use navsight::alignment::gate;
use navsight::alignment::in_motion::InMotion;
use navsight::alignment::levelling::Levelling;
use navsight::alignment::planner::Planner;
use navsight::alignment::standing::StandingAlignment;
use navsight::alignment::stationary::StationaryDetector;
use navsight::alignment::supervisor::Supervisor;
use navsight::covariance::Covariance15;
use navsight::error_model::{N, VEL};
use navsight::filter::{Filter, LateFilter, Settings, Source, UpdateReport};
use navsight::imu::{ConingSculling, ImuIncrement};
use navsight::measurement::{AntennaRows, Direct, Linearized};
use navsight::mechanization::Strapdown;
use navsight::nav::NavState;
use navsight::observability::ceiling::{Gramian, Unseen};
use navsight::observability::diagonal::Xi;
use navsight::observability::eigen_degree::EigenDegree;
use navsight::observability::extreme::Extremes15;
use navsight::observability::pwcs::Staged;
use navsight::observability::riccati::DecreaseRate15;
use navsight::observability::spectrum::{Directions, Spectrum15, ValuesOnly};
use navsight::observability::structural::{self, Groups, Linking, Matchings, Pattern, Segments};
use navsight::observability::verdict::Verdicts;
use navsight::tracking::{AxisTracker, LocalTracker};

use crate::rows::Table;

/// A line for each.
pub fn list(table: &mut Table) -> core::fmt::Result {
    macro_rules! ram {
        ($($state:ty),* $(,)?) => {
            $(writeln!(table.0, "ram\t{}\t{}", stringify!($state), size_of::<$state>())?;)*
        };
    }
    ram!(
        NavState,
        Strapdown,
        ConingSculling,
        Covariance15<f32>,
        Covariance15<f64>,
        Settings,
        Filter,
        LateFilter<64>,
        Source,
        ImuIncrement,
        Linearized<1>,
        Linearized<3>,
        Linearized<3, Direct<VEL>>,
        Linearized<6, AntennaRows>,
        UpdateReport<1>,
        UpdateReport<3>,
        UpdateReport<6>,
        Xi<f32, N>,
        Extremes15<f32>,
        Spectrum15<f32, ValuesOnly>,
        Spectrum15<f32, Directions<f32, N>>,
        DecreaseRate15<f32>,
        Pattern<N>,
        structural::Report,
        Groups<N>,
        Linking<N, N>,
        Segments<N>,
        Matchings<N>,
        Staged<f32, N, 6>,
        EigenDegree<f32, N, 6>,
        Gramian<f32, N>,
        Unseen<f32, N>,
        Verdicts,
        Supervisor,
        Planner<6>,
        gate::Gate,
        StationaryDetector,
        CoarseAlignment,
        Levelling,
        InMotion<16>,
        StandingAlignment<64>,
        BiasBlock,
        AxisTracker<f32>,
        LocalTracker<f32>,
    );
    Ok(())
}
