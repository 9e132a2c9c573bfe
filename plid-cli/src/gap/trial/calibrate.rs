use std::path::PathBuf;

use plid_trial::calibrate::{About, Agreement, Figures};
use plid_trial::{Calibrated, Opened, calibrate};

use super::{Failure, Voice, voice};
use crate::identify::parse;

/// Fit the calibration of stated probabilities to trials, and check it on others.
///
/// Each answer records what its probabilities are based on. A logistic regression finds how often such statements
/// were right. A table compares the statistics that answers record by how well each separates right first effects from
/// wrong ones. Writes calibration.json (for plid-gap/src/judge), agreement.json, reliability.svg and separation.csv.
/// The trials must not be those on which results are reported.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Example, with trials that `plid gap trial diagnose` has answered:\n",
        "  plid gap trial calibrate --fit T1 S1 --fit T2 S2 --check T3 S3 --out out/calibration\n",
        "then open out/calibration/reliability.svg",
    )
)]
pub struct Arguments {
    /// A trial and its sealed folder to which the calibration is fitted.
    #[arg(long, num_args = 2, value_names = ["T", "S"], required = true)]
    fit: Vec<PathBuf>,
    /// A trial and its sealed folder on which the calibration is checked.
    #[arg(long, num_args = 2, value_names = ["T", "S"])]
    check: Vec<PathBuf>,
    /// Kinds of statements to fit, separated by commas; the others keep the coefficients of this program. One or more
    /// of effect, explanation, further, nothing, unknown, remainder.
    #[arg(long, value_name = "KINDS", value_delimiter = ',', value_parser = parse::<About>)]
    only: Vec<About>,
    /// Folder for the results.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let pairs = |paths: &[PathBuf]| -> Vec<Opened> {
        paths.chunks_exact(2).map(|pair| Opened { trial: pair[0].clone(), sealed: pair[1].clone() }).collect()
    };
    let calibrated = calibrate(&pairs(&arguments.fit), &pairs(&arguments.check), &arguments.only, &arguments.out)?;
    if voice.json {
        return voice::print(&format!("{:#}\n", serde_json::json!(calibrated)));
    }
    if voice.quiet {
        return Ok(());
    }
    voice::print(&format!("{}results: {}\n", summary(&calibrated), arguments.out.display()))
}

fn summary(calibrated: &Calibrated) -> String {
    let mut text = String::from("trials that were fitted, by cross-validation:\n");
    text.extend(calibrated.crossed.iter().map(line));
    if !calibrated.checked.is_empty() {
        text += "trials that were checked:\n";
        text.extend(calibrated.checked.iter().map(line));
    }
    text + &separation(calibrated)
}

/// Returns the table of statistics: each alone, and beside the present basis.
fn separation(calibrated: &Calibrated) -> String {
    if calibrated.separation.is_empty() {
        return String::new();
    }
    let figures = |figures: Option<&Figures>| {
        figures.map_or(String::new(), |one| {
            let auc = one.auc.map_or("-".to_owned(), |auc| format!("{auc:.3}"));
            let [gain, error] = one.gain;
            format!("{:.3} ({gain:+.3} +- {error:.3})   {:.3}   {auc}", one.brier, one.log_loss)
        })
    };
    let mut text = String::from(
        "what separates right first effects from wrong ones, by cross-validation (Brier score, and in brackets how far \
         it is below that of the present basis; log loss; area under the curve):\n",
    );
    text += &format!("  {:<20} {:>9}   {:<42}   beside the present basis\n", "statistic", "answers", "alone");
    for row in &calibrated.separation {
        let (alone, beside) = (figures(Some(&row.alone)), figures(row.beside.as_ref()));
        let line = format!("  {:<20} {:>9}   {alone:<42}   {beside}", row.statistic, row.answers);
        text += &format!("{}\n", line.trim_end());
    }
    text
}

/// Returns a line of text: how many statements were right, the expected calibration error before the calibration,
/// after it and by chance alone, and the Brier score before and after.
fn line(agreement: &Agreement) -> String {
    let about = agreement.about.map_or("all", |about| about.name());
    let Agreement { right, before, after, by_chance, .. } = agreement;
    let figure = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x:.3}"));
    format!(
        "  {about:<11} {:>4} of {:>4} right   calibration error {} -> {} ({} by chance)   \
        Brier score {} -> {}\n",
        right.hits,
        right.of,
        figure(before.expected_error),
        figure(after.expected_error),
        figure(*by_chance),
        figure(before.brier),
        figure(after.brier),
    )
}
