//! What plid-gap simulates and where it sees a gap, against answers that share no code with it.

mod forward;
mod truth;
#[path = "../../src/truss.rs"]
mod truss;
mod where_maps;
