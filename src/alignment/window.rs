//! The samples of a coarse window, kept as sums so that the filter can use them again.
//!
//! A sum is the interval of an update long. When the store is full while the window is still open, neighbours are added up
//! and the sums are twice as long: any window fits, with fewer updates. What is kept of a sum is the even motion that leads
//! to the same turn and the same velocity: coning and sculling within it, which on a vehicle that people board are many
//! times what a good gyro drifts by, are in it.

use heapless::Vec;
use nalgebra::Vector3;

use super::inertial::InertialFrame;
use crate::imu::ImuIncrement;
use crate::linalg::{cross, minus, plus, scaled, Two};

/// Samples summed up.
#[derive(Clone, Debug)]
struct Sum {
    frame: InertialFrame,
    /// ∫ f dt in the body frame in which the sum began [m/s].
    v: [Two; 3],
    dt: Two,
}

impl Sum {
    #[inline(always)]
    fn new() -> Self {
        let zero = Two { hi: 0.0, lo: 0.0 };
        Self {
            frame: InertialFrame::new(),
            v: [zero; 3],
            dt: zero,
        }
    }

    fn add(&mut self, imu: &ImuIncrement) {
        let delta_v = self.frame.take(imu);
        let [x, y, z] = &mut self.v;
        x.add(delta_v.x);
        y.add(delta_v.y);
        z.add(delta_v.z);
        self.dt.add(imu.dt);
    }

    /// ∫ f dt so far.
    fn velocity(&self) -> Vector3<f32> {
        let [x, y, z] = self.v;
        Vector3::new(x.hi, y.hi, z.hi)
    }

    /// What has been summed up, as increments of an even motion; the next sum begins.
    fn close(&mut self) -> ImuIncrement {
        let closed = even(self.frame.turned(), self.velocity(), self.dt.hi);
        self.frame.restart();
        self.v = [Two::default(); 3];
        self.dt = Two::default();
        closed
    }
}

/// The even motion of this time that turns by φ and leads to the velocity v in the frame it began in.
fn even(phi: Vector3<f32>, v: Vector3<f32>, dt: f32) -> ImuIncrement {
    // v = (I + ½[φ×] + ⅙[φ×]²) f dt; its inverse to the same order
    let half = cross(&phi, &v);
    ImuIncrement {
        delta_theta_b: phi,
        delta_v_b: plus(
            &minus(&v, &scaled(&half, 0.5)),
            &scaled(&cross(&phi, &half), 1.0 / 12.0),
        ),
        dt,
    }
}

/// Two even motions, one after the other, as one.
fn joined(a: &ImuIncrement, b: &ImuIncrement) -> ImuIncrement {
    // begun anew for each, or it would be taken for coning that they lie side by side
    let (mut first, mut second) = (Sum::new(), Sum::new());
    first.add(a);
    second.add(b);
    let (phi, phi_b) = (first.frame.turned(), second.frame.turned());
    let v_b = second.velocity();
    let once = cross(&phi, &v_b);
    let twice = scaled(&cross(&phi, &once), 0.5);
    even(
        plus(&plus(&phi, &phi_b), &scaled(&cross(&phi, &phi_b), 0.5)),
        plus(&first.velocity(), &plus(&plus(&v_b, &once), &twice)),
        a.dt + b.dt,
    )
}

/// A queue of K sums, and the one that is still open. K = 0 keeps nothing.
#[derive(Clone, Debug)]
pub(super) struct Window<const K: usize> {
    /// Length of a sum [s].
    length: f32,
    sums: Vec<ImuIncrement, K>,
    /// Place of the oldest, and how many there are.
    first: usize,
    count: usize,
    open: Sum,
}

impl<const K: usize> Window<K> {
    /// Empty; sums of this length [s].
    #[inline(always)]
    pub fn new(length: f32) -> Self {
        Self {
            length,
            sums: Vec::new(),
            first: 0,
            count: 0,
            open: Sum::new(),
        }
    }

    /// Adds a sample.
    pub fn add(&mut self, imu: &ImuIncrement) {
        if K == 0 {
            return;
        }
        self.open.add(imu);
        // Half a sample early rather than half a sample late, whatever the rounding of the sum.
        if self.open.dt.hi + 0.5 * imu.dt < self.length {
            return;
        }
        if self.count >= K {
            self.thin();
            if self.open.dt.hi + 0.5 * imu.dt < self.length {
                return;
            }
        }
        let sum = self.open.close();
        let place = match self.first + self.count {
            place if place >= K => place - K,
            place => place,
        };
        match self.sums.get_mut(place) {
            Some(old) => *old = sum,
            None => {
                // the places are filled one after the other
                let _ = self.sums.push(sum);
            }
        }
        self.count += 1;
    }

    /// Begins anew, with sums of this length [s].
    pub fn clear(&mut self, length: f32) {
        self.length = length;
        self.sums.clear();
        (self.first, self.count) = (0, 0);
        self.open = Sum::new();
    }

