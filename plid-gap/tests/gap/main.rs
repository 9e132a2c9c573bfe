//! Simulations and located gaps of plid-gap, compared with results that share no code with it; the order of its
//! modules, and the chapter of its settings.

mod carried;
mod forward;
mod matrices;
mod order;
mod settings;
#[path = "../../src/testing/truss.rs"]
mod truss;
mod truth;
mod where_maps;
