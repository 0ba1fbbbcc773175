//! Calls every public function of the library with values that the optimizer cannot know: the kernels in f32 and f64,
//! updates with 1 to 6 rows. `cargo xtask panic-free` compares the names called here with those in `src/`.

use core::hint::black_box as any;

use nalgebra::{SMatrix, Vector3};

use navsight::alignment::coarse::CoarseAlignment;
use navsight::alignment::standing::{Plan, StandingAlignment};
use navsight::attitude::{self, Enu, Euler, Frd, FrdToNed, Ned, Rfu, RfuToEnu};
use navsight::covariance::{Covariance, Observation, Rows};
use navsight::earth::{self, Geodetic, Local};
use navsight::error::Error;
use navsight::error_model::{
    self, discrete, phi, psi, BiasModel, Environment, Interval, NoiseDensity, Scaling,
};
use navsight::filter::{Filter, Prior, Settings};
use navsight::imu::{ConingSculling, ImuIncrement, ImuLimits};
use navsight::linalg::{self, BlockTransition, Real, Two};
use navsight::measurement::{self, Height, Jacobian, Linearized, Position, Velocity, ZeroVelocity};
use navsight::nav::NavState;

/// Takes a result, so that its computation stays.
#[inline(always)]
fn keep<T>(x: T) {
    any(x);
}

/// An unknown number.
fn number<T: Real>() -> T {
    T::of(any(0.5))
}

/// An unknown matrix.
fn matrix<T: Real, const R: usize, const C: usize>() -> SMatrix<T, R, C> {
    any(SMatrix::repeat(number()))
}

/// Everything.
pub fn call() {
    scalars::<f32>();
    scalars::<f64>();
    two();
    local_level::<f32>();
    local_level::<f64>();
    positions();
    rotations::<f32>();
    rotations::<f64>();
    frames();
    errors::<f32>();
    errors::<f64>();
    covariance::<f32, 15, 120>();
    covariance::<f64, 15, 120>();
    covariance::<f32, 12, 78>();
    covariance::<f64, 12, 78>();
    covariance::<f32, 3, 6>();
    covariance::<f64, 3, 6>();
    structured::<f32>();
    structured::<f64>();
    // What a refused construction leaves out stays linked: the optimizer does not know whether it is refused.
    keep(navigator().and_then(|nav| {
        measurements(&nav)?;
        filters(nav)
    }));
}

fn scalars<T: Real>() {
    let x: T = number();
    keep((x.wide(), x.root(), x.finite()));
    keep(linalg::two_add(any(x), any(x), any(x)));
    keep(linalg::skew(&matrix::<T, 3, 1>()));
}

fn two() {
    let mut two = Two::of(any(1.0));
    two.add(any(1.0));
    keep(two.wide());
}

fn local_level<T: Real>() {
    let x: T = number();
    keep(earth::radii(any(x)));
    keep(earth::normal_gravity(any(x), any(x)));
    keep(earth::omega_ie_n(any(x), any(x)));
    keep(earth::omega_en_n(&matrix(), any(x), any(x), any(x)));
}

fn positions() {
    let position = Geodetic::from_degrees(any(1.0), any(1.0), any(1.0));
    keep(position.to_degrees());
    keep(any(position).check());
    let local = any(Local::at(number(), number()));
    keep(Local::at_words(any(Two::of(0.5)), number()));
    keep(local.omega_ie_n());
    keep(local.omega_en_n(&matrix()));
}

fn rotations<T: Real>() {
    let q: [T; 4] = any([number(); 4]);
    keep(attitude::product(&q, &any(q)));
    keep(attitude::c_b_n(any(q)));
    keep(attitude::c_b_n_scaled(any(q), number()));
    keep(attitude::quaternion_of(&matrix::<T, 3, 3>()));
    keep(attitude::normalized(any(q)));
}

fn frames() {
    let euler = any(Euler::from_degrees(number(), number(), number()));
    keep(euler.to_degrees());
    keep((euler.c_b_n(), euler.quaternion()));
    keep(Euler::from_c_b_n(&matrix()));
    keep(attitude::rotation_minus_one(&matrix()));
    let v: Vector3<f32> = matrix();
    keep((Enu::from(Ned(v)), Ned::from(Enu::from(v))));
    keep((Rfu::from(Frd(v)), Frd::from(Rfu::from(v))));
    let attitude = any(RfuToEnu::from(euler));
    keep(RfuToEnu::from(FrdToNed::from(attitude)));
}

