//! The ways of using several positions, side by side on the same samples.

use nalgebra::{UnitQuaternion, Vector3};
use navsight::alignment::carry::BiasBlock;
use navsight::alignment::north_bias::{paper_eq5, NorthBias};
use navsight::attitude::RfuToEnu;
use navsight::earth::Geodetic;
use navsight::error::Error;
use navsight::filter::Filter;
use navsight::measurement::Velocity;
use navsight::nav::NavState;
use serde::{Deserialize, Serialize};

use super::tally::{Innovations, Tally};
use super::Scenario;
use crate::sim::{error_state, Ideal, Sensor, Truth};

/// How what one position has taught reaches the next.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    clap::ValueEnum,
)]
#[serde(rename_all = "kebab-case")]
pub enum Variant {
    /// Not at all: a new start in the last position.
    OnePosition,
    /// The filter runs on through the turn.
    Full,
    /// A new start with the 6×6 block of the biases.
    Carry,
    /// A new start, and Peng's hᵀx̂ applied once with its own variance.
    PengOnce,
    /// A new start, and hᵀx̂ applied at every update, as the paper does.
    PengEvery,
    /// The same with the paper's eq. (5) in place of hᵀx̂.
    PaperEq5,
}

impl Variant {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::OnePosition,
        Self::Full,
        Self::Carry,
        Self::PengOnce,
        Self::PengEvery,
        Self::PaperEq5,
    ];

    /// As tables name it.
    pub fn name(self) -> &'static str {
        match self {
            Self::OnePosition => "one position",
            Self::Full => "full filter through the turn",
            Self::Carry => "bias block carried",
            Self::PengOnce => "Peng hᵀx̂, once",
            Self::PengEvery => "Peng hᵀx̂, every update",
            Self::PaperEq5 => "Peng eq. (5), every update",
        }
    }
}

/// One variant on its way.
struct Runner {
    variant: Variant,
    filter: Filter,
    /// From the positions before.
    observed: Vec<NorthBias>,
    innovations: Innovations,
}

impl Runner {
    /// A velocity update, and Peng's where it is due.
    fn update(&mut self, z: &Vector3<f32>, scenario: &Scenario) -> Result<(), Error> {
        let sigma = Vector3::repeat(scenario.sigma_velocity as f32);
        let z = Velocity::new(*z, sigma, scenario.interval as f32)?;
        let report = self.filter.update(&z.linearize(self.filter.nav()))?;
        self.innovations.sum += f64::from(report.nis);
        self.innovations.rows += 3;
        if matches!(self.variant, Variant::PengEvery | Variant::PaperEq5) {
            self.observe()?;
        }
        Ok(())
    }

    fn observe(&mut self) -> Result<(), Error> {
        for north in &self.observed {
            let row = north.linearize(self.filter.nav())?;
            self.filter.update(&row)?;
        }
        Ok(())
    }

    /// A new position begins and this variant starts anew there.
    fn restart(&mut self, nav: NavState, scenario: &Scenario) -> Result<(), Error> {
        let settings = scenario.settings()?;
        let before = &self.filter;
        match self.variant {
            Variant::Full => return Ok(()),
            Variant::OnePosition => self.filter = Filter::new(nav, &scenario.prior, settings)?,
            Variant::Carry => {
                self.filter = BiasBlock::of(before).start(nav, &scenario.prior, settings)?;
            }
            Variant::PengOnce | Variant::PengEvery | Variant::PaperEq5 => {
                let mut north = NorthBias::of(before);
                if self.variant == Variant::PaperEq5 {
                    let (b, heading) = (before.nav().b_g(), before.nav().euler().heading);
                    north.value = paper_eq5(b.x, b.y, heading);
                }
                self.observed.push(north);
                self.filter = Filter::new(nav, &scenario.prior, settings)?;
                if self.variant == Variant::PengOnce {
                    self.observe()?;
                }
            }
        }
        Ok(())
    }
}

