//! fusion-nav: its defaults, with our noise and gate, without its bank of heading filters.

use fusion_nav::prelude::*;
use fusion_nav::Quaternion;

use crate::scenario::{frd, time, Peer, Sample, *};

pub struct Fusion(Eskf);

impl Peer for Fusion {
    const NAME: &'static str = "fusion-nav 0.1.0";
    const SCALAR: &'static str = "f32";
    const ALGEBRA_ONLY: bool = false;

    fn start() -> Option<Self> {
        let [angle, velocity, gyro, accel] = WALKS.map(|x| x as f32);
        let mut config = Config::default();
        config.imu.gyro_white = angle;
        config.imu.accel_white = velocity;
        config.imu.gyro_bias_walk = gyro;
        config.imu.accel_bias_walk = accel;
        config.gravity = gravity() as f32;
        config.yaw_estimator = false;
        let mut filter = Eskf::new(config).ok()?;
        // half angles of the 3-2-1 sequence, forward-right-down to north-east-down
        let half = |deg: f64| (libm::sin(0.5 * deg * RAD), libm::cos(0.5 * deg * RAD));
        let (sy, cy) = half(HEADING_DEG + HEADING_ERROR_DEG);
        let (sp, cp) = half(PITCH_DEG + PITCH_ERROR_DEG);
        let (sr, cr) = half(ROLL_DEG);
        let q = Quaternion {
            w: (cr * cp * cy + sr * sp * sy) as f32,
            x: (sr * cp * cy - cr * sp * sy) as f32,
            y: (cr * sp * cy + sr * cp * sy) as f32,
            z: (cr * cp * sy - sr * sp * cy) as f32,
        };
        let state = State {
            attitude: Attitude::from_body_to_ned(q),
            ..State::default()
        };
        let mut sigma = [0.0; 15];
        sigma[..3].fill(PRIOR_POSITION as f32);
        sigma[3..6].fill(PRIOR_VELOCITY as f32);
        sigma[6..8].fill(PRIOR_TILT as f32);
        sigma[8] = PRIOR_HEADING as f32;
        sigma[9..12].fill(PRIOR_ACCEL as f32);
        sigma[12..].fill(PRIOR_GYRO as f32);
        let _ = filter
            .initialize_from(state, Covariance::from_sigmas(sigma), at(0))
            .ok()?;
        Some(Self(filter))
    }

    fn predict(&mut self, sample: &Sample) -> bool {
        let (w, f) = (frd(sample.omega), frd(sample.f));
        let imu = ImuSample::from_rates(
            at(sample.k + 1),
            AngularRate::body(w[0] as f32, w[1] as f32, w[2] as f32),
            Acceleration::body(f[0] as f32, f[1] as f32, f[2] as f32),
            Seconds::from_secs(DT as f32),
        );
        self.0.predict(imu).is_propagated()
    }

    fn update(&mut self, k: u32) -> bool {
        let sigma = SIGMA_VELOCITY as f32;
        let noise = VelocityNoise::<Ned>::from_sigma(sigma, sigma, sigma);
        self.0
            .fuse_gnss_velocity(at(k), Velocity::ned(0.0, 0.0, 0.0), noise, Position::zero())
            .is_accepted()
    }

    fn velocity_variance(&self) -> f64 {
        f64::from(self.0.covariance().variance(ErrorState::VelocityEast))
    }

    fn attitude_deg(&self) -> Option<[f64; 3]> {
        let (roll, pitch, yaw) = self.0.state().attitude.euler_angles();
        Some([yaw, pitch, roll].map(|x| f64::from(x) / RAD))
    }
}

fn at(k: u32) -> Timestamp {
    Timestamp::from_secs_f64(1.0 + time(k))
}
