//! Drawing, sealing, sharing out, merging, scoring: with a diagnosis that is made up, so that only the machinery is at
//! work.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use plid_gap::Step;
use plid_gap::answer::schema::About;
use plid_gap::calibration::Calibration;
use plid_gap::effects::Library;
use plid_trial::ablation::diagnose_without_with;
use plid_trial::config::{Cases, Draw};
use plid_trial::{
    Answer, Calibrated, Extent, Opened, Options, Shard, TrialConfig, TrialError, calibrate, diagnose_with, draw, merge,
    score, score_without,
};
use plid_work::{Progress, Silent};
use tempfile::TempDir;

fn config() -> TrialConfig {
    let cases = Cases { none: 2, singles_per_effect: 1, leave_one_out: 1, ..Cases::default() };
    let effects = ["sensor-offset", "sensor-gain"].map(str::to_owned).to_vec();
    TrialConfig { name: "made up".to_owned(), cases, draw: Draw { effects, ..Draw::default() } }
}

/// T and S in a directory of their own.
struct Trial {
    directory: TempDir,
}

impl Trial {
    fn drawn(seed: u64) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let trial = Self { directory };
        draw(&config(), seed, &trial.t(), &trial.s(), &Silent).unwrap();
        trial
    }

    fn t(&self) -> PathBuf {
        self.directory.path().join("T")
    }

    fn s(&self) -> PathBuf {
        self.directory.path().join("S")
    }

    fn diagnose(&self, shard: Option<&str>, jobs: usize) {
        let shard = shard.map(|text| text.parse::<Shard>().unwrap());
        diagnose_with(&self.t(), Options { shard, jobs }, &made_up, &Silent).unwrap();
    }

    fn score(&self) -> Result<serde_json::Value, TrialError> {
        self.score_of(Extent::Whole)
    }

    fn score_of(&self, extent: Extent) -> Result<serde_json::Value, TrialError> {
        score(&self.t(), &self.s(), extent, &Library::standard(), &self.directory.path().join("out"), &Silent)?;
        let mut scores: serde_json::Value = read(&self.directory.path().join("out/scores.json"));
        scores["time"] = serde_json::Value::Null;
        Ok(scores)
    }
}

fn read(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Names an effect that depends on the case's records, panics at one case and fails at another.
fn made_up(folder: &Path, without: &[String]) -> Result<Answer, String> {
    match folder.file_name().and_then(|name| name.to_str()) {
        Some("case-002") => panic!("the second case is too much"),
        Some("case-004") => return Err("the fourth case cannot be read".to_owned()),
        _ => {}
    }
    let sum: usize = fs::read(folder.join("r1.csv")).map_err(|e| e.to_string())?.iter().map(|b| *b as usize).sum();
    let effect = ["sensor-offset", "sensor-gain"][sum % 2];
    let named = serde_json::json!([{ "effect": effect, "location": "output:y1", "confidence": 0.95 }]);
    let claim = serde_json::json!({
        "verdict": "effects", "effects": named, "without": without,
        "candidates": [{ "effects": named, "probability": 0.9 }, { "effects": [], "unknown": true,
            "probability": 0.1 }],
        "gap": { "predicted_held_out_gap": 0.02 },
        "statements": [
            { "about": "effect", "before": 0.95, "basis": { "imperfect": 0.0 } },
            { "about": "remainder", "before": 0.2, "basis": { "imperfect": 0.0 } },
        ],
        "statistics": { "effect": effect, "location": "output:y1", "values": { "confidence": 0.95, "left": 0.3 } },
        "remainder": { "further_cause": 0.2, "material": 0.02 },
    });
    let baselines = serde_json::json!({ "ranking": { "verdict": "none" }, "fitted": null });
    let bytes = |value: &serde_json::Value| value.to_string().into_bytes();
    let mut answer = Answer::from([
        ("diagnosis.json", bytes(&claim)),
        ("sim-with-effect.json", b"{}".to_vec()),
        ("baselines.json", bytes(&baselines)),
    ]);
    if !without.is_empty() {
        answer.insert("left-out.json", bytes(&serde_json::json!({ "verdict": "unknown" })));
        answer.insert("left-out-sim.json", b"{}".to_vec());
    }
    Ok(answer)
}

/// Every file below a directory with its bytes, but for what says how long something took.
fn bytes(directory: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![directory.to_path_buf()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.file_name().unwrap() != "seconds.json" {
                found.insert(path.strip_prefix(directory).unwrap().to_path_buf(), fs::read(&path).unwrap());
            }
        }
    }
    found
}

