//! The same readers under libFuzzer, which sees what code an input reaches.

use std::sync::{Mutex, OnceLock};

use plid_fuzz::Target;

use crate::{bench, checkpoint, configs, data, fmu, journal, model, prediction, protocol, record, runs, sweep, trial};

/// The readers, each of which calls [`fuzz`].
const READERS: [fn(); 41] = [
    bench::speed_config,
    bench::stability_config,
    bench::expectations_config,
    bench::peers,
    bench::speed_results,
    checkpoint::checkpoint,
    configs::experiment,
    configs::case,
    configs::trial,
    data::csv,
    data::mat,
    data::npy,
    data::npz,
    fmu::archive,
    fmu::model_description,
    journal::stability_journal,
    journal::expectations_journal,
    journal::speed_journal,
    journal::paper_journal,
    journal::study_shard,
    model::model,
    prediction::simulation_with_effects,
    prediction::simulator_with_effects,
    prediction::diagnosis,
    protocol::requests,
    protocol::description,
    protocol::answers,
    record::record,
    record::simulated_record,
    runs::run_model,
    runs::run_result,
    runs::run_manifest,
    runs::run_checkpoint,
    sweep::sweep,
    trial::seal,
    trial::manifest,
    trial::shard,
    trial::answer,
    trial::label,
    trial::drawn,
    trial::seconds,
];

/// The targets that the readers have stated.
static STATED: Mutex<Vec<Target>> = Mutex::new(Vec::new());

/// Notes a target instead of running it.
pub fn fuzz(name: &'static str, memory: u64, executions: u64, read: fn(&[u8]) -> String) {
    STATED.lock().expect("nobody panics while holding it").push(Target { name, read, memory, executions });
}

/// The target that `PLID_FUZZ_TARGET` names.
fn chosen() -> &'static Target {
    static CHOSEN: OnceLock<Target> = OnceLock::new();
    CHOSEN.get_or_init(|| {
        READERS.iter().for_each(|reader| reader());
        let mut stated = STATED.lock().expect("nobody panics while holding it");
        let name = std::env::var("PLID_FUZZ_TARGET").unwrap_or_default();
        let names: Vec<&str> = stated.iter().map(|target| target.name).collect();
        let place = stated.iter().position(|target| target.name == name);
        let place = place.unwrap_or_else(|| panic!("PLID_FUZZ_TARGET is `{name}`, but may be {}", names.join(", ")));
        stated.swap_remove(place)
    })
}

libfuzzer_sys::fuzz_target!(|input: &[u8]| plid_fuzz::check(chosen(), input));
