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

/// Checks a claim that measures times: neither they nor the verdict, which depends on them, are compared.
fn unjudged(id: &str, golden: &[Golden]) {
    let directory = tempfile::tempdir().unwrap();
    figures(id, &quick(&[id], directory.path()).remove(0).1, golden);
}

#[test]
fn fig4() {
    check(
        "fig4",
        ConfirmedInPart,
        &[
            ("group of tube modes below the highest peak", 48.35, 0.5),
            ("the same of the true plant", 47.52, 0.05),
            ("largest distance of a measured peak from the true one", 0.18, 0.1),
            ("largest error of a peak's height", 0.93, 0.2),
        ],
    );
}

#[test]
fn fig5() {
    check(
        "fig5",
        ConfirmedInPart,
        &[
            ("below the amplifier's noise from", 429.6, 1.0),
            ("the same, measured", 428.1, 7.0),
            ("the same for an analogue filter", 542.4, 1.0),
            ("below the converter's rounding from", 508.4, 1.0),
            ("the same for an analogue filter, rounding", 748.9, 1.0),
        ],
    );
}

#[test]
#[ignore = "some ten seconds of several runs; `.ci/release` runs it"]
fn fig6() {
    check(
        "fig6",
        ConfirmedInPart,
        &[
            ("level, paper's covariances, one record", 13.31, 0.3),
            ("level, paper's covariances, ten averages", 7.50, 0.3),
            ("peak, paper's covariances, one record", 47.2, 2.0),
            ("peak, paper's covariances, ten averages", 22.7, 1.5),
            ("level, tuned covariances, one record", 11.44, 0.5),
            ("level, tuned covariances, ten averages", 4.56, 0.3),
            ("modes that show within 3 dB at the last curve", 5.0, 0.0),
        ],
    );
}

#[test]
#[ignore = "some ten seconds of several runs; `.ci/release` runs it"]
fn fig7() {
    check(
        "fig7",
        ConfirmedInPart,
        &[
            ("136 Hz within 3 dB, paper's covariances, one record", 100.0, 0.0),
            ("peaks within 3 dB, paper's covariances, one record", 90.0, 1.2),
            ("peaks within 3 dB, paper's covariances, ten averages", 93.3, 1.2),
            ("median error of a peak, paper's covariances, one record", 0.893, 0.03),
            ("median error of a peak, paper's covariances, ten averages", 0.674, 0.03),
            ("median error of a peak, tuned covariances, one record", 0.102, 0.03),
            ("median error of a peak, tuned covariances, ten averages", 0.037, 0.015),
        ],
    );
}

#[test]
#[ignore = "some ten seconds of several runs; `.ci/release` runs it"]
fn fig8() {
    check(
        "fig8",
        Confirmed,
        &[
            ("error in band, 24 states, paper's covariances", 14.31, 0.3),
            ("error in band, 27 states, paper's covariances", 10.18, 0.3),
            ("error in band, 30 states, paper's covariances", 6.88, 0.2),
            ("168 Hz, 500 samples, paper's covariances", -5.25, 0.1),
            ("168 Hz, 2000 samples, paper's covariances", -0.69, 0.05),
            ("168 Hz, 5000 samples, paper's covariances", -0.42, 0.05),
        ],
    );
}

#[test]
fn fig9() {
    check(
        "fig9",
        ConfirmedInPart,
        &[
            ("outputs at rest", 17.93, 0.1),
            ("one-step error over the last 200 samples, paper's covariances", 10.19, 0.2),
            ("136 Hz off, paper's covariances", 3.46, 0.1),
            ("212 Hz off, paper's covariances", 6.41, 0.1),
            ("one-step error over the last 200 samples, tuned covariances", 8.96, 0.3),
            ("136 Hz off, tuned covariances", 0.43, 0.2),
            ("243 Hz off, tuned covariances", 0.86, 0.3),
        ],
    );
}

#[test]
fn fig10() {
    unjudged(
        "fig10",
        &[("mean |e|, 24 states", 8.47, 0.1), ("mean |e|, 40 states", 7.43, 0.1), ("mean |e|, 64 states", 7.09, 0.1)],
    );
}

#[test]
#[ignore = "some ten seconds of several runs; `.ci/release` runs it"]
fn decibels() {
    check(
        "46db",
        Refuted,
        &[
            ("what clipping alone allows at 2 V RMS", 26.2, 0.02),
            ("output, Gaussian, converters at ±5 V", 1.85, 0.05),
            ("clipped samples, Gaussian, converters at ±5 V", 1.12, 0.2),
            ("one step, Gaussian, converters at ±5 V", 29.6, 0.5),
            ("one step, Gaussian, no clipping", 44.85, 0.14),
            ("free run, Gaussian, no clipping", 39.3, 0.7),
            ("one step, multisine below 5 V", 44.2, 0.4),
            ("free run, multisine below 5 V", 37.0, 0.5),
            ("true plant, multisine below 5 V", 36.7, 0.3),
        ],
    );
}

#[test]
fn graceful() {
    check(
        "graceful",
        Confirmed,
        &[
            ("error in band, shaped, 12 states", 78.0, 1.0),
            ("error in band, shaped, 24 states", 13.6, 0.3),
            ("error in band, shaped, 30 states", 6.41, 0.2),
            ("error in band, white, 24 states", 46.5, 1.0),
            ("error in band, white, 30 states", 25.4, 0.6),
        ],
    );
}

