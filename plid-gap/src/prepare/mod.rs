//! The preparation of a least-squares problem from a case: the records that are fitted, the noise model, and the
//! properties that effects need.

pub(crate) mod coloured;
mod divide;
mod model_free;
pub(crate) mod wandering;

use std::sync::Arc;

use crate::case::record::{Channels, Excitation, Record, rms};
use crate::case::split::split;
use crate::case::{Controller, Limits};
use crate::effects::{Action, MissingModeStart, Setting, Units};
use crate::error::GapError;
use crate::fit::free_run::{errors, outputs, run};
use crate::fit::nuisance::Nuisance;
use crate::fit::problem::{Placed, Problem, dot};
use crate::fit::refit::Refit;
use crate::noise::local_polynomial::unexplained;
use crate::noise::model_error::ModelError;
use crate::noise::whiten::Whitener;
use crate::noise::{NoiseModel, Stretch, is_constant, repeats};
use crate::plant::{CasePort, Mode, Plant, PortScale, SAME_ROW};
use crate::prepare::coloured::{Coloured, coloured};
use crate::prepare::divide::divide;
use crate::prepare::model_free::at_most;
use crate::prepare::wandering::{Wandering, wandering};
use crate::settings::step::Step;
use crate::settings::{GapSettings, PrepareSettings, SignalSettings};
use crate::signal::quantisation::{self, Quantisation};
use crate::signal::{notch, peaks, tones};
use crate::simulate::{Fineness, commands, simulate, slope};
use plid_fourier::C;
use plid_model::Model;

/// A simulation with its records, prepared for fits.
#[derive(Clone)]
pub struct Prepared {
    /// The least-squares problem.
    pub problem: Problem,
    /// The records that are held out from all fits, in order.
    pub held_out: Vec<Record>,
    /// The noise model of the records.
    pub noise: NoiseModel,
    /// The noise model as the simulation declares it.
    pub declared: NoiseModel,
    /// Quantisation and dropouts of each output, from the raw values.
    pub quantisation: Vec<Quantisation>,
    /// Declared standard deviations of the sensors (p); a share of each output's RMS if the simulation declares none.
    pub declared_sensor: Vec<f64>,
    /// Whether the simulation declares sensor noise.
    pub declares: bool,
    /// Spectra of the stretches that no command explains.
    pub quiet: Vec<Stretch>,
    /// What the noise model was first found from.
    pub noise_from: NoiseFrom,
    /// Lines whose phase wanders.
    pub wandering: Vec<Wandering>,
    /// A random force in a frequency band, which is part of the noise.
    pub coloured: Option<Coloured>,
    /// The best linear model of the records, if the simulation is a model that was identified from them with the
    /// forces of a law.
    pub best_linear: Option<Plant>,
    /// Whether the simulation is a model of the records that their inputs do not determine.
    pub undetermined: bool,
    /// Steps that the diagnosis skips.
    pub off: Vec<Step>,
    /// The factor by which the simulation's limits are exceeded, if no explanation leaves only noise. The remaining
    /// residual then counts as an error of the simulation in addition to the noise.
    pub widened: Option<f64>,
    /// Effects that change with time in general, but not within the records.
    pub not_of_time: Vec<String>,
}

/// Prior knowledge in addition to the model and the records.
#[derive(Debug, Clone, Default)]
pub struct Known {
    /// Limits of the simulation's errors.
    pub limits: Limits,
    /// For a surrogate model, the standard deviations of its parameters in the order of the linear parameters.
    pub prior_std: Vec<f64>,
    /// For a surrogate model, its error on the records from which it was identified.
    pub model_error: Option<ModelError>,
    /// For a surrogate model of the records, the constant that is added to each output's response (p); otherwise empty.
    pub offsets: Vec<f64>,
    /// For a surrogate model that was identified with the forces of a law, the best linear model of the same records,
    /// with its offsets.
    pub best_linear: Option<(Model, Vec<f64>)>,
    /// Whether the inputs hold too few frequencies to determine the surrogate model.
    pub undetermined: bool,
    /// The frequency band in Hz that counts; all frequencies if `None`.
    pub band_hz: Option<[f64; 2]>,
    /// Units of the channels.
    pub units: Units,
    /// Ports that the case declares.
    pub ports: Vec<CasePort>,
    /// The controller that closed the loop, if there was one.
    pub controller: Option<Arc<Controller>>,
    /// Whether a part of the held-out record may be fitted.
    pub may_divide: bool,
    /// Steps that the diagnosis skips.
    pub off: Vec<Step>,
    /// Thresholds of the diagnosis.
    pub settings: GapSettings,
}

/// Prepares a problem.
///
/// # Errors
/// [`GapError`] if the simulation cannot be decomposed; [`GapError::Port`] if a port of the case has no motion.
pub fn prepare(model: &Model, records: &[Record], known: &Known) -> Result<Prepared, GapError> {
    let settings = Arc::new(known.settings.clone());
    let (plant, best_linear) = plants(model, known)?;
    let (mut fitted, mut held_out) = split(records, &settings.case);
    let mut errors = given_errors(&plant, &fitted);
    if known.may_divide {
        let error_of = |record: &Record| given_errors(&plant, std::slice::from_ref(record)).swap_remove(0);
        divide(&mut fitted, &mut held_out, &mut errors, error_of, &settings.case);
    }
    let declared_sensor = model.noise.sensor_std.clone().unwrap_or_else(|| {
        (0..plant.p).map(|o| settings.prepare.undeclared_noise * rms(fitted.iter().flat_map(|r| &r.y[o]))).collect()
    });
    let mut declared = declared_noise(&plant, model, &declared_sensor, known);
    let quantisation = quantisation::of_outputs(&fitted, &errors, &declared_sensor, &settings.signal);
    if quantisation.iter().any(|output| output.cut) {
        quantisation::mend(&mut fitted, &errors, &quantisation);
        let held_out_errors = given_errors(&plant, &held_out);
        quantisation::mend(&mut held_out, &held_out_errors, &quantisation);
        errors = given_errors(&plant, &fitted);
    }
    let setting = setting(&plant, model, &fitted, &errors, (&*settings, known.band_hz));
    let setting = Setting { units: known.units.clone(), ..setting };
    let off = &known.off;
    let quiet = if off.contains(&Step::NoiseFit) {
        Vec::new()
    } else {
        quiet_stretches(&plant, &fitted, &setting.tones, &settings.prepare)
    };
    let declares = model.noise.sensor_std.is_some();
    let (noise, noise_from) = if !quiet.is_empty() {
        let silent = fitted.iter().any(|record| is_silent(record, settings.prepare.shortest_quiet));
        (declared.fit_slow(&quiet), if silent { NoiseFrom::Quiet } else { NoiseFrom::Repeats })
    } else if declares || plant.controller.is_some() || off.contains(&Step::NoiseFit) {
        (declared.clone(), NoiseFrom::Assumed)
    } else {
        at_most(&declared, &fitted, &errors, &settings.prepare)
    };
    let noise = rounded(noise, &quiet, &quantisation, (&declared_sensor, declares));
    let whiteners = whiteners(&fitted, &noise, plant.rate, &quantisation);
    let nuisance = Nuisance::new(&plant, &fitted, &known.limits).with_prior_std(&known.prior_std);
    let problem =
        Problem { plant, records: fitted, whiteners, nuisance, setting, settings, strong: false, longer: Vec::new() };
    Ok(Prepared {
        problem,
        held_out,
        declared,
        noise,
        declared_sensor,
        declares,
        quiet,
        noise_from,
        quantisation,
        wandering: Vec::new(),
        coloured: None,
        best_linear,
        undetermined: known.undetermined,
        off: off.clone(),
        widened: None,
        not_of_time: Vec::new(),
    })
}

