//! The linear model of a linear simulator, realised from its impulse responses.
//!
//! The responses to one pulse at each input and at each port fill a Hankel matrix, whose rank is the number of states
//! (Ho & Kalman, *Regelungstechnik* 14, 1966; Juang & Pappa, *J. Guidance* 8, 1985). The responses are free of noise,
//! so the rank is clear. The model is accepted only if it reproduces the simulator in the loudest record with forces
//! at all ports, which is also the test of linearity.

use nalgebra::{DMatrix, DVector};
use plid_model::{Continuous, Model, Port, stability};
use plid_simulator::{Checked, Description, SimulatorError};

use crate::audit::ON_THE_CIRCLE;
use crate::case::record::{Channels, rms};
use crate::plant::logarithm;

/// Numbers of sample times that a Hankel matrix spans. They are tried in turn until the model reproduces the simulator.
const SPANS: [usize; 6] = [12, 24, 48, 96, 192, 384];

/// Largest number of rows or columns of a Hankel matrix.
const LARGEST: usize = 900;

/// Largest difference between the simulator and its model, over the RMS of each output and motion.
const SAME: f64 = 1e-6;

/// A difference so small that no larger Hankel matrix is tried.
const CLOSE: f64 = 1e-10;

/// Largest ratio of a singular value that may count as zero to the first one.
const ZERO: f64 = 1e-6;

/// Largest difference between the response to a pulse and minus twice the response to minus half the pulse, relative
/// to the former.
const PROPORTIONAL: f64 = 1e-9;

/// Size of the force at a port in the comparison: the peak velocity after a pulse of this force, relative to the RMS
/// of the velocity in the record.
const PUSHED: f64 = 0.3;

/// The linear model of a simulator, and its difference from the simulator.
pub(super) struct Realised {
    /// The model with the simulator's channels and ports.
    pub model: Model,
    /// Largest difference in the loudest record, over the RMS of each output and motion.
    pub error: f64,
}

/// A simulator whose signals are taken at the samples: the outputs (p), then displacement and velocity of each port
/// (2 q).
struct Probe<'a, 's> {
    simulator: &'a mut Checked<'s>,
    inputs: usize,
    ports: usize,
    steps: usize,
}

impl Probe<'_, '_> {
    /// Runs from rest with inputs and forces (q channels) that are held over each sample.
    fn run(&mut self, u: &[Vec<f64>], forces: &[Vec<f64>]) -> Result<Channels, SimulatorError> {
        let values = self.simulator.description().values();
        if self.ports == 0 {
            return self.simulator.run(&values, u);
        }
        let steps = self.steps;
        let held: Channels =
            u.iter().map(|u| u.iter().flat_map(|u| std::iter::repeat_n(*u, steps)).collect()).collect();
        let mut motions: Channels = vec![Vec::new(); 2 * self.ports];
        let mut seen = self.simulator.run_with(&values, &held, |step, now, acting| {
            for (acting, force) in acting.iter_mut().zip(forces) {
                *acting = force[step / steps];
            }
            if step % steps == 0 {
                for (channels, motion) in motions.chunks_mut(2).zip(now) {
                    channels[0].push(motion.displacement);
                    channels[1].push(motion.velocity);
                }
            }
        })?;
        seen.append(&mut motions);
        Ok(seen)
    }

    /// Returns the response to a pulse of one sample at an input or at a port. Ports are counted after the inputs.
    fn pulse(&mut self, at: usize, size: f64, samples: usize) -> Result<Channels, SimulatorError> {
        let mut driven = vec![vec![0.0; samples]; self.inputs + self.ports];
        if let Some(first) = driven.get_mut(at).and_then(|channel| channel.first_mut()) {
            *first = size;
        }
        let forces = driven.split_off(self.inputs);
        self.run(&driven, &forces)
    }
}

