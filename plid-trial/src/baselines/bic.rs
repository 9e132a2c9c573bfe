//! BIC alone, as a textbook selects a model: effects of the full vocabulary are added one by one, as long as BIC
//! falls. Each stage screens every effect at every place on the first samples of the records and fits the most
//! promising ones there. The best of these fits are continued on whole records, and only models that were fitted to
//! whole records are compared. There is no test of whether the best model is adequate, no probability for causes
//! outside the vocabulary, and no reference effect.
//!
//! The cost is bounded, whatever the case: there are at most [`MOST`] stages, each with one screen, [`FITTED`] fits to
//! first samples and [`CONTINUED`] fits to whole records, and then the last steps of [`SETTLED`] fits. Every one of
//! these fits has a limited number of steps.

use plid_gap::GapError;
use plid_gap::case::Case;
use plid_gap::effects::Library;
use plid_gap::research::{
    Base, Effort, Fineness, Fit, Placed, Problem, REFIT_STEPS, Refit, audit, leading, polish, prepare, refit, screen,
};

use super::weights::{at_work, schwarz};
use crate::judge::{Candidate, Claim, Named};

/// Largest number of effects in a model, the same as in an explanation.
const MOST: usize = 3;

/// Largest number of effects that are fitted in a stage. The screen ranks them by their gain to first order.
const FITTED: usize = 10;

/// Largest number of these fits that are continued on whole records, the same as in a diagnosis.
const CONTINUED: usize = 4;

/// Number of the best models whose fits take their last steps before BIC decides between all models.
const SETTLED: usize = 3;

/// The effort of the fits to first samples, which is that of the first fits of a diagnosis.
const QUICK: Effort = Effort { steps: 8, gain: 0.5, fineness: Fineness::COARSE };

/// A case with a simulation, prepared for answers.
pub(super) struct Asked {
    /// Its records.
    whole: Problem,
    /// The first samples of its records, as a diagnosis chooses them.
    heads: Problem,
    /// The model without effects.
    refitted: Refit,
    /// Names of the effects that the case excludes.
    excluded: Vec<String>,
}

/// Tells whether an effect at a place is left out.
type LeftOut<'l> = dyn Fn(&Placed) -> bool + Sync + 'l;

impl Asked {
    pub(super) fn new(case: &Case, library: &Library, say: &mut dyn FnMut(String)) -> Result<Self, GapError> {
        let audit = audit(case, library, &[], say)?;
        let model = audit.case.model.as_ref().expect("an audited case has a simulation");
        let ready = prepare(model, &audit.case.records, &audit.known)?;
        let refitted = refit(&ready.problem, REFIT_STEPS);
        let heads = ready.problem.head(leading(&ready.problem, &refitted), &ready.noise);
        Ok(Self { whole: ready.problem, heads, refitted, excluded: audit.case.config.exclude })
    }

    /// Answers the case without some effects of the vocabulary.
    pub(super) fn claim(&self, library: &Library, without: &[String], say: &mut dyn FnMut(String)) -> Claim {
        let excluded = |placed: &Placed| self.excluded.iter().chain(without).any(|name| name == placed.effect.name());
        let models = self.models(library, &excluded, say);
        let candidates = schwarz(models.iter().map(|fit| (bic(&self.whole, fit), self.candidate(fit))).collect());
        let Some(first) = candidates.first() else { return Claim::missing() };
        let sure = |named: &Named| Named { confidence: Some(at_work(&candidates, named)), ..named.clone() };
        let effects: Vec<Named> = first.effects.iter().map(sure).collect();
        let verdict = if effects.is_empty() { "none" } else { "effects" };
        Claim { verdict: verdict.to_owned(), effects, candidates, ..Claim::default() }
    }

