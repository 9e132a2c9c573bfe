//! The period of a record's input.
//!
//! The misfit of a period P is RMS(u\[k + P\] - u\[k\]) over sqrt(2) RMS(u), without the mean: zero if the input
//! repeats exactly, one if it does not repeat at all. With noise or quantisation of the recorded input, the misfit of
//! the true period is small but not zero.

use ndarray::Array2;

use crate::settings::CaseSettings;
use plid_fourier::C;

/// Misfits below this value are due to rounding.
const ROUNDING: f64 = 1e-6;

/// The defect of a declared period.
#[derive(Debug, PartialEq)]
pub(super) struct NotPeriodic {
    /// The input with the largest misfit at the declared period, and the misfit.
    pub worst: (usize, f64),
    /// The nearest period that fits, if there is one.
    pub fits: Option<usize>,
}

/// The inputs of a record, prepared for comparison with shifted copies of themselves.
pub(super) struct Repeating<'s> {
    /// For each input, the values without their mean, divided by the input's level.
    inputs: Vec<Vec<f64>>,
    /// For each input, the step of its converter, in the same units.
    steps: Vec<f64>,
    settings: &'s CaseSettings,
}

impl<'s> Repeating<'s> {
    /// Prepares the inputs of a record. `levels` is the RMS of each input about its mean in the record in which this
    /// RMS is largest, because the noise of an input that is idle in this record need not repeat.
    pub fn new(inputs: &Array2<f64>, levels: &[f64], settings: &'s CaseSettings) -> Self {
        let (inputs, steps) = inputs
            .columns()
            .into_iter()
            .zip(levels)
            .map(|(u, level)| {
                let mean = u.mean().unwrap_or(0.0);
                // A constant input differs from its mean by rounding only.
                let is_constant = *level <= 1e-12 * mean.abs();
                let scaled: Vec<f64> = u.iter().map(|u| if is_constant { 0.0 } else { (u - mean) / level }).collect();
                let step = converter_step(&scaled);
                (scaled, step)
            })
            .unzip();
        Self { inputs, steps, settings }
    }

    fn samples(&self) -> usize {
        self.inputs.first().map_or(0, Vec::len)
    }

    /// Returns the misfit of each input over the pair of consecutive periods with the largest difference; `None` if
    /// the record does not contain two periods.
    fn misfits(&self, period: usize) -> Option<Vec<f64>> {
        let samples = self.samples();
        if period == 0 || 2 * period > samples {
            return None;
        }
        let of = |(u, step): (&Vec<f64>, &f64)| {
            let pair = |first: usize| {
                let end = (first + period).min(samples - period);
                let sum: f64 = (first..end).map(|k| (u[k + period] - u[k]).powi(2)).sum();
                // The end of a record may contain only a few samples of a period, which carry little information.
                if 4 * (end - first) < period { 0.0 } else { sum / (end - first) as f64 }
            };
            let worst = (0..samples - period).step_by(period).map(pair).fold(0.0, f64::max);
            // Noise may move a converter's value by one step.
            (worst - step * step).max(0.0).sqrt() * std::f64::consts::FRAC_1_SQRT_2
        };
        Some(self.inputs.iter().zip(&self.steps).map(of).collect())
    }

    fn misfit(&self, period: usize) -> Option<f64> {
        Some(self.misfits(period)?.into_iter().fold(0.0, f64::max))
    }

    /// Compares a declared period with the inputs. Returns false if the record is too short for the comparison.
    pub fn check(&self, period: usize) -> Result<bool, NotPeriodic> {
        let Some(misfits) = self.misfits(period) else { return Ok(false) };
        let worst = misfits.into_iter().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0));
        if worst.1 > self.settings.period_misfit {
            return Err(NotPeriodic { worst, fits: self.nearest(period) });
        }
        let reach = (period as f64 * self.settings.period_distance) as usize;
        let better = (period.saturating_sub(reach).max(2)..=period + reach)
            .filter_map(|near| Some((near, self.misfit(near)?)))
            .filter(|(_, misfit)| *misfit < self.settings.better_misfit * worst.1)
            .min_by(|a, b| a.1.total_cmp(&b.1));
        match better {
            Some((near, _)) if worst.1 > ROUNDING => Err(NotPeriodic { worst, fits: Some(near) }),
            _ => Ok(true),
        }
    }

    /// Returns the shortest period, if the inputs have one.
    pub fn shortest(&self) -> Option<usize> {
        self.all().into_iter().next()
    }

    /// Returns the multiple of the shortest period that is nearest to a period that does not fit.
    fn nearest(&self, period: usize) -> Option<usize> {
        let shortest = self.shortest()?;
        let multiple = (period + shortest / 2) / shortest;
        let most = self.samples() / 2 / shortest;
        Some(shortest * multiple.clamp(1, most.max(1)))
    }

    /// Returns all shifts after which all inputs repeat, the shortest first.
    fn all(&self) -> Vec<usize> {
        let samples = self.samples();
        // For each shift, the mean square of the difference, largest over the inputs.
        let mut rough = vec![0.0_f64; samples / 2 + 1];
        for u in &self.inputs {
            rough.iter_mut().zip(differences(u)).for_each(|(most, of)| *most = most.max(of));
        }
        let CaseSettings { period_misfit, measured_misfit, unrelated_misfit, better_misfit, .. } = *self.settings;
        let unlike = 2.0 * unrelated_misfit * unrelated_misfit;
        let Some(first) = rough.iter().position(|square| *square > unlike) else { return Vec::new() };
        let candidate = |&shift: &usize| {
            let least = [shift - 1, shift + 1].iter().all(|&at| rough.get(at).is_none_or(|of| rough[shift] <= *of));
            least && rough[shift] < unlike && self.misfit(shift).is_some_and(|misfit| misfit <= period_misfit)
        };
        let found: Vec<usize> = (first.max(2)..rough.len()).filter(candidate).collect();
        // A slow input nearly repeats at shifts near its period; noise keeps the misfit of the true period from zero.
        let least = found.iter().filter_map(|&shift| self.misfit(shift)).fold(f64::INFINITY, f64::min);
        let most = (least / better_misfit).max(ROUNDING) + measured_misfit;
        let good = |shift: &usize| self.misfit(*shift).is_some_and(|of| of <= most);
        found.into_iter().filter(good).collect()
    }
}

