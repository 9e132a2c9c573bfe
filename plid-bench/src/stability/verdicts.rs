//! The verdicts in words with their numbers, all derived from the cells.

use plid_catalogue::Conditions;
use plid_catalogue::{CovarianceName as Form, ScalarName};
use serde::Serialize;

use super::classify::{Class, Judged, RESPONSE_LIMIT};
use super::config::Config;
use super::group::{Part, SCALARS, word};

/// A claim and its verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claim {
    /// The claim and its source.
    pub claim: String,
    /// The verdict in a sentence.
    pub verdict: String,
    /// The numbers, one sentence each.
    pub numbers: Vec<String>,
}

/// A line of the table of recommendations.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recommended {
    /// The number type.
    pub scalar: ScalarName,
    /// Number of states n.
    pub states: usize,
    /// Length of the run.
    pub steps: usize,
    /// The fastest form that held in this study's map, from direct over Joseph and Bierman UD to the array form.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fastest_sound: Option<Form>,
    /// The form that plid recommends and uses by default.
    pub recommended: Form,
    /// Whether that form was sound.
    pub holds: bool,
}

/// All judged cells, selected by their properties.
pub struct Cells<'a>(pub &'a [Judged]);

impl<'a> Cells<'a> {
    /// Returns the cells of a part with a form and scalar, sorted by number of states and otherwise in their original
    /// order.
    fn of(&self, part: Part, form: Form, scalar: ScalarName) -> Vec<&'a Judged> {
        let wanted = |j: &&Judged| j.cell.group.part == part && j.cell.form == form && j.cell.scalar == scalar;
        let mut found: Vec<&Judged> = self.0.iter().filter(wanted).collect();
        found.sort_by_key(|j| j.cell.group.states);
        found
    }
}

/// Returns text such as "sound at n = 12, 18; lost at n = 24 (step 178)".
fn listed(cells: &[&Judged]) -> String {
    let of = |class: Class, word: &str| {
        let names = cells.iter().filter(|j| j.class == class).map(|j| match j.lost_at {
            Some(step) => format!("{} (step {step})", j.cell.group.states),
            None => j.cell.group.states.to_string(),
        });
        let names: Vec<String> = names.collect();
        (!names.is_empty()).then(|| format!("{word} at n = {}", names.join(", ")))
    };
    let parts = [of(Class::Sound, "sound"), of(Class::Degraded, "degraded"), of(Class::Lost, "lost")];
    parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
}

/// Returns text such as "direct, f32".
pub fn name(form: Form, scalar: ScalarName) -> String {
    format!("{}, {}", word(&form), word(&scalar))
}

fn all_sound(cells: &[&Judged]) -> bool {
    !cells.is_empty() && cells.iter().all(|j| j.class == Class::Sound)
}

/// The verdict on a claim whose cells the config leaves out.
const NOT_RUN: &str = "Not run.";

/// Returns the verdicts on the paper's claims and on the target for single precision.
pub fn claims(config: &Config, cells: &Cells<'_>) -> Vec<Claim> {
    vec![twelve_states(config, cells), parameter_noise(cells), long_run(config, cells), hard_starts(cells), cost()]
}

fn cost() -> Claim {
    Claim {
        claim: "Square-root forms cost \"as much as 10x more\" (the paper).".into(),
        verdict: "This is a question of speed, which `plid bench speed` measures.".into(),
        numbers: Vec::new(),
    }
}