/// Returns the noise as declared, with these standard deviations of the sensors.
fn declared_noise(plant: &Plant, model: &Model, sensor: &[f64], known: &Known) -> NoiseModel {
    let actuator = model.noise.actuator_std.clone().unwrap_or_else(|| vec![0.0; plant.m]);
    let mut declared = NoiseModel::declared(plant, sensor, &actuator);
    declared.model_error.clone_from(&known.model_error);
    declared.band_hz = known.band_hz;
    declared.settings.clone_from(&known.settings.noise);
    declared
}

/// Returns the plant with the ports and the controller of the case, and the best linear model of the records if that
/// is another plant.
fn plants(model: &Model, known: &Known) -> Result<(Plant, Option<Plant>), GapError> {
    let of = |model: &Model, offsets: &[f64]| {
        let mut plant = Plant::with_settings(model, &known.settings.plant)?;
        plant.offsets = offsets.to_vec();
        Ok(plant)
    };
    let mut plant = of(model, &known.offsets)?;
    declare(&mut plant, &known.ports)?;
    known.controller.iter().cloned().for_each(|controller| plant.close(controller));
    let best_linear: Option<Result<_, GapError>> =
        known.best_linear.as_ref().map(|(model, offsets)| of(model, offsets));
    Ok((plant, best_linear.transpose()?))
}

/// What a noise model was found from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoiseFrom {
    /// Records without input.
    Quiet,
    /// Differences between periods, or between other repeats of an input.
    Repeats,
    /// The part of driven records that the inputs do not explain. The number is the relative standard deviation of the
    /// noise power.
    Unexplained(f64),
    /// Nothing in the records: it is as declared or, without a declaration, a share of the outputs.
    Assumed,
}

/// The noise level and its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseLevel {
    /// Noise power over that of the noise model.
    pub factor: f64,
    /// Relative standard deviation of the factor.
    pub uncertainty: f64,
    /// Whether records show the noise level. Otherwise the level is only declared or assumed.
    pub seen: bool,
    /// Power of the differences between periods of driven records over that of quiet records, if the ratio exceeds
    /// chance. A random effect that is not noise then acts in the driven records.
    pub driven: Option<f64>,
}

impl Prepared {
    /// Returns the plant whose gap is the gap without effects: the best linear model of the records if there is one,
    /// or else the simulation as given.
    pub fn as_given(&self) -> &Plant {
        self.best_linear.as_ref().unwrap_or(&self.problem.plant)
    }

    /// Estimates the noise level from quiet records and from the differences between periods, after subtraction of
    /// the best explanation. The error of a wrong explanation repeats with the period and does not enter. `left` is
    /// the mean squared whitened residual of the best explanation. If no record shows the noise level, the level is
    /// at most `left`. The uncertainty follows from the number of independent values. One level holds for all outputs,
    /// so the least known output decides how certain it is.
    pub fn noise_level(&self, simulated: &[Channels], left: f64) -> NoiseLevel {
        // The rounding error of a coarse converter repeats with the period, so it does not appear as noise there.
        let shows: Vec<bool> =
            self.quantisation.iter().map(|output| !output.coarse && output.hidden.is_none()).collect();
        let uncertainty = self.problem.settings.prepare.rounded_uncertainty;
        if !shows.contains(&true) {
            return NoiseLevel { factor: 1.0, uncertainty, seen: true, driven: None };
        }
        let others = self.level_of(&shows, simulated, left);
        if !shows.contains(&false) {
            return others;
        }
        let rounded = shows.iter().filter(|shows| !**shows).count() as f64 / shows.len() as f64;
        let factor = if others.seen { rounded + (1.0 - rounded) * others.factor } else { others.factor };
        NoiseLevel { factor, uncertainty: others.uncertainty.max(uncertainty), ..others }
    }

    /// Returns the noise level of the outputs whose noise the records may show.
    fn level_of(&self, shows: &[bool], simulated: &[Channels], left: f64) -> NoiseLevel {
        let settings = &self.problem.settings.prepare;
        let p = shows.iter().filter(|shows| **shows).count() as f64;
        let quiet: f64 = self.quiet.iter().map(|stretch| p * stretch.freedom).sum();
        let (mut power, mut freedom) = self.between_periods(simulated, shows);
        // The square of a whitened value has variance two.
        let uncertainty = |freedom: f64| settings.level_allowance * (2.0 / freedom).sqrt();
        let ratio = power / freedom;
        let both = quiet >= settings.level_values && freedom >= settings.level_values;
        let scatter = uncertainty(quiet).hypot(uncertainty(freedom));
        let driven = (both && ratio - 1.0 > settings.louder.max(settings.louder_deviations * scatter)).then_some(ratio);
        // The noise model was fitted to the quiet records, so the factor is one for these.
        if driven.is_none() {
            (power, freedom) = (power + quiet, freedom + quiet);
        } else {
            (power, freedom) = (quiet, quiet);
        }
        let uncertainty = uncertainty(freedom);
        if uncertainty >= settings.declared_uncertainty {
            let uncertainty = match self.noise_from {
                NoiseFrom::Unexplained(uncertainty) if self.noise.model_error.is_none() => uncertainty,
                _ => settings.declared_uncertainty,
            };
            return NoiseLevel { factor: left.min(1.0), uncertainty, seen: false, driven };
        }
        // The growth of a model's own error with the level is an assumption.
        let uncertainty = if self.noise.model_error.is_some() { settings.declared_uncertainty } else { uncertainty };
        NoiseLevel { factor: power / freedom, uncertainty, seen: true, driven }
    }

