//! Diagnoses of a nonlinear arm. The true forces are inside the equations of motion.

use plid_simulator::{Motion, SimulatorError};

use super::*;
use crate::answer::schema::Bound;
use crate::case::SimulatorConfig;
use crate::effects::Side;
use crate::judge::gap::Blocks;
use crate::judge::verdict::Verdict;
use crate::testing::arm::{Arm, Extra, NOMINAL, Numbers, case, nothing};

fn same(u: &[f64]) -> Vec<f64> {
    u.to_vec()
}

fn as_it_is(_: &mut Channels) {}

fn diagnosed(case: &Case) -> LoopOutcome {
    let mut say = |text: String| {
        if std::env::var_os("SAY").is_some() {
            eprintln!("{text}");
        }
    };
    let outcome = diagnose_in_loop(case, &mut Arm::new(), &Library::standard(), &mut say).unwrap();
    eprintln!("{}", outcome.diagnosis.text());
    outcome
}

/// Returns the first effect of a diagnosis and its place.
fn first(outcome: &LoopOutcome) -> (&str, &str) {
    outcome.diagnosis.effects.first().map_or(("", ""), |effect| (effect.effect.as_str(), effect.location.as_str()))
}

fn inside(extra: Extra) -> LoopOutcome {
    diagnosed(&case(&NOMINAL, extra, same, as_it_is))
}

#[test]
fn forces_inside_are_named_at_their_port() {
    let friction = inside(|x, _, _| [-0.1 * (x[2] / 0.1).tanh(), 0.0, 0.0]);
    assert_eq!(first(&friction), ("coulomb-friction", "input:torque"));
    let stiffening = inside(|x, _, _| [0.0, -6.0 * x[1].powi(3), 0.0]);
    assert_eq!(first(&stiffening), ("cubic-stiffness", "port:link"));
    let stop = inside(|x, _, _| {
        let beyond: f64 = x[1].abs() - 0.3;
        [
            0.0,
            if beyond > 0.0 { -(400.0 * beyond + 1.0 * x[3] * x[1].signum()).max(0.0) * x[1].signum() } else { 0.0 },
            0.0,
        ]
    });
    assert_eq!(first(&stop), ("end-stop", "port:link"));
}

#[test]
fn what_wraps_around_the_simulator_is_named() {
    let saturated =
        diagnosed(&case(&NOMINAL, nothing, |u| u.iter().map(|u| 1.2 * (u / 1.2).tanh()).collect(), as_it_is));
    assert_eq!(first(&saturated), ("actuator-saturation", "input:torque"));
    let late = diagnosed(&case(&NOMINAL, nothing, same, |y| {
        y[1].rotate_right(2);
        y[1][..2].fill(0.0);
    }));
    assert_eq!(first(&late), ("sensor-delay", "output:link"));
    let lag = diagnosed(&case(
        &NOMINAL,
        nothing,
        |u| {
            let mut slow = 0.0;
            let one = |u: &f64| {
                slow += (1.0 - (-std::f64::consts::TAU * 6.0 / 200.0_f64).exp()) * (u - slow);
                slow
            };
            u.iter().map(one).collect()
        },
        as_it_is,
    ));
    assert!(["actuator-lag", "actuator-delay"].contains(&first(&lag).0), "{}", lag.diagnosis.sentence);
}

/// An offset lies at a single frequency.
#[test]
fn an_offset_is_named() {
    let offset = diagnosed(&case(&NOMINAL, nothing, same, |y| y[1].iter_mut().for_each(|y| *y += 0.02)));
    assert_eq!(first(&offset), ("sensor-offset", "output:link"));
}

#[test]
fn a_parameter_of_the_simulator_is_named_with_its_value() {
    let numbers = Numbers { damper: 1.4 * NOMINAL.damper, ..NOMINAL };
    let outcome = diagnosed(&case(&numbers, nothing, same, as_it_is));
    assert_eq!(first(&outcome), ("simulator-parameter", "parameter:motor damper"));
    let change = outcome.diagnosis.effects[0].change.as_ref().unwrap();
    let [low, high] = change.to.ci95.unwrap();
    assert!(low < numbers.damper && numbers.damper < high, "{change}");
}

#[test]
fn nothing_is_named_where_nothing_is_missing() {
    let outcome = diagnosed(&case(&NOMINAL, nothing, same, as_it_is));
    assert_eq!(outcome.diagnosis.verdict, Verdict::None, "{}", outcome.diagnosis.sentence);
}

