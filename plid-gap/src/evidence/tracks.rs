//! An adaptive PLID run follows the plant from record to record.
//!
//! An adaptive filter hides a gap, because its innovations stay small. To keep them small, however, its parameters must
//! follow whatever changes. A resonance that follows the level is evidence of a nonlinearity; one that follows time is
//! evidence of a drift. The diagnosis rests on free runs and does not use this evidence.

use nalgebra::DMatrix;
use ndarray::{Array2, aview1};
use plid_backends::Plain;
use plid_core::{IdentifiedModel, Identifier, NoiseModel, ObservableForm, Settings};
use plid_model::{ModeKind, Model};
use plid_variants::covariance::BiermanUd;
use plid_variants::expectations::MomentMatched;

use crate::case::record::{Record, rms};
use crate::evidence::trend::{Point, trend};
use crate::plant::Plant;
use crate::settings::{EvidenceSettings, GapSettings};

/// The recursion that follows the plant. Its covariance form keeps P positive definite, and its expectations are the
/// default ones.
type Filter = Identifier<BiermanUd<Plain<f64>>, MomentMatched<f64>>;

/// A record in an adaptive run.
#[derive(Debug, Clone, PartialEq)]
pub struct Passed {
    /// Name of the record.
    pub record: String,
    /// RMS of its inputs.
    pub level: f64,
    /// Start of the record in s.
    pub start_s: f64,
    /// RMS of the innovations in the second half of the record, each output over its noise.
    pub innovations: f64,
    /// For each mode of the simulation, frequency (Hz) and damping ratio of the nearest mode of the model after the
    /// record; `None` if no mode is near.
    pub modes: Vec<Option<(f64, f64)>>,
}

/// The run over all records that drive the structure.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tracks {
    /// The records in order.
    pub passed: Vec<Passed>,
}

/// Largest number of samples of each record that the filter uses, to bound its time.
const SAMPLES: usize = 4000;

/// Largest number of states: the time of a step grows with their square.
const STATES: usize = 36;

/// Factor on the parameters' variances from one record to the next, so that they can follow a change.
const WIDENED: f64 = 100.0;

/// Variance of a state's noise over that of a sensor: small, because a large one would hide what the parameters follow.
const STATE_NOISE: f64 = 1e-3;

impl Tracks {
    /// Runs PLID over the records. The result is empty if no record is driven or the filter fails; the diagnosis does
    /// not need it.
    pub fn of(plant: &Plant, records: &[Record], noise: &[f64], settings: &EvidenceSettings) -> Self {
        let driven: Vec<&Record> = records.iter().filter(|r| r.is_driven()).collect();
        Self { passed: follow(plant, &driven, noise, settings).unwrap_or_default() }
    }

    /// States the trend of the mode that follows the level or time most clearly; `None` if no trend exceeds its
    /// scatter.
    pub fn words(&self, plant: &Plant, settings: &GapSettings) -> Option<String> {
        let least = settings.evidence.tracked_records;
        let trends =
            (0..plant.modes.len()).filter_map(|mode| Some((mode, trend(&self.points(mode), least, settings)?)));
        let (mode, strongest) = trends.max_by(|a, b| a.1.clear.total_cmp(&b.1.clear))?;
        let words = strongest.words(plant.modes[mode].hz(), &settings.evidence)?;
        Some(format!("An adaptive PLID run moves {words}."))
    }

    /// Returns the resonance of a mode in each record.
    fn points(&self, mode: usize) -> Vec<Point> {
        let seen = self.passed.iter().filter_map(|p| Some((p, p.modes[mode]?)));
        seen.map(|(p, (hz, damping))| Point {
            level: p.level,
            start_s: p.start_s,
            hz,
            hz_std: RESOLUTION * hz,
            damping,
        })
        .collect()
    }
}

/// Relative change of a frequency that one record cannot resolve.
const RESOLUTION: f64 = 1e-4;

