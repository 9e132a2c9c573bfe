//! Claim: the duration of a single-input run, compared with a run with all inputs.

use plid_bench::speed::Cell;

use super::tenfold::timed;
use crate::claim::{Claim, Context, Finding, Result, claim};

pub const CLAIM: Claim = claim!("halftime",
    statement: "A SIMO run takes half the time of a MIMO run.",
    limit: "Times are this machine's; the ratio of unknowns is not.",
    timed: true,
);

fn run(context: &Context<'_>) -> Result<Finding> {
    let outcome = timed(context)?;
    let mut finding = Finding::default();
    let (mut rows, mut ratios) = (Vec::new(), Vec::new());
    for one in outcome.timings.iter().filter(|timing| timing.cell.inputs == 1) {
        let all = outcome.timing(&Cell { inputs: plid_testbed::INPUTS, ..one.cell }).ok_or("the study lacks a cell")?;
        let time = one.least_us / all.least_us;
        // P has (p + m + 1) n rows, and a step processes all of P.
        let theory = (one.joint_states as f64 / all.joint_states as f64).powi(2);
        let work = one.operations.total() as f64 / all.operations.total() as f64;
        let name = format!("{}, {} states", plid_bench::speed::word(&one.cell.variant.covariance), one.cell.states);
        finding = finding.timed(format!("SIMO over MIMO, {name}"), time, "").figure(
            format!("operations, SIMO over MIMO, {name}"),
            work,
            "",
        );
        rows.push(vec![
            name,
            format!("{:.1}", one.least_us),
            format!("{:.1}", all.least_us),
            format!("{time:.2}"),
            format!("{work:.2}"),
            format!("{theory:.2}"),
        ]);
        ratios.push(time);
    }
    let (least, most) =
        (ratios.iter().copied().fold(f64::INFINITY, f64::min), ratios.iter().copied().fold(0.0, f64::max));
    let half = |ratio: f64| (0.4..=0.6).contains(&ratio);
    let direct = finding.figures.iter().filter(|f| f.timed && f.name.contains("direct"));
    let direct_half = direct.filter_map(|f| f.value).all(half);
    Ok(finding
        .part("With the direct form a SIMO step takes 0.4 to 0.6 of the time of a MIMO step.", direct_half)
        .part("With every form it does.", ratios.iter().copied().all(half))
        .table(
            "Three outputs; least time of a step. Theory: the square of the ratio of unknowns, (5/7)².",
            &[("form", ""), ("SIMO", "µs"), ("MIMO", "µs"), ("ratio", ""), ("of operations", ""), ("theory", "")],
            rows,
        )
        .say(format!(
            "A SIMO step takes {least:.2} to {most:.2} of the time of a MIMO step; in theory, with 5 n unknowns in \
             place of 7 n and work that grows with their square, 0.51. Three SIMO runs therefore take {:.1} to {:.1} \
             times as long as one MIMO run over as many samples.",
            3.0 * least,
            3.0 * most
        )))
}