    /// Adds up neighbours. The oldest is in the first place as long as nothing has been taken out.
    #[inline(never)] // so that a sample has none of its stack
    fn thin(&mut self) {
        let half = self.sums.len() / 2;
        let odd = self.sums.len() > 2 * half;
        for k in 0..half {
            if let Some([a, b]) = self.sums.get(2 * k..2 * k + 2) {
                let pair = joined(a, b);
                self.put(k, pair);
            }
        }
        if let (true, Some(left)) = (odd, self.sums.last()) {
            // an odd one at the end: with the open sum, which is full, it makes a pair
            let pair = joined(left, &self.open.close());
            self.put(half, pair);
        }
        self.count = half + usize::from(odd);
        self.sums.truncate(self.count);
        self.first = 0;
        self.length *= 2.0;
    }

    /// Where there is a sum already.
    fn put(&mut self, place: usize, sum: ImuIncrement) {
        if let Some(to) = self.sums.get_mut(place) {
            *to = sum;
        }
    }

    /// Closed sums.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Takes out the oldest sum.
    pub fn pop(&mut self) -> Option<ImuIncrement> {
        if self.count == 0 {
            return None;
        }
        let sum = self.sums.get(self.first).copied();
        self.first = if self.first + 1 < K {
            self.first + 1
        } else {
            0
        };
        self.count -= 1;
        sum
    }

    /// Takes out what is in the open sum.
    pub fn pop_open(&mut self) -> Option<ImuIncrement> {
        (self.open.dt.hi > 0.0).then(|| self.open.close())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers along one axis, where turn and velocity simply add up.
    fn sample(k: u16) -> ImuIncrement {
        let x = f32::from(k);
        ImuIncrement {
            delta_theta_b: Vector3::new(x / 1024.0, 0.0, 0.0),
            delta_v_b: Vector3::new(x, 0.0, 0.0),
            dt: 0.25,
        }
    }

    /// All that is in it, oldest first: (Σ of the numbers, seconds).
    fn empty<const K: usize>(window: &mut Window<K>) -> Vec<(f32, f32), 16> {
        let mut out = Vec::new();
        loop {
            let Some(sum) = window.pop().or_else(|| window.pop_open()) else {
                return out;
            };
            assert!((sum.delta_theta_b.x * 1024.0 - sum.delta_v_b.x).abs() < 1e-3);
            out.push((sum.delta_v_b.x, sum.dt)).unwrap();
        }
    }

    /// A cone of 5 mrad at 2 Hz drifts by ½ θ² ω, 0.16 mrad a second, which plain sums do not show.
    #[test]
    fn coning_within_a_sum_is_in_it() {
        let (theta, omega, dt) = (5e-3f32, 4.0 * core::f32::consts::PI, 0.01f32);
        let at = |t: f32| {
            let (sin, cos) = libm::sincosf(omega * t);
            Vector3::new(cos, sin, 0.0) * theta
        };
        let cone = (0..400u16).map(|k| {
            let t = f32::from(k) * dt;
            ImuIncrement {
                delta_theta_b: at(t + dt) - at(t),
                delta_v_b: Vector3::new(0.0, 0.0, 9.8 * dt),
                dt,
            }
        });
        let drift = 0.5 * theta * theta * omega;
        let mut window = Window::<8>::new(1.0);
        cone.clone().for_each(|imu| window.add(&imu));
        while let Some(sum) = window.pop() {
            assert!((sum.delta_theta_b.z / drift - 1.0).abs() < 0.02, "{sum:?}");
        }
        // Joined, it is all still there.
        let mut window = Window::<2>::new(1.0);
        cone.for_each(|imu| window.add(&imu));
        let total: f32 = core::iter::from_fn(|| window.pop().or_else(|| window.pop_open()))
            .map(|sum| sum.delta_theta_b.z)
            .sum();
        assert!((total / (4.0 * drift) - 1.0).abs() < 0.02);
    }

    #[test]
    fn sums_come_out_in_order_and_grow_when_there_is_no_room() {
        let mut window = Window::<4>::new(0.5);
        (1..=7).for_each(|k| window.add(&sample(k)));
        assert_eq!(
            empty(&mut window),
            [(3.0, 0.5), (7.0, 0.5), (11.0, 0.5), (7.0, 0.25)]
        );
        // Ten come in while two are there: at the fifth sum neighbours become one.
        let mut window = Window::<4>::new(0.5);
        (1..=11).for_each(|k| window.add(&sample(k)));
        assert_eq!(empty(&mut window), [(10.0, 1.0), (26.0, 1.0), (30.0, 0.75)]);
        // An odd store: what is left over begins the next sum.
        let mut window = Window::<3>::new(0.5);
        (1..=8).for_each(|k| window.add(&sample(k)));
        assert_eq!(empty(&mut window), [(10.0, 1.0), (26.0, 1.0)]);
        // Round and round, without growing.
        let mut window = Window::<3>::new(0.5);
        for k in 0..20 {
            window.add(&sample(2 * k));
            window.add(&sample(2 * k + 1));
            assert_eq!(window.pop().unwrap().delta_v_b.x, f32::from(4 * k + 1));
        }
        let mut none = Window::<0>::new(0.5);
        (1..=7).for_each(|k| none.add(&sample(k)));
        assert!(none.pop().is_none() && none.pop_open().is_none());
    }
}