#[test]
fn a_seed_gives_its_draw_and_the_cases_say_nothing_of_it() {
    let (first, again, other) = (Trial::drawn(11), Trial::drawn(11), Trial::drawn(12));
    assert_eq!(bytes(&first.t()), bytes(&again.t()));
    assert_eq!(bytes(&first.s()), bytes(&again.s()));
    let cases = |trial: &Trial| bytes(&trial.t().join("cases"));
    assert!(cases(&first).iter().zip(cases(&other)).any(|(a, b)| *a.1 != b.1));

    // Names of files are those that every case has; and no text but the list of what is left out has the name of an
    // effect.
    let names: Vec<_> = cases(&first).keys().map(|path| path.file_name().unwrap().to_owned()).collect();
    assert_eq!(names.len(), 5 * 8);
    let seal = read(&first.s().join("seal.json"));
    let salt = seal["salt"].as_str().unwrap();
    assert_eq!((seal["seed"].as_u64(), salt.len()), (Some(11), 64));
    for (path, content) in bytes(&first.t()) {
        let text = String::from_utf8(content).unwrap();
        assert!(!text.contains(salt) && !text.contains("seed") && !text.contains("gap"), "{}", path.display());
        assert!(path.ends_with("trial.json") || !text.contains("sensor-"), "{}", path.display());
    }
    let manifest = read(&first.t().join("trial.json"));
    let without = |case: &serde_json::Value| case["without"].as_array().unwrap().len();
    // The one that lacks what is at work, and one that lacks what is not.
    assert_eq!(manifest["cases"].as_array().unwrap().iter().map(without).sum::<usize>(), 2);
}

#[test]
fn answers_and_scores_do_not_depend_on_jobs_shards_or_what_is_sealed() {
    let (whole, shared) = (Trial::drawn(21), Trial::drawn(21));
    whole.diagnose(None, 1);
    let hidden = shared.directory.path().join("elsewhere");
    fs::rename(shared.s(), &hidden).unwrap();
    shared.diagnose(Some("2/2"), 3);
    shared.diagnose(Some("1/2"), 2);
    merge(&shared.t(), &[]).unwrap();
    fs::rename(&hidden, shared.s()).unwrap();
    assert_eq!(bytes(&whole.t().join("answers")), bytes(&shared.t().join("answers")));

    let (one, other) = (whole.score().unwrap(), shared.score().unwrap());
    assert_eq!(one, other);
    // What failed is told, and counts as no answer.
    let line = |case: &str| one["cases"].as_array().unwrap().iter().find(|line| line["case"] == case).unwrap();
    assert_eq!(line("case-002")["failed"], "panicked: the second case is too much");
    assert_eq!(line("case-004")["failed"], "the fourth case cannot be read");
    assert_eq!(line("case-002")["judged"][0]["said"], "missing");
    // Scored again, nothing changes; merged again, nothing either.
    assert_eq!(merge(&shared.t(), &[]).unwrap(), 2);
    assert_eq!(shared.score().unwrap(), other);
    let page = fs::read_to_string(whole.directory.path().join("out/report.html")).unwrap();
    // The page begins with what failed; a second answer to a case is a diagnosis, too.
    let failures = page.find(" diagnoses failed and count as wrong: ").unwrap();
    assert!(failures < page.find("<svg").unwrap());
    assert!(page.contains("panicked: the second case is too much (case-002)"));
}

