//! Claim: the number of states up to which the direct propagation of P is sound.

use plid_bench::stability::{self, Class, Config, Judged, Part};
use plid_catalogue::{CovarianceName, ScalarName};
use plid_work::Inner;
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};

pub const CLAIM: Claim = claim!("twelve",
    statement: "Direct propagation of the covariance is good enough for up to 12 states; beyond, a square root is \
        needed.",
    limit: "The precision that the paper's computer worked in, and for how many steps, is not known; both scalars are \
        shown.",
    timed: false,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    states: Vec<usize>,
    steps: usize,
}

/// Returns the class of a cell in words, with the step at which P was lost.
pub fn word(judged: &Judged) -> String {
    match (judged.class, judged.lost_at) {
        (Class::Sound, _) => "sound".into(),
        (Class::Degraded, _) => "degraded".into(),
        (Class::Lost, Some(step)) => format!("lost at {step}"),
        (Class::Lost, None) => "lost".into(),
    }
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (mut config, vary): (Config, Vary) = (context.config()?, context.vary()?);
    (config.states, config.steps) = (vary.states.clone(), vary.steps);
    let outcome = stability::carry_out(&config, context.directory, false, &Inner(context.progress))?;
    let mut cells: Vec<&Judged> = outcome.cells.iter().filter(|j| j.cell.group.part == Part::Map).collect();
    cells.sort_by_key(|j| j.cell.group.states);
    let of = |form: CovarianceName, scalar: ScalarName| {
        cells.iter().copied().filter(move |j| (j.cell.form, j.cell.scalar) == (form, scalar)).collect::<Vec<_>>()
    };
    let kinds = [
        ("direct, f32", CovarianceName::Direct, ScalarName::F32),
        ("direct, f64", CovarianceName::Direct, ScalarName::F64),
        ("Bierman UD, f32", CovarianceName::BiermanUd, ScalarName::F32),
        ("Bierman UD, f64", CovarianceName::BiermanUd, ScalarName::F64),
    ];
    let mut finding = Finding::default();
    let mut rows: Vec<Vec<String>> = vary.states.iter().map(|n| vec![n.to_string()]).collect();
    for (name, form, scalar) in kinds {
        for (judged, row) in of(form, scalar).into_iter().zip(&mut rows) {
            let steps = judged.lost_at.unwrap_or(judged.cell.done);
            finding = finding.figure(
                format!("steps until lost or done, {name}, {} states", judged.cell.group.states),
                steps as f64,
                "",
            );
            row.push(word(judged));
        }
    }
    let sound = |form, scalar, wanted: &dyn Fn(usize) -> bool| {
        of(form, scalar).iter().filter(|j| wanted(j.cell.group.states)).all(|j| j.class == Class::Sound)
    };
    let (small, large) = (|n: usize| n <= 12, |n: usize| n > 12);
    let direct = CovarianceName::Direct;
    let largest = vary.states.iter().max().ok_or("no states")?;
    let single_small = sound(direct, ScalarName::F32, &small);
    let double_all = sound(direct, ScalarName::F64, &|_| true);
    let columns: Vec<(&str, &str)> =
        [("states", "")].into_iter().chain(kinds.iter().map(|kind| (kind.0, ""))).collect();
    Ok(finding
        .part("In f64 the direct form is sound with 12 states.", sound(direct, ScalarName::F64, &small))
        .part("In f32 it is.", single_small)
        .part("In f64 it is not sound with more than 12 states at every size.", !sound(direct, ScalarName::F64, &large))
        .part(
            "In f32 it is not, and Bierman UD is.",
            !sound(direct, ScalarName::F32, &large) && sound(CovarianceName::BiermanUd, ScalarName::F32, &large),
        )
        .table(&format!("{} steps on the truss, P0/R = 4·10⁴. {}", vary.steps, stability::rule()), &columns, rows)
        .say(format!(
            "Over {} steps the direct form is {} in f64 up to {largest} states; in f32 it is {} with 12 states. The \
             scalar is decisive, not the number of states.",
            vary.steps,
            if double_all { "sound" } else { "not sound at every size" },
            if single_small { "sound" } else { "lost or degraded" },
        )))
}