/// Returns the linear model of a simulator, or `None` if it is not linear, not stable, or too large for this method.
/// `u` contains the inputs of the loudest record.
pub(super) fn realise(simulator: &mut Checked<'_>, u: &[Vec<f64>]) -> Result<Option<Realised>, SimulatorError> {
    let description = simulator.description().clone();
    let (inputs, ports) = (description.inputs.len(), description.ports.len());
    let mut probe = Probe { simulator, inputs, ports, steps: description.steps_per_sample.max(1) };
    let (rows, columns) = (description.outputs.len() + 2 * ports, inputs + ports);
    let spans: Vec<usize> = SPANS.into_iter().filter(|span| span * rows.max(columns) <= LARGEST).collect();
    let (Some(longest), true) = (spans.last(), inputs > 0) else { return Ok(None) };
    let samples = 2 * longest + 1;
    let peak = |u: &Vec<f64>| u.iter().fold(0.0, |peak: f64, u| peak.max(u.abs()));
    let sizes: Vec<f64> = u.iter().map(peak).chain(std::iter::repeat_n(1.0, ports)).collect();
    if sizes.contains(&0.0) || !is_proportional(&mut probe, sizes[0])? {
        return Ok(None);
    }
    let mut responses = Vec::new();
    for (at, size) in sizes.iter().enumerate() {
        let response = probe.pulse(at, *size, samples)?;
        responses.push(response.into_iter().map(|y| y.into_iter().map(|y| y / size).collect()).collect());
    }
    let trial = Trial::new(&mut probe, u, &responses)?;
    let mut best: Option<(f64, Matrices)> = None;
    for span in spans {
        let Some(found) = Matrices::of(&responses, span) else { continue };
        let error = trial.difference(&found);
        if best.as_ref().is_none_or(|(least, _)| error < *least) {
            best = Some((error, found));
        }
        if error < CLOSE {
            break;
        }
    }
    let found = best.filter(|(error, _)| *error <= SAME);
    Ok(found.and_then(|(error, found)| Some(Realised { model: found.model(&description)?, error })))
}

/// Returns whether the simulator stays at rest without inputs, and whether its response to minus half a pulse is minus
/// half the response to the pulse.
fn is_proportional(probe: &mut Probe, size: f64) -> Result<bool, SimulatorError> {
    let still = probe.pulse(usize::MAX, 0.0, SPANS[0])?;
    if still.iter().flatten().any(|y| *y != 0.0) {
        return Ok(false);
    }
    let (whole, half) = (probe.pulse(0, size, SPANS[0])?, probe.pulse(0, -0.5 * size, SPANS[0])?);
    let same = |(whole, half): (&Vec<f64>, &Vec<f64>)| {
        let apart: Vec<f64> = whole.iter().zip(half).map(|(w, h)| w + 2.0 * h).collect();
        rms(apart) <= PROPORTIONAL * rms(whole)
    };
    Ok(whole.iter().zip(&half).all(same))
}

/// The loudest record with forces at the ports.
struct Trial {
    /// Inputs and forces at each sample.
    driven: Vec<DVector<f64>>,
    /// The outputs and motions of the simulator.
    seen: Channels,
}

impl Trial {
    fn new(probe: &mut Probe, u: &[Vec<f64>], responses: &[Channels]) -> Result<Self, SimulatorError> {
        let samples = u.first().map_or(0, Vec::len);
        let (inputs, ports) = (probe.inputs, probe.ports);
        let mut forces = vec![vec![0.0; samples]; ports];
        let mut seen = probe.run(u, &forces)?;
        if ports > 0 {
            let first = seen.len() - 2 * ports;
            for (port, force) in forces.iter_mut().enumerate() {
                let velocity = first + 2 * port + 1;
                let pulse = responses[inputs + port][velocity].iter().fold(0.0, |peak: f64, v| peak.max(v.abs()));
                let size = if pulse > 0.0 { PUSHED * rms(&seen[velocity]) / pulse } else { 0.0 };
                // The signs are irregular and differ between the ports.
                let sign = |k: usize| if ((k + 1) * (2 * port + 40_503)) & 0x400 == 0 { 1.0 } else { -1.0 };
                *force = (0..samples).map(|k| size * sign(k)).collect();
            }
            seen = probe.run(u, &forces)?;
        }
        let at = |k: usize| DVector::from_iterator(inputs + ports, u.iter().chain(&forces).map(|channel| channel[k]));
        Ok(Self { driven: (0..samples).map(at).collect(), seen })
    }

