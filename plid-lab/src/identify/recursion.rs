//! PLID over records, once or several times, with checkpoints.

use ndarray::Array2;
use plid_core::{
    Checkpoint, Dense, Health, IdentifiedModel, IdentifierError, ImplicitModel, InitialCovariance, NoiseModel,
    ObservableForm, Settings,
};
use serde::{Deserialize, Serialize};

use super::{IdentifyError, Samples};
use plid_catalogue::{CovarianceName, Recursion, Variant, VariantError};

/// What the recursion is to be.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The canonical form.
    pub form: ObservableForm,
    /// The noise covariances.
    pub noise: NoiseModel,
    /// Start, forgetting and parameter noise.
    pub settings: Settings,
    /// The types.
    pub variant: Variant,
    /// How often the records are gone through.
    pub passes: usize,
}

/// What a run of the recursion gives.
#[derive(Clone, Debug)]
pub struct RecursionRun {
    /// The plant at the end, with the covariance of the estimate.
    pub identified: IdentifiedModel,
    /// The innovations of the last pass, one array (K x p) a record.
    pub innovations: Vec<Array2<f64>>,
    /// How sound P is at the end.
    pub health: Health,
}

/// An interrupted run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Paused {
    /// Stretches (a record in a pass) that are finished.
    stretch: usize,
    /// The form that the checkpoint is in.
    pub covariance: CovarianceName,
    /// The recursion within the next one.
    checkpoint: Checkpoint,
    /// The innovations so far, a record at a time, row by row; `None` for NaN, which JSON has not.
    innovations: Vec<Vec<Option<f64>>>,
}

/// Told between samples how many are done of all; false asks for an end.
pub type Watcher<'a> = &'a mut dyn FnMut(usize, usize) -> bool;

/// The end of a run: done, or paused where the watcher asked for it.
#[derive(Debug)]
pub enum Ending {
    /// All samples are done.
    Done(Box<RecursionRun>),
    /// The watcher asked for an end.
    Paused(Box<Paused>),
}

/// What is known of the parameters, and nothing of the state: where a new record begins.
pub fn carry_over(form: &ObservableForm, settings: &Settings, former: &IdentifiedModel) -> Settings {
    let (n, size) = (form.states(), form.joint_states());
    let state_variance = |i: usize| match &settings.initial_covariance {
        InitialCovariance::Diagonal(d) => d[i],
        InitialCovariance::Full(p0) => p0.at(i, i),
    };
    let covariance = Dense::from_fn(size, size, |i, j| match (i < n, j < n) {
        (false, false) => former.covariance.at(i, j),
        (true, true) if i == j => state_variance(i),
        _ => 0.0,
    });
    let mut estimate = vec![0.0; n];
    estimate.extend(former.parameters(form));
    Settings { initial_covariance: InitialCovariance::Full(covariance), initial_estimate: estimate, ..settings.clone() }
}

fn build(plan: &Plan, former: Option<&IdentifiedModel>) -> Result<Box<dyn Recursion>, VariantError> {
    let settings = match former {
        Some(former) => &carry_over(&plan.form, &plan.settings, former),
        None => &plan.settings,
    };
    plan.variant.build(plan.form.clone(), &plan.noise, settings)
}

