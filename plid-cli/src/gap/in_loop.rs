//! Diagnosis and prediction with a program or an FMU as the simulator.

use std::path::Path;
use std::time::Duration;

use ndarray::Array2;
use plid::gap::GapError;
use plid::gap::answer::predict::Prediction;
use plid::gap::case::{Case, CaseConfig, Channels, SimulatorConfig, columns};
use plid::gap::effects::Library;
use plid::gap::in_loop::{self, LoopPredictor};
use plid::simulator::Command;

use super::predict::{Arguments, Stated, own_outputs, say, sum};
use super::serve_fmu::Choice;
use super::{Failure, Voice, directory, progress::Spinner, table, voice};

/// Starts the simulator of a case. An FMU runs in a separate process, because it may crash or hang.
pub fn start(case: &CaseConfig, simulator: &SimulatorConfig, file: &Path) -> Result<Command, GapError> {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let patience = Duration::from_secs_f64(simulator.patience_s);
    match simulator.source() {
        None => Ok(Command::start(&simulator.command, folder, patience)?),
        Some(source) => Choice::of_case(&source, case.rate(), &simulator.parameters, simulator.steps_per_sample)
            .channels(&case.inputs, &case.outputs)
            .start(Path::new(&source.file), folder, patience),
    }
}

/// Diagnoses a case with its program, and writes the answer into a folder.
pub fn diagnose(
    case: &Case,
    simulator: &SimulatorConfig,
    library: &Library,
    file: &Path,
    out: &Path,
    voice: Voice,
) -> Result<(), Failure> {
    let outcome = directory::with(out, || {
        let mut simulator = start(&case.config, simulator, file)?;
        let quiet = voice.quiet || voice.json;
        let outcome = Spinner::during(quiet, |say| in_loop::diagnose(case, &mut simulator, library, say))?;
        outcome.write(case, out)?;
        Ok(outcome)
    })?;
    if voice.json {
        return voice::print(&outcome.diagnosis().map_err(Failure::work)?);
    }
    if voice.quiet {
        return Ok(());
    }
    voice::print(&format!("{}report: {}\n", outcome.text(), out.join("report.html").display()))
}

/// Returns whether a sim-with-effect.json belongs to a simulator in the loop.
pub fn is_of_simulator(simulation: &Path) -> Result<bool, Failure> {
    let text = std::fs::read(simulation).map_err(|error| Failure::file(simulation, &error))?;
    let format = serde_json::from_slice::<serde_json::Value>(&text).ok();
    Ok(format.is_some_and(|json| json["format"] == in_loop::FORMAT))
}

/// Predicts the outputs for a new input with the program or the FMU of the diagnosis. If outputs of the engineer's own
/// simulator are given, the change from the simulator as given is added to these.
pub fn predict(arguments: &Arguments, simulation: &Path, library: &Library, voice: Voice) -> Result<(), Failure> {
    let Arguments { input, out, t0, folder, simulated, measured, .. } = arguments;
    if measured.is_some() {
        let message = "--measured: the simulator of this diagnosis contains its controller, so no feedback is removed";
        return Err(Failure::input(message.to_string()));
    }
    let predictor = LoopPredictor::read(simulation, library)?;
    let written = &predictor.written;
    if written.command.is_empty() && written.fmu.is_none() {
        let message =
            format!("{}: the simulator of this diagnosis was neither a program nor an FMU", simulation.display());
        return Err(Failure::input(message));
    }
    let t0 = t0.unwrap_or(written.t0);
    if !t0.is_finite() {
        return Err(Failure::input(format!("--t0 {t0}: give a time in seconds")));
    }
    let read = |file: &Path, names: &[String]| -> Result<Channels, Failure> {
        let record = table::read(file)?;
        table::require_rate(&record, file, written.simulator.rate_hz, simulation)?;
        Ok(columns(&table::pick(&record, names)?))
    };
    let names: Vec<String> = written.simulator.inputs.iter().map(|input| input.name.clone()).collect();
    let outputs: Vec<String> = written.simulator.outputs.iter().map(|output| output.name.clone()).collect();
    let u = read(input, &names)?;
    let own = simulated.as_ref().map(|file| own_outputs(file, read(file, &outputs)?, &u)).transpose()?;
    let mut simulator = match &written.fmu {
        None => Command::start(&written.command, folder, Command::PATIENCE).map_err(GapError::from)?,
        Some(source) => {
            let choice = Choice::again(source, &written.simulator);
            choice.start(Path::new(&source.file), folder, Command::PATIENCE)?
        }
    };
    let prediction = match own {
        None => predictor.predict(&mut simulator, &u, t0)?,
        Some(own) => {
            let prediction = predictor.predict_change(&mut simulator, &u, t0)?;
            let change = prediction.change.as_ref().unwrap_or(&prediction.correction);
            Prediction { outputs: sum(&own, change), ..prediction }
        }
    };
    let y = &prediction.outputs;
    let values = Array2::from_shape_fn((y[0].len(), y.len()), |(k, o)| y[o][k]);
    table::write_csv(out, &outputs, &values)?;
    let (gap, stated) = (predictor.expected_gap(&prediction), Stated::read(&arguments.diagnosis));
    say((out.as_path(), y[0].len()), t0, gap, stated, prediction.beyond, voice)
}
