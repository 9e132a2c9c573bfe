//! Diagnoses a folder of labelled cases, so that a scorer can compare the answers with the labels.
//!
//! ```sh
//! cargo run --release -p plid-gap --example diagnose_cases -- [--leave-out] [--verbose] OUT LABELS CASE-FOLDER...
//! ```
//!
//! Each CASE-FOLDER holds a case.toml. OUT/NAME gets the diagnosis and predicted.csv, the prediction for LABELS/NAME/test_u.csv. With
//! `--leave-out` each case is diagnosed without the effects that its label.json names: what is not in the vocabulary must be kept open.
//! `--verbose` tells every stage of the search.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use plid_gap::case::{Case, columns};
use plid_gap::effects::Library;
use plid_gap::predict::Predictor;
use plid_lab::data::{MissingPolicy, channels, read};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let leave_out = arguments.iter().any(|argument| argument == "--leave-out");
    let verbose = arguments.iter().any(|argument| argument == "--verbose");
    arguments.retain(|argument| !argument.starts_with("--"));
    let [out, labels, folders @ ..] = arguments.as_slice() else {
        return Err("usage: diagnose_cases [--leave-out] OUT LABELS CASE-FOLDER...".into());
    };
    for folder in folders {
        let clock = Instant::now();
        let folder = Path::new(folder);
        let name = folder.file_name().ok_or("a case folder has a name")?;
        let label = Path::new(labels).join(name);
        let library = if leave_out { without_truth(&label)? } else { Library::standard() };
        let case = Case::read(&folder.join("case.toml"))?;
        let outcome = plid_gap::diagnose(&case, &library, &mut |stage| {
            if verbose {
                println!("    {stage}");
            }
        })?;
        let to = Path::new(out).join(name);
        std::fs::create_dir_all(&to)?;
        plid_gap::write(&outcome, &case, &to)?;
        predict(&to, &label)?;
        let judged = outcome.evidence.adequacy;
        println!("{} {:.1} s: {}", name.display(), clock.elapsed().as_secs_f64(), outcome.diagnosis.sentence);
        println!("    squared residual over noise: {:.4?} (as given, refit, with effects)", outcome.evidence.costs);
        println!(
            "    something else: {:.2} (excess {:.1}, bent {:.1}, next {:.0})",
            judged.unknown, judged.excess, judged.bent, judged.next
        );
    }
    Ok(())
}

fn without_truth(label: &Path) -> Result<Library, Box<dyn Error>> {
    let label: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(label.join("label.json"))?)?;
    let effects = label["effects"].as_array().ok_or("a label names its effects")?;
    let names: Vec<String> = effects.iter().filter_map(|e| e["effect"].as_str()).map(String::from).collect();
    Ok(Library::standard().without(&names))
}

fn predict(to: &Path, label: &Path) -> Result<(), Box<dyn Error>> {
    let predictor = Predictor::read(&to.join("sim-with-effect.json"), &Library::standard())?;
    let table = read(&label.join("test_u.csv"), None)?;
    let u = columns(&channels(&table, &predictor.model.inputs, MissingPolicy::Error)?);
    let y = predictor.run(&u, predictor.t0);
    let mut text = format!("{}\n", predictor.model.outputs.join(","));
    for k in 0..y[0].len() {
        let row: Vec<String> = y.iter().map(|y| y[k].to_string()).collect();
        text += &format!("{}\n", row.join(","));
    }
    std::fs::write(to.join("predicted.csv"), text)?;
    Ok(())
}
