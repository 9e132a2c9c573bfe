use std::path::{Path, PathBuf};

use ndarray::Array2;
use plid::gap::answer::Beyond;
use plid::gap::answer::predict::Predictor;
use plid::gap::case::{Channels, columns};
use plid::gap::effects::Library;
use plid::report::percent;

use super::{Failure, Voice, in_loop, table, voice};

/// Simulate a new input with the diagnosed effects, in free run from rest.
///
/// Reads sim-with-effect.json from the folder of the diagnosis. The result has one row per input row and one column per
/// output.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  plid gap predict --diagnosis out/gap/diagnosis.json --input u.csv --out y.csv")]
pub struct Arguments {
    /// A diagnosis.json written by `plid gap diagnose`.
    #[arg(long, value_name = "FILE")]
    pub(super) diagnosis: PathBuf,
    /// The input, with one column named after each input of the simulation; in closed loop, after each reference.
    #[arg(long, value_name = "FILE")]
    pub(super) input: PathBuf,
    /// The outputs, CSV.
    #[arg(long, value_name = "FILE")]
    pub(super) out: PathBuf,
    /// Outputs measured in closed loop, if the input is the command recorded with them: the feedback is removed.
    #[arg(long, value_name = "FILE")]
    pub(super) measured: Option<PathBuf>,
    /// Start time since the first record began, for drifts and hum [default: end of the last record].
    #[arg(long, value_name = "SECONDS")]
    pub(super) t0: Option<f64>,
    /// Folder in which the simulator program of the diagnosis is started, if there is one; use the folder of its case
    /// [default: the current folder].
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub(super) folder: PathBuf,
    /// Outputs of your own simulator for that input: the change due to the refit and the effects is added to them.
    #[arg(long, value_name = "FILE")]
    pub(super) simulated: Option<PathBuf>,
}

/// Runs the command.
pub fn execute(arguments: Arguments, library: &Library, voice: Voice) -> Result<(), Failure> {
    let simulation = arguments.diagnosis.with_file_name("sim-with-effect.json");
    arguments.overwrites_nothing(&simulation)?;
    if in_loop::is_of_simulator(&simulation)? {
        return in_loop::predict(&arguments, &simulation, library, voice);
    }
    let predictor = Predictor::read(&simulation, library)?;
    let u = arguments.driving(&predictor, &simulation)?;
    let t0 = arguments.t0.unwrap_or(predictor.t0);
    if !t0.is_finite() {
        return Err(Failure::input(format!("--t0 {t0}: give a time in seconds")));
    }
    let prediction = predictor.predict(&u, t0)?;
    let y = match &arguments.simulated {
        None => prediction.outputs.clone(),
        Some(file) => {
            let own = own_outputs(file, read(file, &predictor, &predictor.model.outputs, &simulation)?, &u)?;
            // A file from an earlier version does not contain the simulation as given.
            sum(&own, prediction.change.as_ref().unwrap_or(&prediction.correction))
        }
    };
    let values = Array2::from_shape_fn((y[0].len(), y.len()), |(k, o)| y[o][k]);
    table::write_csv(&arguments.out, &predictor.model.outputs, &values)?;
    let gap = predictor.expected_gap(&prediction, &y);
    let stated = Stated::read(&arguments.diagnosis);
    say((&arguments.out, y[0].len()), t0, gap, stated, prediction.beyond, voice)
}

/// Returns the outputs of the engineer's own simulator, if they have a row for each row of the inputs.
pub(super) fn own_outputs(file: &Path, own: Channels, inputs: &[Vec<f64>]) -> Result<Channels, Failure> {
    let (rows, inputs) = (own[0].len(), inputs[0].len());
    if rows == inputs {
        return Ok(own);
    }
    Err(Failure::input(format!("{}: {rows} rows, but the input has {inputs}", file.display())))
}

/// Returns the sum of the same channels.
pub(super) fn sum(a: &[Vec<f64>], b: &[Vec<f64>]) -> Channels {
    a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a + b).collect()).collect()
}