fn errors<T: Real>() {
    let environment = Environment::<T>::wgs84(any(0.5), any(0.5), matrix());
    let on_sphere = Environment::<T>::sphere(any(0.5), any(0.5), any(0.5), any(0.5), matrix());
    keep((on_sphere.omega_in_n(), on_sphere.omega_coriolis_n()));
    keep(on_sphere.gravity_gradient());

    keep(BiasModel::<T>::constant());
    let bias = BiasModel::from_correlation_times(number::<T>(), number());
    let Ok(bias) = bias else { return };
    keep(bias.check());
    keep(NoiseDensity::<T>::zero());
    let noise = NoiseDensity::from_random_walks(number::<T>(), number());
    let noise = noise.with_stationary_biases(&bias, any([number(); 3]), any([number(); 3]));
    keep((noise.diagonal(), noise.check()));
    keep(error_model::g_matrix(&matrix::<T, 3, 3>()));

    let f = psi::f_matrix(&environment, &matrix(), &matrix(), &bias);
    keep(phi::f_matrix(&environment, &matrix(), &matrix(), &bias));
    let a = discrete::phi_minus_identity(&f, number(), any(3));
    keep(discrete::chain(&a, &matrix()));
    keep(discrete::process_noise(&noise.diagonal(), number()));

    let Ok(scaling) = Scaling::new(&any([number(); 15]), &bias, &noise) else {
        return;
    };
    let mut collected = Interval::<T>::empty();
    collected.add(&matrix(), &matrix(), number());
    keep(error_model::block_transition(
        &environment,
        &any(collected),
        &scaling,
    ));
    keep(error_model::block_rates(
        &environment,
        &matrix(),
        &matrix(),
        &scaling,
    ));
}

fn covariance<T: Real, const N: usize, const L: usize>() {
    keep(Covariance::<T, N, L>::from_diagonal(&any([number(); N])));
    let Ok(mut p) = Covariance::<T, N, L>::from_matrix(&matrix()) else {
        return;
    };
    p.propagate(&matrix(), &matrix());
    p.propagate_full(&matrix(), &matrix());
    keep((p.variance(any(1)), p.element(any(1), any(2))));
    keep((p.diagonal(), p.broken(), p.words()));
    keep(p.to_matrix());
    rows::<T, N, L, 1>(&mut p);
    rows::<T, N, L, 2>(&mut p);
    rows::<T, N, L, 3>(&mut p);
    rows::<T, N, L, 4>(&mut p);
    rows::<T, N, L, 5>(&mut p);
    rows::<T, N, L, 6>(&mut p);
    keep(p);
}

fn rows<T: Real, const N: usize, const L: usize, const M: usize>(p: &mut Covariance<T, N, L>) {
    let rows = Rows::<T, M, N> {
        nu: any([number(); M]),
        h: if any(true) {
            Observation::Direct { first: any(0) }
        } else {
            Observation::Dense(matrix())
        },
        r: any([number(); M]),
        gate: any(Some(number())),
    };
    keep(p.update(&any(rows)));
    keep(p.update_if(&any(rows), |dx| {
        if any(dx).is_empty() {
            Err(Error::Time)
        } else {
            Ok(())
        }
    }));
}

fn structured<T: Real>() {
    let blocks = any(BlockTransition::<T>::identity());
    keep((blocks.dense(), blocks.noise()));
    if let Ok(mut p) = Covariance::<T, 15, 120>::from_diagonal(&any([number(); 15])) {
        p.propagate_blocks(&blocks);
        keep(p);
    }
}

fn sample() -> ImuIncrement {
    let (v, dt) = (matrix::<f32, 3, 1>(), number());
    keep(ImuIncrement::from_rates(v, v, dt));
    any(ImuIncrement::new(v, v, dt))
}

