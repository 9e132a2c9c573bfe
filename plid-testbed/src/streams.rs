//! Random numbers: one ChaCha12 stream per purpose, so that turning one source off leaves the others unchanged.

use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;

/// The purpose of a stream. The numbers are part of the meaning of a seed: never change them.
#[derive(Clone, Copy)]
pub(crate) enum Purpose {
    /// The command; indexed by input.
    Input = 1,
    /// Amplifier noise; indexed by repeat, as are the next three.
    Amplifier = 2,
    /// Ambient force during a record.
    Ambient = 3,
    /// Motion at the start of a record, due to the ambient force before it.
    Start = 4,
    /// Sensor noise.
    Sensor = 5,
    /// The random part of an effect; indexed by repeat and effect.
    Effect = 6,
    /// The plant, the nominal model and the effects of a gap case.
    Draw = 7,
    /// The commands of a gap case; indexed by record and input.
    Excitation = 8,
    /// The coloured part of sensor noise; indexed by repeat, as is the next.
    ColouredNoise = 9,
    /// The heavy-tailed part of sensor noise.
    HeavyNoise = 10,
}

/// Returns the stream of one purpose and index, such as an input or a repeat.
pub(crate) fn stream(seed: u64, purpose: Purpose, index: usize) -> ChaCha12Rng {
    let mut rng = ChaCha12Rng::seed_from_u64(seed);
    rng.set_stream(((purpose as u64) << 32) | index as u64);
    rng
}
