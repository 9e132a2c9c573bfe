//! The noise model of the records: white and slow sensor noise, actuator noise through the simulation, and a white
//! force on each mode.
//!
//! S(f) = sum of theta_j h_j(f) h_j(f)^H is fitted by maximum likelihood (Whittle, Ark. Mat. 2, 1953) to the part of
//! the records that no command explains: records without input, and differences between periods or other repeats of an
//! input. In closed loop, the noise of a sensor also moves the plant: y = S (P v + e), with the sensitivity S of the
//! loop.

mod bridge;
mod expected;
pub(crate) mod local_polynomial;
pub(crate) mod model_error;
pub(crate) mod repeats;
pub(crate) mod whiten;
pub(crate) mod whittle;

use std::f64::consts::{PI, TAU};

use nalgebra::{DMatrix, DVector};

use crate::noise::model_error::ModelError;
use crate::plant::Plant;
use crate::settings::NoiseSettings;
use crate::signal::notch;
use plid_fourier::C;

/// Relative width of the band that represents the remainder of a line with a random phase after its removal.
const LINE_WIDTH: f64 = 0.003;

/// Power of a channel without its mean, relative to that of the declared noise, up to which the channel counts as
/// constant: such a power is due to rounding.
const CONSTANT: f64 = 1e-12;

/// Smallest variance of a source relative to that from which its fit starts.
const LEAST: f64 = 1e-9;

/// Number of rounds of the fixed-point iteration, which converges linearly.
const ROUNDS: usize = 60;

/// Corners of slow sensor noise, over the sample rate. A sum of such spectra approximates any spectrum that falls
/// with frequency, such as that of flicker noise (Keshner, Proceedings of the IEEE 70, 1982, 212).
const CORNERS: [f64; 3] = [0.0025, 0.01, 0.04];

/// Spectra of a stretch that no command explains: p channels of bins, scaled so that |bin|^2 is a power spectral
/// density whose mean is sigma^2 for white noise.
#[derive(Debug, Clone)]
pub struct Stretch {
    /// Number of samples.
    pub length: usize,
    /// The bins (p channels).
    pub bins: Vec<Vec<C>>,
    /// Number of independent values of each channel: the mean of their squares has the relative variance 2 / freedom.
    pub freedom: f64,
}

impl Stretch {
    /// Computes the spectra of residuals (p channels) without their mean and trend. Missing samples (NaN) are bridged,
    /// and the power is that of the samples that are not missing.
    pub fn new(residual: &[Vec<f64>]) -> Self {
        let length = plid_fourier::good_length_below(residual[0].len());
        let mut freedom = 0.0;
        let spectrum = |x: &Vec<f64>| -> Vec<C> {
            let mut x = x[..length].to_vec();
            let missing: Vec<usize> = (0..length).filter(|&k| x[k].is_nan()).collect();
            detrend(&mut x);
            bridge::by_own_spectrum(&mut x, &missing);
            let there = (length - missing.len()) as f64;
            freedom += there / residual.len() as f64;
            let scale = 1.0 / there.max(1.0).sqrt();
            plid_fourier::forward(&x).into_iter().map(|z| z * scale).collect()
        };
        let bins = residual.iter().map(spectrum).collect();
        Self { length, bins, freedom }
    }

    /// Returns the spectra under Hann's window. Without the window, the leakage of a strong resonance would be
    /// mistaken for the noise next to it. Every second bin is almost independent of the others.
    pub fn tapered(&self) -> Self {
        let taper = |bins: &Vec<C>| -> Vec<C> {
            let at = |k: usize| bins[k.min(bins.len() - 1)];
            let one = |k: usize| (at(k) * 0.5 - (at(k.max(1) - 1) + at(k + 1)) * 0.25) / 0.375f64.sqrt();
            (0..bins.len()).map(one).collect()
        };
        let bins = self.bins.iter().map(taper).collect();
        Self { length: self.length, bins, freedom: 0.5 * self.freedom }
    }

    fn hz(&self, k: usize, rate: f64) -> f64 {
        k as f64 * rate / self.length as f64
    }
}

/// Returns whether an output is constant in all stretches, compared with noise of this variance.
pub fn is_constant(stretches: &[Stretch], o: usize, variance: f64) -> bool {
    let power = |stretch: &Stretch| stretch.bins[o].iter().map(C::norm_sqr).sum::<f64>();
    stretches.iter().all(|stretch| power(stretch) <= CONSTANT * variance * stretch.bins[o].len() as f64)
}

