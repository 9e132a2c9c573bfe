//! The kinds of the outputs and the locations of forces, as the diagnosis interpreted them.

use crate::case::ON_A_MODE;
use crate::effects::{Effect, Library, Names, Setting};
use crate::fit::problem::Placed;
use crate::plant::{KindSource, Plant, Port, PortScale, PortSource, Sensed};
use crate::search::rules::Rules;
use crate::search::stage::is_blind;

/// States the kind of each output, the locations of forces that depend on the motion where they are not obvious, and
/// the effects that have no location, with what to declare.
pub(crate) fn in_words(setting: &Setting, library: &Library, rules: &Rules) -> Vec<String> {
    let mut words = of_forces(&setting.plant, &setting.names);
    let effects: Vec<&dyn Effect> = library.effects().filter(|effect| rules.may_name(*effect)).collect();
    words.extend(need_a_port(setting, &effects));
    words.extend(need_a_suspicion(setting, &effects, rules));
    words
}

/// Names the effects that have no location because the ports were inferred from the modes, but would have one if the
/// same ports were declared.
fn need_a_port(setting: &Setting, effects: &[&dyn Effect]) -> Option<String> {
    if setting.plant.port_source != PortSource::Inferred {
        return None;
    }
    let mut declared = setting.clone();
    declared.plant.port_source = PortSource::Declared;
    let lacks_port = |effect: &&&dyn Effect| effect.places(setting).is_empty() && !effect.places(&declared).is_empty();
    let names: Vec<&str> = effects.iter().filter(lacks_port).map(|effect| effect.name()).collect();
    (!names.is_empty()).then(|| {
        format!(
            "Not considered, because the ports were inferred from the modes: {}. Declare a `[[port]]` by an input and \
            an output where one of them may act.",
            names.join(", ")
        )
    })
}

/// Names the contacts that were not tried at ports where no output measures the displacement.
fn need_a_suspicion(setting: &Setting, effects: &[&dyn Effect], rules: &Rules) -> Option<String> {
    let (mut names, mut places) = (Vec::new(), Vec::new());
    let add = |list: &mut Vec<String>, new: String| {
        if !list.contains(&new) {
            list.push(new);
        }
    };
    for &effect in effects.iter().filter(|effect| effect.is_contact()) {
        for place in effect.places(setting) {
            let placed = Placed { effect, place, parameters: Vec::new() };
            if rules.allow(&placed, &setting.names) && is_blind(setting, rules, &placed) {
                add(&mut names, format!("`{}`", effect.name()));
                add(&mut places, placed.place.location(&setting.names));
            }
        }
    }
    (!names.is_empty()).then(|| {
        format!(
            "Not considered at {}, because no output measures the displacement there: {}. Name an effect in `suspects` \
            if the motion may reach a stop.",
            places.join(" and "),
            names.join(", ")
        )
    })
}

/// States the kind of each output and, where they are not obvious, the locations of forces that depend on the motion.
fn of_forces(plant: &Plant, names: &Names) -> Vec<String> {
    let mut words = vec![kinds(plant, names)];
    if plant.ports.is_empty() {
        // If all outputs are declared to measure no motion, the kinds have said it.
        if !plant.shows_motion() {
            return words;
        }
        words.push(
            "No force that depends on the motion, such as friction, backlash or a payload, was considered: the \
            simulation has no lightly damped mode, and no output shows the motion of an input's axis. Declare \
            `output_kinds` (a position, a velocity or an acceleration), a `[[port]]` by an input and an \
            output, or ports in the simulation."
                .into(),
        );
        return words;
    }
    if plant.port_source == PortSource::Axis {
        let place = |(k, port): (usize, &Port)| match (port.scale, port.input) {
            (PortScale::Moved { input, output }, _) => {
                format!("between the motion {} and the force {}", names.inputs[input], names.outputs[output])
            }
            (_, Some(_)) => format!("on the axis of {}", port.name),
            (_, None) if plant.is_joint(k) => format!("in the elastic joint (port:{})", port.name),
            (_, None) if port.name.starts_with(ON_A_MODE) => format!("on {}", port.name),
            (_, None) => format!("at the output {}", port.name),
        };
        let places: Vec<String> = plant.ports.iter().enumerate().map(place).collect();
        words.push(format!("Forces that depend on the motion were considered {}.", places.join(" and ")));
    }
    let blind: Vec<&str> =
        plant.ports.iter().filter(|port| !port.sees_displacement()).map(|port| port.name.as_str()).collect();
    if !blind.is_empty() {
        words.push(format!(
            "Forces that depend on a displacement, such as springs, clearances and stops, were not considered at {}, \
            where only the velocity is known. {}",
            blind.join(" and "),
            to_declare(plant)
        ));
    }
    words.extend(integrated(plant));
    words
}

/// Says what to declare where only the velocity is known.
fn to_declare(plant: &Plant) -> &'static str {
    if plant.modes.is_empty() {
        return "Declare that the output measures a velocity (`output_kinds`), or a `[[port]]` with an output that \
            measures a position or a velocity.";
    }
    "Declare a `[[port]]` with an output that measures a position."
}

