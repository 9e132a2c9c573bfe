//! Failures and their exit status: 1 if the work failed, 2 if the arguments or a file are wrong.

use std::fmt::Display;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::Path;

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use miette::Report;
use plid::IdentifierError;
use plid::catalogue::VariantError;
use plid::lab::data::DataError;
use plid::lab::identify::IdentifyError;
use plid::lab::merge::MergeError;
use plid::lab::run::RunError;
use plid::model::ModelError;
use plid::refine::RefineError;
use plid_bench::study::StudyError;

/// A failure with its exit status.
pub enum Failure {
    /// The arguments or a file are wrong: 2.
    Input(Report),
    /// The work failed: 1.
    Work(Report),
}

impl Failure {
    /// The arguments or a file are wrong.
    pub fn input(message: impl Display) -> Self {
        Self::Input(Report::msg(message.to_string()))
    }

    /// The work failed.
    pub fn work(message: impl Display) -> Self {
        Self::Work(Report::msg(message.to_string()))
    }

    /// A file or directory that the user named cannot be used (2), or the machine failed, as with a full disk (1).
    pub fn file(path: &Path, error: &io::Error) -> Self {
        let message = format!("{}: {error}", path.display());
        match error.kind() {
            ErrorKind::NotFound
            | ErrorKind::PermissionDenied
            | ErrorKind::AlreadyExists
            | ErrorKind::NotADirectory
            | ErrorKind::IsADirectory
            | ErrorKind::ReadOnlyFilesystem
            | ErrorKind::InvalidFilename
            | ErrorKind::InvalidInput => Self::input(message),
            _ => Self::work(message),
        }
    }

    /// Prints the error on standard error and returns the exit status.
    pub fn show(&self) -> u8 {
        let (Self::Work(report) | Self::Input(report)) = self;
        // A terminal gets the text with the place marked; a log gets a line.
        let text = if io::stderr().is_terminal() {
            let styled = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
            marked(report, if styled { Renderer::styled() } else { Renderer::plain() })
        } else {
            let help = report.help().map(|help| format!(" ({help})")).unwrap_or_default();
            format!("plid: {report}{help}")
        };
        // Without a reader, the status still shows the failure.
        let _ = writeln!(io::stderr(), "{text}");
        if matches!(self, Self::Work(_)) { 1 } else { 2 }
    }
}

/// Returns an error as text that shows the lines of the file to which it points, with the places marked.
fn marked(report: &Report, renderer: Renderer) -> String {
    let mut group = Group::with_title(Level::ERROR.primary_title(report.to_string()));
    let labels = || report.labels().into_iter().flatten();
    // Only the lines with a mark and their neighbours are shown, so the source may be the whole file up to the last
    // mark.
    let whole = labels().map(|label| label.offset() + label.len()).max().unwrap_or(0);
    let source = report.source_code().and_then(|code| code.read_span(&(0, whole).into(), 0, 1).ok());
    if let Some(source) = &source {
        let mut snippet = Snippet::source(String::from_utf8_lossy(source.data())).path(source.name());
        for label in labels() {
            let span = label.offset()..label.offset() + label.len();
            snippet = snippet.annotation(AnnotationKind::Primary.span(span).label(label.label().map(str::to_string)));
        }
        group = group.element(snippet);
    }
    if let Some(help) = report.help() {
        group = group.element(Level::HELP.message(help.to_string()));
    }
    renderer.render(&[group])
}

impl From<RunError> for Failure {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Model(error) => error.into(),
            RunError::File { path, source } => Self::file(&path, &source),
            RunError::Merge(MergeError::Run { run, source }) => match Self::from(*source) {
                Self::Input(report) => Self::input(format!("run {run}: {report}")),
                Self::Work(report) => Self::work(format!("run {run}: {report}")),
            },
            RunError::Identify(IdentifyError::Variant(ref cause)) if was_asked_for(cause) => Self::Input(error.into()),
            RunError::Refine(RefineError::Model(error)) => error.into(),
            RunError::Refine(RefineError::Decomposition { .. } | RefineError::Interrupted) => Self::Work(error.into()),
            RunError::Config(_)
            | RunError::Setting { .. }
            | RunError::Data(_)
            | RunError::Prepare(_)
            | RunError::Testbed(_)
            | RunError::Merge(_)
            | RunError::Refine(_)
            | RunError::Signal(_)
            | RunError::Checkpoint { .. }
            | RunError::Sweep { .. } => Self::Input(error.into()),
            RunError::Identify(_) | RunError::NotFinite { .. } | RunError::Interrupted { .. } => {
                Self::Work(error.into())
            }
        }
    }
}

/// Whether the request itself made the recursion impossible.
fn was_asked_for(error: &VariantError) -> bool {
    match error {
        VariantError::NoDoubleDouble(_) | VariantError::Absent { .. } => true,
        VariantError::Identifier(error) => !matches!(
            error,
            IdentifierError::NotFinite { .. } | IdentifierError::Indefinite { .. } | IdentifierError::Diverged { .. }
        ),
    }
}

impl From<ModelError> for Failure {
    fn from(error: ModelError) -> Self {
        match error {
            ModelError::Diverged { .. } | ModelError::Riccati { .. } | ModelError::Eigenvalues => {
                Self::Work(error.into())
            }
            _ => Self::Input(error.into()),
        }
    }
}

impl From<DataError> for Failure {
    fn from(error: DataError) -> Self {
        Self::Input(error.into())
    }
}

impl From<StudyError> for Failure {
    fn from(error: StudyError) -> Self {
        match error {
            StudyError::File { path, source } => Self::file(&path, &source),
            // The error is not wrapped, so that the place in the file is shown.
            StudyError::Config(error) => Self::Input(error.into()),
            StudyError::Content { .. } | StudyError::Shards(_) => Self::input(error),
            StudyError::NotFinite { .. } | StudyError::Cell { .. } | StudyError::Interrupted { .. } => {
                Self::work(error)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A terminal shows the line with the unknown word, and the word that was probably meant.
    #[test]
    fn the_place_in_a_file_is_marked() {
        #[derive(Debug, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        #[expect(dead_code, reason = "the file is never read")]
        struct Config {
            states: usize,
            samples: usize,
        }
        let text = "states = 4\nsampels = 100\n";
        let error = plid::lab::data::config::from_toml::<Config>(text, "a.toml").unwrap_err();
        let shown = marked(&error.into(), Renderer::plain());
        assert!(shown.starts_with("error: a.toml, line 2: unknown field `sampels`"), "{shown}");
        assert!(shown.contains("\n2 | sampels = 100\n  | ^^^^^^^ here"), "{shown}");
        assert!(shown.contains("help: ") && shown.contains("samples"), "{shown}");
    }
}
