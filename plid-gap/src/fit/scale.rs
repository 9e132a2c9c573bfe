//! The coordinates of a fit's steps in the effects' parameters.

use crate::effects::Range;
use crate::fit::problem::{Placed, Problem, dot};

/// The constraint on the length of a vector of which only the direction counts: one over the relative standard
/// deviation of the length.
const HELD: f64 = 1e4;

/// Unit step of a frequency, over the width of a line in all records together: the phase at their ends then turns by
/// about a radian.
const LINE_SHARE: f64 = 0.2;

/// How a step changes a parameter.
#[derive(Debug, Clone, Copy)]
pub(super) enum Scale {
    /// value + step * scale.
    Linear(f64),
    /// value * e^step.
    Logarithm,
    /// value * (1 + step), for a positive parameter to which the effect is proportional. Linear parameters that
    /// compensate for the effect then take their part of the same step. Downwards, the step is linear only to half
    /// the value, and no step leaves less than a sixth.
    Size,
}

impl Scale {
    fn moved(self, value: f64, step: f64) -> f64 {
        match self {
            Scale::Linear(scale) => value + step * scale,
            // No step exceeds a factor e, because the slope here says little about a value that far away.
            Scale::Logarithm => value * step.clamp(-1.0, 1.0).exp(),
            Scale::Size if step > -0.5 => value * (1.0 + step),
            Scale::Size => value * 0.5 * (2.0 * step + 1.0).max(-1.0).exp(),
        }
    }

    /// Returns the step between two values, to first order.
    fn step(self, from: f64, to: f64) -> f64 {
        (to - from) / self.slope(from)
    }

    /// Returns the derivative of the parameter with respect to the step.
    pub(super) fn slope(self, value: f64) -> f64 {
        match self {
            Scale::Linear(scale) => scale,
            Scale::Logarithm | Scale::Size => value,
        }
    }
}

/// Returns the effects after a step of all their parameters.
pub(super) fn stepped<'a>(effects: &[Placed<'a>], step: &[f64], scales: &[Scale]) -> Vec<Placed<'a>> {
    let mut stepped = effects.to_vec();
    let parameters = stepped.iter_mut().flat_map(|placed| placed.parameters.iter_mut());
    for ((value, step), scale) in parameters.zip(step).zip(scales) {
        *value = scale.moved(*value, *step);
    }
    stepped
}

/// Returns the largest step between two lists of the same effects; infinite where a parameter cannot step.
pub(super) fn far_apart(from: &[Placed], to: &[Placed], scales: &[Scale]) -> f64 {
    let values = |effects: &[Placed]| effects.iter().flat_map(|placed| placed.parameters.clone()).collect::<Vec<f64>>();
    let steps = values(from).into_iter().zip(values(to)).zip(scales).map(|((from, to), scale)| scale.step(from, to));
    steps.fold(0.0, |most, step| if step.is_nan() { f64::INFINITY } else { most.max(step.abs()) })
}

impl Problem {
    /// Returns the scale of every effect parameter.
    pub(super) fn scales(&self, effects: &[Placed]) -> Vec<Scale> {
        let mut scales = Vec::new();
        for placed in effects {
            let size = placed.effect.amplitude().map(|(index, _)| index);
            let parameters = placed.effect.parameters(&self.setting);
            for (k, (parameter, &start)) in parameters.iter().zip(&placed.parameters).enumerate() {
                scales.push(match parameter.range {
                    Range::Positive if size == Some(k) => Scale::Size,
                    Range::Signed | Range::Direction => Scale::Linear(if start == 0.0 { 1.0 } else { start.abs() }),
                    Range::Positive => Scale::Logarithm,
                    Range::Hz => Scale::Linear(LINE_SHARE / self.setting.duration_s.max(1e-9)),
                    Range::Angle => Scale::Linear(1.0),
                });
            }
        }
        scales
    }

    /// Returns, for each vector of which only the direction counts, the derivative of its length with respect to all
    /// effect parameters, times [`HELD`]. No data determine such a length, so it is held at its value.
    pub(super) fn lengths(&self, effects: &[Placed], scales: &[Scale]) -> Vec<Vec<f64>> {
        let mut lengths = Vec::new();
        let mut first = 0;
        for placed in effects {
            let mut length = vec![0.0; scales.len()];
            let kinds = placed.effect.parameters(&self.setting);
            for (k, (parameter, &value)) in kinds.iter().zip(&placed.parameters).enumerate() {
                if parameter.range == Range::Direction {
                    length[first + k] = value * scales[first + k].slope(value);
                }
            }
            first += placed.parameters.len();
            let size = dot(&length, &length).sqrt();
            if size > 0.0 {
                lengths.push(length.iter().map(|x| HELD * x / size).collect());
            }
        }
        lengths
    }
}
