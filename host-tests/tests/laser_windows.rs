//! Coarse window, then the filter, from 18 starts along one recording of a vehicle that people and wind disturb: the
//! filter ends at the same heading from every one of them, after ten minutes in all or what is left of the recording:
//! with the samples of the window used again, and with the window for the start alone.
//!
//! Reads `../shared/data/laser_static/imu.csv` beside the repository; says so and passes where it is not there.
#![cfg(not(target_os = "none"))]

use std::path::Path;

use host_tests::config::Config;
use host_tests::input::ImuReader;
use nalgebra::Vector3;
use navsight::alignment::standing::{Progress, StandingAlignment};
use navsight::earth::Geodetic;
use navsight::error_model::ATT;
use navsight::imu::ImuIncrement;
use rayon::prelude::*;

#[test]
fn the_filter_ends_at_one_heading_from_18_starts() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/laser_static/imu.csv");
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
        return;
    }
    let samples: Vec<(f64, ImuIncrement)> = ImuReader::open(&path)
        .unwrap()
        .map(|sample| {
            let s = sample.unwrap();
            let imu = ImuIncrement {
                delta_theta_b: Vector3::from(s.delta_theta).cast(),
                delta_v_b: Vector3::from(s.delta_v).cast(),
                dt: s.dt as f32,
            };
            (s.t, imu)
        })
        .collect();
    let again = ends::<64>(&samples);
    let once = ends::<0>(&samples);
    for (&(from, coarse, heading, sigma), &(_, _, plain, plain_sigma)) in again.iter().zip(&once) {
        println!(
            "{from:5} s: coarse {coarse:.3}°, window again {heading:.3}° ± {sigma:.3}°, once {plain:.3}° ± {plain_sigma:.3}°"
        );
    }
    for (k, (&(from, _, heading, sigma), &(_, _, plain, plain_sigma))) in
        again.iter().zip(&once).enumerate()
    {
        // All starts share the sensor's bias, so their spread is far below σ: 0.02° was measured. The last has 147 s and may
        // use its σ.
        for (heading, sigma) in [(heading, sigma), (plain, plain_sigma)] {
            let tolerance = if k < 17 { 0.06 } else { 3.0 * sigma };
            assert!((heading - 90.59).abs() <= tolerance, "{from}: {heading}");
            assert!(sigma < 0.3);
        }
        // A minute more is known.
        assert!(sigma < plain_sigma);
    }
    // Of 147 s the window is the larger part of what there is to know beside the bias, 0.092°.
    let (_, _, _, sigma) = again[17];
    assert!(sigma < 0.75 * once[17].3, "{sigma}");
}

/// From each start: when, coarse heading, heading of the filter and its σ [°].
fn ends<const K: usize>(samples: &[(f64, ImuIncrement)]) -> Vec<(f64, f32, f32, f32)> {
    let at = Geodetic::from_degrees(34.246048, 0.0, 380.0);
    let config = Config::default();
    (0..18)
        .into_par_iter()
        .map(|k| {
            let from = 100.0 * f64::from(k);
            let (plan, settings) = (config.plan().unwrap(), config.settings().unwrap());
            let mut alignment =
                StandingAlignment::<K>::reusing(at, plan, config.prior(at.lat), settings).unwrap();
            let mut coarse = f32::NAN;
            for (_, imu) in samples
                .iter()
                .filter(|(t, _)| (from..from + 600.0).contains(t))
            {
                if let Progress::Started(found) = alignment.take(imu).unwrap() {
                    coarse = found.euler().heading;
                }
            }
            assert!(!alignment.is_behind());
            let filter = alignment.filter().unwrap();
            let heading = filter.nav().euler().heading;
            let sigma = filter.sigma(ATT + 2).unwrap();
            (
                from,
                coarse.to_degrees(),
                heading.to_degrees(),
                sigma.to_degrees(),
            )
        })
        .collect()
}
