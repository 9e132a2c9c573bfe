//! The diagnosis step by step. Each step is a function of its own.
//!
//! `plid::gap::diagnose` runs all of them. Here a step can be left out, examined or replaced.
//!
//! ```sh
//! cargo run --release --example gap_steps               # on a case that is drawn: a stiffening spring in a beam
//! cargo run --release --example gap_steps -- CASE.toml
//! ```

use std::cell::OnceCell;
use std::path::Path;

use plid::gap::GapError;
use plid::gap::case::Case;
use plid::gap::effects::{Library, Names};
use plid::gap::research::{
    Base, Placed, Predicted, Prepared, REFIT_STEPS, Rules, audit, explain, gaps, locate, next_experiment, of_screen,
    prepare, refit, rivals, screen, stochastic_effects, weigh,
};
use plid::testbed::gap::{Channels, EffectSpec, GapSpec, PlantKind, draw};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let case = match std::env::args().nth(1) {
        Some(path) => Case::read(Path::new(&path))?,
        None => drawn()?,
    };
    Ok(steps(&case)?)
}

fn steps(case: &Case) -> Result<(), GapError> {
    let library = Library::standard();
    let mut silent = |_| {};

    // Audit: errors in the case are corrected where possible.
    let audit = audit(case, &library, &[], &mut silent)?;
    audit.case.warnings.iter().for_each(|warning| println!("audit: {warning}"));
    let model = audit.case.model.as_ref().ok_or_else(|| GapError::Failed("the audit gives a model".into()))?;

    // Plant and noise: the simulation in modal form, the noise, the held-out records.
    let mut ready = prepare(model, &audit.case.records, &audit.known)?;
    let names = ready.problem.setting.names.clone();
    println!(
        "{} modes; noise {:.4?} RMS; {} held out",
        ready.problem.plant.modes.len(),
        ready.noise.rms(),
        ready.held_out.len()
    );

    // Bounded refit of the simulation within its limits.
    let refitted = refit(&ready.problem, REFIT_STEPS);
    print_map(&ready, &refitted.eta);
    ready.renew_missing(&refitted.eta);
    let problem = &ready.problem;
    let rows = problem.rows() as f64;
    println!("after the bounded refit: {:.1} times the noise's power", refitted.cost / rows);

    // Screen: every effect at every location, and whether these records can separate the first two.
    let fit = refitted.as_fit();
    let jacobian = problem.jacobian(&refitted.plant);
    let base = Base {
        problem,
        jacobian: &jacobian,
        plant: &refitted.plant,
        eta: &fit.eta,
        effects: &[],
        residual: &fit.residual,
        bold: false,
        sized: false,
    };
    print_screen(&base, &library);

    // Search, and "is it enough?": fits of up to three effects, and whether they are sufficient.
    let rules = Rules { suspects: &[], exclude: &[], without: &[] };
    let found = explain(ready, refitted, &library, &rules, &[], &OnceCell::new(), &mut silent);
    let best = &found.found.best;
    for placed in &best.effects {
        let sizes: Vec<String> = placed.parameters.iter().map(|size| format!("{size:.4e}")).collect();
        println!("found: {}, {}", said(placed, &names), sizes.join(", "));
    }
    println!("something else is as likely as {:.2}", found.judged.unknown);

    // Effects that a free run cannot show.
    for noise in stochastic_effects(&found.ready, &library).iter().filter(|u| u.gain > 0.0) {
        println!("in quiet records: {} gains {:.0}", said(&noise.placed, &names), noise.gain);
    }
    let weighted =
        weigh(&found.found.candidates, found.judged.unknown, rows, found.level, &found.ready.problem.settings, &[]);

    // How much: the gap on held-out records.
    let problem = &found.ready.problem;
    let plant = problem.nuisance.apply(&problem.plant, &found.fit().eta);
    let actions = problem.actions(&found.fit().effects);
    let gaps = gaps(&found, &plant, &actions, &found.refitted.plant, &audit.case.config.nuisance);
    println!("held out: {:.2} % as given, {:.2} % with it", 100.0 * gaps.as_given, 100.0 * gaps.with_effect);

    // What next: the experiment that separates the remaining explanations.
    let predicted = Predicted::new(problem, found.fit());
    let rivals = rivals(&predicted, &best.effects, &found.found.candidates);
    println!(
        "next: {}",
        next_experiment(&found, &weighted, &best.effects, &predicted, &rivals).unwrap_or("nothing".into())
    );
    Ok(())
}

/// Prints where the gap of the simulation as given lies. `eta` contains the initial states of the refit.
fn print_map(ready: &Prepared, eta: &[f64]) {
    let problem = &ready.problem;
    let errors = locate::errors(ready, eta);
    let map = locate::map(&problem.records, &errors, &ready.noise, problem.plant.rate, &problem.settings);
    for (name, share) in problem.setting.names.outputs.iter().zip(&map.outputs) {
        println!("of the gap at {name}: {:.2} ({:.2} to {:.2})", share.value, share.ci95[0], share.ci95[1]);
    }
}

/// Prints the first entries of the screen, and whether the records can separate the first two.
fn print_screen<'a>(base: &Base<'_, 'a>, library: &'a Library) {
    let names = &base.problem.setting.names;
    let mut entries = screen(base, library, |_| false);
    entries.truncate(5);
    for entry in &entries {
        println!(
            "screen: {} gains {:.0}, {:.0} % absorbed",
            said(&entry.placed, names),
            entry.gain,
            100.0 * entry.absorbed
        );
    }
    if let Some(overlap) = of_screen(base, &entries) {
        println!("cosine of the first two: {:.3}", overlap.cosine[(0, 1)]);
    }
}

fn said(placed: &Placed, names: &Names) -> String {
    format!("{} at {}", placed.effect.name(), placed.place.location(names))
}

/// Draws a beam with two channels and a stiffening spring. The simulation lacks the spring and is slightly wrong.
fn drawn() -> Result<Case, Box<dyn std::error::Error>> {
    let spring = EffectSpec { kind: "cubic-stiffness".into(), at: None, law: None, gap: 0.1 };
    let spec = GapSpec {
        effects: vec![spring],
        perturbed: true,
        plant: PlantKind::Beam,
        channels: Channels { inputs: 2, outputs: 2 },
        length: 0.4,
        ..GapSpec::default()
    };
    let folder = tempfile::tempdir()?;
    draw(1, &spec)?.write(&folder.path().join("case"), &folder.path().join("label"))?;
    Ok(Case::read(&folder.path().join("case/case.toml"))?)
}
