//! The state of an interrupted recursion, which is continued.

use ndarray::Array2;
use plid_catalogue::Variant;
use plid_core::{NoiseModel, ObservableForm, Settings};
use plid_identify::{Ending, Paused, Plan, Samples, run};

use crate::{fuzz, json, words};

/// Samples of the record.
const SAMPLES: usize = 12;

/// A plan of two passes over one small record.
fn plan() -> Plan {
    let form = ObservableForm::new(&[2], 1).unwrap();
    Plan {
        noise: NoiseModel::diagonal(&[1e-2], &[1e-4], &[1e-6; 2]),
        settings: Settings::of_unique_form(&form, 1.0, 1.0),
        form,
        variant: Variant::default(),
        passes: 2,
    }
}

fn record() -> [Array2<f64>; 2] {
    let inputs = Array2::from_shape_fn((SAMPLES, 1), |(k, _)| if k % 3 == 0 { 1.0 } else { -0.5 });
    let outputs = Array2::from_shape_fn((SAMPLES, 1), |(k, _)| (0.7 * k as f64).sin());
    [inputs, outputs]
}

/// Continues an interrupted run, up to an interruption after `until` samples.
fn continued(paused: Option<&Paused>, until: usize) -> Result<Ending, plid_identify::IdentifyError> {
    let [inputs, outputs] = record();
    let samples = Samples { inputs: inputs.view(), outputs: outputs.view(), nan_is_missing: false };
    run(&plan(), &[samples], paused, &mut |done, _| done < until)
}

#[cfg_attr(test, test)]
pub fn checkpoint() {
    fuzz("checkpoint", 1000, 5000, |bytes| {
        let paused: Paused = match json(bytes) {
            Ok(paused) => paused,
            Err(error) => return error.to_string(),
        };
        words(continued(Some(&paused), usize::MAX))
    });
}

/// The corpus holds what an interrupted run writes, and continuing from it gives the uninterrupted run.
#[test]
fn the_corpus_is_a_checkpoint() {
    let Ending::Paused(paused) = continued(None, 17).unwrap() else { panic!("not interrupted") };
    let text = serde_json::to_string(&paused).unwrap();
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus/checkpoint/paused.json");
    assert_eq!(std::fs::read_to_string(file).unwrap_or_default().trim(), text, "write this into the corpus");
    let parameters = |paused| match continued(paused, usize::MAX) {
        Ok(Ending::Done(run)) => run.identified.parameters(&plan().form),
        other => panic!("{other:?}"),
    };
    assert_eq!(parameters(None), parameters(Some(&paused)));
}