#[test]
fn an_answer_that_changed_is_refused_by_its_number() {
    let trial = Trial::drawn(31);
    trial.diagnose(None, 2);
    let answers = trial.t().join("answers");
    let path = answers.join("case-003/diagnosis.json");
    let before = fs::read(&path).unwrap();
    // Changed before scoring: its own hash tells.
    fs::write(&path, "{\"verdict\": \"none\"}").unwrap();
    let said = trial.score().unwrap_err().to_string();
    assert_eq!(said, "case-003: the answer has changed since it was given; it is rejected");
    fs::write(&path, before).unwrap();
    trial.score().unwrap();
    // Changed after scoring, hash and all.
    fs::remove_dir_all(answers.join("case-005")).unwrap();
    let said = trial.score().unwrap_err().to_string();
    assert!(said.starts_with("1 of 5 cases have no answer yet, case-005 is the first"), "{said}");
    let other = |_: &Path, _: &[String]| Err("I have thought again".to_owned());
    diagnose_with(&trial.t(), Options { shard: None, jobs: 1 }, &other, &Silent).unwrap();
    let said = trial.score().unwrap_err().to_string();
    assert_eq!(said, "case-005: the answer has changed since the answers were fixed for scoring; it is rejected");
}

/// Those that are there are scored, and that is the end of the trial: neither is one added, nor one taken away.
#[test]
fn a_part_of_a_trial_is_scored_once() {
    let trial = Trial::drawn(31);
    let nothing = trial.score_of(Extent::Answered).unwrap_err().to_string();
    assert!(nothing.starts_with("5 of 5 cases have no answer yet"), "{nothing}");
    trial.diagnose(None, 2);
    let answer = |case: &str| trial.t().join("answers").join(case);
    let whole = trial.directory.path().join("whole");
    fs::rename(answer("case-002"), &whole).unwrap();
    let scores = trial.score_of(Extent::Answered).unwrap();
    let names: BTreeSet<&str> = scores["cases"]
        .as_array()
        .unwrap()
        .iter()
        .map(|line| &line["case"].as_str().unwrap()[.."case-001".len()])
        .collect();
    assert_eq!((scores["of"].as_u64(), names.len(), names.contains("case-002")), (Some(5), 4, false));
    let page = fs::read_to_string(trial.directory.path().join("out/report.html")).unwrap();
    assert!(page.contains("4 of 5 cases (the others have no answer and do not count)"));
    fs::rename(&whole, answer("case-002")).unwrap();
    for extent in [Extent::Whole, Extent::Answered] {
        let said = trial.score_of(extent).unwrap_err().to_string();
        assert_eq!(said, "case-002: the answer has changed since the answers were fixed for scoring; it is rejected");
    }
    fs::remove_dir_all(answer("case-002")).unwrap();
    fs::remove_dir_all(answer("case-004")).unwrap();
    assert!(trial.score_of(Extent::Answered).unwrap_err().to_string().starts_with("case-004: the answer has changed"));
}

#[test]
fn a_broken_seal_is_found() {
    let trial = Trial::drawn(41);
    trial.diagnose(None, 2);
    let label = trial.s().join("cases/case-004/label.json");
    let before = fs::read(&label).unwrap();
    fs::write(&label, String::from_utf8(before.clone()).unwrap().replace("true", "false")).unwrap();
    let said = trial.score().unwrap_err().to_string();
    assert!(said.starts_with("case-004: ") && said.contains("label.json is not the sealed file"), "{said}");
    // The answers are fixed all the same: whoever broke it has seen what is sealed.
    assert!(trial.s().join("answers.json").exists());
    fs::write(&label, before).unwrap();
    trial.score().unwrap();
    // A trial.json with other commitments.
    let manifest = trial.t().join("trial.json");
    let text = fs::read_to_string(&manifest).unwrap();
    fs::write(&manifest, text.replace("\"without\": []", "\"without\": [\"sensor-gain\"]")).unwrap();
    assert!(trial.score().unwrap_err().to_string().contains("it is not the one that"));
}

