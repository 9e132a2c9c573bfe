use super::super::{Advance, prepare as in_memory};
use super::*;
use crate::prepare::test_plants::Gaussian;
use crate::{MissingPolicy, read, select};
use ndarray_npy::WriteNpyExt;
use std::path::{Path, PathBuf};

/// Returns a record of two inputs and two outputs with direct feedthrough, which is longer than three blocks.
fn columns(missing: bool) -> Array2<f64> {
    let mut g = Gaussian::new(5);
    let mut all = Array2::from_shape_fn((3 * source::ROWS + 17, 4), |_| g.draw());
    for k in 0..all.nrows() {
        all[[k, 2]] = 100.0 + 3.0 * all[[k, 0]] + 0.1 * all[[k, 2]];
        all[[k, 3]] = -1e-3 * all[[k, 1]] + 1e-4 * all[[k, 3]];
    }
    if missing {
        all[[source::ROWS, 3]] = f64::NAN;
    }
    all
}

fn source_of(file: PathBuf) -> Source {
    let names = |all: &[&str]| all.iter().map(|&name| name.to_owned()).collect();
    Source {
        file,
        inputs: names(&["1", "2"]),
        outputs: names(&["3", "4"]),
        rate_hz: Some(50.0),
        missing: MissingPolicy::Nan,
    }
}

fn write(folder: &Path, name: &str, columns: &Array2<f64>) -> PathBuf {
    let path = folder.join(name);
    if name.ends_with("npy") {
        columns.write_npy(std::fs::File::create(&path).unwrap()).unwrap();
    } else {
        let line = |row: ndarray::ArrayView1<'_, f64>| row.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        let text: Vec<String> = columns.rows().into_iter().map(line).collect();
        std::fs::write(&path, text.join("\n")).unwrap();
    }
    path
}

fn same(a: &Array2<f64>, b: &Array2<f64>) -> bool {
    a.dim() == b.dim() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan())
}

#[test]
fn a_streamed_record_is_the_one_that_is_prepared_in_memory_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    for (name, advance, missing) in
        [("a.npy", Advance::No, false), ("b.npy", Advance::Auto, true), ("c.csv", Advance::Yes, true)]
    {
        let source = source_of(write(folder.path(), name, &columns(missing)));
        let how = Preparation { advance, ..Preparation::default() };
        let table = read(&source.file, None).unwrap();
        let (record, warnings) =
            select(&table, &source.inputs, &source.outputs, source.rate_hz, source.missing).unwrap();
        let whole = in_memory(vec![record], &[0.6], &how).unwrap();
        for window in [100_000, 1000] {
            let (prepared, streamed) = prepare(source.clone(), 0.6, &how, window, &mut |_, _, _| ()).unwrap();
            assert_eq!(streamed.warnings, warnings);
            assert_eq!(streamed.has_missing, missing);
            assert_eq!(prepared.advanced, usize::from(advance != Advance::No));
            assert_eq!(prepared.lines, whole.lines);
            assert_eq!(prepared.steps, whole.steps);
            assert_eq!([&prepared.input_scales, &prepared.output_scales], [&whole.input_scales, &whole.output_scales]);
            assert_eq!((streamed.samples, streamed.training), (whole.records[0].samples(), whole.training[0]));
            assert_eq!(streamed.window.start + prepared.training[0], whole.training[0]);
            let rows = s![streamed.window.clone(), ..];
            assert!(same(&prepared.records[0].outputs, &whole.records[0].outputs.slice(rows).to_owned()));
            assert!(same(&prepared.records[0].inputs, &whole.records[0].inputs.slice(rows).to_owned()));
            let mut at = 12_345;
            let mut parts = streamed.parts(at).unwrap();
            while let Some(part) = parts.next_part().unwrap() {
                let rows = s![at..at + part.inputs.nrows(), ..];
                assert!(same(&part.inputs, &whole.records[0].inputs.slice(rows).to_owned()));
                assert!(same(&part.outputs, &whole.records[0].outputs.slice(rows).to_owned()));
                at += part.inputs.nrows();
            }
            assert_eq!(at, streamed.samples);
            assert_eq!(parts.last_output(), whole.last_outputs[0].as_deref());
        }
    }
}

