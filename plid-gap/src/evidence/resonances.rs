//! The resonances of each record alone: a linear refit to a single record moves the simulation's modes.
//!
//! A resonance that follows the level suggests a nonlinearity of the structure; one that follows time suggests a drift.
//! The diagnosis does not use this evidence.

use crate::case::Limits;
use crate::evidence::trend::{Point, Trend, trend};
use crate::fit::nuisance::Nuisance;
use crate::fit::problem::{Problem, sum_of_squares};
use crate::fit::refit::refit;
use crate::noise::NoiseModel;
use crate::plant::Plant;
use crate::settings::{EvidenceSettings, GapSettings};

/// Limits of a record's own modes around those of all records. They are far wider than the errors of any simulation,
/// so that the record alone determines the modes.
const LIMITS: Limits = Limits { frequency: 0.1, damping: 2.0, shape: 0.4 };

/// Largest number of steps of a record's own refit.
const STEPS: usize = 12;

/// Largest number of samples of a record that are used, to bound the time of the fit.
const SAMPLES: usize = 8192;

/// Frequency and damping ratio of a mode in one record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resonance {
    /// Frequency in Hz.
    pub hz: f64,
    /// Its standard deviation.
    pub hz_std: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Its standard deviation.
    pub damping_std: f64,
}

/// One record alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Alone {
    /// Name of the record.
    pub record: String,
    /// RMS of its inputs.
    pub level: f64,
    /// Start in s.
    pub start_s: f64,
    /// The resonance of each mode of the simulation; `None` if the record does not determine it.
    pub modes: Vec<Option<Resonance>>,
}

/// Fits the simulation to each driven record alone, among the records that are fitted. `plant` is the simulation after
/// the bounded refit.
pub fn each_alone(problem: &Problem, plant: &Plant, noise: &NoiseModel) -> Vec<Alone> {
    let driven = |index: &usize| {
        let record = &problem.records[*index];
        record.is_driven()
    };
    (0..problem.records.len()).filter(driven).map(|index| alone(problem, plant, noise, index)).collect()
}

fn alone(problem: &Problem, plant: &Plant, noise: &NoiseModel, index: usize) -> Alone {
    let record = &problem.records[index];
    let whole = Problem {
        plant: plant.clone(),
        records: vec![record.clone()],
        whiteners: vec![problem.whiteners[index].clone()],
        nuisance: Nuisance::new(plant, std::slice::from_ref(record), &LIMITS),
        setting: problem.setting.clone(),
        settings: problem.settings.clone(),
        longer: Vec::new(),
        strong: false,
    };
    let own = if record.samples() > SAMPLES { whole.head(SAMPLES, noise) } else { whole };
    let fitted = refit(&own, STEPS);
    // The residual that a linear model leaves widens the intervals.
    let inflation = (sum_of_squares(&fitted.residual) / own.values().max(1.0)).max(1.0);
    let covariance = fitted.jacobian.normal.clone().cholesky().map(|factor| factor.inverse() * inflation);
    let deviation = |entry: usize| covariance.as_ref().map_or(f64::INFINITY, |c| c[(entry, entry)].max(0.0).sqrt());
    let EvidenceSettings { frequency_narrowed, damping_narrowed, .. } = problem.settings.evidence;
    let mut modes = vec![None; plant.modes.len()];
    for entry in 0..own.nuisance.len() {
        let Some((mode, 0)) = own.nuisance.entry(entry) else { continue };
        let [frequency, damping] = [deviation(entry), deviation(entry + 1)];
        let prior = &own.nuisance.std[entry..entry + 2];
        if frequency < frequency_narrowed * prior[0] && damping < damping_narrowed * prior[1] {
            let found = &fitted.plant.modes[mode];
            modes[mode] = Some(Resonance {
                hz: found.hz(),
                hz_std: frequency * found.hz(),
                damping: found.damping(),
                damping_std: damping * found.damping(),
            });
        }
    }
    Alone { record: record.name.clone(), level: record.level(), start_s: record.start_s, modes }
}

