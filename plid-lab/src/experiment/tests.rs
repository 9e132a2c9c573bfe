//! Tests of the messages for the author of a config.

use super::*;

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
    assert!(message.contains("`udu`") && message.contains("`bierman-ud`"), "{message}");
    // The message already lists the words.
    assert_eq!(help, "");
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
        ("states = 4\n[variant]\nscalar = \"double-double\"\nbackend = \"nalgebra\"", "backend = \\\"plain\\\""),
        ("", "`states`"),
    ] {
        let experiment: Experiment = from_toml(&format!("{base}{rest}"), "e").unwrap();
        let problems = format!("{:?}", experiment.problems());
        assert!(problems.contains(said), "{problems}");
    }
}

/// The word alone is accepted, and the message states with an example what else is required.
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
