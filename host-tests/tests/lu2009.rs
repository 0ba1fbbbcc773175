//! Lu 2009: the five golden configurations through the general kernel in f64 and f32, and the printed tables.

use host_tests::covariance_analysis::{run, Config, Eigen, Instant, N};
use host_tests::paper::cells::{all, Cell, Table};
use host_tests::reference::lu2009 as twin;
use serde_json::Value;

/// The project's own copy, exact to 13 digits.
const EXACT: &str = include_str!("../golden/lu2009.json");
/// The shared file, double precision.
const SHARED: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../shared/golden/lu2009.json"
);

/// f64 against numbers: relative, floor. The golden file's tolerances.
const P: (f64, f64) = (1e-7, 0.0);
const XI1: (f64, f64) = (1e-6, 1e-12);
const EIG_T: (f64, f64) = (1e-6, 1e-14);
const EIG_M: (f64, f64) = (1e-6, 1e-12);
const NU: f64 = 1e-5;
/// Vectors whose eigenvalue is closer than this to the next are planes.
const NU_GAP: f64 = 1e-3;

struct Run {
    name: String,
    case: u8,
    config: Config,
    times: Vec<f64>,
    want: Value,
}

impl Run {
    fn want(&self, t: f64) -> &Value {
        &self.want[format!("{}", t.round())]
    }
}

/// Every configuration and case of a golden file.
fn runs(text: &str) -> Vec<Run> {
    let file: Value = serde_json::from_str(text).unwrap();
    let mut runs = Vec::new();
    for (name, entry) in file["configs"].as_object().unwrap() {
        let mut cfg = entry["cfg"].clone();
        for key in ["sigma0", "constants", "nondiag_P0_corr_pairs"] {
            cfg[key] = file[key].clone();
        }
        let config: Config = serde_json::from_value(cfg).unwrap();
        for case in [1u8, 2] {
            let want = entry["cases"][case.to_string()].clone();
            let mut times: Vec<f64> = want
                .as_object()
                .unwrap()
                .keys()
                .map(|t| t.parse().unwrap())
                .collect();
            times.sort_by(f64::total_cmp);
            runs.push(Run {
                name: name.clone(),
                case,
                config: config.clone(),
                times,
                want,
            });
        }
    }
    assert_eq!(runs.len(), 10);
    runs
}

fn array(value: &Value) -> Vec<f64> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect()
}

fn some(x: &[Option<f64>; N]) -> Vec<f64> {
    x.iter().map(|x| x.unwrap()).collect()
}

/// Every element within `relative` of max(|want|, floor), plus what the numbers themselves cannot hold.
fn close(what: &str, got: &[f64], want: &[f64], tolerance: (f64, f64), resolution: &[f64]) {
    assert_eq!(got.len(), want.len(), "{what}");
    for (i, (got, want)) in got.iter().zip(want).enumerate() {
        let limit = tolerance.0 * want.abs().max(tolerance.1) + resolution[i];
        assert!(
            (got - want).abs() <= limit,
            "{what}[{i}]: {got:e}, want {want:e} ± {limit:e}"
        );
    }
}

/// The vector belonging to value k against nu (SI), in σ0 units and up to its sign.
fn close_vector(what: &str, eigen: &Eigen, k: usize, nu: &[f64], config: &Config) {
    let (mut plus, mut minus) = (0.0f64, 0.0f64);
    for ((got, nu), sigma) in eigen.vectors[k].iter().zip(nu).zip(&config.sigma0) {
        plus = plus.max((got - nu * sigma).abs());
        minus = minus.max((got + nu * sigma).abs());
    }
    assert!(plus.min(minus) <= NU, "{what}: {:e}", plus.min(minus));
}

