//! Strict TOML: an unknown key is an error with its line and a suggestion.

use std::path::{Path, PathBuf};

use miette::{Diagnostic, NamedSource, SourceSpan};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::Experiment;

/// A config that cannot be used.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The reason that the operating system gives.
        source: std::io::Error,
    },
    /// A key or value is invalid.
    #[error("{name}, line {line}: {message}")]
    At {
        /// The file.
        name: String,
        /// The line, from 1.
        line: usize,
        /// The problem with it.
        message: String,
        /// The text of the file.
        #[source_code]
        text: NamedSource<String>,
        /// The location in the text.
        #[label("here")]
        span: SourceSpan,
        /// A suggestion of the intended word.
        #[help]
        help: Option<String>,
    },
}

/// Reads and checks an experiment.
///
/// # Errors
/// Returns a [`ConfigError`] with file, line and, for an unknown word, the most similar known one.
pub fn read(path: &Path) -> Result<Experiment, ConfigError> {
    read_checked(path, Experiment::problems)
}

/// Reads a strict TOML file of any type. `problems` returns the invalid values as pairs of key and reason.
///
/// # Errors
/// Returns the errors of [`read`].
pub fn read_checked<T: DeserializeOwned>(
    path: &Path,
    problems: impl FnOnce(&T) -> Vec<(&'static str, String)>,
) -> Result<T, ConfigError> {
    let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.into(), source })?;
    from_toml_checked(&text, &path.display().to_string(), problems)
}

/// Any strict TOML document, checked as by [`read_checked`].
///
/// # Errors
/// As [`read`].
pub fn from_toml_checked<T: DeserializeOwned>(
    text: &str,
    name: &str,
    problems: impl FnOnce(&T) -> Vec<(&'static str, String)>,
) -> Result<T, ConfigError> {
    let value: T = from_toml(text, name)?;
    match problems(&value).into_iter().next() {
        Some((key, message)) => Err(at(text, name, find_key(text, key), format!("{key}: {message}"), None)),
        None => Ok(value),
    }
}

/// Any strict TOML document.
///
/// # Errors
/// As [`read`].
pub fn from_toml<T: DeserializeOwned>(text: &str, name: &str) -> Result<T, ConfigError> {
    toml::from_str(text).map_err(|error| {
        let message = error.message().to_string();
        at(text, name, error.span().unwrap_or(0..0), message.clone(), suggestion(&message))
    })
}

/// The document that reads back as `value`.
///
/// # Panics
/// If the type cannot be TOML, which is a bug of the type and not of its value.
pub fn to_toml<T: Serialize>(value: &T) -> String {
    toml::to_string_pretty(value).expect("configs are TOML by construction")
}

fn at(text: &str, name: &str, span: std::ops::Range<usize>, message: String, help: Option<String>) -> ConfigError {
    let start = span.start.min(text.len());
    let line = 1 + text.as_bytes()[..start].iter().filter(|&&b| b == b'\n').count();
    ConfigError::At {
        name: name.into(),
        line,
        message,
        text: NamedSource::new(name, text.to_string()),
        span: (start, span.len()).into(),
        help,
    }
}

/// Where a key is set, or its table begins; the document's start if it is only a default.
fn find_key(text: &str, key: &str) -> std::ops::Range<usize> {
    let mut offset = 0;
    for line in text.split_inclusive('\n') {
        let content = line.trim_start();
        let found = content.strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('='))
            || content
                .strip_prefix('[')
                .and_then(|rest| rest.strip_prefix(key))
                .is_some_and(|r| r.starts_with([']', '.']));
        if found {
            let start = offset + line.len() - content.len();
            return start..start + content.trim_end().len();
        }
        offset += line.len();
    }
    0..0
}

