use nalgebra::DVector;

use super::motion::Row;
use super::{Plant, Port, PortScale, PortSource};
use plid_fourier::C;

/// A port as a case declares it: the location where a force may act, given by an input and an output (both counted
/// from 0).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CasePort {
    /// Its name.
    pub name: String,
    /// The input that acts where the force acts.
    pub input: usize,
    /// The output that measures the motion there.
    pub output: usize,
}

impl Plant {
    /// Adds ports that a case declares. They replace inferred ports; ports that the simulation declares are kept.
    ///
    /// A force at a port acts where the port's input acts, after the actuator if the simulation has one before its
    /// modes. It depends on the motion that the port's output measures, before the filters. Two ports of one input
    /// are distinguished by their names; the only port of an input is at the location of that input. Without modes, the
    /// displacement of a port whose velocity alone is known is a further state.
    ///
    /// # Errors
    /// The name of a port, and the reason why no force can act there: its output measures no motion, or the
    /// simulation has no continuous form, or another port has this name.
    pub fn declare(&mut self, ports: &[CasePort]) -> Result<(), (String, String)> {
        if ports.is_empty() {
            return Ok(());
        }
        if self.port_source != PortSource::Declared {
            self.ports.clear();
        }
        let taken = |plant: &Self, input: usize| plant.ports.iter().any(|port| port.input == Some(input));
        for declared in ports {
            let of_input = ports.iter().filter(|port| port.input == declared.input).count();
            let own = of_input == 1 && !taken(self, declared.input);
            if self.ports.iter().any(|port| port.name == declared.name) {
                return Err((declared.name.clone(), "the simulation declares a port of this name".into()));
            }
            self.integrate(declared.output);
            let port = self.between(declared).map_err(|why| (declared.name.clone(), why))?;
            self.ports.push(Port { input: own.then_some(declared.input), ..port });
        }
        self.port_source = PortSource::Declared;
        Ok(())
    }

    /// Returns the port between an input and an output. The port is not assigned to an input.
    ///
    /// # Errors
    /// The reason why there is no such port, in words.
    pub(super) fn between(&self, declared: &CasePort) -> Result<Port, String> {
        let CasePort { name, input, output } = declared;
        if self.rest.continuous.is_none() {
            return Err("the simulation has no continuous form, as with a delay of whole samples".into());
        }
        let kind = self.sensed[*output].kind.name();
        if !self.sensed[*output].is_motion() {
            return Err(format!("its output is declared as `{kind}`, which is not a motion"));
        }
        let motion = self.motion(*output).ok_or_else(|| {
            format!(
                "its output, taken for the {kind} of something, shows no velocity: declare what it measures under \
                `output_kinds`"
            )
        })?;
        let none = Row::none(self);
        let displacement = motion.displacement.unwrap_or(none);
        let (force, force_rest, at_once) = self.entry(*input);
        Ok(Port {
            name: name.clone(),
            input: None,
            scale: PortScale::Shown { input: *input, output: *output },
            force,
            displacement: displacement.modes,
            velocity: motion.velocity.modes,
            force_rest,
            displacement_rest: displacement.rest,
            velocity_rest: motion.velocity.rest,
            output: if at_once.iter().all(|x| *x == 0.0) { Vec::new() } else { at_once },
        })
    }

