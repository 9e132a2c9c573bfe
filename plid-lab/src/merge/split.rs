//! Division of an experiment into runs, in each of which one input acts.

use std::path::{Path, PathBuf};

use plid_testbed::{InputConfig, TrussConfig};

use super::{MergeError, REST};
use crate::experiment::{
    Covariance, DataConfig, Experiment, IdentificationConfig, NoiseConfig, Refinement, StructureConfig, StructureKind,
    ValidationConfig,
};
use crate::run::RunError;
use plid_data::{self as data, MissingPolicy};

/// Returns the experiments of the runs, each named after its active input, with a number if the input is active in
/// several. Their paths are absolute.
pub(super) fn split(experiment: &Experiment, base: &Path) -> Result<Vec<(String, Experiment)>, RunError> {
    let data = &experiment.data;
    let parts = match &data.testbed {
        Some(testbed) => {
            let all: Vec<String> = (1..=plid_testbed::INPUTS).map(|j| format!("u{j}")).collect();
            let inputs = if data.inputs.is_empty() { all.clone() } else { data.inputs.clone() };
            let mut parts = Vec::new();
            for (run, input) in inputs.iter().enumerate() {
                let Some(place) = all.iter().position(|name| name == input) else {
                    let reason = format!("the truss has {}, not `{input}`", all.join(", "));
                    return Err(RunError::Setting { key: "inputs", reason });
                };
                let mut testbed = testbed.clone();
                testbed.truss = one_at_a_time(&testbed.truss, place, run, inputs.len())?;
                let data = DataConfig { inputs: vec![input.clone()], testbed: Some(testbed), ..data.clone() };
                parts.push((run, data));
            }
            parts
        }
        None => acting(data, base)?
            .into_iter()
            .zip(&data.files)
            .map(|(place, file)| {
                let inputs = vec![data.inputs[place].clone()];
                Ok((place, DataConfig { inputs, files: vec![absolute(base, file)?], ..data.clone() }))
            })
            .collect::<Result<_, RunError>>()?,
    };
    let mut names: Vec<String> = Vec::new();
    let mut experiments = Vec::new();
    for (place, data) in parts {
        let input = data.inputs[0].clone();
        let earlier = names.iter().filter(|name| **name == input).count();
        let name = if earlier == 0 { input.clone() } else { format!("{input}-{}", earlier + 1) };
        names.push(input);
        let part = Experiment {
            name: format!("{} {name}", experiment.name),
            data,
            structure: StructureConfig { kind: StructureKind::Mimo, ..experiment.structure.clone() },
            noise: of_one_input(&experiment.noise, place, base)?,
            validation: ValidationConfig { file: None, ..experiment.validation.clone() },
            // The merge uses the recursive estimates; a refined model has no Gaussian posterior in canonical form.
            identification: IdentificationConfig { refine: Refinement::Off, ..experiment.identification.clone() },
            ..experiment.clone()
        };
        experiments.push((name, part));
    }
    Ok(experiments)
}

/// Returns the truss with one active input, for its share of the duration and with independent noise.
fn one_at_a_time(truss: &TrussConfig, place: usize, run: usize, runs: usize) -> Result<TrussConfig, RunError> {
    let mut truss = truss.clone();
    let samples = truss.samples()? / runs;
    truss.duration_s = samples as f64 / truss.sample_rate_hz;
    // The offset is far from the seeds that users choose, so that no two records of a series of seeds have the same
    // noise.
    truss.seed = truss.seed.wrapping_add((run as u64 + 1) << 32);
    let levels = match &mut truss.input {
        InputConfig::Zero => None,
        InputConfig::WhiteNoise(input) => Some(&mut input.level_rms_v),
        InputConfig::Multisine(input) => Some(&mut input.level_rms_v),
        InputConfig::Chirp(input) => Some(&mut input.level_rms_v),
    };
    match levels {
        Some(levels) if levels[place] > 0.0 => {
            (0..levels.len()).filter(|&j| j != place).for_each(|j| levels[j] = 0.0);
            Ok(truss)
        }
        _ => {
            Err(MergeError::NeverActs { input: format!("u{}", place + 1), records: "the testbed's input".into() }
                .into())
        }
    }
}

/// Returns the active input of each file.
fn acting(data: &DataConfig, base: &Path) -> Result<Vec<usize>, RunError> {
    let mut sizes = Vec::new();
    for file in &data.files {
        let table = data::read(&base.join(file), data.variable.as_deref())?;
        let inputs = data::channels(&table, &data.inputs, MissingPolicy::Error)?;
        sizes.push(inputs.columns().into_iter().map(|u| u.std(0.0)).collect::<Vec<f64>>());
    }
    let largest = |place: usize| sizes.iter().map(|file| file[place]).fold(0.0, f64::max);
    let of_largest = |file: &[f64], place: usize| if file[place] > 0.0 { file[place] / largest(place) } else { 0.0 };
    let mut acting = Vec::new();
    for (sizes, file) in sizes.iter().zip(&data.files) {
        let record = file.display().to_string();
        let at_work: Vec<usize> = (0..sizes.len()).filter(|&place| of_largest(sizes, place) > REST).collect();
        match at_work[..] {
            [place] => acting.push(place),
            [] => return Err(MergeError::NoneActs { record, inputs: data.inputs.join(", ") }.into()),
            [..] => {
                let mut by_size = at_work;
                by_size.sort_by(|&a, &b| of_largest(sizes, b).total_cmp(&of_largest(sizes, a)));
                return Err(MergeError::AnotherActs {
                    record,
                    acting: data.inputs[by_size[0]].clone(),
                    other: data.inputs[by_size[1]].clone(),
                    share: of_largest(sizes, by_size[1]),
                }
                .into());
            }
        }
    }
    if let Some(place) = (0..data.inputs.len()).find(|place| !acting.contains(place)) {
        let records = data.files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join(", ");
        return Err(MergeError::NeverActs { input: data.inputs[place].clone(), records }.into());
    }
    Ok(acting)
}

/// Returns the part of the noise config that concerns one input.
fn of_one_input(noise: &NoiseConfig, place: usize, base: &Path) -> Result<NoiseConfig, RunError> {
    let row = |rows: &Option<Vec<Vec<f64>>>| rows.as_ref().map(|rows| rows.get(place).cloned().into_iter().collect());
    Ok(NoiseConfig {
        actuator: match &noise.actuator {
            Some(Covariance::Diagonal(list)) => {
                Some(Covariance::Diagonal(list.get(place).copied().into_iter().collect()))
            }
            other => other.clone(),
        },
        actuator_sensor: row(&noise.actuator_sensor),
        actuator_state: row(&noise.actuator_state),
        zero_input_file: noise.zero_input_file.as_ref().map(|file| absolute(base, file)).transpose()?,
        ..noise.clone()
    })
}

/// Returns an absolute path, because a run does not depend on the working directory.
fn absolute(base: &Path, file: &Path) -> Result<PathBuf, RunError> {
    let path = base.join(file);
    std::fs::canonicalize(&path).map_err(|source| RunError::File { path, source })
}