    /// Returns the largest difference between a model and the simulator, over the RMS of each channel.
    fn difference(&self, model: &Matrices) -> f64 {
        let mut x = DVector::zeros(model.a.nrows());
        let mut apart = vec![0.0; self.seen.len()];
        for (k, driven) in self.driven.iter().enumerate() {
            let y = &model.c * &x + &model.d * driven;
            for ((apart, y), seen) in apart.iter_mut().zip(y.iter()).zip(&self.seen) {
                *apart += (y - seen[k]).powi(2);
            }
            x = &model.a * x + &model.b * driven;
        }
        let samples = self.driven.len().max(1) as f64;
        let relative = |(apart, seen): (&f64, &Vec<f64>)| {
            let (apart, size) = ((apart / samples).sqrt(), rms(seen));
            if apart == 0.0 { 0.0 } else { apart / size }
        };
        // The difference of a run that diverges is not a number.
        let worst = apart.iter().zip(&self.seen).map(relative);
        worst.fold(0.0, |worst: f64, one| if one <= worst { worst } else { one })
    }
}

/// Matrices from inputs and forces to outputs and motions.
struct Matrices {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    c: DMatrix<f64>,
    d: DMatrix<f64>,
}

impl Matrices {
    /// Realises impulse responses from a Hankel matrix that spans this number of sample times.
    fn of(responses: &[Channels], span: usize) -> Option<Self> {
        let (rows, columns) = (responses[0].len(), responses.len());
        // Channels of very different units are scaled, so that small ones count.
        let size = |channels: &mut dyn Iterator<Item = &Vec<f64>>| {
            let largest = channels.map(|y| y.iter().fold(0.0, |peak: f64, y| peak.max(y.abs()))).fold(0.0, f64::max);
            if largest > 0.0 { largest } else { 1.0 }
        };
        let of_row: Vec<f64> = (0..rows).map(|i| size(&mut responses.iter().map(|all| &all[i]))).collect();
        let scaled = |i: usize, j: usize, k: usize| responses[j][i][k] / of_row[i];
        let of_column: Vec<f64> = (0..columns)
            .map(|j| (0..rows).map(|i| size(&mut std::iter::once(&responses[j][i])) / of_row[i]).fold(0.0, f64::max))
            .map(|size| if size > 0.0 { size } else { 1.0 })
            .collect();
        let hankel = |shift: usize| {
            DMatrix::from_fn(span * rows, span * columns, |r, c| {
                let (i, j, k) = (r % rows, c % columns, 1 + r / rows + c / columns + shift);
                scaled(i, j, k) / of_column[j]
            })
        };
        let svd = hankel(0).try_svd(true, true, f64::EPSILON, 0)?;
        let n = rank(svd.singular_values.as_slice())?;
        let (left, right) = (svd.u?.columns(0, n).into_owned(), svd.v_t?.rows(0, n).into_owned());
        let root = svd.singular_values.rows(0, n).map(f64::sqrt);
        let inverse = DMatrix::from_diagonal(&root.map(f64::recip));
        let root = DMatrix::from_diagonal(&root);
        let a = &inverse * left.transpose() * hankel(1) * right.transpose() * &inverse;
        let (b, c) = (&root * right.columns(0, columns), left.rows(0, rows) * &root);
        Some(Self {
            a,
            b: DMatrix::from_fn(n, columns, |i, j| b[(i, j)] * of_column[j]),
            c: DMatrix::from_fn(rows, n, |i, j| c[(i, j)] * of_row[i]),
            d: DMatrix::from_fn(rows, columns, |i, j| responses[j][i][0]),
        })
    }

