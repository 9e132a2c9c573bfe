//! The audit of a case before any fit: records that cannot be used, channels that clip, are constant or lack samples, a
//! simulation that is unstable or has other channels and units, and effects for which the records are too short.
//!
//! A condition that makes a diagnosis impossible is an error. A mismatch that an engineer would correct before
//! proceeding (exchanged, negated or delayed channels, other units) is named, and corrected for the following steps.

mod clipping;
mod constant;
mod controlled;
mod finite;
mod lines;
mod little;
mod offsets;
mod ports;
mod responses;
mod rewire;
mod shapes;
mod stable;
mod surrogate;
mod wiring;

use crate::case::record::{Channels, Record};
use crate::case::{Case, Intersample};
use crate::effects::{Effect, Library, SensorOffset, Units};
use crate::error::GapError;
use crate::prepare::Known;
use crate::settings::step::Step;
use plid_data::prepare::trend::Trend;
use surrogate::Surrogate;

pub use rewire::Mismatch;
pub(crate) use stable::ON_THE_CIRCLE;

/// The result of an audit.
#[derive(Debug, Clone)]
pub struct Audit {
    /// The case for the following steps: its warnings include the findings, its excluded effects include those for
    /// which the records are too short, and its channels and units are corrected if [`Audit::mismatch`] explains the
    /// gap.
    pub case: Case,
    /// Channels, signs, units or a delay with which the simulation agrees much better with the records.
    pub mismatch: Option<Mismatch>,
    /// The prior knowledge for the preparation.
    pub known: Known,
    surrogate: Option<Surrogate>,
}

/// A law of forces inside the plant that the diagnosis found.
pub(crate) struct Law {
    /// The law in words.
    pub name: String,
    /// The names of its effects, with their locations and parameters.
    pub effects: Vec<(String, String, Vec<f64>)>,
    /// The force at each port in each fitted record, or in the fitted part of that record, by the name of the record.
    /// The scale of the force is arbitrary.
    pub forces: Vec<(String, Channels)>,
}

impl Law {
    /// Returns a record with the forces as further inputs, without the end of the record if that is held out; `None`
    /// if its forces are unknown.
    fn drives(&self, record: &Record, rate: f64) -> Option<Record> {
        let (_, forces) = self.forces.iter().find(|(name, _)| *name == record.name)?;
        let samples = forces.first()?.len().min(record.samples());
        let mut driven = record.part(0..samples, rate);
        driven.u.extend(forces.iter().map(|force| force[..samples].to_vec()));
        Some(driven)
    }
}

/// Audits a case. A case without a simulation gets a surrogate model. `off` are the steps that the diagnosis skips.
///
/// # Errors
/// Returns [`GapError::Record`], [`GapError::Constant`], [`GapError::Port`], [`GapError::Unstable`],
/// [`GapError::UnstableLoop`], [`GapError::TooLittle`] or [`GapError::Model`], or [`GapError::Failed`] if no model is
/// given and none can be identified.
pub fn audit(case: &Case, library: &Library, off: &[Step], say: &mut dyn FnMut(String)) -> Result<Audit, GapError> {
    look(case, library, &[], off, None, say)
}

impl Audit {
    /// Audits the same case with some effects removed from the library. The surrogate model and the wiring are not
    /// determined again.
    ///
    /// # Errors
    /// Returns the errors of the first audit.
    pub fn without(&self, case: &Case, library: &Library, without: &[String]) -> Result<Self, GapError> {
        look(case, library, without, &self.known.off, Some(self), &mut |_| {})
    }
}

impl Audit {
    /// Returns the audit with the channels as they were recorded; `None` if nothing was corrected.
    ///
    /// # Errors
    /// Returns the errors of the first audit.
    pub(crate) fn as_recorded(&self, case: &Case, library: &Library) -> Result<Option<Self>, GapError> {
        let Some(corrected) = self.put_right() else { return Ok(None) };
        let mismatch = Some(Mismatch { explains: false, ..corrected.clone() });
        let before = Self { mismatch, ..self.clone() };
        look(case, library, &[], &self.known.off, Some(&before), &mut |_| {}).map(Some)
    }