fn follow(plant: &Plant, driven: &[&Record], noise: &[f64], settings: &EvidenceSettings) -> Option<Vec<Passed>> {
    let (m, p) = (plant.m, plant.p);
    let states = plant.seen_states().min(STATES);
    let form = ObservableForm::new(&vec![states.div_ceil(p); p], m).ok()?;
    let all =
        |of: &dyn Fn(&Record) -> &Vec<f64>| rms(driven.iter().flat_map(|r| of(r).iter().filter(|x| x.is_finite())));
    let u_scale: Vec<f64> = (0..m).map(|i| all(&|r| &r.u[i]).max(f64::MIN_POSITIVE)).collect();
    let y_scale: Vec<f64> = (0..p).map(|o| all(&|r| &r.y[o]).max(f64::MIN_POSITIVE)).collect();
    let sensor: Vec<f64> = noise.iter().zip(&y_scale).map(|(rms, scale)| (rms / scale).powi(2)).collect();
    let mean = sensor.iter().sum::<f64>() / p as f64;
    let noise_model = NoiseModel::diagonal(&sensor, &vec![0.0; m], &vec![STATE_NOISE * mean; states.div_ceil(p) * p]);
    let start = Settings::new(&form, 1.0, 1.0);
    let mut carried = start.clone();
    let mut passed = Vec::new();
    for record in driven {
        let samples = record.samples().min(SAMPLES);
        let mut filter = Filter::new(form.clone(), &noise_model, &carried).ok()?;
        let mut innovations = Array2::from_elem((samples, p), f64::NAN);
        for k in 0..samples {
            // An acceleration responds at once, but the form is strictly proper, so the input is taken one sample
            // ahead.
            let ahead = (k + 1).min(record.samples() - 1);
            let u: Vec<f64> = (0..m).map(|i| record.u[i][ahead] / u_scale[i]).collect();
            let z: Vec<f64> = (0..p).map(|o| record.y[o][k] / y_scale[o]).collect();
            filter.step_with_missing(&z, &u).ok()?;
            innovations.row_mut(k).assign(&aview1(filter.innovation()));
        }
        let late = |o: usize| rms(innovations.column(o).iter().skip(samples / 2).filter(|e| e.is_finite()));
        let innovations = (0..p).map(|o| (late(o) * y_scale[o] / noise[o]).powi(2)).sum::<f64>() / p as f64;
        let identified = filter.identified();
        passed.push(Passed {
            record: record.name.clone(),
            level: record.level(),
            start_s: record.start_s,
            innovations: innovations.sqrt(),
            modes: nearest(plant, &identified, settings),
        });
        carried = start.carry_over(&form, &identified, WIDENED);
    }
    Some(passed)
}

/// Returns, for each mode of the simulation, the frequency and the damping ratio of the model's nearest mode; `None`
/// if no mode is near.
fn nearest(plant: &Plant, identified: &IdentifiedModel, settings: &EvidenceSettings) -> Vec<Option<(f64, f64)>> {
    let (a, b, c) = ((&identified.a).into(), (&identified.b).into(), (&identified.c).into());
    let model = Model::new(plant.rate, a, b, c, DMatrix::zeros(plant.p, plant.m));
    let Ok(found) = model.and_then(|model| plid_model::modes(&model)) else { return vec![None; plant.modes.len()] };
    let EvidenceSettings { tracked_damping, tracked_distance, .. } = *settings;
    let oscillatory =
        found.iter().filter(|mode| mode.kind == ModeKind::Oscillatory && mode.damping.abs() < tracked_damping);
    let found: Vec<(f64, f64)> = oscillatory.map(|mode| (mode.hz, mode.damping)).collect();
    let of = |hz: f64| {
        let near = found.iter().filter(|(f, _)| (f / hz - 1.0).abs() < tracked_distance);
        near.min_by(|a, b| (a.0 / hz - 1.0).abs().total_cmp(&(b.0 / hz - 1.0).abs())).copied()
    };
    plant.modes.iter().map(|mode| of(mode.hz())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{RATE, case, truss};

    /// Returns the tracks of records of a truss whose first mode is shifted by `shift` in each of them, and the
    /// truss.
    fn tracks(shift: &dyn Fn(&Record) -> f64) -> (Tracks, Plant) {
        let sim = truss(3);
        let plant = Plant::new(&sim).unwrap();
        let mut all = Vec::new();
        for seed in 0..2 {
            for (k, level) in [1.0, 0.4, 0.7, 0.2].into_iter().enumerate() {
                let mut record = case(&sim, &sim).records[1].clone();
                record.u = crate::testing::random_input(40 + 10 * seed + k as u64, 3072, sim.m());
                record.u.iter_mut().flatten().for_each(|u| *u *= level);
                record.start_s = (4 * seed as usize + k) as f64 * 3072.0 / RATE;
                let mut moved = plant.clone();
                moved.move_pole(0, plant.modes[0].pole * (1.0 + shift(&record)));
                record.y = crate::testing::run(&moved.to_model(&sim), &record.u);
                all.push(record);
            }
        }
        all.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        (Tracks::of(&plant, &all, &vec![1e-4; plant.p], &EvidenceSettings::default()), plant)
    }

    #[test]
    fn a_resonance_that_follows_the_level_is_told() {
        let (tracks, plant) = tracks(&|record| -0.01 * record.level());
        assert_eq!(tracks.passed.len(), 8);
        let words = tracks.words(&plant, &GapSettings::default()).unwrap();
        assert!(
            words.contains(&crate::plant::plain_hz(plant.modes[0].hz())) && words.contains("from level 0.2"),
            "{words}"
        );
        assert!(words.contains("by -0.7") || words.contains("by -0.8"), "{words}");
    }

    #[test]
    fn a_resonance_that_follows_the_time_is_told() {
        let (tracks, plant) = tracks(&|record| 0.001 * record.start_s);
        let words = tracks.words(&plant, &GapSettings::default()).unwrap();
        assert!(words.contains(" s to "), "{words}");
    }

    #[test]
    fn what_stays_is_not() {
        let (tracks, plant) = tracks(&|_| 0.0);
        assert_eq!(tracks.words(&plant, &GapSettings::default()), None);
    }
}
