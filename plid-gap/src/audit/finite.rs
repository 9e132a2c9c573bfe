//! Missing samples, and values that are not finite.

use crate::case::Case;
use crate::error::GapError;

/// Returns the missing samples of the outputs (NaN), by record and channel.
///
/// # Errors
/// Returns [`GapError::Record`] for an infinite value, for a missing input or simulated output, and for an output
/// without any value.
pub fn check(case: &Case) -> Result<Vec<String>, GapError> {
    let config = &case.config;
    let mut found = Vec::new();
    for record in &case.records {
        let wrong = |message: String| GapError::Record { record: record.name.clone(), message };
        let first = |channels: &[Vec<f64>], bad: fn(f64) -> bool| {
            channels.iter().enumerate().find_map(|(c, x)| x.iter().position(|&x| bad(x)).map(|k| (c, k)))
        };
        // A free run needs every command.
        if let Some((i, k)) = first(&record.u, |x| !x.is_finite()) {
            return Err(wrong(format!("input `{}` is {} at sample {k}", config.inputs[i], record.u[i][k])));
        }
        if let Some((o, k)) = first(&record.y, f64::is_infinite) {
            return Err(wrong(format!("output `{}` is infinite at sample {k}", config.outputs[o])));
        }
        if let Some((o, k)) = record.simulated.as_deref().and_then(|y| first(y, |x| !x.is_finite())) {
            return Err(wrong(format!("simulated output `{}` is not finite at sample {k}", config.outputs[o])));
        }
        for (name, y) in config.outputs.iter().zip(&record.y) {
            let missing = y.iter().filter(|y| y.is_nan()).count();
            let share = missing as f64 / y.len().max(1) as f64;
            if missing == y.len() {
                return Err(wrong(format!("output `{name}` has no value at all")));
            }
            if missing > 0 {
                let many = if share > config.settings.audit.many_missing { ", so its gap is uncertain" } else { "" };
                found.push(format!(
                    "{}: {missing} of {} samples of `{name}` are missing ({:.1} %) and are ignored{many}.",
                    record.name,
                    y.len(),
                    100.0 * share
                ));
            }
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{case, truss};

    #[test]
    fn missing_samples_are_counted_and_infinities_refused() {
        let sound = case(&truss(1), &truss(1));
        assert!(check(&sound).unwrap().is_empty());
        let mut gaps = sound.clone();
        (100..107).for_each(|k| gaps.records[1].y[1][k] = f64::NAN);
        let found = check(&gaps).unwrap();
        assert_eq!(found.len(), 1);
        assert!(found[0].starts_with("random-1: 7 of 3072 samples of `y2`"), "{}", found[0]);
        gaps.records[1].y[1].fill(f64::NAN);
        assert!(check(&gaps).unwrap_err().to_string().contains("`y2` has no value at all"));
        let mut infinite = sound.clone();
        infinite.records[2].y[0][5] = f64::NEG_INFINITY;
        let error = check(&infinite).unwrap_err().to_string();
        assert!(error.contains("random-2") && error.contains("`y1` is infinite at sample 5"), "{error}");
        let mut input = sound;
        input.records[0].u[0][9] = f64::NAN;
        assert!(check(&input).unwrap_err().to_string().contains("input `u1` is NaN at sample 9"));
    }
}
