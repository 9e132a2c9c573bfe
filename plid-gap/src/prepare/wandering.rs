//! Lines whose phase wanders: forces at one frequency that no simulation can predict. They are removed from the
//! residuals, and their amplitudes are estimated from the removed part.

use nalgebra::{Matrix2, Vector2};

use crate::effects::Place;
use crate::fit::free_run::outputs;
use crate::fit::problem::{Placed, Problem, dot};
use crate::prepare::Prepared;
use crate::signal::notch;
use crate::simulate::Fineness;

/// A line whose phase wanders.
#[derive(Debug, Clone, PartialEq)]
pub struct Wandering {
    /// Name of the effect that was fitted to it.
    pub effect: &'static str,
    /// The port at which it acts.
    pub port: usize,
    /// Its frequency in Hz.
    pub hz: f64,
    /// Its amplitude, in the unit of the port's force.
    pub amplitude: f64,
    /// Its RMS at each output.
    pub rms: Vec<f64>,
    /// Its gain, as twice the log likelihood.
    pub gain: f64,
}

/// Returns the first line of an explanation that does not keep its phase from record to record, with its index.
pub fn wandering(ready: &Prepared, eta: &[f64], effects: &[Placed]) -> Option<(usize, Wandering)> {
    let problem = &ready.problem;
    let settings = &problem.settings.prepare;
    effects.iter().enumerate().find_map(|(which, placed)| {
        let Place::Frequency(hz, port) = placed.place else { return None };
        let (phase, (size, _)) = (placed.effect.phase()?, placed.effect.amplitude()?);
        if placed.parameters[size] == 0.0 {
            return None;
        }
        let mut others = effects.to_vec();
        others.remove(which);
        let plant = problem.nuisance.apply(&problem.plant, eta);
        let without = problem.residual(&plant, eta, &others, Fineness::COARSE);
        let with = |angle: f64| {
            let mut line = placed.clone();
            line.parameters[phase] = angle;
            [others.clone(), vec![line]].concat()
        };
        let traces = [0.0, std::f64::consts::FRAC_PI_2].map(|phase| {
            let with = problem.residual(&plant, eta, &with(phase), Fineness::COARSE);
            without.iter().zip(&with).map(|(a, b)| a - b).collect::<Vec<f64>>()
        });
        let [own, one] = gains(problem, &traces, &without);
        if own - one < settings.random_phase_gain || one > settings.common_phase_share * own {
            return None;
        }
        // The amplitude is estimated from the modulated sine in each record, because the phase may wander within a
        // record as well.
        let runs = [&others, &with(0.0)].map(|effects| outputs(problem, eta, effects));
        let (mut powers, mut one) = (Vec::new(), 0.0);
        for ((record, simulated), steady) in problem.records.iter().zip(&runs[0]).zip(&runs[1]) {
            powers.push(powers_about(&record.error(simulated), problem.plant.rate, hz));
            let power = |(a, b): (&Vec<f64>, &Vec<f64>)| mean_square_of_difference(a, b);
            one += simulated.iter().zip(steady).map(power).sum::<f64>() * record.samples() as f64;
        }
        if !is_steady(&powers, &ready.declared_sensor, settings.steady_line) {
            return None;
        }
        let samples: Vec<f64> = problem.records.iter().map(|record| record.samples() as f64).collect();
        let all: f64 = samples.iter().sum();
        let mean = |o: usize| powers.iter().zip(&samples).map(|(power, n)| power[o] * n).sum::<f64>() / all;
        let means: Vec<f64> = (0..problem.plant.p).map(mean).collect();
        let amplitude = placed.parameters[size].abs() * (means.iter().sum::<f64>() * all / one).sqrt();
        let rms = means.iter().map(|mean| mean.sqrt()).collect();
        let effect = placed.effect.name();
        Some((which, Wandering { effect, port, hz, amplitude, rms, gain: own }))
    })
}

fn mean_square_of_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64
}

/// Returns the mean square, at each output, of the part of a residual that a slowly modulated sine can represent.
pub(super) fn powers_about(residual: &[Vec<f64>], rate: f64, hz: f64) -> Vec<f64> {
    let left = notch::without(residual, rate, hz);
    residual.iter().zip(&left).map(|(all, left)| mean_square_of_difference(all, left)).collect()
}

/// Returns whether a line has about the same amplitude in all records, from its power at each output in each record.
/// `scales` are the scales in which the outputs are compared; an output with a scale of zero is left out. The
/// residual of an unknown law at a resonance also looks like a line, but it follows the level of the inputs.
pub(super) fn is_steady(powers: &[Vec<f64>], scales: &[f64], least: f64) -> bool {
    let amplitude = |power: &Vec<f64>| {
        let both = power.iter().zip(scales).filter(|(_, scale)| **scale > 0.0);
        both.map(|(power, scale)| power / scale.powi(2)).sum::<f64>().sqrt()
    };
    let amplitudes: Vec<f64> = powers.iter().map(amplitude).collect();
    let largest = amplitudes.iter().copied().fold(0.0, f64::max);
    amplitudes.iter().all(|amplitude| *amplitude >= least * largest)
}

