//! A read of consecutive registers, and how its bytes become a sample.

use nalgebra::Vector3;

use crate::error::Error;
use crate::imu::ImuIncrement;

/// How a number is laid out in the burst: two's complement, most (`Be`) or least (`Le`) significant byte first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Word {
    /// 16 bits, big-endian
    I16Be,
    /// 16 bits, little-endian
    I16Le,
    /// 24 bits, big-endian
    I24Be,
    /// 24 bits, little-endian
    I24Le,
    /// 32 bits, big-endian
    I32Be,
    /// 32 bits, little-endian
    I32Le,
}

impl Word {
    /// Length in bytes.
    pub const fn bytes(self) -> usize {
        match self {
            Self::I16Be | Self::I16Le => 2,
            Self::I24Be | Self::I24Le => 3,
            Self::I32Be | Self::I32Le => 4,
        }
    }

    /// The number that starts at byte `first`, shifted to the top of 32 bits; None beyond the end.
    fn read(self, bytes: &[u8], first: usize) -> Option<i32> {
        let at = |k: usize| bytes.get(first.checked_add(k)?).copied();
        let top = match self {
            Self::I16Be => [at(0)?, at(1)?, 0, 0],
            Self::I16Le => [at(1)?, at(0)?, 0, 0],
            Self::I24Be => [at(0)?, at(1)?, at(2)?, 0],
            Self::I24Le => [at(2)?, at(1)?, at(0)?, 0],
            Self::I32Be => [at(0)?, at(1)?, at(2)?, at(3)?],
            Self::I32Le => [at(3)?, at(2)?, at(1)?, at(0)?],
        };
        Some(i32::from_be_bytes(top))
    }

    /// Bits that a number shifted to the top of 32 has below its last place.
    const fn shift(self) -> u32 {
        32 - 8 * self.bytes() as u32
    }
}

/// An axis of the sensor, as printed on its package.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Axis {
    /// +x
    X,
    /// −x
    MinusX,
    /// +y
    Y,
    /// −y
    MinusY,
    /// +z
    Z,
    /// −z
    MinusZ,
}

impl Axis {
    fn of(self, v: &Vector3<f32>) -> f32 {
        match self {
            Self::X => v.x,
            Self::MinusX => -v.x,
            Self::Y => v.y,
            Self::MinusY => -v.y,
            Self::Z => v.z,
            Self::MinusZ => -v.z,
        }
    }
}

/// Which axis of the sensor points right, forward and up in the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Axes {
    /// Sensor axis that points to the right
    pub right: Axis,
    /// Sensor axis that points forward
    pub forward: Axis,
    /// Sensor axis that points up
    pub up: Axis,
}

impl Axes {
    /// A sensor whose x points right, y forward and z up.
    pub const RFU: Self = Self {
        right: Axis::X,
        forward: Axis::Y,
        up: Axis::Z,
    };
    /// A sensor whose x points forward, y right and z down.
    pub const FRD: Self = Self {
        right: Axis::Y,
        forward: Axis::X,
        up: Axis::MinusZ,
    };
    /// A sensor whose x points forward, y left and z up.
    pub const FLU: Self = Self {
        right: Axis::MinusY,
        forward: Axis::X,
        up: Axis::Z,
    };

    fn map(&self, v: &Vector3<f32>) -> Vector3<f32> {
        Vector3::new(self.right.of(v), self.forward.of(v), self.up.of(v))
    }

    /// Three different axes, of a right-handed sensor.
    fn is_rotation(&self) -> bool {
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()].map(|v| self.map(&v));
        x.dot(&y.cross(&z)) == 1.0 // the determinant of three unit vectors: −1, 0 or 1
    }
}

/// Three numbers of one kind in the burst.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Triad {
    /// Where x, y and z start, in bytes from the first one that is read
    pub first: [u8; 3],
    /// Their layout
    pub word: Word,
    /// One unit of the last place: [rad/s] for the gyro, [m/s²] for the accelerometer
    pub scale: f32,
    /// How the sensor sits in the vehicle
    pub axes: Axes,
}

