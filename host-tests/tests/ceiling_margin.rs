//! Why ξ2 of the tilts and the level accelerometers stands 13 to 19 % above the ceiling of one position in a recording of a
//! standing vehicle: people who board it tilt it by some milliradians, and a second position teaches what one cannot. The
//! rest, 3 %, is re-linearisation.
//!
//! Reads `../shared/data/laser_static/imu.csv` beside the repository; says so and passes where it is not there.
#![cfg(not(target_os = "none"))]

use std::path::Path;

use host_tests::config::Config;
use host_tests::input::ImuReader;
use nalgebra::Vector3;
use navsight::alignment::standing::{Progress, StandingAlignment};
use navsight::earth::Geodetic;
use navsight::error_model::{ATT, BA};
use navsight::filter::Filter;
use navsight::imu::ImuIncrement;
use navsight::observability::ceiling::{tilt_excess, MARGIN};

const GRAVITY: f32 = 9.796;

/// ξ2 of the tilts and the level accelerometers over the ceiling of one position, less one. Tilt and bias hide behind each
/// other: 1/s = 1 + (σ_tilt g/σ_a)² and 1 + (σ_a/σ_tilt g)².
fn above(filter: &Filter) -> [f32; 4] {
    let s0 = filter.sigma0();
    let ratio = (s0[ATT] * GRAVITY / s0[BA]).powi(2);
    [
        (ATT, ratio),
        (ATT + 1, ratio),
        (BA, ratio.recip()),
        (BA + 1, ratio.recip()),
    ]
    .map(|(i, ratio)| 1.0 / filter.covariance().variance(i) / (1.0 + ratio) - 1.0)
}

#[test]
fn a_vehicle_that_people_tilt_is_in_more_than_one_position() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/laser_static/imu.csv");
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
        return;
    }
    let samples: Vec<ImuIncrement> = ImuReader::open(&path)
        .unwrap()
        .map(|sample| {
            let s = sample.unwrap();
            ImuIncrement {
                delta_theta_b: Vector3::from(s.delta_theta).cast(),
                delta_v_b: Vector3::from(s.delta_v).cast(),
                dt: s.dt as f32,
            }
        })
        .collect();
    let mean = |of: fn(&ImuIncrement) -> Vector3<f32>| {
        let sum: Vector3<f64> = samples.iter().map(|s| of(s).cast::<f64>()).sum();
        (sum / samples.len() as f64).cast::<f32>()
    };
    let even = (mean(|s| s.delta_theta_b), mean(|s| s.delta_v_b));
    let at = Geodetic::from_degrees(34.246048, 0.0, 380.0);
    let config = Config::default();
    let (plan, settings) = (config.plan().unwrap(), config.settings().unwrap());
    let mut closed = StandingAlignment::new(at, plan, config.prior(at.lat), settings).unwrap();
    // Filters whose innovations are nothing: no correction, so nothing is linearised anew. One of a vehicle that does not
    // move at all, one that turns as the gyros say and feels gravity alone, one that feels what was recorded.
    let mut others: Option<[Filter; 3]> = None;
    let (mut first, mut tilts) = (Vector3::zeros(), Vec::new());
    for imu in &samples {
        let progress = closed.take(imu).unwrap();
        let Some(filter) = closed.filter() else {
            continue;
        };
        let up = filter.nav().c_b_n().row(2).transpose();
        let Some(others) = &mut others else {
            others = Some([filter.clone(), filter.clone(), filter.clone()]);
            first = up;
            continue;
        };
        let [still, tilting, recorded] = others;
        let up_b = tilting.nav().c_b_n().row(2).transpose();
        for (filter, delta_theta_b, delta_v_b) in [
            (&mut *still, even.0, even.1),
            (&mut *tilting, imu.delta_theta_b, up_b * (GRAVITY * imu.dt)),
            (&mut *recorded, imu.delta_theta_b, imu.delta_v_b),
        ] {
            let imu = ImuIncrement {
                delta_theta_b,
                delta_v_b,
                dt: imu.dt,
            };
            filter.propagate(&imu).unwrap();
        }
        if let Progress::Updated(_) = progress {
            tilts.push(up - first);
            for filter in [still, tilting, recorded] {
                let mut nothing = plan.zero_velocity.linearize(filter.nav());
                nothing.nu = Vector3::zeros();
                filter.update(&nothing).unwrap();
            }
        }
    }
    let n = tilts.len() as f32;
    let middle = tilts.iter().sum::<Vector3<f32>>() / n;
    let spread = (tilts
        .iter()
        .map(|t| (t - middle).norm_squared())
        .sum::<f32>()
        / n)
        .sqrt();
    let largest = tilts.iter().map(|t| t.norm()).fold(0.0, f32::max);
    let closed = above(closed.filter().unwrap());
    let [still, tilting, recorded] = others.unwrap().map(|filter| above(&filter));
    let (bias, walk) = (config.sensor.accel_bias(), config.sensor.velocity_walk());
    let excess = |tilt| tilt_excess(tilt, bias as f32, walk as f32, n);
    println!(
        "tilt: {:.2} mrad rms, at most {:.2}",
        1e3 * spread,
        1e3 * largest
    );
    println!("above the ceiling: still {still:.4?}, tilting {tilting:.3?}, recorded {recorded:.3?}, closed loop {closed:.3?}");
    println!(
        "expected of the tilt {:.3}, of the largest {:.3}",
        excess(spread),
        excess(largest)
    );
    for k in 0..4 {
        // At the ceiling, from below but for what half an hour turns the earth by.
        assert!(still[k].abs() < 0.005);
        // The tilt alone does it; the shaking of the specific force adds or takes little.
        assert!((0.05..0.2).contains(&tilting[k]));
        assert!((recorded[k] - tilting[k]).abs() < 0.04);
        // Re-linearisation is within the margin.
        assert!((0.0..MARGIN as f32).contains(&(closed[k] - recorded[k])));
        // The rule of thumb, and that it gives the ceilings up in time.
        assert!((1.0..6.0).contains(&(excess(spread) / recorded[k])));
    }
    assert!(excess(largest) > MARGIN as f32);
}