    /// Returns whether the simulation is a model of the fitted records, because the case gives none.
    pub(crate) fn is_of_records(&self, case: &Case) -> bool {
        let measured = |record: &Record| record.simulated.is_none();
        self.surrogate.is_some() && case.for_simulation.is_empty() && case.records.iter().all(measured)
    }

    /// Returns the audit with a model of the records that was identified again with the forces of a law that was found
    /// ([`surrogate::identify_with`]); `None` if the forces in a record are unknown.
    ///
    /// # Errors
    /// Returns the errors of the first audit and those of the identification.
    pub(crate) fn with_law(
        &self,
        case: &Case,
        library: &Library,
        without: &[String],
        law: &Law,
    ) -> Result<Option<Self>, GapError> {
        let Some(surrogate) = surrogate::identify_with(case, law)? else { return Ok(None) };
        let before = Self { surrogate: Some(surrogate), ..self.clone() };
        look(case, library, without, &self.known.off, Some(&before), &mut |_| {}).map(Some)
    }

    /// Returns the assumed course of the inputs between the samples.
    pub(crate) fn intersample(&self) -> Intersample {
        self.surrogate.as_ref().map_or(Intersample::Zoh, |surrogate| surrogate.intersample)
    }

    /// Returns the model that replaces the simulation if the case contains none. It is the best linear model, even if
    /// the diagnosis uses a model that was identified with a law.
    pub fn surrogate_model(&self) -> Option<&plid_model::Model> {
        self.surrogate
            .as_ref()
            .map(|surrogate| surrogate.best_linear.as_ref().map_or(&surrogate.model, |(model, _)| model))
    }

    /// Returns the mismatch that the audit corrected, if it explains the gap.
    pub(crate) fn put_right(&self) -> Option<&Mismatch> {
        self.mismatch.as_ref().filter(|mismatch| mismatch.explains)
    }
}

fn look(
    case: &Case,
    library: &Library,
    without: &[String],
    off: &[Step],
    before: Option<&Audit>,
    say: &mut dyn FnMut(String),
) -> Result<Audit, GapError> {
    let looks = !off.contains(&Step::Audit);
    let mut found = of_records(case, looks)?;
    let (model, surrogate) = match &case.model {
        Some(model) => (model.clone(), None),
        None => {
            let known = before.and_then(|before| before.surrogate.clone());
            let surrogate = known.map_or_else(|| surrogate::identify(case, say), Ok)?;
            (surrogate.model.clone(), Some(surrogate))
        }
    };
    let from_records = surrogate.is_some() && case.records.iter().all(|record| record.simulated.is_none());
    found.extend(surrogate.iter().map(|surrogate| surrogate.words.clone()));
    found.extend(stable::check(case, &model)?);
    let little = little::check(case, &model, library, without)?;
    found.extend(little.findings);
    // A model that was identified from these channels has no exchanged channels.
    let mismatch = match before {
        Some(before) => before.mismatch.clone(),
        // In closed loop, exchanged wires would have been noticed while the records were taken.
        None if from_records || !looks || case.controller.is_some() => None,
        None => rewire::find(case, &model)?,
    };

    let mut case = case.clone();
    if let Some(surrogate) = &surrogate {
        for record in &mut case.records {
            record.u = surrogate.intersample.held(&record.u);
            surrogate::take_misfit(record, &model);
        }
    }
    case.config.exclude.extend(little.left_out);
    let has_offsets = surrogate.as_ref().is_some_and(|surrogate| !surrogate.offsets.is_empty());
    case.config.exclude.extend(absorbed(&case, library, from_records, has_offsets));
    found.extend(controlled::leave_out(&mut case, &model, library, without)?);
    let explained = mismatch.as_ref().filter(|mismatch| mismatch.explains);
    found.extend(mismatch.iter().map(|mismatch| mismatch.sentence.clone()));
    if let Some(mismatch) = explained {
        found.extend(mismatch.consequences());
        case.records.iter_mut().for_each(|record| mismatch.wiring.delay_inputs(record));
    }
    case.model = Some(explained.map_or(model.clone(), |mismatch| mismatch.wiring.applied(&model)));
    case.warnings.extend(found);
    let known = known(&case, surrogate.as_ref(), off)?;
    Ok(Audit { case, mismatch, known, surrogate })
}

