//! Effects that no free run shows: found in the noise of quiet records and in the codes of all.

use crate::codes::Codes;
use crate::effects::{Effect, Library, Place};
use crate::noise::{NoiseModel, Source};
use crate::prepare::Prepared;
use crate::problem::Placed;

/// Evidence (twice the log likelihood) that such an effect needs: with a few dozen places to look at, noise alone reaches 12.
pub const EVIDENCE: f64 = 40.0;

/// A sensor's variance over what the other sensors' say it should be, from which it counts as noisy.
const NOISIER: f64 = 1.3;

/// All sensors may be misjudged by this factor together (in standard deviation).
const MISJUDGED: f64 = 1.5;

/// Centres of bands, from here on in steps of 6 %, in Hz.
const LOWEST: f64 = 15.0;

/// The search for a band looks at every so many bins.
const THINNED: usize = 4;

/// Relative widths of bands.
const WIDTHS: [f64; 2] = [0.05, 0.2];

/// A finding with its evidence.
pub struct Unseen<'a> {
    /// The effect.
    pub placed: Placed<'a>,
    /// Twice the gain in log likelihood.
    pub gain: f64,
}

/// Looks for all of them.
pub fn unseen<'a>(ready: &Prepared, library: &'a Library) -> Vec<Unseen<'a>> {
    let mut found = Vec::new();
    let mut put = |name: &str, place: Place, parameters: Vec<f64>, gain: f64| {
        if let Some(effect) = library.get(name) {
            found.push(Unseen { placed: Placed { effect, place, parameters }, gain });
        }
    };
    for (o, codes) in ready.codes.iter().enumerate() {
        if codes.coarse {
            let cut = if codes.cut { 0.5 } else { 0.0 };
            put("sensor-quantisation", Place::Output(o), vec![codes.step, cut], 1e3);
        }
        if let Some(rate) = codes.dropout_rate {
            let driven = ready.problem.records.iter().filter(|record| crate::codes::driven(record));
            let onsets = rate * driven.map(|record| record.samples() as f64).sum::<f64>();
            put("sensor-dropout", Place::Output(o), vec![rate], 2.0 * onsets * 6.0);
        }
    }
    let coloured = coloured(ready);
    // A sensor is noisy only against what was declared of it, and beside a force in a band that was found.
    if ready.declares {
        let banded = coloured.map(|(port, hz, width, ..)| {
            let modes = (0..ready.problem.plant.modes.len()).map(Source::Mode);
            let sources: Vec<Source> = modes.chain([Source::Band(port, hz, width)]).collect();
            ready.declared.fit_with(&ready.quiet, &sources, 60, 1)
        });
        let of = |noise: &NoiseModel| noisy(noise, &ready.declared_sensor, &ready.codes);
        let still = banded.as_ref().map(of);
        // Either model of the forces may fall short, and what it lacks is then in the sensors.
        let both = |o: usize| still.as_ref().is_none_or(|still| still.iter().any(|(other, ..)| *other == o));
        for (o, std, gain) in of(&ready.noise).into_iter().filter(|(o, ..)| both(*o)) {
            put("sensor-noise", Place::Output(o), vec![std], gain);
        }
    }
    for line in &ready.wandering {
        let place = Place::Frequency(line.hz, line.port);
        put("narrowband-disturbance", place, vec![line.amplitude, line.hz, 0.0], line.gain);
    }
    if let Some((port, hz, _, a, gain)) = coloured {
        put("coloured-disturbance", Place::Frequency(hz, port), vec![a, hz], gain);
    }
    found
}

