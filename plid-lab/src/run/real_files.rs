//! The accuracy that the refinement must reach on public benchmark records, if they are available.
use super::*;
use crate::experiment::from_toml;
use crate::real_file::real_file;

/// Returns the held-out free-run errors of the PLID model, the refined model and the subspace baseline.
fn errors(file: &str, channels: &str, rest: &str) -> Option<[f64; 3]> {
    let path = real_file(file)?;
    let text = format!("[data]\nfiles = [{path:?}]\n{channels}[validation]\ntraining_share = 0.7\n{rest}");
    let experiment = from_toml(&text, "test").unwrap();
    let outcome = carry_out(&experiment, Path::new("."), None, false, &Silent).unwrap();
    let simulation = &outcome.simulation;
    let overall = |errors: &Errors| errors.overall_relative;
    let refined = &simulation.refined.as_ref().unwrap().0.free_run_errors;
    let subspace = &simulation.subspace.as_ref().unwrap().free_run_errors;
    let found = [overall(&outcome.validation.free_run_errors), overall(refined), overall(subspace)];
    eprintln!("{file}: PLID, refined, subspace {found:?}");
    Some(found)
}

const F16: &str = "f16/F16Data_FullMSine_Level1.csv";
const F16_CHANNELS: &str =
    "inputs = [\"Force\"]\noutputs = [\"Acceleration1\", \"Acceleration2\", \"Acceleration3\"]\n";

/// The bank of filters is omitted for these long records, because the tests do not need it.
#[test]
fn f16_is_simulated_to_ten_per_cent() {
    for (rate, bound) in [("100.0", 0.10), ("50.0", 0.095)] {
        let rest = format!(
            "[structure]\nstates = 48\n[preparation]\ndecimate_to_hz = {rate}\nadvance = 1\n[noise]\nfrom = \
             \"paper-squared\"\n"
        );
        let Some([_, refined, subspace]) = errors(F16, F16_CHANNELS, &rest) else { return };
        assert!(refined <= bound && refined < subspace && subspace < 0.11, "{rate} Hz: {refined} {subspace}");
    }
}

#[test]
fn the_flexible_structure_is_simulated_to_five_and_a_half_per_cent() {
    let channels = "inputs = [\"1\", \"2\"]\noutputs = [\"3\", \"4\", \"5\"]\n";
    let Some([_, refined, subspace]) = errors("daisy/flexibleStructure.mat", channels, "[structure]\nstates = 36\n")
    else {
        return;
    };
    assert!(refined <= 0.056 && subspace < 0.06, "{refined} {subspace}");
}
