//! The strapdown mechanization against its double-precision twin, and both against the truth.

use host_tests::reference::strapdown as twin;
use host_tests::sim::{
    ClimbingTurns, Coning, Ideal, Sensor, SensorErrors, Simulator, Static, Swing, Trajectory,
    Truth, ARCSEC, DEG,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use navsight::attitude::RfuToEnu;
use navsight::earth::Geodetic;
use navsight::imu::ImuIncrement;
use navsight::linalg::Two;
use navsight::nav::NavState;

/// 100 Hz, the length that the navigator is told.
const DT: f32 = 0.01;

/// Differences between two navigators, the largest of a run.
#[derive(Clone, Copy, Debug, Default)]
struct Gap {
    attitude_arcsec: f64,
    v_horizontal: f64,
    v_up: f64,
    horizontal: f64,
    up: f64,
}

impl Gap {
    fn widest(self, other: Self) -> Self {
        Self {
            attitude_arcsec: self.attitude_arcsec.max(other.attitude_arcsec),
            v_horizontal: self.v_horizontal.max(other.v_horizontal),
            v_up: self.v_up.max(other.v_up),
            horizontal: self.horizontal.max(other.horizontal),
            up: self.up.max(other.up),
        }
    }
}

/// (attitude, velocity, latitude, longitude, height)
type State = (UnitQuaternion<f64>, Vector3<f64>, f64, f64, f64);

fn of_nav(nav: &NavState) -> State {
    let s = nav.strapdown();
    let [w, x, y, z] = s.q.map(Two::wide);
    let v = s.v_n.map(Two::wide);
    let p = nav.position();
    (
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
        Vector3::from(v),
        p.lat,
        p.lon,
        p.height,
    )
}

fn of_twin(t: &twin::Strapdown) -> State {
    (t.q, t.v_n, t.lat, t.lon, t.height)
}

fn of_truth(t: &Truth) -> State {
    (t.q, t.v_n, t.lat, t.lon, t.height)
}

fn gap(a: &State, b: &State) -> Gap {
    let (r_m, r_n) = twin::radii(b.2);
    let turn = a.0.inverse() * b.0;
    let d_lon =
        (a.3 - b.3 + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
    let dv = a.1 - b.1;
    Gap {
        attitude_arcsec: 2.0 * turn.imag().norm() / ARCSEC,
        v_horizontal: dv.x.hypot(dv.y),
        v_up: dv.z.abs(),
        horizontal: ((a.2 - b.2) * (r_m + b.4)).hypot(d_lon * (r_n + b.4) * b.2.cos()),
        up: (a.4 - b.4).abs(),
    }
}

/// The navigator at the true initial state, and the twin at the navigator's.
fn start(truth: &Truth) -> (NavState, twin::Strapdown) {
    let q = truth.q.coords.cast::<f32>();
    let position = Geodetic {
        lat: truth.lat,
        lon: truth.lon,
        height: truth.height,
    };
    let nav = NavState::new(
        position,
        truth.v_n.cast::<f32>(),
        RfuToEnu([q.w, q.x, q.y, q.z]),
    )
    .unwrap();
    let (q, v_n, lat, lon, height) = of_nav(&nav);
    (nav, twin::Strapdown::new(q, v_n, lat, lon, height))
}

fn step_twin(t: &mut twin::Strapdown, imu: &ImuIncrement) {
    t.step(
        imu.delta_theta_b.cast(),
        imu.delta_v_b.cast(),
        f64::from(imu.dt),
    );
}

/// Puts height and vertical velocity back to the truth, in the navigator by an ordinary correction.
fn hold_height(nav: &mut NavState, twin: &mut twin::Strapdown, truth: &Truth) {
    let mut dx = nalgebra::SVector::<f32, 15>::zeros();
    dx[2] = (nav.position().height - truth.height) as f32;
    dx[5] = (nav.strapdown().v_n[2].wide() - truth.v_n.z) as f32;
    nav.correct(&dx).unwrap();
    twin.height = truth.height;
    twin.v_n.z = truth.v_n.z;
}

/// Navigator and twin on the same noisy samples; the widest gap of the run, looked at every second before the height
/// is put back.
fn run(trajectory: impl Trajectory, seconds: usize, errors: SensorErrors, seed: u64) -> Gap {
    let mut sim = Simulator::new(trajectory, f64::from(DT));
    let mut sensor = Sensor::new(errors, seed);
    let (mut nav, mut twin) = start(&sim.truth());
    let mut widest = Gap::default();
    for _ in 0..seconds {
        let mut last = sim.truth();
        for (truth, ideal) in sim.by_ref().take(100) {
            let imu = sensor.sample(&ideal);
            nav.advance(&imu).unwrap();
            step_twin(&mut twin, &imu);
            last = truth;
        }
        widest = widest.widest(gap(&of_nav(&nav), &of_twin(&twin)));
        hold_height(&mut nav, &mut twin, &last);
    }
    println!("{widest:?}");
    widest
}

fn beijing() -> Geodetic {
    Geodetic::from_degrees(40.0, 116.0, 100.0)
}

#[test]
fn an_hour_at_rest() {
    let g = run(
        Static::degrees(beijing(), 30.0, 2.0, 1.0),
        3600,
        SensorErrors::TACTICAL,
        1,
    );
    assert!(
        g.attitude_arcsec < 0.05 && g.v_horizontal < 1e-3 && g.v_up < 1e-3 && g.horizontal < 0.3,
        "{g:?}"
    );
}

#[test]
fn an_hour_at_rest_tilted() {
    let g = run(
        Static::degrees(beijing(), 200.0, 35.0, -50.0),
        3600,
        SensorErrors::TACTICAL,
        2,
    );
    assert!(
        g.attitude_arcsec < 0.05 && g.v_horizontal < 1e-3 && g.v_up < 1e-3 && g.horizontal < 1.0,
        "{g:?}"
    );
}

#[test]
fn an_hour_of_swing() {
    let middle = Static::degrees(beijing(), 30.0, 2.0, 1.0);
    let swing = Swing {
        middle,
        amplitude: 5.0 * DEG,
        frequency: 0.5,
    };
    let g = run(swing, 3600, SensorErrors::TACTICAL, 3);
    assert!(
        g.attitude_arcsec < 1.0 && g.v_horizontal < 2e-3 && g.v_up < 2e-3 && g.horizontal < 2.0,
        "{g:?}"
    );
}

fn climb_at(lat_deg: f64, lon_deg: f64, heading_deg: f64) -> ClimbingTurns {
    ClimbingTurns {
        start: Geodetic::from_degrees(lat_deg, lon_deg, 500.0),
        speed: 200.0,
        heading: heading_deg * DEG,
        turn_rate: 3.0 * DEG,
        climb: 3.0 * DEG,
    }
}

#[test]
fn climbing_turns() {
    for (seed, (lat, lon, heading)) in [
        (0.0, 10.0, 0.0),
        (40.0, 179.98, 80.0),
        (-65.0, -179.97, 250.0),
    ]
    .into_iter()
    .enumerate()
    {
        let g = run(
            climb_at(lat, lon, heading),
            300,
            SensorErrors::TACTICAL,
            10 + seed as u64,
        );
        assert!(
            g.attitude_arcsec < 0.5 && g.v_horizontal < 2e-3 && g.v_up < 2e-3 && g.horizontal < 0.3,
            "{g:?}"
        );
    }
}

/// The widest gap between a navigator and the truth, ideal sensor; the height is free.
fn against_truth(trajectory: impl Trajectory, seconds: f64, dt: f32) -> (Gap, Gap) {
    let mut sim = Simulator::new(trajectory, f64::from(dt));
    let (mut nav, mut twin) = start(&sim.truth());
    let mut sensor = Sensor::new(SensorErrors::NONE, 0);
    let (mut ours, mut twins) = (Gap::default(), Gap::default());
    for (truth, ideal) in sim.by_ref().take((seconds / f64::from(dt)) as usize) {
        nav.advance(&sensor.sample(&ideal)).unwrap();
        let Ideal {
            delta_theta_b,
            delta_v_b,
            dt,
        } = ideal;
        twin.step(delta_theta_b, delta_v_b, dt);
        ours = ours.widest(gap(&of_nav(&nav), &of_truth(&truth)));
        twins = twins.widest(gap(&of_twin(&twin), &of_truth(&truth)));
    }
    println!("ours {ours:?}\ntwin {twins:?}");
    (ours, twins)
}

#[test]
fn truth_of_climbing_turns() {
    against_truth(climb_at(40.0, 179.98, 80.0), 300.0, DT);
    against_truth(climb_at(40.0, 179.98, 80.0), 300.0, DT / 2.0);
}

#[test]
fn truth_of_coning() {
    let middle = Static::degrees(beijing(), 30.0, 2.0, 1.0);
    let swing = Swing {
        middle,
        amplitude: 0.5 * DEG,
        frequency: 8.0,
    };
    against_truth(Coning { swing, speed: 0.1 }, 60.0, DT);
    let swing = Swing {
        middle,
        amplitude: 5.0 * DEG,
        frequency: 0.5,
    };
    against_truth(swing, 600.0, DT);
}

#[test]
#[ignore]
fn explore_swing() {
    let middle = Static::degrees(beijing(), 30.0, 2.0, 1.0);
    for f in [0.5, 0.3717] {
        for seed in 0..6 {
            let swing = Swing {
                middle,
                amplitude: 5.0 * DEG,
                frequency: f,
            };
            run(swing, 3600, SensorErrors::TACTICAL, 300 + seed);
        }
    }
    for seed in 0..6 {
        run(
            Static::degrees(beijing(), 200.0, 35.0, -50.0),
            3600,
            SensorErrors::TACTICAL,
            200 + seed,
        );
    }
    for seed in 0..6 {
        run(
            Static::degrees(beijing(), 30.0, 2.0, 1.0),
            3600,
            SensorErrors::TACTICAL,
            200 + seed,
        );
    }
}
