//! Calls every public function of the library with values that the optimizer cannot know: the kernels in f32 and f64,
//! updates with 1 to 6 rows. `cargo xtask panic-free` compares the names called here with those in `src/`.

use core::hint::black_box as any;

use nalgebra::{SMatrix, Vector3};

use navsight::alignment::angle;
use navsight::alignment::carry::BiasBlock;
use navsight::alignment::coarse::CoarseAlignment;
use navsight::alignment::gate;
use navsight::alignment::heading_source::{self, OutsideHeading};
use navsight::alignment::in_motion::InMotion;
use navsight::alignment::levelling::Levelling;
use navsight::alignment::north_bias::{self, NorthBias};
use navsight::alignment::planner::{Manoeuvre, Planner, Rules};
use navsight::alignment::standing::{self, Plan, StandingAlignment};
use navsight::alignment::stationary::{StationaryDetector, StationarySettings};
use navsight::alignment::supervisor::Supervisor;
use navsight::attitude::{self, Enu, Euler, Frd, FrdToNed, Ned, Rfu, RfuToEnu};
use navsight::covariance::{Covariance, Observation, Rows};
use navsight::earth::{self, Geodetic, Local};
use navsight::error::Error;
use navsight::error_model::{
    self, discrete, phi, psi, BiasModel, Environment, Interval, NoiseDensity, Scaling,
};
use navsight::filter::{
    Aided, Filter, Gate, LateFilter, Prior, Settings, Source, States, UpdateReport,
};
use navsight::imu::{ConingSculling, ImuIncrement, ImuLimits};
use navsight::linalg::{self, BlockTransition, Real, Two};
use navsight::measurement::{
    self, Accuracy, Antenna, Barometer, Boresight, Course, Heading, Height, Jacobian, Linearized,
    NonHolonomic, Odometer, Position, PositionVelocity, Velocity, ZeroRotation, ZeroVelocity,
};
use navsight::nav::NavState;
use navsight::observability::agreement::{self, Flag, Limits, View};
use navsight::observability::ceiling::{self, Gramian, Unseen};
use navsight::observability::comprehensive;
use navsight::observability::diagonal::{self, Index, Xi};
use navsight::observability::eigen_degree::{EigenDegree, Form};
use navsight::observability::extreme::Extremes;
use navsight::observability::pwcs::{Kind, Scale, Staged, NAVIGATION};
use navsight::observability::riccati::{DecreaseRate, Information};
use navsight::observability::spectrum::{self, Axes, Directions, Spectrum, ValuesOnly};
use navsight::observability::structural::{
    self, Changes, Cover, Groups, Linking, Matchings, Pattern, Report, Segments, TermRank,
};
use navsight::observability::verdict::{self, Verdicts};
use navsight::sensor::{self, Axis, Burst, Triad, Word};
use navsight::tracking::{
    AxisTracker, CurrentModel, Fix, Kinematics, Limits as AccelerationLimits, LocalTracker, Mean,
    Noise, Reading, Report as TrackReport, Settings as TrackerSettings, Tracker, Transition,
    Variance,
};

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

/// Calls a function for 1 to 6 rows.
macro_rules! with_rows {
    ($function:ident, <$($t:ty),*>, $($argument:expr),*) => {
        $function::<$($t,)* 1>($($argument),*);
        $function::<$($t,)* 2>($($argument),*);
        $function::<$($t,)* 3>($($argument),*);
        $function::<$($t,)* 4>($($argument),*);
        $function::<$($t,)* 5>($($argument),*);
        $function::<$($t,)* 6>($($argument),*);
    };
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
    observability::<f32, 15, 120>();
    observability::<f64, 15, 120>();
    observability::<f32, 12, 78>();
    by_blocks::<f32>();
    by_blocks::<f64>();
    keep(patterns::<15, 15>());
    keep(patterns::<32, 32>());
    keep(looking::<f32, 3>());
    keep(looking::<f32, 6>());
    keep(looking::<f64, 6>());
    keep(sensors());
    current_model::<f32>();
    current_model::<f64>();
    tracker::<f32, 1, 3, 6>();
    tracker::<f64, 1, 3, 6>();
    tracker::<f32, 3, 9, 45>();
    tracker::<f64, 3, 9, 45>();
    keep((
        AxisTracker::<f32>::NORMALISED,
        LocalTracker::<f32>::NORMALISED,
    ));
    // What a refused construction leaves out stays linked: the optimizer does not know whether it is refused.
    keep(navigator().and_then(|nav| {
        measurements(&nav)?;
        aids(&nav)?;
        filters(nav)
    }));
}