/// Returns twice the log likelihood that a line gains over the residual `without` it: with a separate phase in each
/// record, and with one phase for all records. `traces` are its whitened responses at phases of 0 and 90 degrees.
fn gains(problem: &Problem, traces: &[Vec<f64>; 2], without: &[f64]) -> [f64; 2] {
    let (mut normal, mut cross, mut own) = (Matrix2::zeros(), Vector2::zeros(), 0.0);
    for record in 0..problem.records.len() {
        let [s, c, r] = [traces[0].as_slice(), &traces[1], without].map(|x| &x[problem.rows_of(record)]);
        let n = Matrix2::new(dot(s, s), dot(s, c), dot(s, c), dot(c, c));
        let b = Vector2::new(dot(s, r), dot(c, r));
        let Some(inverse) = n.try_inverse() else { continue };
        own += b.dot(&(inverse * b));
        normal += n;
        cross += b;
    }
    let one = normal.try_inverse().map_or(0.0, |inverse| cross.dot(&(inverse * cross)));
    [own, one]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::case::Case;
    use crate::effects::{Action, Library};
    use crate::fit::problem::sum_of_squares;
    use crate::plant::Plant;
    use crate::prepare::{Known, prepare};
    use crate::simulate::simulate;
    use crate::testing;

    const HZ: f64 = 103.0;
    const SIZE: f64 = 0.05;

    /// Phases of a line that differ between the records, amplitudes that do not, and amplitudes that do.
    const APART: [f64; 4] = [0.0, 1.9, 4.1, 5.5];
    const STEADY: [f64; 4] = [SIZE; 4];
    const UNSTEADY: [f64; 4] = [0.3 * SIZE, 0.3 * SIZE, SIZE, SIZE];

    /// Returns a case of four records to which the response to a force at the second port is added.
    fn pushed(phases: [f64; 4], sizes: [f64; 4]) -> Case {
        let sim = testing::truss(1);
        let plant = Plant::new(&sim).unwrap();
        let mut case = testing::case(&sim, &sim);
        for ((record, phase), size) in case.records.iter_mut().zip(phases).zip(sizes) {
            let force = move |t: f64| size * (TAU * HZ * t + phase).sin();
            let quiet = vec![vec![0.0; record.samples()]; plant.m];
            let line = [Action::Disturbance(1, Box::new(force))];
            let more = simulate(&plant, &line, &quiet, record.start_s, None, Fineness::FINE);
            record.y.iter_mut().flatten().zip(more.iter().flatten()).for_each(|(y, more)| *y += more);
        }
        case
    }

    fn prepared(case: &Case) -> Prepared {
        prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap()
    }

    /// A line wanders only if it has a separate phase in each record and one amplitude in all of them.
    #[test]
    fn a_line_that_keeps_its_phase_or_follows_the_records_does_not_wander() {
        let library = Library::standard();
        for (phases, sizes) in [([0.0; 4], STEADY), (APART, STEADY), (APART, UNSTEADY)] {
            let mut ready = prepared(&pushed(phases, sizes));
            let eta = vec![0.0; ready.problem.nuisance.len()];
            let effect = library.get("narrowband-disturbance").unwrap();
            let line = Placed { effect, place: Place::Frequency(HZ, 1), parameters: vec![0.2, HZ, 0.4] };
            let wanders = phases == APART && sizes == STEADY;
            let effects = std::slice::from_ref(&line);
            if let Some((which, found)) = wandering(&ready, &eta, effects) {
                assert_eq!((which, found.port, found.hz), (0, 1, HZ));
                assert!((found.amplitude / SIZE - 1.0).abs() < 0.05, "{}", found.amplitude);
            }
            assert_eq!(ready.renew_lines(&eta, effects, true), wanders.then_some("a line wanders"));
            let problem = &ready.problem;
            let left = sum_of_squares(&problem.residual(&problem.plant, &eta, &[], Fineness::FINE));
            // The residual is noise alone, or contains the whole line.
            let ratio = left / problem.rows() as f64;
            assert!(if wanders { (0.8..1.1).contains(&ratio) } else { ratio > 10.0 }, "{ratio}");
        }
    }

    /// An output that is always zero contains no information about a line.
    #[test]
    fn a_dead_output_does_not_hide_a_line() {
        let powers = [vec![1.0, 0.0], vec![1.1, 0.0]];
        assert!(is_steady(&powers, &[1.0, 0.0], 0.5));
        assert!(!is_steady(&[powers[0].clone(), vec![9.0, 0.0]], &[1.0, 0.0], 0.5));
    }

    /// If no record is quiet, a line is offered to effects only if it has one amplitude.
    #[test]
    fn a_line_that_follows_the_records_is_not_offered() {
        for sizes in [STEADY, UNSTEADY] {
            let mut case = pushed([0.0; 4], sizes);
            case.records.remove(0);
            let tones = prepared(&case).problem.setting.tones;
            let offered = tones.iter().any(|tone| (tone.hz / HZ - 1.0).abs() < 0.01);
            assert_eq!(offered, sizes == STEADY, "{tones:?}");
        }
    }
}
