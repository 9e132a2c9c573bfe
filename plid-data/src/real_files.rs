//! Tests with public benchmark records, which are not part of the project. If a file is not available, the test reports
//! that it was skipped.
use super::*;
use crate::real_file::real_file;

fn names(text: &str) -> Vec<String> {
    text.split_whitespace().map(str::to_owned).collect()
}

#[test]
fn f16_has_a_scalar_rate_and_trailing_commas() {
    let Some(path) = real_file("f16/F16Data_FullMSine_Level1.csv") else {
        return;
    };
    let table = read(&path, None).unwrap();
    assert_eq!(table.samples(), 73728);
    assert_eq!(table.names, names("Force Voltage Acceleration1 Acceleration2 Acceleration3"));
    assert_eq!(table.scalars["Fs"], 400.0);
    let (record, warnings) =
        select(&table, &names("Force"), &names("Acceleration1 Acceleration3"), None, MissingPolicy::Error).unwrap();
    assert_eq!(record.sample_rate_hz, 400.0);
    assert_eq!(warnings, []);
    // The second row of the file.
    assert_eq!(record.inputs[[1, 0]], -0.52401);
    assert_eq!(record.outputs.row(1).to_vec(), [-0.018391, -0.027533]);
}

#[test]
fn daisy_mat_is_one_matrix() {
    let Some(path) = real_file("daisy/flexibleStructure.mat") else {
        return;
    };
    let table = read(&path, None).unwrap();
    assert_eq!(table.columns.dim(), (8523, 30));
    assert_eq!(table.names[29], "30");
    let (_, warnings) = select(&table, &names("1 2"), &names("3 4 5"), None, MissingPolicy::Error).unwrap();
    assert!(matches!(warnings[..], [Warning::RateAssumed { .. }]));
}

#[test]
fn daisy_ascii_has_numbered_columns() {
    let Some(path) = real_file("daisy/CD_player_arm.dat") else {
        return;
    };
    let table = read(&path, None).unwrap();
    assert_eq!(table.columns.dim(), (2048, 4));
    assert_eq!(table.columns.row(0).to_vec(), [0.0531, -0.0313, 0.0495, 0.0342]);
}

#[test]
fn silverbox_is_read() {
    let Some(path) = real_file("silverbox/SNLS80mV.csv") else {
        return;
    };
    let table = read(&path, None).unwrap();
    assert_eq!(table.columns.dim(), (131_072, 2));
    assert_eq!(table.names, names("V1 V2"));
}