/// Runs one seed of some variants on the same samples, and adds what they end with to the tally.
///
/// Before the first turn all variants are one filter.
///
/// # Errors
/// Those of the filter.
pub fn run(
    scenario: &Scenario,
    track: &[(Truth, Ideal)],
    variants: &[Variant],
    seed: u64,
    tally: &mut Tally,
) -> Result<(), Error> {
    let mut sensor = Sensor::new(scenario.sensor, seed);
    let draw = |sensor: &mut Sensor, three: &[f32; 3]| {
        sensor.normal().component_mul(&Scenario::sigma(three))
    };
    if scenario.draw_biases {
        sensor.errors.gyro_bias = draw(&mut sensor, &scenario.prior.gyro_bias);
        sensor.errors.accel_bias = draw(&mut sensor, &scenario.prior.accel_bias);
    }
    // A coarse attitude, and a velocity where truth is drawn; the place is known to a metre.
    let start = |sensor: &mut Sensor, q: &UnitQuaternion<f64>| {
        let psi = draw(sensor, &scenario.prior.attitude);
        let q = UnitQuaternion::from_scaled_axis(-psi) * q;
        let (dr, dv) = (
            draw(sensor, &scenario.prior.position),
            draw(sensor, &scenario.prior.velocity),
        );
        let at = scenario.schedule.at;
        let (at, v) = match scenario.draw_biases {
            true => {
                let there = Geodetic {
                    lat: at.lat + dr.y / 6.37e6,
                    lon: at.lon + dr.x / 6.37e6 / at.lat.cos(),
                    height: at.height + dr.z,
                };
                (there, dv)
            }
            false => (at, Vector3::zeros()),
        };
        let attitude = RfuToEnu([q.w, q.i, q.j, q.k].map(|x| x as f32));
        NavState::new(at, v.cast::<f32>(), attitude)
    };
    let spans = scenario.schedule.spans();
    let Some((first, _)) = track.first() else {
        return Ok(());
    };
    let nav = start(&mut sensor, &first.q)?;
    let filter = Filter::new(nav, &scenario.prior, scenario.settings()?)?;
    // One filter until the first turn, then one for each variant.
    let mut common = Some(Runner {
        variant: Variant::Full,
        filter,
        observed: Vec::new(),
        innovations: Innovations::default(),
    });
    let mut runners: Vec<Runner> = Vec::new();
    let (mut waited, mut position) = (0.0, 0);
    for (truth, ideal) in track {
        let (begin, end) = spans[position];
        let imu = sensor.sample(ideal);
        let standing = truth.time < end + 0.5 * scenario.dt;
        let alive = |r: &&mut Runner| standing || r.variant == Variant::Full;
        for runner in common.iter_mut().chain(runners.iter_mut()).filter(alive) {
            runner.filter.propagate(&imu)?;
        }
        waited += scenario.dt;
        if waited + 0.5 * scenario.dt >= scenario.interval {
            waited = 0.0;
            // The end of a turn falls on no update: the interval begins anew with each position.
            if standing {
                let z = (sensor.normal() * scenario.disturbance).cast::<f32>();
                for runner in common.iter_mut().chain(&mut runners) {
                    runner.update(&z, scenario)?;
                }
            }
        }
        let near = |t: f64| (truth.time - t).abs() < 0.5 * scenario.dt;
        let mark = scenario.marks.iter().any(|&m| near(begin + m)) || near(end);
        if standing && mark {
            for r in common.iter().chain(&runners) {
                let error = error_state(&r.filter, truth, &sensor.errors);
                let since = truth.time - begin;
                tally.add(r.variant, position, since, &r.filter, &error, r.innovations);
            }
        }
        let next = spans.get(position + 1).map(|span| span.0);
        if near(end) && next.is_some() {
            if let Some(one) = common.take() {
                runners = variants
                    .iter()
                    .map(|&variant| Runner {
                        variant,
                        filter: one.filter.clone(),
                        observed: Vec::new(),
                        ..one
                    })
                    .collect();
            }
        }
        if next.is_some_and(near) {
            position += 1;
            waited = 0.0;
            let nav = start(&mut sensor, &truth.q)?;
            for runner in &mut runners {
                runner.restart(nav, scenario)?;
                runner.innovations = Innovations::default();
            }
        }
    }
    tally.seeds += 1;
    Ok(())
}
