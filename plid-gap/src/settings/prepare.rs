//! Settings of the preparation of a problem from a case.

use super::group::group;

group! {
    /// The preparation: noise, its level, lines and forces in a band.
    PrepareSettings {
        /// Shortest record without input, and shortest period, from which the noise is estimated.
        shortest_quiet: usize = 512, "samples", 16.0..=1e9;
        /// Noise of a sensor where the simulation declares none, over the RMS of its output.
        undeclared_noise: f64 = 0.01, "1", 1e-9..=1.0;
        /// Whitened values from which their mean square gives the noise level.
        level_values: f64 = 1000.0, "values", 1.0..=1e9;
        /// Excess of the noise of driven records over that of quiet ones from which something random acts in driven
        /// records. The noise model is fitted to the quiet ones.
        louder: f64 = 0.1, "1", 0.0..=1e6;
        /// The same excess in standard deviations of the difference of the two noise levels: a normal variable exceeds
        /// five of them once in 3.5 million draws.
        louder_deviations: f64 = 5.0, "std", 0.0..=1e6;
        /// Factor on the statistical uncertainty of a noise level. It allows for errors in the shape of the noise
        /// model.
        level_allowance: f64 = 1.1, "1", 1.0..=1e3;
        /// Relative uncertainty of a noise level that is only declared, or grows with the level of the input.
        declared_uncertainty: f64 = 0.3, "1", 1e-6..=1e3;
        /// Relative uncertainty of the noise level where rounding by a coarse converter is the noise: q^2 / 12 holds
        /// for a signal of many steps.
        rounded_uncertainty: f64 = 0.05, "1", 1e-6..=1e3;
        /// Relative change of the noise RMS of an output from which residuals are whitened again.
        renewed: f64 = 0.05, "1", 0.0..=1e3;
        /// Lines in the residual that are offered to effects.
        tones: usize = 4, "lines", 0.0..=100.0;
        /// Distance of a line from a resonance, in widths of the resonance or of the resolution, from which the line is
        /// not the resonance.
        apart_widths: f64 = 2.0, "1", 0.0..=1e3;
        /// Relative distance within which a frequency is that of a known line: bands are tried in steps of 6 %.
        near_line: f64 = 0.04, "1", 0.0..=1.0;
        /// Lowest centre frequency of a random force in a band.
        lowest_band_hz: f64 = 15.0, "Hz", 1e-6..=1e9;
        /// Least share, of what a free force on every mode explains, that such a band must explain.
        band_share: f64 = 0.6, "1", 0.0..=1.0;
        /// Gain of a separate phase in each record from which a line has a random phase: two parameters per record gain
        /// two each by chance.
        random_phase_gain: f64 = 100.0, "2 ln L", 0.0..=1e9;
        /// Largest share of that gain that one phase for all records may reach.
        common_phase_share: f64 = 0.9, "1", 0.0..=1.0;
        /// Least amplitude of a line in a record, over that in the record where it is largest. A disturbance does not
        /// depend on the inputs.
        steady_line: f64 = 0.5, "1", 0.0..=1.0;
    }
}