#[test]
fn robust() {
    check(
        "robust",
        ConfirmedInPart,
        &[
            ("error in band, none: white sensor noise of 5 mV", 0.72, 0.1),
            ("error in band, 12-bit converters", 0.72, 0.1),
            ("error in band, cubic stiffness 1e-5 /V²", 1.81, 0.2),
            ("error in band, stiffness drift 1e-4 /s", 1.19, 0.2),
            ("error in band, all together", 3.89, 0.4),
            ("peaks within 3 dB, all together", 45.0, 0.0),
            ("error in band, all, R and Σ wrong by 1e2", 11.0, 1.0),
            ("peaks within 3 dB, all, R and Σ wrong by 1e2", 43.0, 0.0),
        ],
    );
}

#[test]
fn white() {
    check(
        "white",
        ConfirmedInPart,
        &[
            ("white residuals, 24 states", 0.0, 0.0),
            ("pairs without correlation with the inputs, 24 states", 7.0, 1.0),
            ("largest correlation with an input, 24 states", 0.172, 0.02),
            ("pairs without correlation with the inputs, 60 states", 9.0, 0.0),
            ("largest correlation with an input, 60 states", 0.135, 0.03),
        ],
    );
}

#[test]
fn nopoles() {
    check(
        "nopoles",
        Refuted,
        &[
            ("poles above 600 Hz, shaped, paper's covariances, 24 states", 7.0, 0.0),
            ("poles above 600 Hz, shaped, paper's covariances, 36 states", 8.0, 0.0),
            ("poles above 600 Hz, white, paper's covariances, 24 states", 5.0, 0.0),
        ],
    );
}

#[test]
fn rate() {
    check(
        "rate",
        Confirmed,
        &[
            ("samples needed at 800 Hz", 1500.0, 0.0),
            ("samples needed at 1600 Hz", 500.0, 0.0),
            ("samples needed at 3200 Hz", 1000.0, 0.0),
            ("error at the end at 1600 Hz", 2.16, 0.2),
        ],
    );
}

#[test]
#[ignore = "some ten seconds of several runs; `.ci/release` runs it"]
fn drift() {
    check(
        "drift",
        ConfirmedInPart,
        &[
            ("no drift, one run over all", 3.58, 0.15),
            ("drift, one run over all", 23.1, 1.0),
            ("drift, anew from the last stretch alone", 12.8, 0.6),
            ("drift, forgetting 0.999", 13.9, 0.6),
            ("drift, from the last P, widened 1e4 times", 13.8, 0.6),
        ],
    );
}

#[test]
fn halftime() {
    unjudged(
        "halftime",
        &[
            ("operations, SIMO over MIMO, direct, 64 states", 0.581, 0.005),
            ("operations, SIMO over MIMO, bierman-ud, 64 states", 0.528, 0.005),
        ],
    );
}

#[test]
fn tenfold() {
    unjudged(
        "tenfold",
        &[
            ("operations over direct, bierman-ud, 64 states, moment-matched", 6.20, 0.1),
            ("operations over direct, bierman-ud, 64 states, joint-ekf", 1.97, 0.05),
            ("operations over direct, array-sqrt, 12 states, prior", 4.51, 0.1),
        ],
    );
}

#[test]
fn twelve() {
    check(
        "twelve",
        ConfirmedInPart,
        &[
            ("steps until lost or done, direct, f32, 24 states", 150.0, 100.0),
            ("steps until lost or done, direct, f64, 24 states", 2000.0, 0.0),
            ("steps until lost or done, Bierman UD, f32, 24 states", 2000.0, 0.0),
        ],
    );
}

#[test]
fn parnoise() {
    check(
        "parnoise",
        ConfirmedInPart,
        &[
            ("steps until lost or done, f32, parameter noise 0e0", 237.0, 80.0),
            ("steps until lost or done, f32, parameter noise 1e-8", 1000.0, 0.0),
            ("free-run error, f64, parameter noise 0e0", 4.31, 0.1),
            ("free-run error, f64, parameter noise 1e-8", 15.73, 0.3),
            ("free-run error, f64, parameter noise 1e-4", 84.3, 1.0),
        ],
    );
}

#[test]
fn converge() {
    check(
        "converge",
        ConfirmedInPart,
        &[
            ("slope of the free-run error, prior", -0.441, 0.03),
            ("slope of the free-run error, moment-matched", -0.488, 0.03),
            ("slope of the parameters' RMS error, prior", 0.001, 0.03),
            ("NEES at the end, prior", 13.84, 0.5),
            ("NEES at the end, moment-matched", 1.22, 0.1),
            ("free-run error at the end, moment-matched", 0.578, 0.03),
        ],
    );
}

#[test]
fn unstable() {
    check(
        "unstable",
        Confirmed,
        &[
            ("error of the poles, unstable", 0.000178, 0.00003),
            ("error of the zeros, non-minimum-phase", 0.000581, 0.0001),
        ],
    );
}

#[test]
fn sizing() {
    check(
        "sizing",
        ConfirmedInPart,
        &[("side of the adapter", 0.1584, 0.0001), ("the same with both wafers", 0.3168, 0.0001)],
    );
}

#[test]
fn every_claim_is_there_with_configs_that_can_be_read() {
    let asked = [
        "fig4", "fig5", "fig6", "fig7", "fig8", "fig9", "fig10", "46db", "graceful", "robust", "white", "nopoles",
        "rate", "drift", "halftime", "tenfold", "twelve", "parnoise", "converge", "unstable", "sizing",
    ];
    assert_eq!(CLAIMS.iter().map(|claim| claim.id).collect::<Vec<_>>(), asked);
    // Studies of the bench and arithmetic are not experiments.
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
        Ok::<f64, plid_bench::study::StudyError>(
            lines.iter().find_map(|l| l.finding.as_ref()).unwrap().value("side of the adapter"),
        )
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
