//! The README's main job, with what it is to reach. Golden figures: the same seed gives the same data on every run.

use std::path::Path;
use std::sync::OnceLock;

use plid::catalogue::{BackendName, CovarianceName};
use plid::lab::experiment::{self, Experiment};
use plid::lab::run::{self, Outcome, Silent};
use plid::model::frequency_response;

fn experiment() -> Experiment {
    experiment::read(Path::new("experiments/truss-mimo-30.toml")).unwrap()
}

fn outcome() -> &'static Outcome {
    static OUTCOME: OnceLock<Outcome> = OnceLock::new();
    OUTCOME.get_or_init(|| run::carry_out(&experiment(), Path::new("experiments"), None, false, &Silent).unwrap())
}

#[test]
fn thirty_states_simulate_the_truss_as_well_as_the_true_plant() {
    let validation = &outcome().validation;
    let truth = validation.truth_errors.as_ref().unwrap().overall_relative;
    let ratio = validation.free_run_errors.overall_relative / truth;
    // Below one by chance only: the true plant leaves nothing but noise.
    assert!((0.98..1.06).contains(&ratio), "{ratio}");
    let one_step = validation.one_step_errors.as_ref().unwrap().overall_relative;
    assert!(one_step < 0.02, "{one_step}");
}

#[test]
fn the_refined_model_and_the_baseline_do_so_too() {
    let simulation = &outcome().simulation;
    let truth = outcome().validation.truth_errors.as_ref().unwrap().overall_relative;
    let (refined, path) = simulation.refined.as_ref().unwrap();
    let ratio = refined.free_run_errors.overall_relative / truth;
    assert!((0.98..1.03).contains(&ratio), "{ratio}");
    assert!(path.poles_at_limit == 0, "{}", path.poles_at_limit);
    let ratio = simulation.subspace.as_ref().unwrap().free_run_errors.overall_relative / truth;
    assert!((0.98..1.5).contains(&ratio), "{ratio}");
}

#[test]
fn all_five_dominant_modes_are_found_in_every_pair_that_shows_them() {
    let peaks = &outcome().peaks;
    assert!(peaks.len() >= 40, "{}", peaks.len());
    for row in peaks {
        let frequency = row.frequency_error().unwrap_or(f64::INFINITY).abs();
        let height = row.height_error_db().unwrap_or(f64::INFINITY).abs();
        assert!(frequency < 0.0005 && height < 0.5, "{row:?}");
    }
}

#[test]
fn all_forms_and_backends_agree_on_it() {
    // The covariances that the bank found, given, so that only the variant differs.
    let tuned = outcome();
    let hz: Vec<f64> = (40..=300).map(f64::from).collect();
    let reference = frequency_response(&tuned.model, &hz).unwrap();
    let peak = reference.iter().flatten().map(|h| h.norm()).fold(0.0, f64::max);
    let variants = [
        (CovarianceName::Direct, BackendName::Plain),
        (CovarianceName::Joseph, BackendName::Nalgebra),
        (CovarianceName::ArraySqrt, BackendName::Faer),
        (CovarianceName::BiermanUd, BackendName::Faer),
        (CovarianceName::Direct, BackendName::Faer),
        (CovarianceName::Direct, BackendName::Nalgebra),
    ];
    let scale = &tuned.prepared.output_scales;
    let variance = |factor: f64| scale.iter().map(|s| factor * s * s).collect::<Vec<_>>();
    let per_state: Vec<f64> =
        variance(tuned.noise_levels.1).iter().zip(tuned.form.indices()).flat_map(|(v, n)| vec![*v; *n]).collect();
    for (covariance, backend) in variants {
        let mut experiment = experiment();
        experiment.variant.covariance = Some(covariance);
        experiment.variant.backend = backend;
        experiment.validation.model_only = true;
        experiment.noise.from = plid::lab::experiment::NoiseSource::Given;
        experiment.noise.sensor = Some(plid::lab::experiment::Covariance::Diagonal(variance(tuned.noise_levels.0[0])));
        experiment.noise.state = Some(plid::lab::experiment::Covariance::Diagonal(per_state.clone()));
        let other = run::carry_out(&experiment, Path::new("experiments"), None, false, &Silent).unwrap();
        let response = frequency_response(&other.model, &hz).unwrap();
        let difference =
            reference.iter().flatten().zip(response.iter().flatten()).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        println!("{covariance:?} on {backend:?}: {:.1e} of the peak", difference / peak);
        assert!(difference <= 1e-6 * peak, "{covariance:?} on {backend:?}: {:.1e}", difference / peak);
    }
}