fn f64_agrees(run: &Run, got: &Instant, xi1_resolution: &[f64], m_rounding: f64) {
    let what = format!("{}/{}/{}", run.name, run.case, got.t);
    let want = run.want(got.t);
    let exact = [0.0; N];
    let column = |key: &str| array(&want[key]);
    close(&format!("{what} P"), &got.p, &column("P"), P, &exact);
    close(
        &format!("{what} xi2"),
        &some(&got.xi2),
        &column("xi2"),
        P,
        &exact,
    );
    close(
        &format!("{what} xi1"),
        &some(&got.xi1),
        &column("xi1"),
        XI1,
        &exact,
    );
    let xi1_meas = column("xi1_meas");
    close(
        &format!("{what} xi1_meas"),
        &some(&got.xi1_meas),
        &xi1_meas,
        XI1,
        xi1_resolution,
    );
    let (accuracy, speed) = (got.accuracy.as_ref().unwrap(), got.speed.as_ref().unwrap());
    close(
        &format!("{what} eigT"),
        &accuracy.values,
        &column("eigT"),
        EIG_T,
        &exact,
    );
    // no double-precision method resolves an eigenvalue below the rounding of the largest element
    let eig_m = column("eigM");
    let size = eig_m.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let resolution = [m_rounding * f64::EPSILON * size; N];
    close(
        &format!("{what} eigM"),
        &speed.values,
        &eig_m,
        EIG_M,
        &resolution,
    );
    if want["nuT_gap"].as_f64().unwrap() > NU_GAP {
        assert_eq!(accuracy.dimensions[0], 1);
        close_vector(
            &format!("{what} nuT"),
            accuracy,
            0,
            &column("nuT_min"),
            &run.config,
        );
    }
    if want["nuM_gap"].as_f64().unwrap() > NU_GAP {
        assert_eq!(speed.dimensions[N - 1], 1);
        close_vector(
            &format!("{what} nuM"),
            speed,
            N - 1,
            &column("nuM_max"),
            &run.config,
        );
    }
}

#[test]
fn f64_is_exact() {
    for r in runs(EXACT) {
        for got in run::<f64>(&r.config, r.case, &r.times, || {}).unwrap() {
            f64_agrees(&r, &got, &[0.0; N], 1.0);
        }
    }
}

#[test]
fn f64_agrees_with_the_shared_golden_file() {
    let Ok(text) = std::fs::read_to_string(SHARED) else {
        println!("skipped: {SHARED} is not there");
        return;
    };
    for r in runs(&text) {
        for got in run::<f64>(&r.config, r.case, &r.times, || {}).unwrap() {
            // That file's ξ1 is the difference of two variances in SI units: a multiple of the last place of P, up
            // to 1.5 of them from the exact number (which ours meets in `f64_is_exact`). Its smallest eigenvalues of
            // M carry their own rounding beside ours.
            let resolution: Vec<f64> = (0..N)
                .map(|i| {
                    let last_place = got.p[i].next_up() - got.p[i];
                    2.0 * last_place / r.config.sigma0[i].powi(2) / r.config.interval
                })
                .collect();
            f64_agrees(&r, &got, &resolution, 2.0);
        }
    }
}

#[test]
fn the_dense_twin_agrees() {
    for r in runs(EXACT) {
        twin::run(&r.config, r.case, |step| {
            let want = r.want(step.t);
            if want.is_null() {
                return;
            }
            let what = format!("{}/{}/{}", r.name, r.case, step.t);
            let p: Vec<f64> = step.p.diagonal().iter().copied().collect();
            close(&what, &p, &array(&want["P"]), P, &[0.0; N]);
            let rate = twin::p_dot(step, r.config.interval);
            let xi1: Vec<f64> = (0..N)
                .map(|i| -rate[(i, i)] / r.config.sigma0[i].powi(2))
                .collect();
            close(&what, &xi1, &array(&want["xi1"]), XI1, &[0.0; N]);
        });
    }
}

#[test]
fn the_phi_angle_model_agrees_with_the_dense_twin() {
    // No golden run uses it: the twin is the only witness, so all of P is looked at through ξ2 and the eigenvalues.
    for mut r in runs(EXACT)
        .into_iter()
        .filter(|r| r.name == "best_open" || r.name == "nondiag_P0")
    {
        r.config.model = host_tests::covariance_analysis::Model::Phi;
        let ours = run::<f64>(&r.config, r.case, &r.times, || {}).unwrap();
        let mut ours = ours.iter();
        twin::run(&r.config, r.case, |step| {
            if !r.times.contains(&step.t) {
                return;
            }
            let got = ours.next().unwrap();
            let p: Vec<f64> = step.p.diagonal().iter().copied().collect();
            close("P", &got.p, &p, P, &[0.0; N]);
            let rate = twin::p_dot(step, r.config.interval);
            let xi1: Vec<f64> = (0..N)
                .map(|i| -rate[(i, i)] / r.config.sigma0[i].powi(2))
                .collect();
            close("xi1", &some(&got.xi1), &xi1, XI1, &[0.0; N]);
        });
        assert!(ours.next().is_none());
    }
}

