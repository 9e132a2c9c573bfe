//! Noise-free records determine the system exactly.

use crate::common;

use common::{Data, plant, response_difference};
use nalgebra::{DMatrix, DVector};
use plid_model::Model;
use plid_refine::{Exact, Start, exact, free_run_error};

fn found(truth: &Model, data: &Data, start: Start, feedthrough: bool) -> Option<Exact> {
    exact(&[data.record(start)], 2 * truth.n(), feedthrough, common::RATE).unwrap()
}

#[test]
fn a_plant_is_found_with_its_order_and_its_state() {
    for (odd, feedthrough) in [(false, false), (false, true), (true, true)] {
        let truth = plant(odd, feedthrough);
        let data = Data::new(&truth, 1500, &DVector::from_element(truth.n(), 1.0), 0.0, 11);
        let found = found(&truth, &data, Start::Unknown, feedthrough).unwrap();
        assert_eq!(found.model.n(), truth.n());
        let off = response_difference(&found.model, &truth);
        assert!(off < 1e-8, "odd {odd}, D {feedthrough}: {off:.1e}");
        let left = free_run_error(&found.model, &data.record(Start::Unknown), &found.initial_states[0], 0).unwrap();
        assert!(left < 1e-8, "{left}");
    }
}

#[test]
fn noise_hides_the_order() {
    let truth = plant(false, false);
    let data = Data::new(&truth, 1500, &truth.rest(), 0.01, 12);
    assert!(found(&truth, &data, Start::Rest, false).is_none());
}

/// Two outputs with filters of the same pole. One filter is fast and contributes little to the outputs.
#[test]
fn equal_poles_keep_directions_of_their_own() {
    let a = [[0.05, 0.0, 1.0, 0.0], [0.0, 0.05, 0.0, 1.0], [0.0, 0.0, 0.8, 0.5], [0.0, 0.0, -0.5, 0.8]];
    let a = DMatrix::from_fn(4, 4, |i, j| a[i][j]);
    let b = DMatrix::from_row_slice(4, 2, &[0.0, 0.0, 0.0, 0.0, 1.0, 0.3, -0.2, 1.0]);
    let c = DMatrix::from_row_slice(2, 4, &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    let truth = Model::new(common::RATE, a, b, c, DMatrix::zeros(2, 2)).unwrap();
    let data = Data::new(&truth, 800, &truth.rest(), 0.0, 17);
    let found = found(&truth, &data, Start::Rest, true).unwrap();
    assert!(response_difference(&found.model, &truth) < 1e-8);
    // A less the pole has two null directions.
    let shifted = found.model.a - DMatrix::identity(4, 4) * 0.05;
    let mut singular: Vec<f64> = shifted.singular_values().iter().copied().collect();
    singular.sort_by(f64::total_cmp);
    assert!(singular[1] < 1e-6 && singular[2] > 1e-2, "{singular:?}");
}
