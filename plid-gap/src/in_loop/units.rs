//! Units of an effect's parameters, from the units of the simulator.

use plid_simulator::Description;

use crate::effects::{Place, Setting};

/// Unit of a channel for which none is known.
const AS_RECORDED: &str = "as recorded";

/// Returns the unit of a parameter at a place: `unit` in terms of force, displacement and velocity of a port, or of V
/// at a channel, with the units that the simulator states. A part for which it states none keeps its name.
pub(super) fn stated(unit: &str, place: &Place, setting: &Setting, description: &Description) -> String {
    let ports = &description.ports;
    let at_port = match *place {
        Place::Port(k) => ports.get(k),
        Place::Input(_) if unit.contains("force") || unit.contains("displacement") || unit.contains("velocity") => {
            ports.get(setting.port(place))
        }
        _ => None,
    };
    if let Some(port) = at_port {
        let whole = |text: &str| if unit == text { text.to_string() } else { format!("({text})") };
        let force = port.force_unit.clone().unwrap_or_else(|| "force".into());
        let Some(displacement) = &port.displacement_unit else { return unit.replace("force", &force) };
        // Only a quotient needs brackets.
        let [velocity, acceleration] = ["s", "s^2"].map(|time| format!("{displacement}/{time}"));
        return match unit {
            "velocity" => velocity,
            _ => unit
                .replace("acceleration", &whole(&acceleration))
                .replace("velocity", &whole(&velocity))
                .replace("displacement", displacement)
                .replace("force", &force),
        };
    }
    let channel = match *place {
        Place::Input(i) => &description.inputs[i].unit,
        Place::Output(o) => &description.outputs[o].unit,
        _ => return unit.into(),
    };
    match (unit, channel) {
        ("V" | "V/s", Some(channel)) => unit.replacen('V', channel, 1),
        ("V", None) => AS_RECORDED.into(),
        ("V/s", None) => format!("{AS_RECORDED}/s"),
        _ => unit.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::in_loop::coupling::Response;
    use crate::in_loop::survey::bare;
    use plid_simulator::{Input, Output, Port};

    #[test]
    fn units_are_those_of_the_simulator() {
        let input = Input { unit: Some("N m".into()), ..Input::new("u") };
        let mut description = Description::new("s", 100.0, vec![input], vec![Output::new("y")]);
        description.steps_per_sample = 1;
        description.ports = vec![
            Port {
                input: Some("u".into()),
                force_unit: Some("N m".into()),
                displacement_unit: Some("rad".into()),
                ..Port::new("joint")
            },
            Port::new("other"),
        ];
        let response = Response { mobility: 1.0, weight: 0.5, step: 0.01 };
        let setting = bare(&description, &[response; 2]).unwrap();
        let of = |unit: &str, place: Place| stated(unit, &place, &setting, &description);
        assert_eq!(of("force/displacement^3", Place::Input(0)), "N m/rad^3");
        assert_eq!(of("force/velocity", Place::Input(0)), "N m/(rad/s)");
        assert_eq!(of("velocity", Place::Input(0)), "rad/s");
        assert_eq!(of("force/velocity", Place::Port(1)), "force/velocity");
        assert_eq!(of("V", Place::Input(0)), "N m");
        assert_eq!(of("V/s", Place::Output(0)), "as recorded/s");
        assert_eq!(of("Hz", Place::Input(0)), "Hz");
    }
}
