//! Units of quantities, from those of the channels and ports.

use super::unit::Unit;
use super::{Parameter, Place, Setting};
use crate::plant::{Plant, PortScale};

/// The unit of a motion at a port that was inferred from the modes, which leave the scale of the motion open.
pub const ARBITRARY: &str = "arbitrary scale (no port declared)";

/// Units that the case or the simulator states.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Units {
    /// Unit of each input, if it is known.
    pub inputs: Vec<Option<String>>,
    /// Unit of each output, if it is known.
    pub outputs: Vec<Option<String>>,
    /// Units of force and displacement at each port, as a simulator states them.
    pub ports: Vec<[Option<String>; 2]>,
    /// The unit of a channel without a declared unit; V if this is `None`.
    pub unknown: Option<&'static str>,
}

/// The units at a port.
enum AtPort {
    /// Of force and displacement, as far as they are known.
    Known([Option<Unit>; 2]),
    /// Only the force, as far as it is known: the scale of the motion is arbitrary.
    Arbitrary(Option<Unit>),
}

impl Units {
    fn input(&self, i: usize) -> Option<Unit> {
        self.inputs.get(i)?.as_deref().map(Unit::read)
    }

    fn output(&self, o: usize) -> Option<Unit> {
        self.outputs.get(o)?.as_deref().map(Unit::read)
    }

    /// Returns the unit of the displacement that an output shows: the output's own unit, times s for each derivative.
    /// `None` if the output measures no motion.
    fn displacement(&self, plant: &Plant, o: usize) -> Option<Unit> {
        Some(self.output(o)?.times(&Unit::read("s"), plant.sensed.get(o)?.order()?))
    }

    fn at_port(&self, plant: &Plant, port: usize) -> AtPort {
        if let Some(stated) = self.ports.get(port) {
            let [force, displacement] = stated.each_ref().map(|unit| unit.as_deref().map(Unit::read));
            let of_input = || plant.ports.get(port)?.input.and_then(|i| self.input(i));
            return AtPort::Known([force.or_else(of_input), displacement]);
        }
        match plant.ports[port].scale {
            PortScale::Inferred(input) => AtPort::Arbitrary(input.and_then(|i| self.input(i))),
            PortScale::Shown { input, output } => AtPort::Known([self.input(input), self.displacement(plant, output)]),
            PortScale::Moved { input, output } => AtPort::Known([self.output(output), self.input(input)]),
            // The product of force and displacement is the same work at both places.
            PortScale::Reciprocal { input, axis, output } => {
                let [axis, own] = [axis, output].map(|o| self.displacement(plant, o));
                let force = self.input(input).zip(axis).zip(own.as_ref());
                AtPort::Known([force.map(|((force, axis), own)| force.times(&axis, 1).times(own, -1)), own])
            }
            PortScale::Own => {
                let input = plant.ports[port].input.filter(|&i| plant.is_pushed_by(port, i));
                let output = (0..plant.p).find(|&o| plant.is_shown_by(port, o));
                AtPort::Known([input.and_then(|i| self.input(i)), output.and_then(|o| self.displacement(plant, o))])
            }
        }
    }
}

impl Setting {
    /// Returns the unit of a quantity of an effect at a place. `unit` is given in terms of force, displacement,
    /// velocity and acceleration at a port, or of V at a channel. A term whose unit is not known keeps its name.
    pub fn unit(&self, unit: &str, place: &Place) -> String {
        let units = &self.units;
        let terms = Unit::read(unit);
        let motion = ["displacement", "velocity", "acceleration"].iter().any(|term| terms.has(term));
        if motion || terms.has("force") {
            return match units.at_port(&self.plant, self.port(place)) {
                AtPort::Arbitrary(_) if motion => ARBITRARY.into(),
                AtPort::Arbitrary(force) => mechanical(&terms, &[force, None]),
                AtPort::Known(known) => mechanical(&terms, &known),
            };
        }
        let ratio = |to: Option<Unit>, from: Option<Unit>| to.zip(from).map(|(to, from)| to.times(&from, -1));
        let of_shares = match *place {
            Place::InputToInput(i, j) if unit == "1" => ratio(units.input(j), units.input(i)),
            Place::OutputToOutput(o, q) if unit == "1" => ratio(units.output(q), units.output(o)),
            _ => None,
        };
        if let Some(unit) = of_shares {
            return unit.to_string();
        }
        let channel = match *place {
            Place::Input(i) => units.input(i),
            Place::Output(o) => units.output(o),
            _ => return unit.into(),
        };
        let channel = channel.or_else(|| units.unknown.map(Unit::one)).unwrap_or_else(|| Unit::one("V"));
        let stated = |term: &str| if term == "V" { channel.clone() } else { Unit::one(term) };
        if terms.has("V") { terms.with(stated).to_string() } else { unit.into() }
    }

    /// Returns the unit of a parameter of an effect at a place.
    pub fn unit_of(&self, parameter: &Parameter, place: &Place) -> String {
        let of_shape = || {
            let name = parameter.name.strip_prefix("b_")?;
            self.unit_of_shape(self.names.inputs.iter().position(|input| input == name)?)
        };
        let shape = if matches!(place, Place::MissingMode(_)) { of_shape() } else { None };
        shape.unwrap_or_else(|| self.unit(&parameter.unit, place))
    }

