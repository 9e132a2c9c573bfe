//! The refinement on plants with known parameters.

use crate::common;

use common::{Data, options, plant, response_difference, silent, spoilt};
use nalgebra::{DMatrix, DVector};
use ndarray::s;
use plid_model::{ModelError, stability};
use plid_refine::{Candidate, Record, RefineError, Start, best_of, refine, slower_start};

#[test]
fn without_noise_the_plant_is_found_whatever_its_size_and_start() {
    for (odd, feedthrough, start) in [
        (false, false, Start::Rest),
        (false, true, Start::Unknown),
        (true, true, Start::Rest),
        (true, false, Start::Unknown),
    ] {
        let truth = plant(odd, feedthrough);
        let state = match start {
            Start::Rest => truth.rest(),
            Start::Unknown => DVector::from_fn(truth.n(), |i, _| 1.0 + i as f64),
        };
        let data = Data::new(&truth, 600, &state, 0.0, 1);
        let found = refine(&spoilt(&truth, 0.01), &[data.record(start)], &options(feedthrough), &silent).unwrap();
        let off = response_difference(&found.model, &truth);
        assert!(off < 1e-10, "odd {odd}, D {feedthrough}, {start:?}: {off:.1e} after {} steps", found.iterations);
        if !feedthrough {
            assert!(found.model.d.iter().all(|d| *d == 0.0));
        }
        // The initial state has other coordinates, so it is compared through its response.
        let run = plid_model::simulate(&found.model, data.inputs.view(), &found.initial_states[0]).unwrap().outputs;
        let error = (&run - &data.outputs).iter().fold(0.0_f64, |m, e| m.max(e.abs()));
        assert!(error < 1e-9, "{error}");
    }
}

#[test]
fn units_do_not_matter() {
    let truth = plant(false, true);
    let data = Data::new(&truth, 1500, &truth.rest(), 0.05, 2);
    let found = refine(&spoilt(&truth, 0.01), &[data.record(Start::Rest)], &options(true), &silent).unwrap();
    // The first output in thousandths, the second input in hundreds.
    let (mut inputs, mut outputs) = (data.inputs.clone(), data.outputs.clone());
    outputs.column_mut(0).mapv_inplace(|y| 1e3 * y);
    inputs.column_mut(1).mapv_inplace(|u| 1e-2 * u);
    let record = Record { inputs: inputs.view(), outputs: outputs.view(), start: Start::Rest };
    let mut start = spoilt(&truth, 0.01);
    start.c.row_mut(0).scale_mut(1e3);
    let mut other = refine(&start, &[record], &options(true), &silent).unwrap();
    assert!((other.residual_variances[0] / found.residual_variances[0] / 1e6 - 1.0).abs() < 1e-6);
    other.model.c.row_mut(0).scale_mut(1e-3);
    other.model.d.row_mut(0).scale_mut(1e-3);
    other.model.b.column_mut(1).scale_mut(1e-2);
    other.model.d.column_mut(1).scale_mut(1e-2);
    assert!(response_difference(&other.model, &found.model) < 1e-5);
}

#[test]
fn missing_samples_are_left_out() {
    let truth = plant(false, false);
    let mut data = Data::new(&truth, 800, &truth.rest(), 0.0, 3);
    data.outputs.slice_mut(s![100..140, 0]).fill(f64::NAN);
    data.outputs.slice_mut(s![300..330, ..]).fill(f64::NAN);
    let found = refine(&spoilt(&truth, 0.01), &[data.record(Start::Unknown)], &options(false), &silent).unwrap();
    assert!(response_difference(&found.model, &truth) < 1e-10);
}

