//! Step 7 once more, on records that were held out from all fitting: do the effects simulate them better than a refit alone, beyond chance?
//!
//! With r0 and r1 the whitened residuals of refit and explanation, the gain |r0|^2 - |r1|^2 (twice the log likelihood ratio) has the mean
//! -delta^2 where the refit is right and +delta^2 where the explanation is, and the standard deviation 2 delta in both cases, with delta =
//! |r0 - r1|. That holds for an effect that acts at a few instants too, where the scatter between blocks of the record says nothing.

use crate::case::record::Record;
use crate::effects::Action;
use crate::fit::free_run::run;
use crate::fit::problem::sum_of_squares;
use crate::noise::NoiseModel;
use crate::noise::whiten::Whitener;
use crate::plant::Plant;
use crate::settings::JudgeSettings;

/// What held-out records say of an explanation against a refit alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldOut {
    /// Twice the log likelihood ratio.
    pub gain: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

impl HeldOut {
    /// Whether the explanation fails where it should show: a right one gains a quarter of the standard deviation, squared. And whether it spoils more than
    /// chance can, however little it was to show.
    pub fn refutes(&self, settings: &JudgeSettings) -> bool {
        let JudgeSettings { held_out_gain, held_out_power, .. } = *settings;
        let chance = held_out_gain * self.deviation;
        self.deviation > held_out_power * held_out_gain && self.gain < chance || self.gain < -chance
    }
}

/// The gain of the second simulation over the first on all records together; none without records.
pub fn held_out(
    records: &[Record],
    noise: &NoiseModel,
    refit: &Plant,
    explained: &Plant,
    actions: &[Action],
) -> Option<HeldOut> {
    let (mut before, mut after, mut apart, mut rows) = (0.0, 0.0, 0.0, 0);
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
        rows += r0.len();
    }
    // What the better of the two leaves beyond the noise blurs the gain as noise does.
    let blur = (before.min(after) / rows.max(1) as f64).max(1.0);
    (rows > 0).then(|| HeldOut { gain: before - after, deviation: 2.0 * (apart * blur).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_should_have_shown_and_did_not_is_refuted() {
        let of = |gain: f64, deviation: f64| HeldOut { gain, deviation }.refutes(&JudgeSettings::default());
        // A right explanation of delta = 50: +2500 within 100 each way. A wrong one: -2500.
        assert!(!of(2500.0, 100.0) && of(-2500.0, 100.0) && of(200.0, 100.0));
        // Of delta = 2 nobody can say.
        assert!(!of(-4.0, 4.0));
        // But not that it gains 4 within 4, where it loses 20.
        assert!(of(-20.0, 4.0));
    }
}
