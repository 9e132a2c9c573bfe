//! The page of an invented diagnosis.

use std::collections::BTreeMap;

use nalgebra::DMatrix;

use super::page;
use crate::answer::schema::{
    Change, Comparison, Diagnosis, Explanation, Gap, Located, NamedEffect, Remainder, RemainderPlace, ShrinkOver,
    SimulationWithEffects, Value, Where, WrittenEffect,
};
use crate::answer::shape::{Motion, Shape};
use crate::case::levels::LevelRun;
use crate::case::record::{Channels, Record};
use crate::case::{Case, CaseConfig};
use crate::diagnose::{Outcome, Shown};
use crate::effects::Side;
use crate::evidence::Evidence;
use crate::evidence::lines::{Kind, Line, Lines};
use crate::evidence::resonances::{Alone, Resonance};
use crate::evidence::tracks::{Passed, Tracks};
use crate::judge::locate::{BANDS, Estimate, LevelGap, Map, STRETCHES};
use crate::judge::verdict::{Adequacy, Verdict};
use crate::testing::random_input;

const SAMPLES: usize = 1200;

fn scaled(y: &[Vec<f64>], by: f64) -> Channels {
    y.iter().map(|y| y.iter().map(|y| by * y).collect()).collect()
}

fn case() -> Case {
    let toml = "sample_rate_hz = 100.0\ninputs = [\"u1\"]\noutputs = [\"y<1>\", \"y2\"]\nsuspects = [\"clearance\"]\n\
                [[record]]\nfile = \"a&b.csv\"\n[[record]]\nfile = \"last.csv\"\n";
    let config: CaseConfig = plid_data::config::from_toml(toml, "case.toml").expect("a sound case");
    let record = |index: usize, level: f64| Record {
        name: config.record[index].file.clone(),
        start_s: 12.0 * index as f64,
        ..crate::testing::record(
            scaled(&random_input(index as u64, SAMPLES, 1), level),
            scaled(&random_input(10 + index as u64, SAMPLES, 2), level),
        )
    };
    let records = vec![record(0, 0.3), record(1, 1.0)];
    Case { config, model: None, controller: None, records, for_simulation: Vec::new(), warnings: Vec::new() }
}

fn passed(record: &str, level: f64, start_s: f64, hz: f64) -> Passed {
    Passed { record: record.into(), level, start_s, innovations: 1.2, modes: vec![Some((hz, 0.01)), None] }
}

const CUBIC: &str = "cubic-stiffness";

fn value(value: f64, ci95: Option<[f64; 2]>) -> Value {
    Value { value, ci95, unit: "f/d^3".into() }
}

fn parameters() -> BTreeMap<String, Value> {
    BTreeMap::from([("k".to_string(), value(1.25e3, Some([1.1e3, 1.4e3])))])
}

fn candidates() -> Vec<Explanation> {
    let located = |effect: &str, location: &str| Located { effect: effect.into(), location: location.into() };
    let explained = |effects: Vec<Located>, probability: f64| Explanation {
        effects,
        unknown: false,
        probability,
        gap_after: Some(0.02),
        wiring: None,
    };
    vec![
        explained(vec![located(CUBIC, "input:u1")], 0.9),
        explained(vec![located("clearance", "input:u1"), located("sensor-gain", "output:y2")], 0.06),
        explained(Vec::new(), 0.025),
        Explanation { effects: Vec::new(), unknown: true, probability: 0.015, gap_after: None, wiring: None },
    ]
}

fn separability() -> Vec<Comparison> {
    let compared = |explanation: &str, before: Option<(f64, f64)>, after: Option<(f64, f64)>| Comparison {
        explanation: explanation.into(),
        absorbed: before.map(|_| 0.6543),
        cosine: before.map(|(cosine, _)| cosine),
        expected_before: before.map(|(_, expected)| expected),
        expected: after.map(|(expected, _)| expected),
        realised: after.map(|(_, realised)| realised),
    };
    vec![
        compared("cubic-stiffness@input:u1", Some((1.0, 0.0)), Some((0.0, 0.0))),
        compared("clearance@input:u1", Some((0.9871, 7.25)), Some((3.75, 1.5))),
        compared("clearance@input:u1 + sensor-gain@output:y2", None, Some((31.5, 33.5))),
        compared("sensor-gain@output:y2", Some((0.25, 481.5)), None),
    ]
}

