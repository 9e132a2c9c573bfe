//! Steps of the diagnosis that can be switched off one at a time, to measure the contribution of each. An answer with a
//! step off is for comparison only.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A step that can be switched off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Step {
    /// The audit searches for channels that are exchanged, negated, delayed, clipped or in other units. Off: it does
    /// not. Records that cannot be used are still refused.
    Audit,
    /// The noise is fitted to the stretches that no command explains. Off: the noise is as declared, or a share of each
    /// output, and no effect is found in quiet records.
    NoiseFit,
    /// Linear parameters far outside their prior are brought back before a search. Off: the search starts from the
    /// refit as it is.
    Clipping,
    /// The best of the quick fits are repeated on whole records. Off: they are only judged there.
    Polishing,
    /// Each of several effects must justify itself in the presence of the others. Off: an effect that was accepted
    /// stays.
    Questioning,
    /// The scales of the modes at inferred ports are fitted. Off: they follow from reciprocity alone.
    PortScales,
    /// An effect must explain a material part of the residual, or bring the linear parameters back to their prior. Off:
    /// its price alone decides.
    Material,
    /// Stochastic effects are found in quiet records and raw values. Off: none of them is found.
    #[serde(alias = "unseen")]
    Stochastic,
    /// Residual power above the noise is evidence for something else. Off: it is not.
    Excess,
    /// Linear parameters beyond their limits are evidence for something else. Off: they are not.
    BeyondLimits,
    /// A further entry of the screen that would gain is evidence for something else. Off: it is not.
    Coherent,
    /// Free shapes are tried in addition to the effects' own. Off: none is tried.
    FreeShapes,
    /// Locations on single modes are tried if the ports do not suffice. Off: none is tried.
    ModalPlaces,
    /// Held-out records can refute an explanation. Off: they only measure it.
    HeldOutVeto,
    /// Probability is spread more widely than in the textbook, and more so if the best explanation leaves a large
    /// residual. Off: probability is spread as in the textbook.
    Temperature,
    /// The noise is fitted again to the residual of the explanation in quiet records. Off: it stays as it was first
    /// fitted.
    RenewedNoise,
}

impl Step {
    /// All steps, in the order in which a diagnosis reaches them.
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

    /// Returns the name of the step, as in a command.
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

    /// Returns how a diagnosis differs without the step.
    pub fn when_off(self) -> &'static str {
        match self {
            Self::Audit => "swapped, negated, delayed or clipped channels and other units are not detected",
            Self::NoiseFit => "noise is taken as declared, and nothing is found in quiet records",
            Self::Clipping => "the search starts from the refit, however far its parameters are outside their prior",
            Self::Polishing => "quick fits are only judged on whole records",
            Self::Questioning => "accepted effects are not tested again",
            Self::PortScales => "scales at inferred ports follow from reciprocity alone",
            Self::Material => "an effect is accepted if it pays for its parameters, however little it explains",
            Self::Stochastic => "no stochastic effect is found in quiet records and raw values",
            Self::Excess => "residual power above the noise does not count as evidence for something else",
            Self::BeyondLimits => "linear parameters beyond their limits do not count as evidence for something else",
            Self::Coherent => "a further entry of the screen does not count as evidence for something else",
            Self::FreeShapes => "no free shape is tried",
            Self::ModalPlaces => "no location on a single mode is tried",
            Self::HeldOutVeto => "held-out records refute nothing",
            Self::Temperature => "probabilities are the textbook's",
            Self::RenewedNoise => "the first fit of the noise is kept",
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
        found.ok_or_else(|| format!("`{text}` is not a step that can be switched off; those are {}", known()))
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
