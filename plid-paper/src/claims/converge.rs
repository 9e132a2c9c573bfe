//! Convergence to the true parameters.

use plid_bench::expectations::{self, Config};
use plid_lab::report::{Axis, Chart, Series, chart};
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Inner, Result, claim};

pub const CLAIM: Claim = claim!("converge",
    statement: "The estimate converges almost surely to the true parameters.",
    limit: "A simulation sees many records of finite length, and not the limit. It can see a bias larger than the scatter at the end. Plants are of the model's own order; the truss is not.",
    timed: false,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    samples: Vec<usize>,
    runs: usize,
}

const NAMES: [&str; 5] = ["prior", "posterior", "moment-matched", "certainty-equivalent", "joint-ekf"];

/// Slope of log y over log x by least squares.
fn slope(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let (mx, my) = (logs.iter().map(|p| p.0).sum::<f64>() / count, logs.iter().map(|p| p.1).sum::<f64>() / count);
    let (over, under) = logs.iter().fold((0.0, 0.0), |(o, u), (x, y)| (o + (x - mx) * (y - my), u + (x - mx).powi(2)));
    over / under
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (config, vary): (Config, Vary) = (context.config()?, context.vary()?);
    let mut lines: Vec<Vec<(f64, f64)>> = vec![Vec::new(); NAMES.len()];
    let mut lost = [0; NAMES.len()];
    for &samples in &vary.samples {
        let mut config = config.clone();
        for plant in &mut config.in_class {
            (plant.steps, plant.runs) = (samples, vary.runs);
        }
        let directory = context.directory.join(format!("{samples}-samples"));
        let study = expectations::run(&config, &directory, false, &Inner(context.progress))?;
        let cell = study.cells.first().ok_or("the study has no cell")?;
        for (k, name) in NAMES.iter().enumerate() {
            let score =
                cell.scores.iter().find(|score| score.method == *name).ok_or("the study lacks an expectation")?;
            lost[k] += score.lost;
            let error = score.rmse_a.as_ref().ok_or("no error: every run was lost")?.value;
            lines[k].push((samples as f64, error));
        }
    }
    let mut finding = Finding::default();
    let mut rows = Vec::new();
    for (k, name) in NAMES.iter().enumerate() {
        // The first error is that of the start; the second half of the lengths tells how it goes on.
        let late = &lines[k][lines[k].len() / 2 - 1..];
        let last = lines[k].last().ok_or("no samples")?.1;
        finding = finding.figure(format!("slope, {name}"), slope(late), "").figure(
            format!("error at the end, {name}"),
            last,
            "",
        );
        let errors = lines[k].iter().map(|(_, error)| format!("{error:.5}"));
        rows.push(
            [name.to_string(), format!("{:.2}", slope(late)), lost[k].to_string()].into_iter().chain(errors).collect(),
        );
    }
    let slopes: Vec<f64> = NAMES.iter().map(|name| finding.value(&format!("slope, {name}"))).collect();
    let good: Vec<&str> = NAMES.iter().zip(&slopes).filter(|(_, s)| **s < -0.4).map(|(name, _)| *name).collect();
    let picture = chart(&Chart {
        title: String::new(),
        x: Axis::log("samples"),
        y: Axis::log("RMS error of the entries of a"),
        series: NAMES.iter().zip(&lines).map(|(name, line)| Series::line(*name, line.clone())).collect(),
        height: 230.0,
    });
    let heads: Vec<String> = vary.samples.iter().map(|k| format!("{k} samples")).collect();
    let heads: Vec<(&str, &str)> = [("expectation", ""), ("slope", ""), ("lost runs", "")]
        .into_iter()
        .chain(heads.iter().map(|h| (h.as_str(), "")))
        .collect();
    let rule = |name: &str| {
        format!(
            "With `{name}` the error falls with a slope below -0.4 over the longer records: the square root's is -0.5, and a bias would flatten it."
        )
    };
    for (name, slope) in NAMES.iter().zip(&slopes) {
        finding = finding.part(rule(name), *slope < -0.4);
    }
    let listed: Vec<String> = NAMES.iter().zip(&slopes).map(|(name, slope)| format!("{name} {slope:.2}")).collect();
    Ok(finding
        .picture(picture, format!("RMS over {} random plants of the model's order, signal-to-noise ratio {}.", vary.runs, config.signal_to_noise[0]))
        .table("RMS error of the entries of a_1 .. a_p.", &heads, rows)
        .say(format!(
            "Over the longer records the error falls with these slopes (the square root's is -0.5): {}. {} of the five readings of the conditional expectation converge as they should up to {} samples.",
            listed.join(", "), good.len(), vary.samples.last().unwrap_or(&0)
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
