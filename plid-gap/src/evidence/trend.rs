//! The trend of a resonance over records: with the level or with time.

use crate::plant::plain_hz;
use crate::settings::{CaseSettings, EvidenceSettings, GapSettings};

/// A resonance in a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// RMS of the record's inputs.
    pub level: f64,
    /// Its start in s.
    pub start_s: f64,
    /// Frequency in Hz.
    pub hz: f64,
    /// Standard deviation of `hz`.
    pub hz_std: f64,
    /// Damping ratio.
    pub damping: f64,
}

/// The variable that a resonance follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Along {
    /// RMS of the inputs.
    Level,
    /// Start of the record.
    Time,
}

/// A straight line through the frequencies of a resonance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trend {
    /// The variable that it follows.
    pub with: Along,
    between: (f64, f64),
    /// Relative change of the frequency.
    pub change: f64,
    /// The change over the scatter about the line.
    pub clear: f64,
    damping: (f64, f64),
}

/// Returns the trend of points with the level or with the time, whichever is clearer; `None` if there are fewer than
/// `least` points or neither of the two varies enough.
pub fn trend(points: &[Point], least: usize, settings: &GapSettings) -> Option<Trend> {
    let GapSettings { case: CaseSettings { same_level, .. }, evidence, .. } = settings;
    let along = |with: Along| -> Option<Trend> {
        let x = |p: &Point| match with {
            Along::Level => p.level,
            Along::Time => p.start_s,
        };
        let n = points.len() as f64;
        let mx = points.iter().map(x).sum::<f64>() / n;
        let mf = points.iter().map(|p| p.hz).sum::<f64>() / n;
        let square = points.iter().map(|p| (x(p) - mx).powi(2)).sum::<f64>();
        if points.len() < least || square <= 1e-6 * mx * mx * n {
            return None;
        }
        let slope = points.iter().map(|p| (x(p) - mx) * (p.hz - mf)).sum::<f64>() / square;
        let left = points.iter().map(|p| (p.hz - mf - slope * (x(p) - mx)).powi(2)).sum::<f64>() / (n - 2.0).max(1.0);
        let low = points.iter().min_by(|a, b| x(a).total_cmp(&x(b)))?;
        let high = points.iter().max_by(|a, b| x(a).total_cmp(&x(b)))?;
        let between = (x(low), x(high));
        // Levels this close count as one.
        if with == Along::Level && between.1 < same_level * between.0 {
            return None;
        }
        let chance = points.iter().map(|p| p.hz_std * p.hz_std).sum::<f64>() / n;
        Some(Trend {
            with,
            between,
            change: slope * (between.1 - between.0) / mf,
            clear: (slope * (between.1 - between.0)).abs() / left.max(chance).sqrt(),
            damping: (low.damping, high.damping),
        })
    };
    match [Along::Level, Along::Time].map(along) {
        [Some(level), Some(time)] if !together(points) && time.clear > evidence.time_over_level * level.clear => {
            Some(time)
        }
        [Some(level), _] => Some(level),
        [None, time] => time,
    }
}

/// Returns whether the records were taken in the order of their levels, in which case level and time cannot be
/// distinguished.
fn together(points: &[Point]) -> bool {
    let mut by_time = points.to_vec();
    by_time.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    by_time.is_sorted_by(|a, b| a.level <= b.level) || by_time.is_sorted_by(|a, b| a.level >= b.level)
}

impl Trend {
    /// States the trend: "the resonance at 168 Hz by +0.40 % from level 0.3 to 1, its damping ratio from 0.0050 to
    /// 0.0051"; `None` if it does not exceed its scatter.
    pub fn words(&self, hz: f64, settings: &EvidenceSettings) -> Option<String> {
        let (from, to) = self.between;
        (self.clear > settings.trend_change).then(|| {
            format!(
                "the resonance at {} Hz by {:+.2} % from {}, its damping ratio from {:.4} to {:.4}",
                plain_hz(hz),
                100.0 * self.change,
                match self.with {
                    Along::Level => format!("level {from:.3} to {to:.3}"),
                    Along::Time => format!("{from:.1} s to {to:.1} s"),
                },
                self.damping.0,
                self.damping.1,
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_is_told_from_the_level_only_where_they_go_apart() {
        let at = |level: f64, start_s: f64| Point { level, start_s, hz: 100.0 + start_s, hz_std: 1e-3, damping: 0.01 };
        let told = |points: &[Point]| trend(points, 3, &GapSettings::default()).map(|trend| trend.with);
        assert_eq!(told(&[at(0.3, 0.0), at(0.5, 1.0), at(1.0, 2.0)]), Some(Along::Level));
        assert_eq!(told(&[at(1.0, 0.0), at(0.3, 1.0), at(0.9, 2.0)]), Some(Along::Time));
        assert_eq!(told(&[at(1.0, 0.0), at(1.01, 1.0), at(1.02, 2.0)]), Some(Along::Time));
        assert_eq!(told(&[at(1.0, 0.0), at(0.3, 1.0)]), None);
    }
}
