//! sim-with-effect.json, which is read for a prediction with or without a simulator, and diagnosis.json.

use std::path::Path;

use plid_gap::answer::predict::Predictor;
use plid_gap::answer::schema::{Diagnosis, SimulationWithEffects};
use plid_gap::effects::Library;
use plid_gap::in_loop::{LoopPredictor, SimulatorWithEffects};

use crate::protocol::simulator;
use crate::{fuzz, json, words};

/// Samples that are predicted.
const SAMPLES: usize = 24;

/// Number of inputs of a file that is predicted, so that an execution stays short.
const INPUTS: usize = 4;

/// What such a file says at its most is a delay of a million samples.
#[cfg_attr(test, test)]
pub fn simulation_with_effects() {
    fuzz("sim-with-effect", 100_000, 2000, |bytes| {
        let written: SimulationWithEffects = match json(bytes) {
            Ok(written) => written,
            Err(error) => return error.to_string(),
        };
        let library = Library::standard();
        let predictor = match Predictor::new(written, &library, Path::new("x.json")) {
            Ok(predictor) => predictor,
            Err(error) => return error.to_string(),
        };
        if predictor.inputs.len().max(predictor.model.inputs.len()) > INPUTS {
            return "many inputs".into();
        }
        let u: Vec<f64> = (0..SAMPLES).map(|k| if k % 5 < 2 { 1.0 } else { -0.5 }).collect();
        let predicted = predictor.predict(&vec![u; predictor.inputs.len()], predictor.t0);
        if let Ok(prediction) = &predicted {
            assert!(prediction.outputs.iter().flatten().all(|y| y.is_finite()), "an output that is not finite");
            let gap = predictor.expected_gap(prediction, &prediction.outputs);
            assert!(gap.is_none_or(f64::is_finite));
        }
        words(predicted)
    });
}

/// Such a file belongs to a simulator with one input. It, too, may contain a delay of a million samples.
#[cfg_attr(test, test)]
pub fn simulator_with_effects() {
    fuzz("simulator-with-effects", 100_000, 2000, |bytes| {
        let written: SimulatorWithEffects = match json(bytes) {
            Ok(written) => written,
            Err(error) => return error.to_string(),
        };
        let library = Library::standard();
        let predictor = match LoopPredictor::new(written, &library) {
            Ok(predictor) => predictor,
            Err(message) => return message,
        };
        let u: Vec<f64> = (0..SAMPLES).map(|k| if k % 5 < 2 { 1.0 } else { -0.5 }).collect();
        let t0 = predictor.written.t0;
        let predicted = predictor.predict(&mut simulator(), &[u], t0);
        if let Ok(prediction) = &predicted {
            assert!(prediction.outputs.iter().flatten().all(|y| y.is_finite()), "an output that is not finite");
            assert!(predictor.expected_gap(prediction).is_none_or(f64::is_finite));
        }
        words(predicted)
    });
}

#[cfg_attr(test, test)]
pub fn diagnosis() {
    fuzz("diagnosis", 1000, 5000, |bytes| {
        let read = json::<Diagnosis>(bytes);
        if let Ok(diagnosis) = &read {
            let _ = diagnosis.text();
        }
        words(read)
    });
}