/// Returns what the diagnosis knows besides the model and the records.
fn known(case: &Case, surrogate: Option<&Surrogate>, off: &[Step]) -> Result<Known, GapError> {
    let of_surrogate = surrogate.cloned().map(|s| (s.prior_std, s.offsets, s.best_linear, s.model_error));
    let (prior_std, offsets, best_linear, model_error) = of_surrogate.unwrap_or_default();
    Ok(Known {
        units: Units {
            inputs: case.config.units_of(&case.config.inputs),
            outputs: case.config.units_of(&case.config.outputs),
            ..Units::default()
        },
        ports: ports::of_case(case)?,
        controller: case.controller.clone(),
        limits: case.config.nuisance,
        prior_std,
        offsets,
        best_linear,
        model_error,
        undetermined: surrogate.is_some_and(|surrogate| surrogate.undetermined),
        band_hz: case.config.band_hz,
        // Trends and a surrogate model were estimated without the held-out record.
        may_divide: surrogate.is_none() && case.config.trend == Trend::None && !case.config.names_held_out(),
        off: off.to_vec(),
        settings: case.config.settings.clone(),
    })
}

/// Checks the records alone and returns warnings. `looks` states whether clipping is checked.
///
/// # Errors
/// Returns [`GapError::Record`], [`GapError::Constant`] or [`GapError::TooLittle`].
pub(crate) fn of_records(case: &Case, looks: bool) -> Result<Vec<String>, GapError> {
    shapes::check(case)?;
    let mut found = finite::check(case)?;
    found.extend(constant::check(case)?);
    found.extend(if looks { clipping::check(case) } else { Vec::new() });
    Ok(found)
}

/// Returns the names of the effects that the surrogate model already contains, if it was identified from the fitted
/// records themselves: all linear ones, and the offsets that it has.
fn absorbed(case: &Case, library: &Library, of_records: bool, has_offsets: bool) -> Vec<String> {
    if !of_records || !case.for_simulation.is_empty() {
        return Vec::new();
    }
    let is_absorbed = |effect: &&dyn Effect| effect.is_linear() || has_offsets && effect.name() == SensorOffset.name();
    library.effects().filter(is_absorbed).map(|effect| effect.name().to_string()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{case, truss};

    fn look(case: &Case) -> Audit {
        audit(case, &Library::standard(), &[], &mut |_| {}).unwrap()
    }

    #[test]
    fn a_sound_case_stays_as_it_is() {
        let case = case(&truss(1), &truss(1));
        let audit = look(&case);
        assert_eq!(audit.mismatch, None);
        assert_eq!((audit.case.model, audit.case.config, audit.case.records), (case.model, case.config, case.records));
        assert!(audit.case.warnings.is_empty());
    }

    #[test]
    fn what_explains_the_gap_is_put_right() {
        let mut case = case(&truss(1), &truss(1));
        for record in &mut case.records {
            record.y.swap(0, 1);
        }
        let first = look(&case);
        assert!(first.mismatch.unwrap().explains);
        assert!(first.case.warnings[0].contains("y1 and y2 look swapped"), "{:?}", first.case.warnings);
        // After the correction, nothing more is found.
        assert_eq!(look(&first.case).mismatch, None);
    }

    #[test]
    fn a_delay_is_put_right_in_the_records() {
        let mut case = case(&truss(1), &truss(1));
        for y in case.records.iter_mut().flat_map(|record| &mut record.y) {
            y.splice(0..0, [0.0; 40]);
            y.truncate(y.len() - 40);
        }
        let first = look(&case);
        assert_eq!(first.mismatch.unwrap().wiring.delay, 40);
        assert_eq!(first.case.model, case.model);
        assert_eq!(look(&first.case).mismatch, None);
    }
}
