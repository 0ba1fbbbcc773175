//! What a measurement does to the filter: refused, gated, or used for estimate and covariance.
//!
//! The kind of its rows decides which kernel of the covariance takes it.

use super::room::Room;
use super::{Filter, UpdateReport};
use crate::covariance::{each_row, Covariance15, Lines, Pattern, Slots};
use crate::error::Error;
use crate::error_model::{N, POS, VEL};
use crate::linalg::Real;
use crate::measurement::{AntennaRows, Kind, Linearized, MeasurementRows, UP};
use nalgebra::SMatrix;

/// Largest |ν| [unit of z] and |h| that a measurement may hold: far beyond any sensor, and small enough for the squares
/// and products of the update to stay inside f32.
pub(super) const MAX_MAGNITUDE: f32 = 1e9;
/// Largest noise variance that a measurement may hold: a standard deviation of the same size.
const MAX_VARIANCE: f32 = MAX_MAGNITUDE * MAX_MAGNITUDE;

impl Filter {
    /// Uses one measurement of M rows: gates it, corrects the nominal state, and reports what happened.
    ///
    /// Rows beyond their gate are reported and not used.
    ///
    /// Errors: [`Error::NonFinite`] and [`Error::OutOfRange`] for a measurement that cannot be, the filter then bit for
    /// bit as it was. [`Error::OutOfRange`] and [`Error::Polar`] for a correction that the nominal state does not accept,
    /// [`Error::InnovationVariance`] and [`Error::Variance`] when the covariance itself is broken, which a reset must
    /// answer: estimate and covariance are then those of the present, without this measurement.
    #[inline(always)]
    pub fn update<const M: usize, H: MeasurementRows<M>>(
        &mut self,
        measurement: &Linearized<M, H>,
    ) -> Result<UpdateReport<M>, Error> {
        let mut outcome = Ok(UpdateReport::empty());
        if let Ok(report) = &mut outcome {
            // inside the outcome: moved into it, it would be copied once more
            if let Err(error) = self.update_into(measurement, report) {
                outcome = Err(error);
            }
        }
        outcome
    }

    /// As [`Filter::update`], with the report written where the caller has room for it: a copy and its stack less. After
    /// an error the report may hold anything.
    ///
    /// Errors: those of [`Filter::update`].
    #[inline(always)]
    pub fn update_into<const M: usize, H: MeasurementRows<M>>(
        &mut self,
        measurement: &Linearized<M, H>,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        self.update_gated(measurement, self.settings.gate, report)
    }

    /// As [`Filter::update_into`] with this gate.
    ///
    /// The kind of the rows is known from their type, but for [`crate::measurement::Jacobian`]: of a program that only has
    /// velocities nothing else is linked.
    #[inline(always)]
    pub(super) fn update_gated<const M: usize, H: MeasurementRows<M>>(
        &mut self,
        measurement: &Linearized<M, H>,
        gate: Option<f32>,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        let mut given = Given {
            nu: measurement.nu.data.0[0],
            r: measurement.r.data.0[0],
            interval: measurement.interval,
            gate,
        };
        match measurement.h.kind() {
            Kind::Direct { first: UP } if M == 1 => self.update_states::<M, UP>(&mut given, report),
            Kind::Direct { first: VEL } if M == 3 => {
                self.update_states::<M, VEL>(&mut given, report)
            }
            Kind::Direct { first } => self.update_direct(&mut given, first, report),
            Kind::Antenna(rows) if M == 6 => self.update_antenna(&mut given, rows, report),
            Kind::Antenna(rows) => self.update_dense(&mut given, &rows.elements(), report),
            Kind::Dense(h) => self.update_dense(&mut given, h, report),
        }
    }

    /// The six rows of position and velocity of an antenna; M is 6.
    #[inline(never)]
    fn update_antenna<const M: usize>(
        &mut self,
        given: &mut Given<M>,
        rows: &AntennaRows,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        given.check()?;
        if !rows.within(MAX_MAGNITUDE) {
            return Err(Error::OutOfRange);
        }
        self.update_by(
            given,
            report,
            units_from::<M, POS>,
            |p, job, room, out, accept| {
                let six = rows.in_units(job.sigma0);
                let mut own = const { [[0.0; N]; M] };
                let room = room.panel().unwrap_or(&mut own);
                if job.considered == 0 && p.update_six(&six, &job.lines, room, out, accept)? {
                    return Ok(());
                }
                update_in_full(p, rows, job, out, accept)
            },
        )
    }

