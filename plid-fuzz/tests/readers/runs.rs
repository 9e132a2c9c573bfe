//! The files of a finished run, which a merge reads, and the checkpoint of an interrupted one.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use plid_lab::experiment::{Experiment, from_toml};
use plid_lab::merge::FinishedRun;
use plid_lab::run::{CHECKPOINT, Outcome, Progress, RunError, carry_out};

use crate::{fuzz, with_folder, words};

/// A finished run with one file in another form.
fn finished(bytes: &[u8], file: &str) -> String {
    with_folder(|folder| {
        let files = [
            ("model.json", include_str!("../../corpus/run-model/model.json")),
            ("result.json", include_str!("../../corpus/run-result/result.json")),
            ("manifest.json", include_str!("../../corpus/run-manifest/manifest.json")),
        ];
        for (name, text) in files {
            fs::write(folder.join(name), text).unwrap();
        }
        fs::write(folder.join(file), bytes).unwrap();
        words(FinishedRun::read(folder))
    })
}

#[cfg_attr(test, test)]
pub fn run_model() {
    fuzz("run-model", 2000, 3000, |bytes| finished(bytes, "model.json"));
}

#[cfg_attr(test, test)]
pub fn run_result() {
    fuzz("run-result", 1000, 3000, |bytes| finished(bytes, "result.json"));
}

#[cfg_attr(test, test)]
pub fn run_manifest() {
    fuzz("run-manifest", 1000, 3000, |bytes| finished(bytes, "manifest.json"));
}

/// A small experiment and its record, in `folder`.
fn experiment(folder: &Path) -> Experiment {
    let rows = (0..40_u32).map(|k| {
        let u = if k % 3 == 0 { 1.0 } else { -0.5 };
        format!("{u},{}\n", (0.7 * f64::from(k)).sin() + 0.01 * f64::from(k * k % 7))
    });
    fs::write(folder.join("r.csv"), format!("u,y\n{}", rows.collect::<String>())).unwrap();
    let text = "name = \"small\"\n[data]\nfiles = [\"r.csv\"]\ninputs = [\"u\"]\noutputs = [\"y\"]\n\
        sample_rate_hz = 100.0\n[preparation]\nadvance = 0\n[structure]\nstates = 2\n[identification]\npasses = 2\n\
        [validation]\nmodel_only = true\n";
    from_toml(text, "small.toml").unwrap()
}

/// Interrupts a run after a number of reports of its progress.
struct After(AtomicUsize);

impl After {
    fn new(reports: usize) -> Self {
        Self(AtomicUsize::new(reports))
    }
}

impl Progress for After {
    fn stage(&self, _: &str) {}

    fn advance(&self, _: usize, _: usize) {
        let _ = self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1));
    }

    fn interrupted(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }
}

fn continued(folder: &Path, reports: usize) -> Result<Outcome, RunError> {
    carry_out(&experiment(folder), folder, Some(folder), true, &After::new(reports))
}

#[cfg_attr(test, test)]
pub fn run_checkpoint() {
    fuzz("run-checkpoint", 2000, 100, |bytes| {
        with_folder(|folder| {
            fs::write(folder.join(CHECKPOINT), bytes).unwrap();
            words(continued(folder, usize::MAX))
        })
    });
}

/// The corpus holds what an interrupted run writes in its recursion, but for rounding, and a run continues from it.
#[test]
fn the_corpus_is_the_checkpoint_of_a_run() {
    with_folder(|folder| {
        let interrupted = (1..).map(|reports| {
            let _ = fs::remove_file(folder.join(CHECKPOINT));
            continued(folder, reports).unwrap_err();
            fs::read_to_string(folder.join(CHECKPOINT)).unwrap()
        });
        let written = interrupted.into_iter().find(|text| text.contains("\"paused\":{")).unwrap();
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus/run-checkpoint/recursion.json");
        let corpus = fs::read_to_string(file).unwrap();
        let of_the_experiment = |text: &str| text.split("\"memory\"").next().map(str::to_string);
        assert_eq!(of_the_experiment(&corpus), of_the_experiment(&written), "{written}");
        assert!(corpus.contains("\"paused\":{"));
        fs::write(folder.join(CHECKPOINT), corpus).unwrap();
        continued(folder, usize::MAX).unwrap();
    });
}
