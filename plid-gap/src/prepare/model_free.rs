//! The noise of records none of which shows the noise alone, without a model of what it hides in.

use std::ops::Range;

use crate::case::record::{Channels, Record};
use crate::noise::local_polynomial::unexplained;
use crate::noise::{NoiseModel, Stretch};
use crate::prepare::NoiseFrom;
use crate::settings::PrepareSettings;
use plid_fourier::C;
use plid_model::signal::mean;

/// Returns the noise of records none of which shows the noise alone, if no noise is declared: the part that their
/// inputs do not explain, but no more than is assumed. In the fit, random forces on the modes may account for all of
/// this part. The white noise of a sensor is therefore at least as strong as the weakest part of the spectrum.
pub(super) fn at_most(
    assumed: &NoiseModel,
    records: &[Record],
    errors: &[Channels],
    settings: &PrepareSettings,
) -> (NoiseModel, NoiseFrom) {
    let driven = records.iter().zip(errors).filter(|(record, _)| record.is_driven());
    let both = driven.filter_map(|(record, error)| Some((unexplained(record, error)?, Stretch::new(error).tapered())));
    let (stretches, whole): (Vec<Stretch>, Vec<Stretch>) = both.unzip();
    if stretches.is_empty() {
        return (assumed.clone(), NoiseFrom::Assumed);
    }
    let found = assumed.fit(&stretches).sensors();
    let (mut noise, mut uncertainty) = (assumed.clone(), 0.0_f64);
    for (o, (found, assumed)) in found.into_iter().zip(assumed.sensors()).enumerate() {
        let shown = found.max(weakest(&stretches, o));
        noise = noise.with_sensor(o, shown.min(assumed));
        uncertainty = if shown < assumed {
            uncertainty.max(settings.level_allowance * scatter(shown, o, &stretches, &whole))
        } else {
            f64::INFINITY
        };
    }
    let is_known = uncertainty < settings.declared_uncertainty;
    (noise, if is_known { NoiseFrom::Unexplained(uncertainty) } else { NoiseFrom::Assumed })
}

/// Returns the relative standard deviation of a noise power: that of its number of independent values, and that of its
/// difference from the power of the error at the highest frequencies, where a simulation hardly moves. Only the part of
/// the difference that exceeds chance counts.
fn scatter(shown: f64, o: usize, stretches: &[Stretch], whole: &[Stretch]) -> f64 {
    let freedom = |stretches: &[Stretch]| stretches.iter().map(|stretch| stretch.freedom).sum::<f64>();
    let highest = HIGHEST.len() as f64 / BANDS as f64;
    let own = 2.0 / freedom(stretches);
    let of_other = 2.0 / (highest * freedom(whole));
    let apart = (shown / density_in(whole, o, HIGHEST)).ln();
    (own + (apart * apart - own - of_other).max(0.0) / 2.0).sqrt()
}

/// Number of bands in which the power of an output is compared.
const BANDS: usize = 16;

/// The bands of the highest frequencies.
const HIGHEST: Range<usize> = 12..BANDS;

/// Returns the power spectral density of an output in the band where it is lowest.
fn weakest(stretches: &[Stretch], o: usize) -> f64 {
    (0..BANDS).map(|band| density_in(stretches, o, band..band + 1)).fold(f64::INFINITY, f64::min)
}

/// Returns the mean power spectral density of an output in these bands.
fn density_in(stretches: &[Stretch], o: usize, bands: Range<usize>) -> f64 {
    let power = |stretch: &Stretch| -> Vec<f64> {
        let bins = &stretch.bins[o];
        // The first bin holds the mean, which was removed.
        let edge = |band: usize| 1 + band * (bins.len() - 1) / BANDS;
        bins[edge(bands.start)..edge(bands.end)].iter().map(C::norm_sqr).collect()
    };
    mean(stretches.iter().flat_map(power))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{Known, Prepared, prepare};
    use crate::simulate::{Fineness, simulate};
    use crate::testing::{self, add_noise, random_input};
    use nalgebra::dmatrix;
    use plid_model::Model;

    /// The power of white noise is that of the weakest part of the spectrum, even beside a strong resonance.
    #[test]
    fn the_weakest_part_of_a_spectrum_is_its_white_noise() {
        const STD: f64 = 0.1;
        let mut y = testing::random_input(3, 8192, 1);
        for k in 2..y[0].len() {
            y[0][k] += 1.9 * y[0][k - 1] - 0.98 * y[0][k - 2];
        }
        let resonance = weakest(&[Stretch::new(&y)], 0);
        testing::add_noise(&mut y, 4, &[STD]);
        let both = weakest(&[Stretch::new(&y)], 0);
        let white = both - resonance;
        assert!((white / (STD * STD) - 1.0).abs() < 0.3, "{white}");
    }

    /// Returns a process with two time constants.
    fn process() -> Model {
        let (a, b) = (dmatrix![0.9, 0.05; 0.0, 0.8], dmatrix![0.02; 0.2]);
        Model::new(1.0, a, b, dmatrix![1.0, 0.0], dmatrix![0.0]).unwrap()
    }

    /// Standard deviation of the drawn noise, less than is assumed if none is declared.
    const STD: f64 = 3e-4;

    const SAMPLES: usize = 800;

    /// Prepares records of the process. The first two have the same input up to a difference of one sample.
    fn drawn(seed: u64, difference: f64) -> Prepared {
        let model = process();
        let record = |k: u64| {
            let mut u = random_input(if k < 2 { seed } else { seed + 1 }, SAMPLES, 1);
            u[0][100] += if k == 1 { difference } else { 0.0 };
            let mut y = testing::run(&model, &u);
            add_noise(&mut y, 7000 + 10 * seed + k, &[STD]);
            Record { start_s: k as f64 * SAMPLES as f64, ..testing::record(u, y) }
        };
        prepare(&model, &[0, 1, 2].map(record), &Known::default()).unwrap()
    }

    /// Returns the level of the noise model over the true one, in stated standard deviations.
    fn deviation(ready: &Prepared) -> f64 {
        let run = |record: &Record| simulate(&ready.problem.plant, &[], &record.u, 0.0, None, Fineness::COARSE);
        let simulated: Vec<Channels> = ready.problem.records.iter().map(run).collect();
        let level = ready.noise_level(&simulated, 1.0);
        assert!(level.uncertainty < 0.25, "{level:?}");
        (ready.noise.sensors()[0] * level.factor / (STD * STD) - 1.0) / level.uncertainty
    }

    /// The stated uncertainty of the noise holds as often as it should, whether repeats show the noise or only what the
    /// inputs do not explain. An input that differs in one sample is no repeat.
    #[test]
    fn the_uncertainty_of_the_noise_holds_as_often_as_it_should() {
        const DRAWS: u64 = 40;
        for (difference, repeats) in [(0.0, true), (0.1, false)] {
            let mut deviations = Vec::new();
            for seed in 0..DRAWS {
                let ready = drawn(100 + 3 * seed, difference);
                assert_eq!(ready.noise_from == NoiseFrom::Repeats, repeats, "{:?}", ready.noise_from);
                assert_eq!(matches!(ready.noise_from, NoiseFrom::Unexplained(_)), !repeats, "{:?}", ready.noise_from);
                deviations.push(deviation(&ready).abs());
            }
            let within = |most: f64| deviations.iter().filter(|deviation| **deviation < most).count();
            // One and two standard deviations of a normal variable hold 27 and 38 of 40 draws.
            assert!((20..=37).contains(&within(1.0)), "{repeats}: {deviations:?}");
            assert!(within(2.0) >= 35, "{repeats}: {deviations:?}");
        }
    }
}
