use super::figure::{Stack, grid};
use super::panel::{Axis, Panel, Series};
use super::style;
use plid_model::signal::Correlation;

/// Plots correlation functions with their bounds, each under its title, in rows of `columns`.
/// `label` names the vertical axis, such as "autocorrelation".
pub fn correlation_plot(label: &str, columns: usize, functions: &[(String, &Correlation)]) -> String {
    let stack = |(title, function): &(String, &Correlation)| {
        let lags: Vec<f64> = function.lags.iter().map(|lag| *lag as f64).collect();
        let bound = |sign: f64| lags.iter().zip(&function.bound).map(|(lag, b)| (*lag, sign * b)).collect();
        let values: Vec<(f64, f64)> = lags.iter().copied().zip(function.value.iter().copied()).collect();
        let is_outside = |k: usize| function.value[k].abs() > function.bound[k];
        let inside = (0..values.len()).filter(|&k| !is_outside(k)).map(|k| values[k]).collect();
        let outside: Vec<(f64, f64)> = (0..values.len()).filter(|&k| is_outside(k)).map(|k| values[k]).collect();
        let ends = (lags.first().copied().unwrap_or(0.0) - 0.8, lags.last().copied().unwrap_or(1.0) + 0.8);
        let name = format!("{} % bounds", trimmed(100.0 * function.test.confidence));
        // The two kinds also differ in width, for prints without colour.
        let mut series = vec![
            Series::line(name, bound(1.0)).colour(style::TEXT).width(1.0).dashed(),
            Series::line("", bound(-1.0)).colour(style::TEXT).width(1.0).dashed(),
            Series::line("", vec![(ends.0, 0.0), (ends.1, 0.0)]).colour(style::AXIS).width(0.8),
            Series::stems("inside", inside).colour(style::IDENTIFIED).width(2.0),
        ];
        if !outside.is_empty() {
            series.push(Series::stems("outside", outside).colour(style::REFERENCE).width(3.0));
        }
        let x = Axis::linear("lag, samples").range(ends.0, ends.1);
        let reach = function.value.iter().zip(&function.bound).map(|(v, b)| v.abs().max(*b)).fold(1e-12, f64::max);
        let y = Axis::linear(label).range(-1.12 * reach, 1.12 * reach);
        Stack { title: title.clone(), panels: vec![Panel::new(x, y, 120.0, series)] }
    };
    grid(style::WIDTH.max(230.0 * columns as f64), columns, functions.iter().map(stack).collect())
}

fn trimmed(value: f64) -> String {
    format!("{value:.2}").trim_end_matches('0').trim_end_matches('.').to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use plid_model::signal::CorrelationTest;

    #[test]
    fn lags_outside_stand_out() {
        let test = CorrelationTest {
            statistic: 1.0,
            degrees_of_freedom: 2,
            p_value: 0.5,
            outside: vec![2],
            confidence: 0.99,
            passes: true,
        };
        let function = Correlation { lags: vec![1, 2], value: vec![0.1, -0.5], bound: vec![0.2, 0.2], test };
        let svg = correlation_plot("autocorrelation", 1, &[("e1".into(), &function)]);
        assert!(svg.contains("99 % bounds") && svg.contains("e1"));
        assert_eq!(svg.matches("stroke-width=\"3\"").count(), 1);
        let quiet = Correlation { value: vec![0.1, 0.1], ..function };
        let svg = correlation_plot("autocorrelation", 1, &[("e1".into(), &quiet)]);
        assert_eq!(svg.matches("stroke-width=\"3\"").count(), 0);
    }
}
