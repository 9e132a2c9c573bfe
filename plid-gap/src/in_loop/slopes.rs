//! Derivatives of the simulator's outputs with respect to the parameters of effects, updated from point to point
//! without new runs.
//!
//! Finite differences take a run of every record for each parameter. The runs of the steps themselves already show
//! the error with which the derivatives predict the outputs. Broyden's rank-one update (*Math. Comp.* 19, 1965)
//! assigns this error to the direction of the step. Space mapping updates its surrogate of an expensive simulator in
//! this way (Bandler et al., *IEEE Trans. Microwave Theory Tech.* 43, 1995).

use nalgebra::DVector;

use crate::case::record::Channels;
use crate::effects::Range;
use crate::in_loop::problem::{Fit, Problem};

/// Longest step, in a parameter's logarithm or unit, over which derivatives are updated. Over longer steps, the laws
/// of effects are too strongly curved.
const NEAR: f64 = 0.5;

/// The derivatives at a point: the change of the outputs of each record per unit step of each parameter.
#[derive(Clone, Debug)]
pub(super) struct Slopes {
    /// The derivatives, indexed by parameter and record.
    pub by_parameter: Vec<Vec<Channels>>,
}

impl Slopes {
    /// Returns the derivatives at `to`, the end of a step from `from`, where `self` holds the derivatives. Returns
    /// `None` if the step is zero or too long.
    pub fn carry(&self, problem: &Problem, from: &Fit, to: &Fit) -> Option<Self> {
        let (step, units) = problem.step_between(from, to);
        let length = step.norm_squared();
        if !(length > 0.0 && step.amax() <= NEAR) {
            return None;
        }
        let mut misfit = difference(&to.simulated, &from.simulated);
        for (slope, step) in self.by_parameter.iter().zip(&step) {
            add(&mut misfit, slope, -step);
        }
        for ((nuisance, before), after) in problem.nuisances.iter().zip(&from.eta).zip(&to.eta) {
            if !problem.is_replaced(nuisance, &from.effects) {
                add(&mut misfit, &nuisance.change, before - after);
            }
        }
        let mut by_parameter = self.by_parameter.clone();
        for ((slope, step), unit) in by_parameter.iter_mut().zip(&step).zip(&units) {
            add(slope, &misfit, step / length);
            slope.iter_mut().flatten().flatten().for_each(|x| *x *= unit);
        }
        Some(Self { by_parameter })
    }
}

impl Problem<'_> {
    /// Returns the step of the effects' parameters from one point to another, each in its logarithm or in its unit at
    /// the first point, and the factors by which these units change from the first point to the second.
    fn step_between(&self, from: &Fit, to: &Fit) -> (DVector<f64>, Vec<f64>) {
        let (mut steps, mut units) = (Vec::new(), Vec::new());
        for (before, after) in from.effects.iter().zip(&to.effects) {
            let parameters = before.effect.parameters(&self.setting);
            for ((x, y), parameter) in before.parameters.iter().zip(&after.parameters).zip(parameters) {
                if parameter.range == Range::Positive {
                    steps.push((y / x).ln());
                    units.push(1.0);
                } else {
                    steps.push((y - x) / unit(*x));
                    units.push(unit(*y) / unit(*x));
                }
            }
        }
        (steps.into(), units)
    }
}

/// Returns the unit of steps in a parameter of any sign.
pub(super) fn unit(value: f64) -> f64 {
    if value == 0.0 { 1.0 } else { value.abs() }
}

/// Returns the change of channels from one set of runs to another.
pub(super) fn difference(to: &[Channels], from: &[Channels]) -> Vec<Channels> {
    let mut to = to.to_vec();
    add(&mut to, from, -1.0);
    to
}

/// Adds `factor` times `channels` to `to`.
fn add(to: &mut [Channels], channels: &[Channels], factor: f64) {
    let pairs = to.iter_mut().flatten().flatten().zip(channels.iter().flatten().flatten());
    pairs.for_each(|(to, x)| *to += factor * x);
}