    /// Returns the unit of an entry of the input shape of a mode that the simulation lacks, which is the mode's
    /// acceleration over the input, if the displacements that the outputs show have the same unit.
    fn unit_of_shape(&self, input: usize) -> Option<String> {
        let all: Option<Vec<Unit>> = (0..self.plant.p).map(|o| self.units.displacement(&self.plant, o)).collect();
        let all = all?;
        let first = all.first()?;
        let acceleration = all.iter().all(|unit| unit == first).then(|| first.times(&Unit::one("s"), -2))?;
        Some(acceleration.times(&self.units.input(input)?, -1).to_string())
    }
}

/// Expresses a unit that is given in terms of force and motion in the units of force and displacement, as far as
/// these are known.
fn mechanical(terms: &Unit, [force, displacement]: &[Option<Unit>; 2]) -> String {
    let motion = |term: &str, order: i32| match displacement {
        Some(displacement) => displacement.times(&Unit::one("s"), -order),
        None => Unit::one(term),
    };
    let stated = |term: &str| match term {
        "force" => force.clone().unwrap_or_else(|| Unit::one(term)),
        "displacement" => motion(term, 0),
        "velocity" => motion(term, 1),
        "acceleration" => motion(term, 2),
        _ => Unit::one(term),
    };
    terms.with(stated).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::CasePort;
    use crate::testing::{Sensor, truss, truss_sensed};
    use plid_model::Model;

    /// Returns the setting of a truss whose outputs have this unit.
    fn setting(model: &Model, ports: &[CasePort], output: &str) -> Setting {
        let mut plant = Plant::new(model).unwrap();
        plant.declare(ports).unwrap();
        let units =
            Units { inputs: vec![Some("N".into()); 2], outputs: vec![Some(output.into()); 2], ..Units::default() };
        Setting { units, ..Setting::bare(&plant, model) }
    }

    fn bare(sensor: Sensor) -> Model {
        Model { ports: Vec::new(), ..truss_sensed(1, sensor, |_| {}) }
    }

    /// The force at a port has the unit of its input. The displacement has that of the output, times s for each
    /// derivative.
    #[test]
    fn units_at_a_port_follow_from_its_channels_and_their_kinds() {
        let strut = |input: usize| CasePort { name: format!("strut{input}"), input, output: input };
        let kinds = [
            (Sensor::Position, "mm", "N/mm^3", "mm/s"),
            (Sensor::Velocity, "mm/s", "N/mm^3", "mm/s"),
            (Sensor::Acceleration, "m/s^2", "N/m^3", "m/s"),
            (Sensor::Acceleration, "g", "N/(g^3 s^6)", "g s"),
        ];
        for (sensor, output, cubic, velocity) in kinds {
            let setting = setting(&bare(sensor), &[strut(0), strut(1)], output);
            let of = |unit: &str| setting.unit(unit, &Place::Input(1));
            assert_eq!(of("force/displacement^3"), cubic, "{output}");
            assert_eq!((of("velocity").as_str(), of("force").as_str()), (velocity, "N"), "{output}");
        }
        let setting = setting(&bare(Sensor::Acceleration), &[strut(0), strut(1)], "m/s^2");
        let of = |unit: &str| setting.unit(unit, &Place::Input(0));
        assert_eq!(of("force/acceleration"), "N s^2/m");
        assert_eq!(of("force/velocity^2"), "N s^2/m^2");
        assert_eq!((of("Hz").as_str(), of("1/s").as_str(), of("samples").as_str()), ("Hz", "1/s", "samples"));
        assert_eq!(setting.unit("V/s", &Place::Output(0)), "m/s^3");
        assert_eq!(setting.unit("V", &Place::Input(0)), "N");
        // The entry of a mode's shape, and shares between channels of one unit.
        let b = Parameter::new("b_u2", "V/V", super::super::Range::Signed);
        assert_eq!(setting.unit_of(&b, &Place::MissingMode(90.0)), "m/(s^2 N)");
        assert_eq!(setting.unit("1", &Place::InputToInput(0, 1)), "1");
    }

    /// The modes alone leave the scale of the motion open, but not that of the force.
    #[test]
    fn an_inferred_strut_has_an_arbitrary_scale() {
        let setting = setting(&bare(Sensor::Acceleration), &[], "m/s^2");
        assert_eq!(setting.unit("force/displacement^3", &Place::Input(0)), ARBITRARY);
        assert_eq!(setting.unit("velocity", &Place::Input(1)), ARBITRARY);
        assert_eq!(setting.unit("force", &Place::Input(1)), "N");
    }

    /// A port of the simulation has its own units, unless its force or its motion is that of a channel.
    #[test]
    fn a_port_of_the_simulation_keeps_the_names_of_what_it_does_not_state() {
        let own = setting(&truss(1), &[], "m/s^2");
        assert_eq!(own.unit("force/displacement", &Place::Input(0)), "N/displacement");
        let none = Setting { units: Units::default(), ..own };
        assert_eq!(none.unit("force/displacement^3", &Place::Input(0)), "force/displacement^3");
        assert_eq!(none.unit("V/s", &Place::Output(1)), "V/s");
    }

    /// Cross-talk between channels of different units has a unit.
    #[test]
    fn cross_talk_carries_one_unit_into_another() {
        let mut setting = setting(&bare(Sensor::Velocity), &[], "m/s");
        setting.units.outputs[1] = Some("rad/s".into());
        assert_eq!(setting.unit("1", &Place::OutputToOutput(0, 1)), "rad/m");
        setting.units.outputs[1] = None;
        assert_eq!(setting.unit("1", &Place::OutputToOutput(0, 1)), "1");
    }
}
