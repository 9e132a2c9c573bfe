//! The next experiment: the one that is expected to separate the remaining explanations best.
//!
//! Each possible experiment with this setup is judged by each pair of the best explanation and a rival. The rival was
//! fitted to the prediction of the records by the best explanation (`separability.rs`). The rival is now fitted to
//! the prediction of the experiment, with the information of those records on its parameters as prior. The squared
//! norm of the whitened part that it cannot follow is twice the expected log likelihood ratio (Box and Hill 1967,
//! with the noise known).
//!
//! An experiment in which the free run of the best explanation or of a rival diverges is never proposed: its outcome
//! cannot be predicted, and it might damage the plant.

use nalgebra::DMatrix;
use plid_report::Cell;
use rayon::prelude::*;

use crate::case::record::{Excitation, Record};
use crate::fit::candidate::{all_same, in_words};
use crate::fit::problem::{Fit, Placed, Problem};
use crate::judge::experiments::{Experiment, experiments};
use crate::judge::explained::Explained;
use crate::judge::imagined::{Separation, imagined, known};
use crate::judge::separability::{Predicted, Rival, open};
use crate::judge::verdict::Weighted;
use crate::noise::NoiseModel;
use crate::settings::JudgeSettings;
use crate::words::likelihood;

/// Returns the next experiment in words with its predicted gain; `None` if no question is open.
pub fn next_experiment<'a>(
    explained: &Explained<'a>,
    weighted: &[Weighted<'a>],
    best: &[Placed],
    records: &Predicted<'a>,
    rivals: &[Rival<'a>],
) -> Option<String> {
    if weighted.len() < 2 {
        return None;
    }
    let settings = &records.problem.settings.judge;
    let mut fitted: Vec<Fit> = open(rivals, best, settings).map(|rival| rival.fit.clone()).collect();
    let most = fitted.len().max(settings.experiment_rivals);
    for likely in weighted.iter().filter(|w| !w.unknown && w.probability > settings.open_probability) {
        let effects: Vec<Placed> = likely.effects.iter().filter(|p| !p.effect.is_stochastic()).cloned().collect();
        let there = all_same(&effects, best) || fitted.iter().any(|fit| all_same(&fit.effects, &effects));
        if fitted.len() < most && !there {
            let compared = rivals.iter().find(|rival| all_same(&rival.effects, &effects));
            fitted.push(compared.map_or_else(|| records.fit(&effects), |rival| rival.fit.clone()));
        }
    }
    if fitted.is_empty() {
        let unknown = weighted.iter().find(|w| w.unknown).map_or(0.0, |w| w.probability);
        return (unknown > settings.open_unknown).then(|| by_rule(explained));
    }
    let asked = Asked::new(&records.problem, &explained.ready.noise, &records.truth, &fitted);
    let name = |effects: &[Placed]| in_words(effects, &records.problem.setting.names);
    let others: Vec<String> = fitted.iter().map(|fit| name(&fit.effects)).collect();
    Some(asked.proposal(&format!("{} from {}", name(best), others.join(" and from "))))
}

/// The explanations that an experiment should separate.
struct Asked<'q, 'a> {
    problem: &'q Problem,
    noise: &'q NoiseModel,
    best: &'q Fit<'a>,
    rivals: &'q [Fit<'a>],
    /// The information of the records on each rival's parameters.
    known: Vec<Option<DMatrix<f64>>>,
}

/// An experiment with the expected log likelihood ratio against the rival that it separates least.
struct Judged {
    gain: f64,
    experiment: Experiment,
}

