//! The kinds of the outputs and the locations of forces, as the diagnosis interpreted them.

use crate::effects::Names;
use crate::plant::{KindSource, Plant, Port, PortScale, PortSource};

/// States the kind of each output and, where they are not obvious, the locations of forces that depend on the motion.
pub(crate) fn in_words(plant: &Plant, names: &Names) -> Vec<String> {
    let mut words = vec![kinds(plant, names)];
    if plant.ports.is_empty() {
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
        let place = |port: &Port| match (port.scale, port.input) {
            (PortScale::Moved { input, output }, _) => {
                format!("between the motion {} and the force {}", names.inputs[input], names.outputs[output])
            }
            (_, Some(_)) => format!("on the axis of {}", port.name),
            (_, None) => format!("at the output {}", port.name),
        };
        let places: Vec<String> = plant.ports.iter().map(place).collect();
        words.push(format!("Forces that depend on the motion were considered {}.", places.join(" and ")));
    }
    let blind: Vec<&str> =
        plant.ports.iter().filter(|port| !port.sees_displacement()).map(|port| port.name.as_str()).collect();
    if !blind.is_empty() {
        words.push(format!(
            "Forces that depend on a displacement, such as springs, clearances and stops, were not considered at {}, \
            where only the velocity is known. Declare a `[[port]]` with an output that measures a position.",
            blind.join(" and ")
        ));
    }
    words
}

fn kinds(plant: &Plant, names: &Names) -> String {
    let is_force =
        |o: usize| plant.ports.iter().any(|port| matches!(port.scale, PortScale::Moved { output, .. } if output == o));
    let one = |(o, (output, sensed)): (usize, (&String, &crate::plant::Sensed))| {
        let source = match sensed.source {
            KindSource::Declared => "declared",
            KindSource::Inferred => "inferred from the simulation",
            KindSource::Assumed if is_force(o) => return format!("{output} measures a force (its response shows it)"),
            KindSource::Assumed => "assumed",
        };
        format!("{output} measures {} ({source})", with_article(sensed.kind().name()))
    };
    let all: Vec<String> = names.outputs.iter().zip(&plant.sensed).enumerate().map(one).collect();
    format!("{}.", all.join("; "))
}

fn with_article(kind: &str) -> String {
    if kind.starts_with('a') { format!("an {kind}") } else { format!("a {kind}") }
}
