//! Stochastic effects, which are found in the noise of quiet records and in raw values.

use crate::effects::{Effect, Library, Observation, Place};
use crate::fit::problem::Placed;
use crate::noise::{Band, NoiseModel, Stretch};
use crate::prepare::Prepared;
use crate::prepare::coloured::Coloured;
use crate::settings::SearchSettings;
use crate::signal::quantisation::Quantisation;

/// A stochastic effect with its evidence.
pub struct Stochastic<'a> {
    /// The effect.
    pub placed: Placed<'a>,
    /// Standard deviation of each parameter; zero for a parameter of raw values, which is exact.
    pub std: Vec<f64>,
    /// Gain in twice the log likelihood.
    pub gain: f64,
}

/// Returns all stochastic effects that the records show.
pub fn stochastic_effects<'a>(ready: &Prepared, library: &'a Library) -> Vec<Stochastic<'a>> {
    let mut found = Vec::new();
    let mut put = |is: &dyn Fn(&dyn Effect) -> bool, place: Place, parameters: &[f64], std: &[f64], gain: f64| {
        if let Some(effect) = library.effects().find(|effect| is(*effect)) {
            let placed = Placed { effect, place, parameters: parameters.to_vec() };
            found.push(Stochastic { placed, std: std.to_vec(), gain });
        }
    };
    let observed = |what: Observation| move |effect: &dyn Effect| effect.observed_in() == what;
    for (o, quantisation) in ready.quantisation.iter().enumerate() {
        if quantisation.coarse {
            let cut = if quantisation.cut { 0.5 } else { 0.0 };
            put(&observed(Observation::Quantisation), Place::Output(o), &[quantisation.step, cut], &[0.0, 0.0], 1e3);
        }
        if let Some(rate) = quantisation.dropout_rate {
            let driven = ready.problem.records.iter().filter(|record| crate::signal::quantisation::driven(record));
            let onsets = rate * driven.map(|record| record.samples() as f64).sum::<f64>();
            // Dropouts are rare and independent of each other.
            put(
                &observed(Observation::Dropouts),
                Place::Output(o),
                &[rate],
                &[rate / onsets.sqrt()],
                2.0 * onsets * 6.0,
            );
        }
    }
    // A sensor counts as noisy only relative to its declared noise. If a force in a band drives resonances, the
    // sensor must also be noisy without their leakage, and by more than the skirts of this force, which the fit of
    // its band hardly determines.
    if ready.declares {
        let search = &ready.problem.settings.search;
        let of = |noise: &NoiseModel| noisy(noise, &ready.declared_sensor, &ready.quantisation, search);
        let clear = ready.noise.drives().then(|| of(&without_leakage(ready)));
        let both = |o: usize| clear.as_ref().is_none_or(|clear| clear.iter().any(|(other, ..)| *other == o));
        let beyond = |o: usize, std: f64| std * std > ready.noise.skirts(o);
        for (o, added, std, gain) in of(&ready.noise).into_iter().filter(|(o, std, ..)| both(*o) && beyond(*o, *std)) {
            put(&observed(Observation::SensorNoise), Place::Output(o), &[added], &[std], gain);
        }
    }
    for line in &ready.wandering {
        let place = Place::Frequency(line.hz, line.port);
        // The extent to which the phase and the amplitude of the line wander is unknown.
        let std = [f64::INFINITY; 3];
        put(&|effect| effect.name() == line.effect, place, &[line.amplitude, line.hz, 0.0], &std, line.gain);
    }
    if let Some(Coloured { band: Band { port, hz, .. }, a, std, gain }) = ready.coloured {
        put(&observed(Observation::Band), Place::Frequency(hz, port), &[a, hz], &[std[0] * a, std[1] * hz], gain);
    }
    found
}

/// Fits the noise to tapered data. Adjacent bins are then correlated and evidence is counted twice, but this fit only
/// has to confirm the evidence without a taper.
fn without_leakage(ready: &Prepared) -> NoiseModel {
    let tapered: Vec<Stretch> = ready.quiet.iter().map(Stretch::tapered).collect();
    ready.declared.fit_beside(&tapered, ready.coloured.iter().map(Coloured::source))
}

