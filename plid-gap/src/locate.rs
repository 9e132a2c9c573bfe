//! Where the gap lies: output x band x time x level, of the simulation as given.

use nalgebra::DMatrix;

use crate::noise::NoiseModel;
use crate::problem::Problem;
use crate::record::{Channels, Excitation, Record, rms};
use crate::simulate::Fineness;
use crate::transform;

/// Bands over which the gap is spread.
pub const BANDS: usize = 24;

/// Stretches of time over all records.
pub const STRETCHES: usize = 8;

/// The map of a gap. Shares are of the squared gap beyond the noise, each output scaled to unit RMS.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Edges of the bands in Hz ([`BANDS`] + 1).
    pub edges: Vec<f64>,
    /// Share of each output (p) in each band.
    pub share: DMatrix<f64>,
    /// Share of each stretch of time in each band.
    pub time: DMatrix<f64>,
    /// Level (RMS of the inputs) and relative gap beyond the noise, of each driven random record.
    pub levels: Vec<(f64, f64)>,
    /// Slope of log gap against log level.
    pub slope: Option<f64>,
}

/// Errors of a simulation (p channels), one for each record.
pub fn errors(problem: &Problem) -> Vec<Channels> {
    let eta = vec![0.0; problem.nuisance.len()];
    (0..problem.records.len())
        .map(|index| {
            let y = problem.outputs(&problem.plant, &eta, &[], index, Fineness::COARSE);
            error(&problem.records[index], &y)
        })
        .collect()
}

/// Measured minus simulated; zero where nothing was measured.
pub fn error(record: &Record, simulated: &[Vec<f64>]) -> Channels {
    let one = |(y, s): (&Vec<f64>, &Vec<f64>)| {
        y.iter().zip(s).map(|(y, s)| if y.is_finite() { y - s } else { 0.0 }).collect()
    };
    record.y.iter().zip(simulated).map(one).collect()
}

/// Draws the map.
pub fn map(records: &[Record], errors: &[Channels], noise: &NoiseModel, rate: f64) -> Map {
    let p = records[0].y.len();
    let edges: Vec<f64> = (0..=BANDS).map(|k| 0.5 * rate * k as f64 / BANDS as f64).collect();
    let scale: Vec<f64> = (0..p)
        .map(|o| 1.0 / rms(records.iter().flat_map(|r| r.y[o].iter().filter(|y| y.is_finite()))).max(1e-300))
        .collect();
    // Noise power of each output in each band, a sample.
    let quiet = DMatrix::from_fn(p, BANDS, |o, b| {
        let within =
            (0..4).map(|j| noise.density(edges[b] + (edges[b + 1] - edges[b]) * (f64::from(j) + 0.5) / 4.0)[(o, o)].re);
        within.sum::<f64>() / 4.0 / BANDS as f64
    });
    let samples: usize = records.iter().map(Record::samples).sum();
    let mut share = DMatrix::zeros(p, BANDS);
    let mut time = DMatrix::zeros(STRETCHES, BANDS);
    let mut levels = Vec::new();
    let mut at = 0;
    for (record, error) in records.iter().zip(errors) {
        let each = samples.div_ceil(STRETCHES);
        let (mut beyond, mut whole) = (0.0, 0.0);
        let mut from = 0;
        while from < record.samples() {
            let stretch = ((at + from) / each).min(STRETCHES - 1);
            let to = record.samples().min((stretch + 1) * each - at).max(from + 1);
            for o in 0..p {
                let power = band_power(&error[o][from..to]);
                for b in 0..BANDS {
                    let value = (power[b] - quiet[(o, b)] * (to - from) as f64) * scale[o] * scale[o];
                    share[(o, b)] += value;
                    time[(stretch, b)] += value;
                    beyond += value;
                }
                whole +=
                    record.y[o][from..to].iter().filter(|y| y.is_finite()).map(|y| (y * scale[o]).powi(2)).sum::<f64>();
            }
            from = to;
        }
        at += record.samples();
        if record.excitation == Excitation::Random && record.level() > 0.0 && whole > 0.0 {
            levels.push((record.level(), (beyond.max(0.0) / whole).sqrt()));
        }
    }
    let normalise = |m: &mut DMatrix<f64>| {
        m.iter_mut().for_each(|x| *x = x.max(0.0));
        let all = m.sum();
        if all > 0.0 {
            *m /= all;
        }
    };
    normalise(&mut share);
    normalise(&mut time);
    let slope = slope(&levels);
    Map { edges, share, time, levels, slope }
}

/// Energy in each band.
fn band_power(x: &[f64]) -> Vec<f64> {
    let mut power = vec![0.0; BANDS];
    let spectrum = transform::forward(x);
    let last = (spectrum.len() - 1).max(1);
    for (k, z) in spectrum.iter().enumerate() {
        let band = (k * BANDS / last).min(BANDS - 1);
        let weight = if k == 0 || 2 * k == x.len() { 1.0 } else { 2.0 };
        power[band] += weight * z.norm_sqr() / x.len() as f64;
    }
    power
}

fn slope(levels: &[(f64, f64)]) -> Option<f64> {
    let usable: Vec<(f64, f64)> =
        levels.iter().filter(|(level, gap)| *level > 0.0 && *gap > 0.0).map(|(l, g)| (l.ln(), g.ln())).collect();
    let n = usable.len() as f64;
    let (mean_x, mean_y) =
        (usable.iter().map(|(x, _)| x).sum::<f64>() / n, usable.iter().map(|(_, y)| y).sum::<f64>() / n);
    let square: f64 = usable.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
    if usable.len() < 2 || square < 0.02 {
        return None;
    }
    Some(usable.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>() / square)
}
