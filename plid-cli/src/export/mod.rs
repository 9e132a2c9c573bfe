//! `plid export`: a model for other programs.

mod mat;
mod npz;
mod script;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use nalgebra::{DMatrix, DVector};
use plid::lab::report::write_atomic;
use plid::model::Model;

use super::{Failure, Voice, table, voice};

/// Write a model for MATLAB, NumPy or Python.
///
/// The ending of --to selects the format. A .mat and a .npz hold A, B, C, D, sample_rate_hz and, where the model has
/// them, predictor_gain, parameter_covariance, observability_indices and initial_state, each with the meaning that it
/// has in model.json; `more` holds all other keys as JSON. A .py is a module of NumPy arrays with a function that
/// simulates. `plid.Model.load` in Python reads .mat and .npz back.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  plid export out/truss/model.json --to model.mat\n  \
                  plid export model.json --to model.npz\n  \
                  plid export model.json --to model.py\n\n\
                  In MATLAB:  load model.mat; sys = ss(A, B, C, D, 1 / sample_rate_hz)\n\
                  In Python:  from model import simulate, A, B, C, D")]
pub struct Arguments {
    /// The model, a model.json.
    #[arg(value_name = "MODEL.json")]
    model: PathBuf,
    /// The file to write: .mat, .npz or .py.
    #[arg(long, value_name = "FILE")]
    to: PathBuf,
    /// Overwrite an existing file.
    #[arg(long)]
    force: bool,
}

/// A variable of a .mat or .npz.
pub enum Variable {
    /// A matrix.
    Matrix(DMatrix<f64>),
    /// A list of numbers.
    Vector(DVector<f64>),
    /// One number.
    Number(f64),
    /// Text.
    Text(String),
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let Arguments { model: from, to, force } = arguments;
    let ending = to.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_ascii_lowercase();
    if !["mat", "npz", "py"].contains(&ending.as_str()) {
        return Err(Failure::input(format!("--to {}: the ending is not .mat, .npz or .py", to.display())));
    }
    if table::same_file(from, to) {
        return Err(Failure::input(format!("--to {} would overwrite the model", to.display())));
    }
    if to.exists() && !force {
        return Err(Failure::input(format!("{} already exists; use --force to replace it", to.display())));
    }
    let model = Model::read(from)?;
    let bytes = match ending.as_str() {
        "mat" => mat::file(&variables(&model)),
        "npz" => npz::file(&variables(&model)).map_err(|error| Failure::file(to, &error))?,
        _ => script::text(&model, from).into_bytes(),
    };
    write_atomic(to, &bytes).map_err(|error| Failure::file(to, &error))?;
    said(to, &model, voice)
}

fn said(to: &Path, model: &Model, voice: Voice) -> Result<(), Failure> {
    if voice.json {
        return voice::print(&format!("{}\n", serde_json::json!({ "to": to, "states": model.n() })));
    }
    if voice.quiet {
        return Ok(());
    }
    let (n, m, p) = (model.n(), model.m(), model.p());
    voice::print(&format!("{n} states, {m} inputs, {p} outputs: {}\n", to.display()))
}

/// Returns the variables of a model, as `plid.Model.save` in Python writes them.
fn variables(model: &Model) -> Vec<(&'static str, Variable)> {
    let matrix = |matrix: &DMatrix<f64>| Variable::Matrix(matrix.clone());
    let mut all =
        vec![("A", matrix(&model.a)), ("B", matrix(&model.b)), ("C", matrix(&model.c)), ("D", matrix(&model.d))];
    all.extend(model.predictor_gain.as_ref().map(|gain| ("predictor_gain", matrix(gain))));
    all.extend(model.parameter_covariance.as_ref().map(|covariance| ("parameter_covariance", matrix(covariance))));
    let indices = model.observability_indices.as_ref();
    all.extend(indices.map(|indices| {
        let indices = DVector::from_iterator(indices.len(), indices.iter().map(|index| *index as f64));
        ("observability_indices", Variable::Vector(indices))
    }));
    all.extend(model.initial_state.as_ref().map(|state| ("initial_state", Variable::Vector(state.clone()))));
    all.push(("sample_rate_hz", Variable::Number(model.sample_rate_hz)));
    let mut more = model.to_json();
    if let Some(keys) = more.as_object_mut() {
        keys.retain(|key, _| all.iter().all(|(name, _)| name != key));
    }
    all.push(("more", Variable::Text(ascii(&more.to_string()))));
    all
}

/// Returns JSON with letters beyond ASCII as escapes, because not every reader of a .mat knows their encoding.
fn ascii(json: &str) -> String {
    let mut text = String::new();
    for letter in json.chars() {
        if letter.is_ascii() {
            text.push(letter);
            continue;
        }
        for unit in letter.encode_utf16(&mut [0; 2]) {
            let _ = write!(text, "\\u{unit:04x}");
        }
    }
    text
}
