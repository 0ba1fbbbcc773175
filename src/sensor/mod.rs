//! Where the samples come from: inertial sensors behind one trait.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | [`ImuSource`], what a program that navigates asks of a sensor |
//! | `burst` | [`Burst`]: how the bytes of one read become an [`ImuIncrement`], filled in from the data sheet |
//! | `bus` | [`SpiImu`] and [`I2cImu`], which read such a burst over embedded-hal 1.0 (feature `embedded-hal`) |
//!
//! The library knows no device: setting ranges, rates and filters of the sensor is the program's own business, done
//! over the same bus before (or through `bus_mut`). A maintained driver for the part is as good a source: give its type
//! an `impl ImuSource` of a few lines, with [`ImuIncrement::from_rates`] and the typed frames of [`crate::attitude`].
//!
//! ```
//! use navsight::sensor::{Axes, Axis, Burst, Triad, Word};
//!
//! // A six-axis part with its data sheet open: 12 bytes from register 0x1f, accelerometer first, big-endian words of
//! // 16 bits, ±4 g and ±500 °/s; bit 7 of the address asks for a read over SPI. Its x axis points forward and its
//! // y axis to the left, so right is −y.
//! const G: f32 = 9.80665;
//! let axes = Axes { right: Axis::MinusY, forward: Axis::X, up: Axis::Z };
//! let burst = Burst::<12>::new(
//!     &[0x1f | 0x80],
//!     Triad { first: [6, 8, 10], word: Word::I16Be, scale: (1.0f32 / 65.5).to_radians(), axes },
//!     Triad { first: [0, 2, 4], word: Word::I16Be, scale: G / 8192.0, axes },
//!     None,
//! )?;
//! // (12 bytes arrive)
//! let bytes = [0x00, 0x00, 0xe0, 0x00, 0x20, 0x00, 0x00, 0x83, 0x00, 0x00, 0x00, 0x00];
//! let sample = burst.decode(&bytes, 0.01).unwrap();
//! assert!((sample.delta_v_b.x - 0.0980665).abs() < 1e-6); // 1 g to the right over 10 ms
//! assert!((sample.delta_v_b.z - 0.0980665).abs() < 1e-6); // 1 g up
//! assert!((sample.delta_theta_b.y - 0.02f32.to_radians()).abs() < 1e-6); // 2 °/s about forward
//! # Ok::<(), navsight::error::Error>(())
//! ```

mod burst;
#[cfg(feature = "embedded-hal")]
mod bus;

pub use burst::{Axes, Axis, Burst, Fault, Ready, Triad, Word};
#[cfg(feature = "embedded-hal")]
pub use bus::{BusFault, I2cImu, SpiImu};

use crate::imu::ImuIncrement;

/// A source of inertial samples.
pub trait ImuSource {
    /// Why there was no sample.
    type Error: core::fmt::Debug;

    /// The sample that ends now. `dt` is the time since the one before by the program's clock [s], best taken from the
    /// interrupt that announced the data; a source with a clock of its own may put its own time into the sample.
    ///
    /// Nothing is judged here but whether there is data: the filter checks every sample at its door.
    fn sample(&mut self, dt: f32) -> Result<ImuIncrement, Self::Error>;
}
