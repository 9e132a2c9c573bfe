//! A test of whether a change over time follows the time or the level.
//!
//! Records are often taken at successive levels. A stiffness that falls with the level then looks like one that
//! drifts: it is smaller in each record than in the one before. But a drift continues within each record, and a
//! change that depends on the level does not. So an effect that changes with time is fitted once more with a size
//! that is constant within each record: the size in the middle of the record. If this fit explains the records
//! better, the effect does not follow the time.

use std::sync::Arc;

use crate::case::record::Record;
use crate::effects::{Action, Command, Drive, Effect, Memory, Parameter, Place, Setting, Side};
use crate::fit::candidate::in_words;
use crate::fit::problem::{Effort, Fit, Placed, Problem};
use crate::fit::refit::Refit;
use crate::simulate::Fineness;

/// Effort of the fits that are compared.
const COMPARED: Effort = Effort { steps: 6, gain: 1.0, fineness: Fineness::COARSE };

/// A change over time that does not follow the time.
pub(crate) struct NotOfTime {
    /// The name of its effect.
    pub effect: String,
    /// The effect and its place in words.
    pub words: String,
}

/// Returns the first effect of an explanation that changes with time, but not within the records. Records of a single
/// level cannot decide this, because the plant may have changed between two of them.
pub(crate) fn not_of_time(problem: &Problem, refitted: &Refit, best: &Fit) -> Option<NotOfTime> {
    let levels: Vec<f64> = problem.records.iter().filter(|r| r.is_driven()).map(Record::level).collect();
    let [low, high] = levels.iter().fold([f64::INFINITY, 0.0], |[low, high], &x| [low.min(x), x.max(high)]);
    if !(high > problem.settings.case.same_level * low) {
        return None;
    }
    let spans: Arc<[[f64; 2]]> =
        problem.records.iter().map(|r| [r.start_s, r.start_s + r.samples() as f64 / problem.plant.rate]).collect();
    let cost = |effects: &[Placed]| problem.fit(&refitted.jacobian, &best.eta, effects, COMPARED).cost;
    let mut steady = None;
    let refuted = (0..best.effects.len()).filter(|&k| best.effects[k].effect.side() == Side::Time).find(|&k| {
        let by_record = ByRecord { effect: best.effects[k].effect, spans: spans.clone() };
        let mut effects: Vec<Placed> = best.effects.clone();
        effects[k].effect = &by_record;
        let gain = *steady.get_or_insert_with(|| cost(&best.effects)) - cost(&effects);
        gain > problem.settings.search.by_record_gain
    })?;
    let placed = &best.effects[refuted];
    let words = in_words(std::slice::from_ref(placed), &problem.setting.names);
    Some(NotOfTime { effect: placed.effect.name().into(), words })
}

/// An effect with the size that it has in the middle of each record.
struct ByRecord<'e> {
    effect: &'e dyn Effect,
    /// Start and end of each record in s.
    spans: Arc<[[f64; 2]]>,
}

/// Returns the middle of the record to which a time belongs.
fn middle(spans: &[[f64; 2]], t: f64) -> f64 {
    spans.iter().find(|[start, end]| (*start..*end).contains(&t)).map_or(t, |[start, end]| 0.5 * (start + end))
}

impl Effect for ByRecord<'_> {
    fn name(&self) -> &'static str {
        self.effect.name()
    }

    fn side(&self) -> Side {
        self.effect.side()
    }

    fn equation(&self) -> &'static str {
        self.effect.equation()
    }

    fn parameters(&self, setting: &Setting) -> Vec<Parameter> {
        self.effect.parameters(setting)
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        self.effect.places(setting)
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        self.effect.starts(setting, place)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let constant = |action: Action| match action {
            Action::Stiffness(of) => {
                let spans = self.spans.clone();
                Action::Stiffness(Box::new(move |t| of(middle(&spans, t))))
            }
            Action::Command(command) => {
                Action::Command(Box::new(ConstantCommand { command, spans: self.spans.clone() }))
            }
            other => other,
        };
        self.effect.act(setting, place, parameters).into_iter().map(constant).collect()
    }
}

/// A change of the command that depends on time alone, evaluated in the middle of the record.
struct ConstantCommand {
    command: Box<dyn Command>,
    spans: Arc<[[f64; 2]]>,
}

impl Command for ConstantCommand {
    fn apply(&self, drive: &mut Drive, memory: &mut Memory) {
        let (rate, t0) = (drive.rate, drive.t0);
        // With an infinite rate, no time passes within the record.
        (drive.rate, drive.t0) = (f64::INFINITY, middle(&self.spans, t0));
        self.command.apply(drive, memory);
        (drive.rate, drive.t0) = (rate, t0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{ActuatorGainDrift, StiffnessDrift};
    use crate::fit::refit::{STEPS, refit};
    use crate::prepare::{Known, prepare};
    use crate::simulate::simulate;
    use crate::testing;

    /// Returns the effect that is refuted, if any. The true change is constant within each record if `by_record` is
    /// true; otherwise it is continuous.
    fn refuted(effect: &'static dyn Effect, place: Place, r: f64, by_record: bool) -> Option<String> {
        let model = testing::truss(8);
        let case = testing::case(&model, &model);
        let mut records = case.records.clone();
        let ready = prepare(&model, &records, &Known::default()).unwrap();
        let problem = &ready.problem;
        let end = |r: &Record| r.start_s + r.samples() as f64 / problem.plant.rate;
        let spans: Arc<[[f64; 2]]> = records.iter().map(|r| [r.start_s, end(r)]).collect();
        let changed = ByRecord { effect, spans };
        let truth: &dyn Effect = if by_record { &changed } else { effect };
        let actions = truth.act(&problem.setting, &place, &[r]);
        for record in &mut records {
            let run =
                |actions: &[Action]| simulate(&problem.plant, actions, &record.u, record.start_s, None, Fineness::FINE);
            let (with, without) = (run(&actions), run(&[]));
            for ((y, with), without) in record.y.iter_mut().zip(&with).zip(&without) {
                y.iter_mut().zip(with).zip(without).for_each(|((y, with), without)| *y += with - without);
            }
        }
        let ready = prepare(&model, &records, &Known::default()).unwrap();
        let problem = &ready.problem;
        let refitted = refit(problem, STEPS);
        let effects = vec![Placed { effect, place, parameters: vec![r] }];
        let best = problem.fit(&refitted.jacobian, &refitted.eta, &effects, COMPARED);
        not_of_time(problem, &refitted, &best).map(|found| found.effect)
    }

    /// A change within the records is accepted as a drift; a change only from one record to the next is not.
    #[test]
    fn a_change_that_is_constant_within_each_record_is_no_drift() {
        let cases: [(&'static dyn Effect, Place); 2] =
            [(&StiffnessDrift, Place::Structure), (&ActuatorGainDrift, Place::Input(0))];
        for (effect, place) in cases {
            assert_eq!(refuted(effect, place.clone(), 0.01, false), None, "{}", effect.name());
            let found = refuted(effect, place, 0.01, true);
            assert_eq!(found.as_deref(), Some(effect.name()));
        }
    }
}