#[test]
fn a_case_that_was_altered_is_refused() {
    let trial = Trial::drawn(41);
    let refused = |what: &str, said: &str| {
        let message = format!(
            "case-003: {} is not the file that was drawn",
            trial.t().join("cases/case-003").join(what).display()
        );
        assert!(said.starts_with(&message), "{said}");
    };
    let diagnosed = || diagnose_with(&trial.t(), Options { shard: None, jobs: 1 }, &made_up, &Silent);
    // A record that is changed, one that is added, and one that is missing when the answers are scored.
    let record = trial.t().join("cases/case-003/r1.csv");
    let before = fs::read(&record).unwrap();
    fs::write(&record, "u1,y1\n0,0\n").unwrap();
    refused("r1.csv", &diagnosed().unwrap_err().to_string());
    fs::write(&record, &before).unwrap();
    let added = record.with_file_name("r9.csv");
    fs::write(&added, &before).unwrap();
    refused("r9.csv", &diagnosed().unwrap_err().to_string());
    fs::remove_file(&added).unwrap();
    diagnosed().unwrap();
    fs::remove_file(&record).unwrap();
    refused("r1.csv", &trial.score().unwrap_err().to_string());
    fs::write(&record, &before).unwrap();
    // A seed that is not the one that was drawn from.
    let seal = trial.s().join("seal.json");
    let text = fs::read_to_string(&seal).unwrap();
    fs::write(&seal, text.replace("\"seed\": 41", "\"seed\": 42")).unwrap();
    let said = trial.score().unwrap_err().to_string();
    assert!(said.contains("seed: the salt was not made from 42"), "{said}");
    fs::write(&seal, text).unwrap();
    trial.score().unwrap();
}

/// An answer and a shard as another build would have left them.
#[test]
fn answers_of_two_programs_are_not_mixed() {
    let rebuilt = |path: &Path| {
        let mut written = read(path);
        written["program"]["executable_sha256"] = "0123456789abcdef".into();
        fs::write(path, written.to_string()).unwrap();
    };
    let trial = Trial::drawn(51);
    trial.diagnose(None, 2);
    let program = trial.score().unwrap()["program"].clone();
    assert_eq!(program, read(&trial.s().join("seal.json"))["program"]);
    assert_eq!(program["version"], env!("CARGO_PKG_VERSION"));

    let trial = Trial::drawn(51);
    trial.diagnose(None, 2);
    rebuilt(&trial.t().join("answers/case-002/answer.json"));
    let said = diagnose_with(&trial.t(), Options { shard: None, jobs: 1 }, &made_up, &Silent).unwrap_err().to_string();
    assert!(
        said.starts_with("the answer to case-002 comes from plid")
            && said.contains("(executable 01234567), but this is")
    );
    let said = trial.score().unwrap_err().to_string();
    assert!(said.starts_with("the answer to case-002 comes from") && said.contains("but another comes from"), "{said}");

    trial.diagnose(Some("1/2"), 1);
    trial.diagnose(Some("2/2"), 1);
    rebuilt(&trial.t().join("shards/2-of-2/shard.json"));
    let said = merge(&trial.t(), &[]).unwrap_err().to_string();
    assert!(said.starts_with("shard 2 of 2 comes from plid"), "{said}");
}

