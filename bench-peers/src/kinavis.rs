//! kinavis-ins.

use core::time::Duration;

use kinavis_ins::{ImuNoise, ImuSample, InsFilter, InsPriors, Quaternion, Strapdown};
use kinavis_kernel::{
    Angle, Distance, GatingPolicy, GeodeticPoint, Height, Instant, Ned, Position, Speed,
    TrueCourse, Utc, Vector3,
};

use crate::scenario::{frd, Peer, Sample, *};

pub struct Kinavis(InsFilter);

impl Peer for Kinavis {
    const NAME: &'static str = "kinavis-ins 0.3.0";
    const SCALAR: &'static str = "f64";
    const ALGEBRA_ONLY: bool = false;

    fn start() -> Option<Self> {
        let here = GeodeticPoint::new(
            Position::from_degrees(LAT_DEG, LON_DEG).ok()?,
            Height::above_ellipsoid(Distance::from_metres(HEIGHT_M).ok()?),
        );
        let attitude = Quaternion::from_euler(
            Angle::from_degrees(ROLL_DEG).ok()?,
            Angle::from_degrees(PITCH_DEG + PITCH_ERROR_DEG).ok()?,
            TrueCourse::new(HEADING_DEG + HEADING_ERROR_DEG).ok()?,
        );
        let still = Vector3::<Ned, Speed>::new(Speed::ZERO, Speed::ZERO, Speed::ZERO);
        let start = Instant::<Utc>::from_unix_seconds(1_789_000_000);
        let [angle, velocity, gyro, accel] = WALKS;
        let priors = InsPriors::new(
            Distance::from_metres(PRIOR_POSITION).ok()?,
            Distance::from_metres(PRIOR_POSITION).ok()?,
            Speed::from_metres_per_second(PRIOR_VELOCITY).ok()?,
            Angle::from_degrees(PRIOR_TILT / RAD).ok()?,
            Angle::from_degrees(PRIOR_HEADING / RAD).ok()?,
            PRIOR_GYRO,
            PRIOR_ACCEL,
        )
        .ok()?;
        Some(Self(InsFilter::new(
            Strapdown::new(start, here, still, attitude).ok()?,
            ImuNoise::new(angle, velocity, gyro, accel).ok()?,
            &priors,
        )))
    }

    fn predict(&mut self, sample: &Sample) -> bool {
        let imu = ImuSample::new(frd(sample.omega), frd(sample.f), Duration::from_millis(10));
        imu.is_ok_and(|imu| self.0.predict(&imu).is_ok())
    }

    fn update(&mut self, _: u32) -> bool {
        Speed::from_metres_per_second(SIGMA_VELOCITY).is_ok_and(|sigma| {
            self.0
                .update_zero_velocity(sigma, GatingPolicy::none())
                .is_ok()
        })
    }

    fn velocity_variance(&self) -> f64 {
        let sigma = self.0.velocity_sigma().metres_per_second();
        sigma * sigma
    }

    fn attitude_deg(&self) -> Option<[f64; 3]> {
        let a = self.0.attitude();
        Some([a.yaw.degrees(), a.pitch.degrees(), a.roll.degrees()])
    }
}
