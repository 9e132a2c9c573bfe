//! The answer to a case.

use serde::Serialize;

use super::spec::{Experiment, PlantKind, Simulator};
use crate::axes::Axes;
use crate::effects::law::{Load, ModeChange};
use crate::effects::{self, At, Effect};
use crate::plant::Truss;
use crate::structure::Mode;
use crate::{INPUTS, OUTPUTS};

/// The truth of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Label {
    /// The effects at work; the single effect `none` if there is none.
    pub effects: Vec<LabelledEffect>,
    /// Whether the nominal simulation also has errors in its parameters.
    pub perturbed: bool,
    /// The gap of the nominal simulation on the held-out record.
    pub gap_sim: f64,
    /// The gap that remains if everything except the noise is known.
    pub gap_floor: f64,
    /// Whether the nominal simulation has ports.
    pub ports: bool,
    /// The kind of plant. This key and the following ones are left out if they have their default values.
    #[serde(skip_serializing_if = "is_default")]
    pub plant: PlantKind,
    /// Number of inputs.
    #[serde(skip_serializing_if = "is_all")]
    pub inputs: usize,
    /// Number of outputs.
    #[serde(skip_serializing_if = "is_all")]
    pub outputs: usize,
    /// The kind of experiment.
    #[serde(skip_serializing_if = "is_default")]
    pub experiment: Experiment,
    /// The form in which the case gives the nominal simulation.
    #[serde(skip_serializing_if = "is_default")]
    pub simulator: Simulator,
    /// Whether the declared noise is wrong.
    #[serde(skip_serializing_if = "is_default")]
    pub misjudged: bool,
    /// Effects that are too small, compared with the effects at work, to be a main cause; none if the truth has no
    /// imperfections.
    #[serde(flatten)]
    pub background: Option<LabelledBackground>,
}

/// The small imperfections of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelledBackground {
    /// Always true; the tables of scores distinguish these cases by it.
    pub imperfect: bool,
    /// The gap that they make together, without noise.
    pub imperfections: f64,
    /// The gap that they and the noise cause on the held-out record without the main effects: that of a simulation that
    /// has none of these effects and whose own parameters are exact.
    pub gap_background: f64,
    /// This gap for the nominal simulation, whose parameters have errors.
    pub gap_background_as_given: f64,
    /// Each of them, with the approximate gap that it causes alone, followed by the errors of the simulation beyond
    /// the stated limits.
    pub background_effects: Vec<LabelledEffect>,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

fn is_all(channels: &usize) -> bool {
    *channels == INPUTS && *channels == OUTPUTS
}

/// One effect of the answer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelledEffect {
    /// The name of the effect.
    pub effect: String,
    /// The place of the effect, from 0.
    pub loc: usize,
    /// The parameters, in the order of the vocabulary.
    pub par: Vec<f64>,
    /// The requested gap.
    pub target: f64,
    /// The gap that it makes alone, without noise.
    pub gap: f64,
    /// Frequency of the mode at `loc`, or of the one that is missing, Hz.
    pub hz: f64,
    /// Whether its law is the vocabulary's own equation.
    pub own_equation: bool,
    /// Whether a change of a mode or an axis exceeds twice the stated limit on a simulation's errors (0.2 % of a
    /// frequency, a tenth of a damping ratio, 2 % of a gain). For a mode, this must hold both for the change by
    /// itself and in addition to this simulation's own errors. Always true of other effects.
    pub clear_of_nuisance: bool,
    /// The effect in the notation of a config's list.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub config: Option<Effect>,
}

/// Stated limits on relative errors of a simulation: two standard deviations.
const FREQUENCY_LIMIT: f64 = 0.002;
const DAMPING_LIMIT: f64 = 0.1;
const SHAPE_LIMIT: f64 = 0.02;

impl LabelledEffect {
    /// Returns the names of `par` in the vocabulary's equations, in order. The index of the other channel, which
    /// `par` of a cross-talk contains, has no name, and the parameters of an effect outside the vocabulary have none.
    #[must_use]
    pub fn parameter_names(&self) -> &'static [&'static str] {
        let names = effects::kind(&self.effect).map_or(&[][..], |kind| kind.parameters);
        // The last parameters may be left out.
        &names[..names.len().min(self.par.len())]
    }

    /// Returns whether a location, as a diagnosis states it (`input:u2`, `output:y1->y3`, `mode:168.2`), means the
    /// place of this effect.
    #[must_use]
    pub fn is_at(&self, location: &str) -> bool {
        effects::kind(&self.effect).is_some_and(|kind| kind.at.is_meant(location, self.loc, &self.par, self.hz))
    }
}