    /// Returns the sum of squares of the whitened deviations of the periods of driven records from their mean, after
    /// subtraction of these simulations, and its degrees of freedom. Only the outputs that `shows` marks count.
    fn between_periods(&self, simulated: &[Channels], shows: &[bool]) -> (f64, f64) {
        let problem = &self.problem;
        let (mut power, mut freedom) = (0.0, 0.0);
        for ((record, y), whitener) in problem.records.iter().zip(simulated).zip(&problem.whiteners) {
            let Excitation::Periodic(period) = record.excitation else { continue };
            let mut error = record.error_where_measured(y);
            for (error, masked) in error.iter_mut().zip(&whitener.masked) {
                masked.iter().for_each(|&k| error[k] = f64::NAN);
            }
            let mut periods: Vec<Channels> = (1..record.samples() / period)
                .map(|j| error.iter().map(|e| e[j * period..(j + 1) * period].to_vec()).collect())
                .collect();
            if periods.len() < 2 {
                continue;
            }
            let share = without_their_mean(&mut periods);
            let white = |y: &Channels| {
                let period = Record { u: Vec::new(), y: y.clone(), simulated: None, ..record.clone() };
                Whitener::new(&period, &self.noise, problem.plant.rate, vec![Vec::new(); problem.plant.p])
            };
            let mut last = white(&periods[0]);
            for (j, deviation) in periods.iter().enumerate() {
                // Periods without missing samples have the same whitening.
                let whole = |y: &Channels| y.iter().flatten().all(|y| y.is_finite());
                if j > 0 && !(whole(deviation) && whole(&periods[j - 1])) {
                    last = white(deviation);
                }
                let mut to = vec![0.0; last.rows()];
                last.apply(deviation, &mut to);
                let shown = |(row, _): &(usize, &f64)| shows[last.output_of(*row)];
                power += to.iter().enumerate().filter(shown).map(|(_, x)| x * x).sum::<f64>();
                freedom += (0..shows.len()).filter(|&o| shows[o]).map(|o| last.values_of(o)).sum::<f64>();
            }
            // Each sample that is there in any period has determined a mean.
            let rows = last.rows() as f64 / shows.len() as f64;
            freedom -= rows * share.iter().zip(shows).filter(|(_, shows)| **shows).map(|(share, _)| share).sum::<f64>();
        }
        (power, freedom)
    }

    /// Looks again for missing modes, in the residual of a refit. While the simulation's own frequencies are off,
    /// their peaks hide smaller ones.
    pub fn renew_missing(&mut self, eta: &[f64]) {
        let problem = &mut self.problem;
        let left = errors(problem, eta, &[]);
        let signal = &problem.settings.signal;
        for mode in missing_modes(&problem.plant, &problem.records, &left, (signal, problem.setting.band_hz)) {
            let known = &mut problem.setting.missing;
            if !known.iter().any(|other| peaks::is_same(other.hz, mode.hz, signal.same_peak)) {
                known.push(mode);
            }
        }
    }

    /// Looks again for repeated values, in the errors of an explanation: in a large gap of the simulation as given,
    /// they do not stand out. Returns whether an output turned out to drop samples.
    pub fn renew_quantisation(&mut self, simulated: &[Channels]) -> bool {
        let records = &self.problem.records;
        let errors: Vec<Channels> = records.iter().zip(simulated).map(|(r, y)| r.error(y)).collect();
        let mut seen = quantisation::of_outputs(records, &errors, &self.declared_sensor, &self.problem.settings.signal);
        // The values of coarse converters have been corrected, so their other properties are known only from the
        // recorded values.
        for (new, old) in seen.iter_mut().zip(&self.quantisation) {
            let (dropout_rate, repeats) = (new.dropout_rate, std::mem::take(&mut new.repeats));
            *new = if old.coarse { old.clone() } else { Quantisation { dropout_rate, repeats, ..old.clone() } };
        }
        let more = |(new, old): (&Quantisation, &Quantisation)| new.dropout_rate > old.dropout_rate;
        if !seen.iter().zip(&self.quantisation).any(more) {
            return false;
        }
        self.quantisation = seen;
        self.problem.whiteners = whiteners(records, &self.noise, self.problem.plant.rate, &self.quantisation);
        true
    }

    /// Corrects coarsely rounded values by the free runs of a refit. Returns whether there are any.
    pub fn unround(&mut self, eta: &[f64]) -> bool {
        let rounds = self.quantisation.iter().any(Quantisation::rounds);
        if rounds {
            let simulated = outputs(&self.problem, eta, &[]);
            quantisation::unround(&mut self.problem.records, &simulated, &self.quantisation);
        }
        rounds
    }