/// Removes mean and trend from the samples that are not missing and sets the missing ones to zero.
fn detrend(x: &mut [f64]) {
    let there: Vec<usize> = (0..x.len()).filter(|&k| !x[k].is_nan()).collect();
    let n = there.len().max(1) as f64;
    let middle = there.iter().sum::<usize>() as f64 / n;
    let mean = there.iter().map(|&k| x[k]).sum::<f64>() / n;
    let square: f64 = there.iter().map(|&k| (k as f64 - middle).powi(2)).sum();
    let slope = there.iter().map(|&k| (k as f64 - middle) * x[k]).sum::<f64>() / square.max(1.0);
    for (k, x) in x.iter_mut().enumerate() {
        *x = if x.is_nan() { 0.0 } else { *x - (mean + slope * (k as f64 - middle)) };
    }
}

/// A source of noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source {
    /// White noise of one sensor.
    Sensor(usize),
    /// Slow noise of one sensor: white noise through a low-pass of first order.
    Slow(Slow),
    /// White noise of one input, held over samples.
    Actuator(usize),
    /// A white force on one mode.
    Mode(usize),
    /// White forces on all modes, in proportion to the ports' shapes.
    Ambient,
    /// A force at a port in a frequency band.
    Band(Band),
}

/// A low-pass of first order at a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slow {
    /// The output.
    pub output: usize,
    /// Corner in Hz.
    pub hz: f64,
}

/// A band-pass of second order with a slope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    /// The port at which the force acts.
    pub port: usize,
    /// Centre in Hz.
    pub hz: f64,
    /// Width over centre.
    pub width: f64,
    /// Exponent of the power of frequency that multiplies the amplitude: 0 for a band-pass, which falls off equally
    /// on both sides; -1 for a resonator, which passes slow forces.
    pub slope: f64,
}

impl Band {
    /// Returns the band about a line whose phase wanders.
    pub fn line(port: usize, hz: f64) -> Self {
        Self::pass(port, hz, LINE_WIDTH)
    }

    /// Returns a band that falls off equally on both sides.
    pub fn pass(port: usize, hz: f64, width: f64) -> Self {
        Self { port, hz, width, slope: 0.0 }
    }
}

/// A fitted noise model.
#[derive(Debug, Clone)]
pub struct NoiseModel {
    /// The plant through which the noise passes.
    plant: Plant,
    /// The sources with their variances.
    pub sources: Vec<(Source, f64)>,
    /// Negative log likelihood over the stretches, without constants.
    pub misfit: f64,
    /// Number of bins used.
    pub bins: usize,
    /// For a surrogate model, its error on the records from which it was identified. This error grows with the level
    /// and does not occur in quiet records.
    pub model_error: Option<ModelError>,
    /// The frequency band in Hz that counts, if not all frequencies do. The noise outside the band has no bound.
    pub band_hz: Option<[f64; 2]>,
    /// Lines whose phase wanders, as port and frequency in Hz. Their modulated sines are removed from the records.
    pub lines: Vec<(usize, f64)>,
    /// The thresholds of the fit.
    pub settings: NoiseSettings,
}

impl NoiseModel {
    /// Creates the declared noise: standard deviations of sensors (p) and actuators (m).
    pub fn declared(plant: &Plant, sensor: &[f64], actuator: &[f64]) -> Self {
        let sensors = sensor.iter().enumerate().map(|(o, std)| (Source::Sensor(o), std * std));
        let actuators = actuator.iter().enumerate().map(|(i, std)| (Source::Actuator(i), std * std));
        let sources = sensors.chain(actuators).collect();
        Self {
            plant: plant.clone(),
            sources,
            misfit: f64::NAN,
            bins: 0,
            model_error: None,
            band_hz: None,
            lines: Vec::new(),
            settings: NoiseSettings::default(),
        }
    }

    /// Returns the noise of a plant with one additional output, with white noise of this variance at the new output.
    pub(crate) fn with_output(&self, plant: &Plant, variance: f64) -> Self {
        let mut more = Self { plant: plant.clone(), ..self.clone() };
        more.sources.push((Source::Sensor(plant.p - 1), variance));
        more
    }

