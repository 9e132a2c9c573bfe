//! Mains hum: a sine with harmonics, whose phase runs on through the records.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use rand::RngExt;
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, not_negative, positive, within};
use crate::effects::chain::{Chain, Site};
use crate::effects::family::Halves;
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// y' = y + a sin(2 pi f t + phi) + its harmonics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MainsHum {
    /// The output.
    pub at: Output,
    /// a, V; positive.
    pub amplitude_v: f64,
    /// f, Hz; near 50 or 60.
    pub frequency_hz: f64,
    /// phi, rad.
    #[serde(default)]
    pub phase_rad: f64,
    /// Harmonics in addition to the fundamental.
    #[serde(default)]
    pub harmonics: Vec<Harmonic>,
}

/// One harmonic of the hum.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Harmonic {
    /// The multiple of f; 2 or more.
    pub multiple: u32,
    /// Amplitude, V.
    pub amplitude_v: f64,
    /// Phase, rad.
    pub phase_rad: f64,
}

impl Law for MainsHum {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("amplitude_v", self.amplitude_v)?;
        positive("frequency_hz", self.frequency_hz)?;
        finite("phase_rad", self.phase_rad)?;
        self.harmonics.iter().try_for_each(|h| {
            within("harmonics.multiple", h.multiple as usize, 2, HIGHEST)?;
            not_negative("harmonics.amplitude_v", h.amplitude_v)?;
            finite("harmonics.phase_rad", h.phase_rad)
        })
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let mut lines = vec![(self.frequency_hz, self.amplitude_v, self.phase_rad)];
        lines.extend(
            self.harmonics.iter().map(|h| (f64::from(h.multiple) * self.frequency_hz, h.amplitude_v, h.phase_rad)),
        );
        let hum = move |t: f64| -> f64 { lines.iter().map(|(f, a, phase)| a * (2.0 * PI * f * t + phase).sin()).sum() };
        chain.change_output(self.at.0, move |y, t| y + hum(t));
    }

    fn strengthen(&mut self, factor: f64) {
        self.amplitude_v *= factor;
        self.harmonics.iter_mut().for_each(|h| h.amplitude_v *= factor);
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.amplitude_v, self.frequency_hz, self.phase_rad]
    }

    fn own_equation(&self) -> bool {
        self.harmonics.iter().all(|h| FIXED.iter().any(|(multiple, _)| h.multiple == *multiple))
    }
}

/// The highest multiple of a harmonic, far above those that mains have.
const HIGHEST: usize = 1000;

/// Multiples of the frequency that are drawn as harmonics. Rectifiers cause 5, 7, 11 and 13, transformers that
/// saturate cause 3 and 9, and loads that differ between the two halves of a period cause the even ones.
const MULTIPLES: Halves<u32> = Halves { development: &[2, 3, 5, 9], reported: &[4, 6, 7, 11, 13] };
/// Usual amplitude of such a harmonic, relative to that of the fundamental.
const SHARE: Range<f64> = 0.1..0.3;
/// Largest number of harmonics that are drawn from these multiples.
const MOST: usize = 3;
/// The harmonics if none are drawn, with their usual shares. The vocabulary has these multiples only.
const FIXED: [(u32, f64); 3] = [(2, 0.1), (3, 0.3), (5, 0.15)];

/// Returns the multiples of a hum's harmonics, each with its usual share.
fn usual_harmonics(draw: &mut Draw<'_>) -> Vec<(u32, f64)> {
    let mut multiples = draw.families.of(&MULTIPLES);
    if multiples.is_empty() {
        return FIXED.to_vec();
    }
    multiples.shuffle(draw.rng);
    multiples.truncate(draw.rng.random_range(1..=MOST));
    multiples.into_iter().map(|multiple| (multiple, draw.within(SHARE))).collect()
}

impl Described for MainsHum {
    const FAMILY: Family = Family::AddedBySensor;
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure];
    const PARAMETERS: &'static [&'static str] = &["a", "f", "phi"];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        let frequency_hz = if draw.sign > 0.0 { 50.0 } else { 60.0 } + draw.within(-0.05..0.05);
        let harmonics = usual_harmonics(draw).into_iter().map(|(multiple, share)| {
            let amplitude_v = 0.03 * share * draw.within(0.5..1.5);
            json!({ "multiple": multiple, "amplitude_v": amplitude_v, "phase_rad": draw.within(0.0..TAU) })
        });
        let harmonics: Vec<Value> = harmonics.collect();
        json!({
            "amplitude_v": 0.03,
            "frequency_hz": frequency_hz,
            "phase_rad": draw.within(0.0..TAU),
            "harmonics": harmonics,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_harmonic_is_in_both_halves_and_those_of_the_vocabulary_are_in_one() {
        let Halves { development, reported } = MULTIPLES;
        assert!(development.iter().all(|multiple| *multiple >= 2 && !reported.contains(multiple)));
        assert!(FIXED.iter().all(|(multiple, _)| development.contains(multiple)));
    }

    /// The fundamental is no harmonic of its own, and neither is a constant.
    #[test]
    fn a_harmonic_is_a_multiple_from_two_on() {
        let limits = Limits { sample_rate_hz: 1600.0, end_s: 4.0, modes: 10 };
        let check = |multiple| {
            let harmonics = vec![Harmonic { multiple, amplitude_v: 0.01, phase_rad: 0.0 }];
            let hum = MainsHum { at: Output(0), amplitude_v: 0.03, frequency_hz: 50.0, phase_rad: 0.0, harmonics };
            hum.check(&limits)
        };
        for value in [0, 1] {
            let wrong = TestbedError::OutOfRange { key: "harmonics.multiple", value, least: 2, most: HIGHEST };
            assert_eq!(check(value as u32), Err(wrong));
        }
        assert_eq!(check(2), Ok(()));
    }
}
