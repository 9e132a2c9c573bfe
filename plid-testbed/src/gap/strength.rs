//! The strengths at which effects cause the requested gap.

use ndarray::{Array2, ArrayView2};

use super::excitation::Planned;
use super::{GapError, measured, with_effects};
use crate::config::TrussConfig;
use crate::effects::Effect;
use crate::effects::chain::dot;
use crate::effects::own::Level;
use crate::error::TestbedError;
use crate::plant::{Truss, altered};
use crate::record::record;
use crate::state_space::multiply_add;
use crate::{INPUTS, OUTPUTS};

/// Returns RMS(y - other) / RMS(y) over all outputs, each scaled to unit RMS of y.
pub(crate) fn gap(y: &Array2<f64>, other: &Array2<f64>) -> f64 {
    let squares = (0..y.ncols()).map(|i| {
        let (y, other) = (y.column(i), other.column(i));
        let error: f64 = y.iter().zip(other).map(|(y, o)| (y - o) * (y - o)).sum();
        error / y.iter().map(|y| y * y).sum::<f64>()
    });
    (squares.sum::<f64>() / y.ncols() as f64).sqrt()
}

/// RMS of the signals on which effects act, in the held-out record without effects.
pub(crate) struct Signals {
    pub displacement: [f64; INPUTS],
    pub velocity: [f64; INPUTS],
    pub output: [f64; OUTPUTS],
}

impl Signals {
    pub(crate) fn of(truss: &Truss, commands: ArrayView2<f64>) -> Self {
        let model = &truss.discrete;
        let (mut x, mut next) = (vec![0.0; model.states()], vec![0.0; model.states()]);
        let mut squares = [[0.0; 3]; 3];
        for u in commands.rows() {
            let mut y = [0.0; OUTPUTS];
            multiply_add(&model.c, &x, &mut y);
            for port in &truss.ports {
                squares[0][port.input] += dot(&port.displacement, &x).powi(2);
                squares[1][port.input] += dot(&port.velocity, &x).powi(2);
            }
            for (square, y) in squares[2].iter_mut().zip(y) {
                *square += y * y;
            }
            next.fill(0.0);
            multiply_add(&model.a, &x, &mut next);
            multiply_add(&model.b, &u.to_vec(), &mut next);
            std::mem::swap(&mut x, &mut next);
        }
        let [displacement, velocity, output] = squares.map(|s| s.map(|s| (s / commands.nrows() as f64).sqrt()));
        Self { displacement, velocity, output }
    }

    /// Returns the values of one input and one output.
    pub(crate) fn at(&self, channel: usize) -> Level {
        let Self { displacement, velocity, output } = self;
        Level { displacement: displacement[channel], velocity: velocity[channel], output: output[channel] }
    }
}

/// The conditions under which strengths are tried: the held-out record, or a part of it, without noise.
pub(crate) struct Bench<'a> {
    pub config: &'a TrussConfig,
    pub truss: &'a Truss,
    pub planned: &'a Planned,
    /// Number of measured outputs.
    pub measured: usize,
    /// Number of the first effect in the case's list. The streams from which the effect draws depend on it.
    pub number: usize,
}

/// The accuracy with which a search meets the requested gap.
#[derive(Clone, Copy)]
pub(crate) struct Goal {
    /// Relative error at which the search ends.
    pub sought: f64,
    /// Relative error that is still good enough.
    pub accepted: f64,
}

impl Goal {
    /// For an effect that a spec asks for.
    const MAIN: Self = Self { sought: 0.005, accepted: 0.05 };
    /// For a small effect whose size is random in any case.
    const ROUGH: Self = Self { sought: 0.25, accepted: 0.7 };
    /// For all small effects together.
    pub(crate) const TOGETHER: Self = Self { sought: 0.01, accepted: 0.05 };
}

/// Largest factor between the first strength and a strength that is tried, up or down.
const FARTHEST: f64 = 1e7;
const TRIALS: usize = 60;