    /// Removes a line whose phase wanders from the records. If `may_be` is set and the records indicate a random
    /// force in a band instead, the force becomes part of the noise. Returns a description of which of the two was
    /// found; `None` if there is no such line.
    pub fn renew_lines(&mut self, eta: &[f64], effects: &[Placed], may_be: bool) -> Option<&'static str> {
        let (which, line) = wandering(self, eta, effects)?;
        let mut others = effects.to_vec();
        others.remove(which);
        let simulated = outputs(&self.problem, eta, &others);
        if may_be && self.coloured.is_none() {
            // The lines were removed from the quiet records, so these are computed anew.
            let mut whole = self.clone();
            whole.quiet = whole.quiet_of(&simulated);
            whole.noise = whole.fitted(&whole.quiet);
            if let Some(force) = coloured(&whole).filter(|force| force.rather_than(&line, &whole)) {
                self.quiet = whole.quiet;
                self.with_band(force, &simulated);
                return Some(BAND);
            }
        }
        self.declared = self.declared.clone().with_line(line.port, line.hz);
        let near_line = self.problem.settings.prepare.near_line;
        let elsewhere = |hz: f64| (hz / line.hz - 1.0).abs() > near_line;
        self.problem.setting.tones.retain(|tone| elsewhere(tone.hz));
        self.problem.setting.missing.retain(|mode| elsewhere(mode.hz));
        self.wandering.push(line);
        self.quiet = self.quiet_of(&simulated);
        self.whiten_with(self.fitted(&self.quiet));
        Some("a line wanders")
    }

    /// Adds a random force in a band, which acts in the quiet records, to the noise, because separate forces on all
    /// modes represent it poorly. Returns a description if there is such a force and it was not known before.
    pub fn renew_band(&mut self, simulated: &[Channels]) -> Option<&'static str> {
        if self.coloured.is_some() {
            return None;
        }
        self.with_band(coloured(self)?, simulated);
        Some(BAND)
    }

    fn with_band(&mut self, force: Coloured, simulated: &[Channels]) {
        self.coloured = Some(force);
        let longest = self.quiet.iter().map(|stretch| stretch.length).max().unwrap_or(1);
        let plant = &self.problem.plant;
        let apart_widths = self.problem.settings.prepare.apart_widths;
        // In a short record, a resonance driven by noise looks like a line.
        let apart = |hz: f64, mode: &Mode| {
            (hz - mode.hz()).abs() > (mode.damping() * mode.hz()).max(plant.rate / longest as f64) * apart_widths
        };
        self.problem.setting.tones.retain(|tone| plant.modes.iter().all(|mode| apart(tone.hz, mode)));
        self.quiet = self.quiet_of(simulated);
        self.coloured = Some(force.sharpened(self));
        self.whiten_with(self.fitted(&self.quiet));
    }

    /// Fits the noise model to these stretches.
    fn fitted(&self, quiet: &[Stretch]) -> NoiseModel {
        let band = self.coloured.iter().map(Coloured::source);
        let noise = if quiet.is_empty() { self.declared.clone() } else { self.declared.fit_beside(quiet, band) };
        rounded(noise, quiet, &self.quantisation, (&self.declared_sensor, self.declares))
    }

    /// Adopts a noise model and whitens with it.
    fn whiten_with(&mut self, noise: NoiseModel) {
        self.problem.whiteners = whiteners(&self.problem.records, &noise, self.problem.plant.rate, &self.quantisation);
        self.noise = noise;
    }

    /// Returns the residual of the records without input, after removal of lines whose phase wanders. If a force acts
    /// in a band, the differences between the periods of other records are added, because a short record contains few
    /// independent values of a resonance driven by noise.
    fn quiet_of(&self, simulated: &[Channels]) -> Vec<Stretch> {
        let plant = &self.problem.plant;
        let left = |(record, y): (&Record, &Channels)| {
            let error = record.error(y);
            let mut left = self.wandering.iter().fold(error, |error, line| notch::without_both(&error, plant, line.hz));
            for (left, y) in left.iter_mut().zip(&record.y) {
                left.iter_mut().zip(y).filter(|(_, y)| y.is_nan()).for_each(|(left, _)| *left = f64::NAN);
            }
            Record { y: left, ..record.clone() }
        };
        let records = self.problem.records.iter().zip(simulated);
        let of_use =
            |(record, _): &(&Record, &Channels)| self.coloured.is_some() || record.excitation == Excitation::Zero;
        let errors: Vec<Record> = records.filter(of_use).map(left).collect();
        let shortest = self.problem.settings.prepare.shortest_quiet;
        let mut quiet = silent(&errors, shortest, |record| Stretch::new(&record.y));
        if self.coloured.is_some() {
            quiet.extend(repeated(plant, &errors, shortest));
        }
        quiet
    }

    /// Counts the residual of an explanation in driven records as an error of the simulation in addition to the
    /// noise. In practice, a simulation is off in many small ways that no effect explains. A likelihood with noise
    /// alone would treat each of these errors as significant and rank explanations by them.
    pub fn admit_error(&mut self, simulated: &[Channels]) {
        let problem = &self.problem;
        let errors: Vec<Channels> = problem.records.iter().zip(simulated).map(|(record, y)| record.error(y)).collect();
        let noise = |hz: f64| {
            let density = self.noise.density(hz);
            (0..density.nrows()).map(|o| density[(o, o)].re).collect()
        };
        let error = ModelError::left(&problem.records, &errors, noise, problem.plant.rate);
        self.declared.model_error.clone_from(&error);
        let mut noise = self.noise.clone();
        noise.model_error = error;
        self.whiten_with(noise);
        self.widened = Some(1.0);
    }

    /// Treats the part of the residual that the inputs do not explain as noise, as if the driven records were quiet.
    /// Looks for a random force in a band if `may_be` is set and resonances account for most of the noise at some
    /// output.
    pub fn take_for_noise(&mut self, simulated: &[Channels], may_be: bool) {
        let driven = self.problem.records.iter().zip(simulated).filter(|(record, _)| record.is_driven());
        let stretch = |(record, y): (&Record, &Channels)| {
            let error = record.error_where_measured(y);
            unexplained(record, &error).unwrap_or_else(|| Stretch::new(&error))
        };
        self.quiet = driven.map(stretch).collect();
        // The residual contains the error of the simulation.
        self.declared.model_error = None;
        self.noise = self.declared.fit_slow(&self.quiet);
        let resonant = may_be && self.noise.rings();
        if let Some(force) = resonant.then(|| coloured(self)).flatten() {
            self.coloured = Some(force);
            self.coloured = Some(force.sharpened(self));
            self.noise = self.fitted(&self.quiet);
        }
    }

    /// Returns the factor by which the limits must widen to contain most of these linear parameters. The refit shows
    /// which of the parameters the records determine.
    pub fn needed(&self, eta: &[f64], refitted: &Refit) -> f64 {
        let problem = &self.problem;
        problem.nuisance.needed(eta, &refitted.jacobian, problem.settings.fit.determined)
    }

    /// Widens the limits by a factor.
    pub fn widen(&mut self, scale: f64) {
        let nuisance = &mut self.problem.nuisance;
        let modes = nuisance.of_simulation();
        nuisance.std[..modes].iter_mut().for_each(|std| *std *= scale);
        self.widened = Some(scale);
    }

    /// Fits the noise again, to the residual of an explanation in the quiet records: a disturbance or a line in these
    /// records is not noise. Returns whether the noise changed enough for the residuals to be whitened again.
    pub fn renew_noise(&mut self, simulated: &[Channels]) -> bool {
        if self.off.iter().any(|step| matches!(step, Step::NoiseFit | Step::RenewedNoise)) {
            return false;
        }
        let quiet = self.quiet_of(simulated);
        if quiet.is_empty() {
            return false;
        }
        let noise = self.fitted(&quiet);
        self.quiet = quiet;
        let renewed = self.problem.settings.prepare.renewed;
        let changed = noise.rms().iter().zip(self.noise.rms()).any(|(a, b)| (a / b - 1.0).abs() > renewed);
        if changed {
            self.whiten_with(noise);
        }
        changed
    }
}

/// Adds the ports of a case.
fn declare(plant: &mut Plant, ports: &[CasePort]) -> Result<(), GapError> {
    plant.declare(ports).map_err(|(name, message)| GapError::Port { name, message })
}

/// Returns the whitener of each record, with repeated values masked.
fn whiteners(records: &[Record], noise: &NoiseModel, rate: f64, quantisation: &[Quantisation]) -> Vec<Whitener> {
    let masked = |k: usize| quantisation.iter().map(|output| output.repeats[k].clone()).collect();
    records.iter().enumerate().map(|(k, record)| Whitener::new(record, noise, rate, masked(k))).collect()
}

/// Adds the noise of converters and encoders: q^2 / 12 as soon as the signal moves, although a quiet record may be
/// constant. A coarse converter hides the noise before it, which is then taken as declared. If the values lie on a grid
/// and a quiet record is constant, the noise before the converter is small: with a standard deviation above a sixth of
/// a step, some value would have left its code. If the values occupy only a few codes, the frequency of each code gives
/// the noise before the converter. Otherwise the noise is that of the quiet records, and no less than the rounding.
fn rounded(
    noise: NoiseModel,
    quiet: &[Stretch],
    quantisation: &[Quantisation],
    (declared, declares): (&[f64], bool),
) -> NoiseModel {
    let shown = noise.sensors();
    let outputs = quantisation.iter().zip(declared).enumerate().filter(|(_, (output, _))| output.step.is_finite());
    outputs.fold(noise, |noise, (o, (output, std))| {
        let (rounding, variance) = (output.step * output.step / 12.0, std * std);
        let at_rest = output.grid && !quiet.is_empty() && is_constant(quiet, o, variance);
        let before = if declares { variance.min(rounding / 3.0) } else { 0.0 };
        noise.with_sensor(
            o,
            match (output.coarse, at_rest) {
                (true, _) => variance + rounding,
                (false, true) => before + rounding,
                (false, false) => shown[o].max(output.hidden.unwrap_or(0.0) + rounding),
            },
        )
    })
}

/// The description of a random force in a band.
const BAND: &str = "a force acts in a band";

