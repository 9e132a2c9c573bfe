//! Simulations that lack nothing, or only a state. Their declared noise is wrong, or they were fitted to one part of
//! the records and are tested on another.

use std::path::Path;

use nalgebra::{DMatrix, DVector, dmatrix};
use plid_model::Model;

use crate::answer::predict::Predictor;
use crate::case::Case;
use crate::case::record::rms;
use crate::diagnose;
use crate::effects::Library;
use crate::judge::verdict::Verdict;
use crate::testing::{add_noise, diagnosed, four_records, random_input, run};

const SAMPLES: usize = 2000;

/// Number of samples over which a command is held.
const HOLD: usize = 15;

/// Returns a thermal plant of bodies in a row with these time constants in s, measured by a thermometer at 1 Hz.
fn oven(time_constants: &[f64]) -> Model {
    let n = time_constants.len();
    let turn = |k: usize| (-1.0 / time_constants[k]).exp();
    // Each body moves towards the one before it; the first moves towards the heater.
    let mut a = DMatrix::zeros(n, n);
    let mut b = DVector::zeros(n);
    for k in 0..n {
        let gain = 1.0 - turn(k);
        for j in 0..k {
            a[(k, j)] = gain * a[(k - 1, j)];
        }
        b[k] = if k == 0 { gain } else { gain * b[k - 1] };
        a[(k, k)] = turn(k);
    }
    let c = DMatrix::from_fn(1, n, |_, k| f64::from(u8::from(k + 1 == n)));
    Model::new(1.0, a, DMatrix::from_column_slice(n, 1, b.as_slice()), c, dmatrix![0.0]).unwrap()
}

/// Returns a case of a quiet record and three driven ones of a sound simulation, with 0.5 % of noise.
fn case(plant: &Model) -> Case {
    let input = |k: usize| {
        let drawn = &random_input(k as u64 + 1, SAMPLES, 1)[0];
        vec![(0..SAMPLES).map(|n| drawn[n / HOLD]).collect()]
    };
    let std = [0.005 * rms(&run(plant, &input(0))[0])];
    four_records(plant, &std, [1.0, 0.5, 1.0], input, |k, u| {
        let mut y = run(plant, u);
        add_noise(&mut y, k as u64 + 50, &std);
        y
    })
}

/// The declared noise is 0.7 or 1.4 times the true noise. The only finding may be a sensor that is noisier than
/// declared, and only with a quiet record. Without such a record, nothing is missing.
#[test]
fn a_wrong_declared_noise_is_no_effect() {
    for factor in [0.7, 1.4] {
        let mut case = case(&oven(&[40.0, 12.0, 4.0]));
        let declared = case.model.as_mut().unwrap().noise.sensor_std.as_mut().unwrap();
        declared.iter_mut().for_each(|std| *std *= factor);
        for quiet in [true, false] {
            if !quiet {
                case.records.remove(0);
            }
            let found = diagnosed(&case);
            assert!(found.effects.iter().all(|effect| effect.effect == "sensor-noise"), "{}", found.sentence);
            assert!(found.verdict != Verdict::Unknown, "{}", found.sentence);
            assert!(quiet && factor < 1.0 || found.verdict == Verdict::None, "{}", found.sentence);
        }
    }
}

/// The thermometer does not read zero when the oven is at rest. Without a simulation, this level is part of the linear
/// model, and a prediction from rest begins at this level.
#[test]
fn a_level_is_part_of_the_model_of_the_records() {
    let plant = oven(&[40.0, 12.0]);
    let mut case = case(&plant);
    let level = 20.0 * rms(&case.records[1].y[0]);
    case.model = None;
    case.config.states = Some(2);
    case.records.remove(0);
    for record in &mut case.records {
        record.from_rest = false;
        record.y[0].iter_mut().for_each(|y| *y += level);
    }
    let outcome = diagnose(&case, &Library::standard(), &mut |_| {}).unwrap();
    let found = &outcome.diagnosis;
    assert!(found.effects.is_empty() && found.verdict == Verdict::None, "{}", found.sentence);
    let predictor = Predictor::new(outcome.simulation, &Library::standard(), Path::new("sim.json")).unwrap();
    let u = vec![vec![1.0; 200]];
    let predicted = predictor.predict(&u, 0.0).unwrap().outputs;
    let off: Vec<f64> = run(&plant, &u)[0].iter().zip(&predicted[0]).map(|(y, p)| y + level - p).collect();
    assert!(rms(&off) < 0.01 * rms(&run(&plant, &u)[0]), "{}", rms(&off));
}

/// A model with one state too few is identified from a record that is set aside. Its errors on the other records look
/// like a lag and a gain, but these effects leave a larger remainder than a third state does.
#[test]
fn one_state_too_few_is_no_effect() {
    for (states, verdict) in [(2, Verdict::Unknown), (3, Verdict::None)] {
        let mut case = case(&oven(&[40.0, 12.0, 4.0]));
        case.for_simulation = vec![case.records.remove(1)];
        case.model = None;
        case.config.sim = None;
        case.config.states = Some(states);
        let found = diagnosed(&case);
        assert_eq!((found.verdict, found.effects.len()), (verdict, 0), "{}", found.sentence);
        let lacks = found.sentence.contains("too few states") && found.sentence.contains("with 3 instead of 2");
        assert_eq!(lacks, states == 2, "{}", found.sentence);
    }
}