    /// Returns the plant for which the model was made.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Returns the number of ports of the plant for which the model was made. Ports on single modes are added later.
    pub fn ports(&self) -> usize {
        self.plant.ports.len()
    }

    /// Adds the slow noise of those sensors that have much of it to this model, and returns the fit to stretches.
    /// Without it, the skirts of forces on modes would have to represent slow noise, and the noise at the modes
    /// themselves would be far too large.
    pub fn fit_slow(&mut self, stretches: &[Stretch]) -> Self {
        let slow = |output| CORNERS.map(|corner| Source::Slow(Slow { output, hz: corner * self.plant.rate }));
        let all: Vec<Source> = (0..self.plant.p).flat_map(slow).collect();
        let (with, without) = (self.fit_beside(stretches, all), self.fit(stretches));
        if without.misfit - with.misfit <= self.settings.slow_gain {
            return without;
        }
        let declared = self.sources.len();
        for (output, white) in with.sensors().into_iter().enumerate() {
            let of_output = |source: &Source| matches!(source, Source::Slow(slow) if slow.output == output);
            let slow = || with.sources.iter().filter(|(source, _)| of_output(source)).copied();
            if slow().map(|(_, theta)| theta).sum::<f64>() > self.settings.slow_power * white {
                self.sources.extend(slow());
            }
        }
        if self.sources.len() > declared { self.fit(stretches) } else { without }
    }

    /// Fits the variances of sensors and modal forces to stretches. The actuator noise remains as declared.
    pub fn fit(&self, stretches: &[Stretch]) -> Self {
        self.fit_beside(stretches, None)
    }

    /// Fits the variances of sensors, modal forces and further sources to stretches.
    pub fn fit_beside(&self, stretches: &[Stretch], others: impl IntoIterator<Item = Source>) -> Self {
        let modes = (0..self.plant.modes.len()).map(Source::Mode);
        self.fit_with(stretches, &modes.chain(others).collect::<Vec<Source>>(), ROUNDS, 1)
    }

    /// Fits the variances of sensors and of these sources to every `thin`th bin.
    pub fn fit_with(&self, stretches: &[Stretch], more: &[Source], rounds: usize, thin: usize) -> Self {
        let mut model = self.clone();
        let level = self.sensor_variance();
        for &source in more {
            // The starting value of each variance gives a peak as high as the sensor noise.
            let power = |hz: f64| self.columns(source, hz).iter().map(|h| h.norm_squared()).sum::<f64>();
            let peak = self.plant.modes.iter().map(|mode| power(mode.pole.im / TAU)).fold(0.0, f64::max);
            if peak > 0.0 {
                model.sources.push((source, level / peak));
            }
        }
        let rows: Vec<Row> = stretches.iter().flat_map(|s| model.rows(s, thin)).collect();
        let mut theta: Vec<f64> = model.sources.iter().map(|(_, theta)| *theta).collect();
        // A constant channel shows no noise level, so its noise remains as declared.
        let fixed = model.sources.iter().map(|(source, theta)| match source {
            Source::Actuator(_) => true,
            Source::Sensor(o) => is_constant(stretches, *o, *theta),
            _ => false,
        });
        let fixed: Vec<bool> = fixed.collect();
        let least: Vec<f64> = theta.iter().map(|theta| LEAST * theta).collect();
        let mut used = vec![true; rows.len()];
        for round in 0..rounds {
            let (up, down) = ratios(&rows, &theta, &mut used, (round >= 5).then_some(self.settings.line_power));
            for j in 0..theta.len() {
                if !fixed[j] && down[j] > 0.0 {
                    theta[j] *= (up[j] / down[j]).sqrt().clamp(0.2, 5.0);
                    theta[j] = theta[j].max(least[j]);
                }
            }
        }
        model.misfit = 0.0;
        for (row, _) in rows.iter().zip(&used).filter(|(_, used)| **used) {
            let covariance = row.covariance(&theta);
            let determinant = covariance.determinant().norm().ln();
            let power = covariance.try_inverse().map_or(0.0, |inverse| row.data.dotc(&(inverse * &row.data)).re);
            model.misfit += determinant + power;
        }
        model.bins = used.iter().filter(|used| **used).count();
        model.sources.iter_mut().zip(theta).for_each(|((_, to), from)| *to = from);
        model
    }

