//! A step allocates nothing, with all outputs or with some missing, with a noise model given per step or not.

use crate::case::{Options, random_case};
use crate::run::{Variant, take};
use plid_core::kernels::Kernels;

/// The first steps are not counted: a library may set up thread-local buffers.
const WARM_UP: usize = 3;

pub fn a_step_allocates_nothing<S: Kernels>(variant: &Variant<S>) {
    let options = Options { steps: 40, missing: 0.1, noise_models: 2, ..Options::default() };
    // Large enough that every library's own product is used.
    let case = random_case(&[7, 6, 5], 2, options, 21);
    let mut run = variant.on(&case);
    for k in 0..case.z.len() {
        let count = allocation_counter::measure(|| take(&mut run, &case, k).unwrap()).count_total;
        assert!(k < WARM_UP || count == 0, "{}: {count} allocations in step {k}", variant.label());
    }
}
