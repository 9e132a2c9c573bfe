use nalgebra::DVector;

use super::motion::Row;
use super::{Plant, Port, PortSource};
use crate::fourier::C;

/// A port as a case declares it: where a force may act, by an input and an output (both from 0).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CasePort {
    /// Its name.
    pub name: String,
    /// The input that enters where the force does.
    pub input: usize,
    /// The output that shows the motion there.
    pub output: usize,
}

impl Plant {
    /// Adds ports that a case declares. They replace those that were inferred; ports that the simulation declares stay.
    ///
    /// A force at a port enters as its input does, after the actuator if the simulation shows one before its modes, and
    /// meets the motion that its output shows, before the filters. Two ports of one input are told apart by their
    /// names; the only port of an input is at the location of that input.
    ///
    /// # Errors
    /// The name of a port, and why no force can act there: its output shows no motion, or the simulation has no
    /// continuous form, or another port has this name.
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
            let port = self.between(declared).map_err(|why| (declared.name.clone(), why))?;
            self.ports.push(Port { input: own.then_some(declared.input), ..port });
        }
        self.port_source = PortSource::Declared;
        Ok(())
    }

    fn between(&self, declared: &CasePort) -> Result<Port, String> {
        let CasePort { name, input, output } = declared;
        if self.rest.continuous.is_none() {
            return Err("the simulation has no continuous form, as with a delay of whole samples".into());
        }
        let motion = self.motion(*output).ok_or_else(|| {
            let kind = self.sensed[*output].kind().name();
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
            force,
            displacement: displacement.modes,
            velocity: motion.velocity.modes,
            force_rest,
            displacement_rest: displacement.rest,
            velocity_rest: motion.velocity.rest,
            output: if at_once.iter().all(|x| *x == 0.0) { Vec::new() } else { at_once },
        })
    }

    /// Returns how a force enters that acts where an input does: on the modes, on the rest, and on the outputs at once.
    ///
    /// Behind an actuator with the pole p, a force f is an input u = f + f' / p. In the states less B f / p, it enters
    /// by B + A B / p.
    fn entry(&self, input: usize) -> (Vec<C>, DVector<f64>, Vec<f64>) {
        let Some((a, b)) = &self.rest.continuous else { return Default::default() };
        let column: DVector<f64> = b.column(input).into_owned();
        let direct: Vec<f64> = self.d.column(input).iter().copied().collect();
        let actuator = self.chain.actuator[input].as_ref().filter(|_| !self.modes.is_empty());
        let force = self.modes.iter().map(|mode| mode.b[input] / self.chain.before(input, mode.pole)).collect();
        let Some(actuator) = actuator else { return (force, column, direct) };
        let ahead = &column / actuator.pole;
        let seen = &self.rest.c * &ahead;
        let of_modes = |o: usize| -> f64 {
            self.modes.iter().map(|mode| 2.0 * (mode.c[o] * mode.b[input]).re / actuator.pole).sum()
        };
        // An output that a force reaches through further poles sees the sum of their parts, which is rounding.
        let at_once = (0..self.p).map(|o| {
            let sum = seen[o] + of_modes(o) + direct[o];
            if self.answers_at_once(o) { sum } else { 0.0 }
        });
        (force, &column + a * &ahead, at_once.collect())
    }
}