fn diagnosis() -> Diagnosis {
    Diagnosis {
        verdict: Verdict::Effects,
        sentence: "cubic-stiffness at input:u1 <b>is it</b>.".into(),
        simulator: None,
        effects: vec![NamedEffect {
            effect: CUBIC.into(),
            location: "input:u1".into(),
            share: Some(0.951),
            share_ci95: Some([0.932, 0.964]),
            confidence: 0.93,
            family: None,
            parameters: parameters(),
            change: Some(Change {
                number: "factor of input u1".into(),
                from: 1.0,
                to: Value { value: 1.0725, ci95: Some([1.065, 1.08]), unit: "1".into() },
            }),
            shape_differs: true,
        }],
        candidates: candidates(),
        not_separable: vec![vec!["cubic-stiffness@input:u1".into(), "clearance@input:u1".into()]],
        separability: separability(),
        statements: Vec::new(),
        shapes: vec![shape()],
        place: place(),
        gap: gap(),
        statistics: None,
        remainder: remainder(),
        next_experiment: Some("Record it at <twice> the level.".into()),
        evidence: vec!["The resonance at 11 Hz stiffens & the damping does not change.".into()],
        settings: crate::settings::GapSettings::default(),
        warnings: vec!["a&b.csv: 3 samples are missing.".into()],
    }
}

fn shape() -> Shape {
    Shape {
        effect: CUBIC.into(),
        location: "input:u1".into(),
        family: Some("springs & more".into()),
        over: Motion::Displacement,
        unit: "mm".into(),
        force_unit: "N".into(),
        points: vec![[-1.0, 2.0], [0.5, -0.25], [2.0, -16.0]],
        ci95: Some(vec![[1.5, 2.5], [-0.3, -0.2], [-18.0, -14.0]]),
    }
}

fn remainder() -> Remainder {
    Remainder {
        gap: 0.02,
        noise: 0.01,
        share_of_gap: 0.0019,
        further_cause: 0.12,
        material: 0.02,
        repeats: Some(0.35),
        place: RemainderPlace { channels: place().channels, bands_hz: vec![[10.0, 12.0, 0.8]] },
        nearest: vec![Located { effect: "clearance".into(), location: "input:u1".into() }],
        noise_unseen: false,
    }
}

fn place() -> Where {
    Where {
        side: Some(Side::Structure),
        side_is_clear: true,
        places: Vec::new(),
        channels: BTreeMap::from([("y<1>".to_string(), 0.3), ("y2".to_string(), 0.7)]),
        bands_hz: vec![[10.0, 12.0, 0.8]],
        time: vec![0.125; STRETCHES],
        level_slope: Some(2.0),
        channels_ci95: BTreeMap::from([("y<1>".to_string(), [0.2, 0.4]), ("y2".to_string(), [0.6, 0.8])]),
        bands_ci95: vec![[0.7, 0.9]],
        time_ci95: vec![[0.1, 0.15]; STRETCHES],
        level_slope_ci95: Some([1.9, 2.1]),
        levels: Vec::new(),
    }
}

fn gap() -> Gap {
    Gap {
        as_given: 0.4,
        refit: 0.15,
        within_limits: 0.15,
        free_refit: 0.12,
        with_effect: 0.02,
        noise_floor: 0.01,
        shrink: 0.957,
        shrink_ci95: [0.94, 0.97],
        shrink_over_refit: 0.88,
        placebo_shrink: 0.01,
        shrink_over: vec![ShrinkOver { than: "bounded refit".into(), gap: 0.15, shrink: 0.88, ci95: [0.86, 0.9] }],
        share_of_ceiling: 0.99,
        share_of_ceiling_ci95: [0.97, 1.0],
        crossed_gap: 0.021,
        predicted_held_out_gap: 0.021,
        predicted_ci80: [0.018, 0.025],
        measured_on: vec!["last.csv".into()],
        measured_on_fitted: false,
    }
}

fn simulation() -> SimulationWithEffects {
    SimulationWithEffects {
        format: "simulation-with-effects".into(),
        linear: serde_json::Value::Null,
        modes: 1,
        linear_with_modal_effects: None,
        as_given: None,
        controller: None,
        refit: vec!["mode 11.00 Hz: frequency 11.000 -> 11.010 Hz".into()],
        intersample: Default::default(),
        effects: vec![WrittenEffect {
            effect: CUBIC.into(),
            location: "input:u1".into(),
            parameters: parameters(),
            given: BTreeMap::new(),
            equation: "f = -k d^3".into(),
        }],
        t0: 24.0,
        noise_rms: vec![0.01, 0.01],
        fitted: None,
        plant: Default::default(),
    }
}

