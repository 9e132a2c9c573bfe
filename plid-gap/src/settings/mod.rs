//! The thresholds of the diagnosis, and the steps that can be switched off.

mod answer;
mod audit;
mod case;
mod evidence;
mod fit;
mod group;
mod in_loop;
mod judge;
mod noise;
mod plant;
mod prepare;
mod search;
mod signal;
pub(crate) mod step;

use serde::{Deserialize, Serialize};

pub use answer::AnswerSettings;
pub use audit::AuditSettings;
pub use case::CaseSettings;
pub use evidence::EvidenceSettings;
pub use fit::FitSettings;
pub use group::Field;
pub use in_loop::LoopSettings;
pub use judge::JudgeSettings;
pub use noise::NoiseSettings;
pub use plant::PlantSettings;
pub use prepare::PrepareSettings;
pub use search::SearchSettings;
pub use signal::SignalSettings;

/// The thresholds of the diagnosis, in one group for each of its modules. A case sets them in `[settings.GROUP]`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GapSettings {
    /// The reading of a case.
    pub case: CaseSettings,
    /// The audit.
    pub audit: AuditSettings,
    /// The decomposition of a simulation.
    pub plant: PlantSettings,
    /// The processing of records before any fit.
    pub signal: SignalSettings,
    /// The noise model.
    pub noise: NoiseSettings,
    /// The preparation.
    pub prepare: PrepareSettings,
    /// The fits.
    pub fit: FitSettings,
    /// The search for explanations.
    pub search: SearchSettings,
    /// The judgement of explanations.
    pub judge: JudgeSettings,
    /// The evidence that does not enter the verdict.
    pub evidence: EvidenceSettings,
    /// The sentences of the answer.
    pub answer: AnswerSettings,
    /// The diagnosis with the engineer's own simulator in the loop.
    pub in_loop: LoopSettings,
}

impl GapSettings {
    /// Returns each group with its key.
    pub fn groups(&self) -> Vec<(&'static str, Vec<Field>)> {
        vec![
            ("case", self.case.fields()),
            ("audit", self.audit.fields()),
            ("plant", self.plant.fields()),
            ("signal", self.signal.fields()),
            ("noise", self.noise.fields()),
            ("prepare", self.prepare.fields()),
            ("fit", self.fit.fields()),
            ("search", self.search.fields()),
            ("judge", self.judge.fields()),
            ("evidence", self.evidence.fields()),
            ("answer", self.answer.fields()),
            ("in_loop", self.in_loop.fields()),
        ]
    }

    /// Returns the values outside their range, as key and reason.
    pub fn problems(&self) -> Vec<(&'static str, String)> {
        let out_of_range = |(group, fields): (&'static str, Vec<Field>)| {
            fields.into_iter().filter(|field| !field.range.contains(&field.value)).map(move |field| {
                let [least, most] = [field.range.start(), field.range.end()];
                (field.key, format!("{} is not within {least} to {most} (settings.{group})", field.value))
            })
        };
        self.groups().into_iter().flat_map(out_of_range).collect()
    }

    /// Returns whether every setting has its default.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_in_range_and_keys_are_not_repeated() {
        let settings = GapSettings::default();
        assert_eq!(settings.problems(), []);
        for (group, fields) in settings.groups() {
            for (at, field) in fields.iter().enumerate() {
                assert!(
                    fields[..at].iter().all(|other| other.key != field.key),
                    "{group}.{} is listed twice",
                    field.key
                );
                assert!(!field.about.is_empty() && !field.unit.is_empty(), "{group}.{}", field.key);
            }
        }
    }

    #[test]
    fn every_field_is_listed() {
        let written = serde_json::to_value(GapSettings::default()).unwrap();
        let written = written.as_object().unwrap();
        let groups = GapSettings::default().groups();
        assert_eq!(groups.len(), written.len());
        for (group, fields) in groups {
            let keys: Vec<&str> = written[group].as_object().unwrap().keys().map(String::as_str).collect();
            let mut listed: Vec<&str> = fields.iter().map(|field| field.key).collect();
            listed.sort_unstable();
            assert_eq!(keys, listed, "{group}");
        }
    }

    #[test]
    fn keys_of_earlier_answers_are_read() {
        let read: GapSettings = serde_json::from_str(r#"{ "search": { "few_numbers": 7 } }"#).unwrap();
        assert_eq!(read.search.few_parameters, 7);
    }

    #[test]
    fn values_out_of_range_are_refused() {
        let mut settings = GapSettings::default();
        settings.judge.most_unknown = 1.5;
        let [(key, reason)] = &settings.problems()[..] else { panic!("{:?}", settings.problems()) };
        assert_eq!(*key, "most_unknown");
        assert_eq!(reason, "1.5 is not within 0 to 1 (settings.judge)");
        settings.judge.most_unknown = f64::NAN;
        assert_eq!(settings.problems().len(), 1);
    }
}