    /// Returns the model with channels and ports; `None` if it is unstable, or if it has ports but no continuous
    /// form.
    fn model(&self, description: &Description) -> Option<Model> {
        let (n, m, p) = (self.a.nrows(), description.inputs.len(), description.outputs.len());
        let own =
            |matrix: &DMatrix<f64>, rows: usize, columns: usize| matrix.view((0, 0), (rows, columns)).into_owned();
        let (b, c, d) = (own(&self.b, n, m), own(&self.c, p, n), own(&self.d, p, m));
        let mut model = Model::new(description.rate_hz, self.a.clone(), b, c, d).ok()?;
        if stability(&model).ok()?.spectral_radius > 1.0 + ON_THE_CIRCLE {
            return None;
        }
        model.inputs = description.inputs.iter().map(|input| input.name.clone()).collect();
        model.outputs = description.outputs.iter().map(|output| output.name.clone()).collect();
        model.output_kinds = description.outputs.iter().map(|output| output.kind).collect();
        if description.ports.is_empty() {
            return Some(model);
        }
        let columns = self.b.ncols();
        let mut whole = DMatrix::identity(n + columns, n + columns);
        whole.view_mut((0, 0), (n, n)).copy_from(&self.a);
        whole.view_mut((0, n), (n, columns)).copy_from(&self.b);
        let whole = logarithm(&whole)? * description.rate_hz;
        model.continuous = Some(Continuous { a: own(&whole, n, n), b: whole.view((0, n), (n, m)).into_owned() });
        let port = |(k, port): (usize, &plid_simulator::Port)| {
            let row = |i: usize| self.c.row(p + 2 * k + i).iter().copied().collect();
            let output: Vec<f64> = self.d.column(m + k).iter().take(p).copied().collect();
            Port {
                name: port.name.clone(),
                input: port.input.clone(),
                force: whole.view((0, n + m + k), (n, 1)).iter().copied().collect(),
                displacement: row(0),
                velocity: row(1),
                output: output.iter().any(|g| *g != 0.0).then_some(output),
            }
        };
        model.ports = description.ports.iter().enumerate().map(port).collect();
        Some(model)
    }
}

