//! Φ, U and Q of the 'current' model against their integrals, and in single precision against double.

use host_tests::tracking::scenario::Noise;
use nalgebra::Matrix3;
use navsight::linalg::Real;
use navsight::tracking::Transition;

/// Column 3 of Φ at s, from its definition: what a unit of acceleration now makes of position, velocity and itself.
/// Series where the closed forms cancel.
fn column(s: f64, tau: f64) -> [f64; 3] {
    let x = s / tau;
    let phi = |k: u32| -> f64 {
        if x < 0.5 {
            let first = (1..=k).fold(1.0, |y, n| y / f64::from(n));
            let next = |(term, n): &(f64, f64)| Some((term * -x / (n + 1.0), n + 1.0));
            std::iter::successors(Some((first, f64::from(k))), next)
                .take(25)
                .map(|(term, _)| term)
                .sum()
        } else {
            (0..k).fold((-x).exp(), |y, n| {
                let inverse = (1..=n).fold(1.0, |y, m| y / f64::from(m));
                (inverse - y) / x
            })
        }
    };
    [s * s * phi(2), s * phi(1), phi(0)]
}

/// ∫₀ᵀ gᵢ gⱼ ds with g = column 3: positive terms only, so nothing cancels. Gauss-Legendre of order 5 on 64 parts.
fn noise(t: f64, tau: f64) -> [f64; 6] {
    const NODES: [(f64, f64); 5] = [
        (0.0, 0.568_888_888_888_888_9),
        (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
        (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
        (0.906_179_845_938_664, 0.236_926_885_056_189_08),
        (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    ];
    const PARTS: usize = 64;
    let half = 0.5 * t / PARTS as f64;
    let mut q = [0.0; 6];
    for part in 0..PARTS {
        for (node, weight) in NODES {
            let g = column(half * (2.0 * part as f64 + 1.0 + node), tau);
            let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
            for (q, (i, j)) in q.iter_mut().zip(pairs) {
                *q += weight * half * g[i] * g[j];
            }
        }
    }
    q
}

fn worst(got: &[f64], want: &[f64]) -> f64 {
    got.iter()
        .zip(want)
        .map(|(g, w)| (g / w - 1.0).abs())
        .fold(0.0, f64::max)
}

/// T/τ from 1e-6 to 10 on a grid of 141, close to the seam, and 4000 at random with T from 0.01 to 20.
fn cases() -> Vec<(f64, f64)> {
    let mut noise = Noise::new(5);
    let mut all: Vec<(f64, f64)> = (0..=140)
        .map(|i| (1.0, 10f64.powf(-6.0 + f64::from(i) / 20.0)))
        .collect();
    all.extend([1.4999, 1.499_999_9, 1.5, 1.500_000_1, 1.5001].map(|x| (1.0, x)));
    all.extend((0..4000).map(|_| {
        let x = 10f64.powf(-6.0 + 7.0 * noise.uniform());
        (0.01 * 2000f64.powf(noise.uniform()), x)
    }));
    all
}

#[test]
fn double_precision_is_the_integral() {
    for (t, x) in cases().into_iter().take(400) {
        let (tau, got) = (t / x, Transition::new(t, t / x).unwrap());
        let q = worst(&got.q, &noise(t, tau));
        // closed forms above the seam lose two digits of 16, the quadrature has 13
        assert!(q < 2e-12, "T {t}, T/τ {x}: {q}");
        let [phi13, phi23, phi33] = column(t, tau);
        assert!(worst(&got.phi[..2], &[phi13, phi23]) < 1e-13, "{x}");
        assert!((got.phi[2] + 1.0 - phi33).abs() < 1e-15);
        // U: the rest to Newton's matrix, checked where that difference has digits
        if x > 0.1 {
            let u = [0.5 * t * t - phi13, t - phi23, 1.0 - phi33];
            assert!(worst(&got.u, &u) < 1e-11, "{x}");
        }
    }
}

#[test]
fn single_precision() {
    let (mut q, mut rest) = ((0.0, 0.0), 0.0f64);
    for (t, x) in cases() {
        let (t, tau) = (t as f32, (t / x) as f32);
        let got = Transition::new(t, tau).unwrap();
        let want = Transition::new(t.wide(), tau.wide()).unwrap();
        let d = worst(&got.q.map(Real::wide), &want.q);
        if d > q.0 {
            q = (d, x);
        }
        rest = rest.max(worst(&got.phi.map(Real::wide), &want.phi));
        rest = rest.max(worst(&got.u.map(Real::wide), &want.u));
        // positive definite: leading minors of the scaled matrix
        let [a, b, c, d, e, f] = got.q.map(Real::wide);
        let m = Matrix3::new(a, b, c, b, d, e, c, e, f);
        let scale = m.diagonal().map(|d| 1.0 / d.sqrt());
        let scaled = Matrix3::from_diagonal(&scale) * m * Matrix3::from_diagonal(&scale);
        assert!(scaled.cholesky().is_some(), "T {t}, T/τ {x}");
    }
    println!("Q {:.1e} at T/τ = {:.2e}, Φ and U {rest:.1e}", q.0, q.1);
    assert!(q.0 <= 2e-6, "{q:?}");
    assert!(rest <= 1e-6, "{rest}");
}
