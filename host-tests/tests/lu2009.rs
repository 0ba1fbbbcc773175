use host_tests::covariance_analysis::*;
use host_tests::reference::lu2009 as twin;
#[test]
fn twin_golden() {
    let text = std::fs::read_to_string("../../shared/golden/lu2009.json").unwrap();
    let g: serde_json::Value = serde_json::from_str(&text).unwrap();
    for (name, c) in g["configs"].as_object().unwrap() {
        let mut cfg = c["cfg"].clone();
        for k in ["sigma0", "constants", "nondiag_P0_corr_pairs"] {
            cfg[k] = g[k].clone();
        }
        let cfg: Config = serde_json::from_value(cfg).unwrap();
        for case in [1u8, 2] {
            let mut worst = [0.0f64; 3];
            twin::run(&cfg, case, |s| {
                let want = &c["cases"][case.to_string()][(s.t.round() as u32).to_string()];
                if want.is_null() {
                    return;
                }
                let pd = twin::p_dot(s, cfg.interval);
                for i in 0..15 {
                    let p = want["P"][i].as_f64().unwrap();
                    worst[0] = worst[0].max((s.p[(i, i)] / p - 1.0).abs());
                    let p0 = cfg.sigma0[i].powi(2);
                    let x = want["xi1"][i].as_f64().unwrap();
                    worst[1] = worst[1].max((-pd[(i, i)] / p0 - x).abs() / x.abs().max(1e-12));
                    let x = want["xi1_meas"][i].as_f64().unwrap();
                    worst[2] = worst[2].max(
                        ((s.p_before[(i, i)] - s.p[(i, i)]) / p0 / cfg.interval - x).abs()
                            / x.abs().max(1e-12),
                    );
                }
            });
            println!("{name} {case} {worst:?}");
        }
    }
}