    /// Rows that are −1 on the states from FIRST on.
    #[inline(never)]
    fn update_states<const M: usize, const FIRST: usize>(
        &mut self,
        given: &mut Given<M>,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        given.check()?;
        self.update_by(
            given,
            report,
            units_from::<M, FIRST>,
            |p, job, room, out, accept| {
                if job.considered == 0 && p.update_block::<M, FIRST>(&job.lines, out, accept)? {
                    return Ok(());
                }
                let h = Pattern::Direct { first: FIRST };
                p.update_carefully_by(&job.lines, h, job.considered, room.pairs(), out, accept)
            },
        )
    }

    /// Rows that are −1 on the states from `first` on.
    #[inline(never)]
    fn update_direct<const M: usize>(
        &mut self,
        given: &mut Given<M>,
        first: usize,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        given.check()?;
        if first > N || M > N - first {
            return Err(Error::OutOfRange);
        }
        let unit = |sigma0: &[f32; N]| {
            let mut unit = [1.0; M];
            for (u, &sigma) in unit.iter_mut().zip(sigma0.iter().skip(first)) {
                *u = sigma;
            }
            unit
        };
        self.update_by(given, report, unit, |p, job, room, out, accept| {
            update_any(p, Pattern::Direct { first }, job, room, out, accept)
        })
    }

    /// Rows of any kind.
    #[inline(never)]
    fn update_dense<const M: usize>(
        &mut self,
        given: &mut Given<M>,
        h: &SMatrix<f32, M, N>,
        report: &mut UpdateReport<M>,
    ) -> Result<(), Error> {
        given.check()?;
        check_rows(h)?;
        self.update_by(
            given,
            report,
            |_| const { [1.0; M] },
            |p, job, room, out, accept| {
                let unit = job.sigma0;
                update_any(p, Pattern::Dense { h, unit }, job, room, out, accept)
            },
        )
    }

    /// What stands around every kernel: the numbers go to the units of their rows, the covariance comes up to the time of
    /// the measurement, `kernel` works on it, and the report is completed. `unit`: of each row, from those of the states.
    #[inline(always)]
    fn update_by<const M: usize>(
        &mut self,
        given: &mut Given<M>,
        report: &mut UpdateReport<M>,
        unit: impl Fn(&[f32; N]) -> [f32; M],
        kernel: impl FnOnce(
            &mut Covariance15<f32>,
            &Job<'_, M>,
            &mut Room,
            &mut Slots<'_, f32, M, N>,
            &mut dyn FnMut(&[f32; N]) -> Result<(), Error>,
        ) -> Result<(), Error>,
    ) -> Result<(), Error> {
        given.scale(&unit(&self.sigma0), report)?;
        self.synchronize();
        let (nav, sigma0) = (&mut self.nav, &self.sigma0);
        let job = Job {
            lines: Lines {
                nu: &given.nu,
                r: &given.r,
                gate: given.gate,
            },
            sigma0,
            considered: u32::from(self.considered),
        };
        let mut accept = |dx: &[f32; N]| nav.correct_in_units(dx, sigma0);
        let (p, room) = (&mut self.covariance, &mut self.room);
        kernel(p, &job, room, &mut report.slots(), &mut accept)?;
        // formed again: kept, it would lie below the kernel
        let unit = unit(&self.sigma0);
        each_row!(m; report.s[m] *= unit[m] * unit[m]);
        report.normalised = self.normalised;
        report.interval = given.interval;
        Ok(())
    }
}

/// Units of rows that measure the states from FIRST on.
#[inline(always)]
fn units_from<const M: usize, const FIRST: usize>(sigma0: &[f32; N]) -> [f32; M] {
    let mut unit = const { [0.0; M] };
    each_row!(m; unit[m] = sigma0[FIRST + m]);
    unit
}

/// What a kernel needs of a measurement and of the filter.
struct Job<'a, const M: usize> {
    /// In the units of the rows.
    lines: Lines<'a, f32, M>,
    sigma0: &'a [f32; N],
    considered: u32,
}

/// Rows of any kind: swiftly where that is good enough.
#[inline(always)]
fn update_any<const M: usize>(
    p: &mut Covariance15<f32>,
    h: Pattern<'_, f32, M, N>,
    job: &Job<'_, M>,
    room: &mut Room,
    out: &mut Slots<'_, f32, M, N>,
    accept: &mut dyn FnMut(&[f32; N]) -> Result<(), Error>,
) -> Result<(), Error> {
    let mut own = const { [[0.0; N]; M] };
    let panel = room.panel().unwrap_or(&mut own);
    if job.considered == 0 && p.update_swiftly(&job.lines, h, panel, out, accept)? {
        return Ok(());
    }
    p.update_carefully_by(&job.lines, h, job.considered, room.pairs(), out, accept)
}

