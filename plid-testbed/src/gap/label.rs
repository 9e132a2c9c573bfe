//! The answer to a case.

use serde::Serialize;

use super::effect::is_at_a_port;
use super::spec::{Experiment, PlantKind, Simulator};
use crate::axes::Axes;
use crate::effects::{Effect, own};
use crate::plant::Truss;
use crate::structure::Mode;
use crate::{INPUTS, OUTPUTS};

/// The truth of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Label {
    /// The effects at work; the single effect `none` where there is none.
    pub effects: Vec<LabelledEffect>,
    /// Whether the nominal simulation is also slightly off.
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
    /// Each of them, with about the gap that it makes alone; then what the simulation is off by more than the stated
    /// limits.
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
    /// The gap that was asked for.
    pub target: f64,
    /// The gap that it makes alone, without noise.
    pub gap: f64,
    /// Frequency of the mode at `loc`, or of the one that is missing, Hz.
    pub hz: f64,
    /// Whether its law is the vocabulary's own equation.
    pub own_equation: bool,
    /// Whether it lies beyond twice what a case lets a simulation be off (0.2 % of a frequency, a tenth of a damping
    /// ratio), both by itself and in addition to this simulation's own errors; always true of other effects.
    pub clear_of_nuisance: bool,
    /// The effect as a config's list has it.
    pub config: Option<Effect>,
}

/// Stated limits on relative errors of a simulation: two standard deviations.
const FREQUENCY_LIMIT: f64 = 0.002;
const DAMPING_LIMIT: f64 = 0.1;
const SHAPE_LIMIT: f64 = 0.02;

/// Relative distance at which a stated frequency still means the label's: of a mode, of a disturbance.
const SAME_MODE: f64 = 0.05;
const SAME_FREQUENCY: f64 = 0.1;