#[test]
fn shards_that_make_no_whole_are_named_by_number() {
    let trial = Trial::drawn(51);
    let t = trial.t();
    let said = |folders: &[PathBuf]| merge(&t, folders).unwrap_err().to_string();
    trial.diagnose(Some("1/3"), 1);
    trial.diagnose(Some("3/3"), 1);
    assert_eq!(said(&[]), "shard 2 of 3 is missing");
    trial.diagnose(Some("2/3"), 1);
    let shard = |i: usize| t.join(format!("shards/{i}-of-3"));
    assert_eq!(said(&[shard(2)]), "shards 1, 3 of 3 are missing");
    let twice = said(&[shard(1), shard(2), shard(2), shard(3)]);
    assert!(twice.starts_with("shard 2 of 3 is given twice"), "{twice}");
    trial.diagnose(Some("1/2"), 1);
    assert!(said(&[]).contains("is one of 3, but others are of 2"));
    fs::remove_dir_all(t.join("shards/1-of-2")).unwrap();
    // A shard of another trial.
    let other = Trial::drawn(52);
    other.diagnose(Some("2/3"), 1);
    let strange = other.t().join("shards/2-of-3");
    assert_eq!(said(&[shard(1), strange, shard(3)]), "shard 2 of 3 is of another trial");
    // One that is not finished.
    fs::remove_file(shard(3).join("shard.json")).unwrap();
    assert!(said(&[]).contains("3-of-3: this shard is not finished"));
    trial.diagnose(Some("3/3"), 1);
    fs::write(shard(3).join("case-003/diagnosis.json"), "{}").unwrap();
    assert!(said(&[]).starts_with("case-003: the answer has changed"));
}

/// Asks for an end after so many cases.
struct Until(std::sync::atomic::AtomicUsize);

impl Progress for Until {
    fn stage(&self, _name: &str) {}
    fn advance(&self, done: usize, _total: usize) {
        self.0.store(done, std::sync::atomic::Ordering::Relaxed);
    }
    fn interrupted(&self) -> bool {
        self.0.load(std::sync::atomic::Ordering::Relaxed) >= 3
    }
}

#[test]
fn what_was_done_before_an_interruption_is_not_done_again() {
    let (trial, whole) = (Trial::drawn(61), Trial::drawn(61));
    let options = Options { shard: None, jobs: 1 };
    let ended = diagnose_with(&trial.t(), options, &made_up, &Until(0.into())).unwrap_err();
    assert!(matches!(ended, TrialError::Interrupted { .. }), "{ended}");
    let answers = trial.t().join("answers");
    assert_eq!(fs::read_dir(&answers).unwrap().count(), 3);
    // A crash left half an answer.
    fs::create_dir(answers.join(".case-004.x.plid-tmp")).unwrap();
    let done = diagnose_with(&trial.t(), options, &made_up, &Silent).unwrap();
    assert_eq!((done.cases, done.before), (5, 3));
    let failed: Vec<_> = done.failed.iter().map(|(case, why)| (case.as_str(), why.as_str())).collect();
    assert_eq!(
        failed,
        [("case-002", "panicked: the second case is too much"), ("case-004", "the fourth case cannot be read")]
    );
    whole.diagnose(None, 1);
    assert_eq!(bytes(&answers), bytes(&whole.t().join("answers")));
}

/// Without polishing nothing is ever named; without anything else the answers stay as they are.
fn made_up_without(folder: &Path, without: &[String], off: Option<Step>) -> Result<Answer, String> {
    let mut answer = made_up(folder, without)?;
    answer.remove("baselines.json");
    if off == Some(Step::Polishing) {
        answer.insert("diagnosis.json", b"{ \"verdict\": \"none\", \"effects\": [], \"candidates\": [] }".to_vec());
    }
    Ok(answer)
}