fn twelve_states(config: &Config, cells: &Cells<'_>) -> Claim {
    let (single, double) =
        (cells.of(Part::Map, Form::Direct, ScalarName::F32), cells.of(Part::Map, Form::Direct, ScalarName::F64));
    let largest = double.last().map_or(0, |j| j.cell.group.states);
    let small: Vec<&Judged> = single.iter().copied().filter(|j| j.cell.group.states <= 12).collect();
    let verdict = match (all_sound(&double), all_sound(&small)) {
        _ if single.is_empty() || double.is_empty() => NOT_RUN.into(),
        (true, false) => format!(
            "Twelve states are not the bound. In f64 the direct form is sound at every size up to {largest}; in f32 it \
             is not even at 12. \
             The scalar and the length of the run are decisive."
        ),
        (true, true) => format!(
            "The bound applies to single precision, in which the direct form is sound at 12 states. In f64 it is sound \
             at every size up to {largest}."
        ),
        (false, _) => "In f64 the direct form is not sound at every size; the numbers list the failures.".into(),
    };
    let both = |form| SCALARS.map(|scalar| (name(form, scalar), cells.of(Part::Map, form, scalar)));
    let run = [Form::Direct, Form::Joseph].into_iter().flat_map(both).filter(|(_, cells)| !cells.is_empty());
    let numbers = run.map(|(name, cells)| format!("{name}: {}.", listed(&cells)));
    Claim {
        claim: format!(
            "Direct propagation is fine for \"<= 12 states\" (the paper); here over {} steps.",
            config.steps
        ),
        verdict,
        numbers: numbers.collect(),
    }
}

/// Returns the verdict on parameter noise. `tested` holds the number of cells in f32 that parameter noise keeps
/// positive, and the number of these with a good model; it is `None` if no cell was tested.
fn parameter_noise_verdict(cells: &Cells<'_>, tested: Option<(usize, usize)>) -> String {
    let direct = cells.of(Part::Map, Form::Direct, ScalarName::F64);
    let factored = all_sound(&cells.of(Part::Map, Form::BiermanUd, ScalarName::F32));
    let in_single = match tested {
        None => "It was not tested in f32.".into(),
        Some((kept, worth)) => format!(
            "In f32, parameter noise keeps a matrix positive in {kept} of the cells below, in {worth} of them at a \
             free-run error of less than 1.5 times that of Bierman UD without noise."
        ),
    };
    let verdict = format!(
        "{} {in_single} {}",
        if direct.is_empty() {
            "The direct form was not run without it."
        } else if all_sound(&direct) {
            "It is not needed in f64: the direct form is sound without it."
        } else {
            "In f64 the direct form is not sound without it either."
        },
        if factored { "Bierman UD is sound in f32 without it." } else { "" }
    );
    verdict.trim_end().into()
}

fn parameter_noise(cells: &Cells<'_>) -> Claim {
    let percent = |error: Option<f64>| error.map_or("diverges".into(), |e| format!("{:.1} %", 100.0 * e));
    let mut numbers = Vec::new();
    let (mut kept, mut worth) = (0, 0);
    for form in [Form::Direct, Form::Joseph] {
        for scalar in SCALARS {
            let mut varied = cells.of(Part::Variation, form, scalar);
            varied.retain(|j| j.cell.group.parameter_noise > 0.0);
            let mut sizes: Vec<usize> = varied.iter().map(|j| j.cell.group.states).collect();
            sizes.dedup();
            for states in sizes {
                let at = |form, scalar| {
                    let all = cells.of(Part::Map, form, scalar);
                    all.into_iter().find(|j| j.cell.group.states == states)
                };
                let what = |j: &Judged| match j.lost_at {
                    Some(step) => format!("lost at step {step}"),
                    None => format!("positive, simulation error {}", percent(j.cell.free_run)),
                };
                let mut said =
                    at(form, scalar).map(|j| format!("without, {}", what(j))).into_iter().collect::<Vec<_>>();
                let bare = at(Form::BiermanUd, ScalarName::F64).and_then(|j| j.cell.free_run);
                for j in varied.iter().filter(|j| j.cell.group.states == states) {
                    said.push(format!("{:e}, {}", j.cell.group.parameter_noise, what(j)));
                    if scalar == ScalarName::F32 && j.lost_at.is_none() {
                        kept += 1;
                        worth +=
                            usize::from(matches!((j.cell.free_run, bare), (Some(own), Some(bare)) if own < 1.5 * bare));
                    }
                }
                numbers.push(format!(
                    "{}, n = {states} (Bierman UD in f64 without noise: {}): {}.",
                    name(form, scalar),
                    percent(bare),
                    said.join("; ")
                ));
            }
        }
    }
    let verdict = parameter_noise_verdict(cells, (!numbers.is_empty()).then_some((kept, worth)));
    Claim { claim: "Tiny parameter noise is needed without square roots (the paper).".into(), verdict, numbers }
}

