//! A step allocates nothing, whether or not outputs are missing, and whether or not a noise model is given per step.

use crate::case::{Options, random_case};
use crate::run::{Variant, take};
use plid_core::kernels::Kernels;

/// Number of first steps that are not counted, because a library may set up thread-local buffers.
const WARM_UP: usize = 3;

pub fn a_step_allocates_nothing<S: Kernels>(variant: &Variant<S>) {
    let options = Options { steps: 40, missing: 0.1, noise_models: 2, ..Options::default() };
    // The case is large enough for every library to use its own product.
    let case = random_case(&[7, 6, 5], 2, options, 21);
    let mut run = variant.on(&case);
    for k in 0..case.z.len() {
        let count = allocation_counter::measure(|| take(&mut run, &case, k).unwrap()).count_total;
        assert!(k < WARM_UP || count == 0, "{}: {count} allocations in step {k}", variant.label());
    }
}
