use std::collections::HashMap;

use nalgebra::{DMatrix, DVector};
use plid_model::{Model, held};

use crate::{Description, Input, Motion, Output, Port, Simulator, SimulatorError};

/// A linear model as a simulator with steps: x+ = A x + B u + F f, y = C x + D u + G f, with forces f at its declared
/// ports.
#[derive(Debug, Clone)]
pub struct Linear {
    description: Description,
    a: DMatrix<f64>,
    /// Inputs, then forces.
    b: DMatrix<f64>,
    c: DMatrix<f64>,
    d: DMatrix<f64>,
    /// Displacement and velocity of each port, in turn.
    seen: DMatrix<f64>,
    x: DVector<f64>,
    next: DVector<f64>,
    driven: DVector<f64>,
    /// The stored states, by their slots.
    kept: HashMap<usize, DVector<f64>>,
}

impl Linear {
    /// Creates a simulator from a model, with a number of steps in a sample.
    ///
    /// # Errors
    /// Returns [`SimulatorError::Description`] if the model has ports or several steps per sample, but no
    /// continuous-time form.
    pub fn new(model: &Model, name: &str, steps_per_sample: usize) -> Result<Self, SimulatorError> {
        let inputs = model.inputs.iter().map(Input::new).collect();
        let mut description = Description::new(name, model.sample_rate_hz, inputs, Vec::new());
        description.outputs = model
            .outputs
            .iter()
            .zip(&model.output_kinds)
            .map(|(name, kind)| Output { kind: *kind, ..Output::new(name) })
            .collect();
        description.ports =
            model.ports.iter().map(|port| Port { input: port.input.clone(), ..Port::new(&port.name) }).collect();
        description.steps_per_sample = steps_per_sample.max(1);
        description.states = true;
        let (n, p, count) = (model.n(), model.p(), model.ports.len());
        let (a, b) = match &model.continuous {
            Some(continuous) => {
                let force = DMatrix::from_fn(n, count, |i, j| model.ports[j].force[i]);
                let step = 1.0 / (model.sample_rate_hz * description.steps_per_sample as f64);
                held(&continuous.a, &columns(&continuous.b, &force), step)
            }
            None if count == 0 && steps_per_sample <= 1 => (model.a.clone(), model.b.clone()),
            None => {
                let message = "ports and steps within a sample need the model's continuous form".into();
                return Err(SimulatorError::Description { name: name.into(), message });
            }
        };
        let direct = |i: usize, j: usize| model.ports[j].output.as_ref().map_or(0.0, |output| output[i]);
        let d = columns(&model.d, &DMatrix::from_fn(p, count, direct));
        let row = |k: usize, i: usize| {
            let port = &model.ports[k / 2];
            if k.is_multiple_of(2) { port.displacement[i] } else { port.velocity[i] }
        };
        let driven = DVector::zeros(b.ncols());
        let (x, next) = (DVector::zeros(n), DVector::zeros(n));
        Ok(Self {
            description,
            a,
            b,
            c: model.c.clone(),
            d,
            seen: DMatrix::from_fn(2 * count, n, row),
            x,
            next,
            driven,
            kept: HashMap::new(),
        })
    }

    fn motions(&self) -> Vec<Motion> {
        (0..self.description.ports.len()).map(|port| self.motion(port)).collect()
    }

    fn motion(&self, port: usize) -> Motion {
        let row = |k: usize| self.seen.row(k).iter().zip(self.x.iter()).map(|(s, x)| s * x).sum();
        Motion { displacement: row(2 * port), velocity: row(2 * port + 1) }
    }
}

/// Returns two matrices side by side.
fn columns(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    let at = |i: usize, j: usize| if j < left.ncols() { left[(i, j)] } else { right[(i, j - left.ncols())] };
    DMatrix::from_fn(left.nrows(), left.ncols() + right.ncols(), at)
}