    /// Returns the model with a different variance of one sensor (V^2).
    pub fn with_sensor(mut self, output: usize, variance: f64) -> Self {
        for (source, theta) in &mut self.sources {
            if *source == Source::Sensor(output) {
                *theta = variance;
            }
        }
        self
    }

    /// Returns the model with a line whose phase wanders: a narrow band at a port for the remainder of the line after
    /// its removal.
    pub fn with_line(mut self, port: usize, hz: f64) -> Self {
        let band = Source::Band(Band::line(port, hz));
        let peak = self.columns(band, hz)[0].norm_squared();
        let start = self.sensor_variance() / peak.max(f64::MIN_POSITIVE);
        self.sources.push((band, start));
        self.lines.push((port, hz));
        self
    }

    /// Returns whether the noise contains a force in a band or a line whose phase wanders. Resonances then ring far
    /// above all other noise.
    pub fn drives(&self) -> bool {
        self.sources.iter().any(|(source, _)| matches!(source, Source::Band(_)))
    }

    /// Returns whether forces on modes account for most of the noise of some output.
    pub fn rings(&self) -> bool {
        let mut rest = self.clone();
        rest.sources.retain(|(source, _)| !matches!(source, Source::Mode(_)));
        self.rms().iter().zip(rest.rms()).any(|(all, rest)| rest * rest < 0.5 * all * all)
    }

    /// Returns the power of forces in bands at an output at frequencies where they are weak, as the variance (V^2) of
    /// white noise: a quarter of all frequencies have less power.
    pub fn skirts(&self, output: usize) -> f64 {
        const POINTS: u32 = 256;
        let at = |hz: f64| -> f64 {
            let bands = self.sources.iter().filter(|(source, _)| matches!(source, Source::Band(_)));
            bands.map(|(band, theta)| theta * self.columns(*band, hz)[0][output].norm_sqr()).sum()
        };
        let frequencies = (1..POINTS).map(|k| 0.5 * self.plant.rate * f64::from(k) / f64::from(POINTS));
        let mut powers: Vec<f64> = frequencies.map(at).collect();
        powers.sort_by(f64::total_cmp);
        powers[powers.len() / 4]
    }

    /// Returns the variance of each sensor in V^2.
    pub fn sensors(&self) -> Vec<f64> {
        let of = |(source, theta): &(Source, f64)| matches!(source, Source::Sensor(_)).then_some(*theta);
        self.sources.iter().filter_map(of).collect()
    }

    fn sensor_variance(&self) -> f64 {
        let all = self.sensors();
        all.iter().sum::<f64>() / all.len().max(1) as f64
    }

    /// Returns the frequencies that count, with the bins of a stretch there.
    pub(crate) fn bins(&self, stretch: &Stretch) -> impl Iterator<Item = (f64, DVector<C>)> {
        // The bins at zero, of the trend and at half the rate are not circularly Gaussian.
        let taken_out = |hz: f64| self.lines.iter().any(|(_, line)| (hz - line).abs() < notch::HOLE_HZ);
        (2..stretch.bins[0].len() - 1)
            .map(|k| (k, stretch.hz(k, self.plant.rate)))
            .filter(move |(_, hz)| !taken_out(*hz))
            .map(|(k, hz)| (hz, DVector::from_iterator(stretch.bins.len(), stretch.bins.iter().map(|bins| bins[k]))))
    }

    fn rows(&self, stretch: &Stretch, thin: usize) -> Vec<Row> {
        let columns = |hz: f64| self.sources.iter().map(|(source, _)| self.columns(*source, hz)).collect();
        self.bins(stretch).step_by(thin).map(|(hz, data)| Row { columns: columns(hz), data }).collect()
    }