fn scalars<T: Real>() {
    let x: T = number();
    keep((x.wide(), x.root(), x.finite()));
    keep((any(x).exponential(), any(x).exponential_m1()));
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
    let mut place = any(BlockTransition::identity());
    error_model::block_transition_into(&environment, &any(collected), &scaling, &mut place);
    keep(place);
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
    keep(p.isolate(any(1), number()));
    keep(p.to_matrix());
    with_rows!(rows, <T, N, L>, &mut p);
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
    keep(p.update_considering(&any(rows), any(1), |dx: &[T; N]| {
        if any(dx).is_empty() {
            Err(Error::Time)
        } else {
            Ok(())
        }
    }));
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

fn indices<T: Real, const N: usize>(index: Index<T, N>) {
    let index = any(index);
    keep((index.get(any(1)), index.all(), index.available()));
}

fn observability<T: Real, const N: usize, const L: usize>() {
    let variances = any([number::<T>(); N]);
    if let Ok(index) = diagonal::xi1(&variances, number(), any(1)) {
        indices(index);
    }
    if let Ok(index) = diagonal::xi2(&variances, any(1)) {
        indices(index);
    }
    let Ok(p) = Covariance::<T, N, L>::from_diagonal(&variances) else {
        return;
    };
    with_rows!(rates, <T, N, L>, &p);
    let rate = any(DecreaseRate::riccati(
        &p,
        &matrix(),
        &matrix(),
        &information::<T, N, 1>(),
    ));
    keep((rate.element(any(1), any(2)), rate.diagonal()));
    spectra(&p, &rate, Spectrum::<T, N, L, ValuesOnly>::new());
    spectra(&p, &rate, Spectrum::<T, N, L, Directions<T, N>>::new());
    let mut ends = Extremes::<T, N, L>::default();
    keep((ends.most(&p, any(1)), ends.least(&p, any(1))));
}

fn information<T: Real, const N: usize, const M: usize>() -> Information<T, M, N> {
    any(Information {
        h: if any(true) {
            Observation::Direct { first: any(0) }
        } else {
            Observation::Dense(matrix())
        },
        r_t: [number(); M],
    })
}

fn rates<T: Real, const N: usize, const L: usize, const M: usize>(p: &Covariance<T, N, L>) {
    let information = information::<T, N, M>();
    let riccati = diagonal::xi1_riccati(p, &matrix(), &matrix(), any(Some(&information)), any(1));
    indices(riccati);
    keep(DecreaseRate::riccati(p, &matrix(), &matrix(), &information));
}

fn spectra<'p, T: Real, const N: usize, const L: usize, A: Axes<T>>(
    p: &'p Covariance<T, N, L>,
    rate: &DecreaseRate<T, N, L>,
    mut spectrum: Spectrum<'p, T, N, L, A>,
) {
    let prior = if any(true) {
        spectrum::Prior::Independent
    } else {
        spectrum::Prior::Correlated(any(p))
    };
    keep(if any(true) {
        spectrum.start_accuracy(p, prior, any(1))
    } else {
        spectrum.start_speed(rate, prior, any(1))
    });
    keep(spectrum.step(any(spectrum::SLICE)));
    keep((spectrum.len(), spectrum.is_empty()));
    keep((spectrum.value(any(1)), spectrum.direction(any(1))));
}

fn by_blocks<T: Real>() {
    let Ok(p) = Covariance::<T, 15, 120>::from_diagonal(&any([number(); 15])) else {
        return;
    };
    with_rows!(rates_by_blocks, <T>, &p);
}

fn rates_by_blocks<T: Real, const M: usize>(p: &Covariance<T, 15, 120>) {
    let blocks = any(BlockTransition::<T>::identity());
    let information = information::<T, 15, M>();
    let riccati = diagonal::xi1_riccati_blocks(p, &blocks, any(Some(&information)), any(1));
    indices(riccati);
    keep(DecreaseRate::blocks(p, &blocks, &information));
}

