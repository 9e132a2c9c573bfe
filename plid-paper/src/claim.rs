//! What a claim is, what it is given, and what it finds.

use std::error::Error;
use std::path::Path;

use plid_bench::study::{ConfigError, Progress};
use plid_lab::experiment::{Experiment, Refinement, from_toml};
use plid_lab::run::{self, Outcome};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// The result of a claim's parts; any error will do, since the runner names the claim.
pub type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// A figure or a statement of the paper, and the function that puts it to the test.
#[derive(Clone, Copy)]
pub struct Claim {
    /// Its name in files and on the command line.
    pub id: &'static str,
    /// What the paper says.
    pub statement: &'static str,
    /// What a simulated truss can say to it, and what it cannot.
    pub limit: &'static str,
    /// experiments/paper/ID.toml: an experiment for `plid run`, or a study for `plid bench`.
    pub config: &'static str,
    /// experiments/paper/ID.vary.toml: what is varied from there, in full and in quick.
    pub vary: &'static str,
    /// Whether it measures times: it then runs alone, and its figures differ from run to run.
    pub timed: bool,
    /// The test.
    pub run: fn(&Context<'_>) -> Result<Finding>,
}

/// The parts of a claim that its file does not repeat: id and configs.
macro_rules! claim {
    ($id:literal, $($field:ident: $value:expr),+ $(,)?) => {
        $crate::claim::Claim {
            id: $id,
            config: include_str!(concat!("../../../experiments/paper/", $id, ".toml")),
            vary: include_str!(concat!("../../../experiments/paper/", $id, ".vary.toml")),
            run,
            $($field: $value),+
        }
    };
}
pub(crate) use claim;

/// What a claim's test is given.
pub struct Context<'a> {
    /// The claim.
    pub id: &'a str,
    /// Whether it is to be quick.
    pub quick: bool,
    /// The text of ID.toml.
    pub config: &'a str,
    /// The text of ID.vary.toml.
    pub vary: &'a str,
    /// Where the claim's files go; it exists.
    pub directory: &'a Path,
    /// Asked whether to go on.
    pub progress: &'a dyn Progress,
}

/// The two tables of ID.vary.toml.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary<T> {
    full: T,
    quick: T,
}

impl Context<'_> {
    /// ID.toml, as whatever it is.
    ///
    /// # Errors
    /// Names the line and the key.
    pub fn config<T: DeserializeOwned>(&self) -> std::result::Result<T, ConfigError> {
        from_toml(self.config, &format!("{}.toml", self.id))
    }

    /// ID.toml as an experiment.
    ///
    /// # Errors
    /// Names the line and the key.
    pub fn experiment(&self) -> std::result::Result<Experiment, ConfigError> {
        self.config()
    }

    /// The table of ID.vary.toml that counts.
    ///
    /// # Errors
    /// Names the line and the key.
    pub fn vary<T: DeserializeOwned>(&self) -> std::result::Result<T, ConfigError> {
        let both: Vary<T> = from_toml(self.vary, &format!("{}.vary.toml", self.id))?;
        Ok(if self.quick { both.quick } else { both.full })
    }

    /// Carries out an experiment for PLID's model alone: what else a run does would take longer. Data files lie in the claim's directory.
    ///
    /// # Errors
    /// [`run::RunError`]
    pub fn identify(&self, experiment: &Experiment) -> std::result::Result<Outcome, run::RunError> {
        let mut experiment = experiment.clone();
        experiment.validation.model_only = true;
        self.validate(&experiment)
    }

    /// Carries out an experiment, with PLID's one-step prediction of held-out data; without a second model, of which the paper says nothing.
    ///
    /// # Errors
    /// [`run::RunError`]
    pub fn validate(&self, experiment: &Experiment) -> std::result::Result<Outcome, run::RunError> {
        let mut experiment = experiment.clone();
        experiment.identification.refine = Refinement::Off;
        run::carry_out(&experiment, self.directory, None, false, &Inner(self.progress))
    }
}

/// The progress of a part: it says nothing, but it can be interrupted.
pub struct Inner<'a>(pub &'a dyn Progress);

impl Progress for Inner<'_> {
    fn stage(&self, _name: &str) {}
    fn advance(&self, _done: usize, _total: usize) {}
    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

/// How a statement fares.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Every part holds.
    Confirmed,
    /// Some parts hold.
    ConfirmedInPart,
    /// No part that can be tested holds.
    Refuted,
    /// No part can be tested here.
    CannotBeJudged,
}

impl Verdict {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Confirmed => "confirmed",
            Self::ConfirmedInPart => "confirmed in part",
            Self::Refuted => "refuted",
            Self::CannotBeJudged => "cannot be judged",
        }
    }
}

/// One part of a statement, with the rule by which it holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// The rule, with its threshold and the reason for it.
    pub rule: String,
    /// Whether it holds; `None` where nothing here can say.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub holds: Option<bool>,
}