#[test]
fn what_the_vocabulary_lacks_is_kept_open() {
    // A spring between motor and link is lost in one direction of the motor's motion.
    let outcome = inside(|x, _, _| {
        let lost = if x[2] > 0.0 { 20.0 * (x[0] - x[1]) } else { 0.0 };
        [lost, -lost, 0.0]
    });
    assert_ne!(outcome.diagnosis.verdict, Verdict::None);
    assert!(outcome.diagnosis.effects.iter().all(|effect| effect.confidence < 0.9), "{}", outcome.diagnosis.sentence);
}

/// Returns the error of a changed case with the arm as the simulator.
fn refused(change: fn(&mut Case)) -> String {
    let mut case = case(&NOMINAL, nothing, same, as_it_is);
    change(&mut case);
    diagnose_in_loop(&case, &mut Arm::new(), &Library::standard(), &mut |_| {}).err().unwrap().to_string()
}

#[test]
fn what_does_not_fit_the_simulator_is_refused() {
    let names = refused(|case| case.config.outputs[1] = "lnik".into());
    assert!(names.contains("outputs") && names.contains("lnik") && names.contains("link"), "{names}");
    let rate = refused(|case| case.config.sample_rate_hz = 100.0);
    assert!(rate.contains("sample_rate_hz") && rate.contains("200"), "{rate}");
    let moving = refused(|case| case.records[1].from_rest = false);
    assert!(moving.contains("r1") && moving.contains("begins at rest"), "{moving}");
    let excluded = refused(|case| case.config.exclude = vec!["parameter:motor dampr".into()]);
    assert!(excluded.contains("did you mean `parameter:motor damper`"), "{excluded}");
    let limit = refused(|case| {
        let limits = [("sprnig".to_string(), 1.0)].into();
        let command = vec!["arm".into()];
        case.config.simulator = Some(SimulatorConfig { command, limits, ..SimulatorConfig::default() });
    });
    assert!(limit.contains("no parameter `sprnig`; did you mean `spring`"), "{limit}");
}

/// A parameter within its limit is not a cause; the same error without a limit is one.
#[test]
fn a_parameter_within_its_limit_is_no_cause() {
    let numbers = Numbers { damper: 1.08 * NOMINAL.damper, ..NOMINAL };
    let mut limited = case(&numbers, nothing, same, as_it_is);
    let open = diagnosed(&limited);
    assert_eq!(first(&open).0, "simulator-parameter", "{}", open.diagnosis.sentence);
    let limits = [("motor damper".to_string(), 0.2 * NOMINAL.damper)].into();
    let command = vec!["arm".into()];
    limited.config.simulator = Some(SimulatorConfig { command, limits, ..SimulatorConfig::default() });
    let closed = diagnosed(&limited);
    assert_eq!(closed.diagnosis.verdict, Verdict::None, "{}", closed.diagnosis.sentence);
    // The limit belongs to the case and is not known to the simulator that predicts.
    let library = Library::standard();
    let predictor = LoopPredictor::new(closed.simulation, &library).unwrap();
    predictor.predict(&mut Arm::new(), &limited.records[0].u, 0.0).unwrap();
    let [from, to, z] = closed.diagnosis.refit["parameter:motor damper"];
    assert!((to / numbers.damper - 1.0).abs() < 0.02 && from == NOMINAL.damper && z < 1.0, "{to}, {z}");
}

/// Runs in parallel change neither the answer nor the number of runs.
#[test]
fn runs_side_by_side_give_the_same_answer() {
    let answers = [1, 2].map(|count| {
        let mut case = case(&NOMINAL, |x, _, _| [0.0, -6.0 * x[1].powi(3), 0.0], same, as_it_is);
        case.config.settings.in_loop.side_by_side = count;
        let LoopOutcome { mut diagnosis, simulation, .. } = diagnosed(&case);
        diagnosis.simulator.seconds = 0.0;
        diagnosis.settings.in_loop.side_by_side = 1;
        (serde_json::to_string(&diagnosis).unwrap(), serde_json::to_string(&simulation).unwrap())
    });
    assert_eq!(answers[0], answers[1]);
}