#[test]
fn what_a_step_is_worth_is_read_case_by_case() {
    let trial = Trial::drawn(71);
    let (t, out) = (trial.t(), trial.directory.path().join("ablation"));
    let steps = [Step::Polishing, Step::Audit];
    let ablated = |off: &[Step]| score_without(&t, &trial.s(), off, &Library::standard(), &out, &Silent);
    trial.diagnose(None, 2);
    let said = ablated(&steps).unwrap_err().to_string();
    assert!(said.starts_with("5 of 5 cases have no answer yet"), "{said}");
    let done = diagnose_without_with(&t, &steps, 2, &made_up_without, &Silent).unwrap();
    assert_eq!(done.iter().map(|done| (done.cases, done.before)).collect::<Vec<_>>(), [(5, 0); 3]);
    let done = diagnose_without_with(&t, &steps, 2, &made_up_without, &Silent).unwrap();
    assert!(done.iter().all(|done| done.before == 5));

    let found = ablated(&steps).unwrap();
    let scores = trial.score().unwrap();
    let cases = scores["cases"].as_array().unwrap();
    let of = |asked: &str, key: &str| -> Vec<String> {
        let there = |case: &&serde_json::Value| case["asked"] == asked && case["judged"][0][key] == true;
        cases.iter().filter(there).filter_map(|case| case["case"].as_str().map(str::to_owned)).collect()
    };
    let [polishing, audit] = found.steps.as_slice() else { panic!("two steps were asked for") };
    // Two of the five have no answer with or without it.
    assert_eq!((polishing.changed.len(), audit.changed.len()), (3, 0));
    let change = |figure: &str| polishing.changes.iter().find(|change| change.figure == figure).unwrap();
    // Whatever was named is named no longer: alarms go, and so do the right names.
    assert_eq!((&change("false alarm").better, &change("exact").worse), (&of("none", "named"), &of("single", "exact")));
    assert!(change("false alarm").worse.is_empty() && change("exact").better.is_empty());
    assert!(!change("false alarm").better.is_empty() || !change("exact").worse.is_empty(), "the seed says nothing");
    assert!(audit.changes.iter().all(|c| c.better.is_empty() && c.worse.is_empty() && c.p == 1.0));
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("No answer changed without audit") && page.contains("<svg"), "{page}");
    let written = read(&out.join("ablation.json"));
    assert_eq!(written["steps"][0]["step"], "polishing");

    // Fixed before anything was opened, as the trial's own.
    let answers = t.join("ablation/polishing");
    fs::remove_dir_all(answers.join("case-003")).unwrap();
    diagnose_without_with(&t, &steps, 1, &|_, _, _| Err("I have thought again".to_owned()), &Silent).unwrap();
    let said = ablated(&steps).unwrap_err().to_string();
    assert_eq!(said, "case-003: the answer has changed since the answers were fixed for scoring; it is rejected");
}

#[test]
fn another_program_s_answers_are_no_measure_for_a_step() {
    let trial = Trial::drawn(72);
    trial.diagnose(None, 1);
    let other = |folder: &Path, without: &[String], _: Option<Step>| {
        let mut answer = made_up(folder, without)?;
        answer.insert("sim-with-effect.json", b"{ }".to_vec());
        Ok(answer)
    };
    diagnose_without_with(&trial.t(), &[Step::Audit], 1, &other, &Silent).unwrap();
    let said = score_without(&trial.t(), &trial.s(), &[Step::Audit], &Library::standard(), &trial.t(), &Silent);
    let said = said.unwrap_err().to_string();
    assert!(said.starts_with("case-001: the answer has changed since the trial was diagnosed"), "{said}");
}

/// Each of the three answers makes a statement about the first effect, about the explanation and about the remainder.
#[test]
fn every_kind_of_statement_has_its_curve() {
    let trial = Trial::drawn(21);
    trial.diagnose(None, 2);
    let scores = trial.score().unwrap();
    let kinds: Vec<(&str, u64)> = (scores["reliability"].as_array().unwrap().iter())
        .map(|one| (one["about"].as_str().unwrap(), one["calibration"]["of"].as_u64().unwrap()))
        .collect();
    assert_eq!(kinds, [("effect", 3), ("explanation", 3), ("remainder", 3)]);
    let page = fs::read_to_string(trial.directory.path().join("out/report.html")).unwrap();
    let section = page.split("Reliability of each kind of statement").nth(1).unwrap();
    assert!(section.contains("A cause that the answer does not name"), "{section}");
}

