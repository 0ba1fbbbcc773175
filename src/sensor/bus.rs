//! Bursts over the two buses of embedded-hal 1.0, blocking.

use embedded_hal::i2c::{I2c, SevenBitAddress};
use embedded_hal::spi::{Operation, SpiDevice};

use super::{Burst, Fault, ImuSource};
use crate::imu::ImuIncrement;

/// Why a sensor on a bus gave no sample; E is the bus's own error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BusFault<E> {
    /// The transfer failed.
    Bus(E),
    /// The transfer brought no sample.
    Sensor(Fault),
}

/// An inertial sensor on SPI. The device does the chip select; command and read are one transaction.
#[derive(Debug)]
pub struct SpiImu<S, const L: usize> {
    spi: S,
    burst: Burst<L>,
}

impl<S: SpiDevice, const L: usize> SpiImu<S, L> {
    /// A sensor that has been set up already.
    pub fn new(spi: S, burst: Burst<L>) -> Self {
        Self { spi, burst }
    }

    /// The device, for what the program itself wants of the sensor.
    pub fn bus_mut(&mut self) -> &mut S {
        &mut self.spi
    }

    /// Gives the device back.
    pub fn release(self) -> S {
        self.spi
    }
}

impl<S: SpiDevice, const L: usize> ImuSource for SpiImu<S, L> {
    type Error = BusFault<S::Error>;

    fn sample(&mut self, dt: f32) -> Result<ImuIncrement, Self::Error> {
        let mut bytes = [0; L];
        let mut operations = [
            Operation::Write(self.burst.command()),
            Operation::Read(&mut bytes),
        ];
        self.spi
            .transaction(&mut operations)
            .map_err(BusFault::Bus)?;
        self.burst.decode(&bytes, dt).map_err(BusFault::Sensor)
    }
}

/// An inertial sensor on I²C, at an address of seven bits. Write and read are one transaction with a repeated start.
#[derive(Debug)]
pub struct I2cImu<I, const L: usize> {
    i2c: I,
    address: SevenBitAddress,
    burst: Burst<L>,
}

impl<I: I2c, const L: usize> I2cImu<I, L> {
    /// A sensor that has been set up already.
    pub fn new(i2c: I, address: SevenBitAddress, burst: Burst<L>) -> Self {
        Self {
            i2c,
            address,
            burst,
        }
    }

    /// The bus, for what the program itself wants of the sensor.
    pub fn bus_mut(&mut self) -> &mut I {
        &mut self.i2c
    }

    /// Gives the bus back.
    pub fn release(self) -> I {
        self.i2c
    }
}

impl<I: I2c, const L: usize> ImuSource for I2cImu<I, L> {
    type Error = BusFault<I::Error>;

    fn sample(&mut self, dt: f32) -> Result<ImuIncrement, Self::Error> {
        let mut bytes = [0; L];
        self.i2c
            .write_read(self.address, self.burst.command(), &mut bytes)
            .map_err(BusFault::Bus)?;
        self.burst.decode(&bytes, dt).map_err(BusFault::Sensor)
    }
}