#[test]
fn two_records_tell_as_much_as_one_of_both_lengths() {
    let truth = plant(false, false);
    let whole = Data::new(&truth, 4000, &truth.rest(), 0.1, 4);
    let record = whole.record(Start::Rest);
    let halves = [record.range(0, 2000), record.range(2000, 4000)];
    let one = refine(&spoilt(&truth, 0.005), &[record], &options(false), &silent).unwrap();
    let two = refine(&spoilt(&truth, 0.005), &halves, &options(false), &silent).unwrap();
    let hz = [5.6, 17.5];
    let std = |r: &plid_refine::Refined| r.uncertainty.response_variance(&hz).unwrap()[0].magnitude_std()[(0, 0)];
    // Only the state at the cut is lost.
    assert!((std(&one) / std(&two) - 1.0).abs() < 0.05, "{} {}", std(&one), std(&two));
    assert!(response_difference(&two.model, &one.model) < 0.01);
    let both = refine(&spoilt(&truth, 0.005), &halves[..1], &options(false), &silent).unwrap();
    assert!(std(&both) > 1.2 * std(&one), "half of the data tells less");
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let truth = plant(true, true);
    let data = Data::new(&truth, 1200, &truth.rest(), 0.1, 5);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let records = [data.record(Start::Unknown)];
            let base = plid_refine::subspace(&records, 5, None, 100.0, &options(true)).unwrap();
            let found = refine(&base.model, &records, &options(true), &silent).unwrap();
            (base.model, found.model)
        })
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn an_unstable_start_is_mended() {
    let truth = plant(false, false);
    let data = Data::new(&truth, 2000, &truth.rest(), 0.01, 6);
    let mut start = truth.clone();
    start.a *= 1.03;
    assert!(stability(&start).unwrap().spectral_radius > 1.0);
    let found = refine(&start, &[data.record(Start::Rest)], &options(false), &silent).unwrap();
    assert!(stability(&found.model).unwrap().spectral_radius <= 0.999);
    assert!(response_difference(&found.model, &truth) < 0.01, "{}", response_difference(&found.model, &truth));
}

#[test]
fn poles_that_meet_do_not_stop_it() {
    // The plant's real poles are equal where the start has a complex pair, and the other way round.
    let block = |c: f64, d: f64| nalgebra::DMatrix::from_row_slice(2, 2, &[c, 0.2, d / 0.2, c]);
    let b = nalgebra::DMatrix::from_row_slice(2, 1, &[1.0, 0.5]);
    let c = nalgebra::DMatrix::from_row_slice(1, 2, &[1.0, -0.3]);
    let model = |d: f64| {
        plid_model::Model::new(100.0, block(0.8, d), b.clone(), c.clone(), nalgebra::DMatrix::zeros(1, 1)).unwrap()
    };
    for (truth, start) in [(1e-4, -0.02), (-1e-4, 0.02), (0.0, -0.05), (-0.02, 0.01)] {
        let truth = model(truth);
        let data = Data::new(&truth, 400, &truth.rest(), 0.0, 7);
        let found = refine(&model(start), &[data.record(Start::Rest)], &options(false), &silent).unwrap();
        let off = response_difference(&found.model, &truth);
        assert!(off < 1e-8, "{off}");
    }
}

#[test]
fn the_better_start_is_taken() {
    let truth = plant(false, false);
    let data = Data::new(&truth, 2000, &truth.rest(), 0.05, 8);
    // A start whose modes lie elsewhere: a local minimum.
    let mut poor = truth.clone();
    poor.a = -&poor.a;
    let good = Candidate { name: "good".into(), model: spoilt(&truth, 0.005) };
    let poor = Candidate { name: "poor".into(), model: poor };
    let best_of =
        |starts: &[Candidate]| best_of(starts, &[data.record(Start::Rest)], &options(false), &silent).unwrap();
    let choice = best_of(&[poor.clone(), good.clone()]);
    assert!(choice.chosen >= 2, "{:?}", choice.scores);
    assert!(choice.scores[2].error < choice.scores[0].error);
    assert!(response_difference(&choice.refined.model, &truth) < 0.02);
    // After the good one, the poor one is not worth a refinement.
    let choice = best_of(&[good, poor]);
    assert!(choice.chosen < 2 && choice.scores.len() == 3, "{:?}", choice.scores);
    assert!(choice.scores[2].noise.is_none() && choice.scores[2].error > 2.0 * choice.scores[choice.chosen].error);
    assert!(response_difference(&choice.refined.model, &truth) < 0.02);
}