impl Part {
    /// A part that was tested.
    pub fn new(rule: impl Into<String>, holds: bool) -> Self {
        Self { rule: rule.into(), holds: Some(holds) }
    }

    /// A part that nothing here can test.
    pub fn open(rule: impl Into<String>) -> Self {
        Self { rule: rule.into(), holds: None }
    }
}

/// A number that was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// What it is.
    pub name: String,
    /// Its value; `None` where it is not finite.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Its unit; empty for a plain number.
    pub unit: String,
    /// Whether it is a time, or depends on one: such figures differ from run to run.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub timed: bool,
}

/// A picture or a table of the page.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Panel {
    /// A picture.
    Picture {
        /// SVG.
        svg: String,
        /// The sentence below it.
        caption: String,
    },
    /// A table.
    Table {
        /// The sentence above it.
        caption: String,
        /// Names and units of the columns.
        columns: Vec<(String, String)>,
        /// Cells as they are to be shown.
        rows: Vec<Vec<String>>,
    },
}

/// What came of a claim.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// The result in a sentence or two, with its figures.
    pub sentence: String,
    /// The parts of the statement, from which the verdict follows.
    pub parts: Vec<Part>,
    /// The figures.
    pub figures: Vec<Figure>,
    /// Pictures and tables.
    pub panels: Vec<Panel>,
}

impl Finding {
    /// The verdict that follows from the parts.
    pub fn verdict(&self) -> Verdict {
        let tested: Vec<bool> = self.parts.iter().filter_map(|part| part.holds).collect();
        let all = tested.len() == self.parts.len();
        match (tested.iter().any(|&holds| holds), tested.iter().all(|&holds| holds)) {
            _ if tested.is_empty() => Verdict::CannotBeJudged,
            (true, true) if all => Verdict::Confirmed,
            (true, _) => Verdict::ConfirmedInPart,
            (false, _) => Verdict::Refuted,
        }
    }

    /// With a figure.
    pub fn figure(mut self, name: impl Into<String>, value: f64, unit: &str) -> Self {
        let value = value.is_finite().then_some(value);
        self.figures.push(Figure { name: name.into(), value, unit: unit.into(), timed: false });
        self
    }

    /// With a figure that differs from run to run.
    pub fn timed(self, name: impl Into<String>, value: f64, unit: &str) -> Self {
        let mut finding = self.figure(name, value, unit);
        finding.figures.iter_mut().next_back().into_iter().for_each(|figure| figure.timed = true);
        finding
    }

    /// With a part.
    pub fn part(mut self, rule: impl Into<String>, holds: bool) -> Self {
        self.parts.push(Part::new(rule, holds));
        self
    }

    /// With a part that nothing here can test.
    pub fn open(mut self, rule: impl Into<String>) -> Self {
        self.parts.push(Part::open(rule));
        self
    }

    /// With a picture.
    pub fn picture(mut self, svg: String, caption: impl Into<String>) -> Self {
        self.panels.push(Panel::Picture { svg, caption: caption.into() });
        self
    }

    /// With a table; a column's unit may be empty.
    pub fn table(mut self, caption: &str, columns: &[(&str, &str)], rows: Vec<Vec<String>>) -> Self {
        let columns = columns.iter().map(|(name, unit)| (name.to_string(), unit.to_string())).collect();
        self.panels.push(Panel::Table { caption: caption.into(), columns, rows });
        self
    }

    /// With its sentence.
    pub fn say(mut self, sentence: impl Into<String>) -> Self {
        self.sentence = sentence.into();
        self
    }

    /// The value of a figure.
    ///
    /// # Panics
    /// If there is none of that name, which is a bug of the claim.
    pub fn value(&self, name: &str) -> f64 {
        let figure = self.figures.iter().find(|figure| figure.name == name);
        figure.unwrap_or_else(|| panic!("no figure `{name}`")).value.unwrap_or(f64::NAN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_verdict_follows_from_the_parts() {
        let verdict = |holds: &[Option<bool>]| {
            let parts = holds.iter().map(|&holds| Part { rule: String::new(), holds }).collect();
            Finding { parts, ..Finding::default() }.verdict()
        };
        assert_eq!(verdict(&[Some(true), Some(true)]), Verdict::Confirmed);
        assert_eq!(verdict(&[Some(true), Some(false)]), Verdict::ConfirmedInPart);
        assert_eq!(verdict(&[Some(true), None]), Verdict::ConfirmedInPart);
        assert_eq!(verdict(&[Some(false), None]), Verdict::Refuted);
        assert_eq!(verdict(&[None]), Verdict::CannotBeJudged);
        assert_eq!(verdict(&[]), Verdict::CannotBeJudged);
    }

    #[test]
    fn a_figure_that_is_not_finite_is_none_and_reads_as_nan() {
        let finding = Finding::default().figure("a", f64::INFINITY, "V").timed("b", 2.0, "s");
        assert_eq!(finding.figures[0].value, None);
        assert!(finding.value("a").is_nan() && finding.figures[1].timed && !finding.figures[0].timed);
    }
}