/// Sensors whose noise exceeds what is common to all: number, added standard deviation, evidence.
fn noisy(noise: &NoiseModel, declared: &[f64], codes: &[Codes]) -> Vec<(usize, f64, f64)> {
    let sensors = noise.sensors();
    let ratios: Vec<f64> = sensors.iter().zip(declared).map(|(theta, std)| theta / (std * std)).collect();
    let mut found = Vec::new();
    for o in 0..ratios.len() {
        if codes[o].coarse || noise.bins == 0 {
            continue;
        }
        let mut others: Vec<f64> =
            (0..ratios.len()).filter(|&j| j != o && !codes[j].coarse).map(|j| ratios[j]).collect();
        others.sort_by(f64::total_cmp);
        // The least noisy other channel says what is common.
        let common = others.first().copied().unwrap_or(MISJUDGED * MISJUDGED).max(0.4);
        let excess = ratios[o] / common;
        let gain = 2.0 * noise.bins as f64 * (excess - 1.0 - excess.ln());
        if excess > NOISIER && gain > EVIDENCE {
            found.push((o, declared[o] * (ratios[o] - common).sqrt(), gain));
        }
    }
    found
}

/// A force in a band: where an equal force on all modes does not explain the quiet records, and one band at one port does.
/// Port, centre, relative width, standard deviation, evidence.
fn coloured(ready: &Prepared) -> Option<(usize, f64, f64, f64, f64)> {
    if ready.quiet.is_empty() {
        return None;
    }
    let plant = &ready.problem.plant;
    let plain = ready.declared.fit_with(&ready.quiet, &[Source::Ambient], 40, 1);
    let free = &ready.noise;
    if 2.0 * (plain.misfit - free.misfit) < EVIDENCE {
        return None;
    }
    let mut best: Option<(f64, usize, f64, f64, f64)> = None;
    let mut hz = LOWEST;
    while hz < 0.45 * plant.rate {
        for port in 0..ready.declared.ports() {
            for width in WIDTHS {
                let band = Source::Band(port, hz, width);
                let fitted = ready.declared.fit_with(&ready.quiet, &[Source::Ambient, band], 8, THINNED);
                if best.is_none_or(|best| fitted.misfit < best.0) {
                    let theta = fitted.sources.last().map_or(0.0, |(_, theta)| *theta);
                    best = Some((fitted.misfit, port, hz, width, theta));
                }
            }
        }
        hz *= 1.06;
    }
    let (_, port, hz, width, theta) = best?;
    if ready.wandering.iter().any(|line| (line.hz / hz - 1.0).abs() < NEAR_LINE) {
        return None;
    }
    let misfit = ready.declared.fit_with(&ready.quiet, &[Source::Ambient, Source::Band(port, hz, width)], 40, 1).misfit;
    let gain = 2.0 * (plain.misfit - misfit);
    // An equal force on all modes is a guess, from few ports a poor one: where one mode alone that is pushed harder explains as much, it is no band.
    let pushed =
        |mode: usize| ready.declared.fit_with(&ready.quiet, &[Source::Ambient, Source::Mode(mode)], 40, 1).misfit;
    let near = (0..plant.modes.len()).filter(|&k| (plant.modes[k].hz() / hz - 1.0).abs() < 2.0 * WIDTHS[1]);
    let harder = near.map(pushed).fold(plain.misfit, f64::min);
    if 2.0 * (harder - misfit) < EVIDENCE {
        return None;
    }
    // Three numbers of a band must do most of what a free force on every mode does.
    let share = gain / (2.0 * (plain.misfit - free.misfit));
    // Variance of a band of white noise of density theta: the band's share of half the sample rate, times pi / 2 for its skirts.
    let variance = theta * std::f64::consts::FRAC_PI_2 * width * hz / (0.5 * plant.rate);
    (gain > EVIDENCE && share > 0.6).then(|| (port, hz, width, variance.sqrt(), gain))
}

/// Whether an effect is one of these.
pub fn is_unseen(effect: &dyn Effect) -> bool {
    matches!(effect.name(), "sensor-quantisation" | "sensor-dropout" | "sensor-noise" | "coloured-disturbance")
}

