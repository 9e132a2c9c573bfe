//! The scatter, from record to record, of the gap that stochastic effects make. It follows from their own statistics:
//! few events or a narrow band make a gap that differs much between records of the same length.

use crate::case::record::rms;
use crate::effects::{Observation, Place};
use crate::fit::free_run::run;
use crate::fit::problem::{Fit, Placed};
use crate::judge::crossed::Stated;
use crate::judge::explained::Explained;
use crate::judge::shrink::{Gap, opened};
use crate::prepare::Prepared;
use crate::prepare::coloured::Coloured;
use crate::search::stochastic::Stochastic;
use crate::signal::quantisation::repeats;

/// Number of frequencies at which a spectrum is computed.
const POINTS: u32 = 4096;

/// Returns the 80 % interval of the stated gap of a further record that is as long as the opened ones, with the scatter
/// of the stochastic effects of the answer. Without such effects, it is the interval as stated.
pub fn widened(explained: &Explained, gap: &Gap, shown: &[&Stochastic], squared_gaps: &[f64]) -> [f64; 2] {
    let opened = opened(explained);
    let samples = opened.iter().map(|record| record.samples()).sum::<usize>() as f64 / opened.len() as f64;
    let fit = explained.predicting();
    let part = |(u, squared): (&&Stochastic, &f64)| (*squared, scatter(&explained.ready, &fit, &u.placed, samples));
    let stated = Stated { gap: gap.predicted_held_out_gap, ci80: gap.predicted_ci80 };
    stated.with_parts(shown.iter().zip(squared_gaps).map(part)).ci80
}

/// Returns the variance of the squared gap that a stochastic effect makes in records of this number of samples,
/// relative to the squared mean. It is zero for a line whose phase wanders, because its amplitude is steady.
fn scatter(ready: &Prepared, fit: &Fit, placed: &Placed, samples: f64) -> f64 {
    match (placed.effect.observed_in(), &placed.place) {
        (Observation::SensorNoise | Observation::Quantisation, _) => of_spectrum(|_| 1.0, samples),
        (Observation::Band, _) => {
            ready.coloured.as_ref().map_or(0.0, |band| of_spectrum(|turns| in_band(ready, band, turns), samples))
        }
        (Observation::Dropouts, Place::Output(o)) => {
            let (energies, fitted) = dropouts(ready, fit, *o);
            of_events(&energies, fitted, samples)
        }
        _ => 0.0,
    }
}

/// Returns the relative variance of the energy of events in a record of this number of samples, about the energy that
/// was found in `fitted` samples. Both are compound Poisson sums: with n events of energy e, the relative variance is
/// E[e^2] / (n E[e]^2).
fn of_events(energies: &[f64], fitted: f64, samples: f64) -> f64 {
    let sum: f64 = energies.iter().sum();
    let squares: f64 = energies.iter().map(|energy| energy * energy).sum();
    if sum > 0.0 { squares / (sum * sum) * (1.0 + fitted / samples) } else { 0.0 }
}

/// Returns the relative variance of the energy of Gaussian noise in a record of this number of samples. `spectrum` is
/// its power at a frequency in turns per sample. With B = (int S df)^2 / int S^2 df and the duration T, the energy has
/// a chi-square distribution with about 2 B T degrees of freedom (Bendat and Piersol, Random Data, 2010, section 8.3),
/// but no less than two.
fn of_spectrum(spectrum: impl Fn(f64) -> f64, samples: f64) -> f64 {
    let powers = (0..POINTS).map(|k| spectrum((f64::from(k) + 0.5) / f64::from(2 * POINTS)));
    let (sum, squares) = powers.fold((0.0, 0.0), |(sum, squares), s| (sum + s, squares + s * s));
    if sum > 0.0 { (squares / (sum * sum) * f64::from(2 * POINTS) / samples).min(1.0) } else { 0.0 }
}

/// Returns the power of a force in a band at a frequency in turns per sample, over all outputs, each relative to its
/// own size.
fn in_band(ready: &Prepared, band: &Coloured, turns: f64) -> f64 {
    let response = &ready.noise.columns(band.source(), turns * ready.problem.plant.rate)[0];
    let sizes = ready.problem.setting.y_rms.iter();
    response.iter().zip(sizes).map(|(h, size)| h.norm_sqr() / (size * size).max(f64::MIN_POSITIVE)).sum()
}

