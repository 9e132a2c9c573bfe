//! Probabilities by BIC alone: the weight of a model is exp(-BIC / 2), as if one model of the set were true (Schwarz
//! 1978).

use crate::judge::{Candidate, Named};

/// Returns explanations with their weights from the BIC of each, the likeliest first.
pub(super) fn schwarz(mut models: Vec<(f64, Candidate)>) -> Vec<Candidate> {
    models.retain(|(bic, _)| bic.is_finite());
    models.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(least) = models.first().map(|(bic, _)| *bic) else { return Vec::new() };
    let weight = |bic: f64| ((least - bic) / 2.0).exp();
    let all: f64 = models.iter().map(|(bic, _)| weight(*bic)).sum();
    let weighted = |(bic, candidate)| Candidate { probability: Some(weight(bic) / all), ..candidate };
    models.into_iter().map(weighted).collect()
}

/// Returns the probability that an effect acts at its place: the sum over all explanations that contain the effect.
pub(super) fn at_work(candidates: &[Candidate], named: &Named) -> f64 {
    let is_it = |e: &Named| (&e.effect, &e.location) == (&named.effect, &named.location);
    candidates.iter().filter(|c| c.effects.iter().any(is_it)).filter_map(|c| c.probability).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_of_two_is_a_factor_of_e() {
        let named = |name: &str| Named { effect: name.to_owned(), ..Named::default() };
        let of =
            |names: &[&str]| Candidate { effects: names.iter().map(|n| named(n)).collect(), ..Candidate::default() };
        let models = vec![(7.0, of(&["a"])), (5.0, of(&["a", "b"])), (f64::NAN, of(&["c"])), (9.0, of(&[]))];
        let found = schwarz(models);
        let e = 1f64.exp();
        let all = 1.0 + 1.0 / e + 1.0 / (e * e);
        let expected = [1.0 / all, 1.0 / (e * all), 1.0 / (e * e * all)];
        assert!(found.iter().zip(expected).all(|(c, p)| (c.probability.unwrap() - p).abs() < 1e-12), "{found:?}");
        assert_eq!(found[0].effects.len(), 2);
        assert!((at_work(&found, &named("a")) - expected[0] - expected[1]).abs() < 1e-12);
        assert_eq!(at_work(&found, &named("c")), 0.0);
    }
}
