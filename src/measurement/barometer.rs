//! Height from air pressure.

use super::Height;
use crate::error::Error;

/// A barometer, calibrated at a place whose height is known.
///
/// ```text
/// h = h₀ + T₀/Γ (1 − (p/p₀)^(R Γ/g))        T₀ temperature at the reference, Γ = 6.5 K/km, R = 287.053 J/(kg K)
/// ```
///
/// Source: ICAO standard atmosphere, troposphere, with the reference where the vehicle is. Weather moves p₀ by up to
/// 1 hPa (8 m) an hour, and a wrong T₀ costs 0.4 % of h − h₀ per kelvin: neither is white noise, so give the height a σ
/// that covers them and calibrate again against satellite heights ([`Barometer::calibrate`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Barometer {
    p0: f32,
    /// [m]
    h0: f64,
    t0: f32,
}

/// Lapse rate of the standard atmosphere [K/m].
const LAPSE: f32 = 6.5e-3;
/// Exponent R Γ/g.
const EXPONENT: f32 = 287.053 * LAPSE / 9.806_65;

impl Barometer {
    /// Pressure [Pa] and temperature [K] where the height [m, above the ellipsoid] is known.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::OutOfRange`] outside 1 … 200 kPa or 150 … 350 K.
    pub fn calibrate(pressure: f32, temperature: f32, height: f64) -> Result<Self, Error> {
        check_pressure(pressure)?;
        if !(temperature.is_finite() && height.is_finite()) {
            return Err(Error::NonFinite);
        }
        if !(150.0..=350.0).contains(&temperature) {
            return Err(Error::OutOfRange);
        }
        Ok(Self {
            p0: pressure,
            h0: height,
            t0: temperature,
        })
    }

    /// Height above the ellipsoid at this pressure [Pa].
    ///
    /// # Errors
    /// As [`Barometer::calibrate`].
    pub fn height(&self, pressure: f32) -> Result<f64, Error> {
        check_pressure(pressure)?;
        // 1 − (p/p₀)^k = −(e^(k ln(p/p₀)) − 1), without the loss near p₀
        let power = libm::expm1f(EXPONENT * libm::logf(pressure / self.p0));
        Ok(self.h0 - f64::from(self.t0 / LAPSE * power))
    }

    /// The height measurement of this pressure [Pa] with 1σ [m], and the nominal interval between two of them [s].
    ///
    /// # Errors
    /// As [`Barometer::calibrate`] and [`Height::new`].
    pub fn measure(&self, pressure: f32, sigma: f32, interval: f32) -> Result<Height, Error> {
        Height::new(self.height(pressure)?, sigma, interval)
    }
}

fn check_pressure(pressure: f32) -> Result<(), Error> {
    match pressure {
        p if !p.is_finite() => Err(Error::NonFinite),
        p if (1e3..=2e5).contains(&p) => Ok(()),
        _ => Err(Error::OutOfRange),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_atmosphere() {
        let sea = Barometer::calibrate(101_325.0, 288.15, 0.0).unwrap();
        // ICAO Doc 7488: geopotential heights of 89 874.6 Pa and 54 019.9 Pa; table rounding and f32, 0.1 m
        for (pressure, height) in [(101_325.0, 0.0), (89_874.6, 1000.0), (54_019.9, 5000.0)] {
            let h = sea.height(pressure).unwrap();
            assert!((h - height).abs() < 0.2, "{pressure}: {h}");
        }
        assert!(sea.height(101_313.0).unwrap() > 0.9); // 12 Pa a metre, upwards
        let there = Barometer::calibrate(95_000.0, 290.0, 512.0).unwrap();
        assert_eq!(there.height(95_000.0), Ok(512.0));
    }

    #[test]
    fn what_cannot_be_is_refused() {
        assert_eq!(
            Barometer::calibrate(f32::NAN, 288.0, 0.0),
            Err(Error::NonFinite)
        );
        assert_eq!(
            Barometer::calibrate(1.0, 288.0, 0.0),
            Err(Error::OutOfRange)
        );
        assert_eq!(Barometer::calibrate(1e5, 15.0, 0.0), Err(Error::OutOfRange));
        let b = Barometer::calibrate(1e5, 288.0, 0.0).unwrap();
        assert_eq!(b.height(-1.0), Err(Error::OutOfRange));
        assert!(b.measure(1e5, 0.0, 1.0).is_err());
    }
}
