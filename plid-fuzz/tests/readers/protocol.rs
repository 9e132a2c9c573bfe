//! The messages to a simulator, its answers, and its description.

use std::time::Duration;

use plid_model::Model;
use plid_simulator::{Command, Description, Linear, Motion, Simulator, SimulatorError, serve};

use crate::{fuzz, json, with_folder, words};

pub fn simulator() -> Linear {
    let value = include_str!("../../corpus/model/port.json");
    let model = Model::from_json(&serde_json::from_str(value).unwrap(), "port.json").unwrap();
    Linear::new(&model, "linear", 2).unwrap()
}

#[cfg_attr(test, test)]
pub fn requests() {
    fuzz("requests", 1000, 20_000, |bytes| {
        let mut answers = Vec::new();
        let served = serve(&mut simulator(), bytes, &mut answers);
        let refusals = answers.split(|&byte| byte == b'\n').filter(|line| line.starts_with(b"{\"error\"")).count();
        format!("{} with {} refusals", words(served), "i".repeat(refusals.min(3)))
    });
}

#[cfg_attr(test, test)]
pub fn description() {
    fuzz("description", 1000, 10_000, |bytes| match json::<Description>(bytes) {
        Ok(description) => words(description.check()),
        refused => words(refused),
    });
}

/// Asks a simulator for everything that the protocol has.
fn ask(simulator: &mut Command) -> Result<(), SimulatorError> {
    let (m, p, q) = {
        let description = simulator.description();
        (description.inputs.len(), description.outputs.len(), description.ports.len())
    };
    let parameters = simulator.description().values();
    let y = simulator.run(&parameters, &vec![vec![1.0; 3]; m])?;
    assert!(y.len() == p && y.iter().all(|y| y.len() == 3));
    assert_eq!(simulator.start(&parameters)?.len(), q);
    let mut motions = vec![Motion { displacement: 0.0, velocity: 0.0 }; q];
    simulator.step(&vec![0.0; m], &vec![0.0; q], &mut vec![0.0; p], &mut motions)?;
    simulator.save(0)?;
    assert_eq!(simulator.restore(0)?.len(), q);
    Ok(())
}

/// A program that answers whatever it is asked with these bytes, and ends.
#[cfg(unix)]
#[cfg_attr(test, test)]
pub fn answers() {
    fuzz("answers", 5000, 300, |bytes| {
        with_folder(|folder| {
            std::fs::write(folder.join("answers"), bytes).unwrap();
            let command = ["cat", "answers"].map(str::to_owned);
            let started = Command::start(&command, folder, Duration::from_secs(5));
            words(started.and_then(|mut simulator| ask(&mut simulator)))
        })
    });
}