impl<'q, 'a> Asked<'q, 'a> {
    fn new(problem: &'q Problem, noise: &'q NoiseModel, best: &'q Fit<'a>, rivals: &'q [Fit<'a>]) -> Self {
        let known = rivals.iter().map(|fit| known(problem, fit)).collect();
        Self { problem, noise, best, rivals, known }
    }

    fn settings(&self) -> &JudgeSettings {
        &self.problem.settings.judge
    }

    /// Returns the expected log likelihood ratio against the rival that an experiment separates least; `None` if a free
    /// run diverges.
    fn gain(&self, experiment: &Experiment) -> Option<f64> {
        let imagined = imagined(self.problem, self.noise, self.best, experiment)?;
        let mut least = f64::INFINITY;
        for (rival, known) in self.rivals.iter().zip(&self.known) {
            // If the records do not determine a rival's parameters, no gain can be promised.
            let Some(known) = known else { return Some(0.0) };
            match imagined.separation(&self.problem.nuisance, rival, known) {
                Separation::By(gain) => least = least.min(gain),
                Separation::Diverges => return None,
            }
        }
        Some(least)
    }

    /// Judges experiments and returns those without a diverging run, the best first. If several separate about as
    /// well as the best one, the simplest of them, which comes first in the list, is put first.
    fn judged(&self, experiments: Vec<Experiment>) -> Vec<Judged> {
        let one = |experiment: Experiment| Some(Judged { gain: self.gain(&experiment)?, experiment });
        let mut judged: Vec<Judged> = experiments.into_par_iter().filter_map(one).collect();
        let Some(most) = judged.iter().map(|judged| judged.gain).reduce(f64::max) else { return judged };
        let simplest = judged.iter().position(|judged| judged.gain * self.settings().experiment_better >= most);
        let first = judged.remove(simplest.unwrap_or(0));
        judged.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        judged.insert(0, first);
        judged
    }

    /// Returns the best experiment. The present sensors and the usual length are tried first, then a longer record,
    /// and then one more sensor at a declared port. `None` if a run diverges in every experiment that has an input.
    fn best(&self) -> Option<Judged> {
        let JudgeSettings { experiment_samples: samples, experiment_longer, experiment_best, separable, .. } =
            *self.settings();
        let mut all = self.judged(experiments(self.problem, samples));
        if all.first()?.gain > separable {
            return Some(all.swap_remove(0));
        }
        if all.iter().all(|judged| judged.experiment.excitation == Excitation::Zero) {
            return None;
        }
        let leading: Vec<String> = all.iter().take(experiment_best).map(|j| j.experiment.words.clone()).collect();
        let longer: Vec<Experiment> = experiments(self.problem, experiment_longer * samples)
            .into_iter()
            .filter(|experiment| leading.contains(&experiment.words))
            .collect();
        let sensed: Vec<Experiment> = longer.iter().flat_map(|experiment| self.with_sensors(experiment)).collect();
        for more in [longer, sensed] {
            let judged = self.judged(more).into_iter().next();
            if let Some(judged) = judged.filter(|judged| judged.gain > all[0].gain) {
                all.insert(0, judged);
            }
            if all[0].gain > separable {
                break;
            }
        }
        Some(all.swap_remove(0))
    }

    /// Returns an experiment with one more sensor at each declared port whose motion no output shows. The list is
    /// empty if an explanation has a mode whose shape at the new sensor is unknown, or if the error of the simulation
    /// at the new sensor is unknown.
    fn with_sensors(&self, experiment: &Experiment) -> Vec<Experiment> {
        let plant = &self.problem.plant;
        let all = || self.rivals.iter().chain([self.best]).flat_map(|fit| &fit.effects);
        if plant.modes.is_empty() || self.noise.model_error.is_some() || all().any(|p| p.effect.adds_mode()) {
            return Vec::new();
        }
        let lacking = (0..plant.ports.len()).filter(|&port| plant.lacks_sensor(port));
        lacking.map(|port| experiment.with_sensor(port, &plant.ports[port].name)).collect()
    }

    /// States the best experiment. `from` names the explanations that the experiment distinguishes.
    fn proposal(&self, from: &str) -> String {
        let Some(Judged { gain, experiment }) = self.best() else {
            return format!(
                "No experiment that was tested to distinguish {from} is safe to propose: in each, the free run of one \
                of these explanations diverges."
            );
        };
        let samples = experiment.u.first().map_or(0, Vec::len);
        let seconds = Cell::significant(samples as f64 / self.problem.plant.rate, 3);
        let words = &experiment.words;
        let separable = self.settings().separable;
        if gain > separable {
            return format!(
                "{words}: {samples} samples ({seconds} s) are expected to distinguish {from} by {}.",
                likelihood(gain)
            );
        }
        let longest = self.settings().experiment_longer * self.settings().experiment_samples;
        format!(
            "No tested experiment of up to {longest} samples distinguishes {from}, whether without input, with the \
            input of the loudest record at other levels, with each input alone, with a multisine or with a chirp. The \
            best gives {gain:.1} in log likelihood, where {separable:.0} is needed ({words}): a sensor or an input at \
            another location is necessary."
        )
    }
}