impl Bench<'_> {
    /// Returns the same bench with another record.
    pub(crate) fn on<'b>(&'b self, planned: &'b Planned) -> Bench<'b> {
        Bench { planned, ..*self }
    }

    /// Returns the gap that an effect causes.
    pub(crate) fn gap_of_one(&self, effect: &Effect) -> Result<f64, GapError> {
        self.gap_of(&self.outputs(&[])?, std::slice::from_ref(effect))
    }

    /// Returns the effect at the strength that causes the gap `target`, and the gap that it causes.
    pub(crate) fn reach(&self, first: &Effect, target: f64) -> Result<(Effect, f64), GapError> {
        self.near(first, target, Goal::MAIN)
    }

    /// Returns the effect at about the strength that causes the gap, found in few trials. The search starts at the
    /// strength that would be right if the gap were proportional to it.
    pub(crate) fn roughly(&self, first: &Effect, target: f64) -> Result<(Effect, f64), GapError> {
        let unscaled = self.gap_of_one(first)?;
        let near = unscaled > 0.0 && unscaled.is_finite();
        let start = if near { first.strengthened(target / unscaled) } else { first.clone() };
        self.near(&start, target, Goal::ROUGH)
    }

    fn near(&self, first: &Effect, target: f64, goal: Goal) -> Result<(Effect, f64), GapError> {
        let (factor, gap) = self.search(target, goal, &|factor| vec![first.strengthened(factor)])?;
        let effect = first.strengthened(factor);
        let miss = (gap / target).ln().abs();
        // The gap of an effect that consists of whole events changes in steps, and the nearest step is the best there
        // is.
        if miss < goal.accepted || (!effect.foretold() && miss < 0.5) {
            return Ok((effect, gap));
        }
        Err(GapError::Unreachable { kind: effect.kind().to_owned(), target, nearest: gap })
    }

    /// Returns the gap that some effects cause. It is infinite if they make the structure unstable, or if they are
    /// too strong for their laws to make sense.
    fn gap_of(&self, linear: &Array2<f64>, effects: &[Effect]) -> Result<f64, GapError> {
        match self.with(effects) {
            Ok(y) => Ok(gap(linear, &y)),
            Err(TestbedError::Diverged { .. } | TestbedError::Effect { .. }) => Ok(f64::INFINITY),
            Err(other) => Err(other.into()),
        }
    }

    /// Returns the factor at which effects come nearest to the gap, and that gap. The search brackets the logarithm
    /// of the factor and then bisects it, with a secant step instead wherever that falls well inside the bracket.
    pub(crate) fn search(
        &self,
        target: f64,
        goal: Goal,
        effects: &dyn Fn(f64) -> Vec<Effect>,
    ) -> Result<(f64, f64), GapError> {
        let linear = self.outputs(&[])?;
        let at = |log: f64| self.gap_of(&linear, &effects(log.exp()));
        let mut best: (f64, f64) = (0.0, f64::INFINITY);
        let miss = |gap: f64| (gap / target).ln().abs();
        let (mut low, mut high) = (None, None);
        for _ in 0..TRIALS {
            if miss(best.1) < goal.sought {
                break;
            }
            let log = match (low, high) {
                (None, None) => 0.0,
                (Some((low, _)), None) => low + 1.2,
                (None, Some((high, _))) => high - 1.2,
                (Some((low, at_low)), Some((high, at_high))) => between((low, at_low), (high, at_high), target),
            };
            if log.abs() > FARTHEST.ln() {
                break;
            }
            let found = at(log)?;
            if miss(found) < miss(best.1) {
                best = (log, found);
            }
            if found < target {
                low = Some((log, found))
            } else {
                high = Some((log, found))
            }
            if let (Some((low, _)), Some((high, _))) = (low, high)
                && high - low < 1e-9
            {
                break;
            }
        }
        Ok((best.0.exp(), best.1))
    }

    fn with(&self, effects: &[Effect]) -> Result<Array2<f64>, TestbedError> {
        // Gains of one stand in for the preceding effects, so that these effects draw from the streams that they have
        // in the case.
        let mut list = vec![Effect::idle(); self.number];
        list.extend_from_slice(effects);
        self.outputs(&list)
    }

    fn outputs(&self, effects: &[Effect]) -> Result<Array2<f64>, TestbedError> {
        let config = with_effects(self.config, effects);
        config.check_for(self.truss.modes.len(), self.planned.end())?;
        let plant = altered(&config, self.truss);
        let outputs = record(&config, &plant, self.planned.commands.view(), self.planned.clock(), None)?.outputs;
        Ok(measured(outputs, self.measured))
    }
}

/// Returns the logarithm of the strength to try next.
fn between((low, at_low): (f64, f64), (high, at_high): (f64, f64), target: f64) -> f64 {
    let share = (target.ln() - at_low.ln()) / (at_high.ln() - at_low.ln());
    let share = if at_high.is_finite() && at_low > 0.0 && (0.02..0.98).contains(&share) { share } else { 0.5 };
    low + share * (high - low)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::gap::spec::GapSpec;
    use crate::gap::{config, excitation, plant, plants};
    use crate::streams::{Purpose, stream};

    /// A drift that leaves some stiffness at the end of the held-out record has a gap, and one that leaves none has
    /// not.
    #[test]
    fn a_drift_may_last_until_the_end_of_the_held_out_record() {
        let spec = GapSpec { length: 0.1, ..GapSpec::default() };
        let mut rng = stream(5, Purpose::Draw, plant::PLANT);
        let layout = plants::layout(spec.plant, &mut rng);
        let config = config(5, &spec, &layout.rig);
        let schedule = excitation::schedule(5, &spec, &layout.rig);
        let drawn = plant::drawn(&config, &spec, layout, &schedule, &mut rng);
        let planned = schedule.last().unwrap();
        let bench = Bench { config: &config, truss: &drawn.base, planned, measured: OUTPUTS, number: 0 };
        let gap = |end_s: f64| {
            let drift = json!({ "kind": "stiffness-drift", "rate_per_s": -1.0 / end_s });
            bench.gap_of_one(&serde_json::from_value(drift).unwrap()).unwrap()
        };
        let end_s = planned.end() as f64 / config.sample_rate_hz;
        assert!(gap(1.2 * end_s).is_finite());
        assert_eq!(gap(0.99 * end_s), f64::INFINITY);
    }
}
