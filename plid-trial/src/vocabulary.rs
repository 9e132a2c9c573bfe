//! The testbed's effects as a trial draws them: family, places, and the laws that are near misses in shape. Effects
//! that a program has added to the testbed are drawn where a trial names them.

use plid_testbed::effects::own::{self, Side};
use serde::{Deserialize, Serialize};

/// The kind of place of an effect, in the notation of the testbed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum At {
    /// `u1`
    Input,
    /// `u1`, or `all`
    InputOrAll,
    /// `u1->u3`
    InputPair,
    /// `y1`
    Output,
    /// `y1->y3`
    OutputPair,
    /// `m4`: one of the dominant modes
    Mode,
    /// The structure as a whole.
    Whole,
}

/// An effect that can be drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kind {
    /// Its identifier.
    pub name: &'static str,
    /// Its family of similar effects.
    pub family: &'static str,
    /// Its possible places.
    pub at: At,
    /// Other laws of the same physics, which differ from the vocabulary's own equation.
    pub near_misses: &'static [&'static str],
}

const fn kind(name: &'static str, family: &'static str, at: At, near_misses: &'static [&'static str]) -> Kind {
    Kind { name, family, at, near_misses }
}

/// Effects inside the structure, at the port of an input.
pub(crate) const NONLINEAR_STRUCTURE: &str = "structure-nonlinear";
/// Effects of a mode, and of a load that moves modes.
pub(crate) const LINEAR_STRUCTURE: &str = "structure-linear";
const NONLINEAR_ACTUATOR: &str = "actuator-nonlinear";
const ACTUATOR: &str = "actuator-linear";
const NONLINEAR_SENSOR: &str = "sensor-nonlinear";
const SENSOR: &str = "sensor-linear";
const ADDED: &str = "sensor-additive";
const TIME: &str = "time";
const DISTURBANCE: &str = "disturbance";

/// The vocabulary as far as it is drawn on structures.
pub const VOCABULARY: [Kind; 33] = [
    kind("cubic-stiffness", NONLINEAR_STRUCTURE, At::Input, &["power", "straightening"]),
    kind("quadratic-stiffness", NONLINEAR_STRUCTURE, At::Input, &["one-sided"]),
    kind("coulomb-friction", NONLINEAR_STRUCTURE, At::Input, &["root", "stribeck"]),
    kind("clearance", NONLINEAR_STRUCTURE, At::Input, &["rounded", "asymmetric"]),
    kind("iwan-joint", NONLINEAR_STRUCTURE, At::Input, &["kink"]),
    kind("joint-hysteresis", NONLINEAR_STRUCTURE, At::Input, &["dahl", "sharp"]),
    kind("quadratic-damping", NONLINEAR_STRUCTURE, At::Input, &["power", "asymmetric"]),
    kind("modal-frequency", LINEAR_STRUCTURE, At::Mode, &[]),
    kind("modal-damping", LINEAR_STRUCTURE, At::Mode, &[]),
    kind("missing-mode", LINEAR_STRUCTURE, At::Whole, &[]),
    kind("actuator-saturation", NONLINEAR_ACTUATOR, At::Input, &["clip", "arctangent"]),
    kind("actuator-dead-zone", NONLINEAR_ACTUATOR, At::Input, &["rounded", "asymmetric"]),
    kind("actuator-hysteresis", NONLINEAR_ACTUATOR, At::Input, &["dahl", "sharp"]),
    kind("actuator-slew-limit", NONLINEAR_ACTUATOR, At::Input, &["soft"]),
    kind("actuator-lag", ACTUATOR, At::Input, &[]),
    kind("actuator-gain", ACTUATOR, At::Input, &[]),
    kind("actuator-delay", ACTUATOR, At::InputOrAll, &[]),
    kind("actuator-crosstalk", ACTUATOR, At::InputPair, &[]),
    kind("sensor-saturation", NONLINEAR_SENSOR, At::Output, &["tanh", "arctangent"]),
    kind("sensor-quantisation", NONLINEAR_SENSOR, At::Output, &["truncate"]),
    kind("sensor-dropout", NONLINEAR_SENSOR, At::Output, &["half"]),
    kind("sensor-gain", SENSOR, At::Output, &[]),
    kind("sensor-delay", SENSOR, At::Output, &["interpolated"]),
    kind("sensor-lag", SENSOR, At::Output, &["two-poles"]),
    kind("sensor-crosstalk", SENSOR, At::OutputPair, &[]),
    kind("sensor-offset", ADDED, At::Output, &[]),
    kind("sensor-drift", ADDED, At::Output, &["settling"]),
    kind("mains-hum", ADDED, At::Output, &[]),
    kind("sensor-noise", ADDED, At::Output, &["laplace"]),
    kind("stiffness-drift", TIME, At::Whole, &["settling"]),
    kind("actuator-gain-drift", TIME, At::Input, &["settling"]),
    kind("narrowband-disturbance", DISTURBANCE, At::Input, &["wandering"]),
    kind("coloured-disturbance", DISTURBANCE, At::Input, &[]),
];