/// Largest term of the sum that ξ1 by the Riccati equation is, per state.
fn largest_terms(config: &Config, step: &twin::Step) -> [f64; N] {
    core::array::from_fn(|i| {
        let mut largest = step.q[i];
        for j in 0..N {
            largest = largest.max((2.0 * step.f[(i, j)] * step.p[(i, j)]).abs());
        }
        for &(state, r) in &step.rows {
            largest = largest.max(step.p[(i, state)].powi(2) / (r * config.interval));
        }
        largest / config.sigma0[i].powi(2)
    })
}

#[test]
fn f32_is_within_a_tenth_of_a_percent() {
    let mut worst = [0.0f64; 3];
    for r in runs(EXACT) {
        let mut terms = Vec::new();
        twin::run(&r.config, r.case, |step| {
            if r.times.contains(&step.t) {
                terms.push(largest_terms(&r.config, step));
            }
        });
        let got = run::<f32>(&r.config, r.case, &r.times, || {}).unwrap();
        for (got, terms) in got.iter().zip(&terms) {
            let what = format!("{}/{}/{} f32", r.name, r.case, got.t);
            let want = r.want(got.t);
            let (xi2, xi1_meas, xi1) = (
                array(&want["xi2"]),
                array(&want["xi1_meas"]),
                array(&want["xi1"]),
            );
            close(
                &format!("{what} xi2"),
                &some(&got.xi2),
                &xi2,
                (1e-3, 0.0),
                &[0.0; N],
            );
            close(
                &format!("{what} xi1_meas"),
                &some(&got.xi1_meas),
                &xi1_meas,
                (1e-2, 1e-9),
                &[0.0; N],
            );
            for i in 0..N {
                let error = (got.xi1[i].unwrap() - xi1[i]).abs();
                let limit = (1e-2 * xi1[i].abs()).max(1e-3 * terms[i]);
                assert!(
                    error <= limit,
                    "{what} xi1[{i}]: {:e}, want {:e} ± {limit:e}",
                    got.xi1[i].unwrap(),
                    xi1[i]
                );
                worst[0] = worst[0].max((got.xi2[i].unwrap() / xi2[i] - 1.0).abs());
                worst[1] = worst[1]
                    .max((got.xi1_meas[i].unwrap() - xi1_meas[i]).abs() / xi1_meas[i].max(1e-9));
                worst[2] = worst[2].max(error / terms[i]);
            }
        }
    }
    println!(
        "f32, worst: ξ2 {:.1e}, exact ξ1 {:.1e}, Riccati ξ1 {:.1e} of its largest term",
        worst[0], worst[1], worst[2]
    );
}

fn listed(cells: &[Cell], table: Table) -> Vec<&Cell> {
    let cells: Vec<&Cell> = cells.iter().filter(|cell| cell.table == table).collect();
    println!("{table:?}");
    for cell in &cells {
        println!(
            "  case {} {:>7}  printed {:>11.4e}  ours {:>11.4e}  {:>+9.2} %  {}",
            cell.case,
            cell.name(),
            cell.printed,
            cell.ours,
            100.0 * cell.off(),
            cell.reason.unwrap_or("")
        );
    }
    assert_eq!(cells.len(), 30);
    cells
}

#[test]
fn tables_4_and_5_are_reproduced() {
    let cells = all().unwrap();
    let mut cells_of_both = listed(&cells, Table::Xi2);
    cells_of_both.extend(listed(&cells, Table::T));
    let within = |limit: f64| {
        cells_of_both
            .iter()
            .filter(|c| c.off().abs() <= limit)
            .count()
    };
    assert_eq!(within(0.03), 60);
    // 48 by an independent program as well; 45 is what was asked for
    assert!(within(0.01) >= 45, "{}", within(0.01));
    for cell in cells_of_both {
        assert_eq!(cell.off().abs() > 0.01, cell.reason.is_some(), "{cell:?}");
    }
}

