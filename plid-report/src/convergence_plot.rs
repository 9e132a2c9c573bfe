use super::figure::single;
use super::panel::{Axis, Panel, Scale, Series};
use super::style;
use plid_model::signal::Convergence;

/// The contents of a convergence plot.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvergencePlot<'a> {
    /// The curve.
    pub convergence: &'a Convergence,
    /// Sample rate in Hz.
    pub sample_rate_hz: f64,
    /// Unit of the error, such as "V".
    pub unit: String,
    /// The level that noise alone leaves, if known.
    pub noise_floor: Option<f64>,
    /// Scale of time.
    pub time_scale: Scale,
    /// Scale of the error.
    pub error_scale: Scale,
}

/// Plots the largest one-step error over the sensors against time, as in the paper's Fig. 6: each sample in grey, with
/// the median and the range from the 10th to the 90th percentile.
pub fn convergence_plot(plot: &ConvergencePlot) -> String {
    // The first sample lies at one sample time, so that it also appears on a logarithmic axis.
    let time = |k: f64| (k + 1.0) / plot.sample_rate_hz;
    let each = plot.convergence.largest.iter().enumerate().map(|(k, e)| (time(k as f64), *e)).collect();
    let centre = |start: usize, end: usize| match plot.time_scale {
        Scale::Linear => time((start + end - 1) as f64 / 2.0),
        Scale::Log => (time(start as f64) * time((end - 1) as f64)).sqrt(),
    };
    let bins = &plot.convergence.bins;
    let band = bins.iter().map(|b| (centre(b.start, b.end), b.low, b.high)).collect();
    let median = bins.iter().map(|b| (centre(b.start, b.end), b.median)).collect();
    let mut series = vec![
        Series::line("each sample", each).colour("#bdbdbd").width(0.7),
        Series::band("10th to 90th percentile", band).colour(style::IDENTIFIED),
        Series::line("median", median).colour(style::IDENTIFIED).width(2.0),
    ];
    if let Some(floor) = plot.noise_floor {
        series.push(Series::level("noise floor", floor).colour(style::REFERENCE).width(1.6));
    }
    let mut x = Axis { label: "time, s".into(), scale: plot.time_scale, ..Axis::default() };
    if plot.time_scale == Scale::Linear && !plot.convergence.largest.is_empty() {
        x = x.range(0.0, time(plot.convergence.largest.len() as f64));
    }
    let mut y = Axis { label: format!("largest |e|, {}", plot.unit), scale: plot.error_scale, ..Axis::default() };
    let highest = plot.convergence.largest.iter().copied().filter(|e| e.is_finite()).fold(0.0, f64::max);
    if plot.error_scale == Scale::Linear && highest > 0.0 {
        y = y.range(0.0, 1.06 * highest);
    }
    single("", vec![Panel::new(x, y, 280.0, series)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use plid_model::signal::convergence;

    #[test]
    fn an_empty_course_and_exact_zeros_are_drawn_on_both_scales() {
        for errors in [Array2::<f64>::zeros((0, 1)), Array2::zeros((50, 2)), Array2::from_elem((9, 1), f64::INFINITY)] {
            let curve = convergence(errors.view(), 10);
            for scale in [Scale::Linear, Scale::Log] {
                let svg = convergence_plot(&ConvergencePlot {
                    convergence: &curve,
                    sample_rate_hz: 10.0,
                    unit: "V".into(),
                    noise_floor: Some(0.01),
                    time_scale: scale,
                    error_scale: scale,
                });
                assert!(svg.contains("noise floor") && svg.contains("largest |e|, V"));
                assert!(!svg.contains("NaN") && !svg.contains("inf"));
            }
        }
    }
}