/// Returns the sensors whose noise exceeds the part that is common to all: the number of each, its additional
/// standard deviation with the uncertainty, and the evidence.
fn noisy(
    noise: &NoiseModel,
    declared: &[f64],
    quantisation: &[Quantisation],
    search: &SearchSettings,
) -> Vec<(usize, f64, f64, f64)> {
    let sensors = noise.sensors();
    let ratios: Vec<f64> = sensors.iter().zip(declared).map(|(theta, std)| theta / (std * std)).collect();
    let mut found = Vec::new();
    for o in 0..ratios.len() {
        if quantisation[o].coarse || noise.bins == 0 {
            continue;
        }
        let mut others: Vec<f64> =
            (0..ratios.len()).filter(|&j| j != o && !quantisation[j].coarse).map(|j| ratios[j]).collect();
        others.sort_by(f64::total_cmp);
        // The least noisy of the other channels gives the common part.
        let common = others.first().copied().unwrap_or(search.misjudged * search.misjudged).max(search.least_common);
        let excess = ratios[o] / common;
        let gain = 2.0 * noise.bins as f64 * (excess - 1.0 - excess.ln());
        if excess > search.noisier && gain > search.stochastic_gain {
            let std = declared[o] * (ratios[o] - common).sqrt();
            // The power of a bin is exponentially distributed, so the relative uncertainty of a variance is one over
            // the root of the number of bins.
            let variance = declared[o].powi(2) * ratios[o].hypot(common) / (noise.bins as f64).sqrt();
            found.push((o, std, variance / (2.0 * std), gain));
        }
    }
    found
}

/// Returns the index of the narrowband disturbance near whose frequency a band lies, if such a disturbance is named:
/// the phase of this line then wanders.
pub fn wandering(band: &Placed, effects: &[Placed], near_line: f64) -> Option<usize> {
    let Place::Frequency(hz, _) = band.place else { return None };
    let line = |placed: &Placed| match placed.place {
        Place::Frequency(line, _) => placed.effect.phase().is_some() && (line / hz - 1.0).abs() < near_line,
        _ => false,
    };
    (band.effect.observed_in() == Observation::Band).then(|| effects.iter().position(line)).flatten()
}

/// Returns whether a stochastic effect is a line whose phase wanders.
pub fn wanders(shown: &Placed) -> bool {
    shown.effect.phase().is_some()
}

/// Returns whether an effect is a converter that truncates instead of rounding.
pub fn cuts(placed: &Placed) -> bool {
    placed.effect.observed_in() == Observation::Quantisation && placed.parameters.get(1).is_some_and(|cut| *cut > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Action, Flexible, Parameter, Range, Setting, Side};
    use crate::prepare::{Known, prepare};
    use crate::testing;

    /// A user's own effect that is observed in repeated samples.
    struct Hiccup;

    impl Effect for Hiccup {
        fn name(&self) -> &'static str {
            "hiccup"
        }

        fn side(&self) -> Side {
            Side::Sensor
        }

        fn equation(&self) -> &'static str {
            "samples repeat"
        }

        fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
            vec![Parameter::new("rate", "1/sample", Range::Positive)]
        }

        fn places(&self, setting: &Setting) -> Vec<Place> {
            setting.outputs()
        }

        fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
            Vec::new()
        }

        fn observed_in(&self) -> Observation {
            Observation::Dropouts
        }

        fn act(&self, _setting: &Setting, _place: &Place, _parameters: &[f64]) -> Vec<Action> {
            vec![Action::Noise]
        }
    }

    /// An effect is selected by the kind of observation in which it appears, whatever its name.
    #[test]
    fn an_effect_of_ones_own_is_found_in_raw_values() {
        let case = testing::case(&testing::truss(1), &testing::truss(1));
        let mut ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        ready.quantisation[1].dropout_rate = Some(0.01);
        let standard = Library::standard().without(&["sensor-dropout".into()]);
        assert!(stochastic_effects(&ready, &standard).iter().all(|found| found.placed.place != Place::Output(1)));
        let own = standard.with(Box::new(Hiccup));
        let found = stochastic_effects(&ready, &own);
        let named: Vec<_> = found.iter().map(|u| (u.placed.effect.name(), u.placed.place.clone())).collect();
        assert!(named.contains(&("hiccup", Place::Output(1))), "{named:?}");
        assert!(own.get("hiccup").unwrap().is_stochastic() && !Effect::is_number(&Hiccup));
    }

    /// Twenty effects have a free shape, and each of them acts on the side of its free shape.
    #[test]
    fn free_shapes_fit_their_effects() {
        let library = Library::standard();
        let shaped: Vec<(&dyn Effect, &Flexible)> =
            library.effects().filter_map(|effect| Some((effect, effect.free_shape()?))).collect();
        assert_eq!(shaped.len(), 20);
        for (effect, free) in shaped {
            assert_eq!(effect.side(), free.side(), "{}", effect.name());
        }
    }
}
