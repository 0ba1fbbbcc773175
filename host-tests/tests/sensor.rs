//! Inertial sensors over embedded-hal buses: what goes over the wires, what comes out in the vehicle's axes, and what
//! is refused. The buses are mocks that check every transfer.

use embedded_hal::i2c::{ErrorKind as I2cError, I2c, NoAcknowledgeSource};
use embedded_hal::spi::{ErrorKind as SpiError, SpiDevice};
use embedded_hal_mock::eh1::i2c::{Mock as I2cMock, Transaction as I2cTransaction};
use embedded_hal_mock::eh1::spi::{Mock as SpiMock, Transaction as SpiTransaction};
use nalgebra::Vector3;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::imu::ImuIncrement;
use navsight::nav::NavState;
use navsight::sensor::{
    Axes, Axis, Burst, BusFault, Fault, I2cImu, ImuSource, Ready, SpiImu, Triad, Word,
};

const DT: f32 = 1.0 / 128.0;
const ADDRESS: u8 = 0x68;

fn triad(first: [u8; 3], word: Word, scale: f32, axes: Axes) -> Triad {
    Triad {
        first,
        word,
        scale,
        axes,
    }
}

/// A made-up part: a status byte, then gyro and accelerometer as big-endian words of 16 bits. Scales are powers of two,
/// so every number below is exact.
fn burst(axes: Axes) -> Burst<13> {
    Burst::new(
        &[0x80 | 0x20],
        triad([1, 3, 5], Word::I16Be, 1.0 / 1024.0, axes),
        triad([7, 9, 11], Word::I16Be, 1.0 / 256.0, axes),
        Some(Ready {
            byte: 0,
            mask: 0x03,
            value: 0x03,
        }),
    )
    .unwrap()
}

const BYTES: [u8; 13] = [
    0xf3, // ready, with bits that do not count
    0x00, 0x80, 0xff, 0x00, 0x02, 0x00, // 128, −256, 512: 0.125, −0.25, 0.5 rad/s
    0x01, 0x00, 0x02, 0x00, 0xf6, 0x00, // 256, 512, −2560: 1, 2, −10 m/s²
];

fn spi_read(bytes: &[u8]) -> [SpiTransaction<u8>; 4] {
    [
        SpiTransaction::transaction_start(),
        SpiTransaction::write_vec(vec![0xa0]),
        SpiTransaction::read_vec(bytes.to_vec()),
        SpiTransaction::transaction_end(),
    ]
}

#[test]
fn spi_asks_once_and_the_vehicle_axes_come_out() {
    let mut imu = SpiImu::new(SpiMock::new(&spi_read(&BYTES)), burst(Axes::FRD));
    let sample = imu.sample(DT).unwrap();
    // right = y, forward = x, up = −z
    assert_eq!(sample.delta_theta_b, Vector3::new(-0.25, 0.125, -0.5) * DT);
    assert_eq!(sample.delta_v_b, Vector3::new(2.0, 1.0, 10.0) * DT);
    assert_eq!(sample.dt, DT);
    imu.release().done();
}

#[test]
fn i2c_writes_the_register_and_reads_on() {
    let mut imu = I2cImu::new(
        I2cMock::new(&[I2cTransaction::write_read(
            ADDRESS,
            vec![0xa0],
            BYTES.to_vec(),
        )]),
        ADDRESS,
        burst(Axes::FLU),
    );
    let sample = imu.sample(DT).unwrap();
    // right = −y, forward = x, up = z
    assert_eq!(sample.delta_theta_b, Vector3::new(0.25, 0.125, 0.5) * DT);
    assert_eq!(sample.delta_v_b, Vector3::new(-2.0, 1.0, -10.0) * DT);
    imu.release().done();
}

#[test]
fn a_failed_transfer_is_told_as_the_bus_tells_it() {
    let mut imu = SpiImu::new(
        SpiMock::new(&[
            SpiTransaction::transaction_start(),
            SpiTransaction::write_vec(vec![0xa0]),
            SpiTransaction::read_vec(BYTES.to_vec()),
            SpiTransaction::transaction_end(),
        ]),
        burst(Axes::RFU),
    );
    assert!(imu.sample(DT).is_ok());
    imu.release().done();

    let refused = I2cError::NoAcknowledge(NoAcknowledgeSource::Address);
    let mut imu = I2cImu::new(
        I2cMock::new(&[
            I2cTransaction::write_read(ADDRESS, vec![0xa0], BYTES.to_vec()).with_error(refused),
        ]),
        ADDRESS,
        burst(Axes::RFU),
    );
    assert_eq!(imu.sample(DT), Err(BusFault::Bus(refused)));
    imu.release().done();
}

