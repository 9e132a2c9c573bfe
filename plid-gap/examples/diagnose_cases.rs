//! Diagnoses a folder of labelled cases for a scorer to compare the answers with the labels.
//!
//! ```sh
//! cargo run --release -p plid-gap --example diagnose_cases -- [--leave-out] [--as-simulator] [--verbose] OUT LABELS \
//!     CASE-FOLDER...
//! ```
//!
//! Each CASE-FOLDER contains a case.toml. OUT/NAME gets the diagnosis and predicted.csv, the prediction for
//! LABELS/NAME/test_u.csv. With `--leave-out` each case is diagnosed a second time, without the effects that its
//! label.json names, into OUT/NAME/left-out: a cause outside the vocabulary must be kept open. With `--as-simulator`
//! the model of each case is hidden behind a simulator that only takes steps. `--verbose` prints every stage of the
//! search.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use ndarray::Array2;
use plid_data::{MissingPolicy, channels, read, to_csv};
use plid_gap::answer::predict::Predictor;
use plid_gap::case::{Case, columns};
use plid_gap::effects::Library;
use plid_gap::in_loop::{self, Answered};
use plid_gap::{Groundwork, Outcome};
use plid_simulator::Linear;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let leave_out = arguments.iter().any(|argument| argument == "--leave-out");
    let verbose = arguments.iter().any(|argument| argument == "--verbose");
    let as_simulator = arguments.iter().any(|argument| argument == "--as-simulator");
    arguments.retain(|argument| !argument.starts_with("--"));
    let [out, labels, folders @ ..] = arguments.as_slice() else {
        return Err("usage: diagnose_cases [--leave-out] [--as-simulator] OUT LABELS CASE-FOLDER...".into());
    };
    for folder in folders {
        let clock = Instant::now();
        let folder = Path::new(folder);
        let name = folder.file_name().ok_or("a case folder has a name")?;
        let label = Path::new(labels).join(name);
        let library = Library::standard();
        let case = Case::read(&folder.join("case.toml"))?;
        let mut say = |stage: String| {
            if verbose {
                println!("    {:.1} s: {stage}", clock.elapsed().as_secs_f64());
            }
        };
        if as_simulator {
            let (outcome, case) = by_simulator(&case, &library, &mut say)?;
            told(&outcome, &case, &label, &Path::new(out).join(name), clock)?;
            continue;
        }
        let (outcome, ground) = Groundwork::whole(&case, &library, &[], &mut say)?;
        let to = Path::new(out).join(name);
        told(&outcome, &case, &label, &to, clock)?;
        if leave_out {
            let clock = Instant::now();
            let outcome = ground.leave_out(&true_effects(&label)?, &mut say)?;
            told(&outcome, &case, &label, &to.join("left-out"), clock)?;
        }
    }
    Ok(())
}

/// Diagnoses a case whose model is a simulator.
fn by_simulator(
    case: &Case,
    library: &Library,
    say: &mut dyn FnMut(String),
) -> Result<(Outcome, Case), Box<dyn Error>> {
    let model = case.model.as_ref().ok_or("a case has a model")?;
    let mut simulator = Linear::new(model, "model", 1)?;
    let case = Case { model: None, ..case.clone() };
    match in_loop::diagnose(&case, &mut simulator, library, say)? {
        Answered::ByModel(found) => Ok(*found),
        Answered::InLoop(_) => Err("the simulator was not found to be linear".into()),
    }
}

/// Writes an answer with its prediction, and prints it.
fn told(outcome: &Outcome, case: &Case, label: &Path, to: &Path, clock: Instant) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(to)?;
    plid_gap::write(outcome, case, to)?;
    predict(to, label)?;
    let judged = outcome.shown.adequacy;
    println!("{} {:.1} s: {}", to.display(), clock.elapsed().as_secs_f64(), outcome.diagnosis.sentence);
    println!("    squared residual over noise: {:.4?} (as given, refit, with effects)", outcome.shown.costs);
    let gap = &outcome.diagnosis.gap;
    println!(
        "    gaps: given {:.4} refit {:.4} limits {:.4} free {:.4} with {:.4} floor {:.4} left {:.3} stated {:.4}",
        gap.as_given,
        gap.refit,
        gap.within_limits,
        gap.free_refit,
        gap.with_effect,
        gap.noise_floor,
        gap.left(),
        gap.predicted_held_out_gap
    );
    println!(
        "    something else: {:.2} (excess {:.1}, prior z {:.1}, next {:.0})",
        judged.unknown, judged.excess, judged.max_prior_z, judged.next_gain
    );
    Ok(())
}

/// Returns the effects that a label names.
fn true_effects(label: &Path) -> Result<Vec<String>, Box<dyn Error>> {
    let label: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(label.join("label.json"))?)?;
    let effects = label["effects"].as_array().ok_or("a label names its effects")?;
    Ok(effects.iter().filter_map(|e| e["effect"].as_str()).map(String::from).collect())
}

fn predict(to: &Path, label: &Path) -> Result<(), Box<dyn Error>> {
    let predictor = Predictor::read(&to.join("sim-with-effect.json"), &Library::standard())?;
    let table = read(&label.join("test_u.csv"), None)?;
    let u = columns(&channels(&table, &predictor.inputs, MissingPolicy::Error)?);
    let y = predictor.run(&u, predictor.t0);
    let values = Array2::from_shape_fn((y[0].len(), y.len()), |(k, o)| y[o][k]);
    std::fs::write(to.join("predicted.csv"), to_csv(&predictor.model.outputs, &values))?;
    Ok(())
}
