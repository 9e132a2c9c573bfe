//! A compact histogram of the times of single steps.

use serde::{Deserialize, Serialize};

/// Number of classes per octave, so that times are stored to about 1 %.
const PARTS: f64 = 64.0;

/// A histogram of step times, stored as pairs of a class and a count. Class c contains times around 2^(c / 64) ns.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Histogram(Vec<(u16, u64)>);

impl Histogram {
    /// Creates the histogram of times in ns.
    pub fn of(times: &[u32]) -> Self {
        let mut histogram = Self::default();
        for &time in times {
            histogram.add((PARTS * f64::from(time.max(1)).log2()).round() as u16, 1);
        }
        histogram
    }

    fn add(&mut self, class: u16, count: u64) {
        match self.0.binary_search_by_key(&class, |&(c, _)| c) {
            Ok(at) => self.0[at].1 += count,
            Err(at) => self.0.insert(at, (class, count)),
        }
    }

    /// Adds another histogram.
    pub fn merge(&mut self, other: &Self) {
        other.0.iter().for_each(|&(class, count)| self.add(class, count));
    }

    /// Returns the number of times.
    pub fn count(&self) -> u64 {
        self.0.iter().map(|&(_, count)| count).sum()
    }

    /// Returns the time in us that a share of all times does not exceed, or NaN if there are no times.
    pub fn quantile_us(&self, share: f64) -> f64 {
        let needed = (share * self.count() as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        for &(class, count) in &self.0 {
            seen += count;
            if seen >= needed {
                return (f64::from(class) / PARTS).exp2() / 1e3;
            }
        }
        f64::NAN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_kept_to_a_hundredth() {
        let times: Vec<u32> = (1..=10_000).map(|k| 100 * k).collect();
        let (low, high) = times.split_at(3000);
        let mut all = Histogram::of(high);
        all.merge(&Histogram::of(low));
        assert_eq!(all, Histogram::of(&times));
        assert_eq!(all.count(), 10_000);
        for share in [0.001, 0.5, 0.99, 0.999, 1.0] {
            let (found, exact) = (all.quantile_us(share), 1000.0 * share);
            assert!((found / exact - 1.0).abs() < 0.01, "{share}: {found} for {exact}");
        }
        assert!(Histogram::default().quantile_us(0.5).is_nan());
        assert_eq!(Histogram::of(&[0]).count(), 1);
    }
}