    /// Returns the response of the outputs to a unit of a source at a frequency: one column for each independent part.
    pub(crate) fn columns(&self, source: Source, hz: f64) -> Vec<DVector<C>> {
        let plant = &self.plant;
        // In closed loop, the controller responds to whatever enters at an output.
        let closed = |open: DVector<C>| plant.sensitivity(hz).map_or(open.clone(), |sensitivity| sensitivity * open);
        match source {
            Source::Sensor(o) => vec![closed(unit(plant.p, o, 1.0))],
            Source::Slow(Slow { output, hz: corner }) => {
                vec![closed(unit(plant.p, output, 1.0 / (1.0 + (hz / corner).powi(2)).sqrt()))]
            }
            Source::Actuator(i) => vec![plant.response(hz).column(i).into_owned()],
            Source::Mode(k) => vec![closed(self.modal(k, hz))],
            Source::Ambient => (0..plant.modes.len()).map(|k| closed(self.modal(k, hz))).collect(),
            Source::Band(Band { port, hz: centre, width, slope }) => {
                // A force that is held over samples has a periodic spectrum, so frequencies are replaced by chords of
                // the unit circle. Near the centre, nothing changes. Far above it, the skirt of a resonator levels
                // off, which matters if a force passes straight through to an accelerometer.
                let angle = |hz: f64| PI * hz / plant.rate;
                let of_centre = angle(hz.max(1e-9)).sin() / angle(centre).sin();
                let ratio = of_centre - 1.0 / of_centre;
                let width = width * angle(centre) / angle(centre).tan();
                let gain = of_centre.powf(slope) / (1.0 + (ratio / width).powi(2)).sqrt();
                vec![plant.port_response(port, hz) * C::from(gain)]
            }
        }
    }

    /// Returns the response to a unit white force on one mode, held over samples, in proportion to the ports' shapes,
    /// or to those of the inputs if there is no port.
    fn modal(&self, k: usize, hz: f64) -> DVector<C> {
        let plant = &self.plant;
        let z = C::cis(TAU * hz / plant.rate);
        let mode = &plant.modes[k];
        let turn = (mode.pole / plant.rate).exp();
        let of_ports = plant.ports.iter().map(|port| port.force[k]);
        let force: Vec<C> = if plant.ports.is_empty() { mode.b.clone() } else { of_ports.collect() };
        let size = force.iter().map(|g| g.norm_sqr()).sum::<f64>().sqrt();
        let phase = C::cis(force.iter().map(|g| g * g).sum::<C>().arg() / 2.0);
        let held = (turn - 1.0) / mode.pole * size * phase;
        DVector::from_fn(plant.p, |o, _| {
            let residue = mode.c[o] * held;
            residue / (z - turn) + residue.conj() / (z - turn.conj())
        })
    }

    /// Returns the spectral density at a frequency (p x p).
    pub fn density(&self, hz: f64) -> DMatrix<C> {
        let p = self.plant.p;
        let mut sum = DMatrix::zeros(p, p);
        for (source, theta) in &self.sources {
            for h in self.columns(*source, hz) {
                sum += (&h * h.adjoint()) * C::from(*theta);
            }
        }
        sum
    }

    /// Returns the RMS of each output's noise, without lines whose phase wanders.
    pub fn rms(&self) -> Vec<f64> {
        let bins = 2048;
        let mut sums = vec![0.0; self.plant.p];
        let mut steady = self.clone();
        steady
            .sources
            .retain(|(source, _)| !matches!(source, Source::Band(band) if self.lines.contains(&(band.port, band.hz))));
        for k in 0..bins {
            let density = steady.density((k as f64 + 0.5) * self.plant.rate / (2 * bins) as f64);
            sums.iter_mut().enumerate().for_each(|(o, sum)| *sum += density[(o, o)].re);
        }
        sums.into_iter().map(|sum| (sum / bins as f64).sqrt()).collect()
    }
}

/// Returns a vector that is zero except for one entry.
fn unit(length: usize, at: usize, value: f64) -> DVector<C> {
    DVector::from_fn(length, |i, _| if i == at { C::from(value) } else { C::ZERO })
}

struct Row {
    /// The responses to each source.
    columns: Vec<Vec<DVector<C>>>,
    data: DVector<C>,
}

impl Row {
    fn covariance(&self, theta: &[f64]) -> DMatrix<C> {
        let p = self.data.len();
        let mut sum = DMatrix::zeros(p, p);
        for (h, &theta) in self.columns.iter().zip(theta).flat_map(|(hs, theta)| hs.iter().map(move |h| (h, theta))) {
            for j in 0..p {
                for i in 0..p {
                    sum[(i, j)] += h[i] * h[j].conj() * theta;
                }
            }
        }
        sum
    }
}

