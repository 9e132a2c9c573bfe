//! What plid-gap simulates and where it sees a gap, against answers that share no code with it.

mod carried;
mod forward;
#[path = "../../src/testing/truss.rs"]
mod truss;
mod truth;
mod where_maps;
