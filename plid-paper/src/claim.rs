//! A claim, its inputs and its finding.

use std::error::Error;
use std::path::Path;

use plid_bench::study::{ConfigError, Progress};
use plid_lab::experiment::{Experiment, Refinement, from_toml};
use plid_lab::run::{self, Outcome};
use plid_work::Inner;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// The result of a test. Any error type will do, because the runner adds the name of the claim.
pub type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// A figure or statement of the paper, and the function that tests it.
#[derive(Clone, Copy)]
pub struct Claim {
    /// The name in files and on the command line.
    pub id: &'static str,
    /// The statement of the paper.
    pub statement: &'static str,
    /// What a simulated truss can and cannot show about the statement.
    pub limit: &'static str,
    /// experiments/paper/ID.toml: an experiment for `plid run`, or a study for `plid bench`.
    pub config: &'static str,
    /// experiments/paper/ID.vary.toml: the variations for the full and the quick run.
    pub vary: &'static str,
    /// Whether the claim measures times. It then runs alone, and its figures differ from run to run.
    pub timed: bool,
    /// The test.
    pub run: fn(&Context<'_>) -> Result<Finding>,
}

/// Builds the parts of a claim that its file does not repeat: the id and the configs.
macro_rules! claim {
    ($id:literal, $($field:ident: $value:expr),+ $(,)?) => {
        $crate::claim::Claim {
            id: $id,
            config: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/experiments/", $id, ".toml")),
            vary: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/experiments/", $id, ".vary.toml")),
            run,
            $($field: $value),+
        }
    };
}
pub(crate) use claim;

/// The inputs of a test.
pub struct Context<'a> {
    /// The claim.
    pub id: &'a str,
    /// Whether to run the quick version.
    pub quick: bool,
    /// The text of ID.toml.
    pub config: &'a str,
    /// The text of ID.vary.toml.
    pub vary: &'a str,
    /// The existing directory for the claim's files.
    pub directory: &'a Path,
    /// The receiver of progress reports, which also tells whether to continue.
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
    /// Parses ID.toml as the requested type.
    ///
    /// # Errors
    /// Returns an error that names the line and the key.
    pub fn config<T: DeserializeOwned>(&self) -> std::result::Result<T, ConfigError> {
        from_toml(self.config, &format!("{}.toml", self.id))
    }

    /// Parses ID.toml as an experiment.
    ///
    /// # Errors
    /// Returns an error that names the line and the key.
    pub fn experiment(&self) -> std::result::Result<Experiment, ConfigError> {
        self.config()
    }

    /// Parses the table of ID.vary.toml that applies.
    ///
    /// # Errors
    /// Returns an error that names the line and the key.
    pub fn vary<T: DeserializeOwned>(&self) -> std::result::Result<T, ConfigError> {
        let both: Vary<T> = from_toml(self.vary, &format!("{}.vary.toml", self.id))?;
        Ok(if self.quick { both.quick } else { both.full })
    }

    /// Runs an experiment for the PLID model only, which saves time. Paths of data files are relative to the
    /// directory of the claim.
    ///
    /// # Errors
    /// Returns a [`run::RunError`].
    pub fn identify(&self, experiment: &Experiment) -> std::result::Result<Outcome, run::RunError> {
        let mut experiment = experiment.clone();
        experiment.validation.model_only = true;
        self.validate(&experiment)
    }

    /// Runs an experiment with the one-step prediction of held-out data, but without a second model, which the paper
    /// does not consider.
    ///
    /// # Errors
    /// Returns a [`run::RunError`].
    pub fn validate(&self, experiment: &Experiment) -> std::result::Result<Outcome, run::RunError> {
        let mut experiment = experiment.clone();
        experiment.identification.refine = Refinement::Off;
        run::carry_out(&experiment, self.directory, None, false, &Inner(self.progress))
    }
}

/// The verdict on a statement.
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
    /// Returns the verdict in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Confirmed => "confirmed",
            Self::ConfirmedInPart => "confirmed in part",
            Self::Refuted => "refuted",
            Self::CannotBeJudged => "cannot be judged",
        }
    }
}

/// One part of a statement, with the rule that decides whether it holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// The rule with its threshold and the reason for the threshold.
    pub rule: String,
    /// Whether the part holds; `None` if it cannot be tested here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub holds: Option<bool>,
}

impl Part {
    /// Creates a part that was tested.
    pub fn new(rule: impl Into<String>, holds: bool) -> Self {
        Self { rule: rule.into(), holds: Some(holds) }
    }

    /// Creates a part that cannot be tested here.
    pub fn open(rule: impl Into<String>) -> Self {
        Self { rule: rule.into(), holds: None }
    }
}

/// A measured number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// The name of the number.
    pub name: String,
    /// Its value; `None` if it is not finite.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Its unit; empty for a plain number.
    pub unit: String,
    /// Whether it is or depends on a time, so that it differs from run to run.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub timed: bool,
}

/// A plot or table on the page.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Panel {
    /// A plot.
    Picture {
        /// The SVG.
        svg: String,
        /// The caption below it.
        caption: String,
    },
    /// A table.
    Table {
        /// The caption above it.
        caption: String,
        /// Names and units of the columns.
        columns: Vec<(String, String)>,
        /// The cells as they are shown.
        rows: Vec<Vec<String>>,
    },
}

/// The result of testing a claim.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// The result in one or two sentences, with its figures.
    pub sentence: String,
    /// The parts of the statement, from which the verdict follows.
    pub parts: Vec<Part>,
    /// The figures.
    pub figures: Vec<Figure>,
    /// Plots and tables.
    pub panels: Vec<Panel>,
}

impl Finding {
    /// Returns the verdict that follows from the parts.
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

    /// Adds a figure.
    pub fn figure(mut self, name: impl Into<String>, value: f64, unit: &str) -> Self {
        let value = value.is_finite().then_some(value);
        self.figures.push(Figure { name: name.into(), value, unit: unit.into(), timed: false });
        self
    }

    /// Adds a figure that differs from run to run.
    pub fn timed(self, name: impl Into<String>, value: f64, unit: &str) -> Self {
        let mut finding = self.figure(name, value, unit);
        finding.figures.iter_mut().next_back().into_iter().for_each(|figure| figure.timed = true);
        finding
    }

    /// Adds a part.
    pub fn part(mut self, rule: impl Into<String>, holds: bool) -> Self {
        self.parts.push(Part::new(rule, holds));
        self
    }

    /// Adds a part that cannot be tested here.
    pub fn open(mut self, rule: impl Into<String>) -> Self {
        self.parts.push(Part::open(rule));
        self
    }

    /// Adds a plot.
    pub fn picture(mut self, svg: String, caption: impl Into<String>) -> Self {
        self.panels.push(Panel::Picture { svg, caption: caption.into() });
        self
    }

    /// Adds a table; the unit of a column may be empty.
    pub fn table(mut self, caption: &str, columns: &[(&str, &str)], rows: Vec<Vec<String>>) -> Self {
        let columns = columns.iter().map(|(name, unit)| (name.to_string(), unit.to_string())).collect();
        self.panels.push(Panel::Table { caption: caption.into(), columns, rows });
        self
    }

    /// Sets the sentence.
    pub fn say(mut self, sentence: impl Into<String>) -> Self {
        self.sentence = sentence.into();
        self
    }

    /// Returns the value of a figure.
    ///
    /// # Panics
    /// Panics if there is no figure of that name, which is a fault of the claim.
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