/// A bound on the runs is kept, and the answer states what was left out because of it.
#[test]
fn a_bound_on_the_runs_is_kept() {
    let mut case = case(&NOMINAL, |x, _, _| [-0.1 * (x[2] / 0.1).tanh(), 0.0, 0.0], same, as_it_is);
    for calls in [60, 120] {
        case.config.settings.in_loop.calls = calls;
        let outcome = diagnosed(&case);
        let used = &outcome.diagnosis.simulator;
        assert!(used.runs > calls / 2 && used.runs <= calls, "{} runs of {calls}", used.runs);
        assert!(used.cut_short && used.ended_by == Some(Bound::Calls) && !used.left_out.is_empty(), "{used:?}");
        let warning = outcome.diagnosis.warnings.last().unwrap();
        let said = format!("The bound on the runs (`calls` = {calls}) ended the search early. Left out: ");
        assert!(warning.starts_with(&said) && warning.contains(&used.left_out[0]), "{warning}");
        assert!(outcome.diagnosis.text().contains(&format!("(`calls` = {calls})")), "{}", outcome.diagnosis.text());
        let folder = tempfile::tempdir().unwrap();
        report::write(&outcome, &case, folder.path()).unwrap();
        let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
        assert!(page.contains(used.left_out.last().unwrap()), "{:?}", used.left_out);
    }
}

/// An arm whose runs take a while.
struct Slow(Arm);

impl Simulator for Slow {
    fn description(&self) -> &Description {
        self.0.description()
    }

    fn start(&mut self, parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
        std::thread::sleep(std::time::Duration::from_millis(15));
        self.0.start(parameters)
    }

    fn step(&mut self, u: &[f64], forces: &[f64], y: &mut [f64], at: &mut [Motion]) -> Result<(), SimulatorError> {
        self.0.step(u, forces, y, at)
    }
}

/// A bound on the time of the runs is kept, too.
#[test]
fn a_bound_on_the_time_is_kept() {
    let mut case = case(&NOMINAL, |x, _, _| [-0.1 * (x[2] / 0.1).tanh(), 0.0, 0.0], same, as_it_is);
    case.config.settings.in_loop.seconds = 2.0;
    let outcome = diagnose_in_loop(&case, &mut Slow(Arm::new()), &Library::standard(), &mut |_| {}).unwrap();
    let used = &outcome.diagnosis.simulator;
    assert!(used.cut_short && used.ended_by == Some(Bound::Seconds), "{used:?}");
    // The time of a run is only estimated.
    assert!(used.seconds > 1.0 && used.seconds < 2.5, "{} s", used.seconds);
    let warning = outcome.diagnosis.warnings.last().unwrap();
    assert!(warning.starts_with("The bound on the time in the simulator (`seconds` = 2) ended"), "{warning}");
}

/// A search that no bound ends leaves nothing out.
#[test]
fn a_search_within_its_bounds_leaves_nothing_out() {
    let outcome = inside(|x, _, _| [0.0, -6.0 * x[1].powi(3), 0.0]);
    let used = &outcome.diagnosis.simulator;
    assert!(!used.cut_short && used.ended_by.is_none() && used.left_out.is_empty(), "{used:?}");
    assert!(!outcome.diagnosis.warnings.iter().any(|warning| warning.contains("ended the search early")));
    let json = serde_json::to_value(used).unwrap();
    assert!(json.get("ended_by").is_none() && json.get("left_out").is_none(), "{json}");
}

/// A lighter link and friction at the motor: the effect that explains most on its own is neither, but their traces
/// explain the gap together.
#[test]
fn two_causes_are_found_together() {
    let truth = Numbers { link: 0.75 * NOMINAL.link, ..NOMINAL };
    let outcome = diagnosed(&case(&truth, |x, _, _| [-0.1 * (x[2] / 0.1).tanh(), 0.0, 0.0], same, as_it_is));
    let named = outcome.diagnosis.effects.iter().map(|effect| (effect.effect.as_str(), effect.location.as_str()));
    let mut named: Vec<_> = named.collect();
    named.sort_unstable();
    let both = [("coulomb-friction", "input:torque"), ("simulator-parameter", "parameter:link inertia")];
    assert_eq!(named, both, "{}", outcome.diagnosis.sentence);
}

