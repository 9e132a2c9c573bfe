use std::path::PathBuf;

use plid::gap::case::Case;
use plid::gap::effects::Library;
use plid::gap::{diagnose, write};

use super::{Failure, Voice, directory, progress::Spinner, voice};

/// Diagnose the gap between records and a simulation.
///
/// CASE.toml names the simulation (a model.json) and the records. Writes DIR/diagnosis.json (the answer),
/// DIR/sim-with-effect.json (the simulation with what was found, which `plid gap predict` uses) and DIR/report.html.
#[derive(clap::Args)]
#[command(
    after_help = "Example of a case:\n  sim = \"sim.json\"\n  sample_rate_hz = 1600.0\n  inputs = [\"u1\", \"u2\"]\n  outputs = [\"y1\", \"y2\"]\n\n  [[record]]\n  file = \"quiet.csv\"\n  excitation = \"zero\"\n\n  [[record]]\n  file = \"random.csv\"\n  excitation = \"random\""
)]
pub struct Arguments {
    /// The case.
    #[arg(value_name = "CASE.toml")]
    case: PathBuf,
    /// Where the records' files are; beside the case if left out.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Where the results go; out/CASE if left out.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write into a directory that is not empty.
    #[arg(long)]
    force: bool,
    /// Leave an effect out of the vocabulary; may be given several times. What the diagnosis says then is what it would say of an
    /// effect that it does not know.
    #[arg(long, value_name = "EFFECT")]
    without: Vec<String>,
}

/// Runs the command.
pub fn execute(arguments: Arguments, voice: Voice) -> Result<(), Failure> {
    let library = Library::standard();
    if let Some(name) = arguments.without.iter().find(|name| library.get(name).is_none()) {
        let known: Vec<&str> = library.effects().map(|effect| effect.name()).collect();
        return Err(Failure::input(format!("--without {name}: the vocabulary is {}", known.join(", "))));
    }
    let library = library.without(&arguments.without);
    let stem = arguments.case.file_stem().map_or_else(|| "case".into(), |stem| stem.to_string_lossy().into_owned());
    let out = arguments.out.clone().unwrap_or_else(|| directory::default_for(&stem));
    directory::check(&out, arguments.force)?;
    let outcome = directory::with(&out, || {
        let case = match &arguments.data {
            Some(data) => Case::read_with(&arguments.case, data)?,
            None => Case::read(&arguments.case)?,
        };
        let spinner = Spinner::new(voice.quiet || voice.json);
        let outcome = diagnose(&case, &library, &mut |stage| spinner.say(&stage));
        spinner.finish();
        let outcome = outcome?;
        write(&outcome, &case, &out)?;
        Ok(outcome)
    })?;
    if voice.json {
        let text = serde_json::to_string_pretty(&outcome.diagnosis).expect("a diagnosis is JSON by construction");
        return voice::print(&format!("{text}\n"));
    }
    if voice.quiet {
        return Ok(());
    }
    let mut text = format!("{}\n", outcome.diagnosis.sentence);
    for effect in &outcome.diagnosis.effects {
        for (name, value) in &effect.parameters {
            let interval = value.ci95.map(|[a, b]| format!(" ({a:.4e} to {b:.4e})")).unwrap_or_default();
            text += &format!(
                "  {} at {}: {name} = {:.5e} {}{interval}\n",
                effect.effect, effect.location, value.value, value.unit
            );
        }
    }
    if let Some(next) = &outcome.diagnosis.next_experiment {
        text += &format!("next: {next}\n");
    }
    text += &format!("report: {}\n", out.join("report.html").display());
    voice::print(&text)
}
