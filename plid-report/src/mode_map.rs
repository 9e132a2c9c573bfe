use super::figure::single;
use super::panel::{Axis, Panel, Series};

/// The modes of one model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ModeSet {
    /// Name in the legend.
    pub label: String,
    /// Frequencies in Hz.
    pub frequency_hz: Vec<f64>,
    /// Damping ratios (0.01 is one percent).
    pub damping: Vec<f64>,
    /// Standard deviations of both, in the same order; empty where they are not known.
    pub std: Vec<(f64, f64)>,
}

/// Plots modes as points of frequency and damping ratio with bars of two standard deviations. The plot shows at a
/// glance which modes two models share, and which are poorly known.
pub fn mode_map(sets: &[ModeSet]) -> String {
    let mut series = Vec::new();
    for (index, set) in sets.iter().enumerate() {
        let colour = super::style::CYCLE[index % super::style::CYCLE.len()];
        let points: Vec<(f64, f64)> = set.frequency_hz.iter().zip(&set.damping).map(|(f, d)| (*f, 100.0 * d)).collect();
        for ((f, d), (f_std, d_std)) in points.iter().zip(&set.std) {
            let bar = |from: (f64, f64), to: (f64, f64)| Series::line("", vec![from, to]).colour(colour).width(1.2);
            series.push(bar((f - 2.0 * f_std, *d), (f + 2.0 * f_std, *d)));
            series.push(bar((*f, d - 200.0 * d_std), (*f, d + 200.0 * d_std)));
        }
        // Later sets are drawn smaller, so that both of two equal modes are visible.
        series.push(Series::points(set.label.clone(), points).colour(colour).width(if index == 0 { 5.0 } else { 3.0 }));
    }
    let mut x = Axis::linear("frequency, Hz");
    let frequencies = || sets.iter().flat_map(|set| set.frequency_hz.iter().copied()).filter(|f| f.is_finite());
    let (low, high) = frequencies().fold((f64::INFINITY, 0.0), |(l, h), f| (f.min(l), f.max(h)));
    if low <= high {
        let room = (0.08 * (high - low)).max(0.02 * high);
        x = x.range(low - room, high + room);
    }
    single("", vec![Panel::new(x, Axis::linear("damping ratio, %"), 260.0, series)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_mode_has_a_mark_and_two_bars() {
        let set = ModeSet {
            label: "identified".into(),
            frequency_hz: vec![100.0, 120.0],
            damping: vec![0.01, 0.02],
            std: vec![(0.1, 0.001), (f64::NAN, 0.001)],
        };
        let bars = |sets: &[ModeSet]| mode_map(sets).matches("stroke-width=\"1.2\"").count();
        // The bar of an unknown deviation is left out.
        assert_eq!(bars(std::slice::from_ref(&set)), 3);
        assert_eq!(bars(&[ModeSet { std: vec![], ..set }]), 0);
        assert!(mode_map(&[]).starts_with("<svg"));
    }
}