/// The gap that a diagnosis states for a further record at full level, with its 80 % interval.
pub(super) struct Stated {
    gap: f64,
    ci80: [f64; 2],
}

impl Stated {
    /// Reads the statement of a diagnosis.json. The prediction does not depend on it, so a file that is absent or does
    /// not contain it is no error.
    pub(super) fn read(diagnosis: &Path) -> Option<Self> {
        let json: serde_json::Value = serde_json::from_slice(&std::fs::read(diagnosis).ok()?).ok()?;
        let gap = &json["gap"];
        let end = |k: usize| gap["predicted_ci80"][k].as_f64();
        Some(Self { gap: gap["predicted_held_out_gap"].as_f64()?, ci80: [end(0)?, end(1)?] })
    }
}

impl std::fmt::Display for Stated {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [gap, low, high] = [self.gap, self.ci80[0], self.ci80[1]].map(percent);
        write!(f, "on a record at full level {gap}, 80 % interval {low} to {high}")
    }
}

impl Arguments {
    fn overwrites_nothing(&self, simulation: &Path) -> Result<(), Failure> {
        let optional = [self.simulated.as_deref(), self.measured.as_deref()];
        let sources = [Some(self.diagnosis.as_path()), Some(simulation), Some(&self.input)].into_iter().chain(optional);
        match sources.flatten().find(|source| table::same_file(source, &self.out)) {
            Some(source) => Err(Failure::input(format!("--out {} would overwrite what is read", source.display()))),
            None => Ok(()),
        }
    }
}

impl Arguments {
    /// Reads the inputs of the prediction.
    fn driving(&self, predictor: &Predictor, simulation: &Path) -> Result<Channels, Failure> {
        let Some(measured) = &self.measured else {
            return read(&self.input, predictor, &predictor.inputs, simulation);
        };
        let u = read(&self.input, predictor, &predictor.model.inputs, simulation)?;
        let y = read(measured, predictor, &predictor.model.outputs, simulation)?;
        if u[0].len() != y[0].len() {
            let (rows, inputs) = (y[0].len(), u[0].len());
            return Err(Failure::input(format!("{}: {rows} rows, but the input has {inputs}", measured.display())));
        }
        predictor.without_feedback(&u, &y).ok_or_else(|| {
            let message = "--measured: this simulation is not driven by commands that a controller adds to";
            Failure::input(message.to_string())
        })
    }
}

/// Reads channels from a file at the rate of the simulation.
fn read(file: &Path, predictor: &Predictor, names: &[String], simulation: &Path) -> Result<Channels, Failure> {
    let table = table::read(file)?;
    table::require_rate(&table, file, predictor.model.sample_rate_hz, simulation)?;
    Ok(columns(&table::pick(&table, names)?))
}

/// Reports what was written and how good it is expected to be, and warns if the input exceeds the fitted range.
pub(super) fn say(
    (out, samples): (&Path, usize),
    t0: f64,
    gap: Option<f64>,
    stated: Option<Stated>,
    beyond: Option<Beyond>,
    voice: Voice,
) -> Result<(), Failure> {
    if voice.json {
        let beyond = beyond.filter(Beyond::is_clear);
        return voice::print(&format!(
            "{}\n",
            serde_json::json!({
                "out": out, "samples": samples, "t0": t0, "expected_gap": gap,
                "predicted_held_out_gap": stated.as_ref().map(|stated| stated.gap),
                "predicted_ci80": stated.as_ref().map(|stated| stated.ci80),
                "beyond_fitted": beyond.map(|beyond| serde_json::json!({ "times": beyond.times, "what": beyond.what })),
            })
        ));
    }
    if voice.quiet {
        return Ok(());
    }
    let gap = gap.map_or("the outputs are zero".to_string(), |gap| format!("expected gap {}", percent(gap)));
    let stated = stated.map_or_else(String::new, |stated| format!(" ({stated})"));
    voice::print(&format!("{samples} samples from {t0:.3} s on: {}; {gap}{stated}\n", out.display()))?;
    if let Some(warning) = beyond.and_then(|beyond| beyond.warning()) {
        voice::remark(&format!("warning: {warning}"));
    }
    Ok(())
}
