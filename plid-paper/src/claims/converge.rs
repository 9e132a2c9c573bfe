//! Claim: convergence to the true parameters.

use plid_bench::expectations::{self, Config};
use plid_report::{Axis, Chart, Series, chart};
use plid_work::Inner;
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};

pub const CLAIM: Claim = claim!("converge",
    statement: "The estimate converges almost surely to the true parameters.",
    limit: "A simulation sees many records of finite length, and not the limit. It can see a bias larger than the \
        scatter at the end. Plants are of the model's own order; the truss is not.",
    timed: false,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    samples: Vec<usize>,
    runs: usize,
}

/// The best possible estimate, for comparison: the maximum of the posterior density over the whole record.
const BATCH: &str = "batch-maximum-posterior";
const NAMES: [&str; 6] = ["prior", "posterior", "moment-matched", "certainty-equivalent", "joint-ekf", BATCH];

/// Fits the slope of log y against log x by least squares.
fn slope(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let (mx, my) = (logs.iter().map(|p| p.0).sum::<f64>() / count, logs.iter().map(|p| p.1).sum::<f64>() / count);
    let (over, under) = logs.iter().fold((0.0, 0.0), |(o, u), (x, y)| (o + (x - mx) * (y - my), u + (x - mx).powi(2)));
    over / under
}

/// Results of the study for one method at one record length.
struct Point {
    /// Geometric mean over plants of the free-run error against the true response.
    free_run: f64,
    /// RMS over plants of the error of the entries of a_1 .. a_p.
    rmse: f64,
    /// Normalised estimation error squared.
    nees: f64,
}

/// Returns pairs of record length and a figure of each point.
fn against(samples: &[usize], line: &[Point], of: fn(&Point) -> f64) -> Vec<(f64, f64)> {
    samples.iter().zip(line).map(|(&samples, point)| (samples as f64, of(point))).collect()
}

/// The decrease of the errors of one method with the record length.
struct Trend<'a> {
    name: &'static str,
    line: &'a [Point],
    /// The point of the longest records.
    last: &'a Point,
    /// Slopes of log error against log record length over the longer records.
    free_run_slope: f64,
    rmse_slope: f64,
}

impl<'a> Trend<'a> {
    fn of(name: &'static str, samples: &[usize], line: &'a [Point]) -> Result<Self> {
        // The results for the first half of the lengths depend on the start.
        let late = line.len() / 2 - 1;
        let slope = |of: fn(&Point) -> f64| slope(&against(samples, line, of)[late..]);
        let last = line.last().ok_or("no samples")?;
        Ok(Self { name, line, last, free_run_slope: slope(|p| p.free_run), rmse_slope: slope(|p| p.rmse) })
    }

    /// Whether the covariance at the end is consistent with the error.
    fn is_honest(&self) -> bool {
        self.last.nees < 2.0
    }

    fn add_figures(&self, finding: Finding) -> Finding {
        let name = self.name;
        finding
            .figure(format!("slope of the free-run error, {name}"), self.free_run_slope, "")
            .figure(format!("free-run error at the end, {name}"), 100.0 * self.last.free_run, "%")
            .figure(format!("slope of the parameters' RMS error, {name}"), self.rmse_slope, "")
            .figure(format!("NEES at the end, {name}"), self.last.nees, "")
    }

    /// Returns the row of the table with name, slope, NEES and RMS error at the end, followed by the free-run error
    /// at every length.
    fn cells(&self) -> Vec<String> {
        let start = [
            self.name.to_string(),
            format!("{:.2}", self.free_run_slope),
            format!("{:.1}", self.last.nees),
            format!("{:.4}", self.last.rmse),
        ];
        let errors = self.line.iter().map(|point| format!("{:.2}", 100.0 * point.free_run));
        start.into_iter().chain(errors).collect()
    }
}