fn map(levels: Vec<(f64, f64)>) -> Map {
    let estimate = |value: f64| Estimate { value, ci95: [0.9 * value, 1.1 * value] };
    Map {
        edges: (0..=BANDS).map(|k| 50.0 * k as f64 / BANDS as f64).collect(),
        share: DMatrix::from_fn(2, BANDS, |o, b| (1 + o + b) as f64 / 660.0),
        time: DMatrix::from_element(STRETCHES, BANDS, 1.0 / (STRETCHES * BANDS) as f64),
        outputs: vec![estimate(0.3), estimate(0.7)],
        bands: vec![estimate(1.0 / BANDS as f64); BANDS],
        stretches: vec![estimate(0.125); STRETCHES],
        levels: levels
            .into_iter()
            .map(|(level, gap)| LevelGap { record: "a&b.csv".into(), level, gap: estimate(gap) })
            .collect(),
        slope: Some(estimate(2.0)),
    }
}

fn level_run(record: &Record) -> LevelRun {
    LevelRun {
        record: record.name.clone(),
        level: record.level(),
        u: record.u.clone(),
        y: record.y.clone(),
        given: scaled(&record.y, 0.6),
        with: scaled(&record.y, 0.98),
    }
}

fn evidence() -> Evidence {
    Evidence {
        repeats: None,
        tracks: Tracks { passed: vec![passed("a&b.csv", 0.3, 0.0, 11.02), passed("last.csv", 1.0, 12.0, 10.97)] },
        resonances: [("a&b.csv", 0.3, 11.02), ("b.csv", 0.6, 11.0), ("last.csv", 1.0, 10.97)]
            .map(|(record, level, hz)| Alone {
                record: record.into(),
                level,
                start_s: level,
                modes: vec![Some(Resonance { hz, hz_std: 1e-3, damping: 0.01, damping_std: 1e-4 })],
            })
            .to_vec(),
        lines: Some(Lines {
            record: "a&b.csv".into(),
            periods: 4,
            outputs: vec![
                [Kind::Driven, Kind::Odd, Kind::Even]
                    .map(|kind| Line { hz: 7.0, kind, measured: 0.1, simulated: 0.1, noise: 0.01 })
                    .to_vec();
                2
            ],
        }),
    }
}

fn shown(case: &Case) -> Shown {
    let last = &case.records[1].y;
    Shown {
        outputs: case.config.outputs.clone(),
        units: vec![Some("rad/s".into()), Some("m".into())],
        rate: 100.0,
        before: map(vec![(0.3, 0.04), (1.0, 0.4)]),
        after: map(vec![(0.3, 0.0), (1.0, 0.01)]),
        adequacy: Adequacy { excess: 0.5, left: 0.001, max_prior_z: 1.2, next_gain: 4.0, unknown: 0.015 },
        stages: vec![vec![
            (CUBIC.into(), "input:u1".into(), 5123.4, 0.78),
            ("clearance".into(), "input:u1".into(), 5000.0, 0.8),
            ("sensor-gain".into(), "output:y2".into(), -3.0, 1.0),
        ]],
        trace_record: "last.csv".into(),
        trace: [last.clone(), scaled(last, 0.6), scaled(last, 0.98)],
        stochastic: vec![("sensor-noise".into(), "output:y2".into(), 55.0)],
        refit: vec![(11.0, 0.4, -1.2, 0.3)],
        costs: [1600.0, 220.0, 1.01],
        fitted: vec![("a&b.csv".into(), 0.0, SAMPLES)],
        levels: case.records.iter().map(level_run).collect(),
        noise: vec![vec![(1.0, 1e-6), (49.0, 1e-6)]; 2],
        evidence: evidence(),
        linear: false,
    }
}

fn outcome(case: &Case) -> Outcome {
    Outcome { diagnosis: diagnosis(), simulation: simulation(), shown: shown(case) }
}