/// Returns the mean of (u[k + shift] - u[k])^2 for each shift from zero to half the length.
fn differences(u: &[f64]) -> Vec<f64> {
    let samples = u.len();
    let mut padded = u.to_vec();
    padded.resize(plid_fourier::good_length(2 * samples), 0.0);
    let power: Vec<C> = plid_fourier::forward(&padded).iter().map(|z| C::new(z.norm_sqr(), 0.0)).collect();
    let products = plid_fourier::backward(&power, padded.len());
    let mut before = vec![0.0; samples + 1];
    (0..samples).for_each(|k| before[k + 1] = before[k] + u[k] * u[k]);
    (0..=samples / 2)
        .map(|shift| {
            let both = samples - shift;
            let squares = before[both] + before[samples] - before[shift];
            ((squares - 2.0 * products[shift]) / both as f64).max(0.0)
        })
        .collect()
}

/// Returns the step of a converter: the smallest distance between two values if there are few different values, and
/// zero otherwise.
fn converter_step(u: &[f64]) -> f64 {
    let mut sorted = u.to_vec();
    sorted.sort_by(f64::total_cmp);
    let distances: Vec<f64> = sorted.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 1e-9).collect();
    let few = 4 * distances.len() < u.len();
    if few { distances.into_iter().fold(f64::INFINITY, f64::min).min(1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random_input;

    fn repeating(u: &[Vec<f64>]) -> Repeating<'static> {
        static SETTINGS: std::sync::LazyLock<CaseSettings> = std::sync::LazyLock::new(CaseSettings::default);
        let array = Array2::from_shape_fn((u[0].len(), u.len()), |(k, i)| u[i][k]);
        Repeating::new(&array, &vec![1.0; u.len()], &SETTINGS)
    }

    fn noisy(u: &[f64], size: f64) -> Vec<f64> {
        u.iter().zip(random_input(9, u.len(), 1).remove(0)).map(|(u, e)| u + size * e).collect()
    }

    /// Returns white noise, and a signal that hardly changes from one sample to the next.
    fn inputs() -> [Vec<f64>; 2] {
        let white = random_input(3, 1024, 1).remove(0);
        let tone = |k: usize, line: f64| (std::f64::consts::TAU * line * k as f64 / 1024.0 + line * line).sin();
        let slow: Vec<f64> = (0..1024).map(|k| (1..9).map(|line| 0.5 * tone(k, f64::from(line))).sum()).collect();
        [white.repeat(5), slow.repeat(5)]
    }

    #[test]
    fn the_period_is_found_and_a_wrong_one_is_named_beside_it() {
        for u in inputs() {
            for size in [0.0, 0.01] {
                let one = repeating(&[noisy(&u, size)]);
                assert_eq!(one.shortest(), Some(1024));
                assert_eq!(one.check(1024), Ok(true));
                assert_eq!(one.check(2048), Ok(true));
                for wrong in [1000, 1100, 512, 700] {
                    assert_eq!(one.check(wrong).unwrap_err().fits, Some(1024), "{wrong}");
                }
                assert_eq!(one.check(2000).unwrap_err().fits, Some(2048));
            }
            assert_eq!(repeating(std::slice::from_ref(&u)).check(1023).unwrap_err().fits, Some(1024));
        }
    }

    #[test]
    fn every_input_and_every_period_must_repeat() {
        let [white, slow] = inputs();
        let aperiodic = random_input(4, white.len(), 1).remove(0);
        let two = repeating(&[white.clone(), aperiodic.clone()]);
        let said = two.check(1024).unwrap_err();
        assert_eq!((said.worst.0, said.fits), (1, None));
        assert_eq!(repeating(&[aperiodic]).shortest(), None);
        let mut stopped = slow;
        stopped[3 * 1024..].fill(0.0);
        assert!(repeating(&[stopped]).check(1024).is_err());
        // An idle input has its own noise, and the last bit of its converter flickers.
        let idle: Vec<f64> = random_input(5, white.len(), 1).remove(0).iter().map(|e| 0.01 * e).collect();
        let flicker: Vec<f64> = idle.iter().map(|e| f64::from(u8::from(*e > 0.0))).collect();
        assert_eq!(repeating(&[white.clone(), idle]).check(1024), Ok(true));
        assert_eq!(repeating(&[white.clone(), flicker]).check(1024), Ok(true));
        assert_eq!(repeating(&[white]).check(4000), Ok(false));
    }
}
