//! A trial of three cases with plid's own diagnosis, from the draw to the report.

use std::fs;
use std::path::Path;

use plid_gap::effects::Library;
use plid_testbed::gap::{Channels, PlantKind};
use plid_trial::config::{Cases, Draw};
use plid_trial::{Extent, Options, Shard, TrialConfig, diagnose, draw, score};
use plid_work::Silent;
use serde_json::Value;

const FILES: [&str; 4] = ["answer.json", "baselines.json", "diagnosis.json", "sim-with-effect.json"];

fn answer(folder: &Path) -> Vec<Vec<u8>> {
    FILES.iter().map(|file| fs::read(folder.join(file)).unwrap()).collect()
}

/// The keys whose values are `null` in a JSON text, apart from those of which the format of diagnosis.json says so.
fn nulls(value: &Value, key: &str, found: &mut Vec<String>) {
    match value {
        Value::Null if !["gap_after", "next_experiment"].contains(&key) => found.push(key.to_owned()),
        Value::Array(items) => items.iter().for_each(|item| nulls(item, key, found)),
        Value::Object(fields) => fields.iter().for_each(|(key, value)| nulls(value, key, found)),
        _ => {}
    }
}

/// Where there is no figure, there is no key.
fn require_no_null(file: &Path) {
    let value = serde_json::from_slice(&fs::read(file).unwrap()).unwrap();
    let mut found = Vec::new();
    nulls(&value, "", &mut found);
    assert!(found.is_empty(), "{}: null at {found:?}", file.display());
}

#[test]
fn three_cases_from_the_draw_to_the_report() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let (t, s) = (at("T"), at("S"));
    let cases = Cases { none: 1, singles_per_effect: 1, ..Cases::default() };
    let draws = Draw {
        effects: ["sensor-offset", "actuator-saturation"].map(str::to_owned).to_vec(),
        // Above what may be missed.
        least_over_floor: 5.0,
        near_misses: 0.0,
        // Short records of a plant with few modes and channels show the machinery as well as long ones.
        plants: vec![PlantKind::Beam],
        channels: vec![Channels { inputs: 2, outputs: 2 }],
        length: 0.25,
        ..Draw::default()
    };
    let config = TrialConfig { name: "three".to_owned(), cases, draw: draws };
    draw(&config, 3, &t, &s, &Silent).unwrap();

    let library = Library::standard();
    // Diagnosed while what is sealed is out of sight.
    fs::rename(&s, at("elsewhere")).unwrap();
    diagnose(&t, Options { shard: None, jobs: 2 }, &library, &Silent).unwrap();
    fs::rename(at("elsewhere"), &s).unwrap();
    // One of them again with everything in its place, as a shard on one thread: the same bytes.
    let shard: Shard = "2/3".parse().unwrap();
    diagnose(&t, Options { shard: Some(shard), jobs: 1 }, &library, &Silent).unwrap();
    assert_eq!(answer(&t.join("answers/case-002")), answer(&t.join("shards/2-of-3/case-002")));

    let scored = score(&t, &s, Extent::Whole, &library, &at("out"), &Silent).unwrap();
    require_no_null(&at("out/scores.json"));
    for case in ["case-001", "case-002", "case-003"] {
        FILES.iter().for_each(|file| require_no_null(&t.join("answers").join(case).join(file)));
    }
    assert_eq!(scored.cases.len(), 3);
    assert!(scored.cases.iter().all(|line| line.failed.is_none()));
    for line in &scored.cases {
        // Every answerer predicted the held-out record, and no gap is below what the noise makes.
        for judged in &line.judged {
            assert!(judged.gap.is_some_and(|gap| gap > 0.9 * line.gap_floor), "{line:?}");
        }
    }
    // The black box closes much of what both effects leave, and makes the third case no worse.
    for line in &scored.cases {
        let left = line.gap_black_box.unwrap();
        let most = if line.truth == "none" { 1.05 } else { 0.5 };
        assert!(left > 0.9 * line.gap_floor && left < most * line.gap_as_given, "{line:?}");
    }
    let ceiling = scored.ceiling.first().unwrap();
    assert_eq!((ceiling.is.as_str(), ceiling.cases), ("effects of the vocabulary", 2));
    // Every baseline states probabilities.
    for judged in scored.cases.iter().flat_map(|line| &line.judged) {
        assert!(judged.top.is_some_and(|(probability, _)| probability > 0.0 && probability <= 1.0), "{judged:?}");
    }
    // Both effects are loud and the vocabulary's own, and nothing is missing in the third.
    let all = scored.totals("all", "all", 0).unwrap();
    assert_eq!((all.exact.hits, all.exact.of, all.located.hits), (2, 2, 2), "{:#?}", scored.cases);
    assert_eq!((all.false_alarms.hits, all.false_alarms.of), (0, 1));
    assert!(all.shrink_median.is_some_and(|shrink| shrink > 0.9));
    assert!(fs::read_to_string(at("out/report.html")).unwrap().contains("Power against strength"));
    assert!(fs::read_to_string(at("out/report.html")).unwrap().contains("What a model without physics closes"));
    assert!(fs::read_to_string(at("out/reliability.svg")).unwrap().contains("stated probability"));
}
