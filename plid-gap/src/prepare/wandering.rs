//! Lines whose phase wanders: forces at one frequency that no simulation can predict. They are removed from the
//! residuals, and are estimated from the removed part.

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
    /// Its gain in twice the log likelihood.
    pub gain: f64,
}

/// Returns the first line of an explanation that does not keep its phase from record to record, by number.
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
        // Its size is estimated from its modulated sine in each record, because its phase may wander within a record as
        // well.
        let runs = [&others, &with(0.0)].map(|effects| outputs(problem, eta, effects));
        let (mut squares, mut samples, mut one) = (vec![0.0; problem.plant.p], 0, 0.0);
        for ((record, simulated), steady) in problem.records.iter().zip(&runs[0]).zip(&runs[1]) {
            let error = record.error(simulated);
            let left = notch::without(&error, problem.plant.rate, hz);
            for o in 0..squares.len() {
                squares[o] += error[o].iter().zip(&left[o]).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
                one += simulated[o].iter().zip(&steady[o]).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            }
            samples += record.samples();
        }
        let amplitude = placed.parameters[size].abs() * (squares.iter().sum::<f64>() / one).sqrt();
        let rms = squares.iter().map(|square| (square / samples as f64).sqrt()).collect();
        let effect = placed.effect.name();
        Some((which, Wandering { effect, port, hz, amplitude, rms, gain: own }))
    })
}

/// Returns twice the log likelihood that a line gains over the residual `without` it: with a separate phase in each
/// record, and with one phase for all. `traces` are its whitened responses at phases of 0 and 90 degrees.
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
    use crate::effects::{Action, Library};
    use crate::fit::problem::sum_of_squares;
    use crate::plant::Plant;
    use crate::prepare::{Known, prepare};
    use crate::simulate::simulate;
    use crate::testing;

    /// A force of 103 Hz at the second port, with one phase or with a separate one in each record.
    #[test]
    fn a_line_that_keeps_its_phase_does_not_wander() {
        const HZ: f64 = 103.0;
        const SIZE: f64 = 0.05;
        let sim = testing::truss(1);
        let library = Library::standard();
        for phases in [[0.0; 4], [0.0, 1.9, 4.1, 5.5]] {
            let mut case = testing::case(&sim, &sim);
            let plant = Plant::new(&sim).unwrap();
            for (record, phase) in case.records.iter_mut().zip(phases) {
                let force = move |t: f64| SIZE * (TAU * HZ * t + phase).sin();
                let quiet = vec![vec![0.0; record.samples()]; plant.m];
                let line = [Action::Disturbance(1, Box::new(force))];
                let more = simulate(&plant, &line, &quiet, record.start_s, None, Fineness::FINE);
                record.y.iter_mut().flatten().zip(more.iter().flatten()).for_each(|(y, more)| *y += more);
            }
            let mut ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
            let eta = vec![0.0; ready.problem.nuisance.len()];
            let effect = library.get("narrowband-disturbance").unwrap();
            let line = Placed { effect, place: Place::Frequency(HZ, 1), parameters: vec![0.2, HZ, 0.4] };
            let wanders = phases[3] > 0.0;
            let effects = std::slice::from_ref(&line);
            if let Some((which, found)) = wandering(&ready, &eta, effects) {
                assert_eq!((which, found.port, found.hz), (0, 1, HZ));
                assert!((found.amplitude / SIZE - 1.0).abs() < 0.05, "{}", found.amplitude);
            }
            assert_eq!(ready.renew_lines(&eta, effects, true), wanders.then_some("a line wanders"));
            let problem = &ready.problem;
            let left = sum_of_squares(&problem.residual(&problem.plant, &eta, &[], Fineness::FINE));
            // Noise alone, or the whole line.
            let ratio = left / problem.rows() as f64;
            assert!(if wanders { (0.8..1.1).contains(&ratio) } else { ratio > 10.0 }, "{ratio}");
        }
    }
}
