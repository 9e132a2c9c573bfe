//! The quick claims against figures that were looked at once. They guard against a change of result, not of rounding.

use std::collections::BTreeSet;
use std::path::Path;

use plid_lab::experiment::{Experiment, from_toml};
use plid_lab::run::Silent;
use plid_paper::{CLAIMS, Claim, Finding, Line, Options, Verdict, reproduce};

use Verdict::{Confirmed, ConfirmedInPart, Refuted};

/// Runs claims quickly.
fn quick(ids: &[&str], directory: &Path) -> Vec<(Claim, Finding)> {
    let only = ids.iter().map(ToString::to_string).collect();
    let options = Options { only, quick: true, ..Options::default() };
    let lines = reproduce(CLAIMS, &options, directory, &Silent).unwrap();
    lines.into_iter().filter_map(|Line { claim, finding, .. }| Some((claim, finding?))).collect()
}

/// A figure of a claim, its value, and how far it may be off.
type Golden = (&'static str, f64, f64);

fn check(id: &str, verdict: Verdict, golden: &[Golden]) {
    let directory = tempfile::tempdir().unwrap();
    let (_, finding) = quick(&[id], directory.path()).remove(0);
    assert_eq!(finding.verdict(), verdict, "{id}: {:#?}", finding.parts);
    figures(id, &finding, golden);
}

fn figures(id: &str, finding: &Finding, golden: &[Golden]) {
    for &(name, expected, tolerance) in golden {
        let found = finding.value(name);
        assert!((found - expected).abs() <= tolerance, "{id}: {name} is {found}, not {expected} within {tolerance}");
    }
}



#[test]
fn every_claim_is_there_with_configs_that_can_be_read() {
    let asked = [
        "fig4", "fig5", "fig6", "fig7", "fig8", "fig9", "fig10", "46db", "graceful", "robust", "white", "nopoles", "rate", "drift",
        "halftime", "tenfold", "twelve", "parnoise", "converge", "unstable", "sizing",
    ];
    assert_eq!(CLAIMS.iter().map(|claim| claim.id).collect::<Vec<_>>(), asked);
    // Those that are studies of the bench, or arithmetic, are no experiments.
    let others: BTreeSet<&str> = ["halftime", "tenfold", "twelve", "parnoise", "converge", "sizing"].into();
    for claim in CLAIMS.iter().filter(|claim| !others.contains(claim.id)) {
        let experiment: Experiment = from_toml(claim.config, claim.id).unwrap();
        assert_eq!(experiment.problems(), [], "{}", claim.id);
    }
}

#[test]
fn a_finished_claim_is_kept_and_the_same_config_gives_the_same_bytes() {
    let (one, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let read = |directory: &Path, name: &str| std::fs::read_to_string(directory.join(name)).unwrap();
    quick(&["sizing"], one.path());
    let journal = read(one.path(), "cells.jsonl");
    // What is there is not run again: the journal does not grow.
    quick(&["sizing"], one.path());
    assert_eq!(read(one.path(), "cells.jsonl"), journal);
    // A page grows claim by claim.
    let found = quick(&["fig5"], one.path());
    assert_eq!(found.len(), 2);
    quick(&["fig5", "sizing"], other.path());
    for name in ["claims.json", "fig5/claim.json", "fig5/fig5-1.svg", "fig5/fig5.toml", "sizing/claim.json"] {
        assert_eq!(read(one.path(), name), read(other.path(), name), "{name}");
    }
    let page = read(one.path(), "report.html");
    assert!(page.contains("Of 2 figures and claims") && page.contains("Not run yet: fig4, fig6"));
}

#[test]
fn another_config_is_run_anew_and_a_wrong_one_is_named() {
    let (configs, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    for claim in CLAIMS {
        std::fs::write(configs.path().join(format!("{}.toml", claim.id)), claim.config).unwrap();
        std::fs::write(configs.path().join(format!("{}.vary.toml", claim.id)), claim.vary).unwrap();
    }
    let options = Options { only: vec!["sizing".into()], configs: Some(configs.path().into()), ..Options::default() };
    let side = |options: &Options| {
        let lines = reproduce(CLAIMS, options, out.path(), &Silent)?;
        Ok::<f64, plid_bench::study::StudyError>(lines.iter().find_map(|l| l.finding.as_ref()).unwrap().value("side of the adapter"))
    };
    let first = side(&options).unwrap();
    let path = configs.path().join("sizing.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("voltage = 100.0", "voltage = 200.0")).unwrap();
    assert!((side(&options).unwrap() / first - 2.0).abs() < 1e-12);
    std::fs::write(&path, text.replace("voltage", "volts")).unwrap();
    let message = side(&options).unwrap_err().to_string();
    assert!(message.contains("sizing.toml") && message.contains("volts"), "{message}");
}
