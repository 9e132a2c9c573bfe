//! The messages to a simulator, and its description.

use plid_model::Model;
use plid_simulator::{Description, Linear, serve};

use crate::{fuzz, require_same, words};

fn simulator() -> Linear {
    let value = include_str!("../../corpus/model/port.json");
    let model = Model::from_json(&serde_json::from_str(value).unwrap(), "port.json").unwrap();
    Linear::new(&model, "linear", 2).unwrap()
}

#[test]
fn requests() {
    fuzz("requests", 1000, 20_000, |bytes| {
        let mut answers = Vec::new();
        let served = serve(&mut simulator(), bytes, &mut answers);
        let refusals = answers.split(|&byte| byte == b'\n').filter(|line| line.starts_with(b"{\"error\"")).count();
        format!("{} with {} refusals", words(served), "i".repeat(refusals.min(3)))
    });
}

#[test]
fn description() {
    fuzz("description", 1000, 10_000, |bytes| {
        let read = serde_json::from_slice::<Description>(bytes);
        if let Ok(description) = &read {
            let text = serde_json::to_string(description).unwrap();
            require_same(description, &text, serde_json::from_str(&text));
            return words(description.check());
        }
        words(read)
    });
}