/// A band about the line of a narrowband disturbance that is named is that line: it wanders. Which of the effects that is.
pub fn wandering(band: &Placed, effects: &[Placed]) -> Option<usize> {
    let Place::Frequency(hz, _) = band.place else { return None };
    let line = |placed: &Placed| match placed.place {
        Place::Frequency(line, _) => {
            placed.effect.name() == "narrowband-disturbance" && (line / hz - 1.0).abs() < NEAR_LINE
        }
        _ => false,
    };
    (band.effect.name() == "coloured-disturbance").then(|| effects.iter().position(line)).flatten()
}

/// Whether what the records show without a free run is a line: one that wanders.
pub fn wanders(shown: &Placed) -> bool {
    shown.effect.name() == "narrowband-disturbance"
}

/// Whether it is a converter that cuts bits off, and does not round.
pub fn cuts(placed: &Placed) -> bool {
    placed.effect.name() == "sensor-quantisation" && placed.parameters.get(1).is_some_and(|cut| *cut > 0.0)
}

/// Bands are looked for in steps of 6 %.
pub(crate) const NEAR_LINE: f64 = 0.04;

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::effects::Action;
    use crate::prepare::{Known, prepare};
    use crate::simulate::{Fineness, simulate};
    use crate::testing;

    /// Adds what a force at a port does to the case's quiet record.
    fn push(case: &mut crate::case::Case, plant: &crate::plant::Plant, port: usize, strength: f64, force: Vec<f64>) {
        let quiet = &mut case.records[0];
        let rate = plant.rate;
        let of = move |t: f64| strength * force[((t * rate).round() as usize).min(force.len() - 1)];
        let pushed = simulate(plant, &[Action::Disturbance(port, Box::new(of))], &quiet.u, 0.0, None, Fineness::FINE);
        quiet.y.iter_mut().zip(&pushed).for_each(|(y, more)| y.iter_mut().zip(more).for_each(|(y, more)| *y += more));
    }

    fn places(ready: &Prepared, library: &Library) -> Vec<Place> {
        let found = unseen(ready, library).into_iter();
        found.filter(|u| u.placed.effect.name() == "coloured-disturbance").map(|u| u.placed.place).collect()
    }

    /// A mode that ambient forces push harder than the others is no band.
    #[test]
    fn a_mode_that_is_pushed_harder_is_no_coloured_force() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        let mut plant = crate::plant::Plant::new(&sim).unwrap();
        plant.add_modal_port(1);
        let port = plant.ports.len() - 1;
        let white = testing::random_input(77, case.records[0].samples(), 1).remove(0);
        push(&mut case, &plant, port, 0.02, white);
        let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let plain = ready.declared.fit_with(&ready.quiet, &[Source::Ambient], 40, 1);
        assert!(2.0 * (plain.misfit - ready.noise.misfit) > 2.0 * EVIDENCE, "it does not show");
        assert_eq!(places(&ready, &Library::standard()), []);
    }

    /// A force in a band at the second strut is found there, with places on single modes beside the struts too.
    #[test]
    fn a_coloured_force_is_looked_for_at_the_struts_alone() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        let plant = crate::plant::Plant::new(&sim).unwrap();
        // White noise through a resonator at 137 Hz, where a mode lies.
        let white = testing::random_input(77, case.records[0].samples(), 1).remove(0);
        let (turn, radius) = (2.0 * (TAU * 137.0 / plant.rate).cos(), 0.97);
        let (mut force, mut last) = (Vec::new(), [0.0; 2]);
        for e in white {
            let now = turn * radius * last[0] - radius * radius * last[1] + e;
            last = [now, last[0]];
            force.push(now);
        }
        push(&mut case, &plant, 1, 0.003, force);

        let mut ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let library = Library::standard();
        let struts = places(&ready, &library);
        assert!(matches!(struts[..], [Place::Frequency(hz, 1)] if (hz / 137.0 - 1.0).abs() < 0.1), "{struts:?}");
        ready.problem = ready.problem.with_modal_places(&[1, 2]);
        assert_eq!(places(&ready, &library), struts);
    }
}