    /// Returns all models that were fitted to whole records, the best ones with the last steps of their fits.
    fn models<'a>(&self, library: &'a Library, excluded: &LeftOut<'_>, say: &mut dyn FnMut(String)) -> Vec<Fit<'a>> {
        let by_bic = |a: &Fit, b: &Fit| bic(&self.whole, a).total_cmp(&bic(&self.whole, b));
        let mut best = self.refitted.as_fit();
        let mut all = vec![best.clone()];
        for stage in 1..=MOST {
            let fits = self.further(library, &best, excluded);
            let next = fits.iter().min_by(|a, b| by_bic(a, b)).cloned();
            say(self.progress(stage, &fits, &best));
            all.extend(fits);
            match next {
                Some(next) if by_bic(&next, &best).is_lt() => best = next,
                _ => break,
            }
        }
        all.sort_by(by_bic);
        all.iter_mut().take(SETTLED).for_each(|fit| *fit = self.whole.settled(fit));
        say(format!("BIC: last steps of the best {} models", SETTLED.min(all.len())));
        all
    }

    /// Returns the fits to whole records of the best models with one further effect.
    fn further<'a>(&self, library: &'a Library, best: &Fit<'a>, excluded: &LeftOut<'_>) -> Vec<Fit<'a>> {
        let heads = &self.heads;
        let plant = heads.nuisance.apply(&heads.plant, &best.eta);
        let jacobian = heads.jacobian(&plant);
        let residual = heads.residual(&plant, &best.eta, &best.effects, Fineness::COARSE);
        let base = Base {
            problem: heads,
            jacobian: &jacobian,
            plant: &plant,
            eta: &best.eta,
            effects: &best.effects,
            residual: &residual,
            bold: false,
            sized: false,
        };
        let is_there = |placed: &Placed| {
            let same = |e: &Placed| e.effect.name() == placed.effect.name() && e.place == placed.place;
            excluded(placed) || best.effects.iter().any(same)
        };
        let entries = screen(&base, library, is_there);
        let promising = entries.into_iter().take(FITTED).filter(|entry| entry.gain > 0.0);
        let mut fits: Vec<Fit> = promising
            .map(|entry| heads.fit(&jacobian, &best.eta, &[&best.effects[..], &[entry.placed]].concat(), QUICK))
            .filter(|fit| fit.cost.is_finite())
            .collect();
        fits.sort_by(|a, b| bic(heads, a).total_cmp(&bic(heads, b)));
        fits.truncate(CONTINUED);
        let continued = fits.into_iter().map(|fit| polish(&self.whole, fit));
        continued.filter(|fit| fit.cost.is_finite()).collect()
    }

    /// Returns a line on a stage: the change of BIC by each model that was fitted to whole records.
    fn progress(&self, stage: usize, fits: &[Fit], best: &Fit) -> String {
        let one = |fit: &Fit| {
            let last = fit.effects.last().expect("a stage adds an effect");
            let change = bic(&self.whole, fit) - bic(&self.whole, best);
            format!("{} at {} ({change:+.0})", last.effect.name(), last.place.location(&self.whole.setting.names))
        };
        let fits: Vec<String> = fits.iter().map(one).collect();
        format!("BIC, stage {stage}: on whole records {}", fits.join(", "))
    }

    fn candidate(&self, fit: &Fit) -> Candidate {
        let named = |placed: &Placed| Named {
            effect: placed.effect.name().to_owned(),
            location: placed.place.location(&self.whole.setting.names),
            ..Named::default()
        };
        Candidate { effects: fit.effects.iter().map(named).collect(), ..Candidate::default() }
    }
}

/// Returns the BIC of a model, apart from what all models have in common.
fn bic(problem: &Problem, fit: &Fit) -> f64 {
    fit.cost + (problem.rows() as f64).ln() * fit.parameters() as f64
}

#[cfg(test)]
mod tests {
    use plid_gap::case::{CaseConfig, Excitation, Record};
    use plid_model::Model;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha12Rng;
    use serde_json::json;

    use super::*;

    /// Returns a case with records of a mode at 35 Hz whose sensor has this gain and this offset, with noise.
    fn case(gain: f64, offset: f64) -> Case {
        case_of(2000, |_, _, y| gain * y + offset)
    }