/// Returns the power that rows of data have along each source, and the power that they should have with these
/// variances. A row whose power relative to that of the model reaches `line_power` is not `used`.
fn ratios(rows: &[Row], theta: &[f64], used: &mut [bool], line_power: Option<f64>) -> (Vec<f64>, Vec<f64>) {
    let (mut up, mut down) = (vec![0.0; theta.len()], vec![0.0; theta.len()]);
    for (row, used) in rows.iter().zip(used) {
        let Some(inverse) = row.covariance(theta).try_inverse() else { continue };
        let seen = &inverse * &row.data;
        let power = row.data.dotc(&seen).re / row.data.len() as f64;
        *used = line_power.is_none_or(|line_power| power < line_power);
        if !*used {
            continue;
        }
        for (j, columns) in row.columns.iter().enumerate() {
            for h in columns {
                up[j] += h.dotc(&seen).norm_sqr();
                down[j] += h.dotc(&(&inverse * h)).re;
            }
        }
    }
    (up, down)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{RATE, random_input, truss_with};

    /// Sensor noise with a slow part is represented as such, and not by forces on the modes: in a short record, the
    /// skirts of a slow mode imitate it, and the noise at the resonance would be far too large. White noise has no
    /// slow part.
    #[test]
    fn slow_sensor_noise_is_no_force_on_the_modes() {
        const SAMPLES: usize = 2048;
        let model = truss_with(2, |modes, _, _| modes[0] = (12.0, 0.005));
        let plant = Plant::new(&model).unwrap();
        let declared = NoiseModel::declared(&plant, &[1e-3; 2], &[0.0; 2]);
        let white = random_input(1, SAMPLES, 2);
        let scaled = |by: f64| -> Vec<Vec<f64>> { white.iter().map(|x| x.iter().map(|x| by * x).collect()).collect() };
        let mut with_slow = declared.clone();
        with_slow.fit_slow(&[Stretch::new(&scaled(1e-3))]);
        assert_eq!(with_slow.sources.len(), declared.sources.len());
        for hz in [5.0, 20.0] {
            let pole = (-TAU * hz / RATE).exp();
            let mut noise = scaled(0.8e-3);
            for (noise, fresh) in noise.iter_mut().zip(random_input(2, SAMPLES, 2)) {
                let mut state = 0.0;
                for (noise, fresh) in noise.iter_mut().zip(fresh) {
                    state = pole * state + (1.0 - pole * pole).sqrt() * fresh;
                    *noise += 0.6e-3 * state;
                }
            }
            let stretch = [Stretch::new(&noise)];
            let (found, before) = (declared.clone().fit_slow(&stretch), declared.fit(&stretch));
            assert!(found.misfit < before.misfit - 30.0, "{hz}: {} {}", found.misfit, before.misfit);
            for (found, before) in found.rms().into_iter().zip(before.rms()) {
                let [found, before] = [found, before].map(|rms| (rms / 1e-3).ln().abs());
                assert!(found < 0.15 && found < 0.5 * before, "{hz}: {found} {before}");
            }
        }
    }

    /// Missing samples of slow noise are not taken for white noise.
    #[test]
    fn missing_samples_are_no_white_noise() {
        const SAMPLES: usize = 4096;
        let plant = Plant::new(&truss_with(2, |_, _, _| {})).unwrap();
        let declared = NoiseModel::declared(&plant, &[1e-3; 2], &[0.0; 2]);
        let pole = (-TAU * 5.0 / RATE).exp();
        let mut noise = random_input(1, SAMPLES, 2);
        for (noise, fresh) in noise.iter_mut().zip(random_input(2, SAMPLES, 2)) {
            let mut state = 0.0;
            for (noise, fresh) in noise.iter_mut().zip(fresh) {
                state = pole * state + (1.0 - pole * pole).sqrt() * fresh;
                *noise = 1e-3 * *noise + 1e-2 * state;
            }
        }
        let found = |noise: &[Vec<f64>]| declared.clone().fit_slow(&[Stretch::new(noise)]).sensors();
        let whole = found(&noise);
        noise.iter_mut().for_each(|noise| (5..SAMPLES).step_by(100).for_each(|k| noise[k] = f64::NAN));
        for (with_gaps, whole) in found(&noise).iter().zip(&whole) {
            assert!((with_gaps / whole - 1.0).abs() < 0.15, "{with_gaps} {whole}");
        }
    }
}
