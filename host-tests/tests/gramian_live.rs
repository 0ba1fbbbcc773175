//! The Gramian beside a running filter: structure, eigenvalues and ξ2 of the same minutes.

use host_tests::sim::navigation_grade;
use navsight::attitude::Euler;
use navsight::earth::Geodetic;
use navsight::error_model::{psi, NoiseDensity, ATT, BG, N, POS, VEL};
use navsight::filter::{Filter, Settings};
use navsight::imu::ImuIncrement;
use navsight::measurement::ZeroVelocity;
use navsight::nav::NavState;
use navsight::observability::ceiling::{ceiling, Gramian, Unseen};
use navsight::observability::diagonal::Xi;
use navsight::observability::pwcs::{Scale, Staged, NAVIGATION};

use nalgebra::{SMatrix, SVector, Vector3};

/// A filter at rest, the Gramian that watched it, and the last ξ2.
struct Watched {
    filter: Filter,
    gramian: Gramian<f32, N>,
    xi2: [f32; N],
}

/// At rest with perfect increments and no process noise: the case in which filter and Gramian hold the same information.
fn watched() -> Watched {
    let (plan, prior, settings) = navigation_grade();
    let nav = NavState::new(
        Geodetic::from_degrees(40.0, 10.0, 100.0),
        Vector3::zeros(),
        Euler::from_degrees(20.0, 1.0, -2.0),
    )
    .unwrap();
    let settings = Settings {
        noise: NoiseDensity::zero(),
        ..settings
    };
    Watched {
        filter: Filter::new(nav, &prior, settings).unwrap(),
        gramian: Gramian::new(),
        xi2: [1.0; N],
    }
    .run(600, &plan.zero_velocity)
}

impl Watched {
    fn run(mut self, seconds: u32, standing: &ZeroVelocity) -> Self {
        for _ in 0..seconds {
            for _ in 0..10 {
                let nav = self.filter.nav();
                let b_n = nav.c_b_n().transpose();
                let imu = ImuIncrement::from_rates(
                    b_n * nav.local().omega_ie_n(),
                    b_n * Vector3::new(0.0, 0.0, nav.local().gravity),
                    0.1,
                );
                let gramian = &mut self.gramian;
                self.filter
                    .propagate_watched(&imu, |t| gramian.propagate(&t.dense()))
                    .unwrap();
            }
            let gramian = &mut self.gramian;
            self.filter
                .synchronize_watched(|t| gramian.propagate(&t.dense()));
            let measurement = standing.linearize(self.filter.nav());
            let report = self.filter.update(&measurement).unwrap();
            self.gramian
                .observe_update(&measurement, &report, self.filter.sigma0());
            let xi = Xi::of(&report).unwrap();
            self.xi2 = core::array::from_fn(|i| xi.xi2.get(i).unwrap());
        }
        self
    }
}

#[test]
fn without_process_noise_the_gramian_and_the_filter_hold_the_same_information() {
    let Watched { gramian, xi2, .. } = watched();
    assert_eq!(gramian.rows(), 3 * 600);
    let expected = gramian.xi2(&gramian.information());
    for (state, (ours, gramian)) in xi2.iter().zip(&expected).enumerate() {
        // The triangle of 1800 rows in f32: √1800 roundings of 6e-8 in each number, squared and times the spread of the
        // eigenvalues that one state mixes, some 1e3.
        let off = (ours / gramian - 1.0).abs();
        assert!(off < 0.01, "state {state}: {ours} beside {gramian}");
    }
}

#[test]
fn the_live_gramian_shows_the_ceiling_that_the_elimination_predicts() {
    let Watched {
        filter,
        gramian,
        xi2,
    } = watched();
    let nav = filter.nav();
    let f = psi::f_matrix(
        &filter.environment(),
        &nav.c_b_n(),
        &Vector3::new(0.0, 0.0, nav.local().gravity),
        &filter.settings().bias,
    );
    let mut h = SMatrix::<f32, 3, N>::zeros();
    h.fixed_view_mut::<3, 3>(0, VEL).fill_diagonal(-1.0);
    let sigma = SVector::from(*filter.sigma0());
    let mut staged = Staged::<f32, N, 3>::new(&Scale::canonical(&NAVIGATION, &sigma, 9.8)).unwrap();
    staged.segment(&f, &h, None).unwrap();
    assert_eq!(staged.rank(), 9);
    let information = gramian.information();
    assert!(information.converged);
    // Nine directions carry information, the last of them a fifth of what the prior holds (its order needs more than ten
    // minutes). The tenth is what ten minutes of earth rate and curvature turn the unseen space: a hundredth of that.
    let (ninth, tenth) = (information.lambda[8], information.lambda[9]);
    assert!(ninth > 0.1 && tenth < 0.01, "{:?}", information.lambda);
    let share = Unseen::of(&staged).shares();
    for (state, (xi2, share)) in xi2.iter().zip(&share).enumerate() {
        if let Some(ceiling) = ceiling(*share) {
            // 3 % for the rates at which attitude and position turn the unseen space within ten minutes.
            assert!(
                *xi2 < 1.03 * ceiling,
                "state {state}: {xi2} above {ceiling}"
            );
        }
    }
    // Position is not seen at all, heading up to the east gyro, and the east gyro not.
    assert!((xi2[POS] - 1.0).abs() < 0.05);
    let heading = ceiling(share[ATT + 2]).unwrap();
    assert!(
        xi2[ATT + 2] > 0.5 * heading,
        "{} of {heading}",
        xi2[ATT + 2]
    );
    let gyros: Vec<f32> = (BG..BG + 3).map(|i| xi2[i]).collect();
    assert!(gyros.iter().any(|xi2| *xi2 < 1.3), "{gyros:?}");
}