/// The rest of the vocabulary of the diagnosis: effects that are drawn only on bodies on axes, such as a motor or an
/// arm. On a structure, a mass, a damper or a spring is what it does to the frequencies and damping ratios of all
/// modes. Stops and friction that sticks have its clearance and its Stribeck curve for near relatives, and nothing
/// swings.
pub const OF_AXES: [Kind; 8] = [
    kind("added-mass", LINEAR_STRUCTURE, At::Input, &[]),
    kind("added-damping", LINEAR_STRUCTURE, At::Input, &[]),
    kind("added-stiffness", LINEAR_STRUCTURE, At::Input, &[]),
    kind("backlash", NONLINEAR_STRUCTURE, At::Input, &["rounded"]),
    kind("end-stop", NONLINEAR_STRUCTURE, At::Input, &[]),
    kind("gravity-sine", NONLINEAR_STRUCTURE, At::Input, &[]),
    kind("one-sided-stop", NONLINEAR_STRUCTURE, At::Input, &[]),
    kind("stick-friction", NONLINEAR_STRUCTURE, At::Input, &["lorentzian"]),
];

const OUTSIDE: &str = "outside";

/// Effects that are not in the vocabulary of plid-gap, and that trials in development have drawn.
const IN_DEVELOPMENT: [Kind; 8] = [
    kind("x-channel-product", OUTSIDE, At::Output, &[]),
    kind("x-command-play", OUTSIDE, At::Input, &[]),
    kind("x-delay-jitter", OUTSIDE, At::Input, &[]),
    kind("x-parametric-stiffness", OUTSIDE, At::Whole, &[]),
    kind("x-sensor-rate-limit", OUTSIDE, At::Output, &[]),
    kind("x-sensor-square", OUTSIDE, At::Output, &[]),
    kind("x-sticking-valve", OUTSIDE, At::Input, &[]),
    kind("x-varying-damping", OUTSIDE, At::Whole, &[]),
];

/// Effects that are not in the vocabulary of plid-gap either, for trials that are reported: nothing was developed with
/// them.
const FOR_REPORTS: [Kind; 8] = [
    kind("x-clock-skew", OUTSIDE, At::Output, &[]),
    kind("x-force-factor", OUTSIDE, At::Input, &[]),
    kind("x-foreshortening", OUTSIDE, At::InputPair, &[]),
    kind("x-intermittent-contact", OUTSIDE, At::Input, &[]),
    kind("x-proportional-noise", OUTSIDE, At::Output, &[]),
    kind("x-resonant-crosstalk", OUTSIDE, At::OutputPair, &[]),
    kind("x-supply-sag", OUTSIDE, At::Whole, &[]),
    kind("x-thermal-gain", OUTSIDE, At::Input, &[]),
];

/// The effects outside the vocabulary from which a trial draws. The two halves have none in common, so a trial of one
/// half shows whether what was learnt from the other holds for other causes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outsiders {
    /// The half with which the diagnosis was developed.
    Development,
    /// The half that only trials draw whose scores are reported.
    Reported,
    /// Both halves.
    #[default]
    All,
}

impl Outsiders {
    /// Returns these effects.
    pub fn kinds(self) -> Vec<Kind> {
        match self {
            Self::Development => IN_DEVELOPMENT.to_vec(),
            Self::Reported => FOR_REPORTS.to_vec(),
            Self::All => [IN_DEVELOPMENT, FOR_REPORTS].concat(),
        }
    }
}

const OWN: &str = "own";

/// Returns the effects that this program has added to the testbed.
pub fn own() -> Vec<Kind> {
    let at = |side| match side {
        Side::Port | Side::Actuator => At::Input,
        Side::Sensor => At::Output,
    };
    own::all().into_iter().map(|truth| kind(truth.name(), OWN, at(truth.side()), truth.near_misses())).collect()
}

/// Returns the vocabulary, and then the effects of [`own()`].
pub fn whole() -> Vec<Kind> {
    VOCABULARY.into_iter().chain(OF_AXES).chain(own()).collect()
}

/// Returns an effect of [`whole`].
pub fn find(name: &str) -> Option<Kind> {
    whole().into_iter().find(|kind| kind.name == name)
}