impl Triad {
    fn check(&self, length: usize) -> Result<(), Error> {
        if !self.scale.is_finite() {
            return Err(Error::NonFinite);
        }
        let inside = |first: &u8| usize::from(*first) + self.word.bytes() <= length;
        match self.scale > 0.0 && self.first.iter().all(inside) && self.axes.is_rotation() {
            true => Ok(()),
            false => Err(Error::OutOfRange),
        }
    }

    /// Right, forward, up, in SI.
    fn decode(&self, bytes: &[u8]) -> Result<Vector3<f32>, Fault> {
        let axis = |first: u8| {
            // `check` has seen that it is inside.
            let top = self
                .word
                .read(bytes, usize::from(first))
                .ok_or(Fault::NotReady)?;
            let raw = top >> self.word.shift();
            match raw == i32::MIN >> self.word.shift() || raw == i32::MAX >> self.word.shift() {
                true => Err(Fault::AtLimit),
                false => Ok(raw as f32 * self.scale),
            }
        };
        let [x, y, z] = self.first;
        Ok(self.axes.map(&Vector3::new(axis(x)?, axis(y)?, axis(z)?)))
    }
}

/// Bits in the burst that tell whether its data is new.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ready {
    /// Byte, from the first one that is read
    pub byte: u8,
    /// Bits that count
    pub mask: u8,
    /// What they are when the data is good
    pub value: u8,
}

/// Why a burst holds no sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// The bits of [`Ready`] say that there is nothing new.
    NotReady,
    /// A number stood at the end of its range: the motion was more than the sensor can say (or the sensor marks missing
    /// data so). An increment made of it would be wrong by an unknown amount.
    AtLimit,
}

/// The layout of a burst of L bytes, from a data sheet.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Burst<const L: usize> {
    command: &'static [u8],
    gyro: Triad,
    accel: Triad,
    ready: Option<Ready>,
}

impl<const L: usize> Burst<L> {
    /// * `command`: what is written before the L bytes are read: the address of the first register, with the part's read
    ///   bit over SPI. Bytes that a part sends before its first register (dummy bytes) count among the L.
    /// * `gyro`, `accel`: where the numbers stand and what they mean
    /// * `ready`: bits that tell whether the data is new, if the burst has them
    ///
    /// # Errors
    /// [`Error::NonFinite`] for a scale; [`Error::OutOfRange`] for a scale that is not positive, for bytes beyond the
    /// burst, for axes that are not a rotation (a mirrored sensor turns the wrong way), and for an empty command.
    pub fn new(
        command: &'static [u8],
        gyro: Triad,
        accel: Triad,
        ready: Option<Ready>,
    ) -> Result<Self, Error> {
        gyro.check(L)?;
        accel.check(L)?;
        let ready_inside = ready.is_none_or(|r| usize::from(r.byte) < L);
        match ready_inside && !command.is_empty() {
            true => Ok(Self {
                command,
                gyro,
                accel,
                ready,
            }),
            false => Err(Error::OutOfRange),
        }
    }

    /// What is written before the bytes are read.
    pub fn command(&self) -> &'static [u8] {
        self.command
    }

    /// The sample in the bytes of one read, over `dt` [s]: mean rate and specific force times dt.
    ///
    /// # Errors
    /// [`Fault::NotReady`], [`Fault::AtLimit`].
    pub fn decode(&self, bytes: &[u8; L], dt: f32) -> Result<ImuIncrement, Fault> {
        if let Some(r) = &self.ready {
            let status = bytes.get(usize::from(r.byte)).copied().unwrap_or(!r.value);
            if (status ^ r.value) & r.mask != 0 {
                return Err(Fault::NotReady);
            }
        }
        let omega_ib_b = self.gyro.decode(bytes)?;
        let f_b = self.accel.decode(bytes)?;
        Ok(ImuIncrement::from_rates(omega_ib_b, f_b, dt))
    }
}