/// The case whose effect is left out is a single effect with the whole vocabulary, and outside it in its second answer;
/// the decoy's second answer is not counted.
#[test]
fn a_second_answer_is_asked_what_it_cannot_know() {
    let trial = Trial::drawn(21);
    trial.diagnose(None, 2);
    let manifest = read(&trial.t().join("trial.json"));
    let twice = manifest["cases"].as_array().unwrap().iter().filter(|case| case["without"] != serde_json::json!([]));
    assert_eq!(twice.count(), 2);
    let scores = trial.score().unwrap();
    let lines = scores["cases"].as_array().unwrap();
    assert_eq!(lines.len(), 5 + 1);
    let second = lines.iter().find(|line| line["arm"] == "leave-one-out").unwrap();
    let name = second["case"].as_str().unwrap();
    let (case, left_out) = name.split_once(" without ").unwrap();
    assert_eq!((left_out, second["asked"].as_str()), (second["truth"].as_str().unwrap(), Some("outside")));
    let first = lines.iter().find(|line| line["case"] == case).unwrap();
    assert_eq!((first["arm"].as_str(), first["asked"].as_str()), (Some("single"), Some("single")));
    assert_eq!(first["truth"], second["truth"]);
    let answered = first["failed"].is_null();
    assert_eq!(second["judged"][0]["open"], answered);
}

/// Each of the three answers names an effect with 0.95, and not all of them are right.
#[test]
fn a_calibration_is_learnt_from_one_trial_and_checked_on_another() {
    let trials = [11, 12].map(Trial::drawn);
    trials.iter().for_each(|trial| trial.diagnose(None, 1));
    let opened = |trial: &Trial| vec![Opened { trial: trial.t(), sealed: trial.s() }];
    let out = trials[0].directory.path().join("calibration");
    let calibrated = calibrate(&opened(&trials[0]), &opened(&trials[1]), &[], &out).unwrap();

    let written: Calibration = serde_json::from_value(read(&out.join("calibration.json"))).unwrap();
    assert_eq!(written, calibrated.calibration);
    assert_eq!((written.trials[0].name.as_str(), written.trials[0].seed, written.trials[0].cases), ("made up", 11, 5));
    assert_eq!(calibrated.checked_on[0].seed, 12);
    // Three of the five cases are answered; the other two failed.
    let [all, effect, explanation, remainder] = calibrated.checked.as_slice() else {
        panic!("{:?}", calibrated.checked)
    };
    assert_eq!((all.right.of, effect.right.of, explanation.right.of, remainder.right.of), (9, 3, 3, 3));
    let rows: Vec<(&str, usize)> = calibrated.separation.iter().map(|row| (row.statistic.as_str(), row.of)).collect();
    assert_eq!(rows, [("frequency alone", 3), ("present basis", 3), ("left", 3)]);
    assert_eq!(fs::read_to_string(out.join("separation.csv")).unwrap().lines().count(), 4);
    let stated = |calibration: &plid_trial::statistics::Calibration| calibration.bins[0].stated;
    assert!((stated(&effect.before) - 0.95).abs() < 1e-12 && stated(&effect.after) < 0.9, "{:?}", effect.after);
    assert!(fs::read_to_string(out.join("reliability.svg")).unwrap().contains("after calibration"));
    // The answers are fixed before the seals are opened.
    assert!(trials[1].s().join("answers.json").exists());

    // Only the coefficients of the remainder change, and only they are ascribed to this trial.
    let Calibrated { calibration: of_remainder, .. } =
        calibrate(&opened(&trials[0]), &[], &[About::Remainder], &out).unwrap();
    let used = Calibration::used();
    assert_eq!(of_remainder.remainder, calibrated.calibration.remainder);
    assert_ne!(of_remainder.remainder, used.remainder);
    assert_eq!(
        Calibration { remainder: used.remainder.clone(), trials: used.trials.clone(), ..of_remainder.clone() },
        *used
    );
    let last = of_remainder.trials.last().unwrap();
    assert_eq!((of_remainder.trials.len(), last.seed), (used.trials.len() + 1, 11));
    assert_eq!(last.only, [About::Remainder]);
}
