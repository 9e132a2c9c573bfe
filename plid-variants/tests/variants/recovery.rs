//! A known plant from a record without noise: A, B and the transfer function come back.

use nalgebra::{Complex, DMatrix};
use plid_backends::{Faer, Nalgebra, Plain};
use plid_core::kernels::Kernels;
use plid_core::{NoiseModel, ObservableForm, Settings};
use plid_testkit::case::{Case, Plant, record, rng};
use plid_testkit::run::{Variant, identified};
use plid_testkit::test_every_variant;

/// The assumed noise is tiny, and there is none. `unique`: the entries of A that inputs and
/// outputs cannot tell are zero in the plant, and known to be.
fn case(indices: &[usize], unique: bool, seed: u64) -> Case {
    let (inputs, p, n) = (2, indices.len(), indices.iter().sum::<usize>());
    let mut rng = rng(seed);
    let random = if unique { Plant::random_unique } else { Plant::random };
    let plant = random(indices, inputs, 0.9, &mut rng);
    let silent = NoiseModel::diagonal(&vec![0.0; p], &[0.0; 2], &vec![0.0; n]);
    let (z, u) = record(&plant, &[silent], 400, &mut rng);
    let noise = vec![NoiseModel::diagonal(&vec![1e-8; p], &[0.0; 2], &vec![0.0; n])];
    let form = ObservableForm::new(indices, inputs).unwrap();
    let settings = if unique { Settings::of_unique_form(&form, 1.0, 10.0) } else { Settings::new(&form, 1.0, 10.0) };
    Case { indices: indices.to_vec(), inputs, plant, noise, settings, z, u }
}

/// C (z I - A)^-1 B on the unit circle.
fn response(a: &DMatrix<f64>, b: &DMatrix<f64>, outputs: &[usize], angle: f64) -> DMatrix<Complex<f64>> {
    let z = Complex::from_polar(1.0, angle);
    let complex = |m: &DMatrix<f64>| m.map(|x| Complex::new(x, 0.0));
    let resolvent = DMatrix::identity(a.nrows(), a.nrows()) * z - complex(a);
    let states = resolvent.lu().solve(&complex(b)).unwrap();
    DMatrix::from_fn(outputs.len(), b.ncols(), |i, j| states[(outputs[i], j)])
}

/// The largest errors of A, of B, and of the transfer function relative to its peak.
fn errors<S: Kernels>(variant: &Variant<S>, case: &Case) -> [f64; 3] {
    let model = identified(&variant.finish(case));
    let (n, m) = (case.states(), case.inputs);
    let a = DMatrix::from_fn(n, n, |i, j| model.a.at(i, j));
    let b = DMatrix::from_fn(n, m, |i, j| model.b.at(i, j));
    for (output, &state) in case.plant.outputs.iter().enumerate() {
        for j in 0..n {
            assert_eq!(model.c.at(output, j), f64::from(u8::from(j == state)));
        }
    }
    let (mut worst, mut peak) = (0.0_f64, 0.0_f64);
    for k in 0..200 {
        let angle = std::f64::consts::PI * (f64::from(k) + 0.5) / 200.0;
        let truth = response(&case.plant.a, &case.plant.b, &case.plant.outputs, angle);
        let found = response(&a, &b, &case.plant.outputs, angle);
        worst = worst.max((found - &truth).iter().map(|z| z.norm()).fold(0.0, f64::max));
        peak = peak.max(truth.iter().map(|z| z.norm()).fold(0.0, f64::max));
    }
    [(&a - &case.plant.a).amax(), (&b - &case.plant.b).amax(), worst / peak]
}

fn a_known_plant_is_recovered<S: Kernels>(variant: &Variant<S>) {
    let name = variant.label();
    for (indices, unique) in [(&[2, 2][..], false), (&[3, 1, 2], true), (&[3, 1, 2], false)] {
        let [a, b, transfer] = errors(variant, &case(indices, unique, 5));
        println!("{name} {indices:?}, unique {unique}: A {a:.1e}, B {b:.1e}, transfer function {transfer:.1e}");
        assert!(transfer < 1e-6, "{name} {indices:?}: transfer function {transfer:.1e}");
        if unique || indices == [2, 2] {
            assert!(a < 1e-6 && b < 1e-6, "{name} {indices:?}: A {a:.1e}, B {b:.1e}");
        } else {
            // Unequal indices: another A, of the same transfer function.
            assert!(a > 1e-3, "{name} {indices:?}: A {a:.1e}");
        }
    }
}

test_every_variant!(a_known_plant_is_recovered:
    plain_f64 = Plain<f64>,
    nalgebra_f64 = Nalgebra<f64>,
    faer_f64 = Faer<f64>,
);