fn current_model<T: Real>() {
    let x: T = number();
    let limits = any(AccelerationLimits::new(x, x));
    keep((
        limits.variance(any(x)),
        AccelerationLimits::paper(any(x), any(x)),
    ));
    keep(CurrentModel::singer(any(x), any(x)));
    let mut model = any(CurrentModel::current(x, limits));
    model.mean = any(Mean::Zero);
    model.variance = any(Variance::Fixed(x));
    keep((model.check(), model.sigma2(any(x))));
    if let Ok(over) = Transition::new(any(x), any(x)) {
        keep((over.noise(any(x)), model.gain(&over, any(x))));
    }
}

fn tracker<T: Real, const AXES: usize, const N: usize, const L: usize>() {
    let all = any([number::<T>(); AXES]);
    let kinematics = any(Kinematics {
        position: all,
        velocity: all,
        acceleration: all,
    });
    let model = CurrentModel::current(number(), any(AccelerationLimits::new(number(), number())));
    let settings = any(TrackerSettings::new(model));
    let Ok(mut tracker) = Tracker::<T, AXES, N, L>::new(&kinematics, &kinematics, settings) else {
        return;
    };
    keep(tracker.predict(any(number())));
    let mut reading = any(Reading::new(all, number()));
    if any(true) {
        reading.noise = Noise::Correlated(matrix());
    }
    let fix = any(Fix {
        position: Some(reading),
        velocity: Some(reading),
    });
    let mut room = any(TrackReport::empty());
    keep(tracker.update_into(&fix, &mut room));
    keep(room);
    if let Ok(report) = tracker.update(&fix) {
        keep((report.used(), report.outcome.map(|o| o.map(|o| o.used()))));
        keep(report.information(any(number())));
        keep(report);
    }
    keep((tracker.state(), tracker.sigma(), tracker.covariance()));
    keep((tracker.sigma0(), tracker.sigma2(), tracker.rates()));
    keep(tracker);
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
    keep(coning.rate());
    let motion = coning.correct(&imu);
    coning.remember(&imu);
    keep(coning);
    keep((motion.phi_b(), motion.less_biases(&matrix(), &matrix())));

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
    keep((nav.b_g(), nav.b_a(), nav.omega_ib_b()));
    keep(Environment::from_local(&nav.local(), &nav.v_n()));
    keep(nav.displacement_to(&any(position)));
    Ok(any(nav))
}

fn measurements(nav: &NavState) -> Result<(), Error> {
    let x: f32 = number();
    keep((measurement::variance(x), measurement::check_interval(x)));
    let height = Height::new(any(0.5), x, x)?;
    keep((height.interval(), height.linearize(nav)));
    let heading = Heading::new(x, x, x)?;
    keep((heading.interval(), heading.linearize(nav)));
    let azimuth = Heading::of_axis(matrix::<f32, 3, 1>(), x, x, x)?;
    keep(azimuth.linearize(nav));
    let still = ZeroRotation::new(matrix(), x, x)?;
    keep((still.interval(), still.linearize(nav)));
    let position = Position::new(any(Geodetic::from_degrees(1.0, 1.0, 1.0)), matrix(), x)?;
    keep((position.interval(), position.linearize(nav)));
    let velocity = Velocity::new(matrix::<f32, 3, 1>(), matrix(), x)?;
    keep((velocity.interval(), velocity.linearize(nav)));
    let standing = ZeroVelocity::new(x, x)?;
    keep(standing.interval());
    keep(standing.linearize(nav).dense());
    Ok(())
}

