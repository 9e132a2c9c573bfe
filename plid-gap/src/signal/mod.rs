//! Signal processing. These modules use records and the plant, but neither effects nor fits.

pub(crate) mod lines;
pub(crate) mod notch;
pub(crate) mod peaks;
pub(crate) mod quantisation;
pub(crate) mod tones;
