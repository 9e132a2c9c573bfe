//! Trials that draw shapes of families: what is sealed has them, and development has none of what is reported.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use plid_testbed::effects::{Families, Shape, kind};
use plid_testbed::gap::PlantKind;
use plid_trial::config::{Cases, Draw};
use plid_trial::{TrialConfig, draw};
use plid_work::Silent;
use serde_json::Value;

const EFFECTS: [&str; 4] = ["sensor-lag", "sensor-saturation", "actuator-dead-zone", "sensor-drift"];

/// The laws that the labels of a small trial of near misses record, those of imperfections included.
fn laws(families: Families, imperfections: f64) -> Vec<Value> {
    let effects = EFFECTS.map(str::to_owned).to_vec();
    let imperfections = plid_trial::config::Span::Value(imperfections);
    laws_of(Draw { effects, families, imperfections, ..Draw::default() })
}

/// The laws that the labels record if each effect is drawn three times with a law that is a near miss.
fn laws_of(draws: Draw) -> Vec<Value> {
    let at = tempfile::tempdir().unwrap();
    let cases = Cases { singles_per_effect: 3, ..Cases::default() };
    let draws = Draw { near_misses: 1.0, length: 0.1, ..draws };
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

/// Bodies on axes have no imperfections, but their laws have shapes of families all the same.
#[test]
fn axes_have_shapes_of_families_too() {
    let effects = ["actuator-dead-zone", "coulomb-friction"].map(str::to_owned).to_vec();
    let plants = vec![PlantKind::Servo, PlantKind::Slider, PlantKind::Pendulum];
    let laws = laws_of(Draw { effects, plants, families: Families::Reported, ..Draw::default() });
    assert_eq!(laws.len(), 6);
    for shape in laws.iter().map(|law| law.as_object().unwrap_or_else(|| panic!("{law} has no numbers"))) {
        let (law, numbers) = shape.iter().next().unwrap();
        let kinds = [kind("actuator-dead-zone").unwrap(), kind("coulomb-friction").unwrap()];
        for (number, value) in numbers.as_object().unwrap() {
            let of_it = |shape: &&Shape| shape.law == law && shape.number == number;
            let shape = kinds.iter().flat_map(|kind| kind.shapes).find(of_it).unwrap();
            let value = value.as_f64().unwrap();
            let is_reported = shape.ranges.reported.iter().any(|[low, high]| (*low..=*high).contains(&value));
            assert!(is_reported, "{law}: {number} = {value}");
        }
    }
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
