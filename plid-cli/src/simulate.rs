//! `plid simulate`: the free run of a model on an input.

use std::path::PathBuf;

use ndarray::Array2;
use plid::model::{Model, simulate};

use super::{Failure, Voice, table, voice};

/// Simulate a model in free run: x_{k+1} = A x_k + B u_k, y_k = C x_k + D u_k, from rest.
///
/// The input file needs one column per model input, named after it; its sample rate, if stated, must match the model's.
/// The result has one row per input row and one column per output. A model identified by plid describes deviations from
/// its operating point; --operating-point subtracts the operating point from the input and adds it to the output.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  plid simulate --model out/truss/model.json --input u.csv --out y.csv")]
pub struct Arguments {
    /// The model, a model.json.
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// The input, in any data format.
    #[arg(long, value_name = "FILE")]
    input: PathBuf,
    /// The simulated outputs, CSV.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Start from the model's own initial_state instead of rest.
    #[arg(long)]
    from_model_state: bool,
    /// Account for the means that were removed before identification.
    #[arg(long)]
    operating_point: bool,
}

/// Returns the means of inputs and outputs that the provenance of an identified model states.
fn operating_point(model: &Model) -> Option<[Vec<f64>; 2]> {
    let point = model.provenance.as_ref()?.get("operating_point")?;
    let list = |key: &str| -> Option<Vec<f64>> { point.get(key)?.as_array()?.iter().map(|x| x.as_f64()).collect() };
    let (inputs, outputs) = (list("inputs")?, list("outputs")?);
    (inputs.len() == model.m() && outputs.len() == model.p()).then_some([inputs, outputs])
}

fn shift(values: &mut Array2<f64>, by: &[f64], sign: f64) {
    for (mut column, offset) in values.columns_mut().into_iter().zip(by) {
        column.mapv_inplace(|x| x + sign * offset);
    }
}

/// Runs the command.
pub fn execute(arguments: Arguments, voice: Voice) -> Result<(), Failure> {
    for source in [&arguments.model, &arguments.input] {
        if table::same_file(source, &arguments.out) {
            return Err(Failure::input(format!("--out {} would overwrite what is read", source.display())));
        }
    }
    let model = Model::read(&arguments.model)?;
    let input = table::read(&arguments.input)?;
    table::require_rate(&input, &arguments.input, model.sample_rate_hz, &arguments.model)?;
    let mut inputs = table::pick(&input, &model.inputs)?;
    let x0 = match (arguments.from_model_state, &model.initial_state) {
        (false, _) => model.rest(),
        (true, Some(state)) => state.clone(),
        (true, None) => {
            return Err(Failure::input(format!("{} has no `initial_state`", arguments.model.display())));
        }
    };
    let point = match (arguments.operating_point, operating_point(&model)) {
        (false, _) => None,
        (true, Some(point)) => Some(point),
        (true, None) => return Err(Failure::input(format!("{} has no operating point", arguments.model.display()))),
    };
    if let Some([means, _]) = &point {
        shift(&mut inputs, means, -1.0);
    }
    let mut simulation = simulate(&model, inputs.view(), &x0)?;
    if let Some([_, means]) = &point {
        shift(&mut simulation.outputs, means, 1.0);
    }
    table::write_csv(&arguments.out, &model.outputs, &simulation.outputs)?;
    let samples = simulation.outputs.nrows();
    if voice.json {
        voice::print(&format!("{}\n", serde_json::json!({ "out": arguments.out, "samples": samples })))
    } else if voice.quiet {
        Ok(())
    } else {
        voice::print(&format!("{samples} samples of {}: {}\n", model.outputs.join(", "), arguments.out.display()))
    }
}
