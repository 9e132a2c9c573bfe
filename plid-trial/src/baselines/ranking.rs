//! BIC alone: the candidates fitted by the diagnosis, ranked by BIC. There is no test of whether the best one is
//! adequate, no probability for causes outside the vocabulary, and no reference effect.

use plid_gap::answer::schema::{Diagnosis, Explanation};
use plid_gap::effects::{Library, Setting};

use super::weights::{at_work, schwarz};
use crate::judge::{Candidate, Claim, Named, Stated};

pub(super) fn claim(diagnosis: &Diagnosis, rows: f64, library: &Library, setting: &Setting) -> Claim {
    let parameters = |name: &str| library.get(name).map_or(1, |effect| effect.parameters(setting).len());
    // The gap that a fit leaves, over that of noise, is the root of its squared residual a row.
    let bic = |e: &Explanation| -> Option<f64> {
        let misfit = (e.gap_after? / diagnosis.gap.noise_floor).powi(2);
        let count: usize = e.effects.iter().map(|located| parameters(&located.effect)).sum();
        Some(rows * misfit + count as f64 * rows.ln())
    };
    let name = |located: &plid_gap::answer::schema::Located| Named {
        effect: located.effect.clone(),
        location: located.location.clone(),
        ..Named::default()
    };
    let of = |e: &Explanation| Candidate { effects: e.effects.iter().map(name).collect(), ..Candidate::default() };
    let known = diagnosis.candidates.iter().filter(|e| !e.unknown);
    let candidates = schwarz(known.filter_map(|e| Some((bic(e)?, of(e)))).collect());
    let Some(first) = candidates.first() else { return Claim::missing() };
    let sure = |named: &Named| Named { confidence: Some(at_work(&candidates, named)), ..named.clone() };
    let effects: Vec<Named> = first.effects.iter().map(sure).collect();
    let verdict = if effects.is_empty() { "none" } else { "effects" };
    Claim { verdict: verdict.to_owned(), effects, candidates, gap: Stated::default() }
}

#[cfg(test)]
mod tests {
    use plid_gap::research::Plant;
    use plid_model::Model;
    use serde_json::json;

    use super::*;

    fn setting() -> Setting {
        let text = json!({
            "format": "state-space", "sample_rate_hz": 400.0, "inputs": ["u1"], "outputs": ["y1"],
            "A": [[0.9, 0.2], [-0.2, 0.9]], "B": [[0.0], [1.0]], "C": [[1.0, 0.0]], "D": [[0.0]],
        });
        let model = Model::from_json(&text, "here").unwrap();
        Setting::bare(&Plant::new(&model).unwrap(), &model)
    }

    /// Two explanations whose sums of squares differ by what the second one's further parameter costs, and four more.
    #[test]
    fn weights_are_the_textbook_s() {
        let rows: f64 = 1000.0;
        let gap = |cost: f64| 0.02 * (cost / rows).sqrt();
        let one = |name: &str| json!([{ "effect": name, "location": "input:u1" }]);
        let diagnosis = serde_json::from_value(json!({
            "verdict": "unknown", "sentence": "", "effects": [], "not_separable": [], "evidence": [], "warnings": [],
            "where": { "side": "structure", "channels": {}, "bands_hz": [], "time": [], "level_slope": null },
            "gap": {
                "as_given": 0.2, "refit": 0.1, "free_refit": 0.1, "with_effect": 0.02, "noise_floor": 0.02,
                    "shrink": 1.0,
                "shrink_ci95": [0.9, 1.0], "shrink_over_refit": 1.0, "placebo_shrink": 0.0, "share_of_ceiling": 1.0,
                "predicted_held_out_gap": 0.02, "measured_on": []
            },
            "candidates": [
                { "effects": [], "unknown": true, "probability": 0.9, "gap_after": null },
                { "effects": one("coulomb-friction"), "probability": 0.06, "gap_after": gap(1200.0) },
                { "effects": one("actuator-gain"), "probability": 0.03, "gap_after": gap(1204.0 + rows.ln()) },
                { "effects": [], "probability": 0.01, "gap_after": gap(1500.0) },
            ],
            "next_experiment": null,
        }))
        .unwrap();
        let claim = claim(&diagnosis, rows, &Library::standard(), &setting());
        assert_eq!((claim.verdict.as_str(), claim.effects[0].effect.as_str()), ("effects", "coulomb-friction"));
        // Friction has two parameters, the gain one: what is left is the four.
        let expected = 1.0 / (1.0 + (-2.0f64).exp());
        assert!((claim.effects[0].confidence.unwrap() - expected).abs() < 1e-9);
        assert!(claim.candidates.iter().all(|c| !c.unknown) && claim.candidates.len() == 3);
    }
}