/// Runs the study at every record length; the points of each method are in the order of `NAMES`.
fn study(context: &Context<'_>, config: &Config, vary: &Vary) -> Result<Vec<Vec<Point>>> {
    let mut lines: Vec<Vec<Point>> = NAMES.iter().map(|_| Vec::new()).collect();
    for &samples in &vary.samples {
        let mut config = config.clone();
        for plant in &mut config.in_class {
            (plant.steps, plant.runs) = (samples, vary.runs);
        }
        let directory = context.directory.join(format!("{samples}-samples"));
        let study = expectations::run(&config, &directory, false, &Inner(context.progress))?;
        let cell = study.cells.first().ok_or("the study has no cell")?;
        for (line, name) in lines.iter_mut().zip(NAMES) {
            let score =
                cell.scores.iter().find(|score| score.method == name).ok_or("the study lacks an expectation")?;
            let value =
                |figure: &Option<_>| figure.as_ref().map_or(f64::NAN, |f: &expectations::statistics::Figure| f.value);
            line.push(Point { free_run: value(&score.free_run), rmse: value(&score.rmse_a), nees: value(&score.nees) });
        }
    }
    Ok(lines)
}

/// Plots one figure of every method against the record length.
fn picture(label: &str, samples: &[usize], lines: &[Vec<Point>], of: fn(&Point) -> f64) -> String {
    let series = NAMES.iter().zip(lines).map(|(name, line)| Series::line(*name, against(samples, line, of))).collect();
    chart(&Chart { title: String::new(), x: Axis::log("samples"), y: Axis::log(label), series, height: 230.0 })
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (config, vary): (Config, Vary) = (context.config()?, context.vary()?);
    let lines = study(context, &config, &vary)?;
    let trends: Vec<Trend<'_>> = NAMES
        .into_iter()
        .zip(&lines)
        .map(|(name, line)| Trend::of(name, &vary.samples, line))
        .collect::<Result<_>>()?;
    let mut finding = trends.iter().fold(Finding::default(), |finding, trend| trend.add_figures(finding));
    let rows = trends.iter().map(Trend::cells).collect();
    let free_run_picture = picture("free-run error, relative", &vary.samples, &lines, |p| p.free_run);
    let nees_picture = picture("NEES of the parameters", &vary.samples, &lines, |p| p.nees);
    let heads: Vec<String> = vary.samples.iter().map(|k| format!("{k} samples")).collect();
    let heads: Vec<(&str, &str)> = [("estimate", ""), ("slope", ""), ("NEES at the end", ""), ("RMS error of a", "")]
        .into_iter()
        .chain(heads.iter().map(|h| (h.as_str(), "%")))
        .collect();
    let recursive: Vec<&Trend<'_>> = trends.iter().filter(|trend| trend.name != BATCH).collect();
    for Trend { name, free_run_slope, .. } in &recursive {
        let rule = format!(
            "With `{name}` the free-run error falls over the longer records with a slope below -0.25, half of the \
             square root's -0.5: a bias would flatten it."
        );
        finding = finding.part(rule, *free_run_slope < -0.25);
    }
    let listed: Vec<String> = recursive.iter().map(|t| format!("{} {:.2}", t.name, t.free_run_slope)).collect();
    let proud: Vec<&str> = recursive.iter().filter(|t| !t.is_honest()).map(|t| t.name).collect();
    let batch = finding.value(&format!("slope of the free-run error, {BATCH}"));
    Ok(finding
        .part(
            "With every expectation P says how far the estimate still is: NEES at the end is below \
            2.",
            proud.is_empty(),
        )
        .picture(
            free_run_picture,
            format!(
                "Geometric mean over {} random plants of the model's order, signal-to-noise ratio \
            {}.",
                vary.runs, config.signal_to_noise[0]
            ),
        )
        .picture(nees_picture, "One for an honest P.")
        .table(
            "Free-run error against the true response; the RMS error of the entries of a_1 .. a_p at the end is \
            owned by the plants that the data tell least of.",
            &heads,
            rows,
        )
        .say(format!(
            "Over the longer records, up to {} samples, the free-run error falls with these slopes (the square root's \
             is -0.5): {}; batch estimation's with {:.2}. P falls faster than the error with {}.",
            vary.samples.last().unwrap_or(&0),
            listed.join(", "),
            batch,
            if proud.is_empty() { "none".into() } else { proud.join(", ") },
        )))
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_slope_of_a_power_is_its_exponent() {
        let points: Vec<(f64, f64)> = [1.0_f64, 7.0, 30.0, 200.0].map(|x| (x, 3.0 * x.powf(-0.5))).to_vec();
        assert!((super::slope(&points) + 0.5).abs() < 1e-12);
    }
}
