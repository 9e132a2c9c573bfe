//! The recursion over one or more records, in one or more passes, with checkpoints.

use ndarray::Array2;
use plid_core::{
    Checkpoint, Health, IdentifiedModel, IdentifierError, ImplicitModel, NoiseModel, ObservableForm, Settings,
};
use serde::{Deserialize, Serialize};

use super::{IdentifyError, Samples};
use plid_catalogue::{CovarianceName, Recursion, Variant, VariantError};

/// The specification of a recursion.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The canonical form.
    pub form: ObservableForm,
    /// The noise covariances.
    pub noise: NoiseModel,
    /// Initial estimate, forgetting and parameter noise.
    pub settings: Settings,
    /// The scalar type, covariance form and expectation.
    pub variant: Variant,
    /// Number of passes over the records.
    pub passes: usize,
}

/// The result of a recursion.
#[derive(Clone, Debug)]
pub struct RecursionRun {
    /// The identified plant with its parameter covariance.
    pub identified: IdentifiedModel,
    /// The innovations of the last pass, one array (K x p) per record.
    pub innovations: Vec<Array2<f64>>,
    /// The numerical condition of P at the end.
    pub health: Health,
}

/// The state of an interrupted recursion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Paused {
    /// Number of completed segments (one record in one pass).
    stretch: usize,
    /// The covariance form of the checkpoint.
    pub covariance: CovarianceName,
    /// The state of the recursion within the next segment.
    checkpoint: Checkpoint,
    /// The innovations so far, by record and row; `None` represents NaN, which JSON cannot.
    innovations: Vec<Vec<Option<f64>>>,
}

/// A callback that receives the numbers of samples done and in total, and returns false to interrupt the recursion.
pub type Watcher<'a> = &'a mut dyn FnMut(usize, usize) -> bool;

/// The end of a recursion: completed, or interrupted by the watcher.
#[derive(Debug)]
pub enum Ending {
    /// All samples have been processed.
    Done(Box<RecursionRun>),
    /// The watcher interrupted the recursion.
    Paused(Box<Paused>),
}

fn build(plan: &Plan, former: Option<&IdentifiedModel>) -> Result<Box<dyn Recursion>, VariantError> {
    let settings = match former {
        Some(former) => &plan.settings.carry_over(&plan.form, former, 1.0),
        None => &plan.settings,
    };
    plan.variant.build(plan.form.clone(), &plan.noise, settings)
}

/// Runs the recursion of `plan` over the records, `plan.passes` times. Each record after the first starts with the
/// current parameters and their covariance, and with an uninformative prior of the state.
///
/// # Errors
/// Returns the error of the recursion.
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
    let length = |stretch: usize| records[stretch % records.len()].len();
    let mut recursion = build(plan, None)?;
    if let Some(paused) = paused {
        if paused.stretch >= stretches || paused.checkpoint.step() > length(paused.stretch) as u64 {
            return Err(VariantError::from(IdentifierError::Checkpoint("its place is beyond the records")).into());
        }
        recursion.restore(&paused.checkpoint).map_err(VariantError::from)?;
        (stretch, first) = (paused.stretch, paused.checkpoint.step() as usize);
        for (array, saved) in innovations.iter_mut().zip(&paused.innovations) {
            for (to, from) in array.iter_mut().zip(saved) {
                *to = from.unwrap_or(f64::NAN);
            }
        }
    }
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

/// Runs the recursion as [`run`] does, for a covariance form that the user did not select. If P loses positive
/// definiteness, Bierman UD replaces the form in `plan` from the start, and the reason is returned.
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

    /// The sum of the records before the place did not end.
    #[test]
    fn a_checkpoint_beyond_the_records_is_refused() {
        let form = ObservableForm::new(&[1], 1).unwrap();
        let inputs = Array2::from_shape_fn((8, 1), |(k, _)| (k % 3) as f64);
        let records = [Samples { inputs: inputs.view(), outputs: inputs.view(), nan_is_missing: false }];
        let plan = Plan {
            noise: NoiseModel::diagonal(&[1e-2], &[1e-2], &[1e-2]),
            settings: Settings::new(&form, 1.0, 1.0),
            form,
            variant: Variant::default(),
            passes: 2,
        };
        let Ok(Ending::Paused(paused)) = run(&plan, &records, None, &mut |done, _| done < 11) else { panic!() };
        assert_eq!((paused.stretch, paused.checkpoint.step()), (1, 3));
        let resumed =
            |stretch: usize| run(&plan, &records, Some(&Paused { stretch, ..*paused.clone() }), &mut |_, _| true);
        assert!(matches!(resumed(1), Ok(Ending::Done(_))));
        for beyond in [2, usize::MAX] {
            assert!(resumed(beyond).unwrap_err().to_string().contains("beyond the records"));
        }
    }

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
