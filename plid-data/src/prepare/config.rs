//! The keys of an experiment that concern preparation.
use super::repeats::Repeats;
use super::scaling::Scaling;
use super::trend::Trend;
use serde::{Deserialize, Serialize};

/// The steps that records go through, in the order of [`super::prepare`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Preparation {
    /// Average repeats of one input. Without it there is no averaging.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repeats: Option<Repeats>,
    /// Decimate to this rate in Hz, an integer fraction of the data's rate. Without it there is no decimation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decimate_to_hz: Option<f64>,
    /// The trend that is removed from every channel: `none`, `mean` (the default) or `linear`.
    pub trend: Trend,
    /// Replace u_k by u_{k+1}: `"auto"` (the default, decided by a test), 0 (no) or 1 (yes).
    pub advance: Advance,
    /// The divisor of every channel: `rms` (the default) or `none`.
    pub scaling: Scaling,
}

impl Preparation {
    /// Returns the key of a requested step that is not possible for a record that is read in blocks.
    pub fn not_in_blocks(&self) -> Option<&'static str> {
        let steps = [
            ("repeats", self.repeats.is_some()),
            ("decimate_to_hz", self.decimate_to_hz.is_some()),
            ("trend = \"linear\"", self.trend == Trend::Linear),
        ];
        steps.into_iter().find(|(_, is_wanted)| *is_wanted).map(|(key, _)| key)
    }
}

/// The number of samples by which the input is advanced.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "AdvanceWord", into = "AdvanceWord")]
pub enum Advance {
    /// One if the test finds direct feedthrough, and otherwise none.
    #[default]
    Auto,
    /// None.
    No,
    /// One.
    Yes,
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum AdvanceWord {
    Samples(i64),
    Word(String),
}

impl TryFrom<AdvanceWord> for Advance {
    type Error = String;

    fn try_from(word: AdvanceWord) -> Result<Self, String> {
        match word {
            AdvanceWord::Samples(0) => Ok(Self::No),
            AdvanceWord::Samples(1) => Ok(Self::Yes),
            AdvanceWord::Word(word) if word == "auto" => Ok(Self::Auto),
            AdvanceWord::Samples(n) => Err(format!("advance is \"auto\", 0 or 1, not {n}")),
            AdvanceWord::Word(w) => Err(format!("advance is \"auto\", 0 or 1, not \"{w}\"")),
        }
    }
}

impl From<Advance> for AdvanceWord {
    fn from(advance: Advance) -> Self {
        match advance {
            Advance::Auto => Self::Word("auto".into()),
            Advance::No => Self::Samples(0),
            Advance::Yes => Self::Samples(1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_is_read_and_written_alike() {
        let text = "decimate_to_hz = 50.0\ntrend = \"linear\"\nadvance = 1\nscaling = \"rms\"\n\n[repeats]\nperiod = \
            8192\nskip = 1\n";
        let read: Preparation = toml::from_str(text).unwrap();
        assert_eq!(read.advance, Advance::Yes);
        assert_eq!(read.repeats.as_ref().unwrap().tolerance, 0.01);
        let written = toml::to_string(&read).unwrap();
        assert_eq!(toml::from_str::<Preparation>(&written).unwrap(), read);
        let none: Preparation = toml::from_str("").unwrap();
        assert_eq!(none, Preparation::default());
        let written = toml::to_string(&none).unwrap();
        assert_eq!(toml::from_str::<Preparation>(&written).unwrap(), none);
    }

    #[test]
    fn unknown_keys_and_words_are_errors() {
        for (text, said) in [
            ("decimate = 50", "unknown field `decimate`"),
            ("advance = 2", "advance is \"auto\", 0 or 1, not 2"),
            ("advance = \"yes\"", "not \"yes\""),
            ("trend = \"means\"", "unknown variant `means`"),
            ("[repeats]\nperiods = 4", "unknown field `periods`"),
        ] {
            let error = toml::from_str::<Preparation>(text).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
