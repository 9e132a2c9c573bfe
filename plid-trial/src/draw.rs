//! Draws the cases into one directory, and their sealed truths into another.

use plid_file::sha256;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use plid_testbed::gap::{self, EffectSpec, GapCase, GapError, GapSpec, Label};
use plid_work::Progress;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use rayon::prelude::*;

use crate::config::TrialConfig;
use crate::error::TrialError;
use crate::files;
use crate::manifest::{DrawnCase, FORMAT, MANIFEST, Manifest, OpenCase, SEAL, SEAL_FORMAT, SEALED, Seal};
use crate::plan::{Planned, plan};
use crate::program::Program;
use crate::seal::{derived, salt, salted};

/// The extent of a draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Drawn {
    /// Number of cases.
    pub cases: usize,
    /// Number of draws that were repeated.
    pub repeated: usize,
}

/// Largest number of attempts to draw a case. Each draws other parameters of the plant and other strengths.
const ATTEMPTS: usize = 60;

/// Number of attempts after which a case is drawn on another kind of plant: on some, an effect is too small at any
/// strength.
const ON_ONE_PLANT: usize = 15;

/// Error of a gain, or share of another channel, that the stated limits of a shape allow.
const SHAPE: f64 = 0.02;

/// Draws the cases of a trial. The same config and seed give the same bytes.
///
/// # Errors
/// Returns an error if an effect cannot be drawn as strong as asked for, or a file cannot be written.
pub fn draw(
    config: &TrialConfig,
    seed: u64,
    trial: &Path,
    sealed: &Path,
    progress: &dyn Progress,
) -> Result<Drawn, TrialError> {
    let planned = plan(config, seed);
    let salt = salt(seed);
    progress.stage("drawing");
    progress.advance(0, config.total());
    let done = AtomicUsize::new(0);
    let cases_in_all = planned.len();
    let width = planned.len().to_string().len().max(3);
    let cases = planned
        .par_iter()
        .enumerate()
        .map(|(index, planned)| {
            if progress.interrupted() {
                return Err(TrialError::Interrupted { directory: trial.into() });
            }
            let name = format!("case-{:0width$}", index + 1);
            let made = one(config, seed, index, planned)?;
            let folder = sealed.join("cases").join(&name);
            let open = trial.join("cases").join(&name);
            made.case.write(&open, &folder).map_err(|e| not_drawn(planned, &e))?;
            let files = OpenCase::hashes(&open)?;
            files::write_json(&folder.join("drawn.json"), &made.drawn)?;
            let hashes = SEALED
                .iter()
                .map(|file| {
                    let bytes = files::read(&folder.join(file))?;
                    Ok(((*file).to_owned(), salted(&salt, &name, file, &bytes)))
                })
                .collect::<Result<BTreeMap<_, _>, TrialError>>()?;
            progress.advance(done.fetch_add(1, Ordering::Relaxed) + 1, cases_in_all);
            Ok((OpenCase { case: name, without: planned.without.clone(), files, sealed: hashes }, made.repeated))
        })
        .collect::<Result<Vec<_>, TrialError>>()?;
    let repeated = cases.iter().map(|(_, repeated)| repeated).sum();
    let manifest = Manifest { format: FORMAT.to_owned(), cases: cases.into_iter().map(|(case, _)| case).collect() };
    let text = files::json(&trial.join(MANIFEST), &manifest)?;
    let seal = Seal {
        format: SEAL_FORMAT.to_owned(),
        seed,
        salt,
        trial_sha256: sha256(&text),
        repeated,
        program: Program::this()?,
        config: config.clone(),
    };
    files::write_json(&sealed.join(SEAL), &seal)?;
    files::write(&trial.join(MANIFEST), &text)?;
    Ok(Drawn { cases: manifest.cases.len(), repeated })
}

struct Made {
    case: GapCase,
    drawn: DrawnCase,
    repeated: usize,
}