    /// Returns the factors with which a force that acts where an input acts enters the modes, the rest and, at once,
    /// the outputs.
    ///
    /// Behind an actuator with the pole p, a force f is equivalent to an input u = f + f' / p. If B f / p is subtracted
    /// from the states, the force enters through B + A B / p.
    pub(super) fn entry(&self, input: usize) -> (Vec<C>, DVector<f64>, Vec<f64>) {
        let Some((a, b)) = &self.rest.continuous else { return Default::default() };
        let column: DVector<f64> = b.column(input).into_owned();
        // A force changes no position or velocity at once: a feedthrough to one of these is an error of the model. How
        // an output without motion responds to it is not known.
        let moves = |o: usize| self.sensed[o].order() == Some(2);
        let direct: Vec<f64> = (0..self.p).map(|o| if moves(o) { self.d[(o, input)] } else { 0.0 }).collect();
        let actuator = self.chain.actuator[input].as_ref().filter(|_| !self.modes.is_empty());
        let force = self.modes.iter().map(|mode| mode.b[input] / self.chain.before(input, mode.pole)).collect();
        let Some(actuator) = actuator else { return (force, column, direct) };
        let ahead = &column / actuator.pole;
        let seen = &self.rest.c * &ahead;
        let of_modes = |o: usize| -> f64 {
            self.modes.iter().map(|mode| 2.0 * (mode.c[o] * mode.b[input]).re / actuator.pole).sum()
        };
        // For an output that a force reaches through further poles, the parts cancel, so the sum is a rounding error.
        let at_once = (0..self.p).map(|o| {
            let sum = seen[o] + of_modes(o) + direct[o];
            if self.answers_at_once(o) { sum } else { 0.0 }
        });
        (force, &column + a * &ahead, at_once.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use nalgebra::dmatrix;
    use plid_model::Model;

    fn port(name: &str, input: usize, output: usize) -> CasePort {
        CasePort { name: name.into(), input, output }
    }

    /// If accelerometers are at the struts, a port between an input and an output is the strut that the simulation
    /// declares, behind the actuator and before the filter.
    #[test]
    fn a_port_between_an_input_and_an_output_is_the_declared_strut() {
        const RATIO: f64 = 0.05;
        let mut model = testing::truss_with(2, |_, beta, gamma| *gamma = beta.transpose() * RATIO);
        let declared = Plant::new(&model).unwrap();
        model.ports.clear();
        let mut plant = Plant::new(&model).unwrap();
        assert_eq!(plant.port_source, PortSource::Inferred);
        plant.declare(&[port("a", 0, 0), port("b", 1, 1)]).unwrap();
        assert_eq!((plant.ports.len(), plant.port_source), (2, PortSource::Declared));
        for k in 0..2 {
            assert_eq!(plant.ports[k].input, Some(k));
            let same = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
            same(plant.mobility(k), RATIO * declared.mobility(k));
            same(plant.stiffness(&plant.ports[k]), declared.stiffness(&declared.ports[k]) / RATIO);
            for hz in [5.0, 60.0, 150.0, 400.0] {
                let [found, right] = [&plant, &declared].map(|plant| plant.port_response(k, hz));
                assert!((&found - &right).norm() < 1e-3 * right.norm(), "{hz} Hz: {found} {right}");
            }
        }
    }

    /// Ports of the simulation are kept. Ports that share an input are distinguished only by their names.
    #[test]
    fn declared_ports_stay_and_names_tell_two_apart() {
        let model = testing::truss(1);
        let mut plant = Plant::new(&model).unwrap();
        let before = plant.ports.len();
        plant.declare(&[port("a", 0, 0)]).unwrap();
        assert_eq!((plant.ports.len(), plant.ports[before].input), (before + 1, None));
        assert_eq!(plant.declare(&[port("a", 0, 1)]).unwrap_err().0, "a");
        let mut bare = model.clone();
        bare.ports.clear();
        let mut plant = Plant::new(&bare).unwrap();
        plant.declare(&[port("a", 0, 0), port("b", 0, 1), port("c", 1, 1)]).unwrap();
        let inputs: Vec<Option<usize>> = plant.ports.iter().map(|port| port.input).collect();
        assert_eq!(inputs, [None, None, Some(1)]);
    }

    /// An output that follows the input at once measures no motion.
    #[test]
    fn an_output_without_motion_is_refused() {
        let model = Model::new(100.0, dmatrix![0.5], dmatrix![1.0], dmatrix![1.0], dmatrix![30.0]).unwrap();
        let mut plant = Plant::new(&model).unwrap();
        let (name, why) = plant.declare(&[port("axis", 0, 0)]).unwrap_err();
        assert!(name == "axis" && why.contains("output_kinds"), "{why}");
    }
}