/// Names the ports whose displacement is the integral of their velocity.
fn integrated(plant: &Plant) -> Option<String> {
    let names: Vec<&str> =
        plant.ports.iter().filter(|port| plant.integrates(port)).map(|port| port.name.as_str()).collect();
    (!names.is_empty()).then(|| {
        format!(
            "The displacement at {} is the integral of the velocity. It is zero at the beginning of each record that \
            starts from rest, and fitted at the beginning of the others.",
            names.join(" and ")
        )
    })
}

fn kinds(plant: &Plant, names: &Names) -> String {
    let is_force =
        |o: usize| plant.ports.iter().any(|port| matches!(port.scale, PortScale::Moved { output, .. } if output == o));
    let one = |(o, (output, sensed)): (usize, (&String, &Sensed))| {
        let source = match sensed.source {
            KindSource::Declared if !sensed.is_motion() && is_force(o) => {
                return format!("{output} measures a force (declared)");
            }
            KindSource::Declared if !sensed.is_motion() => {
                return format!(
                    "{output} measures no motion (declared as `{}`), so no force that depends on the motion was \
                    considered there",
                    sensed.kind.name()
                );
            }
            KindSource::Declared => "declared",
            KindSource::Inferred => "inferred from the simulation",
            KindSource::Assumed if is_force(o) => return format!("{output} measures a force (its response shows it)"),
            KindSource::Assumed => "assumed",
        };
        format!("{output} measures {} ({source})", with_article(sensed.kind.name()))
    };
    let all: Vec<String> = names.outputs.iter().zip(&plant.sensed).enumerate().map(one).collect();
    format!("{}.", all.join("; "))
}

fn with_article(kind: &str) -> String {
    if kind.starts_with('a') { format!("an {kind}") } else { format!("a {kind}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{Known, prepare};
    use crate::testing::axis::Axis;
    use crate::testing::{held, truss};
    use nalgebra::dmatrix;
    use plid_model::{Model, OutputKind};

    const FREE: Rules = Rules { suspects: &[], exclude: &[], without: &[] };

    fn said(setting: &Setting, rules: &Rules) -> String {
        in_words(setting, &Library::standard(), rules).join("\n")
    }

    /// The report of a heater says that its output was declared, and that no force was considered there.
    #[test]
    fn a_declared_temperature_measures_no_motion() {
        let (a, b) = held(&dmatrix![-0.02], &dmatrix![0.5], 1.0);
        let mut model = Model::new(1.0, a, b, dmatrix![1.0], dmatrix![0.0]).unwrap();
        let words = |model: &Model| said(&Setting::bare(&Plant::new(model).unwrap(), model), &FREE);
        assert!(words(&model).contains("y1 measures a velocity (inferred"), "{}", words(&model));
        model.output_kinds = vec![Some(OutputKind::Other)];
        assert_eq!(
            words(&model),
            "y1 measures no motion (declared as `other`), so no force that depends on the motion was considered there."
        );
    }

    /// Effects that act at declared ports alone are named if the ports were inferred from modes, unless the case
    /// excludes them.
    #[test]
    fn effects_that_need_a_declared_port_are_named() {
        let mut model = truss(1);
        let setting = |model: &Model| Setting::bare(&Plant::new(model).unwrap(), model);
        let begin = "Not considered, because the ports were inferred from the modes: ";
        assert!(!said(&setting(&model), &FREE).contains(begin));
        model.ports.clear();
        let all = said(&setting(&model), &FREE);
        let listed = "added-damping, added-mass, added-stiffness, backlash, end-stop, gravity-sine, one-sided-stop, \
            stick-friction. Declare a `[[port]]`";
        assert!(all.contains(&format!("{begin}{listed}")), "{all}");
        let exclude = ["backlash".to_string(), "added-mass".to_string()];
        let fewer = said(&setting(&model), &Rules { exclude: &exclude, ..FREE });
        assert!(fewer.contains(&format!("{begin}added-damping, added-stiffness, end-stop, ")), "{fewer}");
    }

    /// A stop is tried where no output measures the displacement only if the case suspects it, and the report says so.
    #[test]
    fn stops_that_no_output_shows_are_named() {
        let setting = |position: bool| {
            let case = Axis { mass: 1.0, c: 60.0, k: 700.0, force: |_, _| 0.0, position }.case();
            let known = Known::default();
            prepare(case.model.as_ref().unwrap(), &case.records, &known).unwrap().problem.setting
        };
        let begin = "Not considered at input:u1, because no output measures the displacement there: ";
        assert!(!said(&setting(true), &FREE).contains(begin));
        let blind = setting(false);
        let all = said(&blind, &FREE);
        assert!(all.contains(&format!("{begin}`end-stop`, `one-sided-stop`. Name an effect in `suspects`")), "{all}");
        let suspects = ["end-stop".to_string()];
        let fewer = said(&blind, &Rules { suspects: &suspects, ..FREE });
        assert!(fewer.contains(&format!("{begin}`one-sided-stop`. Name")), "{fewer}");
        assert!(!said(&blind, &Rules { suspects: &["input:u1".to_string()], ..FREE }).contains(begin));
    }
}