fn navigator() -> Result<NavState, Error> {
    let imu = sample();
    keep(imu.check(&any(ImuLimits::DEFAULT)));
    let mut coning = any(ConingSculling::NEW);
    let motion = coning.correct(&imu);
    coning.remember(&imu);
    keep(coning);

    let position = any(Geodetic::from_degrees(1.0, 1.0, 1.0));
    let nav = NavState::new(position, matrix::<f32, 3, 1>(), RfuToEnu(any([0.5; 4])))?;
    let mut nav = nav.with_biases(matrix(), matrix())?;
    let mut strapdown = any(*nav.strapdown());
    keep(strapdown.step(&any(motion)));
    keep(strapdown);
    keep(nav.advance(&imu));
    let step = nav.advance_within(&imu, &any(ImuLimits::default()))?;
    let mut interval = Interval::<f32>::default();
    interval.accumulate(&step);
    keep(interval);
    keep(nav.correct(&matrix()));
    keep(nav.corrected(&matrix()));
    keep((nav.v_n(), nav.c_b_n(), nav.quaternion(), nav.euler()));
    keep((nav.position(), nav.lat(), nav.lon(), nav.height()));
    keep((nav.b_g(), nav.b_a()));
    keep(Environment::from_local(&nav.local(), &nav.v_n()));
    keep(nav.displacement_to(&any(position)));
    Ok(any(nav))
}

fn measurements(nav: &NavState) -> Result<(), Error> {
    let x: f32 = number();
    keep((measurement::variance(x), measurement::check_interval(x)));
    keep(Height::new(any(0.5), x, x)?.linearize(nav));
    let position = any(Geodetic::from_degrees(1.0, 1.0, 1.0));
    keep(Position::new(position, matrix(), x)?.linearize(nav));
    keep(Velocity::new(matrix::<f32, 3, 1>(), matrix(), x)?.linearize(nav));
    let standing = ZeroVelocity::new(x, x)?;
    keep(standing.interval());
    keep(standing.linearize(nav).h.dense());
    Ok(())
}

fn filters(nav: NavState) -> Result<(), Error> {
    let prior = any(Prior {
        position: [1.0; 3],
        velocity: [1.0; 3],
        attitude: [1.0; 3],
        gyro_bias: [1.0; 3],
        accel_bias: [1.0; 3],
    });
    keep(prior.sigma0());
    let settings = any(Settings {
        limits: ImuLimits::DEFAULT,
        noise: NoiseDensity::zero(),
        bias: BiasModel::constant(),
        propagation_interval: 0.1,
        gate: Some(9.0),
    });
    keep(settings.check());
    keep(Filter::with_covariance(any(nav), &matrix(), settings));
    let mut filter = any(Filter::new(nav, &prior, settings)?);
    filter.propagate(&sample())?;
    filter.synchronize();
    filter_rows::<1>(&mut filter);
    filter_rows::<2>(&mut filter);
    filter_rows::<3>(&mut filter);
    filter_rows::<4>(&mut filter);
    filter_rows::<5>(&mut filter);
    filter_rows::<6>(&mut filter);
    keep((filter.environment(), filter.sigma(any(3)), filter.time()));
    keep((filter.nav(), filter.covariance(), filter.settings()));
    keep((filter.scaling(), filter.sigma0()));
    alignments(filter, prior, settings)
}

fn filter_rows<const M: usize>(filter: &mut Filter) {
    let linearized = Linearized::<M> {
        nu: matrix(),
        h: if any(true) {
            Jacobian::Direct { first: any(0) }
        } else {
            Jacobian::Dense(matrix())
        },
        r: matrix(),
        interval: number(),
    };
    if let Ok(report) = filter.update(&any(linearized)) {
        keep(report.rows_accepted());
        keep(report);
    }
}

fn alignments(filter: Filter, prior: Prior, settings: Settings) -> Result<(), Error> {
    let position = any(Geodetic::from_degrees(1.0, 1.0, 1.0));
    let mut coarse = CoarseAlignment::new(&position, any(ImuLimits::DEFAULT))?;
    coarse.take(&sample())?;
    keep(coarse.time());
    keep(coarse.solve()?.euler());

    let plan = any(Plan {
        coarse_duration: 60.0,
        zero_velocity: ZeroVelocity::new(number(), number())?,
        turning: 0.02,
    });
    let mut standing = StandingAlignment::new(position, plan, prior, settings)?;
    keep(standing.take(&sample()));
    keep(standing.filter().is_some());
    keep(StandingAlignment::from_filter(filter, plan, prior));

    Ok(())
}