/// Measurements with a lever arm, a boresight or an accuracy of their own.
fn aids(nav: &NavState) -> Result<(), Error> {
    let x: f32 = number();
    let antenna = Antenna::new(matrix::<f32, 3, 1>())?;
    keep((antenna.lever_arm(), antenna.is_at_imu()));
    keep((
        antenna.offset(&nav.c_b_n()),
        antenna.motion(nav, &nav.c_b_n()),
    ));
    let accuracy = Accuracy::covariance(&matrix())?;
    keep((accuracy.is_diagonal(), accuracy.variances()));
    keep((
        Accuracy::per_axis(matrix()),
        Accuracy::horizontal_vertical(x, any(x)),
        Accuracy::speed(x),
    ));
    let place = any(Geodetic::from_degrees(1.0, 1.0, 1.0));
    let position = Position::with_accuracy(place, accuracy, x)?.of(antenna);
    keep((position.accuracy(), position.linearize_horizontal(nav)));
    let velocity = Velocity::with_accuracy(matrix::<f32, 3, 1>(), accuracy, x)?.of(antenna);
    keep((velocity.accuracy(), velocity.linearize_horizontal(nav)));
    let fix = PositionVelocity::new(any(position), any(velocity), antenna);
    keep((fix.position(), fix.velocity(), fix.interval()));
    keep((fix.linearize(nav), fix.linearize(nav).dense()));
    let barometer = Barometer::calibrate(x, any(x), any(0.5))?;
    keep((barometer.height(any(x)), barometer.measure(any(x), x, x)));
    let boresight = Boresight::new(any(nav.euler()))?;
    keep((boresight.c_m_b(), boresight.forward_b()));
    let course = Course::new(x, boresight, any(x), x)?;
    keep(Course::of_velocity(
        matrix::<f32, 3, 1>(),
        x,
        any(x),
        boresight,
        x,
    ));
    keep((course.interval(), course.linearize(nav)));
    let odometer = Odometer::new(x, antenna, boresight, matrix(), any(x))?;
    keep((odometer.interval(), odometer.linearize(nav)));
    let wheels = NonHolonomic::new(antenna, boresight, x, any(x), any(x))?;
    keep((wheels.interval(), wheels.linearize(nav)));
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
    keep(filter.restart(&any(nav), &prior, &settings));
    let mut gramian = Gramian::<f32, 15>::new();
    filter.propagate(&sample())?;
    filter.propagate_watched(&sample(), |t| gramian.propagate(&t.dense()))?;
    filter.synchronize();
    filter.synchronize_watched(|t| gramian.propagate(&t.dense()));
    keep(gramian);
    with_rows!(filter_rows, <>, &mut filter);
    keep((filter.environment(), filter.sigma(any(3)), filter.time()));
    keep((filter.nav(), filter.covariance(), filter.settings()));
    keep((filter.scaling(), filter.sigma0()));
    filter.open(any(States::POSITION), number())?;
    late(&filter);
    keep(in_motion());
    alignments(filter, prior, settings)
}

/// The filter with a memory.
fn late(filter: &Filter) {
    let x: f32 = number();
    let gate = any(Gate {
        limit: Some(x),
        lock_out: Some((x, States::VELOCITY)),
    });
    let (Ok(mut filter), Ok(mut source)) =
        (LateFilter::<16>::new(filter.clone(), x), Source::new(gate))
    else {
        return;
    };
    keep(filter.propagate(&sample()));
    filter.synchronize();
    keep((filter.filter().time(), filter.state_at(any(0.5))));
    keep((source.gate(), source.used(), source.refused()));
    keep((source.refused_in_a_row(), source.resets()));
    keep(any(States::HEIGHT).has(any(1)));
    with_rows!(late_rows, <>, &mut filter, &mut source);
    if let Ok(fix) = fix() {
        // the rows of an antenna have a kernel of their own
        keep(filter.update(&mut source, any(0.5), |nav| fix.linearize(nav)));
    }
}

fn fix() -> Result<PositionVelocity, Error> {
    let place = any(Geodetic::from_degrees(1.0, 1.0, 1.0));
    let position = Position::new(place, matrix(), number())?;
    let velocity = Velocity::new(matrix::<f32, 3, 1>(), matrix(), number())?;
    let antenna = Antenna::new(matrix::<f32, 3, 1>())?;
    Ok(PositionVelocity::new(position, velocity, antenna))
}

fn late_rows<const M: usize>(filter: &mut LateFilter<16>, source: &mut Source) {
    let linearized = any(Linearized::<M> {
        nu: matrix(),
        h: Jacobian::Dense(matrix()),
        r: matrix(),
        interval: number(),
    });
    keep(filter.update(source, any(0.5), |nav| {
        keep(nav.v_n());
        linearized
    }));
    let mut aided = Aided::<M>::empty();
    keep(filter.update_into(source, any(0.5), |_| linearized, &mut aided));
    keep(aided);
}