    /// Returns a case with records of a mode at 35 Hz with noise. `sensor` gives the output for the number of the
    /// record, that of the sample, and the output without a fault.
    fn case_of(samples: usize, sensor: impl Fn(usize, usize, f64) -> f64) -> Case {
        let (radius, (sin, cos)) = (0.985, 0.55_f64.sin_cos());
        let text = json!({
            "format": "state-space", "sample_rate_hz": 400.0, "inputs": ["u1"], "outputs": ["y1"],
            "A": [[radius * cos, radius * sin], [-radius * sin, radius * cos]], "B": [[0.0], [1.0]],
            "C": [[1.0, 0.0]], "D": [[0.0]], "noise": { "sensor_std": [0.05] },
        });
        let mut rng = ChaCha12Rng::seed_from_u64(9);
        let mut one = |k: usize| {
            let u: Vec<f64> = (0..samples).map(|_| if k == 0 { 0.0 } else { rng.random_range(-1.0..1.0) }).collect();
            let mut x = [0.0, 0.0];
            let step = |(at, u): (usize, &f64)| {
                let y = sensor(k, at, x[0]) + 0.05 * 3f64.sqrt() * rng.random_range(-1.0..1.0);
                x = [radius * (cos * x[0] + sin * x[1]), radius * (cos * x[1] - sin * x[0]) + u];
                y
            };
            let y = u.iter().enumerate().map(step).collect();
            let excitation = if k == 0 { Excitation::Zero } else { Excitation::Random };
            let (name, start_s) = (format!("r{k}"), (samples * k) as f64 / 400.0);
            let (u, y) = (vec![u], vec![y]);
            Record { name, excitation, from_rest: true, start_s, held_out: k == 4, u, y, simulated: None }
        };
        let records = (0..5).map(&mut one).collect();
        let config = CaseConfig::new(400.0, vec!["u1".into()], vec!["y1".into()]);
        let model = Some(Model::from_json(&text, "here").unwrap());
        Case { config, model, controller: None, records, for_simulation: Vec::new(), warnings: Vec::new() }
    }

    #[test]
    fn effects_are_added_as_long_as_bic_falls() {
        let library = Library::standard();
        let names = |gain: f64, offset: f64| -> Vec<String> {
            let claim =
                Asked::new(&case(gain, offset), &library, &mut |_| {}).unwrap().claim(&library, &[], &mut |_| {});
            let all: f64 = claim.candidates.iter().filter_map(|c| c.probability).sum();
            assert!((all - 1.0).abs() < 1e-9 && claim.candidates.iter().all(|c| !c.unknown));
            assert!(claim.effects.iter().all(|e| e.confidence.is_some_and(|p| p > 0.0)));
            claim.effects.into_iter().map(|e| e.effect).collect()
        };
        assert!(names(1.0, 0.0).is_empty());
        assert_eq!(names(1.0, 0.4), ["sensor-offset"]);
        let both = names(1.3, 0.4);
        assert!(both.iter().any(|name| name == "sensor-offset") && both.len() > 1, "{both:?}");
        let asked = Asked::new(&case(1.0, 0.4), &library, &mut |_| {}).unwrap();
        let reduced = asked.claim(&library, &["sensor-offset".into()], &mut |_| {});
        assert!(reduced.candidates.iter().flat_map(|c| &c.effects).all(|e| e.effect != "sensor-offset"));
    }

    /// A small offset of the sensor begins after the first samples. These do not show it, and whole records do.
    #[test]
    fn whole_records_decide() {
        let library = Library::standard().only(&["sensor-offset"]);
        let late = |k: usize, at: usize, y: f64| if k > 0 && at >= 2000 { y + 0.015 } else { y };
        let asked = Asked::new(&case_of(6000, late), &library, &mut |_| {}).unwrap();
        assert_eq!(asked.heads.records[0].samples(), 2000);
        let mut said = Vec::new();
        let claim = asked.claim(&library, &[], &mut |line| said.push(line));
        assert_eq!((claim.effects.len(), claim.candidates.len()), (1, 2), "{said:?}");
        assert_eq!(claim.effects[0].effect, "sensor-offset");
        assert!(said.iter().any(|line| line.contains("on whole records sensor-offset at output:y1 (-")), "{said:?}");
    }
}
