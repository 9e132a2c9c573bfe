//! BIC alone, as a textbook selects a model: effects of the full vocabulary are added one by one, as long as BIC
//! falls. Each stage screens every effect at every place and fits the most promising ones. There is no test of
//! whether the best model is adequate, no probability for causes outside the vocabulary, and no reference effect.

use plid_gap::GapError;
use plid_gap::case::Case;
use plid_gap::effects::Library;
use plid_gap::research::{
    Base, Effort, Fineness, Fit, Jacobian, Placed, Problem, REFIT_STEPS, audit, prepare, refit, screen,
};

use super::weights::{at_work, schwarz};
use crate::judge::{Candidate, Claim, Named, Stated};

/// Largest number of effects in a model, the same as in an explanation.
const MOST: usize = 3;

/// Largest number of effects that are fitted in a stage. The screen ranks them by their gain to first order.
const FITTED: usize = 10;

/// The effort of these fits, which is that of the first fits of a diagnosis.
const QUICK: Effort = Effort { steps: 8, gain: 0.5, fineness: Fineness::COARSE };

/// A case with a simulation, prepared for answers.
pub(super) struct Asked {
    /// The first samples of its records.
    heads: Problem,
    /// Names of the effects that the case excludes.
    excluded: Vec<String>,
}

impl Asked {
    pub(super) fn new(case: &Case, library: &Library) -> Result<Self, GapError> {
        let audit = audit(case, library, &[], &mut |_| {})?;
        let model = audit.case.model.as_ref().expect("an audited case has a simulation");
        let ready = prepare(model, &audit.case.records, &audit.known)?;
        let heads = ready.problem.head(ready.problem.settings.search.first_samples, &ready.noise);
        Ok(Self { heads, excluded: audit.case.config.exclude })
    }

    /// Answers the case without some effects of the vocabulary.
    pub(super) fn claim(&self, library: &Library, without: &[String]) -> Claim {
        let excluded = |placed: &Placed| self.excluded.iter().chain(without).any(|name| name == placed.effect.name());
        let candidates = candidates(&self.heads, library, &excluded);
        let Some(first) = candidates.first() else { return Claim::missing() };
        let sure = |named: &Named| Named { confidence: Some(at_work(&candidates, named)), ..named.clone() };
        let effects: Vec<Named> = first.effects.iter().map(sure).collect();
        let verdict = if effects.is_empty() { "none" } else { "effects" };
        Claim { verdict: verdict.to_owned(), effects, candidates, gap: Stated::default() }
    }
}

/// Returns all models that were fitted, with their weights.
fn candidates(problem: &Problem, library: &Library, excluded: &(dyn Fn(&Placed) -> bool + Sync)) -> Vec<Candidate> {
    let per_parameter = (problem.rows() as f64).ln();
    let bic = |fit: &Fit| fit.cost + per_parameter * fit.parameters() as f64;
    let named = |placed: &Placed| Named {
        effect: placed.effect.name().to_owned(),
        location: placed.place.location(&problem.setting.names),
        ..Named::default()
    };
    let model =
        |fit: &Fit| (bic(fit), Candidate { effects: fit.effects.iter().map(named).collect(), ..Candidate::default() });
    let mut best = refit(problem, REFIT_STEPS).as_fit();
    let mut models = vec![model(&best)];
    for _ in 0..MOST {
        let fits = further(problem, library, &best, excluded);
        models.extend(fits.iter().map(model));
        match fits.into_iter().min_by(|a, b| bic(a).total_cmp(&bic(b))) {
            Some(next) if bic(&next) < bic(&best) => best = next,
            _ => break,
        }
    }
    schwarz(models)
}

/// Returns the fits of a model with one further effect.
fn further<'a>(
    problem: &Problem,
    library: &'a Library,
    best: &Fit<'a>,
    excluded: &(dyn Fn(&Placed) -> bool + Sync),
) -> Vec<Fit<'a>> {
    let plant = problem.nuisance.apply(&problem.plant, &best.eta);
    let jacobian: Jacobian = problem.jacobian(&plant);
    let base = Base {
        problem,
        jacobian: &jacobian,
        plant: &plant,
        eta: &best.eta,
        effects: &best.effects,
        residual: &best.residual,
        bold: false,
        sized: false,
    };
    let is_there = |placed: &Placed| {
        let same = |e: &Placed| e.effect.name() == placed.effect.name() && e.place == placed.place;
        excluded(placed) || best.effects.iter().any(same)
    };
    let entries = screen(&base, library, is_there);
    let promising = entries.into_iter().take(FITTED).filter(|entry| entry.gain > 0.0);
    promising
        .map(|entry| problem.fit(&jacobian, &best.eta, &[&best.effects[..], &[entry.placed]].concat(), QUICK))
        .collect()
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
        let (radius, (sin, cos)) = (0.985, 0.55_f64.sin_cos());
        let text = json!({
            "format": "state-space", "sample_rate_hz": 400.0, "inputs": ["u1"], "outputs": ["y1"],
            "A": [[radius * cos, radius * sin], [-radius * sin, radius * cos]], "B": [[0.0], [1.0]],
            "C": [[1.0, 0.0]], "D": [[0.0]], "noise": { "sensor_std": [0.05] },
        });
        let mut rng = ChaCha12Rng::seed_from_u64(9);
        let mut one = |k: usize| {
            let u: Vec<f64> = (0..2000).map(|_| if k == 0 { 0.0 } else { rng.random_range(-1.0..1.0) }).collect();
            let mut x = [0.0, 0.0];
            let step = |u: &f64| {
                let y = gain * x[0] + offset + 0.05 * 3f64.sqrt() * rng.random_range(-1.0..1.0);
                x = [radius * (cos * x[0] + sin * x[1]), radius * (cos * x[1] - sin * x[0]) + u];
                y
            };
            let y = u.iter().map(step).collect();
            let excitation = if k == 0 { Excitation::Zero } else { Excitation::Random };
            let (name, start_s) = (format!("r{k}"), 5.0 * k as f64);
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
            let claim = Asked::new(&case(gain, offset), &library).unwrap().claim(&library, &[]);
            let all: f64 = claim.candidates.iter().filter_map(|c| c.probability).sum();
            assert!((all - 1.0).abs() < 1e-9 && claim.candidates.iter().all(|c| !c.unknown));
            assert!(claim.effects.iter().all(|e| e.confidence.is_some_and(|p| p > 0.0)));
            claim.effects.into_iter().map(|e| e.effect).collect()
        };
        assert!(names(1.0, 0.0).is_empty());
        assert_eq!(names(1.0, 0.4), ["sensor-offset"]);
        let both = names(1.3, 0.4);
        assert!(both.iter().any(|name| name == "sensor-offset") && both.len() > 1, "{both:?}");
        let reduced = Asked::new(&case(1.0, 0.4), &library).unwrap().claim(&library, &["sensor-offset".into()]);
        assert!(reduced.candidates.iter().flat_map(|c| &c.effects).all(|e| e.effect != "sensor-offset"));
    }
}
