//! Settings of the noise model.

use super::group::group;

group! {
    /// The noise model.
    NoiseSettings {
        /// Power of a frequency bin over that of the model above which the bin contains a line rather than noise. The
        /// probability of more by chance is e^-16.
        line_power: f64 = 16.0, "1", 1.0..=1e9;
        /// Power of a sensor's slow noise at low frequencies, over that of its white noise, above which the slow noise
        /// is a part of the noise model.
        slow_power: f64 = 0.25, "1", 0.0..=1e9;
        /// Gain in log likelihood above which slow sensor noise is a part of the noise model.
        slow_gain: f64 = 15.0, "ln L", 0.0..=1e9;
        /// Factor in frequency about the centre of a force in a band within which bins determine the band. Further
        /// away, the shape of its spectrum is unknown.
        band_range: f64 = 1.4, "1", 1.0..=100.0;
        /// Prior standard deviation of the exponent with which the band's spectrum varies with frequency, with mean
        /// zero. The exponents of a band-pass and a resonator differ by one.
        band_slope_std: f64 = 1.0, "1", 1e-6..=1e6;
        /// Relative shift of a band's centre above which a maximum of the likelihood belongs to another band.
        band_shift: f64 = 0.15, "1", 0.0..=1.0;
    }
}
