//! Effects that a program defines itself: the truth of an effect that the testbed does not have.
//!
//! A program adds a [`Truth`] at its start. Configs and specs then name it as they name a built-in effect, and the
//! testbed simulates it. The truth states only what happens in the plant. Its diagnosis is separate code, so that
//! neither can hide an error of the other.

use std::sync::{PoisonError, RwLock};

use serde::{Deserialize, Serialize};

use super::at::At;
use super::chain::{Chain, Site};
use super::law::{Law, Limits};
use super::place::{Input, Output};
use crate::config::finite;
use crate::error::TestbedError;

/// The part of the plant in which an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The port of an input, inside the structure.
    Port,
    /// The actuator of an input.
    Actuator,
    /// A sensor.
    Sensor,
}

impl Side {
    /// Returns the kind of its places.
    pub(crate) fn at(self) -> At {
        match self {
            Self::Port => At::Port,
            Self::Actuator => At::Input,
            Self::Sensor => At::Output,
        }
    }
}

/// The action of an effect in one record, from rest. All signals are in volts, times in seconds.
pub enum Action {
    /// The force on the structure at a port, from the port's displacement (V) and velocity (V/s).
    Force(Box<dyn Fn(f64, f64) -> f64>),
    /// The voltage between amplifier and actuator pole, from the voltage without the effect.
    Voltage(Box<dyn Fn(f64) -> f64>),
    /// The sample before the sensor noise, from the sample without the effect and its time since the first record
    /// began. The samples of a record come in order, so the function may have a memory.
    Sample(Box<dyn FnMut(f64, f64) -> f64>),
}

/// RMS values in the held-out record at the place of an effect, without any effect: those of the port of the input
/// for a port or an actuator, and that of the output for a sensor. The commands of that record have about 1 V RMS.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Displacement of the port, V.
    pub displacement: f64,
    /// Velocity of the port, V/s.
    pub velocity: f64,
    /// Output, V.
    pub output: f64,
}

/// The truth of an effect, as the testbed simulates it.
pub trait Truth: Send + Sync {
    /// Returns the name of the effect in configs, specs and labels, which is that in the vocabulary of the diagnosis.
    fn name(&self) -> &'static str;

    /// Returns the part of the plant in which it acts. Its places are the inputs or the outputs.
    fn side(&self) -> Side;

    /// Returns the names of its parameters, in the order of the diagnosis's equation.
    fn parameters(&self) -> &'static [&'static str];

    /// Returns initial parameters. The draw of a case scales them with [`Truth::strengthen`], by positive factors,
    /// until they cause the requested gap.
    fn start(&self, level: &Level) -> Vec<f64>;

    /// Makes the effect stronger by a factor. The response grows with the factor, and is proportional to it to first
    /// order. By default, the first parameter is multiplied by the factor.
    fn strengthen(&self, parameters: &mut [f64], factor: f64) {
        parameters[0] *= factor;
    }

    /// Returns the names of other laws of the same physics, which differ in shape from the diagnosis's equation. A
    /// config or a spec names one as `law`; trials draw them as near misses. By default there is none.
    fn near_misses(&self) -> &'static [&'static str] {
        &[]
    }

    /// Returns the action of the effect in a record that begins now. It follows the diagnosis's equation, or the
    /// named law, which is one of [`Truth::near_misses`]. It must be an action of the effect's [`Truth::side`].
    fn act(&self, law: Option<&str>, parameters: &[f64]) -> Action;
}

static TRUTHS: RwLock<Vec<&'static dyn Truth>> = RwLock::new(Vec::new());

/// Adds an effect to those that configs and specs may name, for as long as the process runs.
///
/// # Panics
/// Panics if there is already an effect of this name, or if the effect has no parameter.
pub fn add(truth: impl Truth + 'static) {
    let name = truth.name();
    assert!(!super::is_built_in(name) && name != OWN, "the testbed has a `{name}` already");
    assert!(!truth.parameters().is_empty(), "`{name}` has no parameter");
    let mut truths = TRUTHS.write().unwrap_or_else(PoisonError::into_inner);
    assert!(truths.iter().all(|there| there.name() != name), "the testbed has a `{name}` already");
    truths.push(Box::leak(Box::new(truth)));
}

/// Returns the added effect of this name.
#[must_use]
pub fn find(name: &str) -> Option<&'static dyn Truth> {
    all().into_iter().find(|truth| truth.name() == name)
}

/// Returns all added effects, in the order in which they were added.
#[must_use]
pub fn all() -> Vec<&'static dyn Truth> {
    TRUTHS.read().unwrap_or_else(PoisonError::into_inner).clone()
}

/// The `kind` of every added effect in a config's list.
pub(crate) const OWN: &str = "own";

/// The name of an added effect. With this alias, serde does not treat the name as a reference into the text that is
/// read.
type Name = &'static str;

/// An effect that a program has added, in the notation of a config's list: with its name, its place, its parameters
/// and, for a near miss, its law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct Own {
    name: Name,
    /// An input or an output, from 0.
    at: usize,
    parameters: Vec<f64>,
    /// One of the truth's near misses; without it, the diagnosis's equation holds.
    law: Option<Name>,
}

/// The keys of an effect that a program has added.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    name: String,
    at: String,
    parameters: Vec<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    law: Option<String>,
}

impl TryFrom<Written> for Own {
    type Error = String;

