//! Experiments that may come next: signals for the inputs of the plant, each with its description.

use std::f64::consts::TAU;

use plid_report::Cell;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::case::levels::loudest;
use crate::case::record::{Channels, Excitation, rms};
use crate::fit::problem::Problem;
use crate::plant::Plant;
use plid_fourier::C;

/// Levels relative to that of the loudest input, with their descriptions.
const LEVELS: [(f64, &str); 4] =
    [(1.0, "its level"), (1.0 / 3.0, "a third of its level"), (2.0, "twice its level"), (4.0, "four times its level")];

/// Levels of synthetic signals relative to that of the loudest record, with their descriptions.
const SYNTHETIC: [(f64, &str); 2] = [(1.0, "the highest level so far"), (2.0, "twice the highest level so far")];

/// The band of synthetic signals: below the lowest and above the highest mode by these factors, so that the flanks of
/// all resonances are driven.
const AROUND_MODES: [f64; 2] = [0.5, 1.25];

/// The band without modes, over the sample rate: from a frequency with several periods in a record to one at which a
/// held input still moves a sampled plant.
const WITHOUT_MODES: [f64; 2] = [2e-3, 0.1];

/// Highest frequency over the sample rate. It is below one half, so that a held input is still close to a sine.
const HIGHEST: f64 = 0.4;

/// A possible experiment.
#[derive(Clone)]
pub(super) struct Experiment {
    /// The inputs.
    pub u: Channels,
    pub excitation: Excitation,
    /// The record to take, in words but without its length.
    pub words: String,
    /// The port at which there is one more sensor.
    pub sensor: Option<usize>,
}

impl Experiment {
    fn driven(u: Channels, words: String) -> Self {
        Self { u, excitation: Excitation::Random, words, sensor: None }
    }

    /// Returns this experiment with one more sensor.
    pub fn with_sensor(&self, port: usize, name: &str) -> Self {
        let words = format!("{}, with one more sensor at port:{name}", self.words);
        Self { sensor: Some(port), words, ..self.clone() }
    }
}

/// Returns the experiments of a given length, the simplest first: no input, the input of the loudest record at
/// several levels, each input alone, multisines and chirps.
pub(super) fn experiments(problem: &Problem, samples: usize) -> Vec<Experiment> {
    let loudest = loudest(&problem.records, problem.settings.case.same_level);
    let levels: Vec<f64> = loudest.u.iter().map(rms).collect();
    // A record that is too short is repeated.
    let scaled = |by: &dyn Fn(usize) -> f64| -> Channels {
        let scale = |(i, u): (usize, &Vec<f64>)| u.iter().cycle().take(samples).map(|x| by(i) * x).collect();
        loudest.u.iter().enumerate().map(scale).collect()
    };
    let mut all = vec![Experiment {
        u: vec![vec![0.0; samples]; loudest.u.len()],
        excitation: Excitation::Zero,
        words: "Record without input".into(),
        sensor: None,
    }];
    for (level, name) in LEVELS {
        let words = if level == 1.0 {
            "Record the input of the loudest record once more, from rest".into()
        } else {
            format!("Record the input of the loudest record at {name}")
        };
        all.push(Experiment::driven(scaled(&|_| level), words));
    }
    let names = &problem.setting.names.inputs;
    if names.len() > 1 {
        for (alone, name) in names.iter().enumerate() {
            let words = format!("Record with {name} alone at twice its highest level");
            all.push(Experiment::driven(scaled(&|i| if i == alone { 2.0 } else { 0.0 }), words));
        }
    }
    let (band, rate) = (band(&problem.plant), problem.plant.rate);
    let signals = [
        ("a random-phase multisine", multisine(&levels, band, rate, samples)),
        ("a chirp", chirp(&levels, band, rate, samples)),
    ];
    for (signal, u) in signals {
        for (level, name) in SYNTHETIC {
            let u = u.iter().map(|u| u.iter().map(|x| level * x).collect()).collect();
            let inputs = if names.len() > 1 { "all inputs" } else { "the input" };
            let [from, to] = band.map(|hz| Cell::significant(hz, 3));
            let words = format!("Record {signal} from {from} to {to} Hz on {inputs} at {name}, from rest");
            all.push(Experiment::driven(u, words));
        }
    }
    all
}