/// Returns the signals that no command explains: records without input, or else the differences between repeats.
fn quiet_stretches(
    plant: &Plant,
    records: &[Record],
    tones: &[tones::Tone],
    settings: &PrepareSettings,
) -> Vec<Stretch> {
    let shortest = settings.shortest_quiet;
    // What is left of a motion that decays is no noise.
    let at_rest = |record: &Record| {
        if record.from_rest { record.y.clone() } else { record.error_where_measured(&run(plant, &[], record)) }
    };
    let silent = silent(records, shortest, |record| Stretch::new(&tones::without(&at_rest(record), plant.rate, tones)));
    if silent.is_empty() { repeated(plant, records, shortest) } else { silent }
}

/// Returns the differences between periods, and between other repeats of an input in records without enough periods.
fn repeated(plant: &Plant, records: &[Record], shortest: usize) -> Vec<Stretch> {
    let (mut stretches, mut others) = (Vec::new(), Vec::new());
    for record in records {
        let periods = differences(record, shortest);
        if periods.is_empty() {
            others.push(record);
        }
        stretches.extend(periods);
    }
    stretches.extend(repeats::differences(&others, repeats::settling(plant), shortest));
    stretches
}

/// Returns the stretches of records without input.
fn silent(records: &[Record], shortest: usize, stretch: impl Fn(&Record) -> Stretch) -> Vec<Stretch> {
    records.iter().filter(|record| is_silent(record, shortest)).map(stretch).collect()
}

/// Returns whether a record without input is long enough to show the noise.
fn is_silent(record: &Record, shortest: usize) -> bool {
    record.excitation == Excitation::Zero && record.samples() >= shortest
}

/// Subtracts from periods (p channels each) their mean over those in which a sample is not missing (NaN). Returns, for
/// each channel, the share of the samples that are there in at least one period.
fn without_their_mean(periods: &mut [Channels]) -> Vec<f64> {
    let (p, length) = (periods[0].len(), periods[0][0].len());
    let mut share = vec![0.0; p];
    for (o, k) in (0..p).flat_map(|o| (0..length).map(move |k| (o, k))) {
        let there = periods.iter().map(|period| period[o][k]).filter(|y| y.is_finite());
        let (sum, count) = there.fold((0.0, 0.0), |(sum, count), y| (sum + y, count + 1.0));
        if count > 0.0 {
            periods.iter_mut().for_each(|period| period[o][k] -= sum / count);
            share[o] += 1.0 / length as f64;
        }
    }
    share
}

/// Returns the differences between periods. The first two periods are left out, because they contain the transient.
fn differences(record: &Record, shortest: usize) -> Vec<Stretch> {
    let Excitation::Periodic(period) = record.excitation else { return Vec::new() };
    if period < shortest {
        return Vec::new();
    }
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let periods = record.samples() / period;
    let after = |first: usize| {
        let at = first * period;
        let difference: Channels =
            record.y.iter().map(|y| (at..at + period).map(|k| (y[k + period] - y[k]) * half).collect()).collect();
        Stretch::new(&difference)
    };
    (periods.min(2)..periods.saturating_sub(1)).step_by(2).map(after).collect()
}

/// Returns the errors of the simulation as given (p channels), one for each record.
fn given_errors(plant: &Plant, records: &[Record]) -> Vec<Channels> {
    records
        .iter()
        .map(|record| {
            let y = simulate(plant, &[], &record.u, record.start_s, None, Fineness::COARSE);
            record.error(&y)
        })
        .collect()
}

fn setting(
    plant: &Plant,
    model: &Model,
    records: &[Record],
    errors: &[Channels],
    (settings, band_hz): (&GapSettings, Option<[f64; 2]>),
) -> Setting {
    let loudest = (0..records.len()).max_by(|&a, &b| records[a].level().total_cmp(&records[b].level()));
    let (m, p) = (plant.m, plant.p);
    let mut setting = Setting { band_hz, ..Setting::bare(plant, model) };
    let Some(loudest) = loudest else { return setting };
    let sent: Vec<_> = records.iter().map(|record| commands(plant, &record.u)).collect();
    setting.duration_s = records.iter().map(|r| r.start_s + r.samples() as f64 / plant.rate).fold(0.0, f64::max);
    for i in 0..m {
        let slope = |u: &[f64]| rms(u.windows(2).map(|w| (w[1] - w[0]) * plant.rate));
        // A random record of the same level is much steeper than a multisine of a few lines.
        // The loudest record may not drive this input.
        let in_loudest = rms(&sent[loudest][i]);
        let anywhere = || sent.iter().map(|sent| rms(&sent[i])).fold(0.0, f64::max);
        setting.u_rms[i] = if in_loudest > 0.0 { in_loudest } else { anywhere() };
        setting.u_slope[i] = sent.iter().map(|sent| slope(&sent[i])).fold(0.0, f64::max);
    }
    let loudest = &records[loudest];
    for o in 0..p {
        setting.y_rms[o] = rms(loudest.y[o].iter().filter(|y| y.is_finite()));
        let all = records.iter().flat_map(|r| &r.y[o]);
        setting.y_max[o] = all.filter(|y| y.is_finite()).fold(0.0, |most: f64, y| most.max(y.abs()));
    }
    setting.d_range = (0..plant.ports.len()).map(|port| measured_range(plant, port, records)).collect();
    of_ports(&mut setting, records);
    setting.missing = missing_modes(plant, records, errors, (&settings.signal, band_hz));
    // Lines are most visible in a record without input.
    let quiet: Vec<usize> = (0..records.len()).filter(|&k| records[k].excitation == Excitation::Zero).collect();
    let shows_noise = !quiet.is_empty();
    let chosen: Vec<usize> = if shows_noise { quiet } else { (0..records.len()).collect() };
    let stretch = |k: usize| tones::Stretch { start_s: records[k].start_s, residual: &errors[k] };
    let first: Vec<tones::Stretch> = chosen.iter().map(|&k| stretch(k)).collect();
    let mut tones = tones::tones(&first, plant.rate, settings.prepare.tones, &settings.signal);
    let driven = |k: usize, hz: f64| tones::is_driven(&records[k], plant.rate, hz, settings.signal.driven_share);
    tones.retain(|tone| !chosen.iter().all(|&k| driven(k, tone.hz)));
    if !shows_noise && chosen.len() > 1 {
        let about = |hz: f64| errors.iter().map(move |error| wandering::powers_about(error, plant.rate, hz));
        let powers = |hz: f64| about(hz).collect::<Vec<_>>();
        tones.retain(|tone| wandering::is_steady(&powers(tone.hz), &setting.y_rms, settings.prepare.steady_line));
    }
    setting.tones = tones;
    setting
}

fn missing_modes(
    plant: &Plant,
    records: &[Record],
    errors: &[Channels],
    (settings, band_hz): (&SignalSettings, Option<[f64; 2]>),
) -> Vec<MissingModeStart> {
    let random = || records.iter().zip(errors).filter(|(record, _)| record.excitation == Excitation::Random);
    let driven: Vec<peaks::Driven> = random().map(|(record, error)| peaks::Driven { u: &record.u, error }).collect();
    // The units of outputs may differ by many orders of magnitude, and outputs may contain constants.
    let size = |o: usize| {
        let motion = rms(random().flat_map(|(record, _)| about_its_mean(&record.y[o])));
        let whole = rms(random().flat_map(|(record, _)| record.y[o].iter().filter(|y| y.is_finite())));
        match (motion > STANDS * whole, whole > 0.0) {
            (true, _) => motion,
            (_, true) => whole,
            _ => 1.0,
        }
    };
    let sizes: Vec<f64> = (0..plant.p).map(size).collect();
    peaks::missing_modes(plant, &driven, &sizes, settings, band_hz)
}

