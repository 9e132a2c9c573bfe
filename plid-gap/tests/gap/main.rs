//! Simulations and located gaps of plid-gap, compared with results that share no code with it.

mod carried;
mod forward;
mod matrices;
#[path = "../../src/testing/truss.rs"]
mod truss;
mod truth;
mod where_maps;