impl LabelledEffect {
    /// Names of `par` in the vocabulary's equations, in order; the index of the other channel, which a crosstalk has in
    /// it, has none.
    #[must_use]
    pub fn parameter_names(&self) -> &'static [&'static str] {
        match self.effect.as_str() {
            "cubic-stiffness" | "quadratic-stiffness" => &["k"],
            "coulomb-friction" => &["F", "v0"],
            "clearance" => &["k", "g"],
            // The last one only where it is not zero.
            "iwan-joint" => &["k", "dm", "chi", "s"][..self.par.len().min(4)],
            "joint-hysteresis" => &["k", "dy"],
            "quadratic-damping" | "actuator-crosstalk" | "sensor-crosstalk" => &["c"],
            "stick-friction" => &["Fc", "Fs", "vs"],
            "backlash" => &["k", "g"],
            "end-stop" | "one-sided-stop" => &["k", "c", "g"],
            "gravity-sine" | "added-stiffness" => &["k"],
            "added-mass" => &["m"],
            "added-damping" => &["c"],
            "modal-frequency" | "actuator-dead-zone" => &["delta"],
            "modal-damping" => &["rho"],
            "missing-mode" => &["f"],
            "actuator-saturation" | "sensor-saturation" => &["a"],
            "actuator-hysteresis" => &["alpha", "uy"],
            "actuator-slew-limit" => &["R"],
            "actuator-lag" => &["fp"],
            "actuator-gain" | "sensor-gain" => &["g"],
            "actuator-delay" | "sensor-delay" => &["tau"],
            "actuator-gain-drift" | "stiffness-drift" => &["r"],
            "narrowband-disturbance" | "mains-hum" => &["a", "f", "phi"],
            "coloured-disturbance" => &["a", "f"],
            "sensor-lag" => &["fc"],
            "sensor-offset" => &["o"],
            "sensor-drift" => &["s"],
            "sensor-noise" => &["std"],
            "sensor-quantisation" => &["q"],
            "sensor-dropout" => &["rate"],
            name => own::find(name).map_or(&[], |truth| truth.parameters()),
        }
    }

    /// Whether a location, as a diagnosis states it (`input:u2`, `output:y1->y3`, `mode:168.2`), means the place of
    /// this effect.
    #[must_use]
    pub fn is_at(&self, location: &str) -> bool {
        let (loc, par) = (self.loc + 1, &self.par);
        let near = |hz: f64, within: f64| {
            let stated = location.split_once(':').and_then(|(_, at)| at.split(' ').next()?.parse::<f64>().ok());
            stated.is_some_and(|stated| (stated / hz - 1.0).abs() < within)
        };
        if let Some(truth) = own::find(&self.effect) {
            return match truth.side() {
                own::Side::Port => location == format!("input:u{loc}") || location == format!("port:strut{loc}"),
                own::Side::Actuator => location == format!("input:u{loc}"),
                own::Side::Sensor => location == format!("output:y{loc}"),
            };
        }
        match self.effect.as_str() {
            force if is_at_a_port(force) => {
                location == format!("input:u{loc}") || location == format!("port:strut{loc}")
            }
            "modal-frequency" | "modal-damping" | "missing-mode" => near(self.hz, SAME_MODE),
            "narrowband-disturbance" | "coloured-disturbance" => near(par[1], SAME_FREQUENCY),
            "stiffness-drift" => location == "structure",
            "actuator-delay" if self.loc == INPUTS => location == "input:all",
            "actuator-crosstalk" => location == format!("input:u{loc}->u{}", par[1] as usize + 1),
            "sensor-crosstalk" => location == format!("output:y{loc}->y{}", par[1] as usize + 1),
            kind if kind.starts_with("actuator-") => location == format!("input:u{loc}"),
            kind if kind.starts_with("sensor-") || kind == "mains-hum" => location == format!("output:y{loc}"),
            _ => false,
        }
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
    let (loc, hz) = match effect {
        Effect::MissingMode(mode) => {
            let below = base.modes.iter().filter(|m| m.frequency_hz < mode.frequency_hz).count();
            (below, mode.frequency_hz)
        }
        _ => (effect.place(), base.modes.get(effect.place()).map_or(0.0, |mode| mode.frequency_hz)),
    };
    // What the simulation is off may take back a part of it.
    let both = |own: f64, of: fn(&Mode) -> f64| {
        let (truth, simulated) = (of(&base.modes[effect.place()]), of(&nominal.modes[effect.place()]));
        own.abs().min((own + (truth / simulated).ln()).abs())
    };
    let clear_of_nuisance = match effect {
        Effect::ModalFrequency(e) => both(e.change.ln_1p(), |mode| mode.frequency_hz) > 2.0 * FREQUENCY_LIMIT,
        Effect::ModalDamping(e) => both(e.factor.ln(), |mode| mode.damping_ratio) > 2.0 * DAMPING_LIMIT,
        _ => base.axes.as_ref().is_none_or(|axes| clear_of_the_axis_s(effect, axes)),
    };
    LabelledEffect {
        effect: effect.kind().to_owned(),
        loc,
        par,
        target,
        gap,
        hz,
        own_equation: effect.own_equation(),
        clear_of_nuisance,
        config: Some(effect.clone()),
    }
}

/// Whether a mass, a damper or a spring changes an axis by more than twice what a simulation may be off: a mass its
/// gain, a damper its damping ratio, a spring its frequency. Where the axis has none of its own, any is clear.
fn clear_of_the_axis_s(effect: &Effect, axes: &Axes) -> bool {
    let own = axes.own(effect.place().min(axes.drive.len() - 1));
    let beyond = |added: f64, own: f64, limit: f64| added.abs() > 2.0 * limit * own;
    match effect {
        Effect::AddedMass(e) => beyond(e.mass_s2, own.inertia, SHAPE_LIMIT),
        Effect::AddedDamping(e) => beyond(e.damping_s, own.damping, DAMPING_LIMIT),
        // The frequency goes with the root of the stiffness.
        Effect::AddedStiffness(e) => beyond(e.stiffness, own.stiffness, 2.0 * FREQUENCY_LIMIT),
        _ => true,
    }
}

/// Errors of a simulation beyond the stated limits: frequencies, damping ratios, and poles of actuators, for
/// which no limits are stated.
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