impl Label {
    /// Adds the effect `none` if there is no other effect.
    pub(crate) fn or_none(mut self) -> Self {
        if self.effects.is_empty() {
            self.effects.push(LabelledEffect {
                effect: "none".to_owned(),
                loc: 0,
                par: vec![0.0],
                target: 0.0,
                gap: 0.0,
                hz: 0.0,
                own_equation: true,
                clear_of_nuisance: true,
                config: None,
            });
        }
        self
    }
}

pub(crate) fn labelled(effect: &Effect, target: f64, gap: f64, base: &Truss, nominal: &Truss) -> LabelledEffect {
    let par = effect.parameters();
    let is_new = effects::kind(effect.kind()).is_some_and(|kind| kind.at == At::NewMode);
    let (loc, hz) = if is_new {
        (base.modes.iter().filter(|mode| mode.frequency_hz < par[0]).count(), par[0])
    } else {
        (effect.place(), base.modes.get(effect.place()).map_or(0.0, |mode| mode.frequency_hz))
    };
    LabelledEffect {
        effect: effect.kind().to_owned(),
        loc,
        par,
        target,
        gap,
        hz,
        own_equation: effect.own_equation(),
        clear_of_nuisance: is_clear_of_nuisance(effect, base, nominal),
        config: Some(effect.clone()),
    }
}

/// Returns whether an effect changes a mode or an axis by more than twice the stated limits; true if it changes
/// neither.
fn is_clear_of_nuisance(effect: &Effect, base: &Truss, nominal: &Truss) -> bool {
    if let Some(change) = effect.law().mode_change() {
        let (own, of, limit): (f64, fn(&Mode) -> f64, f64) = match change {
            ModeChange::Frequency(own) => (own, |mode| mode.frequency_hz, FREQUENCY_LIMIT),
            ModeChange::Damping(own) => (own, |mode| mode.damping_ratio, DAMPING_LIMIT),
        };
        // The error of the simulation may compensate a part of the change.
        let off = (of(&base.modes[effect.place()]) / of(&nominal.modes[effect.place()])).ln();
        return own.abs().min((own + off).abs()) > 2.0 * limit;
    }
    match (&base.axes, effect.law().load()) {
        (Some(axes), Some(load)) => is_clear_of_the_axis_s(&load, axes),
        _ => true,
    }
}

/// Returns whether a mass, a damper or a spring changes an axis by more than twice the stated limits: a mass its
/// gain, a damper its damping ratio, a spring its frequency. If the axis has none of its own, any of them is clear.
fn is_clear_of_the_axis_s(load: &Load, axes: &Axes) -> bool {
    let own = axes.own(load.port.min(axes.drive.len() - 1));
    let beyond = |added: f64, own: f64, limit: f64| added.abs() > 2.0 * limit * own;
    beyond(load.mass, own.inertia, SHAPE_LIMIT)
        || beyond(load.damping, own.damping, DAMPING_LIMIT)
        // The frequency is proportional to the square root of the stiffness.
        || beyond(load.stiffness, own.stiffness, 2.0 * FREQUENCY_LIMIT)
}

/// Returns the errors of a simulation beyond the stated limits: frequencies, damping ratios, and poles of actuators,
/// for which no limits are stated.
pub(crate) fn off_limits(base: &Truss, nominal: &Truss, inputs: usize) -> Vec<LabelledEffect> {
    let off = |effect: &str, loc: usize, par: f64, hz: f64| LabelledEffect {
        effect: effect.to_owned(),
        loc,
        par: vec![par],
        target: 0.0,
        gap: 0.0,
        hz,
        own_equation: true,
        clear_of_nuisance: true,
        config: None,
    };
    let mut found = Vec::new();
    for (m, (truth, simulated)) in base.modes.iter().zip(&nominal.modes).enumerate() {
        let [frequency, damping] = [
            (truth.frequency_hz / simulated.frequency_hz, FREQUENCY_LIMIT),
            (truth.damping_ratio / simulated.damping_ratio, DAMPING_LIMIT),
        ]
        .map(|(ratio, limit)| (ratio.ln().abs() > limit).then_some(ratio));
        found.extend(frequency.map(|ratio| off("modal-frequency", m, ratio - 1.0, truth.frequency_hz)));
        found.extend(damping.map(|ratio| off("modal-damping", m, ratio, truth.frequency_hz)));
    }
    for (j, (truth, simulated)) in base.actuator_poles_hz.iter().zip(nominal.actuator_poles_hz).take(inputs).enumerate()
    {
        if *truth != simulated {
            found.push(off("actuator-lag", j, *truth, 0.0));
        }
    }
    found
}