/// The careful update by the rows of an antenna in full, each in the unit of the state it is −1 on.
#[cold]
#[inline(never)]
fn update_in_full<const M: usize>(
    p: &mut Covariance15<f32>,
    rows: &AntennaRows,
    job: &Job<'_, M>,
    out: &mut Slots<'_, f32, M, N>,
    accept: &mut dyn FnMut(&[f32; N]) -> Result<(), Error>,
) -> Result<(), Error> {
    let mut h = rows.elements::<M>();
    for (mut row, unit) in h.row_iter_mut().zip(job.sigma0.iter().skip(POS)) {
        row /= *unit;
    }
    let h = Pattern::Dense {
        h: &h,
        unit: job.sigma0,
    };
    p.update_carefully_by(&job.lines, h, job.considered, None, out, accept)
}

/// The numbers of a measurement, without its rows.
struct Given<const M: usize> {
    nu: [f32; M],
    r: [f32; M],
    interval: f32,
    gate: Option<f32>,
}

impl<const M: usize> Given<M> {
    /// Refuses what no sensor can have sent.
    #[inline(always)]
    fn check(&self) -> Result<(), Error> {
        let mut good = self.interval.abs() <= f32::MAX;
        each_row!(m; {
            good &= self.nu[m].abs() <= MAX_MAGNITUDE;
            good &= self.r[m] >= f32::MIN_POSITIVE;
            good &= self.r[m] <= MAX_VARIANCE;
        });
        if good {
            Ok(())
        } else {
            Err(refused(self.interval, &self.nu, &self.r))
        }
    }

    /// Innovations and variances to the unit of each row, and the innovations as they are into the report.
    #[inline(always)]
    fn scale(&mut self, unit: &[f32; M], report: &mut UpdateReport<M>) -> Result<(), Error> {
        if M > 3 {
            self.scale_apart(unit, report)
        } else {
            self.scale_here(unit, report)
        }
    }

    /// Of many rows for itself, so that its registers are not kept on the stack below the kernel.
    #[inline(never)]
    fn scale_apart(&mut self, unit: &[f32; M], report: &mut UpdateReport<M>) -> Result<(), Error> {
        self.scale_here(unit, report)
    }

    #[inline(always)]
    fn scale_here(&mut self, unit: &[f32; M], report: &mut UpdateReport<M>) -> Result<(), Error> {
        let mut sum = 0.0;
        each_row!(m; {
            report.nu[m] = self.nu[m];
            self.nu[m] /= unit[m];
            self.r[m] /= unit[m] * unit[m];
            sum += (self.nu[m] + self.r[m]) * 0.0; // NaN where one is not finite
        });
        if sum == 0.0 {
            Ok(())
        } else {
            Err(Error::OutOfRange)
        }
    }
}

/// Why a measurement is refused that is not as it should be.
#[cold]
#[inline(never)]
fn refused(interval: f32, nu: &[f32], r: &[f32]) -> Error {
    if !interval.finite() {
        return Error::NonFinite;
    }
    let nu = nu.iter().map(|x| within(*x, -MAX_MAGNITUDE, MAX_MAGNITUDE));
    let r = r
        .iter()
        .map(|x| within(*x, f32::MIN_POSITIVE, MAX_VARIANCE));
    nu.chain(r)
        .find_map(Result::err)
        .unwrap_or(Error::OutOfRange)
}

/// Refuses elements that no measurement can have.
fn check_rows<const M: usize>(h: &SMatrix<f32, M, N>) -> Result<(), Error> {
    // at a glance; written as what is good: a NaN fails
    let columns = h.data.0.as_flattened().iter();
    let size = columns.fold(0.0, |sum: f32, h| sum + h.abs());
    if size <= MAX_MAGNITUDE {
        return Ok(());
    }
    h.iter()
        .try_for_each(|&h| within(h, -MAX_MAGNITUDE, MAX_MAGNITUDE))
}

/// Refuses numbers outside `low` … `high`.
fn within(x: f32, low: f32, high: f32) -> Result<(), Error> {
    if !x.finite() {
        Err(Error::NonFinite)
    } else if (low..=high).contains(&x) {
        Ok(())
    } else {
        Err(Error::OutOfRange)
    }
}