impl Simulator for Linear {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, _parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
        self.x.fill(0.0);
        self.kept.clear();
        Ok(self.motions())
    }

    fn save(&mut self, slot: usize) -> Result<(), SimulatorError> {
        self.kept.insert(slot, self.x.clone());
        Ok(())
    }

    fn restore(&mut self, slot: usize) -> Result<Vec<Motion>, SimulatorError> {
        self.x.copy_from(self.kept.get(&slot).ok_or_else(|| SimulatorError::empty(slot))?);
        Ok(self.motions())
    }

    fn another(&self) -> Result<Option<Box<dyn Simulator>>, SimulatorError> {
        Ok(Some(Box::new(self.clone())))
    }

    fn step(&mut self, u: &[f64], forces: &[f64], y: &mut [f64], motions: &mut [Motion]) -> Result<(), SimulatorError> {
        self.driven.iter_mut().zip(u.iter().chain(forces)).for_each(|(to, from)| *to = *from);
        for (o, y) in y.iter_mut().enumerate() {
            let states: f64 = self.c.row(o).iter().zip(self.x.iter()).map(|(c, x)| c * x).sum();
            *y = states + self.d.row(o).iter().zip(self.driven.iter()).map(|(d, u)| d * u).sum::<f64>();
        }
        self.next.gemv(1.0, &self.a, &self.x, 0.0);
        self.next.gemv(1.0, &self.b, &self.driven, 1.0);
        std::mem::swap(&mut self.x, &mut self.next);
        motions.iter_mut().enumerate().for_each(|(j, motion)| *motion = self.motion(j));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Checked;
    use plid_model::Continuous;

    /// A mass of 2 kg on a spring of 800 N/m and a damper of 4 N s/m, at 100 Hz.
    fn oscillator(steps: usize) -> Linear {
        let (mass, stiffness, damper) = (2.0, 800.0, 4.0);
        let a = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -stiffness / mass, -damper / mass]);
        let b = DMatrix::from_row_slice(2, 1, &[0.0, 1.0 / mass]);
        let (discrete, input) = held(&a, &b, 0.01);
        let c = DMatrix::from_row_slice(1, 2, &[1.0, 0.0]);
        let mut model = Model::new(100.0, discrete, input, c, DMatrix::zeros(1, 1)).unwrap();
        model.continuous = Some(Continuous { a, b });
        model.ports = vec![plid_model::Port {
            name: "spring".into(),
            input: Some("u1".into()),
            force: vec![0.0, 1.0 / mass],
            displacement: vec![1.0, 0.0],
            velocity: vec![0.0, 1.0],
            output: None,
        }];
        Linear::new(&model, "oscillator", steps).unwrap()
    }

    /// The response to a step of force follows the closed form of the damped oscillator, and a force at the port has
    /// the same effect as the input.
    #[test]
    fn a_step_follows_the_closed_form() {
        let (samples, force): (usize, f64) = (200, 3.0);
        let (sigma, omega) = (1.0_f64, (400.0_f64 - 1.0).sqrt());
        let expected = |k: usize| {
            let t = 0.01 * k as f64;
            let decay = (-sigma * t).exp() * ((omega * t).cos() + sigma / omega * (omega * t).sin());
            force / 800.0 * (1.0 - decay)
        };
        for steps in [1, 4] {
            let mut simulator = oscillator(steps);
            let mut checked = Checked::new(&mut simulator).unwrap();
            let by_input = checked.run(&[], &[vec![force; samples]]).unwrap();
            let none = vec![vec![0.0; samples * steps]];
            let by_force = checked.run_with(&[], &none, |_, _, forces| forces.fill(force)).unwrap();
            for k in 0..samples {
                assert!((by_input[0][k] - expected(k)).abs() < 1e-14, "{k}");
                assert!((by_force[0][k] - expected(k)).abs() < 1e-14, "{k}");
            }
        }
    }

    /// The checker confirms that states are restored, and runs of a copy agree with those of the original.
    #[test]
    fn states_and_copies_are_exact() {
        let mut simulator = oscillator(4);
        let findings = crate::check(&mut simulator, 1.0).unwrap();
        assert!(findings.iter().any(|f| f.what == "states") && findings.iter().all(|f| f.holds), "{findings:#?}");
        let mut another = simulator.another().unwrap().unwrap();
        let u = [vec![1.0; 50]];
        assert_eq!(another.run(&[], &u).unwrap(), simulator.run(&[], &u).unwrap());
        simulator.start(&[]).unwrap();
        assert!(simulator.restore(0).is_err(), "a start forgets what was kept");
    }

    /// A spring at the port changes the frequency like a stiffer spring.
    #[test]
    fn the_motion_at_a_port_is_that_of_the_model() {
        let mut simulator = oscillator(50);
        let mut checked = Checked::new(&mut simulator).unwrap();
        let mut far = 0.0_f64;
        let y = checked
            .run_with(&[], &[vec![1.0; 300 * 50]], |_, motions, forces| {
                forces[0] = -100.0 * motions[0].displacement;
                far = far.max(motions[0].displacement);
            })
            .unwrap();
        // The static displacement is 1 / 900 m, which is approached with an overshoot.
        assert!((y[0][290..].iter().sum::<f64>() / 10.0 - 1.0 / 900.0).abs() < 2e-4);
        assert!(far > 1.5 / 900.0, "{far}");
    }
}
