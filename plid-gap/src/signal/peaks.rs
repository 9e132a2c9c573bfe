//! Resonances that the simulation lacks: peaks in the frequency response of the residual.

use nalgebra::DMatrix;

use crate::plant::Plant;
use crate::settings::SignalSettings;
use plid_fourier::C;

/// Number of samples of a segment: the peak of a mode with a damping ratio of one per cent at a tenth of the sample
/// rate is then a few bins wide.
pub(crate) const SEGMENT: usize = 2048;

/// A resonance in the residual's frequency response.
#[derive(Debug, Clone, PartialEq)]
pub struct MissingModeStart {
    /// Frequency in Hz.
    pub hz: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Input shape (m).
    pub b: Vec<f64>,
    /// Output shape (p), of norm one.
    pub c: Vec<f64>,
}

/// A driven record: inputs (m channels) and errors (p channels).
pub struct Driven<'a> {
    /// Inputs (m channels).
    pub u: &'a [Vec<f64>],
    /// Errors (p channels).
    pub error: &'a [Vec<f64>],
}

/// Sums of the products of spectra over the segments of driven records.
struct Spectra {
    /// Products of the inputs, for each bin (m x m).
    uu: Vec<DMatrix<C>>,
    /// Products of the errors with the inputs, for each bin (p x m).
    eu: Vec<DMatrix<C>>,
    segments: usize,
}

impl Spectra {
    fn of(m: usize, p: usize, driven: &[Driven]) -> Self {
        let bins = SEGMENT / 2 + 1;
        let mut uu = vec![DMatrix::<C>::zeros(m, m); bins];
        let mut eu = vec![DMatrix::<C>::zeros(p, m); bins];
        let window: Vec<f64> = (0..SEGMENT)
            .map(|k| 0.5 - 0.5 * (std::f64::consts::TAU * (k as f64 + 0.5) / SEGMENT as f64).cos())
            .collect();
        let spectrum = |x: &[f64]| {
            let windowed: Vec<f64> = x.iter().zip(&window).map(|(x, w)| x * w).collect();
            plid_fourier::forward(&windowed)
        };
        let mut segments = 0;
        for Driven { u, error: e } in driven {
            let samples = e[0].len();
            let mut at = 0;
            while at + SEGMENT <= samples {
                let us: Vec<_> = u.iter().map(|u| spectrum(&u[at..at + SEGMENT])).collect();
                let es: Vec<_> = e.iter().map(|e| spectrum(&e[at..at + SEGMENT])).collect();
                for k in 0..bins {
                    for i in 0..m {
                        for j in 0..m {
                            uu[k][(i, j)] += us[i][k] * us[j][k].conj();
                        }
                        for o in 0..p {
                            eu[k][(o, i)] += es[o][k] * us[i][k].conj();
                        }
                    }
                }
                segments += 1;
                at += SEGMENT / 2;
            }
        }
        Self { uu, eu, segments }
    }
}

/// Returns the peaks of the residual's frequency response over driven records, the largest first. Each output counts
/// relative to its size (p). If there is a band in Hz, the peaks lie in it.
pub fn missing_modes(
    plant: &Plant,
    driven: &[Driven],
    sizes: &[f64],
    settings: &SignalSettings,
    band_hz: Option<[f64; 2]>,
) -> Vec<MissingModeStart> {
    let (m, p) = (plant.m, plant.p);
    let Spectra { uu, mut eu, segments } = Spectra::of(m, p, driven);
    if segments <= m {
        return Vec::new();
    }
    for eu in &mut eu {
        for (o, size) in sizes.iter().enumerate() {
            eu.row_mut(o).iter_mut().for_each(|x| *x /= *size);
        }
    }
    let bins = SEGMENT / 2 + 1;
    let hz = |k: usize| k as f64 * plant.rate / SEGMENT as f64;
    let mut power = vec![0.0; bins];
    let response: Vec<DMatrix<C>> = uu
        .into_iter()
        .zip(eu)
        .zip(&mut power)
        .map(|((mut uu, eu), power)| {
            let ridge = C::from(1e-6 * uu.trace().re / m as f64);
            (0..m).for_each(|i| uu[(i, i)] += ridge);
            let response = uu.try_inverse().map_or_else(|| DMatrix::zeros(p, m), |inverse| &eu * inverse);
            // The power that the inputs explain. At frequencies without input power, the response means nothing.
            *power = (&response * eu.adjoint()).trace().re.max(0.0);
            response
        })
        .collect();
    let most = power[2..bins - 2].iter().copied().fold(0.0, f64::max);
    let counts = |k: &usize| band_hz.is_none_or(|[from, to]| (from..=to).contains(&hz(*k)));
    let mut peaks: Vec<usize> = (2..bins - 2)
        .filter(counts)
        .filter(|&k| power[k] > settings.least_peak * most && power[k] >= power[k - 1] && power[k] > power[k + 1])
        .collect();
    peaks.sort_by(|&a, &b| power[b].total_cmp(&power[a]));
    let mut found: Vec<MissingModeStart> = Vec::new();
    for k in peaks {
        if found.len() == settings.most_peaks {
            break;
        }
        if found.iter().any(|mode| is_same(mode.hz, hz(k), settings.same_peak)) {
            continue;
        }
        found.push(start(plant, (&response[k], sizes), &power, k, hz(k)));
    }
    found
}

