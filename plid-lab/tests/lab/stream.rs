//! Runs whose record is read block by block, against runs that hold it in memory.

use std::path::Path;
use std::sync::atomic::AtomicUsize;

use plid_lab::experiment::Experiment;
use plid_lab::run::{self, Errors, Outcome, RunError, Silent};
use serde_json::Value;

use super::run::{Plant, StopAt, carry_out, config};

/// More than one block of rows, with a missing sample in the training part if `missing`.
fn write(directory: &Path, direct: bool, missing: bool) {
    let text = Plant::new(direct).csv(12_000, 0.05, 8);
    let lines = text.lines().enumerate().map(|(k, line)| match line.rsplit_once(',') {
        Some((head, _)) if missing && k % 3000 == 100 => format!("{head},"),
        _ => line.to_owned(),
    });
    std::fs::write(directory.join("a.csv"), lines.collect::<Vec<_>>().join("\n")).unwrap();
}

/// An experiment in memory, and the same with a stream.
fn both(rest: &str, window: usize) -> [Experiment; 2] {
    let experiment = config("\"a.csv\"", rest);
    let mut streamed = experiment.clone();
    (streamed.data.stream, streamed.data.window) = (true, Some(window));
    [experiment, streamed]
}

/// The files of a run: result.json without what only a stream has, model.json, and the innovations.
fn files(outcome: &Outcome, out: &Path) -> (Value, Vec<u8>, Vec<u8>) {
    run::write(outcome, out).unwrap();
    let read = |name: &str| std::fs::read(out.join(name)).unwrap();
    let mut result: Value = serde_json::from_slice(&read("result.json")).unwrap();
    let object = result.as_object_mut().unwrap();
    assert_eq!(object.remove("stream").is_some(), outcome.streamed.is_some());
    // Its sums are taken in another order.
    result["estimate"].as_object_mut().unwrap().remove("channel_rms").unwrap();
    (result, read("model.json"), read("innovations.csv"))
}

fn close(a: &Errors, b: &Errors) {
    let all = |e: &Errors| [&e.rms_error[..], &e.relative, &e.fit_percent, &[e.overall_relative]].concat();
    for (a, b) in all(a).iter().zip(&all(b)) {
        assert!((a - b).abs() <= 1e-12 * b.abs(), "{a} {b}");
    }
}

/// With a window as long as the record, everything is the same to the bit: noise bank, model, predictor, validation
/// and refinement.
#[test]
fn a_stream_with_a_long_window_gives_the_files_of_a_run_in_memory() {
    let directory = tempfile::tempdir().unwrap();
    for direct in [false, true] {
        write(directory.path(), direct, true);
        let rest = "missing = \"nan\"\n[structure]\nstates = 6\n[validation]\ntraining_share = 0.2\n";
        let [whole, streamed] = both(rest, 20_000).map(|experiment| carry_out(&experiment, directory.path()));
        assert_eq!(streamed.prepared.advanced, usize::from(direct));
        let tail = streamed.streamed.as_ref().unwrap();
        assert_eq!((tail.first, tail.training + tail.window_held_out), (0, tail.samples));
        close(&tail.free_run, &whole.validation.free_run_errors);
        close(tail.one_step.as_ref().unwrap(), whole.validation.one_step_errors.as_ref().unwrap());
        for (name, size) in &streamed.estimate.channel_rms {
            assert!((size / whole.estimate.channel_rms[name] - 1.0).abs() < 1e-12, "{name}");
        }
        let [whole, streamed] = [("whole", &whole), ("streamed", &streamed)]
            .map(|(name, outcome)| files(outcome, &directory.path().join(name)));
        assert_eq!(streamed, whole);
    }
}

