//! Linear algebra only: the same Φ, Q, H and R handed to filters that know no navigation. Φ and Q are those of the vehicle
//! at rest and cost nothing here; states in units of their prior.

use adskalman::{
    CovarianceUpdateMethod, ObservationModel, StateAndCovariance, TransitionModelLinearNoControl,
};
use kfilter::measurement::LinearMeasurement;
use kfilter::system::LinearNoInputSystem;
use kfilter::{Kalman, KalmanFilter as _, KalmanPredict as _, KalmanUpdate as _};
use minikalman::prelude::*;
use minikalman::regular::builder::KalmanFilterBuilder;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use navsight::error_model::{
    block_transition, BiasModel, Environment, Interval, NoiseDensity, Scaling,
};

use crate::scenario::{Peer, Sample, *};

type P15 = SMatrix<f32, 15, 15>;
type H15 = SMatrix<f32, 3, 15>;

/// Φ, Q, H, R and P0.
fn model() -> Option<(P15, P15, H15, Matrix3<f32>, P15)> {
    let mut sigma0 = [0.0f32; 15];
    sigma0[..3].fill(PRIOR_POSITION as f32);
    sigma0[3..6].fill(PRIOR_VELOCITY as f32);
    sigma0[6..8].fill(PRIOR_TILT as f32);
    sigma0[8] = PRIOR_HEADING as f32;
    sigma0[9..12].fill(PRIOR_GYRO as f32);
    sigma0[12..].fill(PRIOR_ACCEL as f32);
    let [angle, velocity, gyro, accel] = WALKS;
    let mut noise = NoiseDensity::from_random_walks(angle as f32, velocity as f32);
    noise.gyro_bias = [(gyro * gyro) as f32; 3];
    noise.accel_bias = [(accel * accel) as f32; 3];
    let scaling = Scaling::new(&sigma0, &BiasModel::constant(), &noise).ok()?;
    let environment = Environment::wgs84(LAT_DEG * RAD, HEIGHT_M, Vector3::zeros());
    let axes = axes(HEADING_DEG);
    let interval = Interval {
        c_dt: Matrix3::from_fn(|i, j| (axes[j][i] * DT) as f32),
        f_dt: Vector3::new(0.0, 0.0, (gravity() * DT) as f32),
        dt: DT as f32,
    };
    let t = block_transition(&environment, &interval, &scaling);
    let mut h = H15::zeros();
    h.fixed_view_mut::<3, 3>(0, 3).fill_diagonal(1.0);
    let r = (SIGMA_VELOCITY / PRIOR_VELOCITY) as f32;
    Some((
        P15::identity() + t.dense(),
        P15::from_diagonal(&t.noise()),
        h,
        Matrix3::from_diagonal_element(r * r),
        P15::identity(),
    ))
}

fn variance(p: f32) -> f64 {
    f64::from(p) * PRIOR_VELOCITY * PRIOR_VELOCITY
}

/// Written as a user of nalgebra would: Φ P Φᵀ + Q, and Joseph's form.
pub struct Dense {
    p: P15,
    x: SVector<f32, 15>,
    phi: P15,
    q: P15,
    h: H15,
    r: Matrix3<f32>,
}

impl Peer for Dense {
    const NAME: &'static str = "dense nalgebra 0.35, Joseph";
    const SCALAR: &'static str = "f32";
    const ALGEBRA_ONLY: bool = true;

    fn start() -> Option<Self> {
        let (phi, q, h, r, p) = model()?;
        Some(Self {
            p,
            x: SVector::zeros(),
            phi,
            q,
            h,
            r,
        })
    }
    fn predict(&mut self, _: &Sample) -> bool {
        self.x = self.phi * self.x;
        self.p = self.phi * self.p * self.phi.transpose() + self.q;
        true
    }
    fn update(&mut self, _: u32) -> bool {
        let pht = self.p * self.h.transpose();
        let Some(s) = (self.h * pht + self.r).try_inverse() else {
            return false;
        };
        let k = pht * s;
        self.x -= k * (self.h * self.x);
        let i_kh = P15::identity() - k * self.h;
        self.p = i_kh * self.p * i_kh.transpose() + k * self.r * k.transpose();
        true
    }
    fn velocity_variance(&self) -> f64 {
        variance(self.p[(3, 3)])
    }
    fn attitude_deg(&self) -> Option<[f64; 3]> {
        None
    }
}

pub struct Kfilter {
    filter: Kalman<f32, 15, 0, LinearNoInputSystem<f32, 15>>,
    row: LinearMeasurement<f32, 15, 3>,
}

impl Peer for Kfilter {
    const NAME: &'static str = "kfilter 0.5.1";
    const SCALAR: &'static str = "f32";
    const ALGEBRA_ONLY: bool = true;