/// The bad values are in the second and third blocks, where a count within a block would be wrong.
#[test]
fn bad_cells_are_named_as_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let bad = |change: fn(&mut Array2<f64>)| {
        let mut all = columns(false);
        change(&mut all);
        all
    };
    let cases: [(&str, Array2<f64>); 4] = [
        ("nan.csv", bad(|all| all[[9000, 0]] = f64::NAN)),
        ("nan.npy", bad(|all| all[[9000, 0]] = f64::NAN)),
        ("large.csv", bad(|all| all[[20_000, 3]] = 1e80)),
        ("constant.npy", bad(|all| all.slice_mut(s![.., ..2]).fill(1.0))),
    ];
    for (name, columns) in cases {
        let source = source_of(write(folder.path(), name, &columns));
        let streamed = prepare(source.clone(), 0.6, &Preparation::default(), 100, &mut |_, _, _| ());
        let table = read(&source.file, None).unwrap();
        let whole = select(&table, &source.inputs, &source.outputs, source.rate_hz, source.missing);
        assert_eq!(streamed.unwrap_err().to_string(), whole.unwrap_err().to_string());
    }
}

#[test]
fn the_rate_comes_from_times_and_a_lost_sample_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.csv");
    let mut g = Gaussian::new(3);
    let rows: Vec<String> =
        (0..20_000).map(|k| format!("{:.4},{},{}", f64::from(k) / 1600.0, g.draw(), g.draw())).collect();
    let names = |name: &str| vec![name.to_owned()];
    let source = Source {
        file: path.clone(),
        inputs: names("u"),
        outputs: names("y"),
        rate_hz: None,
        missing: MissingPolicy::Error,
    };
    let go = |rows: &[String]| {
        std::fs::write(&path, format!("time,u,y\n{}\n", rows.join("\n"))).unwrap();
        prepare(source.clone(), 0.5, &Preparation::default(), 1000, &mut |_, _, _| ())
    };
    assert_eq!(go(&rows).unwrap().0.records[0].sample_rate_hz, 1600.0);
    // The second sample is the first of a block.
    for lost in [10_000, source::ROWS] {
        let mut rows = rows.clone();
        rows.remove(lost);
        let said = go(&rows).unwrap_err().to_string();
        assert!(said.contains(&format!("line {}:", lost + 2)), "{said}");
    }
}

/// A training share of less than half a sample leaves no sample to the divisors where the input is advanced.
#[test]
fn a_tiny_training_share_does_not_panic() {
    let folder = tempfile::tempdir().unwrap();
    let source = source_of(write(folder.path(), "a.npy", &columns(false)));
    let how = Preparation { advance: Advance::Yes, scaling: Scaling::Rms, ..Preparation::default() };
    let table = read(&source.file, None).unwrap();
    let (record, _) = select(&table, &source.inputs, &source.outputs, source.rate_hz, source.missing).unwrap();
    let whole = in_memory(vec![record], &[1e-6], &how).map(|prepared| prepared.training);
    let streamed = prepare(source, 1e-6, &how, 100, &mut |_, _, _| ()).map(|(prepared, _)| prepared.training);
    assert_eq!(format!("{streamed:?}"), format!("{whole:?}"));
}

#[test]
fn a_step_that_needs_the_whole_record_is_refused() {
    let source = source_of("none.npy".into());
    for text in ["decimate_to_hz = 10.0", "trend = \"linear\"", "repeats = { period = 10 }"] {
        let how: Preparation = toml::from_str(text).unwrap();
        let error = prepare(source.clone(), 0.5, &how, 10, &mut |_, _, _| ()).unwrap_err();
        assert!(matches!(error, PrepareError::NotInBlocks { .. }), "{error}");
    }
}
