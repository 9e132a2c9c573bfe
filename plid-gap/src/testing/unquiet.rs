//! Records of which none shows the noise level. The process is disturbed whenever it is driven, and it is always
//! driven.

use nalgebra::dmatrix;
use plid_model::Model;

use crate::case::{Case, CaseConfig};
use crate::effects::Library;
use crate::judge::verdict::Verdict;
use crate::testing::{random_input, record};

const SAMPLES: usize = 1500;

/// Length in samples of a step of the input.
const HOLD: usize = 5;

/// Returns a process with two time constants, whose output is the temperature after both.
fn process() -> Model {
    let (a, b) = (dmatrix![0.9, 0.05; 0.0, 0.8], dmatrix![0.02; 0.2]);
    Model::new(1.0, a, b, dmatrix![1.0, 0.0], dmatrix![0.0]).unwrap()
}

/// Returns a case of two records that are driven by steps. At each sample, `bend`, a function of the input and of the
/// first state, is added to the input.
fn case(seed: u64, disturbance: f64, bend: fn(f64, f64) -> f64) -> Case {
    let model = process();
    let measured = |k: u64| {
        let drawn = &random_input(seed + k, SAMPLES, 1)[0];
        let u: Vec<f64> = (0..SAMPLES).map(|n| drawn[n / HOLD].signum() * (0.5 + drawn[n / HOLD].abs())).collect();
        let noise = random_input(seed + k + 100, SAMPLES, 2);
        let (mut x, mut y) = ([0.0; 2], Vec::new());
        for (n, u) in u.iter().enumerate() {
            y.push(x[0] + 0.005 * noise[0][n]);
            let u = u + bend(*u, x[0]);
            let next = |i: usize| model.a[(i, 0)] * x[0] + model.a[(i, 1)] * x[1] + model.b[i] * u;
            x = [next(0) + disturbance * noise[1][n], next(1)];
        }
        record(vec![u], vec![y])
    };
    let mut records: Vec<_> = (0..2).map(measured).collect();
    records[1].start_s = SAMPLES as f64;
    records[1].name = "random-2".into();
    let config = CaseConfig::new(1.0, vec!["u1".into()], vec!["y1".into()]);
    let model = Some(Model { inputs: config.inputs.clone(), outputs: config.outputs.clone(), ..model });
    Case { config, model, records, for_simulation: Vec::new(), controller: None, warnings: Vec::new() }
}

/// A disturbance that the inputs do not predict is noise, whatever its size and spectrum. The same gap is not noise if
/// it is due to a product of input and output, which no effect of the vocabulary contains.
#[test]
fn a_disturbance_is_noise_and_a_product_is_not() {
    let library = Library::standard();
    for seed in [1, 2] {
        let disturbed = case(seed, 0.02, |_, _| 0.0);
        let found = crate::diagnose(&disturbed, &library, &mut |_| {}).unwrap().diagnosis;
        assert_eq!(found.verdict, Verdict::None, "{}", found.sentence);
        assert!(found.gap.as_given > 0.1 && found.gap.noise_floor > 0.8 * found.gap.as_given, "{}", found.sentence);
        // Without a known noise level, something else remains possible.
        let unknown = found.candidates.iter().find(|candidate| candidate.unknown).unwrap();
        assert!((0.05..0.5).contains(&unknown.probability), "{}", unknown.probability);

        let product = case(seed, 0.001, |u, y| 0.6 * u * y);
        let found = crate::diagnose(&product, &library, &mut |_| {}).unwrap().diagnosis;
        assert!(found.gap.as_given > 0.1, "{}", found.sentence);
        assert_eq!(found.verdict, Verdict::Unknown, "{}", found.sentence);
    }
}

/// The sharpness of a limit is found together with its level.
#[test]
fn a_sharp_limit_of_the_command_is_named() {
    let limited = case(5, 0.001, |u: f64, _| u.clamp(-0.9, 0.9) - u);
    let found = crate::diagnose(&limited, &Library::standard(), &mut |_| {}).unwrap().diagnosis;
    assert_eq!(found.verdict, Verdict::Effects, "{}", found.sentence);
    let [effect] = &found.effects[..] else { panic!("{}", found.sentence) };
    assert_eq!(effect.effect, "actuator-saturation", "{}", found.sentence);
    let value = |name: &str| effect.parameters[name].value;
    assert!((value("a") / 0.9 - 1.0).abs() < 0.03 && value("r").abs() < 0.2, "{} {}", value("a"), value("r"));
}
