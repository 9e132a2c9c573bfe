//! The kinds of the outputs and the locations of forces, as the diagnosis understood them.

use crate::effects::Names;
use crate::plant::{KindSource, Plant, PortSource};

/// States the kind of each output, and the locations of forces that depend on the motion.
pub(crate) fn in_words(plant: &Plant, names: &Names) -> Vec<String> {
    let mut words = vec![kinds(plant, names)];
    match (plant.port_source, plant.ports.is_empty()) {
        (PortSource::Axis, true) => words.push(
            "No force that depends on the motion, such as friction or backlash, was considered, because the simulation \
            has no lightly damped mode and no output shows the motion of an input's axis. Declare `output_kinds` (a \
            position or a velocity), or ports in the simulation."
                .into(),
        ),
        (PortSource::Axis, false) => {
            words.push(format!("Forces that depend on the motion were considered {}.", axes(plant)));
        }
        _ => {}
    }
    words
}

fn kinds(plant: &Plant, names: &Names) -> String {
    let one = |(output, sensed): (&String, &crate::plant::Sensed)| {
        let source = match sensed.source {
            KindSource::Declared => "declared",
            KindSource::Inferred => "inferred from the simulation",
            KindSource::Assumed => "assumed",
        };
        format!("{output} measures {} ({source})", with_article(sensed.kind().name()))
    };
    let all: Vec<String> = names.outputs.iter().zip(&plant.sensed).map(one).collect();
    format!("{}.", all.join("; "))
}

fn with_article(kind: &str) -> String {
    if kind.starts_with('a') { format!("an {kind}") } else { format!("a {kind}") }
}

fn axes(plant: &Plant) -> String {
    let axis = |port: &crate::plant::Port| {
        let sees = if port.sees_displacement() { "" } else { ", of its velocity alone" };
        format!("on the axis of {}{sees}", port.name)
    };
    plant.ports.iter().map(axis).collect::<Vec<_>>().join(" and ")
}