/// Runs the recursion of `plan` over the records, `plan.passes` times; each record after the first starts with the parameters
/// and their covariance as they stand, and with a state of which nothing is known.
///
/// # Errors
/// What the recursion says.
pub fn run(
    plan: &Plan,
    records: &[Samples<'_>],
    paused: Option<&Paused>,
    watcher: Watcher<'_>,
) -> Result<Ending, IdentifyError> {
    let p = plan.form.outputs();
    let total = plan.passes * records.iter().map(Samples::len).sum::<usize>();
    let mut innovations: Vec<Array2<f64>> =
        records.iter().map(|record| Array2::from_elem((record.len(), p), f64::NAN)).collect();
    let stretches = plan.passes * records.len();
    let (mut stretch, mut first) = (0, 0);
    let mut recursion = build(plan, None)?;
    if let Some(paused) = paused {
        recursion.restore(&paused.checkpoint).map_err(VariantError::from)?;
        (stretch, first) = (paused.stretch, paused.checkpoint.step() as usize);
        for (array, saved) in innovations.iter_mut().zip(&paused.innovations) {
            for (to, from) in array.iter_mut().zip(saved) {
                *to = from.unwrap_or(f64::NAN);
            }
        }
    }
    let length = |stretch: usize| records[stretch % records.len()].len();
    let mut done = (0..stretch).map(length).sum::<usize>() + first;
    let (mut z, mut u) = (vec![0.0; p], vec![0.0; plan.form.inputs()]);
    while stretch < stretches {
        let number = stretch % records.len();
        let record = records[number];
        for k in first..record.len() {
            for (to, &from) in z.iter_mut().zip(record.outputs.row(k)) {
                *to = from;
            }
            for (to, &from) in u.iter_mut().zip(record.inputs.row(k)) {
                *to = from;
            }
            recursion.step(&z, &u, record.nan_is_missing).map_err(VariantError::from)?;
            for (to, &e) in innovations[number].row_mut(k).iter_mut().zip(recursion.innovation()) {
                *to = e;
            }
            done += 1;
            if !watcher(done, total) && done < total {
                let saved = |array: &Array2<f64>| array.iter().map(|&e| e.is_finite().then_some(e)).collect();
                return Ok(Ending::Paused(Box::new(Paused {
                    stretch,
                    covariance: plan.variant.covariance,
                    checkpoint: recursion.checkpoint(),
                    innovations: innovations.iter().map(saved).collect(),
                })));
            }
        }
        first = 0;
        stretch += 1;
        if stretch < stretches {
            recursion = build(plan, Some(&recursion.identified()))?;
        }
    }
    let (identified, health) = (recursion.identified(), recursion.health());
    Ok(Ending::Done(Box::new(RecursionRun { identified, innovations, health })))
}

/// The same, for a form that was not asked for by name: where P is lost, Bierman UD takes its place in `plan`, from the start. Also
/// says how P was lost.
pub fn run_or_factor(
    plan: &mut Plan,
    records: &[Samples<'_>],
    paused: Option<&Paused>,
    watcher: Watcher<'_>,
) -> (Result<Ending, IdentifyError>, Option<IdentifierError>) {
    match run(plan, records, paused, watcher) {
        Err(IdentifyError::Variant(VariantError::Identifier(lost @ IdentifierError::Indefinite { .. })))
            if plan.variant.covariance != CovarianceName::BiermanUd =>
        {
            plan.variant.covariance = CovarianceName::BiermanUd;
            (run(plan, records, None, watcher), Some(lost))
        }
        other => (other, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plid_catalogue::ScalarName;

    #[test]
    fn a_form_that_is_lost_gives_way_to_bierman_ud() {
        let form = ObservableForm::new(&[6], 1).unwrap();
        let signal = |k: usize, seed: usize| (((seed + 31 * k).pow(2) as f64) * 0.129898).sin();
        let inputs = Array2::from_shape_fn((400, 1), |(k, _)| signal(k, 1));
        let outputs =
            Array2::from_shape_fn((400, 1), |(k, _)| signal(k, 7) + if k > 0 { signal(k - 1, 1) } else { 0.0 });
        let records = [Samples { inputs: inputs.view(), outputs: outputs.view(), nan_is_missing: false }];
        let variant = Variant { covariance: CovarianceName::Direct, scalar: ScalarName::F32, ..Variant::default() };
        let mut plan = Plan {
            noise: NoiseModel::diagonal(&[1e-7], &[0.0], &[1e-12; 6]),
            settings: Settings::new(&form, 1.0, 1.0),
            form,
            variant,
            passes: 1,
        };
        assert!(run(&plan, &records, None, &mut |_, _| true).is_err());
        let (ending, lost) = run_or_factor(&mut plan, &records, None, &mut |_, _| true);
        assert!(matches!(ending, Ok(Ending::Done(_))), "{ending:?}");
        assert!(matches!(lost, Some(IdentifierError::Indefinite { .. })), "{lost:?}");
        assert_eq!(plan.variant.covariance, CovarianceName::BiermanUd);
    }
}
