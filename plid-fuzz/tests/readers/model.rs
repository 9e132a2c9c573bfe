//! model.json.

use plid_model::Model;

use crate::{fuzz, require_same, words};

#[cfg_attr(test, test)]
pub fn model() {
    fuzz("model", 1000, 10_000, |bytes| {
        let value = match serde_json::from_slice(bytes) {
            Ok(value) => value,
            Err(error) => return error.to_string(),
        };
        let read = Model::from_json(&value, "x.json");
        if let Ok(model) = &read {
            let written = model.to_json();
            require_same(model, &written.to_string(), Model::from_json(&written, "again.json"));
        }
        words(read)
    });
}
