//! The merge of finished runs: checks, the parameters of each run, and the merged matrices.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use plid_core::{ImplicitModel, ObservableForm};
use plid_model::{Model, undo_advance};
use serde_json::{Map, json};

use super::finished::FinishedRun;
use super::{Combined, Consistency, Knowledge, MergeError, combine, consistency};
use crate::run::{Estimate, RunError, parameters};

/// An input counts as at rest in a record if its RMS is at most this fraction of its RMS in the record where it acts.
pub const REST: f64 = 1e-3;

/// A larger ratio between the scales of P causes a warning, because the merge corrects the scales but not the shapes.
const UNLIKE: f64 = 30.0;

/// The merged model of several runs.
#[derive(Clone, Debug)]
pub struct Merged {
    /// The merged model in the data's units.
    pub model: Model,
    /// The model in canonical form with its parameter covariance, before an input advance is undone.
    pub canonical: Model,
    /// Number of samples by which the inputs were advanced.
    pub advanced: usize,
    /// The test of whether the runs share A.
    pub consistency: Consistency,
    /// Warnings about properties that could not be checked.
    pub remarks: Vec<String>,
}

/// Merges finished runs. The inputs are in the order of the runs.
///
/// # Errors
/// Returns a [`MergeError`] with run and key if the runs differ in a property that they must share, if another input
/// acts in the record of a run, or if the numbers of a run are invalid.
pub fn merge(runs: &[FinishedRun]) -> Result<Merged, RunError> {
    if runs.len() < 2 {
        return Err(MergeError::TooFew.into());
    }
    runs.iter().skip(1).try_for_each(|run| alike(&runs[0], run))?;
    let mut remarks = at_rest(runs)?;
    remarks.extend(unlike_noise(runs));
    let pieces: Vec<Piece<'_>> = runs.iter().map(FinishedRun::piece).collect();
    let (form, inputs) = whole_form(&pieces)?;
    let knowledge = pieces.iter().map(|piece| knowledge(piece, &form, &inputs)).collect::<Result<Vec<_>, _>>()?;
    let canonical = joined(&pieces, &knowledge, &form, inputs)?;
    let consistency = consistency(&knowledge, form.parameter_columns() * form.states())?;
    let advanced = runs[0].advanced;
    let mut model = if advanced == 1 { undo_advance(&canonical, None)? } else { canonical.clone() };
    model.provenance = Some(provenance(runs, advanced));
    Ok(Merged { model, canonical, advanced, consistency, remarks })
}

/// The part of a run that the merge uses.
#[derive(Clone, Copy)]
pub(super) struct Piece<'a> {
    pub(super) name: &'a str,
    /// The model in canonical form, in the data's units.
    pub(super) model: &'a Model,
    pub(super) estimate: &'a Estimate,
}

