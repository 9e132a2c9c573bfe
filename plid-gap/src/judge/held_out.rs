//! The evidence of held-out records: whether the effects simulate them better than a refit alone, beyond chance.
//!
//! With r0 and r1 the whitened residuals of refit and explanation, the gain |r0|^2 - |r1|^2 (twice the log likelihood
//! ratio) has the mean -delta^2 if the refit is right and +delta^2 if the explanation is right. Its standard
//! deviation is 2 delta in both cases, where delta is the norm of r0 - r1. This also holds for an effect that acts at
//! a few instants only, for which the scatter between blocks of the record is not informative.

use crate::case::record::Record;
use crate::effects::Action;
use crate::fit::free_run::run;
use crate::fit::problem::sum_of_squares;
use crate::noise::NoiseModel;
use crate::noise::whiten::Whitener;
use crate::plant::Plant;
use crate::settings::JudgeSettings;

/// The evidence of held-out records for an explanation against a refit alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldOut {
    /// Twice the log likelihood ratio.
    pub gain: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

impl HeldOut {
    /// Returns whether the records refute the explanation. They do if it gains too little although a right one would
    /// gain a quarter of the squared standard deviation, or if it worsens the fit beyond chance, however small the
    /// expected gain.
    pub fn refutes(&self, settings: &JudgeSettings) -> bool {
        let JudgeSettings { held_out_gain, held_out_power, .. } = *settings;
        let chance = held_out_gain * self.deviation;
        self.deviation > held_out_power * held_out_gain && self.gain < chance || self.gain < -chance
    }
}

/// Returns the gain of the simulation with effects over the refit on all records together; `None` without records.
pub fn held_out(
    records: &[Record],
    noise: &NoiseModel,
    refit: &Plant,
    explained: &Plant,
    actions: &[Action],
) -> Option<HeldOut> {
    let (mut before, mut after, mut apart, mut values) = (0.0, 0.0, 0.0, 0.0);
    for record in records {
        let whitener = Whitener::new(record, noise, refit.rate, vec![Vec::new(); record.y.len()]);
        let residual = |plant: &Plant, actions: &[Action]| {
            let mut to = vec![0.0; whitener.rows()];
            whitener.apply(&record.error(&run(plant, actions, record)), &mut to);
            to
        };
        let (r0, r1) = (residual(refit, &[]), residual(explained, actions));
        before += sum_of_squares(&r0);
        after += sum_of_squares(&r1);
        apart += r0.iter().zip(&r1).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        values += whitener.values();
    }
    // A residual of the better simulation beyond the noise adds to the scatter as noise does.
    let blur = (before.min(after) / values.max(1.0)).max(1.0);
    (values > 0.0).then(|| HeldOut { gain: before - after, deviation: 2.0 * (apart * blur).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_should_have_shown_and_did_not_is_refuted() {
        let of = |gain: f64, deviation: f64| HeldOut { gain, deviation }.refutes(&JudgeSettings::default());
        // A right explanation of delta = 50 gains 2500 with a standard deviation of 100; a wrong one loses 2500.
        assert!(!of(2500.0, 100.0) && of(-2500.0, 100.0) && of(200.0, 100.0));
        // With delta = 2, no conclusion is possible.
        assert!(!of(-4.0, 4.0));
        // A loss of 20 refutes an explanation with an expected gain of 4 and a standard deviation of 4.
        assert!(of(-20.0, 4.0));
    }
}