/// Proposes an experiment by rule: if the cause is outside the vocabulary, no model predicts its behaviour elsewhere.
fn by_rule(explained: &Explained) -> String {
    let records = &explained.ready.problem.records;
    let levels = records.iter().filter(|r| r.is_driven()).map(Record::level);
    let (least, most) = levels.fold((f64::INFINITY, 0.0_f64), |(a, b), x| (a.min(x), b.max(x)));
    let mut wanted = Vec::new();
    if most < 2.0 * least {
        wanted.push("the same random input at a third and at twice the level, interleaved");
    }
    if records.iter().all(|r| !matches!(r.excitation, Excitation::Periodic(_))) {
        wanted.push(
            "a random-phase multisine of odd lines over six periods or more, whose even and omitted lines show the \
            kind of nonlinearity",
        );
    }
    if records.iter().all(|r| r.excitation != Excitation::Zero) {
        wanted.push("a record without input");
    }
    if explained.ready.problem.plant.m > 1 {
        wanted.push("each input alone at the highest level");
    }
    if wanted.is_empty() {
        wanted
            .push("a sine at the frequency where most of the gap lies, at several levels: its harmonics show the kind");
    }
    format!(
        "Nothing in the vocabulary explains the remainder. To identify it, the next records should be {}.",
        wanted.join(", then ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Clearance, CubicStiffness, Effect, Place, SensorDrift, SensorOffset};
    use crate::prepare::{Known, Prepared, prepare};
    use crate::testing;

    fn ready() -> Prepared {
        let model = testing::truss(8);
        let case = testing::case(&model, &model);
        prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap()
    }

    fn fit<'a>(problem: &Problem, effect: &'a dyn Effect, place: Place, parameters: &[f64]) -> Fit<'a> {
        let effects = vec![Placed { effect, place, parameters: parameters.to_vec() }];
        let eta = vec![0.0; problem.nuisance.len()];
        let residual = problem.residual(&problem.plant, &eta, &effects, crate::simulate::Fineness::COARSE);
        let covariance = DMatrix::zeros(parameters.len(), parameters.len());
        Fit { eta, effects, cost: 0.0, residual, covariance, converged: true }
    }

    /// Returns a fit with a cubic stiffness at the first input, whose stiffness at the RMS of the motion is this
    /// share of the static one.
    fn cubic(problem: &Problem, share: f64) -> Fit<'static> {
        let setting = &problem.setting;
        fit(problem, &CubicStiffness, Place::Input(0), &[share * setting.stiffness[0] / setting.d_rms[0].powi(2)])
    }

    fn of_words(problem: &Problem, words: &str) -> Experiment {
        let mut all = experiments(problem, problem.settings.judge.experiment_samples).into_iter();
        all.find(|experiment| experiment.words.contains(words)).unwrap_or_else(|| panic!("no {words}"))
    }

    /// A softening spring tears the structure apart at four times the level. Such an experiment is never proposed,
    /// whether the softening spring is the rival or the best explanation.
    #[test]
    fn an_experiment_in_which_an_explanation_diverges_is_not_proposed() {
        let ready = ready();
        let problem = &ready.problem;
        let (stiff, soft) = (cubic(problem, 1e-4), [cubic(problem, -0.01)]);
        let asked = Asked::new(problem, &ready.noise, &stiff, &soft);
        let [once, four] = ["once more", "four times"].map(|words| of_words(problem, words));
        assert!(asked.gain(&once).is_some_and(|gain| gain > 5.0), "{:?}", asked.gain(&once));
        assert_eq!(asked.gain(&four), None);
        let imagined = imagined(problem, &ready.noise, &stiff, &four).unwrap();
        let known = asked.known[0].as_ref().unwrap();
        assert_eq!(imagined.separation(&problem.nuisance, &soft[0], known), Separation::Diverges);
        let judged = asked.judged(experiments(problem, problem.settings.judge.experiment_samples));
        assert!(!judged.is_empty() && judged.iter().all(|judged| !judged.experiment.words.contains("four times")));
        let [stiff] = [[stiff]];
        assert_eq!(Asked::new(problem, &ready.noise, &soft[0], &stiff).gain(&four), None);
        let apart = [cubic(problem, -1.0)];
        let said = Asked::new(problem, &ready.noise, &apart[0], &stiff).proposal("a from b");
        assert!(said.starts_with("No experiment that was tested to distinguish a from b is safe"), "{said}");
    }

    /// An offset and a drift differ even without input. The smaller drift requires the longer record.
    #[test]
    fn a_quiet_record_is_proposed_and_is_as_long_as_it_has_to_be() {
        let ready = ready();
        let problem = &ready.problem;
        let proposed = |drift: f64| {
            let best = fit(problem, &SensorDrift, Place::Output(0), &[drift]);
            let middle = 0.5 * problem.setting.duration_s * drift;
            let rival = [fit(problem, &SensorOffset, Place::Output(0), &[middle])];
            let asked = Asked::new(problem, &ready.noise, &best, &rival);
            (asked.gain(&of_words(problem, "without input")).unwrap(), asked.proposal("a drift from an offset"))
        };
        let (gain, _) = proposed(1e-5);
        // The expected gain grows with the square of the drift.
        let (short, long) = (1e-5 * (20.0 / gain).sqrt(), 1e-5 * (3.0 / gain).sqrt());
        let said = proposed(short).1;
        assert!(
            said.starts_with("Record without input: 2000 samples (1.25 s) are expected to distinguish a"),
            "{said}"
        );
        let said = proposed(long).1;
        assert!(said.starts_with("Record without input: 8000 samples (5.00 s) are expected"), "{said}");
    }

    /// If all records are slow, their inputs do not excite the resonances at any level, but a multisine or a chirp
    /// does.
    #[test]
    fn a_signal_that_reaches_the_modes_is_proposed_where_the_records_do_not() {
        let mut ready = ready();
        for record in &mut ready.problem.records {
            for u in &mut record.u {
                let held: Vec<f64> = (0..u.len()).map(|k| u[k / 200]).collect();
                u.copy_from_slice(&held);
            }
        }
        let problem = &ready.problem;
        let best = cubic(problem, 1e-3);
        let start = &Clearance.starts(&problem.setting, &Place::Input(0))[0];
        let rival = [fit(problem, &Clearance, Place::Input(0), start)];
        let said = Asked::new(problem, &ready.noise, &best, &rival).proposal("a from b");
        assert!(said.contains("multisine") || said.contains("chirp"), "{said}");
        assert!(said.contains("from 29.0 to 304 Hz on all inputs"), "{said}");
    }

    /// A sensor at a port that no output shows separates two explanations better.
    #[test]
    fn a_sensor_at_a_declared_port_tells_more() {
        let ready = ready();
        let problem = &ready.problem;
        let start = Clearance.starts(&problem.setting, &Place::Input(0)).remove(0);
        let (best, rival) = (cubic(problem, 1e-4), [fit(problem, &Clearance, Place::Input(0), &start)]);
        let mut asked = Asked::new(problem, &ready.noise, &best, &rival);
        // The records contain almost no information on the rival, so it can follow as far as its shape allows.
        asked.known = vec![asked.known[0].clone().map(|known| known * 1e-6)];
        let loud = of_words(problem, "four times");
        let more = asked.with_sensors(&loud);
        let words: Vec<&str> = more.iter().map(|experiment| experiment.words.as_str()).collect();
        assert!(words.len() == 2 && words[0].ends_with("with one more sensor at port:strut1"), "{words:?}");
        let (plain, with) = (asked.gain(&loud).unwrap(), asked.gain(&more[0]).unwrap());
        assert!(with > 1.2 * plain, "{with} {plain}");
    }
}
