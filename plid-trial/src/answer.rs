//! The answer to a case on disk: its files, and answer.json with the hashes of these files.

use plid_file::{Folders, sha256};
use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::TrialError;
use crate::files;
use crate::program::Program;

/// The files of an answer by name.
pub type Answer = BTreeMap<&'static str, Vec<u8>>;

/// The content of answer.json: the files of an answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Answered {
    /// The case.
    pub case: String,
    /// The reason for a missing answer: the error of the diagnosis or its panic message.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failed: Option<String>,
    /// The program that answered.
    pub program: Program,
    /// SHA-256 of the files, by name.
    pub files: BTreeMap<String, String>,
}

/// The name of answer.json.
pub(crate) const ANSWER: &str = "answer.json";
/// The duration is stored in a separate file and is not part of the answer, because it differs from run to run.
pub(crate) const SECONDS: &str = "seconds.json";

/// The content of seconds.json.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seconds {
    /// Duration of the diagnosis in s.
    pub seconds: f64,
}

/// Writes an answer whole or not at all. Another process may have given the same answer in the meantime, such as a task
/// of a cluster that was believed to be dead.
pub(crate) fn write(
    answers: &Folders,
    case: &str,
    answer: Result<Answer, String>,
    seconds: f64,
) -> Result<(), TrialError> {
    let (failed, content) = match answer {
        Ok(content) => (None, content),
        Err(reason) => (Some(reason), Answer::new()),
    };
    let hashes = content.iter().map(|(name, bytes)| ((*name).to_owned(), sha256(bytes))).collect();
    let answered = Answered { case: case.to_owned(), failed, program: Program::this()?, files: hashes };
    let place = answers.path().join(case);
    let own = [
        (SECONDS, files::json(&place.join(SECONDS), &Seconds { seconds })?),
        (ANSWER, files::json(&place.join(ANSWER), &answered)?),
    ];
    let all = content.iter().chain(own.iter().map(|(name, bytes)| (name, bytes)));
    match answers.write(case, all.map(|(name, bytes)| (*name, bytes.as_slice()))) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => match read(answers.path(), case)? {
            Some((theirs, _)) if theirs == answered => Ok(()),
            _ => Err(TrialError::Changed { case: case.to_owned(), since: "another process gave it" }),
        },
        written => written.map_err(TrialError::file(place)),
    }
}

/// Reads answer.json of a case and checks the hashes of its files. Returns the hash of answer.json as well; `None` if
/// the case has no answer.
pub(crate) fn read(answers: &Path, case: &str) -> Result<Option<(Answered, String)>, TrialError> {
    let folder = answers.join(case);
    let path = folder.join(ANSWER);
    let bytes = match fs::read(&path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound && !folder.exists() => return Ok(None),
        Err(source) => return Err(TrialError::File { path, source }),
    };
    let answered: Answered = files::parse(&path, &bytes)?;
    let changed = || TrialError::Changed { case: case.to_owned(), since: "it was given" };
    if answered.case != case {
        return Err(changed());
    }
    for (name, hash) in &answered.files {
        // Files of another folder, or devices, are not part of an answer.
        if Path::new(name).file_name().is_none_or(|own| own != name.as_str()) {
            return Err(changed());
        }
        match fs::read(folder.join(name)) {
            Ok(content) if sha256(&content) == *hash => {}
            _ => return Err(changed()),
        }
    }
    Ok(Some((answered, sha256(&bytes))))
}

/// Returns the one program from which all answers come; `None` without answers.
pub(crate) fn one_program<'a>(answered: impl IntoIterator<Item = &'a Answered>) -> Result<Option<Program>, TrialError> {
    let mut one: Option<&Program> = None;
    for answered in answered {
        let ours = *one.get_or_insert(&answered.program);
        if *ours != answered.program {
            return Err(TrialError::OtherProgram {
                what: format!("the answer to {}", answered.case),
                theirs: Box::new(answered.program.clone()),
                ours: Box::new(ours.clone()),
                running: false,
            });
        }
    }
    Ok(one.cloned())
}

pub(crate) fn seconds(answers: &Path, case: &str) -> Result<f64, TrialError> {
    let path = answers.join(case).join(SECONDS);
    let read: Seconds = files::parse(&path, &files::read(&path)?)?;
    Ok(read.seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_whole_or_not_there() {
        let directory = tempfile::tempdir().unwrap();
        let at = directory.path();
        assert_eq!(read(at, "case-1").unwrap(), None);
        // Remains of a crash are removed.
        fs::create_dir(at.join(".case-1.x.plid-tmp")).unwrap();
        fs::write(at.join(".case-1.x.plid-tmp/half"), "x").unwrap();
        let answers = Folders::new(at).unwrap();
        assert_eq!(fs::read_dir(at).unwrap().count(), 0);
        write(&answers, "case-1", Ok(Answer::from([("a.json", b"1".to_vec())])), 2.0).unwrap();
        let (answered, _) = read(at, "case-1").unwrap().unwrap();
        assert_eq!(answered.files["a.json"], sha256(b"1"));
        assert_eq!(seconds(at, "case-1").unwrap(), 2.0);
        write(&answers, "case-2", Err("no".to_owned()), 0.0).unwrap();
        assert_eq!(read(at, "case-2").unwrap().unwrap().0.failed.as_deref(), Some("no"));
    }

    #[test]
    fn an_answer_may_be_given_twice_if_it_is_the_same() {
        let directory = tempfile::tempdir().unwrap();
        let answers = Folders::new(directory.path()).unwrap();
        let give = |content: &[u8]| write(&answers, "case-1", Ok([("a.json", content.to_vec())].into()), 1.0);
        give(b"1").unwrap();
        give(b"1").unwrap();
        assert!(give(b"2").unwrap_err().to_string().contains("since another process gave it"));
    }

    #[test]
    fn a_changed_file_is_found_with_its_case() {
        let directory = tempfile::tempdir().unwrap();
        let at = directory.path();
        write(&Folders::new(at).unwrap(), "case-7", Ok(Answer::from([("a.json", b"1".to_vec())])), 0.0).unwrap();
        let path = at.join("case-7").join(ANSWER);
        let given = fs::read_to_string(&path).unwrap();
        fs::copy(at.join("case-7/a.json"), at.join("a.json")).unwrap();
        fs::write(&path, given.replace("a.json", "../a.json")).unwrap();
        assert!(read(at, "case-7").unwrap_err().to_string().starts_with("case-7: the answer has changed"));
        fs::write(&path, given).unwrap();
        assert!(read(at, "case-7").is_ok());
        fs::write(at.join("case-7/a.json"), "2").unwrap();
        assert!(read(at, "case-7").unwrap_err().to_string().starts_with("case-7: the answer has changed"));
        fs::remove_file(at.join("case-7/a.json")).unwrap();
        assert!(read(at, "case-7").is_err());
    }
}
