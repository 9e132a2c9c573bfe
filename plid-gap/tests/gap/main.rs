//! Simulations and located gaps of plid-gap, compared with results that share no code with it; the order of its
//! modules, and the chapters of its settings and its effects.

mod carried;
mod forward;
mod matrices;
mod order;
mod settings;
#[path = "../../src/testing/truss.rs"]
mod truss;
mod truth;
mod vocabulary;
mod where_maps;
