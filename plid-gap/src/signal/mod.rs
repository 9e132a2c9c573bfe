//! Signal processing that knows records and the plant, but no effect and no fit.

pub(crate) mod notch;
pub(crate) mod peaks;
pub(crate) mod quantisation;
pub(crate) mod tones;