/// With the noise given, the recursion and the simulation of the whole tail do not depend on the window.
#[test]
fn a_short_window_gives_the_same_model_and_the_same_errors_of_the_tail() {
    let directory = tempfile::tempdir().unwrap();
    for (direct, missing) in [(false, true), (true, false)] {
        write(directory.path(), direct, missing);
        let rest = "missing = \"nan\"\n[structure]\nstates = 6\n[noise]\nfrom = \"given\"\nsensor = \
            [0.0025, 2500.0]\nstate = 1e-6\n[identification]\npasses = 2\nrefine = \"off\"\n";
        let [whole, streamed] = both(rest, 500).map(|experiment| carry_out(&experiment, directory.path()));
        let part = streamed.streamed.as_ref().unwrap();
        assert_eq!(part.training, whole.prepared.training[0]);
        assert_eq!((part.window_training + part.first, part.samples), (part.training, 12_000 - usize::from(direct)));
        let bits = |outcome: &Outcome| {
            let model = &outcome.canonical;
            let covariance = model.parameter_covariance.as_ref().unwrap();
            let all = [model.a.as_slice(), model.b.as_slice(), model.c.as_slice(), covariance.as_slice()].concat();
            all.into_iter().map(f64::to_bits).collect::<Vec<_>>()
        };
        assert_eq!(bits(&streamed), bits(&whole));
        close(&part.free_run, &whole.validation.free_run_errors);
        // The innovations are those of the window, with their places in the record.
        let [(_, _, all), (_, _, own)] = [("whole", &whole), ("streamed", &streamed)]
            .map(|(name, outcome)| files(outcome, &directory.path().join(name)));
        let lines = |text: Vec<u8>| String::from_utf8(text).unwrap().lines().map(String::from).collect::<Vec<_>>();
        let (all, own) = (lines(all), lines(own));
        let trained = 1..=part.window_training;
        assert_eq!(own[trained.clone()], all[part.first + trained.start()..=part.first + trained.end()]);
    }
}

#[test]
fn an_interrupted_stream_is_resumed_to_the_same_model() {
    let directory = tempfile::tempdir().unwrap();
    write(directory.path(), false, true);
    let rest = "missing = \"nan\"\n[structure]\nstates = 4\n[noise]\nfrom = \"given\"\nsensor = \
        [0.0025, 2500.0]\nstate = 1e-6\n[identification]\npasses = 2\nrefine = \"off\"\n";
    let [_, experiment] = both(rest, 700);
    let whole = files(&carry_out(&experiment, directory.path()), &directory.path().join("whole"));
    let out = directory.path().join("out");
    // In the first pass, in its last samples (which are in the window), and in the second pass.
    for limit in [3000, 5800, 4000] {
        let stop = StopAt(AtomicUsize::new(0), limit);
        let error = run::carry_out(&experiment, directory.path(), Some(&out), true, &stop).unwrap_err();
        assert!(matches!(error, RunError::Interrupted { .. }), "{error}");
    }
    let resumed = run::carry_out(&experiment, directory.path(), Some(&out), true, &Silent).unwrap();
    assert_eq!(files(&resumed, &out), whole);
}

#[test]
fn what_needs_the_whole_record_is_refused_with_its_key() {
    for (rest, said) in [
        ("[structure]\nstates = 4\n[preparation]\ndecimate_to_hz = 50.0\n", "`decimate_to_hz`"),
        ("[structure]\nstates = 4\n[preparation]\ntrend = \"linear\"\n", "`trend = \"linear\"`"),
        ("[structure]\nstates = 4\n[validation]\nperiod = 100\n", "`period`"),
        ("[structure]\nstates = 4\n[noise]\nfrom = \"converter\"\n", "measured on the data"),
    ] {
        let [_, experiment] = both(rest, 100);
        let error = run::carry_out(&experiment, Path::new("."), None, false, &Silent).unwrap_err().to_string();
        assert!(error.starts_with("stream: ") && error.contains(said), "{error}");
    }
    let [mut two, _] = both("[structure]\nstates = 4\n", 100);
    two.data.window = Some(100);
    assert_eq!(two.problems()[0].0, "window");
}