#[test]
fn table_3_and_the_speeds_of_table_5_are_explained() {
    let cells = all().unwrap();
    for (table, within_one, within_ten) in [(Table::M, 11, 19), (Table::Xi1, 6, 19)] {
        let cells = listed(&cells, table);
        for cell in &cells {
            assert_eq!(cell.off().abs() > 0.01, cell.reason.is_some(), "{cell:?}");
        }
        // how many cells agree today: a change of the model that loses one is seen
        let within = |limit: f64| cells.iter().filter(|c| c.off().abs() <= limit).count();
        assert_eq!(
            (within(0.01), within(0.1)),
            (within_one, within_ten),
            "{table:?}"
        );
    }
}

#[test]
fn the_claims_of_the_paper() {
    let config = host_tests::paper::lu2009::config();
    let times: Vec<f64> = (300..=600).map(f64::from).collect();
    let one = run::<f64>(&config, 1, &times, || {}).unwrap();
    let two = run::<f64>(&config, 2, &times, || {}).unwrap();
    let heading = |run: &[Instant], t: usize| run[t - 300].xi2[8].unwrap();
    // Figure 2: one position creeps from 400 to 421 at 550 s, two reach 6250 there and 7000 at the end. The figures are
    // read off a plot: 2 %.
    let near = |x: f64, y: f64| assert!((x / y - 1.0).abs() < 0.02, "{x}, read {y}");
    near(heading(&one, 300), 400.0);
    near(heading(&one, 550), 421.0);
    near(heading(&two, 550), 6250.0);
    near(heading(&two, 600), 7000.0);
    // the gain is delayed: the turn by itself teaches nothing
    near(heading(&two, 303), 401.0);
    // Figure 1: the speed peaks 40 s after the turn
    let (peak, speed) = two
        .iter()
        .filter(|x| x.t > 302.0) // updates come again
        .map(|x| (x.t, x.xi1_paper[8].unwrap()))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap();
    assert_eq!(peak, 342.0);
    near(speed, 4.2e-4);
    near(one[42].xi1_paper[8].unwrap(), 6.6e-6);
    // Printed eigenvectors have Euclidean norm 1 in SI units: fastest but one of case 2 is gx, with gz.
    let speed = two[300].speed_paper.as_ref().unwrap();
    let si: Vec<f64> = (0..N)
        .map(|i| speed.vectors[N - 2][i] / config.sigma0[i])
        .collect();
    let norm = si.iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!((si[9].abs() / norm - 0.99071).abs() < 1e-3);
    assert!((si[11].abs() / norm - 0.13594).abs() < 1e-3);
    // In units of σ0 the most accurate direction of case 1 is tilt (printed in SI it looks like a gyro). It belongs to a
    // pair closer than 1e-3, so the plane is what can be told: all of it is tilt.
    let accuracy = one[300].accuracy.as_ref().unwrap();
    assert_eq!(accuracy.dimensions[0], 2);
    for k in 0..2 {
        let tilt = accuracy.vectors[k][6].hypot(accuracy.vectors[k][7]);
        assert!(tilt > 0.99, "{tilt}");
        assert!(accuracy.vectors[k][9].hypot(accuracy.vectors[k][10]) < 1e-3);
    }
}

#[test]
fn xi_stays_between_the_extreme_eigenvalues() {
    for r in runs(EXACT).into_iter().filter(|r| r.config.p0 == "paper") {
        for got in run::<f64>(&r.config, r.case, &r.times, || {}).unwrap() {
            let (t, m) = (&got.accuracy.unwrap().values, &got.speed.unwrap().values);
            let (slowest, fastest) = (m[0], m[N - 1]);
            let slack = f64::EPSILON * fastest.abs().max(slowest.abs());
            for i in 0..N {
                let (xi1, xi2) = (got.xi1[i].unwrap(), got.xi2[i].unwrap());
                assert!(slowest - slack <= xi1 && xi1 <= fastest + slack);
                // eight places for the rounding of P's factor at a condition of 1e4
                assert!(xi2 * t[N - 1] >= 1.0 - 1e-8 && xi2 * t[0] <= 1.0 + 1e-8);
            }
            // an independent prior: the traces, ten rounding errors of the largest term
            let sum: f64 = some(&got.xi1).iter().sum();
            assert!((sum - m.iter().sum::<f64>()).abs() <= 10.0 * slack);
            let sum: f64 = some(&got.xi2).iter().map(|x| 1.0 / x).sum();
            assert!((sum - t.iter().sum::<f64>()).abs() <= 1e-14 * sum);
        }
    }
}