fn in_motion() -> Result<(), Error> {
    let mut finder = InMotion::<16>::new(number(), number(), any(ImuLimits::DEFAULT))?;
    finder.take(&sample())?;
    finder.velocity(any(0.5), matrix::<f32, 3, 1>())?;
    keep((finder.time(), finder.pairs()));
    keep(finder.solve(number())?.euler());
    Ok(())
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
    keep(Information::of(&any(linearized), filter.sigma0()));
    let mut room = UpdateReport::empty();
    keep(filter.update_into(&any(linearized), &mut room));
    keep(room);
    let Ok(verdicts) = watching() else { return };
    if let Ok(report) = filter.update(&any(linearized)) {
        let mut gramian = Gramian::<f32, 15>::new();
        gramian.observe_update(&any(linearized), &report, filter.sigma0());
        keep(gramian);
        keep(report.rows_accepted());
        keep(Xi::of(&report));
        keep(any(verdicts).take(any(2.0), &report));
        if let Ok(supervisor) = supervising() {
            keep(any(supervisor).take(any(2.0), &report));
        }
        if let Ok(mut holding) = gate::Gate::new(any(gate::Plan::BIASES)) {
            keep(holding.update(filter, &any(linearized)));
            keep(holding.update_into(filter, &any(linearized), &mut UpdateReport::empty()));
            keep(holding.held());
        }
        filter.consider(any(1));
        keep(filter.considered());
        keep(report);
    }
}

fn watching() -> Result<Verdicts, Error> {
    let limits = any(verdict::Limits::DEFAULT);
    keep(limits.check());
    let mut verdicts = Verdicts::new(&any([1.0; 15]), &any([Some(1.0); 15]), limits)?;
    verdicts.set_ceilings(&any([None; 15]));
    keep(verdicts.pass(any(1.0), &any([1.0; 15])));
    keep((verdicts.limits(), verdicts.all(), verdicts.trend(any(1))));
    keep((verdicts.reached(any(1)), verdicts.excess(any(1))));
    if let Some(judgement) = verdicts.of(any(1)) {
        keep((judgement.verdict.name(), judgement.reason.sentence()));
        keep(judgement.reason.verdict());
    }
    Ok(verdicts)
}

fn supervising() -> Result<Supervisor, Error> {
    let limits = any(verdict::Limits::DEFAULT);
    let mut supervisor = Supervisor::new(&any([1.0; 15]), &any([Some(1.0); 15]), limits)?;
    supervisor.manoeuvred(any(1.0));
    supervisor.reset();
    keep(supervisor.verdicts_mut());
    keep((supervisor.verdicts(), supervisor.latched()));
    keep((supervisor.progress(), supervisor.time_to_go()));
    keep((supervisor.sentence(), supervisor.status().state()));
    Ok(supervisor)
}

fn planning(filter: &Filter, standing: ZeroVelocity) -> Result<(), Error> {
    let rules = any(Rules::usual(standing));
    let mut planner = Planner::new(filter, any(Manoeuvre::USUAL), rules)?;
    keep((planner.step(any(9))?, planner.slice()?));
    keep((planner.outcome(any(1)), planner.ranking(any(8))));
    keep(planner.advice(any(8)));
    Ok(())
}

fn alignments(filter: Filter, prior: Prior, settings: Settings) -> Result<(), Error> {
    let position = any(Geodetic::from_degrees(1.0, 1.0, 1.0));
    let mut coarse = CoarseAlignment::new(&position, any(ImuLimits::DEFAULT))?;
    coarse.take(&sample())?;
    keep(coarse.time());
    keep(coarse.solve()?.euler());
    keep(coarse.at_start(&matrix::<f32, 3, 3>()));

    let plan = any(Plan {
        coarse_duration: 60.0,
        zero_velocity: ZeroVelocity::new(number(), number())?,
        turning: 0.02,
    });
    planning(&filter, plan.zero_velocity)?;
    let mut standing = StandingAlignment::new(position, plan, prior, settings)?;
    keep(standing.take(&sample()));
    let mut progress = any(standing::Progress::Coarse);
    keep(standing.take_into(&sample(), &mut progress));
    keep((standing.filter().is_some(), progress));
    let mut reusing = StandingAlignment::<64>::reusing(position, plan, prior, settings)?;
    keep(reusing.take(&sample()));
    keep((reusing.is_behind(), reusing.filter().is_some()));
    let mut level = Levelling::new(any(ImuLimits::DEFAULT));
    level.take(&sample())?;
    keep((level.time(), level.solve(number())));
    let vehicle = OutsideHeading::new(number(), number())?;
    keep((vehicle.sigma(), vehicle.heading(number(), number())));
    let outside = any(OutsideHeading::of_axis(
        matrix::<f32, 3, 1>(),
        number(),
        number(),
    ));
    keep(level.start(position, outside.as_ref().ok(), &prior, settings));
    let earth = heading_source::earth_rate_sigma(number(), number(), number(), number());
    keep(heading_source::choose(earth, outside.as_ref().ok()));
    let mut with = StandingAlignment::with_heading(position, plan, prior, settings, outside.ok())?;
    keep(with.take(&sample()));
    keep((with.heading_source(), with.level().copied()));
    with.set_heading(any(vehicle));
    keep(with.take(&sample()));

    let block = any(BiasBlock::of(&filter));
    keep(block.loosened(number(), number()));
    keep(block.start(any(*filter.nav()), &prior, settings));
    let north = any(NorthBias::of(&filter));
    keep(north.linearize(filter.nav()));
    keep(north_bias::paper_eq5(number(), number(), number()));
    keep(angle::heading_degree(number(), number(), number()));
    keep(angle::condition(number()));
    keep(StandingAlignment::from_filter(filter, plan, prior));

    let sheet = StationarySettings::from_noise(number(), number(), number(), number());
    keep(any(sheet).check());
    let mut detector = StationaryDetector::new(any(sheet))?;
    keep(detector.take(&sample())?);
    keep(detector.bias());
    detector.restart();
    keep(detector);

    Ok(())
}