/// Returns the number of singular values before the deepest drop to zero.
fn rank(values: &[f64]) -> Option<usize> {
    let first = *values.first().filter(|first| **first > 0.0)?;
    let least = f64::EPSILON * first;
    let drop = |k: usize| values[k - 1].max(least) / values.get(k).copied().unwrap_or(0.0).max(least);
    let zero = |k: &usize| values.get(*k).is_none_or(|value| *value <= ZERO * first);
    // Without a drop to zero there are more states than the matrix can show.
    (1..=values.len()).filter(zero).max_by(|a, b| drop(*a).total_cmp(&drop(*b))).filter(|n| *n < values.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::Plant;
    use crate::testing::{RATE, random_input, truss};
    use plid_simulator::{Channels as Y, Function, Input, Linear, Output, Simulator};

    fn inputs(samples: usize) -> Channels {
        random_input(1, samples, 2)
    }

    fn of(simulator: &mut dyn Simulator) -> Option<Realised> {
        let mut checked = Checked::new(simulator).unwrap();
        let samples = 2000;
        let m = checked.description().inputs.len();
        realise(&mut checked, &inputs(samples)[..m]).unwrap()
    }

    /// The poles, and the product of input and output shapes of each mode, survive a simulator that only takes steps.
    #[test]
    fn a_linear_simulator_gives_its_model_back() {
        let model = truss(1);
        let found = of(&mut Linear::new(&model, "truss", 1).unwrap()).unwrap();
        assert_eq!(found.model.n(), model.n());
        assert!(found.error < 1e-9, "{}", found.error);
        assert_eq!((&found.model.inputs, &found.model.outputs), (&model.inputs, &model.outputs));
        let (own, again) = (Plant::new(&model).unwrap(), Plant::new(&found.model).unwrap());
        for (own, again) in own.modes.iter().zip(&again.modes) {
            assert!((own.pole - again.pole).norm() < 1e-6 * own.pole.norm(), "{} {}", own.pole, again.pole);
            let product = |mode: &crate::plant::Mode| mode.c[1] * mode.b[0];
            assert!((product(own) - product(again)).norm() < 1e-5 * product(own).norm());
        }
    }

    /// The ports of a simulator are those of its model: a spring there moves the poles in the same way.
    #[test]
    fn ports_come_back_with_force_and_motion() {
        let mut model = truss(1);
        let continuous = Plant::new(&model).unwrap().to_model(&model);
        model = continuous;
        let n = model.n();
        let a = model.continuous.clone().unwrap().a;
        // A force with the shape of the first input, and a velocity that is the derivative of the displacement: its
        // row is that of the displacement times A.
        let row = nalgebra::RowDVector::from_fn(n, |_, j| model.c[(0, j)]);
        let rate = &row * &a;
        model.ports = vec![Port {
            name: "strut".into(),
            input: Some("u1".into()),
            force: model.continuous.as_ref().unwrap().b.column(0).iter().copied().collect(),
            displacement: row.iter().copied().collect(),
            velocity: rate.iter().copied().collect(),
            output: None,
        }];
        for steps in [1, 3] {
            let found = of(&mut Linear::new(&model, "truss", steps).unwrap()).unwrap();
            let port = &found.model.ports[0];
            assert_eq!((port.name.as_str(), port.input.as_deref()), ("strut", Some("u1")));
            let again = found.model.continuous.as_ref().unwrap();
            // d (s - A)^-1 b at s = 2 pi 100 i does not depend on the coordinates of the states.
            let response = |a: &DMatrix<f64>, port: &Port| {
                let s =
                    DMatrix::identity(n, n).map(|x: f64| plid_fourier::C::new(0.0, std::f64::consts::TAU * 100.0 * x));
                let force = DVector::from_vec(port.force.clone()).map(plid_fourier::C::from);
                let x = (s - a.map(plid_fourier::C::from)).lu().solve(&force).unwrap();
                port.displacement.iter().zip(x.iter()).map(|(d, x)| x * *d).sum::<plid_fourier::C>()
            };
            let (own, again) = (response(&a, &model.ports[0]), response(&again.a, port));
            assert!((own - again).norm() < 1e-6 * own.norm(), "{own} {again}");
        }
    }

    fn function(of: fn(f64, f64) -> f64) -> impl Simulator {
        let description = plid_simulator::Description::new("f", RATE, vec![Input::new("u")], vec![Output::new("y")]);
        Function::new(description, move |_: &[f64], u: &[Vec<f64>]| -> Result<Y, SimulatorError> {
            let mut x = 0.0;
            Ok(vec![
                u[0].iter()
                    .map(|u| {
                        x = of(x, *u);
                        x
                    })
                    .collect(),
            ])
        })
    }

    /// Simulators with a saturation, a weak quadratic term, an offset or a pole outside the unit circle are rejected.
    #[test]
    fn what_is_not_linear_stays_in_the_loop() {
        let slow = of(&mut function(|x, u| 0.99 * x + 0.01 * u)).unwrap();
        assert_eq!(slow.model.n(), 1);
        assert!(of(&mut function(|x, u| 0.9 * x + u.clamp(-1.0, 1.0))).is_none());
        assert!(of(&mut function(|x, u| 0.9 * x + u - 1e-5 * x * x.abs())).is_none());
        assert!(of(&mut function(|x, u| 0.9 * x + u + 1e-3)).is_none());
        assert!(of(&mut function(|x, u| 1.001 * x + u)).is_none());
    }
}