/// Three slow modes, sampled many times faster than they move: at an eighth of the rate their poles are found, and the
/// refinement at the records' own rate starts from there.
#[test]
fn a_start_is_found_at_a_lower_rate() {
    let poles = [(0.9985_f64, 0.03_f64), (0.998, 0.06), (0.997, 0.11)];
    let mut a = DMatrix::zeros(6, 6);
    for (k, (radius, angle)) in poles.iter().enumerate() {
        let (re, im) = (radius * angle.cos(), radius * angle.sin());
        let block = DMatrix::from_row_slice(2, 2, &[re, im, -im, re]);
        a.view_mut((2 * k, 2 * k), (2, 2)).copy_from(&block);
    }
    let (b, c) = (DMatrix::from_element(6, 1, 1.0), DMatrix::from_element(1, 6, 1.0));
    let truth = plid_model::Model::new(common::RATE, a, b, c, DMatrix::zeros(1, 1)).unwrap();
    // White noise through four low-passes lies below a fortieth of the rate.
    let mut inputs = common::normal(31, 12_000, 1);
    for _ in 0..4 {
        let mut state = 0.0;
        for u in &mut inputs {
            state += 0.15 * (*u - state);
            *u = state;
        }
    }
    let clean = plid_model::simulate(&truth, inputs.view(), &truth.rest()).unwrap().outputs;
    let size = (clean.iter().map(|y| y * y).sum::<f64>() / clean.len() as f64).sqrt();
    let outputs = clean + common::normal(32, 12_000, 1) * (0.02 * size);
    let data = Data { inputs, outputs };
    let records = [data.record(Start::Unknown)];
    let slow = |samples: usize| Record {
        inputs: data.inputs.slice(s![..samples;8, ..]),
        outputs: data.outputs.slice(s![..samples;8, ..]),
        start: Start::Unknown,
    };
    let start = slower_start(&[slow(12_000)], 6, 8, common::RATE, &options(false), &silent).unwrap();
    assert_eq!(start.sample_rate_hz, common::RATE);
    let found = start.a.complex_eigenvalues();
    for (radius, angle) in poles {
        let pole = nalgebra::Complex::from_polar(radius, angle);
        let off = found.iter().map(|z| (z - pole).norm()).fold(f64::INFINITY, f64::min);
        assert!(off < 1e-3, "{pole}: {off}");
    }
    let refined = refine(&start, &records, &options(false), &silent).unwrap();
    let error = plid_refine::free_run_error(&refined.model, &records[0], &refined.initial_states[0], 0).unwrap();
    assert!(error < 0.0202, "{error}");
    // Too few samples at the lower rate are an error.
    assert!(matches!(
        slower_start(&[slow(400)], 6, 8, common::RATE, &options(false), &silent),
        Err(RefineError::TooLittleData { .. })
    ));
}

#[test]
fn what_cannot_be_done_is_a_typed_error() {
    let truth = plant(false, false);
    let data = Data::new(&truth, 200, &truth.rest(), 0.0, 9);
    let record = data.record(Start::Rest);
    let run = |records: &[Record<'_>]| refine(&truth, records, &options(false), &silent).map(|_| ());
    assert!(matches!(run(&[]), Err(RefineError::NoRecords)));
    let few = run(&[record.range(0, 12)]);
    assert!(matches!(few, Err(RefineError::TooLittleData { needed: 25, available: 24, .. })), "{few:?}");
    let mut bad = data.inputs.clone();
    bad[(7, 1)] = f64::NAN;
    let error = run(&[Record { inputs: bad.view(), ..record }]);
    assert!(matches!(error, Err(RefineError::NotFinite { what: "the input", channel: 1, sample: 7, .. })), "{error:?}");
    let mut bad = data.outputs.clone();
    bad[(9, 0)] = f64::INFINITY;
    let error = run(&[Record { outputs: bad.view(), ..record }]);
    assert!(matches!(error, Err(RefineError::NotFinite { what: "the output", sample: 9, .. })), "{error:?}");
    bad.fill(0.0);
    let error = run(&[Record { outputs: bad.view(), ..record }]);
    assert!(matches!(error, Err(RefineError::EmptyChannel { channel: 0, .. })), "{error:?}");
    let narrow = Record { inputs: data.inputs.slice(s![.., ..1]), ..record };
    assert!(matches!(run(&[narrow]), Err(RefineError::Shape { expected: 2, found: 1, .. })));
    assert!(matches!(run(&[record, narrow]), Err(RefineError::Shape { record: 1, .. })));
    let mut broken = truth.clone();
    broken.a[(0, 0)] = f64::NAN;
    let error = refine(&broken, &[record], &options(false), &silent).map(|_| ());
    assert!(matches!(error, Err(RefineError::Model(ModelError::Key { .. }))), "{error:?}");
    let edge = plid_refine::Options { radius: 1.0, ..options(false) };
    let error = refine(&truth, &[record], &edge, &silent).map(|_| ());
    assert!(matches!(error, Err(RefineError::Setting { setting: "radius", .. })), "{error:?}");
    let stop = refine(&truth, &[record], &options(false), &|_, _| false).map(|_| ());
    assert!(matches!(stop, Err(RefineError::Interrupted)));
}