/// RMS of an output about its mean, relative to its RMS, below which the output stands still. Rounding errors of the
/// mean are smaller.
pub(crate) const STANDS: f64 = 1e-9;

/// Returns the measured samples of a channel without their mean.
fn about_its_mean(y: &[f64]) -> Vec<f64> {
    let measured: Vec<f64> = y.iter().copied().filter(|y| y.is_finite()).collect();
    let mean = measured.iter().sum::<f64>() / measured.len().max(1) as f64;
    measured.into_iter().map(|y| y - mean).collect()
}

/// Sets the properties of the ports from the loudest record. A port that it does not move is described by the record
/// that moves it most.
pub(crate) fn of_ports(setting: &mut Setting, records: &[Record]) {
    let plant = &setting.plant;
    setting.names.ports = plant.ports.iter().map(|port| port.name.clone()).collect();
    setting.d_range.resize(plant.ports.len(), None);
    let motion = |record: &Record| -> Vec<[f64; 2]> {
        port_motion(plant, &record.u).chunks_exact(2).map(|both| [rms(&both[0]), rms(&both[1])]).collect()
    };
    let loudest = records.iter().max_by(|a, b| a.level().total_cmp(&b.level()));
    let mut sizes = loudest.map_or_else(|| vec![[0.0; 2]; plant.ports.len()], motion);
    if sizes.iter().any(|both| both[1] == 0.0) {
        let all: Vec<_> = records.iter().map(motion).collect();
        for (port, both) in sizes.iter_mut().enumerate().filter(|(_, both)| both[1] == 0.0) {
            let most = all.iter().map(|sizes| sizes[port]).max_by(|a, b| a[1].total_cmp(&b[1]));
            *both = most.unwrap_or(*both);
        }
    }
    (setting.d_rms, setting.v_rms) = sizes.into_iter().map(|[d, v]| (d, v)).unzip();
    setting.stiffness = plant.ports.iter().map(|port| plant.stiffness(port)).collect();
    let force = |k: usize| match plant.ports[k].scale {
        PortScale::Moved { output, .. } => setting.y_rms[output],
        _ => force_size(plant, k, &setting.u_rms),
    };
    setting.force = (0..plant.ports.len()).map(force).collect();
}

/// Returns the lowest and the highest displacement at a port over all records, if an output measures the displacement.
/// A displacement that is the integral of a measured velocity counts from the beginning of the records from rest.
fn measured_range(plant: &Plant, port: usize, records: &[Record]) -> Option<[f64; 2]> {
    let port = &plant.ports[port];
    let mut all: Vec<f64> = Vec::new();
    if let Some((o, ratio)) = shown(plant, &port.displacement, &port.displacement_rest) {
        all.extend(records.iter().flat_map(|record| &record.y[o]).filter(|y| y.is_finite()).map(|y| y / ratio));
    } else if plant.integrates(port) {
        let (o, ratio) = shown(plant, &port.velocity, &port.velocity_rest)?;
        let from_rest = records.iter().filter(|record| record.from_rest);
        all.extend(from_rest.flat_map(|record| integral(&record.y[o], plant.rate)).map(|d| d / ratio));
    }
    let [low, high] = all.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], d| [low.min(*d), high.max(*d)]);
    (low < high).then_some([low, high])
}

/// Returns an output that is a multiple of a row of the states, and the factor.
fn shown(plant: &Plant, modal: &[C], rest: &nalgebra::DVector<f64>) -> Option<(usize, f64)> {
    let row = |modal: &mut dyn Iterator<Item = C>, rest: Vec<f64>| -> Vec<f64> {
        modal.flat_map(|x| [x.re, x.im]).chain(rest).collect()
    };
    let wanted = row(&mut modal.iter().copied(), rest.iter().copied().collect());
    let ratio = |o: usize| {
        let rest = plant.rest.c.row(o).iter().copied().collect();
        let seen = row(&mut plant.modes.iter().map(|mode| mode.c[o]), rest);
        let ratio = dot(&seen, &wanted) / dot(&wanted, &wanted);
        let apart: f64 = seen.iter().zip(&wanted).map(|(seen, wanted)| (seen - ratio * wanted).powi(2)).sum();
        (ratio.is_finite() && apart.sqrt() < SAME_ROW * dot(&seen, &seen).sqrt()).then_some(ratio)
    };
    (0..plant.p).find_map(|o| Some((o, ratio(o)?)))
}

/// Returns the integral of a signal from zero, by the trapezoidal rule. A missing sample repeats the one before.
fn integral(y: &[f64], rate: f64) -> Vec<f64> {
    let (mut sum, mut before) = (0.0, 0.0);
    let at = |y: &f64| {
        let now = if y.is_finite() { *y } else { before };
        sum += (before + now) / (2.0 * rate);
        before = now;
        sum
    };
    y.iter().map(at).collect()
}

/// Returns displacement and velocity at each port in turn, in the linear simulation from rest.
pub(crate) fn port_motion(plant: &Plant, u: &[Vec<f64>]) -> Channels {
    moving_ports(plant, &[], u, 0.0)
}

/// Returns displacement and velocity at each port in turn, in the simulation from rest with actions that do not change
/// the plant. `t0` is the time of the first sample.
pub(crate) fn moving_ports(plant: &Plant, actions: &[Action], u: &[Vec<f64>], t0: f64) -> Channels {
    if plant.ports.is_empty() {
        return Vec::new();
    }
    // The rows of the ports become further outputs of the same modes. A controller reads only the plant's own outputs.
    let mut probe = plant.clone();
    let (p, ports) = (plant.p, plant.ports.len());
    probe.p = p + 2 * ports;
    for (k, mode) in probe.modes.iter_mut().enumerate() {
        mode.c.extend(plant.ports.iter().flat_map(|port| [port.displacement[k], port.velocity[k]]));
    }
    let rows = |before: &nalgebra::DMatrix<f64>| before.clone().resize_vertically(p + 2 * ports, 0.0);
    (probe.rest.c, probe.d) = (rows(&plant.rest.c), rows(&plant.d));
    for (port, row) in plant.ports.iter().zip((p..).step_by(2)) {
        probe.rest.c.row_mut(row).copy_from(&port.displacement_rest.transpose());
        probe.rest.c.row_mut(row + 1).copy_from(&port.velocity_rest.transpose());
    }
    probe.sensed.extend(vec![plant.sensed[0]; 2 * ports]);
    let moved: Vec<(usize, usize)> =
        plant.ports.iter().enumerate().filter_map(|(k, port)| Some((k, port.moved_by()?))).collect();
    moved.iter().for_each(|&(k, input)| probe.d[(p + 2 * k, input)] = 1.0);
    let mut motion = simulate(&probe, actions, u, t0, None, Fineness::COARSE).split_off(p);
    moved.iter().for_each(|&(k, _)| motion[2 * k + 1] = slope(&motion[2 * k], plant.rate));
    motion
}