/// Returns the family of an effect of [`whole`].
pub fn family(name: &str) -> Option<&'static str> {
    find(name).map(|kind| kind.family)
}

impl Kind {
    /// Returns every possible place in a plant with this many inputs and outputs; `None` leaves the place to the
    /// testbed.
    pub fn places(&self, inputs: usize, outputs: usize) -> Vec<Option<String>> {
        let single = |letter: char, count: usize| (1..=count).map(move |i| Some(format!("{letter}{i}")));
        let pairs = |letter: char, count: usize| {
            (1..=count).flat_map(move |i| {
                (1..=count).filter(move |&j| j != i).map(move |j| Some(format!("{letter}{i}->{letter}{j}")))
            })
        };
        match self.at {
            At::Input => single('u', inputs).collect(),
            At::InputOrAll => single('u', inputs).chain([Some("all".to_owned())]).collect(),
            At::InputPair => pairs('u', inputs).collect(),
            At::Output => single('y', outputs).collect(),
            At::OutputPair => pairs('y', outputs).collect(),
            At::Mode => (4..=7).map(|m| Some(format!("m{m}"))).collect(),
            At::Whole => vec![None],
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use plid_gap::effects::Library;
    use plid_testbed::Effect;

    use super::*;

    /// Each outsider of the testbed is in one half, and only in one.
    #[test]
    fn the_halves_of_the_outsiders_are_disjoint_and_together_all() {
        let names = |half: Outsiders| half.kinds().iter().map(|kind| kind.name).collect::<BTreeSet<_>>();
        let (development, reported) = (names(Outsiders::Development), names(Outsiders::Reported));
        assert!(development.is_disjoint(&reported));
        assert_eq!((development.len(), reported.len(), Outsiders::All.kinds().len()), (8, 8, 16));
        assert_eq!(&development | &reported, names(Outsiders::All));
        // What the testbed knows is in the message about what it does not know.
        let unknown = serde_json::from_value::<Effect>(serde_json::json!({ "kind": "x-" })).unwrap_err().to_string();
        let known: BTreeSet<&str> =
            unknown.split('`').filter(|name| name.starts_with("x-") && name.len() > 2).collect();
        assert_eq!(known, names(Outsiders::All));
    }

    #[test]
    fn the_vocabulary_is_the_diagnosis_s_and_outsiders_are_not() {
        let library = Library::standard();
        let mut known: Vec<&str> = library.effects().map(|effect| effect.name()).collect();
        let mut drawn: Vec<&str> = VOCABULARY.iter().chain(&OF_AXES).map(|kind| kind.name).collect();
        known.sort_unstable();
        drawn.sort_unstable();
        assert_eq!(known, drawn);
        assert!(Outsiders::All.kinds().iter().all(|kind| library.get(kind.name).is_none()));
    }

    /// The testbed reads kind, place and law before it misses the parameters, which are not given here.
    #[test]
    fn the_testbed_knows_every_kind_place_and_law() {
        for kind in VOCABULARY.iter().chain(&OF_AXES).chain(&Outsiders::All.kinds()) {
            let laws = kind.near_misses.iter().map(|law| Some(*law)).chain([None]);
            for (place, law) in kind.places(3, 3).into_iter().flat_map(|p| laws.clone().map(move |l| (p.clone(), l))) {
                let mut effect = serde_json::json!({ "kind": kind.name });
                place.iter().for_each(|place| effect["at"] = place.as_str().into());
                law.iter().for_each(|law| effect["law"] = (*law).into());
                let said = serde_json::from_value::<Effect>(effect.clone()).map_err(|e| e.to_string());
                let missing = said.as_ref().is_err_and(|e| e.starts_with("missing field") && !e.contains("`at`"));
                assert!(missing, "{effect}: {said:?}");
            }
            let strange = serde_json::json!({ "kind": kind.name, "law": "strange" });
            let said = serde_json::from_value::<Effect>(strange).unwrap_err().to_string();
            assert_eq!(said.contains("unknown variant `strange`"), !kind.near_misses.is_empty(), "{said}");
        }
    }

    #[test]
    fn places_are_all_there_are() {
        let count = |name: &str| find(name).unwrap().places(3, 3).len();
        assert_eq!((count("actuator-delay"), count("sensor-crosstalk"), count("missing-mode")), (4, 6, 1));
        assert_eq!(find("actuator-crosstalk").unwrap().places(1, 1).len(), 0);
        assert_eq!(find("cubic-stiffness").unwrap().places(2, 1), [Some("u1".to_owned()), Some("u2".to_owned())]);
    }
}