    fn try_from(Written { name, at, parameters, law }: Written) -> Result<Self, String> {
        let truth = find(&name).ok_or_else(|| format!("this program has added no effect `{name}`"))?;
        let at = match truth.side() {
            Side::Port | Side::Actuator => Input::try_from(at).map(|Input(j)| j),
            Side::Sensor => Output::try_from(at).map(|Output(i)| i),
        };
        let (found, wanted) = (parameters.len(), truth.parameters());
        if found != wanted.len() {
            return Err(format!("`{name}` has the parameters {}, not {found} of them", wanted.join(", ")));
        }
        let laws = truth.near_misses();
        let found = |law: String| {
            let known = laws.iter().copied().find(|known| *known == law);
            known.ok_or_else(|| format!("`{name}` has no law `{law}`; its laws are: {}", laws.join(", ")))
        };
        let law = law.map(found).transpose()?;
        Ok(Self { name: truth.name(), at: at.map_err(|error| error.to_string())?, parameters, law })
    }
}

impl From<Own> for Written {
    fn from(own: Own) -> Self {
        let at = match own.truth().side() {
            Side::Port | Side::Actuator => Input(own.at).into(),
            Side::Sensor => Output(own.at).into(),
        };
        Self { name: own.name.to_owned(), at, parameters: own.parameters, law: own.law.map(str::to_owned) }
    }
}

impl Own {
    pub(crate) fn name(&self) -> &'static str {
        self.name
    }

    fn truth(&self) -> &'static dyn Truth {
        find(self.name).expect("an effect that was made was added before")
    }
}

impl Law for Own {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        self.parameters.iter().try_for_each(|&value| finite("parameters", value))
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        match self.truth().act(self.law, &self.parameters) {
            Action::Force(force) => chain.force_at(&site.truss.ports[self.at], force),
            Action::Voltage(law) => chain.change_inputs(vec![self.at], law),
            Action::Sample(law) => chain.change_output(self.at, law),
        }
    }

    fn strengthen(&mut self, factor: f64) {
        self.truth().strengthen(&mut self.parameters, factor);
    }

    fn place(&self) -> usize {
        self.at
    }

    fn parameters(&self) -> Vec<f64> {
        self.parameters.clone()
    }

    fn own_equation(&self) -> bool {
        self.law.is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Effect;
    use crate::gap::PlantKind;

    struct Square;

    impl Truth for Square {
        fn name(&self) -> &'static str {
            "test-square"
        }
        fn side(&self) -> Side {
            Side::Sensor
        }
        fn parameters(&self) -> &'static [&'static str] {
            &["c"]
        }
        fn start(&self, level: &Level) -> Vec<f64> {
            vec![0.1 / level.output]
        }
        fn near_misses(&self) -> &'static [&'static str] {
            &["power"]
        }
        fn act(&self, law: Option<&str>, parameters: &[f64]) -> Action {
            let c = parameters[0];
            let exponent = if law == Some("power") { 1.5 } else { 2.0 };
            Action::Sample(Box::new(move |y, _t| y + c * y.abs().powf(exponent)))
        }
    }

    #[test]
    fn an_added_effect_is_read_written_and_strengthened_and_wrong_keys_are_named() {
        add(Square);
        let read = |at: &str, parameters: &[f64]| {
            let keys = serde_json::json!({
                "kind": "own", "name": "test-square", "at": at, "parameters": parameters
            });
            serde_json::from_value::<Effect>(keys.clone()).map(|effect| (effect, keys)).map_err(|e| e.to_string())
        };
        let kind = crate::effects::kind("test-square").unwrap();
        assert_eq!((kind.at, kind.parameters, kind.near_misses), (At::Output, &["c"][..], &["power"][..]));
        assert!(!kind.family.is_built_in() && kind.is_in_vocabulary());
        assert!(PlantKind::ALL.into_iter().all(|plant| plant.takes("test-square")), "it makes sense everywhere");
        let (effect, keys) = read("y2", &[0.5]).unwrap();
        assert_eq!((effect.kind(), effect.place(), effect.parameters()), ("test-square", 1, vec![0.5]));
        assert_eq!(serde_json::to_value(&effect).unwrap(), keys);
        assert_eq!(effect.strengthened(3.0).parameters(), [1.5]);
        assert!(effect.own_equation());
        let near_miss = |law: &str| {
            let mut keys = keys.clone();
            keys["law"] = law.into();
            serde_json::from_value::<Effect>(keys.clone()).map(|effect| (effect, keys)).map_err(|e| e.to_string())
        };
        let (other, other_keys) = near_miss("power").unwrap();
        assert!(!other.own_equation() && other != effect);
        assert_eq!(serde_json::to_value(&other).unwrap(), other_keys);
        assert!(near_miss("root").unwrap_err().contains("its laws are: power"));
        assert!(read("u2", &[0.5]).unwrap_err().contains("an output, y1 to y3"));
        assert!(read("y2", &[]).unwrap_err().contains("has the parameters c"));
        let unknown = serde_json::json!({ "kind": "own", "name": "nobody's", "at": "y1", "parameters": [] });
        assert!(serde_json::from_value::<Effect>(unknown).unwrap_err().to_string().contains("nobody's"));
        assert!(std::panic::catch_unwind(|| add(Square)).is_err(), "a name is taken twice");
    }
}