    fn start() -> Option<Self> {
        use nalgebra34::{SMatrix as M, SVector as V};
        let (phi, q, h, r, p) = model()?;
        let square = |m: P15| M::<f32, 15, 15>::from_fn(|i, j| m[(i, j)]);
        let system = LinearNoInputSystem::new(square(phi), square(q), V::zeros());
        Some(Self {
            filter: Kalman::new_custom(system, square(p)),
            row: LinearMeasurement::new(
                M::from_fn(|i, j| h[(i, j)]),
                M::from_fn(|i, j| r[(i, j)]),
                V::zeros(),
            ),
        })
    }
    fn predict(&mut self, _: &Sample) -> bool {
        self.filter.predict().is_ok()
    }
    fn update(&mut self, _: u32) -> bool {
        self.filter.update(&self.row).is_ok()
    }
    fn velocity_variance(&self) -> f64 {
        variance(self.filter.covariance()[(3, 3)])
    }
    fn attitude_deg(&self) -> Option<[f64; 3]> {
        None
    }
}

pub struct Ads {
    model: AdsModel,
    state: StateAndCovariance<f32, nalgebra::Const<15>>,
}
pub struct AdsModel {
    f: P15,
    ft: P15,
    q: P15,
    h: H15,
    ht: SMatrix<f32, 15, 3>,
    r: Matrix3<f32>,
}
#[allow(non_snake_case)] // the trait's names
impl TransitionModelLinearNoControl<f32, nalgebra::Const<15>> for AdsModel {
    fn F(&self) -> &P15 {
        &self.f
    }
    fn FT(&self) -> &P15 {
        &self.ft
    }
    fn Q(&self) -> &P15 {
        &self.q
    }
}
#[allow(non_snake_case)] // the trait's names
impl ObservationModel<f32, nalgebra::Const<15>, nalgebra::Const<3>> for AdsModel {
    fn H(&self) -> &H15 {
        &self.h
    }
    fn HT(&self) -> &SMatrix<f32, 15, 3> {
        &self.ht
    }
    fn R(&self) -> &Matrix3<f32> {
        &self.r
    }
}

impl Peer for Ads {
    const NAME: &'static str = "adskalman 0.18.0";
    const SCALAR: &'static str = "f32";
    const ALGEBRA_ONLY: bool = true;

    fn start() -> Option<Self> {
        let (f, q, h, r, p) = model()?;
        Some(Self {
            model: AdsModel {
                f,
                ft: f.transpose(),
                q,
                h,
                ht: h.transpose(),
                r,
            },
            state: StateAndCovariance::new(SVector::zeros(), p),
        })
    }
    fn predict(&mut self, _: &Sample) -> bool {
        self.state = TransitionModelLinearNoControl::predict(&self.model, &self.state);
        true
    }
    fn update(&mut self, _: u32) -> bool {
        let z = Vector3::zeros();
        let method = CovarianceUpdateMethod::OptimalKalman;
        match ObservationModel::update(&self.model, &self.state, &z, method) {
            Ok(state) => {
                self.state = state;
                true
            }
            Err(_) => false,
        }
    }
    fn velocity_variance(&self) -> f64 {
        variance(self.state.covariance()[(3, 3)])
    }
    fn attitude_deg(&self) -> Option<[f64; 3]> {
        None
    }
}

/// Its buffers are on the heap: the builder makes them there.
pub struct Mini {
    filter: minikalman::regular::builder::KalmanFilterType<15, f32>,
    rows: minikalman::regular::builder::KalmanFilterObservationType<15, 3, f32>,
}

impl Peer for Mini {
    const NAME: &'static str = "minikalman 0.8.1";
    const SCALAR: &'static str = "f32";
    const ALGEBRA_ONLY: bool = true;

    fn start() -> Option<Self> {
        let (phi, q, h, r, p) = model()?;
        let builder = KalmanFilterBuilder::<15, f32>::default();
        let mut filter = builder.build();
        let mut rows = builder.observations().build::<3>();
        for i in 0..15 {
            for j in 0..15 {
                filter.state_transition_mut().set(i, j, phi[(i, j)]);
                filter.estimate_covariance_mut().set(i, j, p[(i, j)]);
                filter.direct_process_noise_mut().set(i, j, q[(i, j)]);
            }
        }
        for i in 0..3 {
            for j in 0..15 {
                rows.observation_matrix_mut().set(i, j, h[(i, j)]);
            }
            rows.measurement_noise_covariance_mut().set(i, i, r[(i, i)]);
        }
        Some(Self { filter, rows })
    }
    fn predict(&mut self, _: &Sample) -> bool {
        self.filter.predict();
        true
    }
    fn update(&mut self, _: u32) -> bool {
        self.filter.correct(&mut self.rows);
        true
    }
    fn velocity_variance(&self) -> f64 {
        variance(self.filter.estimate_covariance().get(3, 3))
    }
    fn attitude_deg(&self) -> Option<[f64; 3]> {
        None
    }
}
