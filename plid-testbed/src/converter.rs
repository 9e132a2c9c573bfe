//! A converter, which rounds to codes and clips.

/// A DAC or ADC.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Converter {
    /// Size of a code, V; 0 leaves values unrounded.
    pub step_v: f64,
    /// Largest magnitude, V.
    pub range_v: f64,
}

impl Converter {
    /// Returns the converted value, and whether it was clipped.
    #[must_use]
    pub fn convert(&self, value: f64) -> (f64, bool) {
        let clipped = value.clamp(-self.range_v, self.range_v);
        let coded = if self.step_v > 0.0 {
            // The last whole code within the range, if the range is not a whole number of codes.
            let most = (self.range_v / self.step_v * (1.0 + 1e-12)).floor();
            (clipped / self.step_v).round().clamp(-most, most) * self.step_v
        } else {
            clipped
        };
        (coded, clipped != value)
    }

    /// Returns the standard deviation of the rounding error, V: that of a uniform distribution over a code.
    #[must_use]
    pub fn rounding_std(&self) -> f64 {
        self.step_v / 12.0_f64.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_to_the_nearest_code_and_clips() {
        let adc = Converter { step_v: 0.0025, range_v: 5.0 };
        assert_eq!(adc.convert(0.0012), (0.0, false));
        assert_eq!(adc.convert(0.0013), (0.0025, false));
        assert_eq!(adc.convert(-0.0013), (-0.0025, false));
        assert_eq!(adc.convert(5.0), (5.0, false));
        assert_eq!(adc.convert(7.0), (5.0, true));
        assert_eq!(adc.convert(-5.1), (-5.0, true));
        let coarse = Converter { step_v: 0.3, range_v: 1.0 };
        assert!((coarse.convert(1.0).0 - 0.9).abs() < 1e-12);
    }

    #[test]
    fn without_steps_and_range_values_pass() {
        let ideal = Converter { step_v: 0.0, range_v: f64::INFINITY };
        assert_eq!(ideal.convert(123.456), (123.456, false));
        assert_eq!(ideal.rounding_std(), 0.0);
    }
}