/// Draws one case, whose plant, strengths and noise follow from its own seed.
fn one(config: &TrialConfig, seed: u64, index: usize, planned: &Planned) -> Result<Made, TrialError> {
    let mut rng = ChaCha12Rng::from_seed(derived(seed, "case", index));
    let plants = planned.plants(&config.draw);
    let mut last = None;
    for repeated in 0..ATTEMPTS {
        let case_seed: u64 = rng.random();
        let planned = &planned.on(plants[repeated / ON_ONE_PLANT % plants.len()]);
        // The same plant without an effect gives the gap of noise alone.
        let nothing = planned.spec.clone();
        let floor = gap::draw(case_seed, &nothing).map_err(|e| not_drawn(planned, &e))?.label.gap_floor;
        let least = (config.draw.least_over_floor * floor).max(config.draw.least);
        let range = least.ln()..=config.draw.most.ln();
        if range.is_empty() {
            let reason = format!("most: {} is below the least gap, at a noise of {floor:.4}", config.draw.most);
            return Err(TrialError::Draw { what: what(planned), reason });
        }
        let effects = planned.effects.iter().map(|wanted| EffectSpec {
            kind: wanted.kind.name.to_owned(),
            at: wanted.at.clone(),
            law: wanted.law.map(str::to_owned),
            gap: rng.random_range(range.clone()).exp(),
        });
        let effects = effects.collect();
        let spec = match config.draw.imperfections.drawn(&mut rng) {
            0.0 => GapSpec { effects, ..nothing.clone() },
            imperfections => {
                let beyond_limits = config.draw.beyond_limits.drawn(&mut rng);
                GapSpec { effects, imperfections, beyond_limits, ..nothing.clone() }
            }
        };
        match gap::draw(case_seed, &spec) {
            Ok(case) if clear(&case.label) => {
                return Ok(Made {
                    case,
                    drawn: DrawnCase { arm: planned.arm, seed: case_seed, spec, floor },
                    repeated,
                });
            }
            Ok(_) => {}
            // Several effects, each of which is feasible alone, may be too much together.
            Err(
                error @ (GapError::Unreachable { .. }
                | GapError::Unseen { .. }
                | GapError::Escaped { .. }
                | GapError::Testbed(_)),
            ) => last = Some(error),
            Err(error) => return Err(not_drawn(planned, &error)),
        }
    }
    let reason = last
        .map_or("it never exceeds what the stated limits of nuisance parameters allow".to_owned(), |e| e.to_string());
    Err(TrialError::Draw { what: what(planned), reason: format!("{ATTEMPTS} draws failed: {reason}") })
}

/// Returns whether every effect lies beyond the errors that the stated limits of the simulation allow.
fn clear(label: &Label) -> bool {
    label.effects.iter().all(|effect| {
        effect.clear_of_nuisance
            && match effect.effect.as_str() {
                "actuator-gain" | "sensor-gain" => (effect.par[0] - 1.0).abs() > SHAPE,
                "actuator-crosstalk" | "sensor-crosstalk" => effect.par[0].abs() > SHAPE,
                _ => true,
            }
    })
}

fn what(planned: &Planned) -> String {
    let names: Vec<&str> = planned.effects.iter().map(|e| e.kind.name).collect();
    if names.is_empty() { "a case with nothing missing".to_owned() } else { names.join(" + ") }
}

fn not_drawn(planned: &Planned, error: &GapError) -> TrialError {
    TrialError::Draw { what: what(planned), reason: error.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Cases, Draw};
    use crate::plan::{Arm, Wanted};
    use crate::vocabulary::Outsiders;
    use plid_testbed::gap::PlantKind;

    /// A jitter of the delay cannot make a gap of 3 % on a slider, so it is drawn on the other plant.
    #[test]
    fn a_case_that_its_plant_does_not_allow_is_drawn_on_another() {
        let outsiders = Outsiders::All.kinds();
        let kind = *outsiders.iter().find(|kind| kind.name == "x-delay-jitter").unwrap();
        let effects = vec![Wanted { kind, at: None, law: None }];
        let spec = GapSpec { plant: PlantKind::Slider, channels: PlantKind::Slider.channels(), ..GapSpec::default() };
        let planned = Planned { arm: Arm::Outsider, effects, spec, without: Vec::new() };
        let draw = Draw { plants: vec![PlantKind::Slider, PlantKind::Truss], least: 0.03, ..Draw::default() };
        let config = TrialConfig { name: "t".to_owned(), cases: Cases::default(), draw };
        let moved = one(&config, 3, 0, &planned).unwrap();
        assert_eq!((moved.drawn.spec.plant, moved.repeated), (PlantKind::Truss, ON_ONE_PLANT));
    }
}
