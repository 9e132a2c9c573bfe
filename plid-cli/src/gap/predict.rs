use std::path::PathBuf;

use ndarray::Array2;
use plid::gap::answer::Beyond;
use plid::gap::answer::predict::Predictor;
use plid::gap::case::columns;
use plid::gap::effects::Library;

use super::{Failure, Voice, table, voice};

/// Simulate a new input with the diagnosed effects, in free run from rest.
///
/// Reads sim-with-effect.json from the folder of the diagnosis. The result has one row per input row and one column per
/// output.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  plid gap predict --diagnosis out/gap/diagnosis.json --input u.csv --out y.csv")]
pub struct Arguments {
    /// A diagnosis.json written by `plid gap diagnose`.
    #[arg(long, value_name = "FILE")]
    diagnosis: PathBuf,
    /// The input, with one column named after each input of the simulation.
    #[arg(long, value_name = "FILE")]
    input: PathBuf,
    /// The outputs, CSV.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Start time since the first record began, for drifts and hum [default: end of the last record].
    #[arg(long, value_name = "SECONDS")]
    t0: Option<f64>,
    /// Outputs of your own simulator for that input: the effects' correction is added to them.
    #[arg(long, value_name = "FILE")]
    simulated: Option<PathBuf>,
}

/// Records of one level differ by about so much.
const JUST_BEYOND: f64 = 1.1;

/// Runs the command.
pub fn execute(arguments: Arguments, library: &Library, voice: Voice) -> Result<(), Failure> {
    let folder = arguments.diagnosis.parent().map(PathBuf::from).unwrap_or_default();
    let simulation = folder.join("sim-with-effect.json");
    let sources = [Some(&arguments.diagnosis), Some(&simulation), Some(&arguments.input), arguments.simulated.as_ref()];
    for source in sources.into_iter().flatten() {
        if table::same_file(source, &arguments.out) {
            return Err(Failure::input(format!("--out {} would overwrite what is read", source.display())));
        }
    }
    let predictor = Predictor::read(&simulation, library)?;
    let input = table::read(&arguments.input)?;
    table::require_rate(&input, &arguments.input, &predictor.model, &simulation)?;
    let u = columns(&table::pick(&input, &predictor.model.inputs)?);
    let t0 = arguments.t0.unwrap_or(predictor.t0);
    if !t0.is_finite() {
        return Err(Failure::input(format!("--t0 {t0}: give a time in seconds")));
    }
    let prediction = predictor.predict(&u, t0)?;
    let y = match &arguments.simulated {
        None => prediction.outputs.clone(),
        Some(file) => {
            let own = table::read(file)?;
            table::require_rate(&own, file, &predictor.model, &simulation)?;
            let own = columns(&table::pick(&own, &predictor.model.outputs)?);
            if own[0].len() != u[0].len() {
                return Err(Failure::input(format!(
                    "{}: {} rows, but the input has {}",
                    file.display(),
                    own[0].len(),
                    u[0].len()
                )));
            }
            own.iter().zip(&prediction.correction).map(|(y, c)| y.iter().zip(c).map(|(y, c)| y + c).collect()).collect()
        }
    };
    let samples = y[0].len();
    let values = Array2::from_shape_fn((samples, y.len()), |(k, o)| y[o][k]);
    table::write_csv(&arguments.out, &predictor.model.outputs, &values)?;
    let gap = predictor.expected_gap(&prediction, &y);
    let beyond = prediction.beyond.filter(|beyond| beyond.times > JUST_BEYOND);
    if voice.json {
        return voice::print(&format!(
            "{}\n",
            serde_json::json!({
                "out": arguments.out, "samples": samples, "t0": t0, "expected_gap": gap,
                "beyond_fitted": beyond.map(|beyond| serde_json::json!({ "times": beyond.times, "what": beyond.what })),
            })
        ));
    }
    if voice.quiet {
        return Ok(());
    }
    voice::print(&format!(
        "{samples} samples from {t0:.3} s on: {}; {}\n",
        arguments.out.display(),
        gap.map_or("the outputs are zero".to_string(), |gap| format!("expected gap {:.2} %", 100.0 * gap))
    ))?;
    if let Some(Beyond { times, what }) = beyond {
        let far = if times < 1e3 { format!("{times:.1} times") } else { "far beyond".to_string() };
        voice::remark(&format!("warning: beyond what was fitted: {what} is {far} that of the fitted records"));
    }
    Ok(())
}
