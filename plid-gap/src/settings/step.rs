//! Steps of the diagnosis that can be switched off, one at a time, to see what each is worth. Nothing else is: an answer with a step off is for
//! comparison only.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A step that can be off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Step {
    /// What the audit finds. Off: crossed, negated, delayed or clipped channels and other units are not looked for. Records that cannot be used are still
    /// refused.
    Audit,
    /// The noise, fitted to what no command explains. Off: as declared, or a share of each output; nothing is found in quiet records.
    NoiseFit,
    /// Linear parameters far outside their prior are brought back before a search. Off: the search starts from the refit as it is.
    Clipping,
    /// The best of the quick fits, fitted again to whole records. Off: they are only judged there.
    Polishing,
    /// Each effect of several is questioned beside the others. Off: what was accepted first stays.
    Questioning,
    /// Scales of the modes at inferred ports. Off: they rest on reciprocity.
    PortScales,
    /// An effect must explain a material part, or straighten the linear parameters. Off: its price alone decides.
    Material,
    /// Stochastic effects are found in quiet records and raw values. Off: none of them is found.
    #[serde(alias = "unseen")]
    Stochastic,
    /// Power above the noise speaks for something else. Off: it does not.
    Excess,
    /// Linear parameters beyond their limits speak for something else. Off: they do not.
    BeyondLimits,
    /// A further entry of the screen that would gain speaks for something else. Off: it does not.
    Coherent,
    /// Free shapes beside the effects' own. Off: none is tried.
    FreeShapes,
    /// Places on single modes, where the ports do not suffice. Off: none is tried.
    ModalPlaces,
    /// Records that were held out refute an explanation. Off: they only measure it.
    HeldOutVeto,
    /// Confidence is spread more widely than a textbook does, and more so where the best leaves much. Off: as in the textbook.
    Temperature,
    /// The noise once more, from what the explanation leaves of quiet records. Off: it stays as it was first fitted.
    RenewedNoise,
}

impl Step {
    /// All of them, in the order in which a diagnosis comes to them.
    pub const ALL: [Self; 16] = [
        Self::Audit,
        Self::NoiseFit,
        Self::Clipping,
        Self::Polishing,
        Self::Material,
        Self::PortScales,
        Self::Questioning,
        Self::RenewedNoise,
        Self::FreeShapes,
        Self::Excess,
        Self::BeyondLimits,
        Self::Coherent,
        Self::ModalPlaces,
        Self::Stochastic,
        Self::HeldOutVeto,
        Self::Temperature,
    ];

    /// As a command has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Audit => "audit",
            Self::NoiseFit => "noise-fit",
            Self::Clipping => "clipping",
            Self::Polishing => "polishing",
            Self::Questioning => "questioning",
            Self::PortScales => "port-scales",
            Self::Material => "material",
            Self::Stochastic => "stochastic",
            Self::Excess => "excess",
            Self::BeyondLimits => "beyond-limits",
            Self::Coherent => "coherent",
            Self::FreeShapes => "free-shapes",
            Self::ModalPlaces => "modal-places",
            Self::HeldOutVeto => "held-out-veto",
            Self::Temperature => "temperature",
            Self::RenewedNoise => "renewed-noise",
        }
    }

    /// What a diagnosis does without it.
    pub fn when_off(self) -> &'static str {
        match self {
            Self::Audit => "crossed, negated, delayed or clipped channels and other units are not looked for",
            Self::NoiseFit => "noise is taken as declared, and nothing is found in quiet records",
            Self::Clipping => "the search starts from the refit as it is, however far it has gone",
            Self::Polishing => "fits to the heads of the records are only judged on whole ones",
            Self::Questioning => "of several effects, what was accepted first stays",
            Self::PortScales => "scales at inferred ports rest on reciprocity",
            Self::Material => "an effect's price alone decides whether it is accepted",
            Self::Stochastic => "no stochastic effect is found in quiet records and raw values",
            Self::Excess => "power above the noise does not speak for something else",
            Self::BeyondLimits => "linear parameters beyond their limits do not speak for something else",
            Self::Coherent => "a further entry of the screen does not speak for something else",
            Self::FreeShapes => "no free shape is tried",
            Self::ModalPlaces => "no place on a single mode is tried",
            Self::HeldOutVeto => "records that were held out refute nothing",
            Self::Temperature => "probabilities are the textbook's",
            Self::RenewedNoise => "the noise stays as it was first fitted",
        }
    }
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Step {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::name).join(", ");
        let found = Self::ALL.into_iter().find(|step| step.name() == text);
        found.ok_or_else(|| format!("`{text}` is no step that can be off; those are {}", known()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_one_everywhere() {
        for (at, step) in Step::ALL.into_iter().enumerate() {
            assert_eq!(step.name().parse(), Ok(step));
            assert_eq!(serde_json::to_value(step).unwrap(), step.name());
            assert!(!Step::ALL[..at].contains(&step), "{step} is there twice");
        }
        let said = "polish".parse::<Step>().unwrap_err();
        assert!(said.contains("`polish`") && Step::ALL.iter().all(|step| said.contains(step.name())), "{said}");
    }
}