/// Returns the energy of each dropout of an output in the fitted records, relative to the output's power there, and the
/// number of samples of these records.
fn dropouts(ready: &Prepared, fit: &Fit, o: usize) -> (Vec<f64>, f64) {
    let problem = &ready.problem;
    let (plant, actions) = (problem.nuisance.apply(&problem.plant, &fit.eta), problem.actions(&fit.effects));
    let (mut energies, mut samples) = (Vec::new(), 0);
    for record in problem.records.iter().filter(|record| record.is_driven()) {
        let error = record.error(&run(&plant, &actions, record)).swap_remove(o);
        let repeated = repeats(&record.y[o], &error, ready.declared_sensor[o], &problem.settings.signal);
        let power = rms(record.y[o].iter().filter(|y| y.is_finite())).powi(2).max(f64::MIN_POSITIVE);
        let events = repeated.chunk_by(|a, b| a + 1 == *b);
        energies.extend(events.map(|event| event.iter().map(|&k| error[k] * error[k]).sum::<f64>() / power));
        samples += record.samples();
    }
    (energies, samples as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Library;
    use crate::fit::refit::refit;
    use crate::prepare::{Known, prepare};
    use crate::search::stochastic::stochastic_effects;
    use crate::testing;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::Poisson;

    /// The closed form for events agrees with drawn records: those that were fitted, and a further one.
    #[test]
    fn the_scatter_of_events_is_that_of_drawn_records() {
        const DRAWS: usize = 4000;
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for (fitted, further) in [(90.0, 30.0), (60.0, 6.0)] {
            let mut records = |mean: f64| -> Vec<f64> {
                let events = rng.sample(Poisson::new(mean).unwrap()) as usize;
                (0..events).map(|_| rng.random_range(0.0..1.0_f64).powi(2)).collect()
            };
            let (mut square, mut stated) = (0.0, 0.0);
            for _ in 0..DRAWS {
                let (known, new) = (records(fitted), records(further));
                // The mean energy of an event is a third.
                let off = (new.iter().sum::<f64>() / further - known.iter().sum::<f64>() / fitted) * 3.0;
                square += off * off / DRAWS as f64;
                stated += of_events(&known, fitted, further) / DRAWS as f64;
            }
            assert!((stated / square - 1.0).abs() < 0.1, "{fitted} {further}: {stated} for {square}");
        }
        assert_eq!(of_events(&[], 100.0, 100.0), 0.0);
    }

    /// The energy of white noise has two over the number of samples as its relative variance. That of noise in a band
    /// agrees with drawn noise, and that of a line in a short record is no larger than one.
    #[test]
    fn the_scatter_of_noise_follows_from_its_bandwidth() {
        assert!((of_spectrum(|_| 3.0, 500.0) - 2.0 / 500.0).abs() < 1e-12);
        assert_eq!(of_spectrum(|turns| f64::from(u8::from((turns - 0.1).abs() < 2e-4)), 100.0), 1.0);
        let pole: f64 = 0.9;
        let spectrum = |turns: f64| 1.0 / (1.0 + pole * pole - 2.0 * pole * (std::f64::consts::TAU * turns).cos());
        let energies: Vec<f64> = testing::random_input(5, 400 * 1000, 1)
            .remove(0)
            .chunks(400)
            .map(|white| {
                let mut state = 0.0;
                let coloured = white.iter().map(|e| {
                    state = pole * state + e;
                    state * state
                });
                // The first samples still show the start from rest.
                coloured.skip(50).sum()
            })
            .collect();
        let mean = energies.iter().sum::<f64>() / 1000.0;
        let variance = energies.iter().map(|energy| (energy / mean - 1.0).powi(2)).sum::<f64>() / 1000.0;
        let stated = of_spectrum(spectrum, 350.0);
        assert!((stated / variance - 1.0).abs() < 0.15, "{stated} for {variance}");
    }

    /// Dropped samples that make most of the gap widen the interval of the stated gap. Without them, the interval stays
    /// as it is, bit for bit.
    #[test]
    fn dropouts_widen_the_stated_interval() {
        let library = Library::standard();
        let sim = testing::truss(1);
        for drops in [true, false] {
            let mut case = testing::case(&sim, &sim);
            for record in case.records.iter_mut().filter(|record| drops && record.is_driven()) {
                for from in (50..record.samples() - 10).step_by(200) {
                    let held = record.y[0][from];
                    record.y[0][from + 1..from + 4].fill(held);
                }
            }
            let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
            let fit = refit(&ready.problem, 0).as_fit();
            let found = stochastic_effects(&ready, &library);
            let dropping = found.iter().filter(|u| u.placed.effect.observed_in() == Observation::Dropouts);
            let stated = Stated { gap: 0.1, ci80: [0.085, 0.1 / 0.85] };
            let parts = dropping.map(|u| (0.0081, scatter(&ready, &fit, &u.placed, 3072.0)));
            let interval = stated.with_parts(parts).ci80;
            if drops {
                // There are 45 events in the fitted records and a third as many in the further one.
                assert!(interval[0] < 0.98 * stated.ci80[0] && interval[1] > 1.02 * stated.ci80[1], "{interval:?}");
                assert!(interval[0] > 0.06 && interval[1] < 0.17, "{interval:?}");
            } else {
                assert_eq!(interval.map(f64::to_bits), stated.ci80.map(f64::to_bits));
            }
        }
    }
}