/// A register map of which the optimizer knows nothing.
fn sensors() -> Result<(), Error> {
    let triad = any(Triad {
        first: [0, 2, 4],
        word: Word::I16Be,
        scale: 1.0,
        axes: sensor::Axes {
            right: Axis::X,
            forward: Axis::Y,
            up: Axis::Z,
        },
    });
    keep(any(Word::I16Be).bytes());
    let burst = Burst::<14>::new(any(&[0x1f]), triad, triad, any(None))?;
    keep(burst.command());
    keep(burst.decode(&any([0; 14]), number()));
    #[cfg(feature = "embedded-hal")]
    buses::call(burst);
    Ok(())
}

/// Sensors on buses that answer anything.
#[cfg(feature = "embedded-hal")]
mod buses {
    use super::{any, keep, number};
    use embedded_hal::{i2c, spi};
    use navsight::sensor::{Burst, I2cImu, ImuSource, SpiImu};

    struct Bus;

    impl spi::ErrorType for Bus {
        type Error = spi::ErrorKind;
    }

    impl spi::SpiDevice for Bus {
        fn transaction(
            &mut self,
            work: &mut [spi::Operation<'_, u8>],
        ) -> Result<(), spi::ErrorKind> {
            any(work);
            any(Ok(()))
        }
    }

    impl i2c::ErrorType for Bus {
        type Error = i2c::ErrorKind;
    }

    impl i2c::I2c for Bus {
        fn transaction(
            &mut self,
            address: u8,
            work: &mut [i2c::Operation<'_>],
        ) -> Result<(), i2c::ErrorKind> {
            any((address, work));
            any(Ok(()))
        }
    }

