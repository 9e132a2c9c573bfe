//! The subspace estimate on plants with known parameters.

use crate::common;

use common::{Data, options, plant, response_difference};
use nalgebra::DVector;
use ndarray::s;
use plid_model::stability;
use plid_refine::{RefineError, Start, free_run_error, subspace};

#[test]
fn an_exact_plant_is_found() {
    for (odd, feedthrough) in [(false, false), (false, true), (true, true)] {
        let truth = plant(odd, feedthrough);
        let state = DVector::from_element(truth.n(), 1.0);
        let data = Data::new(&truth, 1000, &state, 0.0, 11);
        let records = [data.record(Start::Unknown)];
        let found = subspace(&records, truth.n(), None, common::RATE, &options(feedthrough)).unwrap();
        let off = response_difference(&found.model, &truth);
        assert!(off < 1e-8, "odd {odd}, D {feedthrough}: {off:.1e}");
        // The gap among the singular values indicates the order.
        let values = &found.singular_values;
        assert!(values[truth.n()] < 1e-8 * values[truth.n() - 1], "{values:?}");
        let left = free_run_error(&found.model, &records[0], &found.initial_states[0], 0).unwrap();
        assert!(left < 1e-8, "{left}");
    }
}

/// The outputs of a simulator have no noise: beyond the order of the system A consists of rounding errors, and the
/// eigenvalue iteration must still terminate.
#[test]
fn more_states_than_an_exact_plant_has_do_no_harm() {
    for seed in 0..5 {
        let truth = plant(false, false);
        let data = Data::new(&truth, 1500, &truth.rest(), 0.0, 30 + seed);
        let records = [data.record(Start::Rest)];
        let found = subspace(&records, 24, Some(20), common::RATE, &options(true)).unwrap();
        let left = free_run_error(&found.model, &records[0], &found.initial_states[0], 0).unwrap();
        assert!(left < 1e-3, "{left}");
    }
}

#[test]
fn records_and_gaps_are_put_together() {
    let truth = plant(false, false);
    let mut first = Data::new(&truth, 700, &DVector::from_element(6, 2.0), 0.0, 12);
    first.outputs.slice_mut(s![300..303, 1]).fill(f64::NAN);
    let second = Data::new(&truth, 500, &truth.rest(), 0.0, 13);
    let records = [first.record(Start::Unknown), second.record(Start::Rest)];
    let found = subspace(&records, 6, Some(12), common::RATE, &options(false)).unwrap();
    assert!(response_difference(&found.model, &truth) < 1e-8);
    assert_eq!(found.initial_states[1], DVector::zeros(6));
}

#[test]
fn an_estimate_of_noise_is_stable() {
    // With too many states and much noise, some poles are unstable and must be corrected.
    let truth = plant(false, false);
    let mut mirrored = 0;
    for seed in 0..10 {
        let data = Data::new(&truth, 500, &truth.rest(), 3.0, 50 + seed);
        let records = [data.record(Start::Unknown)];
        let found = subspace(&records, 24, Some(20), common::RATE, &options(true)).unwrap();
        mirrored += found.mirrored;
        assert!(stability(&found.model).unwrap().spectral_radius <= 0.999);
        assert!(free_run_error(&found.model, &records[0], &found.initial_states[0], 0).unwrap() < 1.0);
    }
    assert!(mirrored > 0, "no estimate was unstable, so nothing was mended");
}

#[test]
fn what_cannot_be_done_is_a_typed_error() {
    let truth = plant(false, false);
    let data = Data::new(&truth, 100, &truth.rest(), 0.0, 14);
    let records = [data.record(Start::Unknown)];
    let run = |states, horizon| subspace(&records, states, horizon, common::RATE, &options(false)).map(|_| ());
    // 2 x 20 samples of 4 channels: 160 windows are needed, there are 61.
    let few = run(6, Some(20));
    assert!(matches!(few, Err(RefineError::TooLittleData { needed: 160, available: 61, .. })), "{few:?}");
    assert!(matches!(run(6, Some(2)), Err(RefineError::Setting { setting: "horizon", .. })));
    assert!(matches!(run(0, None), Err(RefineError::Setting { setting: "states", .. })));
}