/// Beyond the inputs and the motion of the fitted records, the expected gap grows, and the signal that exceeds them
/// is named.
#[test]
fn the_expected_gap_grows_beyond_what_was_fitted() {
    let case = case(&NOMINAL, |x, _, _| [0.0, -6.0 * x[1].powi(3), 0.0], same, as_it_is);
    let outcome = diagnosed(&case);
    let loud = &case.records[1].u[0];
    let library = Library::standard();
    let predictor = LoopPredictor::new(outcome.simulation.clone(), &library).unwrap();
    let predicted = |predictor: &LoopPredictor, level: f64| {
        let u = vec![loud.iter().map(|u| level * u).collect::<Vec<f64>>()];
        let mut arm = Arm::new();
        let prediction = predictor.predict(&mut arm, &u, 0.0).unwrap();
        let gap = predictor.expected_gap(&prediction).unwrap();
        (gap, prediction.beyond, arm.runs)
    };
    let (within, beyond, runs) = predicted(&predictor, 0.9);
    let beyond = beyond.unwrap();
    assert!(!beyond.is_clear() && beyond.warning().is_none() && runs == 1, "{beyond:?}, {runs} runs");
    let stated = outcome.diagnosis.gap.predicted_held_out_gap;
    assert!((within / stated - 1.0).abs() < 0.3, "{within}, stated {stated}");
    let mut before = within;
    for level in [1.3, 1.7, 2.2] {
        let (gap, beyond, _) = predicted(&predictor, level);
        let beyond = beyond.unwrap();
        assert!(gap > 1.2 * before && beyond.times > 0.9 * level, "{gap} after {before}: {beyond:?}");
        let warning = beyond.warning().unwrap();
        assert!(warning.contains("input `torque`") || warning.contains("motion at `"), "{warning}");
        before = gap;
    }
    // A motion beyond that of the records counts even if the input does not exceed theirs.
    let mut still = outcome.simulation.clone();
    let peaks = &mut still.fitted.as_mut().unwrap().displacement_peak;
    assert!(peaks.len() == 2 && peaks.iter().all(|peak| *peak > 0.0), "{peaks:?}");
    peaks.iter_mut().for_each(|peak| *peak *= 0.25);
    let beyond = predicted(&LoopPredictor::new(still, &library).unwrap(), 0.9).1.unwrap();
    assert!(beyond.what.starts_with("motion at `") && beyond.times > 2.0, "{beyond:?}");
    // A file of an earlier version has no range.
    let old = LoopPredictor::new(SimulatorWithEffects { fitted: None, ..outcome.simulation }, &library).unwrap();
    assert_eq!([1.0, 8.0].map(|level| predicted(&old, level).0), [stated; 2]);
}

/// A range that was edited by hand is refused with its key.
#[test]
fn a_range_that_is_impossible_is_refused() {
    let case = case(&NOMINAL, nothing, same, as_it_is);
    let good = diagnosed(&case).simulation;
    let refused = |change: fn(&mut SimulatorWithEffects)| {
        let mut bad = good.clone();
        change(&mut bad);
        LoopPredictor::new(bad, &Library::standard()).err().unwrap()
    };
    let short = refused(|bad| bad.fitted.as_mut().unwrap().displacement_peak.truncate(1));
    assert!(short.contains("`fitted.displacement_peak` must contain 2"), "{short}");
    let negative = refused(|bad| bad.fitted.as_mut().unwrap().unexplained = -1.0);
    assert!(negative.contains("`fitted.unexplained`"), "{negative}");
    let noise = refused(|bad| bad.noise_rms.clear());
    assert!(noise.contains("`noise_rms`"), "{noise}");
}

/// The written files predict the response to a new input, with the effects and the parameters.
#[test]
fn the_answer_predicts_what_it_has_not_seen() {
    let damped = case(&Numbers { damper: 1.4 * NOMINAL.damper, ..NOMINAL }, nothing, same, as_it_is);
    let stiffening = case(&NOMINAL, |x, _, _| [0.0, -6.0 * x[1].powi(3), 0.0], same, as_it_is);
    for case in [damped, stiffening] {
        let outcome = diagnosed(&case);
        let folder = tempfile::tempdir().unwrap();
        report::write(&outcome, &case, folder.path()).unwrap();
        let library = Library::standard();
        let predictor = LoopPredictor::read(&folder.path().join("sim-with-effect.json"), &library).unwrap();
        let fresh = &case.records[2];
        let y = predictor.predict(&mut Arm::new(), &fresh.u, fresh.start_s).unwrap();
        let gap = Blocks::new(&fresh.y, &y.outputs, 0).gap();
        assert!(gap < 1.5 * outcome.diagnosis.gap.noise_floor, "{gap}");
        assert!(std::fs::read_to_string(folder.path().join("report.html")).unwrap().contains("<svg"));
        // A different simulator is refused.
        let output = plid_simulator::Output::new("y");
        let description = Description::new("other", 200.0, Vec::new(), vec![output]);
        let mut other = plid_simulator::Function::new(description, |_: &[f64], _: &[Vec<f64>]| Ok(Vec::new()));
        let message = predictor.predict(&mut other, &fresh.u, 0.0).unwrap_err().to_string();
        assert!(message.contains("other inputs"), "{message}");
    }
}

