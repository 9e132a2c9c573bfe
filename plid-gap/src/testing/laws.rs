//! Records of a simulated truss with an effect, for tests of the search.

use crate::effects::{Library, Place, Setting};
use crate::fit::free_run::run;
use crate::fit::problem::Placed;
use crate::prepare::{Known, Prepared, prepare};
use crate::testing::{add_noise, case, truss};

/// Returns an effect of the library at a place.
pub fn at<'a>(library: &'a Library, name: &str, place: Place, parameters: Vec<f64>) -> Placed<'a> {
    Placed { effect: library.get(name).unwrap(), place, parameters }
}

/// Returns the names of all effects but these.
pub fn without(library: &Library, names: &[&str]) -> Vec<String> {
    library.effects().map(|effect| effect.name().to_owned()).filter(|name| !names.contains(&name.as_str())).collect()
}

/// An effect at the first input or at its port: its name, and its parameters for a setting.
pub type Acting = (&'static str, fn(&Setting) -> Vec<f64>);

/// Prepares the records of a truss that is simulated exactly, with effects at its first input and 0.2 % of noise.
pub fn prepared(effects: &[Acting]) -> Prepared {
    let library = Library::standard();
    let sim = truss(1);
    let mut case = case(&sim, &sim);
    let model = case.model.clone().unwrap();
    let problem = prepare(&model, &case.records, &Known::default()).unwrap().problem;
    let placed = |(name, of): &Acting| at(&library, name, Place::Input(0), of(&problem.setting));
    let actions = problem.actions(&effects.iter().map(placed).collect::<Vec<_>>());
    for (k, record) in case.records.iter_mut().enumerate() {
        record.y = run(&problem.plant, &actions, record);
        add_noise(&mut record.y, 110 + k as u64, model.noise.sensor_std.as_ref().unwrap());
    }
    prepare(&model, &case.records, &Known::default()).unwrap()
}