/// A device that always fails, since the mock's transactions cannot.
struct Broken;

impl embedded_hal::spi::ErrorType for Broken {
    type Error = SpiError;
}

impl SpiDevice for Broken {
    fn transaction(
        &mut self,
        _: &mut [embedded_hal::spi::Operation<'_, u8>],
    ) -> Result<(), SpiError> {
        Err(SpiError::ChipSelectFault)
    }
}

#[test]
fn a_broken_spi_device_is_told_too() {
    let mut imu = SpiImu::new(Broken, burst(Axes::RFU));
    assert_eq!(
        imu.sample(DT),
        Err(BusFault::Bus(SpiError::ChipSelectFault))
    );
}

#[test]
fn old_and_clipped_data_is_no_sample() {
    for (at, value, fault) in [
        (0, 0x02, Fault::NotReady), // one of the two bits
        (0, 0x00, Fault::NotReady),
        (1, 0x80, Fault::AtLimit), // together with the low byte below: −32768
        (11, 0x7f, Fault::AtLimit), // 32767
    ] {
        let mut bytes = BYTES;
        bytes[at] = value;
        if at > 0 {
            bytes[at + 1] = if value == 0x7f { 0xff } else { 0x00 };
        }
        let mut imu = SpiImu::new(SpiMock::new(&spi_read(&bytes)), burst(Axes::RFU));
        assert_eq!(imu.sample(DT), Err(BusFault::Sensor(fault)));
        imu.release().done();
    }
}

#[test]
fn every_word_is_read_with_its_sign() {
    let numbers = |word: Word, bytes: [u8; 12]| {
        let n = word.bytes() as u8;
        let t = triad([0, n, 2 * n], word, 1.0, Axes::RFU);
        let sample = Burst::<12>::new(&[0], t, t, None)
            .unwrap()
            .decode(&bytes, 1.0)
            .unwrap();
        assert_eq!(sample.delta_theta_b, sample.delta_v_b);
        sample.delta_v_b
    };
    let expect = |v: [f32; 3]| Vector3::from(v);
    assert_eq!(
        numbers(Word::I16Be, [1, 2, 0xff, 0xfe, 0x80, 1, 9, 9, 9, 9, 9, 9]),
        expect([258.0, -2.0, -32767.0])
    );
    assert_eq!(
        numbers(Word::I16Le, [1, 2, 0xff, 0xfe, 0x80, 1, 9, 9, 9, 9, 9, 9]),
        expect([513.0, -257.0, 384.0])
    );
    assert_eq!(
        numbers(
            Word::I24Be,
            [1, 2, 3, 0xff, 0xff, 0xfe, 0x80, 0, 1, 9, 9, 9]
        ),
        expect([66051.0, -2.0, -8388607.0])
    );
    assert_eq!(
        numbers(
            Word::I24Le,
            [1, 2, 3, 0xff, 0xff, 0xfe, 0x80, 0, 1, 9, 9, 9]
        ),
        expect([197121.0, -65537.0, 65664.0])
    );
    assert_eq!(
        numbers(
            Word::I32Be,
            [0, 1, 2, 3, 0xff, 0xff, 0xff, 0xfe, 0, 0, 1, 0]
        ),
        expect([66051.0, -2.0, 256.0])
    );
    assert_eq!(
        numbers(
            Word::I32Le,
            [1, 2, 3, 0, 0xfe, 0xff, 0xff, 0xff, 0, 1, 0, 0]
        ),
        expect([197121.0, -2.0, 256.0])
    );
}

#[test]
fn only_rotations_are_axes() {
    const ALL: [Axis; 6] = [
        Axis::X,
        Axis::MinusX,
        Axis::Y,
        Axis::MinusY,
        Axis::Z,
        Axis::MinusZ,
    ];
    let mut good = 0;
    for right in ALL {
        for forward in ALL {
            for up in ALL {
                let t = triad([0, 2, 4], Word::I16Be, 1.0, Axes { right, forward, up });
                match Burst::<6>::new(&[0], t, t, None) {
                    Ok(_) => good += 1,
                    Err(error) => assert_eq!(error, Error::OutOfRange),
                }
            }
        }
    }
    assert_eq!(good, 24); // the rotations of a cube
}

#[test]
fn each_axis_goes_where_it_points() {
    let decode = |axes| {
        let t = triad([0, 2, 4], Word::I16Be, 1.0, axes);
        let burst = Burst::<6>::new(&[0], t, t, None).unwrap();
        burst.decode(&[0, 1, 0, 2, 0, 3], 1.0).unwrap().delta_v_b
    };
    let axes = |right, forward, up| Axes { right, forward, up };
    for (axes, expected) in [
        (Axes::RFU, [1.0, 2.0, 3.0]),
        (Axes::FRD, [2.0, 1.0, -3.0]),
        (Axes::FLU, [-2.0, 1.0, 3.0]),
        (axes(Axis::MinusX, Axis::MinusY, Axis::Z), [-1.0, -2.0, 3.0]),
        (axes(Axis::Z, Axis::X, Axis::Y), [3.0, 1.0, 2.0]),
    ] {
        assert_eq!(decode(axes), Vector3::from(expected));
    }
}

#[test]
fn a_wrong_table_is_refused() {
    let good = triad([0, 2, 4], Word::I16Be, 1.0, Axes::RFU);
    let refuse = |gyro, accel, ready, command, error| {
        assert_eq!(Burst::<6>::new(command, gyro, accel, ready), Err(error));
    };
    assert!(Burst::<6>::new(&[0], good, good, None).is_ok());
    for bad in [
        Triad {
            first: [0, 2, 5],
            ..good
        },
        Triad {
            first: [255, 2, 4],
            ..good
        },
        Triad {
            word: Word::I24Be,
            ..good
        },
        Triad { scale: 0.0, ..good },
        Triad {
            scale: -1.0,
            ..good
        },
    ] {
        refuse(bad, good, None, &[0], Error::OutOfRange);
        refuse(good, bad, None, &[0], Error::OutOfRange);
    }
    for scale in [f32::NAN, f32::INFINITY] {
        refuse(Triad { scale, ..good }, good, None, &[0], Error::NonFinite);
    }
    let beyond = Ready {
        byte: 6,
        mask: 1,
        value: 1,
    };
    refuse(good, good, Some(beyond), &[0], Error::OutOfRange);
    refuse(good, good, None, &[], Error::OutOfRange);
}

/// What a program writes: any source will do, and a driver of somebody else's is one after a few lines.
fn run(source: &mut impl ImuSource, nav: &mut NavState, samples: usize) -> usize {
    (0..samples)
        .filter_map(|_| source.sample(DT).ok())
        .filter(|sample| nav.advance(sample).is_ok())
        .count()
}

struct SomebodysDriver;

impl SomebodysDriver {
    fn read_rates(&mut self) -> Result<([f32; 3], [f32; 3]), ()> {
        Ok(([0.0; 3], [0.0, 0.0, 9.8]))
    }
}

impl ImuSource for SomebodysDriver {
    type Error = ();
    fn sample(&mut self, dt: f32) -> Result<ImuIncrement, ()> {
        let (gyro, accel) = self.read_rates()?;
        Ok(ImuIncrement::from_rates(
            Vector3::from(gyro),
            Vector3::from(accel),
            dt,
        ))
    }
}

#[test]
fn a_navigator_runs_on_any_source() {
    let nav = || {
        NavState::new(
            Geodetic::from_degrees(40.0, 116.0, 100.0),
            Vector3::zeros(),
            navsight::attitude::Euler::from_degrees(30.0, 2.0, 1.0),
        )
        .unwrap()
    };
    assert_eq!(run(&mut SomebodysDriver, &mut nav(), 10), 10);
    // one of two samples is old
    let mut old = BYTES;
    old[0] = 0;
    let transfers = [spi_read(&BYTES), spi_read(&old)].concat();
    let mut imu = SpiImu::new(SpiMock::new(&transfers), burst(Axes::FRD));
    assert_eq!(run(&mut imu, &mut nav(), 2), 1);
    imu.release().done();
}

#[test]
fn the_program_keeps_its_bus() {
    let mut imu = I2cImu::new(
        I2cMock::new(&[
            I2cTransaction::write(ADDRESS, vec![0x11, 0x22]),
            I2cTransaction::write_read(ADDRESS, vec![0xa0], BYTES.to_vec()),
        ]),
        ADDRESS,
        burst(Axes::RFU),
    );
    imu.bus_mut().write(ADDRESS, &[0x11, 0x22]).unwrap();
    assert!(imu.sample(DT).is_ok());
    imu.release().done();
}