/// Diagnoses a case with these effects alone, and with no parameter of the simulator as a cause.
fn diagnosed_among(mut case: Case, effects: &[&str]) -> LoopOutcome {
    case.config.exclude = vec!["simulator-parameter".into()];
    let library = Library::standard().only(effects);
    let outcome = diagnose_in_loop(&case, &mut Arm::new(), &library, &mut |_| {}).unwrap();
    eprintln!("{}{:?}", outcome.diagnosis.text(), outcome.diagnosis.place);
    outcome
}

/// Returns a case in which the sensor of the motor has these gains in the three driven records.
fn with_gains(gains: [f64; 3]) -> Case {
    let mut case = case(&NOMINAL, nothing, same, as_it_is);
    for (record, gain) in case.records.iter_mut().zip(gains) {
        record.y[0].iter_mut().for_each(|y| *y *= gain);
    }
    case
}

/// Two fitted records at one level have different gains. A fit to both leaves half of what is left if each is predicted
/// by a fit to the other. Without runs for that, the gap of the fit is stated, with a wider interval.
#[test]
fn the_stated_gap_is_that_of_records_predicted_from_others() {
    let mut case = with_gains([1.2, 1.16, 1.24]);
    case.records[0].held_out = true;
    let mut stated = |calls: usize| {
        case.config.settings.in_loop.crossed_calls = calls;
        let LoopDiagnosis { gap, candidates, evidence, verdict, .. } =
            diagnosed_among(case.clone(), &["sensor-gain"]).diagnosis;
        assert_eq!(verdict, Verdict::Effects);
        (gap.predicted_held_out_gap / candidates[0].gap_after.unwrap(), gap.predicted_ci80, evidence.join(" "))
    };
    let (crossed, _, said) = stated(100);
    assert!(crossed > 1.6 && crossed < 2.2 && said.contains("a fit to the others"), "{crossed}: {said}");
    let (own, [low, high], said) = stated(0);
    assert!(own < 1.1 && high / low > 1.6 && said.contains("`crossed_calls` = 0"), "{own} {low} {high}: {said}");
}

/// A gain that the held-out record does not have is not written, and nothing is named.
#[test]
fn what_predicts_the_held_out_record_worse_is_not_written() {
    let LoopOutcome { diagnosis, simulation, .. } = diagnosed_among(with_gains([1.2, 1.2, 1.0]), &["sensor-gain"]);
    assert!(diagnosis.verdict == Verdict::Unknown && diagnosis.effects.is_empty(), "{}", diagnosis.sentence);
    assert!(diagnosis.candidates[0].unknown && diagnosis.candidates[0].probability >= 0.6);
    assert!((diagnosis.candidates.iter().map(|c| c.probability).sum::<f64>() - 1.0).abs() < 1e-9);
    assert!(simulation.effects.is_empty());
    assert!(diagnosis.gap.with_effect > 2.0 * diagnosis.gap.as_given && simulation.expected_gap > 0.1);
    assert!(diagnosis.evidence[0].contains("not written"), "{:?}", diagnosis.evidence);
    // The same gain in all records is named, and its share has an interval.
    let LoopOutcome { diagnosis, simulation, .. } = diagnosed_among(with_gains([1.2; 3]), &["sensor-gain"]);
    assert!(simulation.effects.len() == 1, "{}", diagnosis.sentence);
    let (share, [low, high]) = (diagnosis.effects[0].share.unwrap(), diagnosis.effects[0].share_ci95.unwrap());
    assert!(low <= share && share <= high && high > low && share > 0.9, "{share}: {low} to {high}");
}

/// The part of the signal path follows from the residual, whatever effects may be named.
#[test]
fn the_part_of_the_signal_path_needs_no_right_name() {
    let side = |case: Case, effect: &str| {
        let place = diagnosed_among(case, &[effect]).diagnosis.place;
        (place.side, place.places.first().map(|place| place.place.clone()))
    };
    let sensor = case(&NOMINAL, nothing, same, |y| y[1].iter_mut().for_each(|y| *y = 0.3 * (*y / 0.3).tanh()));
    assert_eq!(side(sensor, "actuator-gain"), (Some(Side::Sensor), Some("output:link".into())));
    let actuator = case(&NOMINAL, nothing, |u| u.iter().map(|u| 1.2 * (u / 1.2).tanh()).collect(), as_it_is);
    assert_eq!(side(actuator, "sensor-gain"), (Some(Side::Actuator), Some("input:torque".into())));
    let joint = case(&NOMINAL, |x, _, _| [0.0, -6.0 * x[1].powi(3), 0.0], same, as_it_is);
    assert_eq!(side(joint, "sensor-gain"), (Some(Side::Structure), Some("port:link".into())));
}