/// Returns the band of synthetic signals in Hz, rounded to three digits.
fn band(plant: &Plant) -> [f64; 2] {
    let ends = match (plant.modes.first(), plant.modes.last()) {
        (Some(first), Some(last)) => [AROUND_MODES[0] * first.hz(), AROUND_MODES[1] * last.hz()],
        _ => WITHOUT_MODES.map(|share| share * plant.rate),
    };
    let digits = |x: f64| {
        let unit = 10_f64.powf(x.log10().floor() - 2.0);
        (x / unit).round() * unit
    };
    [digits(ends[0]), digits(ends[1].min(HIGHEST * plant.rate))]
}

/// Returns a multisine with lines of equal amplitude in a band for each input, with random phases and these RMS
/// values. Different phases on different inputs allow their responses to be separated.
fn multisine(levels: &[f64], [from, to]: [f64; 2], rate: f64, samples: usize) -> Channels {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let one = |level: &f64| {
        let line = |k: usize| {
            let hz = k as f64 * rate / samples as f64;
            let phase = TAU * rng.random_range(0.0..1.0);
            if k > 0 && (from..=to).contains(&hz) { C::from_polar(1.0, phase) } else { C::ZERO }
        };
        let lines: Vec<C> = (0..=samples / 2).map(line).collect();
        at_level(plid_fourier::backward(&lines, samples), *level)
    };
    levels.iter().map(one).collect()
}

/// Returns a linear sweep over a band for each input, with these RMS values. Successive inputs are swept upwards and
/// downwards in turn, so that their responses can be separated.
fn chirp(levels: &[f64], [from, to]: [f64; 2], rate: f64, samples: usize) -> Channels {
    let duration = samples as f64 / rate;
    let one = |(i, level): (usize, &f64)| {
        let (first, last) = if i % 2 == 0 { (from, to) } else { (to, from) };
        let sine = |k: usize| {
            let t = k as f64 / rate;
            (TAU * (first * t + 0.5 * (last - first) * t * t / duration)).sin()
        };
        at_level((0..samples).map(sine).collect(), *level)
    };
    levels.iter().enumerate().map(one).collect()
}

fn at_level(signal: Vec<f64>, level: f64) -> Vec<f64> {
    let size = rms(&signal);
    let by = if size > 0.0 { level / size } else { 0.0 };
    signal.into_iter().map(|x| by * x).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both signals have the requested levels, have nearly all of their power in the band, and differ between inputs.
    #[test]
    fn synthetic_signals_have_their_levels_and_their_band() {
        let (rate, samples, band) = (1000.0, 2000, [40.0, 200.0]);
        for signal in [multisine(&[0.5, 2.0], band, rate, samples), chirp(&[0.5, 2.0], band, rate, samples)] {
            for (u, level) in signal.iter().zip([0.5, 2.0]) {
                assert!((rms(u) / level - 1.0).abs() < 1e-9);
                let lines = plid_fourier::forward(u);
                let power = |inside: bool| -> f64 {
                    let hz = |k: usize| k as f64 * rate / samples as f64;
                    let within = |k: &usize| ((band[0] - 5.0..=band[1] + 5.0).contains(&hz(*k))) == inside;
                    (0..lines.len()).filter(within).map(|k| lines[k].norm_sqr()).sum()
                };
                assert!(power(true) > 30.0 * power(false), "{} {}", power(true), power(false));
            }
            let both: f64 = signal[0].iter().zip(&signal[1]).map(|(a, b)| a * b).sum();
            assert!(both.abs() < 0.2 * samples as f64 * 0.5 * 2.0, "{both}");
        }
    }
}