/// Returns whether two peaks belong to one resonance: their relative distance is then below `same_peak`.
pub fn is_same(hz: f64, other: f64, same_peak: f64) -> bool {
    (hz / other - 1.0).abs() < same_peak
}

/// Returns the start of a fit at a peak. The response is that of the outputs divided by their sizes.
fn start(
    plant: &Plant,
    (response, sizes): (&DMatrix<C>, &[f64]),
    power: &[f64],
    k: usize,
    hz: f64,
) -> MissingModeStart {
    let half = 0.5 * power[k];
    let width = |step: i64| {
        let mut at = k as i64;
        while at > 0 && (at as usize) < power.len() - 1 && power[at as usize] > half {
            at += step;
        }
        (at - k as i64).unsigned_abs() as f64
    };
    let bins = (width(1) + width(-1) - 1.0).max(1.0);
    let damping = (0.5 * bins / k as f64).clamp(0.003, 0.05);
    // At the peak, s^k / (s^2 + 2 zeta w s + w^2) is s^k / (2 j zeta w^2).
    let s = C::new(0.0, std::f64::consts::TAU * hz);
    let shape = DMatrix::from_fn(plant.p, plant.m, |o, i| {
        let chain = plant.chain.behind(o, s) * plant.chain.before(i, s);
        let sensed = s.powi(plant.sensed[o].order_of_added()) / C::new(0.0, 2.0 * damping * s.norm_sqr());
        (response[(o, i)] / (chain * sensed)).re
    });
    let svd = shape.svd(true, true);
    let (u, v) = (svd.u.expect("asked for"), svd.v_t.expect("asked for"));
    let first = svd.singular_values.imax();
    let c: Vec<f64> = u.column(first).iter().zip(sizes).map(|(c, size)| c * size).collect();
    let norm = c.iter().map(|c| c * c).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    MissingModeStart {
        hz,
        damping,
        b: v.row(first).iter().map(|x| x * svd.singular_values[first] * norm).collect(),
        c: c.iter().map(|c| c / norm).collect(),
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::testing::{RATE, random_input, truss};

    /// Returns a signal after a resonance at this frequency.
    fn resonant(u: &[f64], hz: f64, gain: f64) -> Vec<f64> {
        let w = TAU * hz / RATE;
        let (turn, radius) = (2.0 * (-0.01 * w).exp() * w.cos(), (-0.02 * w).exp());
        let mut before = [0.0; 2];
        let step = |u: &f64| {
            let now = turn * before[0] - radius * before[1] + gain * u;
            before = [now, before[0]];
            now
        };
        u.iter().map(step).collect()
    }

    /// The first output lacks a mode. The error of the second output is small, but its unit makes it a large number.
    #[test]
    fn the_unit_of_an_output_hides_no_mode_of_another() {
        let plant = Plant::new(&truss(1)).unwrap();
        let u = random_input(4, 8192, 2);
        let error = [resonant(&u[0], 186.0, 0.1), resonant(&u[0], 58.0, 1e-3 * 1e6)];
        let driven = [Driven { u: &u, error: &error }];
        let first = |sizes: [f64; 2]| missing_modes(&plant, &driven, &sizes, &SignalSettings::default(), None)[0].hz;
        assert!((first([1.0, 1e6]) / 186.0 - 1.0).abs() < 0.02, "{}", first([1.0, 1e6]));
        assert!((first([1.0, 1.0]) / 58.0 - 1.0).abs() < 0.02, "{}", first([1.0, 1.0]));
    }
}