/// "unknown field `stats`, expected one of `states`, ..." -> "did you mean `states`?"
fn suggestion(message: &str) -> Option<String> {
    if !message.starts_with("unknown") {
        return None;
    }
    let mut words = message.split('`').skip(1).step_by(2);
    let wrong = words.next()?;
    let known: Vec<&str> = words.collect();
    let nearest =
        known.iter().max_by(|a, b| strsim::jaro_winkler(wrong, a).total_cmp(&strsim::jaro_winkler(wrong, b)))?;
    if strsim::jaro_winkler(wrong, nearest) > 0.7 {
        Some(format!("did you mean `{nearest}`?"))
    } else {
        Some(format!("it can be {}", known.join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::StructureKind;

    fn error(text: &str) -> (usize, String, String) {
        match from_toml::<Experiment>(text, "e.toml").unwrap_err() {
            ConfigError::At { line, message, help, .. } => (line, message, help.unwrap_or_default()),
            other => panic!("{other}"),
        }
    }

    #[test]
    fn an_unknown_key_is_named_with_line_and_suggestion() {
        let (line, message, help) = error("name = \"a\"\n[data]\nfiles = []\n[structure]\nstats = 3\n");
        assert_eq!(line, 5);
        assert!(message.contains("stats"), "{message}");
        assert_eq!(help, "did you mean `states`?");
    }

    #[test]
    fn an_unknown_word_is_named_with_what_it_can_be() {
        let (line, message, help) = error("[data]\n[variant]\ncovariance = \"udu\"\n");
        assert_eq!(line, 3);
        assert!(message.contains("udu"), "{message}");
        assert!(help.contains("bierman-ud"), "{help}");
    }

    #[test]
    fn every_default_survives_a_round_trip() {
        let text =
            "name = \"a\"\n[data]\nfiles = [\"x.csv\"]\ninputs = [\"u\"]\noutputs = [\"y\"]\n[structure]\nstates = 4\n";
        let experiment: Experiment = from_toml(text, "e.toml").unwrap();
        assert!(experiment.problems().is_empty());
        let again: Experiment = from_toml(&to_toml(&experiment), "again").unwrap();
        assert_eq!(experiment, again);
    }

    #[test]
    fn values_out_of_range_are_named() {
        let base = "[data]\nfiles = [\"x.csv\"]\ninputs = [\"u\"]\noutputs = [\"y\"]\n[structure]\n";
        for (rest, said) in [
            ("states = 4\n[validation]\ntraining_share = 1.5", "training_share"),
            ("states = 4\n[identification]\nforgetting = 0.0", "forgetting"),
            ("states = 4\n[noise]\nfrom = \"given\"", "`sensor`"),
            ("states = 4\nindices = [1, 2]", "add up to 3"),
            ("", "`states`"),
        ] {
            let experiment: Experiment = from_toml(&format!("{base}{rest}"), "e").unwrap();
            let problems = format!("{:?}", experiment.problems());
            assert!(problems.contains(said), "{problems}");
        }
    }

    /// The word alone is understood; what it still needs is said, with an example.
    #[test]
    fn the_structure_may_be_a_word_or_a_table() {
        let data = "[data]\nfiles = [\"1.csv\", \"2.csv\"]\ninputs = [\"u\", \"v\"]\noutputs = [\"y\"]\n";
        let read = |structure: &str| from_toml::<Experiment>(&format!("{structure}\n{data}"), "e");
        let table = read("structure = { kind = \"simo-merge\", states = 4 }").unwrap();
        assert_eq!(table.structure.kind, StructureKind::SimoMerge);
        assert_eq!(table.structure.states, Some(4));
        assert!(table.problems().is_empty(), "{:?}", table.problems());
        let again: Experiment = from_toml(&to_toml(&table), "again").unwrap();
        assert_eq!(table, again);

        let word = read("structure = \"simo-merge\"").unwrap();
        assert_eq!(word.structure.kind, StructureKind::SimoMerge);
        assert!(word.problems().iter().any(|(key, said)| *key == "structure" && said.contains("`states`")));
        for (wrong, said) in
            [("structure = \"simo\"", "simo-merge"), ("structure = 30", "a table"), ("structure = { knd = 1 }", "knd")]
        {
            let error = read(wrong).unwrap_err().to_string();
            assert!(error.contains(said) && error.contains("line 1"), "{error}");
        }
        let scan = read("structure = { kind = \"simo-merge\", scan = [2, 4] }").unwrap();
        assert!(scan.problems().iter().any(|(_, said)| said.contains("all runs")), "{:?}", scan.problems());
    }

    #[test]
    fn a_problem_is_shown_at_its_key() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let text = "[data]\nfiles = [\"x.csv\"]\ninputs = [\"u\"]\noutputs = [\"y\"]\n[structure]\nstates = \
            4\n[validation]\ntraining_share = 2.0\n";
        std::fs::write(file.path(), text).unwrap();
        let message = read(file.path()).unwrap_err().to_string();
        assert!(message.contains("line 8"), "{message}");
    }
}
