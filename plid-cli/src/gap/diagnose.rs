use std::path::PathBuf;

use plid::gap::case::Case;
use plid::gap::effects::Library;
use plid::gap::{diagnose, write};
use plid::model::to_json;

use super::{Failure, Voice, directory, in_loop, progress::Spinner, voice};

/// The shortest case, then the keys for measured data.
const EXAMPLE: &str = r#"Example of a case:
  sim = "sim.json"
  sample_rate_hz = 1600.0
  inputs = ["u1", "u2"]
  outputs = ["y1", "y2"]

  [[record]]
  file = "quiet.csv"
  excitation = "zero"

  [[record]]
  file = "random.csv"

Optional keys for measured data:
  states = 24               # without `sim`: order of the surrogate model
  decimate_to_hz = 400.0
  trend = "mean"            # none, mean or linear: removed from every channel
  band_hz = [1.0, 160.0]    # only these frequencies are fitted and judged

  [[record]]
  file = "measured.csv"     # relative to the case, or to --data DIR
  samples = [0, 8192]       # the first row, and the one after the last
  start = "unknown"         # not at rest: the initial state is fitted
  use = "sim"               # for the surrogate model; or "fit", "test"

  [[record]]
  file = "measured.csv"
  samples = [8192, 40960]
  excitation = "periodic"
  period = 8192
  start = "unknown"

Your own simulator in place of `sim` (see `plid gap check-simulator --help`):
  [simulator]
  command = ["python3", "my_simulator.py"]   # started in the folder of the case
  patience_s = 60.0                          # longest time for one run
  limits = { "motor damper" = 0.02 }         # expected errors of its parameters: not named as causes

An FMU in its place (see `plid gap serve-fmu --help`):
  [simulator]
  fmu = "model.fmu"                          # relative to the case
  parameters = ["mass", "motor.damper"]      # those that may be wrong
  steps_per_sample = 10

  [[simulator.port]]                         # a place that takes a force
  name = "joint"
  force = "torque"
  displacement = "angle"
  velocity = "speed"

With either:
  [settings.in_loop]
  calls = 300                                # largest number of runs
  seconds = 600                              # longest time in the simulator"#;

/// Diagnose the gap between records and a simulation.
///
/// CASE.toml names the simulation (a model.json) and the records. Writes DIR/diagnosis.json (the answer),
/// DIR/sim-with-effect.json (the simulation with the effects, used by `plid gap predict`) and DIR/report.html.
#[derive(clap::Args)]
#[command(after_help = EXAMPLE)]
pub struct Arguments {
    /// The case.
    #[arg(value_name = "CASE.toml")]
    case: PathBuf,
    /// Folder of the record files [default: that of the case file].
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Output directory [default: out/CASE].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write into a directory that is not empty.
    #[arg(long)]
    force: bool,
    /// Remove an effect from the vocabulary, to see how the diagnosis treats an effect it does not know. May be
    /// repeated.
    #[arg(long, value_name = "EFFECT")]
    without: Vec<String>,
}

/// Runs the command.
pub fn execute(arguments: Arguments, library: Library, voice: Voice) -> Result<(), Failure> {
    if let Some(name) = arguments.without.iter().find(|name| library.get(name).is_none()) {
        let known: Vec<&str> = library.effects().map(|effect| effect.name()).collect();
        return Err(Failure::input(format!("--without {name}: the vocabulary is {}", known.join(", "))));
    }
    let library = library.without(&arguments.without);
    let stem = arguments.case.file_stem().map_or_else(|| "case".into(), |stem| stem.to_string_lossy().into_owned());
    let out = arguments.out.clone().unwrap_or_else(|| directory::default_for(&stem));
    directory::check(&out, arguments.force)?;
    let case = match &arguments.data {
        Some(data) => Case::read_with(&arguments.case, data)?,
        None => Case::read(&arguments.case)?,
    };
    if let Some(simulator) = &case.config.simulator {
        return in_loop::diagnose(&case, simulator, &library, &arguments.case, &out, voice);
    }
    let outcome = directory::with(&out, || {
        let outcome = Spinner::during(voice.quiet || voice.json, |say| diagnose(&case, &library, say))?;
        write(&outcome, &case, &out)?;
        Ok(outcome)
    })?;
    if voice.json {
        return voice::print(&to_json(&outcome.diagnosis).map_err(Failure::work)?);
    }
    if voice.quiet {
        return Ok(());
    }
    let mut text = outcome.diagnosis.text();
    text += &format!("report: {}\n", out.join("report.html").display());
    voice::print(&text)
}
