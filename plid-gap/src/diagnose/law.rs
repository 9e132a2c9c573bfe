//! The forces of the laws that an explanation contains, in the records that were fitted.

use crate::audit::Law;
use crate::case::record::{Channels, Record, rms};
use crate::effects::{Action, Library, Setting};
use crate::fit::candidate::in_words;
use crate::fit::problem::{Placed, Problem};
use crate::judge::explained::Explained;
use crate::simulate::{Fineness, Run, State, before_sensors};

/// Returns the laws of the best explanation with their forces; `None` if it has none, if a force acts at a port whose
/// motion is an input, or in closed loop.
pub(super) fn law(explained: &Explained) -> Option<Law> {
    let problem = &explained.ready.problem;
    let Problem { plant, nuisance, records, setting, .. } = problem;
    let fit = explained.fit();
    let at = |action: &Action| if let Action::Force(port, _) = action { Some(*port) } else { None };
    let ports_of = |placed: &Placed| problem.actions(std::slice::from_ref(placed)).iter().filter_map(at).collect();
    let mut ports: Vec<usize> = fit.effects.iter().flat_map::<Vec<usize>, _>(ports_of).collect();
    ports.sort_unstable();
    ports.dedup();
    if ports.is_empty() || plant.controller.is_some() || ports.iter().any(|&k| plant.ports[k].moved_by().is_some()) {
        return None;
    }
    let shown = nuisance.apply(plant, &fit.eta).showing_forces(&ports);
    let actions = problem.actions(&fit.effects);
    let starts: Vec<Option<State>> = (0..records.len()).map(|k| nuisance.start(k, &fit.eta)).collect();
    let run = |k: usize| Run { actions: &actions, u: &records[k].u, t0: records[k].start_s, start: starts[k].as_ref() };
    let runs: Vec<Run> = (0..records.len()).map(run).collect();
    let simulated = before_sensors(&shown, &runs, Fineness::FINE).into_iter();
    let mut forces: Vec<Channels> = simulated.map(|mut y| y.split_off(plant.p)).collect();
    // An identification needs inputs of similar sizes.
    let level = records.iter().map(Record::level).fold(0.0, f64::max);
    for port in 0..ports.len() {
        let scale = level / rms(forces.iter().flat_map(|forces| &forces[port])).max(f64::MIN_POSITIVE);
        forces.iter_mut().flat_map(|forces| &mut forces[port]).for_each(|force| *force *= scale);
    }
    // A free shape counts as the law that it represents.
    let found = &explained.found.best.effects;
    let laws: Vec<Placed> = found.iter().filter(|placed| !ports_of(placed).is_empty()).cloned().collect();
    let described =
        |law: &Placed| (law.effect.name().into(), law.place.location(&setting.names), law.parameters.clone());
    Some(Law {
        name: in_words(&laws, &setting.names),
        effects: laws.iter().map(described).collect(),
        forces: records.iter().map(|record| record.name.clone()).zip(forces).collect(),
    })
}

/// Returns the effects of a law at their places in another plant, without those that have no place there.
pub(super) fn placed<'a>(law: &Law, library: &'a Library, setting: &Setting) -> Vec<Placed<'a>> {
    let placed = |(name, location, parameters): &(String, String, Vec<f64>)| {
        let effect = library.effects().find(|effect| effect.name() == name)?;
        let place = effect.places(setting).into_iter().find(|place| place.location(&setting.names) == *location)?;
        Some(Placed { effect, place, parameters: parameters.clone() })
    };
    law.effects.iter().filter_map(placed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Place;
    use crate::testing::laws::prepared;

    /// A law is found again at its location, and an effect whose location is missing is left out.
    #[test]
    fn a_law_keeps_its_place_in_another_plant() {
        let setting = prepared(&[]).problem.setting;
        let at = |location: &str| ("cubic-stiffness".to_string(), location.to_string(), vec![2.0]);
        let location = Place::Input(0).location(&setting.names);
        let law = Law { name: String::new(), effects: vec![at("port:gone"), at(&location)], forces: Vec::new() };
        let library = Library::standard();
        let effects = placed(&law, &library, &setting);
        let [spring] = effects.as_slice() else { panic!("one effect") };
        assert_eq!((spring.effect.name(), &spring.place), ("cubic-stiffness", &Place::Input(0)));
        assert_eq!(spring.parameters, [2.0]);
    }
}
