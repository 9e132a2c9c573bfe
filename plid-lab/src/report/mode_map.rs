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

/// Modes as points of frequency and damping ratio, with bars of two standard deviations: at a glance, which modes of two
/// models are the same and which are poorly known.
pub fn mode_map(sets: &[ModeSet]) -> String {
    let mut series = Vec::new();
    for (index, set) in sets.iter().enumerate() {
        let colour = super::style::CYCLE[index % super::style::CYCLE.len()];
        let points: Vec<(f64, f64)> = set
            .frequency_hz
            .iter()
            .zip(&set.damping)
            .map(|(f, d)| (*f, 100.0 * d))
            .collect();
        for ((f, d), (f_std, d_std)) in points.iter().zip(&set.std) {
            let bar = |from: (f64, f64), to: (f64, f64)| {
                Series::line("", vec![from, to]).colour(colour).width(1.2)
            };
            series.push(bar((f - 2.0 * f_std, *d), (f + 2.0 * f_std, *d)));
            series.push(bar((*f, d - 200.0 * d_std), (*f, d + 200.0 * d_std)));
        }
        series.push(Series::points(set.label.clone(), points).colour(colour));
    }
    single(
        "",
        vec![Panel::new(
            Axis::linear("frequency, Hz"),
            Axis::linear("damping ratio, %"),
            260.0,
            series,
        )],
    )
}
