//! Trials that draw shapes of families: what is sealed has them, and development has none of what is reported.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use plid_testbed::effects::Families;
use plid_trial::config::{Cases, Draw};
use plid_trial::{TrialConfig, draw};
use plid_work::Silent;
use serde_json::Value;

const EFFECTS: [&str; 4] = ["sensor-lag", "sensor-saturation", "actuator-dead-zone", "sensor-drift"];

/// The laws that the labels of a small trial of near misses record, those of imperfections included.
fn laws(families: Families, imperfections: f64) -> Vec<Value> {
    let at = tempfile::tempdir().unwrap();
    let cases = Cases { singles_per_effect: 3, ..Cases::default() };
    let effects = EFFECTS.map(str::to_owned).to_vec();
    let imperfections = plid_trial::config::Span::Value(imperfections);
    let draws = Draw { effects, near_misses: 1.0, length: 0.1, families, imperfections, ..Draw::default() };
    let config = TrialConfig { name: "families".to_owned(), cases, draw: draws };
    draw(&config, 8, &at.path().join("T"), &at.path().join("S"), &Silent).unwrap();
    let label = |case: &Path| -> Value { serde_json::from_slice(&fs::read(case.join("label.json")).unwrap()).unwrap() };
    let cases = fs::read_dir(at.path().join("S/cases")).unwrap().map(|case| label(&case.unwrap().path()));
    let effects = |label: Value| {
        let of = |key: &str| label[key].as_array().cloned().unwrap_or_default();
        of("effects").into_iter().chain(of("background_effects")).collect::<Vec<_>>()
    };
    let laws = cases.flat_map(effects).map(|effect| effect["config"]["law"].clone());
    laws.filter(|law| !law.is_null()).collect()
}

#[test]
fn a_label_records_the_shape_that_was_drawn() {
    let texts = |families| laws(families, 0.0).iter().map(Value::to_string).collect::<Vec<String>>();
    let [fixed, development, reported] =
        [Families::Fixed, Families::Development, Families::Reported].map(texts).map(|laws| {
            assert_eq!(laws.len(), 3 * EFFECTS.len());
            laws.into_iter().collect::<BTreeSet<String>>()
        });
    // Six near misses of the four effects have fixed shapes, each with its name alone; no shape is drawn twice.
    assert!(fixed.len() <= 6 && fixed.iter().all(|law| law.starts_with('"')), "{fixed:?}");
    assert_eq!((development.len(), reported.len()), (12, 12), "{development:?}, {reported:?}");
    assert!(development.union(&reported).all(|law| law.starts_with('{')), "{development:?}, {reported:?}");
}

/// Half of the imperfections follow another law, and then one of a family, too.
#[test]
fn imperfections_have_shapes_of_families_too() {
    let with_numbers = |families| laws(families, 0.03).iter().filter(|law| law.is_object()).count();
    assert_eq!(with_numbers(Families::Fixed), 0);
    // Twelve of them are the main causes'.
    let found = with_numbers(Families::Development);
    assert!(found > 12 + 12, "{found}");
}