/// Returns the size of a force at a port that moves the modes as much as an input does on average.
fn force_size(plant: &Plant, port: usize, u_rms: &[f64]) -> f64 {
    let forced: f64 = plant.ports[port].force.iter().map(|g| g.norm_sqr()).sum();
    let driven: f64 = plant
        .modes
        .iter()
        .map(|mode| mode.b.iter().zip(u_rms).map(|(b, u)| (b * u).norm_sqr()).sum::<f64>() / plant.m as f64)
        .sum();
    match plant.ports[port].input {
        _ if forced > 0.0 && driven > 0.0 => (driven / forced).sqrt(),
        // A force on an axis has the unit of the input.
        Some(input) if plant.modes.is_empty() && u_rms[input] > 0.0 => u_rms[input],
        _ => force_on_rest(plant, port, u_rms),
    }
}

/// Returns the size of a force at a port that belongs to no input, in a plant without modes, such that the force
/// moves the states as much as the inputs do; one if nothing is driven.
fn force_on_rest(plant: &Plant, port: usize, u_rms: &[f64]) -> f64 {
    let Some((_, b)) = &plant.rest.continuous else { return 1.0 };
    let forced = plant.ports[port].force_rest.norm_squared();
    let driven: f64 = b.column_iter().zip(u_rms).map(|(b, u)| b.norm_squared() * u * u).sum();
    if forced > 0.0 && driven > 0.0 { (driven / forced).sqrt() } else { 1.0 }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::testing;

    pub(crate) fn setting_of(plant: &Plant, model: &Model) -> Setting {
        setting(plant, model, &[], &[], (&GapSettings::default(), None))
    }

    /// The loudest record drives one input alone, and a weaker one the other. Both have a size, and so does every port.
    #[test]
    fn an_input_that_the_loudest_record_does_not_drive_has_a_size() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        for (record, quiet) in case.records[1..].iter_mut().zip([1, 0, 1]) {
            record.u[quiet].fill(0.0);
            record.y = testing::run(&sim, &record.u);
        }
        let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let setting = &ready.problem.setting;
        for sizes in [&setting.u_rms, &setting.d_rms, &setting.v_rms, &setting.force] {
            assert!(sizes.iter().all(|size| *size > 0.0), "{sizes:?}");
        }
    }

    /// The steps of a coarse converter at one output say nothing about the noise of another output.
    #[test]
    fn a_coarse_converter_does_not_show_the_noise_of_other_outputs() {
        let sim = testing::truss(1);
        let settings = PrepareSettings::default();
        for (coarse, quiet, seen) in
            [([true, false], false, false), ([true, false], true, true), ([true, true], false, true)]
        {
            let mut case = testing::case(&sim, &sim);
            let std = case.model.as_ref().unwrap().noise.sensor_std.clone().unwrap();
            if !quiet {
                case.records.remove(0);
            }
            for record in &mut case.records {
                for ((y, std), _) in record.y.iter_mut().zip(&std).zip(coarse).filter(|(_, coarse)| *coarse) {
                    let step = 10.0 * std;
                    y.iter_mut().for_each(|y| *y = (*y / step).round() * step);
                }
            }
            let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
            assert_eq!(ready.quantisation.iter().map(|output| output.coarse).collect::<Vec<_>>(), coarse);
            let run = |record: &Record| simulate(&ready.problem.plant, &[], &record.u, 0.0, None, Fineness::COARSE);
            let simulated: Vec<Channels> = ready.problem.records.iter().map(run).collect();
            let level = ready.noise_level(&simulated, 1.0);
            let expected = if seen { settings.rounded_uncertainty } else { settings.declared_uncertainty };
            assert_eq!((level.seen, level.uncertainty), (seen, expected), "{coarse:?} {quiet}: {level:?}");
        }
    }

    /// A record without input that begins in motion shows how the modes decay, and not the noise on them.
    #[test]
    fn a_decay_is_no_noise() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        let shown = |case: &crate::case::Case| {
            let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
            ready.noise.rms()
        };
        let right = shown(&case);
        let quiet = &mut case.records[0];
        let (samples, noise) = (quiet.samples(), quiet.y.clone());
        let mut u = testing::random_input(9, 600, 2);
        u.iter_mut().for_each(|u| u.resize(600 + samples, 0.0));
        let decay = testing::run(&sim, &u).into_iter().map(|y| y[600..].to_vec());
        quiet.y = decay.zip(&noise).map(|(y, e)| y.iter().zip(e).map(|(y, e)| y + e).collect()).collect();
        quiet.from_rest = false;
        for (found, right) in shown(&case).iter().zip(&right) {
            assert!((found / right - 1.0).abs() < 0.2, "{found} {right}");
        }
    }

    /// Two coupled drives, whose tachometer shows the magnitude of the speed, with a model that was identified from
    /// such records. Forces on the mode of the model would account for all that the input does not explain, including
    /// the white noise.
    #[test]
    fn white_noise_is_not_taken_for_forces_on_modes() {
        use nalgebra::dmatrix;
        const STD: f64 = 0.01;
        let w = std::f64::consts::TAU * 1.6;
        let drives = dmatrix![0.0, 1.0, 0.0; -w * w, -0.24 * w, w * w; 0.0, 0.0, -2.0];
        let (a, b) = testing::held(&drives, &dmatrix![0.0; 0.0; 4.0], 0.02);
        let real = Model::new(50.0, a, b, dmatrix![1.0, 0.0, 0.0], dmatrix![0.0]).unwrap();
        let sim = Model::new(
            50.0,
            dmatrix![0.977417, 0.206484, 0.0; -0.196933, 0.977417, 0.0; 0.0, 0.0, 0.951519],
            dmatrix![-0.00848515; 0.0057503; 0.00589026],
            dmatrix![1.76615, -1.1092, 2.40212],
            dmatrix![-8.25478e-5],
        )
        .unwrap();
        let measured = |seed: u64| {
            let drawn = testing::random_input(seed, 50, 1);
            let u = vec![(0..500).map(|k| drawn[0][k / 10]).collect::<Vec<f64>>()];
            let mut y = testing::run(&real, &u);
            y[0].iter_mut().for_each(|y| *y = y.abs());
            testing::add_noise(&mut y, seed + 7, &[STD]);
            testing::record(u, y)
        };
        let ready = prepare(&sim, &[measured(1), measured(2)], &Known::default()).unwrap();
        let fitted = &ready.problem.records[0];
        let stretch =
            unexplained(fitted, &given_errors(&ready.problem.plant, std::slice::from_ref(fitted))[0]).unwrap();
        let without = ready.declared.fit(std::slice::from_ref(&stretch)).sensors()[0].sqrt();
        assert!(without < 0.1 * STD, "the forces account for little: {without}");
        let found = ready.noise.sensors()[0].sqrt();
        assert!(found > 0.7 * STD, "{found}");
    }

    /// The peaks of the simulation's own frequency errors hide a weak missing mode until a refit removes them.
    #[test]
    fn a_missing_mode_is_seen_behind_frequencies_that_are_off() {
        let real = testing::truss_with(1, |_, shapes, _| shapes.row_mut(2).scale_mut(0.1));
        let sim = testing::truss_with(1, |modes, shapes, _| {
            shapes.row_mut(2).fill(0.0);
            [0, 1, 3].into_iter().for_each(|k| modes[k].0 *= 1.003);
        });
        let case = testing::case(&sim, &real);
        let mut ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let seen =
            |ready: &Prepared| ready.problem.setting.missing.iter().any(|mode| (mode.hz / 186.0 - 1.0).abs() < 0.02);
        assert!(!seen(&ready), "it shows as given");
        let refitted = crate::fit::refit::refit(&ready.problem, crate::fit::refit::STEPS);
        ready.renew_missing(&refitted.eta);
        assert!(seen(&ready), "{:?}", ready.problem.setting.missing);
    }

    /// An encoder at rest shows no noise. As soon as it moves, its noise is that of its steps, and this holds for all
    /// records.
    #[test]
    fn an_encoder_at_rest_does_not_hide_its_steps() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        let std = case.model.as_ref().unwrap().noise.sensor_std.clone().unwrap();
        let steps: Vec<f64> = std.iter().map(|std| 1.5 * std).collect();
        for record in &mut case.records {
            let quiet = record.excitation == Excitation::Zero;
            for (y, step) in record.y.iter_mut().zip(&steps) {
                y.iter_mut().for_each(|y| *y = if quiet { 0.0 } else { (*y / step).round() * step });
            }
        }
        let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        for ((variance, step), std) in ready.noise.sensors().iter().zip(&steps).zip(&std) {
            assert!(*variance > 0.99 * step * step / 12.0 && *variance < 2.0 * std * std, "{variance} {step} {std}");
        }
    }

    /// The noise of an encoder is that of its steps, and is unrelated to the noise that is assumed if none is
    /// declared. A channel that is constant for another reason shows no noise level, so its noise is as declared.
    #[test]
    fn what_is_constant_at_rest_shows_no_noise_level() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        let declared = case.model.as_ref().unwrap().noise.sensor_std.clone().unwrap();
        let step = 0.3 * declared[0];
        for record in &mut case.records {
            record.y[0].iter_mut().for_each(|y| *y = (*y / step).round() * step + 0.4 * step);
            if record.excitation == Excitation::Zero {
                record.y[0].fill(0.4 * step);
                record.y[1].fill(0.0);
            }
        }
        let mut model = case.model.clone().unwrap();
        let noise = |model: &Model| {
            let ready = prepare(model, &case.records, &Known::default()).unwrap();
            (ready.noise.sensors(), ready.declared_sensor)
        };
        let (sensors, _) = noise(&model);
        assert!((sensors[0] / (step * step / 9.0) - 1.0).abs() < 1e-6, "{sensors:?}");
        assert!((sensors[1] / declared[1].powi(2) - 1.0).abs() < 1e-6, "{sensors:?}");
        model.noise.sensor_std = None;
        let (sensors, assumed) = noise(&model);
        assert!((sensors[0] / (step * step / 12.0) - 1.0).abs() < 1e-6, "{sensors:?}");
        assert!((sensors[1] / assumed[1].powi(2) - 1.0).abs() < 1e-6, "{sensors:?}");
    }

    /// If a driven plant has more noise than the quiet record, the quiet record determines the noise level.
    #[test]
    fn what_is_random_only_when_driven_is_no_noise() {
        const PERIOD: usize = 512;
        let sim = testing::truss(1);
        let case = testing::case(&sim, &sim);
        let std = case.model.as_ref().unwrap().noise.sensor_std.clone().unwrap();
        let once = testing::random_input(4, PERIOD, 2);
        let u: Channels = once.iter().map(|u| u.repeat(6)).collect();
        for (louder, expected) in [(1.0, None), (1.5, Some(2.25))] {
            let mut y = testing::run(&sim, &u);
            for ((y, noise), std) in y.iter_mut().zip(testing::random_input(5, 6 * PERIOD, 2)).zip(&std) {
                y.iter_mut().zip(noise).for_each(|(y, e)| *y += louder * std * e);
            }
            let mut records = case.records.clone();
            let excitation = Excitation::Periodic(PERIOD);
            records[1] = Record { excitation, u: u.clone(), y, ..records[1].clone() };
            let ready = prepare(case.model.as_ref().unwrap(), &records, &Known::default()).unwrap();
            let run = |record: &Record| simulate(&ready.problem.plant, &[], &record.u, 0.0, None, Fineness::FINE);
            let simulated: Vec<Channels> = ready.problem.records.iter().map(run).collect();
            let level = ready.noise_level(&simulated, 1.0);
            assert_eq!(level.driven.is_some(), expected.is_some(), "{level:?}");
            assert!((level.factor - 1.0).abs() < 0.1 && level.seen, "{level:?}");
            if let (Some(found), Some(expected)) = (level.driven, expected) {
                assert!((found / expected - 1.0_f64).abs() < 0.1, "{level:?}");
            }
        }
    }

    /// A few missing samples change each figure by less than 5 %, in every kind of record, and whether noise is
    /// declared or not.
    #[test]
    fn missing_outputs_are_masked() {
        const PERIOD: usize = 512;
        for declares in [true, false] {
            let real = testing::truss_with(1, |modes, _, _| modes[2].0 *= 1.01);
            let mut case = testing::case(&testing::truss(1), &real);
            let u: Channels = testing::random_input(4, PERIOD, 2).iter().map(|u| u.repeat(6)).collect();
            let mut y = testing::run(&real, &u);
            for (y, noise) in y.iter_mut().zip(testing::random_input(5, 6 * PERIOD, 2)) {
                y.iter_mut().zip(noise).for_each(|(y, e)| *y += 1e-3 * e);
            }
            case.records[1] = Record { excitation: Excitation::Periodic(PERIOD), u, y, ..case.records[1].clone() };
            let mut model = case.model.clone().unwrap();
            if !declares {
                model.noise.sensor_std = None;
            }
            let figures = |records: &[Record]| {
                let ready = prepare(&model, records, &Known::default()).unwrap();
                let problem = &ready.problem;
                let run = |record: &Record| simulate(&problem.plant, &[], &record.u, 0.0, None, Fineness::COARSE);
                let simulated: Vec<Channels> = problem.records.iter().map(run).collect();
                let level = ready.noise_level(&simulated, 1.0);
                [ready.noise.rms(), ready.declared_sensor.clone(), vec![level.factor]].concat()
            };
            let whole = figures(&case.records);
            for record in &mut case.records {
                let samples = record.samples();
                record.y[0][samples / 3] = f64::NAN;
                (0..samples).skip(5).step_by(400).for_each(|k| record.y[1][k] = f64::NAN);
            }
            for (with_gaps, whole) in figures(&case.records).iter().zip(&whole) {
                assert!((with_gaps / whole - 1.0).abs() < 0.05, "{with_gaps} for {whole}");
            }
        }
    }
}