fn long_run(config: &Config, cells: &Cells<'_>) -> Claim {
    let found = cells.of(Part::Long, Form::BiermanUd, ScalarName::F32);
    let (verdict, numbers) = match found.first() {
        None => (NOT_RUN.into(), Vec::new()),
        Some(j) => {
            let group = &j.cell.group;
            let response = j.response.map_or("not known".into(), |r| format!("{:.2} % of the peak", 100.0 * r));
            let positive = match j.lost_at {
                None => format!("P stays positive definite for {} steps", j.cell.done),
                Some(step) => format!("P is lost at step {step}"),
            };
            let met = j.cell.stop.is_none() && j.lost_at.is_none() && j.response.is_some_and(|r| r <= RESPONSE_LIMIT);
            let verdict = format!(
                "{}: {positive}, and after {} steps the frequency response differs from that in f64 by {response}.",
                if met { "It does" } else { "It does not" },
                group.compared_at
            );
            let pivot = j.cell.smallest_pivot.map_or("not finite".into(), |p| format!("{p:.1e}"));
            (verdict, vec![format!("n = {}; smallest pivot at the end {pivot}.", group.states)])
        }
    };
    Claim {
        claim: format!(
            "Bierman UD in f32 at n = {} keeps P positive definite for {} steps, and its response agrees with that in \
             f64 to within {} % of the peak (our target).",
            config.long.states,
            config.long.steps,
            100.0 * RESPONSE_LIMIT
        ),
        verdict,
        numbers,
    }
}

fn hard_starts(cells: &Cells<'_>) -> Claim {
    let mut numbers = Vec::new();
    let mut unharmed = Vec::new();
    for scalar in SCALARS {
        for form in Form::all() {
            let cells = cells.of(Part::Adversarial, form, scalar);
            if cells.is_empty() {
                continue;
            }
            if all_sound(&cells) {
                unharmed.push(name(form, scalar));
                continue;
            }
            let not = cells.iter().filter(|j| j.class != Class::Sound).map(|j| match j.lost_at {
                Some(step) => format!("{} lost at step {step}", j.cell.group.label),
                None => format!("{} degraded", j.cell.group.label),
            });
            numbers.push(format!("{}: {}.", name(form, scalar), not.collect::<Vec<_>>().join("; ")));
        }
    }
    let verdict = if numbers.is_empty() && unharmed.is_empty() {
        NOT_RUN.into()
    } else if unharmed.is_empty() {
        "No form is sound in all cases.".into()
    } else {
        format!("Sound in all cases: {}.", unharmed.join("; "))
    };
    Claim { claim: "Adverse initial conditions and records.".into(), verdict, numbers }
}

/// Returns the table of recommendations, compared with the map. It has no line for a form that was not run.
pub fn recommended(config: &Config, cells: &Cells<'_>, start_ratio: f64) -> Vec<Recommended> {
    let mut table = Vec::new();
    let lengths = [1000, 10_000, 100_000].into_iter().filter(|&steps| steps <= config.steps);
    let lengths: Vec<usize> = lengths.collect();
    for scalar in SCALARS {
        for &states in &config.states {
            for &steps in &lengths {
                let holds = |form: Form| {
                    let cells = cells.of(Part::Map, form, scalar);
                    cells.iter().any(|j| j.cell.group.states == states && j.holds_to(steps))
                };
                let recommended = Conditions { states, scalar, steps, start_ratio, forgets: false }.recommended();
                if cells.of(Part::Map, recommended, scalar).is_empty() {
                    continue;
                }
                table.push(Recommended {
                    scalar,
                    states,
                    steps,
                    fastest_sound: Form::all().into_iter().find(|&form| holds(form)),
                    recommended,
                    holds: holds(recommended),
                });
            }
        }
    }
    table
}