/// Returns the modes that enough records show, with their trends. The mode that follows the level or the time most
/// clearly comes first.
pub fn by_trend(alone: &[Alone], settings: &GapSettings) -> Vec<(usize, Trend)> {
    let modes = alone.first().map_or(0, |alone| alone.modes.len());
    let least = settings.evidence.trend_records;
    let of = |mode: usize| Some((mode, trend(&points(alone, mode), least, settings)?));
    let mut trends: Vec<(usize, Trend)> = (0..modes).filter_map(of).collect();
    trends.sort_by(|a, b| b.1.clear.total_cmp(&a.1.clear));
    trends
}

/// Largest number of modes in the sentence.
const TOLD: usize = 3;

/// States which modes follow the level or time beyond their scatter, the largest change first; `None` if no mode does.
pub fn words(alone: &[Alone], plant: &Plant, settings: &GapSettings) -> Option<String> {
    let words = |mode: usize, trend: &Trend| trend.words(plant.modes[mode].hz(), &settings.evidence);
    let told = by_trend(alone, settings)
        .into_iter()
        .filter_map(|(mode, trend)| Some((trend.change.abs(), words(mode, &trend)?)));
    let mut told: Vec<(f64, String)> = told.collect();
    told.sort_by(|a, b| b.0.total_cmp(&a.0));
    let told: Vec<String> = told.into_iter().take(TOLD).map(|(_, words)| words).collect();
    (!told.is_empty())
        .then(|| format!("A linear model that is fitted to each record separately moves {}.", told.join("; ")))
}

fn points(alone: &[Alone], mode: usize) -> Vec<Point> {
    let seen = alone.iter().filter_map(|alone| Some((alone, alone.modes[mode]?)));
    seen.map(|(alone, Resonance { hz, hz_std, damping, .. })| Point {
        level: alone.level,
        start_s: alone.start_s,
        hz,
        hz_std,
        damping,
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{Known, prepare};
    use crate::testing::{case, random_input, run, truss};
    use plid_fourier::C;

    /// Returns the resonances of records of a truss whose second mode is shifted by `shift` at each level, and the
    /// truss.
    fn found(shift: &dyn Fn(f64) -> C) -> (Vec<Alone>, Plant) {
        let sim = truss(3);
        let mut case = case(&sim, &sim);
        let plant = Plant::new(&sim).unwrap();
        for (k, level) in [(1, 1.0), (2, 0.4), (3, 0.7)] {
            let record = &mut case.records[k];
            record.u = random_input(20 + k as u64, 3072, sim.m());
            record.u.iter_mut().flatten().for_each(|u| *u *= level);
            let mut moved = plant.clone();
            moved.move_pole(1, plant.modes[1].pole * (C::ONE + shift(level)));
            record.y = run(&moved.to_model(&sim), &record.u);
            let noise = random_input(50 + k as u64, 3072, sim.p());
            for ((y, e), std) in
                record.y.iter_mut().zip(&noise).zip(case.model.as_ref().unwrap().noise.sensor_std.as_ref().unwrap())
            {
                y.iter_mut().zip(e).for_each(|(y, e)| *y += std * e);
            }
        }
        // The last record is held out.
        case.records.push(case.records[3].clone());
        let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        (each_alone(&ready.problem, &plant, &ready.noise), plant)
    }

    #[test]
    fn frequency_and_damping_of_each_record_are_found_within_their_deviations() {
        let (alone, plant) = found(&|level| C::from(0.02 * level));
        assert_eq!(alone.len(), 3);
        for (record, level) in alone.iter().zip([1.0, 0.4, 0.7]) {
            let mode = record.modes[1].expect("a lightly damped mode shows");
            let (hz, damping) = ((1.0 + 0.02 * level) * plant.modes[1].hz(), plant.modes[1].damping());
            assert!((mode.hz - hz).abs() < 4.0 * mode.hz_std, "{} for {hz}, {}", mode.hz, mode.hz_std);
            assert!((mode.damping - damping).abs() < 4.0 * mode.damping_std, "{} for {damping}", mode.damping);
            assert!(mode.hz_std < 1e-3 * hz);
        }
        let words = words(&alone, &plant, &GapSettings::default()).unwrap();
        assert!(words.contains("137.0 Hz by +1.1") && words.contains("from level 0."), "{words}");
    }

    #[test]
    fn what_stays_is_not_told() {
        let (alone, plant) = found(&|_| C::ZERO);
        assert_eq!(words(&alone, &plant, &GapSettings::default()), None);
    }
}
