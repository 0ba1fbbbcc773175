//! Calls every public function of the library with values that the optimizer cannot know.

use core::hint::black_box;

use navsight::linalg::{self, Real, Two};

/// An unknown value.
fn any<T>(x: T) -> T {
    black_box(x)
}

/// Takes a result, so that its computation stays.
fn keep<T>(x: T) {
    black_box(x);
}

/// Everything.
pub fn call() {
    linalg::<f32>();
    linalg::<f64>();
    two();
}

fn linalg<T: Real>() {
    let x = T::of(any(1.0));
    keep((x.wide(), x.root(), x.finite()));
    keep(linalg::two_add(any(x), any(x), any(x)));
    keep(linalg::skew(&any(nalgebra::Vector3::repeat(x))));
}

fn two() {
    let mut two = Two::of(any(1.0));
    two.add(any(1.0));
    keep(two.wide());
}
