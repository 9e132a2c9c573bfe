//! Strict TOML: an unknown key is an error with its line and a suggestion.

use std::ops::Range;
use std::path::{Path, PathBuf};

use miette::{Diagnostic, NamedSource, SourceSpan};
use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue};

/// The error of a config that cannot be used.
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

/// Reads a strict TOML file of any type. `problems` returns the invalid values, as key and reason.
///
/// # Errors
/// Returns [`ConfigError`] with file, line and, for an unknown word, the nearest known one.
pub fn read_checked<T: DeserializeOwned>(
    path: &Path,
    problems: impl FnOnce(&T) -> Vec<(&'static str, String)>,
) -> Result<T, ConfigError> {
    let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.into(), source })?;
    from_toml_checked(&text, &path.display().to_string(), problems)
}

/// Reads any strict TOML document, checked as by [`read_checked`].
///
/// # Errors
/// Returns the errors of [`read_checked`].
pub fn from_toml_checked<T: DeserializeOwned>(
    text: &str,
    name: &str,
    problems: impl FnOnce(&T) -> Vec<(&'static str, String)>,
) -> Result<T, ConfigError> {
    let value: T = from_toml(text, name)?;
    match problems(&value).into_iter().next() {
        Some((key, reason)) => Err(error_at(text, name, find_key(text, key), key, &reason)),
        None => Ok(value),
    }
}

/// Reads any strict TOML document.
///
/// # Errors
/// Returns the errors of [`read_checked`].
pub fn from_toml<T: DeserializeOwned>(text: &str, name: &str) -> Result<T, ConfigError> {
    let value = toml::from_str(text).map_err(|error| {
        let message = error.message().to_string();
        at(text, name, error.span().unwrap_or(0..0), message.clone(), suggestion(&message))
    })?;
    // TOML has words for NaN and infinity, but no key of a config may have such a value.
    match DeTable::parse(text).ok().and_then(|table| table.get_ref().iter().find_map(not_finite)) {
        Some((key, span)) => {
            let message = format!("{key}: {} is not a finite number", &text[span.clone()]);
            Err(at(text, name, span, message, None))
        }
        None => Ok(value),
    }
}

/// Returns the key and the place of the first number of an entry that is not finite.
fn not_finite((key, value): (&Spanned<DeString>, &Spanned<DeValue>)) -> Option<(String, Range<usize>)> {
    match value.get_ref() {
        DeValue::Float(number) => {
            let is_finite = number.as_str().parse().is_ok_and(f64::is_finite);
            (!is_finite).then(|| (key.get_ref().to_string(), value.span()))
        }
        DeValue::Array(items) => items.iter().find_map(|item| not_finite((key, item))),
        DeValue::Table(table) => table.iter().find_map(not_finite),
        _ => None,
    }
}

/// Returns a document that reads back as `value`.
///
/// # Panics
/// Panics if the type cannot be written as TOML, which is a bug of the type and not of its value.
pub fn to_toml<T: Serialize>(value: &T) -> String {
    toml::to_string_pretty(value).expect("configs are TOML by construction")
}

/// Returns the error for a value of the document `text` that cannot be used, with its place there, its key and the
/// reason. A reason that names an unknown word gets a suggestion.
pub fn error_at(text: &str, name: &str, place: Range<usize>, key: &str, reason: &str) -> ConfigError {
    at(text, name, place, format!("{key}: {reason}"), suggestion(reason))
}

fn at(text: &str, name: &str, span: Range<usize>, message: String, help: Option<String>) -> ConfigError {
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

/// Returns the place where a key is set, or where its table begins; the start of the document if the key is not set
/// there.
fn find_key(text: &str, key: &str) -> Range<usize> {
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

/// Returns a suggestion: "unknown field `stats`, expected one of `states`, ..." -> "did you mean `states`?"
fn suggestion(message: &str) -> Option<String> {
    if !message.starts_with("unknown") {
        return None;
    }
    let mut words = message.split('`').skip(1).step_by(2);
    let wrong = words.next()?;
    let known: Vec<&str> = words.collect();
    let nearest =
        known.iter().max_by(|a, b| strsim::jaro_winkler(wrong, a).total_cmp(&strsim::jaro_winkler(wrong, b)))?;
    // The message itself lists the known words.
    (strsim::jaro_winkler(wrong, nearest) > 0.7).then(|| format!("did you mean `{nearest}`?"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    /// A case with `start_s = nan` was once accepted.
    #[test]
    fn a_number_that_is_not_finite_is_refused_with_its_line() {
        #[derive(Debug, Deserialize)]
        struct Config {
            _list: Vec<f64>,
            _inner: Option<Box<Config>>,
        }
        let read = |text: &str| from_toml::<Config>(text, "x.toml").map_err(|error| error.to_string());
        assert!(read("_list = [1.0, 2.0]").is_ok());
        assert_eq!(read("_list = [1.0, nan]").unwrap_err(), "x.toml, line 1: _list: nan is not a finite number");
        // An integer that TOML cannot represent does not hide the NaN.
        let error = read("_list = [18446744073709551615, nan]").unwrap_err();
        assert!(error.ends_with("nan is not a finite number"), "{error}");
        let error = read("_list = []\n[_inner]\n_list = [-inf]").unwrap_err();
        assert!(error.ends_with("_list: -inf is not a finite number"), "{error}");
    }
}
