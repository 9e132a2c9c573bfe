//! Settings of the preparation of a problem from a case.

use super::group::group;

group! {
    /// The preparation: noise, its level, lines and forces in a band.
    PrepareSettings {
        /// Shortest record without input, and shortest period, from which the noise is estimated.
        shortest_quiet: usize = 512, "samples", 16.0..=1e9;
        /// Standard deviation of a sensor's noise, over the RMS of its output, if the simulation declares none.
        undeclared_noise: f64 = 0.01, "1", 1e-9..=1.0;
        /// Smallest number of whitened values of quiet records and of driven ones for which their noise powers are
        /// compared.
        level_values: f64 = 1000.0, "values", 1.0..=1e9;
        /// Excess of the noise power in driven records over that in quiet ones above which a random disturbance acts in
        /// the driven records alone. The noise model is fitted to the quiet records.
        louder: f64 = 0.1, "1", 0.0..=1e6;
        /// The same excess in standard deviations of the difference between the two noise levels. A normal variable
        /// exceeds five of them once in 3.5 million draws.
        louder_deviations: f64 = 5.0, "std", 0.0..=1e6;
        /// Factor on the statistical uncertainty of a noise level. It allows for errors in the shape of the noise
        /// model.
        level_allowance: f64 = 1.1, "1", 1.0..=1e3;
        /// Relative uncertainty of a noise power that is only declared, or that grows with the level of the input. A
        /// power that is estimated from so few values that it is less certain is not used.
        declared_uncertainty: f64 = 0.3, "1", 1e-6..=1e3;
        /// Relative uncertainty of the noise level if the noise is the rounding by a coarse converter. Its variance of
        /// q^2 / 12 holds for a signal that spans many steps.
        rounded_uncertainty: f64 = 0.05, "1", 1e-6..=1e3;
        /// Relative change of the noise RMS of an output above which residuals are whitened again.
        renewed: f64 = 0.05, "1", 0.0..=1e3;
        /// Largest number of lines in the residual that are offered to effects.
        tones: usize = 4, "lines", 0.0..=100.0;
        /// Distance of a line from a resonance, in widths of the resonance or of the frequency resolution, above which
        /// the line is not the resonance.
        apart_widths: f64 = 2.0, "1", 0.0..=1e3;
        /// Relative difference within which a frequency is that of a known line. Bands are tried in steps of 6 %.
        near_line: f64 = 0.04, "1", 0.0..=1.0;
        /// Lowest centre frequency of a random force in a band.
        lowest_band_hz: f64 = 15.0, "Hz", 1e-6..=1e9;
        /// Smallest share that such a band must explain of the part that a free force on every mode explains.
        band_share: f64 = 0.6, "1", 0.0..=1.0;
        /// Gain of a separate phase in each record above which a line has a random phase. By chance, the two parameters
        /// of each record gain two.
        random_phase_gain: f64 = 100.0, "2 ln L", 0.0..=1e9;
        /// Largest share of that gain that a common phase of all records may reach.
        common_phase_share: f64 = 0.9, "1", 0.0..=1.0;
        /// Smallest amplitude of a line in a record, over its amplitude in the record where it is largest. A
        /// disturbance does not depend on the inputs.
        steady_line: f64 = 0.5, "1", 0.0..=1.0;
    }
}
