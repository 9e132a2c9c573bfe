//! The answer to a case.

use serde::Serialize;

use super::spec::EffectSpec;
use crate::effects::Effect;
use crate::plant::Truss;

/// What is true of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Label {
    /// The effects at work; the single effect `none` where there is none.
    pub effects: Vec<LabelledEffect>,
    /// Whether the nominal simulation is slightly off beside them.
    pub perturbed: bool,
    /// Gap of the nominal simulation on the held-out record.
    pub gap_sim: f64,
    /// Gap that would be left to somebody who knew everything but the noise.
    pub gap_floor: f64,
    /// Whether the nominal simulation has ports.
    pub ports: bool,
}

/// One effect of the answer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelledEffect {
    /// Its name.
    pub effect: String,
    /// Its place, from 0.
    pub loc: usize,
    /// Its parameters, in the order of the vocabulary.
    pub par: Vec<f64>,
    /// The gap that was asked for.
    pub target: f64,
    /// The gap that it makes alone, without noise.
    pub gap: f64,
    /// Frequency of the mode at `loc`, or of the one that is missing, Hz.
    pub hz: f64,
    /// Whether its law is the vocabulary's own equation.
    pub own_equation: bool,
    /// Whether it lies beyond four standard deviations of what a perturbed simulation may be off; always so for what is no nuisance.
    pub clear_of_nuisance: bool,
    /// The effect as a config's list has it.
    pub config: Option<Effect>,
}

impl Label {
    /// With the effect `none` where no other is at work.
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

pub(crate) fn labelled(effect: &Effect, wanted: &EffectSpec, gap: f64, base: &Truss) -> LabelledEffect {
    let par = effect.parameters();
    let (loc, hz) = match effect {
        Effect::MissingMode(mode) => {
            let below = base.modes.iter().filter(|m| m.frequency_hz < mode.frequency_hz).count();
            (below, mode.frequency_hz)
        }
        _ => (effect.place(), base.modes[effect.place()].frequency_hz),
    };
    let clear_of_nuisance = match effect {
        Effect::ModalFrequency(e) => e.change.abs() > 4.0 * 5e-4,
        Effect::ModalDamping(e) => e.factor.ln().abs() > 4.0 * 0.03,
        _ => true,
    };
    LabelledEffect {
        effect: effect.kind().to_owned(),
        loc,
        par,
        target: wanted.gap,
        gap,
        hz,
        own_equation: effect.own_equation(),
        clear_of_nuisance,
        config: Some(effect.clone()),
    }
}