/// Returns the model of all inputs in canonical form, from runs that have been checked.
pub(super) fn join(pieces: &[Piece<'_>]) -> Result<Model, RunError> {
    let (form, inputs) = whole_form(pieces)?;
    let knowledge = pieces.iter().map(|piece| knowledge(piece, &form, &inputs)).collect::<Result<Vec<_>, _>>()?;
    joined(pieces, &knowledge, &form, inputs)
}

/// Returns the structure with all inputs, and the inputs in the order of the runs.
fn whole_form(pieces: &[Piece<'_>]) -> Result<(ObservableForm, Vec<String>), RunError> {
    let mut inputs: Vec<String> = Vec::new();
    for input in pieces.iter().flat_map(|piece| &piece.model.inputs) {
        if !inputs.contains(input) {
            inputs.push(input.clone());
        }
    }
    Ok((form(&pieces[0], inputs.len())?, inputs))
}

/// Returns the structure of a run's model with the given number of inputs.
fn form(piece: &Piece<'_>, inputs: usize) -> Result<ObservableForm, MergeError> {
    let indices = piece.model.observability_indices.as_deref().unwrap_or_default();
    ObservableForm::new(indices, inputs).map_err(|error| {
        let problem = format!("its observability_indices are invalid: {error}");
        MergeError::Unusable { run: piece.name.into(), problem }
    })
}

fn alike(first: &FinishedRun, run: &FinishedRun) -> Result<(), MergeError> {
    let (a, b) = (&first.model, &run.model);
    let differ = |what, found: String, expected: String| MergeError::Differ {
        run: run.name.clone(),
        what,
        found,
        first: first.name.clone(),
        expected,
    };
    if (a.sample_rate_hz - b.sample_rate_hz).abs() > 1e-6 * a.sample_rate_hz {
        let hz = |rate: f64| format!("{rate} Hz");
        return Err(differ("sample rate is", hz(b.sample_rate_hz), hz(a.sample_rate_hz)));
    }
    if a.outputs != b.outputs {
        return Err(differ("outputs are", b.outputs.join(", "), a.outputs.join(", ")));
    }
    if a.observability_indices != b.observability_indices {
        let list = |model: &Model| format!("{:?}", model.observability_indices.as_deref().unwrap_or_default());
        return Err(differ("observability indices are", list(b), list(a)));
    }
    if first.advanced != run.advanced {
        // If the feedthrough is small, noise may decide the test for feedthrough, so runs may differ in the advance.
        let samples = |count: usize| format!("advanced by {count} (set `preparation.advance` in both)");
        return Err(differ("input is", samples(run.advanced), samples(first.advanced)));
    }
    Ok(())
}

/// Checks that no input of another run acts in a run's record, and returns warnings about inputs that a record does not
/// contain.
fn at_rest(runs: &[FinishedRun]) -> Result<Vec<String>, MergeError> {
    let mut elsewhere: BTreeMap<&str, f64> = BTreeMap::new();
    for run in runs {
        for input in &run.model.inputs {
            let rms = run.estimate.channel_rms.get(input).copied().unwrap_or(0.0);
            let entry = elsewhere.entry(input).or_insert(0.0);
            *entry = entry.max(rms);
        }
    }
    let mut remarks = Vec::new();
    for run in runs {
        let mut unseen = Vec::new();
        for (&other, &acting) in elsewhere.iter().filter(|(name, _)| !run.model.inputs.iter().any(|own| own == *name)) {
            match run.estimate.channel_rms.get(other) {
                Some(&rms) if rms > REST * acting => {
                    return Err(MergeError::AnotherActs {
                        record: run.name.clone(),
                        acting: run.model.inputs.join(", "),
                        other: other.into(),
                        share: rms / acting,
                    });
                }
                Some(_) => {}
                None => unseen.push(other),
            }
        }
        if !unseen.is_empty() {
            remarks.push(format!(
                "the record of {} has no column {}, which is assumed to be at rest",
                run.name,
                unseen.join(", ")
            ));
        }
    }
    Ok(remarks)
}

/// Returns a warning if the runs' noise covariances differ so much that the shapes of their P differ too.
fn unlike_noise(runs: &[FinishedRun]) -> Option<String> {
    let ratios = || runs.iter().map(|run| run.estimate.innovation_ratio);
    let (least, most) = (ratios().fold(f64::INFINITY, f64::min), ratios().fold(0.0, f64::max));
    (most > UNLIKE * least).then(|| {
        format!(
            "the noise covariances of the runs differ: the innovations are from {least:.1e} to {most:.1e} times their \
             expected variance; give all runs one `[noise]`, or merge by `structure.kind = \"simo-merge\"`"
        )
    })
}

/// Returns the posterior of a run, with the indices of its parameters among those of all inputs.
fn knowledge(run: &Piece<'_>, whole: &ObservableForm, inputs: &[String]) -> Result<Knowledge, MergeError> {
    let own = form(run, run.model.m())?;
    let (n, p) = (whole.states(), whole.outputs());
    let columns =
        (0..p).chain(run.model.inputs.iter().map(|input| {
            p + inputs.iter().position(|name| name == input).expect("the list holds the inputs of all runs")
        }));
    let unusable = |problem: &str| MergeError::Unusable { run: run.name.into(), problem: problem.into() };
    if run.estimate.forgets {
        return Err(unusable("it used forgetting or parameter noise, so it has no single A"));
    }
    let Some(prior_variances) = run.estimate.prior_variances.clone() else {
        return Err(unusable("it started from an earlier model, which is not a common prior"));
    };
    let covariance =
        run.model.parameter_covariance.clone().ok_or_else(|| unusable("it has no parameter_covariance"))?;
    Ok(Knowledge {
        run: run.name.into(),
        places: columns.flat_map(|column| column * n..(column + 1) * n).collect(),
        estimate: DVector::from_vec(parameters(run.model, &own)),
        covariance,
        prior_variances,
        // A second pass would count the same data twice.
        overdispersion: run.estimate.innovation_ratio * run.estimate.passes as f64,
    })
}

fn joined(
    pieces: &[Piece<'_>],
    knowledge: &[Knowledge],
    form: &ObservableForm,
    inputs: Vec<String>,
) -> Result<Model, RunError> {
    let (n, p, m) = (form.states(), form.outputs(), form.inputs());
    let Combined { estimate, covariance, .. } = combine(knowledge, form.parameter_columns() * n)?;
    let first = pieces[0].model;
    let mut a = DMatrix::from_fn(n, n, |row, column| f64::from(form.shift_source(row) == Some(column)));
    for (i, &column) in form.output_states().iter().enumerate() {
        let mut to = a.column_mut(column);
        to += estimate.rows(i * n, n);
    }
    let b = DMatrix::from_column_slice(n, m, &estimate.as_slice()[p * n..]);
    let mut model = Model::new(first.sample_rate_hz, a, b, first.c.clone(), DMatrix::zeros(p, m))?;
    model.inputs = inputs;
    model.outputs.clone_from(&first.outputs);
    model.observability_indices = Some(form.indices().to_vec());
    model.parameter_covariance = Some(covariance);
    Ok(model)
}

fn provenance(runs: &[FinishedRun], advanced: usize) -> Map<String, serde_json::Value> {
    let mut provenance = Map::new();
    provenance.insert("program".into(), json!(format!("plid {}", env!("CARGO_PKG_VERSION"))));
    let merged = runs.iter().map(|run| json!({"experiment": run.experiment.name, "inputs": run.model.inputs}));
    provenance.insert("merged_from".into(), merged.collect());
    provenance.insert("input_advanced_by".into(), json!(advanced));
    provenance
}
