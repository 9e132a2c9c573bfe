//! A trial of an effect that neither the testbed nor the diagnosis has: its truth is added to the one, its model to
//! the other.

use std::fs;

use plid_gap::effects::{
    Action, Effect, Flexible, Library, Memory, Parameter, Place, Range, Sampling, Sensor, Setting, Side,
};
use plid_testbed::effects::own::{self, Level, Truth};
use plid_trial::{Extent, Options, TrialConfig, diagnose, draw, score};
use plid_work::Silent;

#[path = "../../examples/own_effect/bent.rs"]
mod bent;

use bent::BentSensor;

// ANCHOR: truth
/// The truth of a bent sensor: y' = y + c y^2, or y' = y + c |y|^1.5 as a near miss.
struct Bent;

impl Truth for Bent {
    fn name(&self) -> &'static str {
        "bent-sensor"
    }
    fn side(&self) -> own::Side {
        own::Side::Sensor
    }
    fn parameters(&self) -> &'static [&'static str] {
        &["c"]
    }
    fn start(&self, level: &Level) -> Vec<f64> {
        vec![0.1 / level.output]
    }
    fn near_misses(&self) -> &'static [&'static str] {
        &["power"]
    }
    fn act(&self, law: Option<&str>, parameters: &[f64]) -> own::Action {
        let c = parameters[0];
        let exponent = if law == Some("power") { 1.5 } else { 2.0 };
        own::Action::Sample(Box::new(move |y, _t| y + c * y.abs().powf(exponent)))
    }
}
// ANCHOR_END: truth

const TRIAL: &str = r#"
name = "own effect"
[cases]
none = 1
singles_per_effect = 2
[draw]
effects = ["bent-sensor"]
least_over_floor = 5.0
perturbed = 0.0
length = 0.25
channels = [{ inputs = 1, outputs = 2 }]
"#;

#[test]
fn an_effect_of_ones_own_is_drawn_by_name_and_diagnosed() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    fs::write(at("trial.toml"), TRIAL).unwrap();
    let read = || TrialConfig::read(&at("trial.toml"));
    assert!(read().unwrap_err().to_string().contains("`bent-sensor` is not in the vocabulary"));
    own::add(Bent);
    let config = read().unwrap();
    draw(&config, 5, &at("T"), &at("S"), &Silent).unwrap();

    let library = Library::standard().with(Box::new(BentSensor));
    let done = diagnose(&at("T"), Options { shard: None, jobs: 2 }, &library, &Silent).unwrap();
    assert_eq!((done.cases, done.failed), (3, Vec::new()));
    let scores = score(&at("T"), &at("S"), Extent::Whole, &library, &at("out"), &Silent).unwrap();
    let all = scores.totals("all", "all", 0).unwrap();
    assert_eq!((all.exact.hits, all.exact.of, all.located.hits), (2, 2, 2), "{:#?}", scores.cases);
    assert_eq!((all.family.hits, all.false_alarms.hits), (2, 0));
    // One case follows the equation of the diagnosis, the other a near miss.
    let found: Vec<_> = scores.cases.iter().filter(|line| line.truth == "bent-sensor").collect();
    assert_eq!(found.iter().filter(|line| line.own_equation).count(), 1, "{found:?}");
    for line in found.iter().filter(|line| line.own_equation) {
        // Its parameter has an interval, and the simulation with it predicts the held-out record.
        assert_eq!(line.covered.keys().collect::<Vec<_>>(), ["c"], "{line:?}");
        assert!(line.judged[0].gap.is_some_and(|gap| gap < 1.5 * line.gap_floor), "{line:?}");
    }
}