#[test]
fn the_page_says_all_that_the_diagnosis_says() {
    let case = case();
    let html = page(&outcome(&case), &case).to_html();
    for text in [
        "cubic-stiffness at input:u1 &lt;b&gt;is it&lt;/b&gt;.",
        // Every explanation.
        ">cubic-stiffness at input:u1<",
        "clearance at input:u1 and sensor-gain at output:y2",
        "nothing is missing",
        "something outside the vocabulary",
        "cubic-stiffness@input:u1; clearance@input:u1",
        // Whether the records could separate them.
        "if cubic-stiffness@input:u1 is the true cause",
        "65.4",
        "0.9871",
        "481.5",
        "33.5",
        // The size with its unit and interval.
        "f/d^3",
        "1100 to 1400",
        "(shape differs)",
        "f = -k d^3",
        "In the simulation: factor of input u1 from 1.0000 to 1.0725 (1.0650 to 1.0800).",
        "The resonance at 11 Hz stiffens &amp; the damping",
        // Shares and slope with their intervals.
        "80.0\u{a0}% (70.0\u{a0}% to 90.0\u{a0}%)",
        "to the power +2.0 (+1.8 to +2.2)",
        "a&amp;b.csv: 3 samples are missing.",
        "Record it at &lt;twice&gt; the level.",
        "frequency 11.000 -&gt; 11.010 Hz",
        "sensor-noise",
        "higher prior: clearance",
        "Gap on last.csv: 2.10\u{a0}% predicted from the fitted records, 2.00\u{a0}% measured.",
        "a gap of 2.10\u{a0}% is expected (80\u{a0}% interval 1.80\u{a0}% to 2.50\u{a0}%)",
        "1.80 to 2.50",
        // The share of the effect, with its interval.
        "95.1 (93.2 to 96.4)",
        // What remains.
        "a gap of 2.00\u{a0}% remains, and noise alone makes 1.00\u{a0}%",
        "35.0\u{a0}% of its power, noise included, repeats",
        "clearance at input:u1 comes nearest",
        // Axes in the units of the outputs.
        "y2, m",
        "error, rad/s",
        "density of y2, (m)²/Hz",
        // The shrink relative to another model, with its interval.
        "the bounded refit",
        "86.00",
        // The case, and how to repeat it.
        "file = &quot;a&amp;b.csv&quot;",
        "plid gap diagnose case.toml",
    ] {
        assert!(html.contains(text), "{text}");
    }
    assert!(!html.contains("<b>is it") && !html.contains("NaN") && !html.contains(">inf"), "{html}");
    // The gap, a trace, spectra, two maps, shares, level, responses twice, resonances, lines, the screen, the refit,
    // and the folded details.
    assert!(html.matches("<figure>").count() >= 16, "{}", html.matches("<figure>").count());
}

/// The curve of a law has the units of its port on its axes and, if the fit gives one, an interval.
#[test]
fn the_shape_of_a_law_is_drawn_with_its_units() {
    let case = case();
    let mut outcome = outcome(&case);
    let text = |outcome: &Outcome| page(outcome, &case).to_html();
    let html = text(&outcome);
    for said in [
        "Shape of cubic-stiffness at input:u1 (family: springs &amp; more)",
        ">displacement, mm<",
        ">force, N<",
        ">95 % interval<",
        "Band: 95 % interval",
    ] {
        assert!(html.contains(said), "{said}");
    }
    outcome.diagnosis.shapes[0] = Shape { ci95: None, unit: "displacement".into(), ..shape() };
    let bare = text(&outcome);
    assert!(bare.contains(">displacement<") && !bare.contains("Band: 95 % interval"));
    outcome.diagnosis.shapes.clear();
    assert!(!text(&outcome).contains("Shape of"));
}

/// The map of the remainder is beside its sentence, before the details.
#[test]
fn what_remains_has_a_section_with_its_picture() {
    let case = case();
    let mut outcome = outcome(&case);
    let section = |outcome: &Outcome| -> String {
        let html = page(outcome, &case).to_html();
        let (_, after) = html.split_once("3. What remains").unwrap();
        after.split_once("4. The evidence").unwrap().0.into()
    };
    let shown = section(&outcome);
    assert!(shown.contains("<svg") && shown.contains("remains with the effect, in excess"), "{shown}");
    assert!(!shown.contains("<details"), "{shown}");
    outcome.diagnosis.remainder = Remainder { gap: 0.01, ..remainder() };
    outcome.shown.after.share.fill(0.0);
    let nothing = section(&outcome);
    assert!(nothing.contains("Nothing remains beyond the noise") && !nothing.contains("<svg"), "{nothing}");
}

/// The figures of records that were held out are not those of records that nothing has seen, and the page says so
/// below the bars and below the table.
#[test]
fn the_use_of_the_records_is_stated_beside_the_figures() {
    let case = case();
    let mut outcome = outcome(&case);
    let count = |outcome: &Outcome, note: &str| page(outcome, &case).to_html().matches(note).count();
    assert_eq!(count(&outcome, "No fit used it, but the verdict did"), 2);
    outcome.diagnosis.gap.measured_on_fitted = true;
    assert_eq!(count(&outcome, "last.csv, which was fitted, because nothing could be held out"), 2);
    assert_eq!(count(&outcome, "No fit used it"), 0);
}

