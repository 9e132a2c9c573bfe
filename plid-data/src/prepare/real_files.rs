//! Tests of the preparation with public benchmark records, if these are available.
use super::*;
use crate::real_file::real_file;
use crate::{MissingPolicy, read, select};

fn prepared(file: &str, inputs: &str, outputs: &str, how: &Preparation) -> Option<Prepared> {
    let names = |text: &str| -> Vec<String> { text.split_whitespace().map(str::to_owned).collect() };
    let table = read(&real_file(file)?, None).unwrap();
    let (record, _) = select(&table, &names(inputs), &names(outputs), None, MissingPolicy::Error).unwrap();
    Some(prepare(vec![record], &[0.75], how).unwrap())
}

const F16: &str = "f16/F16Data_FullMSine_Level1.csv";
const F16_OUTPUTS: &str = "Acceleration1 Acceleration2 Acceleration3";

#[test]
fn f16_answers_at_once_and_is_sampled_too_fast() {
    for (to_hz, advanced) in [(None, 1), (Some(50.0), 1)] {
        let how = Preparation { decimate_to_hz: to_hz, ..Preparation::default() };
        let Some(p) = prepared(F16, "Force", F16_OUTPUTS, &how) else {
            return;
        };
        eprintln!("{:#?}", p.advance_test);
        for said in &p.warnings {
            eprintln!("{said}");
        }
        assert_eq!(p.advanced, advanced);
        let suggested = p.warnings.iter().find_map(|w| match w {
            Warning::Oversampled { suggested_hz, .. } => Some(*suggested_hz),
            _ => None,
        });
        assert_eq!(suggested, if to_hz.is_none() { Some(50.0) } else { None });
    }
}

#[test]
fn f16_periods_show_its_noise() {
    let how: Preparation = toml::from_str("repeats = { period = 8192, skip = 1, tolerance = 0.05 }").unwrap();
    let Some(p) = prepared(F16, "Force", F16_OUTPUTS, &how) else {
        return;
    };
    let (noise, repeats) = &p.repeat_noise[0];
    assert_eq!(*repeats, 8);
    for (i, rms) in noise.rms().iter().enumerate() {
        let size = plid_model::signal::rms(p.records[0].outputs.column(i));
        eprintln!("noise of output {} over its RMS: {}", i + 1, rms / size);
        // The noise floor of this record is 0.85 % over all outputs.
        assert!((0.001..0.03).contains(&(rms / size)));
    }
}

#[test]
fn daisy_flexible_structure_answers_at_once() {
    let how = Preparation::default();
    let Some(p) = prepared("daisy/flexibleStructure.mat", "1 2", "3 4 5", &how) else {
        return;
    };
    assert_eq!(p.advanced, 1);
    assert_eq!(p.warnings, []);
}
