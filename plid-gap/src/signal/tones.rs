//! Lines in a residual: forces or voltages at one frequency that no command causes.

use std::f64::consts::TAU;

use crate::case::record::Record;
use crate::settings::SignalSettings;
use plid_fourier::C;

/// A spectral line.
#[derive(Debug, Clone, PartialEq)]
pub struct Tone {
    /// Frequency in Hz.
    pub hz: f64,
    /// Power of the line over the median of its neighbourhood.
    pub prominence: f64,
}

/// The neighbourhood in bins on each side. It begins beyond the main lobe of the window and ends near enough to lie
/// within a resonance.
const NEIGHBOURS: std::ops::Range<usize> = 3..13;

/// A stretch of a residual.
pub struct Stretch<'a> {
    /// Start in s since the first record began.
    pub start_s: f64,
    /// Residual (p channels).
    pub residual: &'a [Vec<f64>],
}

/// Returns the strongest lines, at most `most`. Their frequencies are refined over all stretches together, because the
/// phase of a line continues from one stretch to the next.
pub fn tones(stretches: &[Stretch], rate: f64, most: usize, settings: &SignalSettings) -> Vec<Tone> {
    let Some(longest) = stretches.iter().max_by_key(|s| s.residual[0].len()) else { return Vec::new() };
    let mut found: Vec<Tone> = Vec::new();
    let length = longest.residual[0].len();
    let mut power = vec![0.0; length / 2 + 1];
    for channel in longest.residual {
        let windowed: Vec<f64> =
            channel.iter().enumerate().map(|(k, x)| x * (1.0 - (TAU * k as f64 / length as f64).cos())).collect();
        let spectrum = plid_fourier::forward(&windowed);
        let size: f64 = spectrum.iter().map(|z| z.norm_sqr()).sum::<f64>().max(f64::MIN_POSITIVE);
        power.iter_mut().zip(&spectrum).for_each(|(p, z)| *p += z.norm_sqr() / size);
    }
    for k in 3..power.len().saturating_sub(3) {
        let peak = power[k] >= power[k - 1] && power[k] > power[k + 1];
        if !peak {
            continue;
        }
        let below = NEIGHBOURS.filter_map(|j| k.checked_sub(j).filter(|&at| at > 1).map(|at| power[at]));
        let above = NEIGHBOURS.filter_map(|j| power.get(k + j).copied());
        let mut near: Vec<f64> = below.chain(above).collect();
        near.sort_by(f64::total_cmp);
        let prominence = power[k] / near[near.len() / 2].max(f64::MIN_POSITIVE);
        if prominence > settings.line_prominence {
            found.push(Tone { hz: k as f64 * rate / length as f64, prominence });
        }
    }
    found.sort_by(|a, b| b.prominence.total_cmp(&a.prominence));
    found.truncate(most);
    let width = rate / length as f64;
    for tone in &mut found {
        tone.hz = refine(stretches, rate, tone.hz, width);
    }
    found
}

/// Returns the frequency within the width of a bin at which the coherent sum of all stretches is largest.
fn refine(stretches: &[Stretch], rate: f64, hz: f64, width: f64) -> f64 {
    let power = |hz: f64| -> f64 {
        (0..stretches[0].residual.len())
            .map(|o| {
                let all: C = stretches.iter().map(|s| line(&s.residual[o], s.start_s, rate, hz)).sum();
                all.norm_sqr()
            })
            .sum()
    };
    let best = |centre: f64, half: f64, steps: i32| {
        let at = |k: i32| centre + half * f64::from(k) / f64::from(steps);
        (-steps..=steps).map(at).max_by(|a, b| power(*a).total_cmp(&power(*b))).expect("not empty")
    };
    let last = stretches.iter().map(|s| s.start_s + s.residual[0].len() as f64 / rate).fold(0.0, f64::max);
    // The steps are a quarter of the width of a line in all stretches together.
    let steps = ((width * last * 4.0).ceil() as i32).clamp(4, 400);
    let coarse = best(hz, width, steps);
    best(coarse, width / f64::from(steps), 8)
}

fn line(x: &[f64], start_s: f64, rate: f64, hz: f64) -> C {
    let turn = C::cis(-TAU * hz / rate);
    let mut phase = C::cis(-TAU * hz * start_s);
    let mut sum = C::ZERO;
    for x in x {
        sum += phase * x;
        phase *= turn;
    }
    sum
}

/// Distance from a line, in units of the resolution 1 / duration, within which power belongs to the line. Without a
/// window, these bins hold at least nine tenths of the power of a line, wherever it lies between two bins.
const NEAR_LINE: f64 = 2.0;

/// Returns whether a line at `hz` may be the plant's response to the record's input: at least the share `driven` of the
/// input's power lies there, or most of the power lies at one frequency of which `hz` is a multiple. Such a record does
/// not show that the line has another cause.
pub fn is_driven(record: &Record, rate: f64, hz: f64, driven: f64) -> bool {
    let samples = record.samples();
    let resolution = rate / samples as f64;
    let harmonic = |fundamental: f64| (hz / fundamental - (hz / fundamental).round()).abs() * fundamental < resolution;
    record.u.iter().any(|u| {
        let spectrum = plid_fourier::forward(u);
        let all: f64 = spectrum[1..].iter().map(|z| z.norm_sqr()).sum();
        let about = |hz: f64| -> f64 {
            let near = |k: usize| (k as f64 * resolution - hz).abs() <= NEAR_LINE * resolution;
            (1..spectrum.len()).filter(|&k| near(k)).map(|k| spectrum[k].norm_sqr()).sum()
        };
        let strongest = (1..spectrum.len()).max_by(|&a, &b| spectrum[a].norm_sqr().total_cmp(&spectrum[b].norm_sqr()));
        let fundamental = strongest.map_or(resolution, |k| k as f64 * resolution);
        all > 0.0 && (about(hz) > driven * all || about(fundamental) > 0.5 * all && harmonic(fundamental))
    })
}

/// Returns the channels without these lines and those harmonics that hum has. Sines and cosines are fitted by least
/// squares to the samples that are not missing (NaN).
pub fn without(y: &[Vec<f64>], rate: f64, tones: &[Tone]) -> Vec<Vec<f64>> {
    let lines: Vec<f64> =
        tones.iter().flat_map(|tone| [1.0, 2.0, 3.0, 5.0].map(|h| h * tone.hz)).filter(|hz| *hz < 0.5 * rate).collect();
    if lines.is_empty() {
        return y.to_vec();
    }
    let samples = y[0].len();
    let columns = 2 * lines.len() + 1;
    let basis = nalgebra::DMatrix::from_fn(samples, columns, |k, j| {
        if j == columns - 1 {
            return 1.0;
        }
        let phase = TAU * lines[j / 2] * k as f64 / rate;
        if j % 2 == 0 { phase.cos() } else { phase.sin() }
    });
    let left = |y: &Vec<f64>| -> Option<Vec<f64>> {
        let there: Vec<usize> = (0..samples).filter(|&k| !y[k].is_nan()).collect();
        let seen = basis.select_rows(&there);
        let measured = nalgebra::DVector::from_iterator(there.len(), there.iter().map(|&k| y[k]));
        let lines = &basis * seen.tr_mul(&seen).cholesky()?.solve(&seen.tr_mul(&measured));
        Some(y.iter().zip(lines.iter()).map(|(y, line)| y - line).collect())
    };
    y.iter().map(|y| left(y).unwrap_or_else(|| y.clone())).collect()
}
