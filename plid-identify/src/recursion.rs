//! The recursion over one or more records, in one or more passes, with checkpoints.

use ndarray::{Array2, ArrayView1};
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

/// A recursion that takes one sample at a time, so that the records need not be held in memory.
///
/// [`run`] does the same for records in memory.
pub struct Course<'p> {
    plan: &'p Plan,
    recursion: Box<dyn Recursion>,
    z: Vec<f64>,
    u: Vec<f64>,
}

impl<'p> Course<'p> {
    /// Starts the recursion of `plan`.
    ///
    /// # Errors
    /// Returns an error if the variant cannot be constructed.
    pub fn start(plan: &'p Plan) -> Result<Self, IdentifyError> {
        let (z, u) = (vec![0.0; plan.form.outputs()], vec![0.0; plan.form.inputs()]);
        Ok(Self { plan, recursion: build(plan, None)?, z, u })
    }

    /// Takes a sample of outputs (p) and inputs (m), and returns its innovation (p). If `nan_is_missing`, a NaN among
    /// the outputs marks a missing sample.
    ///
    /// # Errors
    /// Returns the error of the recursion.
    pub fn step(
        &mut self,
        outputs: ArrayView1<'_, f64>,
        inputs: ArrayView1<'_, f64>,
        nan_is_missing: bool,
    ) -> Result<&[f64], IdentifyError> {
        self.z.iter_mut().zip(outputs).for_each(|(to, &from)| *to = from);
        self.u.iter_mut().zip(inputs).for_each(|(to, &from)| *to = from);
        self.recursion.step(&self.z, &self.u, nan_is_missing).map_err(VariantError::from)?;
        Ok(self.recursion.innovation())
    }

    /// Begins the next record or pass: with the current parameters and their covariance, and with an uninformative
    /// prior of the state.
    ///
    /// # Errors
    /// Returns the errors of [`Course::start`].
    pub fn next_record(&mut self) -> Result<(), IdentifyError> {
        self.recursion = build(self.plan, Some(&self.recursion.identified()))?;
        Ok(())
    }

    /// Returns the state of the recursion after `stretch` completed segments, with the innovations to be kept.
    pub fn pause(&self, stretch: usize, innovations: &[Array2<f64>]) -> Paused {
        let saved = |array: &Array2<f64>| array.iter().map(|&e| e.is_finite().then_some(e)).collect();
        Paused {
            stretch,
            covariance: self.plan.variant.covariance,
            checkpoint: self.recursion.checkpoint(),
            innovations: innovations.iter().map(saved).collect(),
        }
    }

    /// Continues from a paused recursion.
    ///
    /// # Errors
    /// Returns an error if the paused recursion has different dimensions.
    pub fn resume(&mut self, paused: &Paused) -> Result<(), IdentifyError> {
        Ok(self.recursion.restore(&paused.checkpoint).map_err(VariantError::from)?)
    }

    /// Ends the recursion and returns the result with the innovations that were kept.
    pub fn finish(self, innovations: Vec<Array2<f64>>) -> RecursionRun {
        RecursionRun { identified: self.recursion.identified(), innovations, health: self.recursion.health() }
    }
}

impl Paused {
    /// Returns the number of completed segments, and the number of samples done in the next one.
    pub fn place(&self) -> (usize, usize) {
        (self.stretch, self.checkpoint.step() as usize)
    }

    /// Returns the innovations that were kept, by record and row; NaN for a missing sample.
    pub fn innovations(&self) -> impl Iterator<Item = impl Iterator<Item = f64> + '_> + '_ {
        self.innovations.iter().map(|saved| saved.iter().map(|e| e.unwrap_or(f64::NAN)))
    }
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
    let mut course = Course::start(plan)?;
    if let Some(paused) = paused {
        if paused.stretch >= stretches || paused.checkpoint.step() > length(paused.stretch) as u64 {
            return Err(VariantError::from(IdentifierError::Checkpoint("its place is beyond the records")).into());
        }
        course.resume(paused)?;
        (stretch, first) = paused.place();
        for (array, saved) in innovations.iter_mut().zip(paused.innovations()) {
            array.iter_mut().zip(saved).for_each(|(to, from)| *to = from);
        }
    }
    let mut done = (0..stretch).map(length).sum::<usize>() + first;
    while stretch < stretches {
        let number = stretch % records.len();
        let record = records[number];
        for k in first..record.len() {
            let innovation = course.step(record.outputs.row(k), record.inputs.row(k), record.nan_is_missing)?;
            innovations[number].row_mut(k).iter_mut().zip(innovation).for_each(|(to, &e)| *to = e);
            done += 1;
            if !watcher(done, total) && done < total {
                return Ok(Ending::Paused(Box::new(course.pause(stretch, &innovations))));
            }
        }
        first = 0;
        stretch += 1;
        if stretch < stretches {
            course.next_record()?;
        }
    }
    Ok(Ending::Done(Box::new(course.finish(innovations))))
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

    /// With a place beyond the records, the sum of the lengths of the segments before that place did not terminate.
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