#[test]
fn the_text_states_what_the_page_states() {
    let diagnosis = diagnosis();
    let text = diagnosis.text();
    for line in [
        "With the best explanation, a gap of 2.00 % remains, and noise alone makes 1.00 %; beyond the noise, this is \
        0.19 % of the squared gap as given, mostly at y2 (70.0 %) and y<1> (30.0 %), at 10.0 to 12.0 Hz (80.0 %)",
        "On a further record at full level, a gap of 2.10 % is expected (80 % interval 1.80 % to 2.50 %).",
        "The gaps are those of last.csv. No fit used it, but the verdict did",
        "next: Record it at <twice> the level.",
    ] {
        assert!(text.lines().any(|said| said.starts_with(line)), "{line}\n{text}");
    }
}

#[test]
fn a_linear_refit_that_hides_the_gap_is_shown_as_such() {
    let case = case();
    let mut outcome = outcome(&case);
    let text = |outcome: &Outcome| page(outcome, &case).to_html();
    // If a parameter of the simulation is wrong, a refit is right to change it.
    assert!(!text(&outcome).contains("hides most"));
    outcome.diagnosis.effects[0].change = None;
    // A gap that falls from 0.4 to 0.15, with a noise floor of 0.01, shrinks by 63 %.
    let html = text(&outcome);
    assert!(html.contains("A linear refit hides most of this gap") && html.contains("nonlinear: such a model"));
    assert!(html.contains("(62.6\u{a0}% of the shrink that noise allows)"), "{html}");
    outcome.shown.linear = true;
    assert!(text(&outcome).contains("It would attribute the effect named above"));
    outcome.diagnosis.verdict = Verdict::Unknown;
    assert!(text(&outcome).contains("That does not make the cause linear"));
    (outcome.diagnosis.gap.refit, outcome.diagnosis.gap.free_refit) = (0.35, 0.3);
    assert!(!text(&outcome).contains("hides most"));
}

#[test]
fn a_reference_effect_is_shown_if_there_is_one() {
    let case = case();
    let mut outcome = outcome(&case);
    let text = |outcome: &Outcome| page(outcome, &case).to_html();
    assert!(!text(&outcome).contains("eference effect"));
    let reference = ShrinkOver { than: "reference effect".into(), ..outcome.diagnosis.gap.shrink_over[0].clone() };
    outcome.diagnosis.gap.shrink_over.push(reference);
    let html = text(&outcome);
    assert!(html.contains("reference effect with the bounded refit") && html.contains("is a wrong effect"));
    assert!(html.contains("shrink by a reference effect"));
}

#[test]
fn nothing_and_what_is_not_a_number_make_a_page_too() {
    let case = case();
    let mut outcome = outcome(&case);
    let diagnosis = &mut outcome.diagnosis;
    diagnosis.verdict = Verdict::None;
    diagnosis.sentence = "Nothing is missing.".into();
    diagnosis.effects.clear();
    diagnosis.evidence.clear();
    diagnosis.next_experiment = None;
    diagnosis.place.bands_hz.clear();
    let nan = f64::NAN;
    let gap = &mut diagnosis.gap;
    (gap.as_given, gap.refit, gap.free_refit, gap.with_effect, gap.noise_floor) = (nan, nan, f64::INFINITY, nan, nan);
    (gap.shrink, gap.shrink_ci95, gap.share_of_ceiling) = (nan, [nan, nan], nan);
    gap.shrink_over[0].ci95 = [nan, nan];
    let shown = &mut outcome.shown;
    shown.stages.clear();
    shown.stochastic.clear();
    shown.levels.clear();
    shown.refit = vec![(11.0, nan, nan, nan)];
    shown.costs = [nan; 3];
    shown.before.levels.clear();
    shown.before.slope = None;
    shown.before.share.fill(0.0);
    shown.evidence.resonances.clear();
    shown.evidence.lines.iter_mut().for_each(|lines| lines.outputs.iter_mut().for_each(Vec::clear));
    shown.trace = [vec![vec![nan; 40]; 2], vec![vec![0.0; 40]; 2], vec![vec![f64::INFINITY; 40]; 2]];
    for verdict in [Verdict::None, Verdict::Unknown, Verdict::Effects] {
        outcome.diagnosis.verdict = verdict;
        let html = page(&outcome, &case).to_html();
        assert!(html.contains("Nothing is missing.") && html.contains("gives no spectra"));
        // A gap may be called infinite, but no number is printed as `inf`.
        assert!(!html.contains("NaN") && !html.replace(">infinite", "").contains(">inf"), "{verdict:?}");
    }
}