    pub fn call<const L: usize>(burst: Burst<L>) {
        let mut imu = SpiImu::new(Bus, burst);
        keep(imu.bus_mut());
        keep(imu.sample(number()));
        keep(imu.release());
        let mut imu = I2cImu::new(Bus, any(0x68), burst);
        keep(imu.bus_mut());
        keep(imu.sample(number()));
        keep(imu.release());
    }
}

/// Graphs of up to `N` states and `L` layers.
fn patterns<const N: usize, const L: usize>() -> Result<(), Error> {
    let mut p = Pattern::<N>::new(any(3), any(1))?;
    p.connect(any(1), any(0))?;
    p.observe(any(0), any(0))?;
    keep((p.states(), p.outputs(), p.all(), p.reach()));
    keep((
        p.to(any(1)),
        p.out(any(1)),
        p.row(any(1)),
        p.output_row(any(1)),
    ));
    let words = [1; N];
    let p = Pattern::<N>::from_adjacency(any(&words), any(1))?
        .without(any(2))
        .without_self_loops(any(3))
        .union(&p);
    keep(Pattern::<N>::from_model(
        &matrix::<f32, N, N>(),
        &matrix::<f32, 3, N>(),
        &matrix::<f32, N, 1>(),
        number(),
        any(0),
    ));
    let report = Report::new(&p);
    keep(report.class(any(1)));
    keep(structural::matching_size(&p));
    keep(structural::maximum_matching(&p).states());
    let mut matchings = Matchings::new(&p);
    keep(matchings.next(any(9)));
    keep(matchings.count(any(9), any(99)));
    let cover = Cover::new(&p);
    keep((
        cover.size(),
        cover.states(),
        cover.reach(),
        cover.next(any(1)),
        cover.unique(&p),
    ));
    let mut rank = TermRank::<N>::new();
    keep(rank.add(any(3)));
    keep((
        rank.rank(),
        rank.matched(),
        rank.always(any(7)),
        rank.circuit(any(1)),
    ));
    let segments = [p, p];
    let mut linking = Linking::<N, L>::new(any(&segments));
    keep(linking.widen(any(3)));
    keep((linking.link(any(7)), linking.link_one(any(1))));
    keep((linking.size(), linking.states(), linking.circuit(any(1))));
    if let Some((segment, steps)) = linking.path(any(1)) {
        keep(segment);
        for step in steps {
            keep(step);
        }
    }
    keep(Linking::<N, L>::of_span(any(&segments), any(3)).size());
    keep(linking.by_span());
    keep(linking.by_convention(any(&[1, 2])));
    let groups = Groups::of_linking(&linking);
    keep((groups.sets().len(), groups.of(any(1))));
    let mut all = Segments::new(&p);
    let changes = Changes::between(&matrix::<f32, N, N>(), &matrix::<f32, N, N>(), number())?;
    all.add(&p, &changes)?;
    keep((all.count(), *all.union(), all.bound(any(&segments))));
    keep(structural::matching_shared(any(&segments)));
    keep(structural::matching_separate(any(&segments)));
    keep(structural::holds(any(3), any(1)));
    for member in structural::members(any(3)) {
        keep(member);
    }
    Ok(())
}

/// Elimination and what is read off it.
fn looking<T: Real, const M: usize>() -> Result<(), Error> {
    let (f, h) = (matrix::<T, 15, 15>(), matrix::<T, M, 15>());
    keep(any(Kind::Position).unit::<T>(number(), number()));
    keep(Scale::<T, 15>::plain(number()));
    let scale = Scale::canonical(any(&NAVIGATION), &matrix::<T, 15, 1>(), number());
    let mut staged = Staged::<T, 15, M>::new(&scale)?;
    staged.begin(&h)?;
    keep(staged.step(&f, None)?);
    staged.segment(&f, &h, any(Some(&f)))?;
    keep((staged.rank(), staged.scale().time, staged.pivots()));
    keep(staged.origins().last());
    let row = any(1);
    keep((
        staged.pivot(row),
        staged.reduced(row),
        staged.highest_order(row),
    ));
    if let Some(c) = comprehensive::combination(&staged, row) {
        keep((
            c.strongest(),
            c.kept(number()),
            c.strict(),
            c.prior_weighted(number()),
        ));
    }
    keep(comprehensive::combinations(&staged).last());
    keep(comprehensive::of_state(&staged, row));
    keep(comprehensive::min_norm_degree(
        &f,
        &h,
        &staged,
        any(&[1, 2]),
        row,
    ));
    let form = any(Form::scaled([number(); 15], [number(); M], number()));
    keep(Form::<T, 15, M>::raw());
    let mut eigen = EigenDegree::new(&f, &h, &form, &staged)?;
    keep(eigen.step(&f));
    eigen.run(&f);
    keep((
        eigen.rank(),
        eigen.eigen(row),
        eigen.all().last(),
        eigen.null_share(row),
    ));
    let mut unseen = Unseen::of(&staged);
    unseen.find(&staged);
    keep((
        unseen.shares(),
        unseen.share(any(&[number(); 15])),
        unseen.shadow(row),
    ));
    keep((
        ceiling::ceiling::<T>(number()),
        ceiling::saturation::<T>(number(), number()),
        ceiling::tilt_excess(number(), number(), number(), number()),
    ));
    keep(ceiling::order_cost::<T>(number(), any(2)));
    let mut gramian = Gramian::<T, 15>::new();
    gramian.propagate(&f);
    gramian.observe(&matrix::<T, 15, 1>());
    let information = gramian.information();
    keep((
        gramian.rows(),
        gramian.diagonal(),
        gramian.xi2(&information),
    ));
    let limits = any(Limits::default());
    let view = View::of(&staged, &unseen, row, any(None), any(None), &limits);
    keep((view.ceiling(), view.flag(&limits)));
    keep(view.sentence(&limits, any(&[""; 15]), any(&NAVIGATION)));
    keep(any(Flag::Agree).name());
    keep(agreement::direction(
        &unseen,
        any(&[number(); 15]),
        number(),
        &limits,
    ));
    Ok(())
}
