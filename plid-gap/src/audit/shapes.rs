//! Channels and lengths of the records, compared with each other and with the simulation.

use crate::case::Case;
use crate::error::GapError;

/// Checks that the records have the channels, lengths and rate of the case and of the simulation.
///
/// # Errors
/// Returns [`GapError::Record`] for a record that does not match, and [`GapError::TooLittle`] if there is no record.
pub fn check(case: &Case) -> Result<(), GapError> {
    let config = &case.config;
    if case.records.is_empty() {
        return Err(GapError::TooLittle("the case has no record".into()));
    }
    if let Some(model) = &case.model {
        let rates = (config.rate(), model.sample_rate_hz);
        if (rates.0 / rates.1 - 1.0).abs() > 1e-6 {
            let message = format!("it is sampled at {} Hz, the simulation at {} Hz", rates.0, rates.1);
            return Err(wrong(&case.records[0].name, message));
        }
        let (m, p) = (config.inputs.len(), config.outputs.len());
        if (model.m(), model.p()) != (m, p) {
            let message = format!("it has {m} inputs and {p} outputs, the simulation {} and {}", model.m(), model.p());
            return Err(wrong(&case.records[0].name, message));
        }
    }
    for record in &case.records {
        let simulated = record.simulated.as_ref().unwrap_or(&record.y);
        for (what, channels, names) in [
            ("input", &record.u, &config.inputs),
            ("output", &record.y, &config.outputs),
            ("simulated output", simulated, &config.outputs),
        ] {
            if channels.len() != names.len() {
                let message = format!("{} {what}s where the case names {}", channels.len(), names.len());
                return Err(wrong(&record.name, message));
            }
            for (channel, name) in channels.iter().zip(names) {
                if channel.len() != record.samples() {
                    let message =
                        format!("{what} `{name}` has {} samples, the record {}", channel.len(), record.samples());
                    return Err(wrong(&record.name, message));
                }
            }
        }
    }
    Ok(())
}

fn wrong(record: &str, message: String) -> GapError {
    GapError::Record { record: record.into(), message }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{case, truss};

    #[test]
    fn a_sound_case_passes() {
        check(&case(&truss(1), &truss(1))).unwrap();
    }

    #[test]
    fn rate_channels_and_lengths_are_named() {
        let sound = case(&truss(1), &truss(1));
        let says = |change: &dyn Fn(&mut Case)| {
            let mut case = sound.clone();
            change(&mut case);
            check(&case).unwrap_err().to_string()
        };
        let rate = says(&|case| case.config.sample_rate_hz = 800.0);
        assert!(rate.contains("800 Hz") && rate.contains("1600 Hz"), "{rate}");
        let outputs = says(&|case| drop(case.records[1].y.pop()));
        assert!(outputs.contains("random-1") && outputs.contains("1 outputs"), "{outputs}");
        let model = says(&|case| {
            case.config.outputs.pop();
            case.records.iter_mut().for_each(|record| drop(record.y.pop()));
        });
        assert!(model.contains("the simulation 2 and 2"), "{model}");
        let short = says(&|case| case.records[2].u[1].truncate(3071));
        assert!(short.contains("random-2") && short.contains("`u2` has 3071 samples"), "{short}");
        let simulated = says(&|case| case.records[1].simulated = Some(vec![vec![0.0; 3]; 2]));
        assert!(simulated.contains("simulated output `y1` has 3 samples"), "{simulated}");
        let none = says(&|case| case.records.clear());
        assert!(none.contains("no record"), "{none}");
    }
}
