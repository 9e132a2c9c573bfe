//! Frequency responses by level. Measured and simulated outputs are processed in the same way, so that the window
//! affects both equally.

use ndarray::{Array2, s};
use plid_fourier::Complex64;
use plid_model::signal::{WelchFrf, WelchOptions, welch_frf};
use plid_report::{Axis, Chart, FrfCurve, FrfPlot, Series, chart, frf_grid};

use super::words::{short, with};
use crate::case::Case;
use crate::case::record::Channels;
use crate::diagnose::Outcome;

/// Smallest number of segments without overlap in a record. It is small in favour of a resolution that separates
/// modes, because the responses lie far above the noise.
const SEGMENTS: usize = 6;

/// Share of all frequencies in the enlarged figure.
const SHOWN: f64 = 0.08;

/// Largest number of pairs of input and output in a grid.
const MOST_PAIRS: usize = 36;

/// Responses at one level.
struct Level {
    name: String,
    measured: WelchFrf,
    given: WelchFrf,
    with: WelchFrf,
}

/// Responses at every level, and the pair and band with the largest difference between measured and simulated.
pub(super) struct Responses {
    levels: Vec<Level>,
    pair: (usize, usize),
    range_hz: (f64, f64),
    title: String,
}

fn matrix(channels: &Channels) -> Array2<f64> {
    let samples = channels.first().map_or(0, Vec::len);
    Array2::from_shape_fn((samples, channels.len()), |(k, c)| channels[c][k])
}

impl Responses {
    /// Computes the responses of records that are long enough and whose inputs are all excited. Returns `None` if
    /// there are none.
    pub fn new(outcome: &Outcome, case: &Case) -> Option<Self> {
        let shown = &outcome.shown;
        let m = case.config.inputs.len();
        let shortest = shown.levels.iter().filter_map(|run| run.y.first()).map(Vec::len).min()?;
        let length = 1usize << (shortest / SEGMENTS.max(2 * m)).checked_ilog2()?;
        let options = WelchOptions { sample_rate_hz: shown.rate, segment_length: Some(length) };
        let levels: Vec<Level> = shown
            .levels
            .iter()
            .filter_map(|run| {
                let u = matrix(&run.u);
                let of = |y: &Channels| welch_frf(u.view(), matrix(y).view(), &options).ok();
                Some(Level {
                    name: format!("level {}", short(run.level)),
                    measured: of(&run.y)?,
                    given: of(&run.given)?,
                    with: of(&run.with)?,
                })
            })
            .collect();
        let (pair, range_hz) = largest_difference(levels.last()?, 0.5 * shown.rate);
        let title = format!("{} to {}", case.config.inputs[pair.1], case.config.outputs[pair.0]);
        Some(Self { levels, pair, range_hz, title })
    }

    /// States the method and its resolution, for a caption.
    pub fn how(&self) -> String {
        let frf = &self.levels[0].measured;
        let step = frf.frequency_hz.first().copied().unwrap_or(f64::NAN);
        format!(
            "Welch's method, segments of {} samples, {} Hz apart; levels are RMS of the inputs",
            frf.segment_length,
            short(step)
        )
    }

    /// Returns the pair of the enlarged figure.
    pub fn pair(&self) -> &str {
        &self.title
    }

    /// Draws the measured response at each level, the simulation as given, and the simulation of each level with its
    /// effects.
    pub fn by_level(&self) -> String {
        let curves = |of: &dyn Fn(&Level) -> FrfCurve| -> Vec<(String, FrfCurve)> {
            self.levels.iter().map(|level| (level.name.clone(), of(level))).collect()
        };
        let loudest = &self.levels[self.levels.len() - 1];
        let given = ("simulation as given".to_string(), self.curve(&loudest.given, self.pair, self.range_hz));
        let plot = |what: &str, mut others: Vec<(String, FrfCurve)>| {
            others.push(given.clone());
            FrfPlot {
                title: format!("{}, {what}", self.title),
                others,
                range_hz: Some(self.range_hz),
                ..FrfPlot::default()
            }
        };
        let measured = curves(&|level| self.curve(&level.measured, self.pair, self.range_hz));
        let simulated = curves(&|level| self.curve(&level.with, self.pair, self.range_hz));
        frf_grid(2, &[plot("measured", measured), plot("simulated", simulated)])
    }

    /// Draws the difference of each level's response from the simulation as given: measured, and with the effects.
    pub fn change(&self, outcome: &Outcome) -> String {
        const COLOURS: [&str; 6] = ["#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#4d4d4d", "#8c6d1f"];
        let ratio = |frf: &WelchFrf, given: &WelchFrf| -> Vec<(f64, f64)> {
            let (i, j) = self.pair;
            let lines = frf.frequency_hz.iter().enumerate();
            let shown = lines.filter(|(_, f)| (self.range_hz.0..=self.range_hz.1).contains(*f));
            shown
                .map(|(k, f)| (*f, 20.0 * (frf.response[[k, i, j]].norm() / given.response[[k, i, j]].norm()).log10()))
                .collect()
        };
        let mut series = Vec::new();
        for (level, colour) in self.levels.iter().zip(COLOURS.into_iter().cycle()) {
            let (measured, found) = (ratio(&level.measured, &level.given), ratio(&level.with, &level.given));
            series.push(Series::line(format!("{}, measured", level.name), measured).colour(colour).width(2.6));
            let label = format!("{}, {}", level.name, with(outcome));
            series.push(Series::line(label, found).colour(colour).width(1.4).dashed());
        }
        chart(&Chart {
            title: String::new(),
            x: Axis::linear("frequency, Hz").range(self.range_hz.0, self.range_hz.1),
            y: Axis::linear("|H| against the simulation, dB"),
            series,
            height: 180.0,
        })
    }

    /// Draws all pairs at the highest level. Returns `None` if there are too many pairs to read.
    pub fn all_pairs(&self, outcome: &Outcome, case: &Case) -> Option<String> {
        let loudest = self.levels.last()?;
        let (p, m) = (case.config.outputs.len(), case.config.inputs.len());
        let range = (0.0, 0.5 * outcome.shown.rate);
        let plots: Vec<FrfPlot> = (0..p)
            .flat_map(|i| (0..m).map(move |j| (i, j)))
            .map(|(i, j)| FrfPlot {
                title: format!("{} to {}", case.config.inputs[j], case.config.outputs[i]),
                measured: Some(self.curve(&loudest.measured, (i, j), range)),
                coherence: Some(loudest.measured.multiple_coherence.slice(s![.., i]).to_vec()),
                others: vec![
                    ("as given".to_string(), self.curve(&loudest.given, (i, j), range)),
                    (with(outcome).to_string(), self.curve(&loudest.with, (i, j), range)),
                ],
                range_hz: Some(range),
                ..FrfPlot::default()
            })
            .collect();
        (p * m <= MOST_PAIRS).then(|| frf_grid(m, &plots))
    }

    fn curve(&self, frf: &WelchFrf, (i, j): (usize, usize), (low, high): (f64, f64)) -> FrfCurve {
        let shown: Vec<usize> =
            (0..frf.frequency_hz.len()).filter(|&k| (low..=high).contains(&frf.frequency_hz[k])).collect();
        FrfCurve {
            frequency_hz: shown.iter().map(|&k| frf.frequency_hz[k]).collect(),
            response: shown.iter().map(|&k| frf.response[[k, i, j]]).collect(),
            std: None,
        }
    }
}

/// Returns the pair and the band in which the input causes the largest error relative to the output: |H - H_sim|^2
/// S_uu / S_yy.
fn largest_difference(level: &Level, top_hz: f64) -> ((usize, usize), (f64, f64)) {
    let (lines, p, m) = level.measured.response.dim();
    let mut best = (-1.0, (0, 0), 0);
    let width = ((lines as f64 * SHOWN).ceil() as usize).clamp(1, lines.max(1));
    for i in 0..p {
        let power: f64 = level.measured.output_density.column(i).iter().filter(|x| x.is_finite()).sum();
        for j in 0..m {
            let driven = |k: usize| {
                let difference: Complex64 = level.measured.response[[k, i, j]] - level.given.response[[k, i, j]];
                let value = difference.norm_sqr() * level.measured.input_density[[k, j]] / power.max(1e-300);
                if value.is_finite() { value } else { 0.0 }
            };
            let each: Vec<f64> = (0..lines).map(driven).collect();
            for (start, window) in each.windows(width).enumerate() {
                let sum: f64 = window.iter().sum();
                if sum > best.0 {
                    best = (sum, (i, j), start);
                }
            }
        }
    }
    let (_, pair, start) = best;
    let hz = &level.measured.frequency_hz;
    let (low, high) = (hz.get(start).copied(), hz.get(start + width - 1).copied());
    (pair, (low.unwrap_or(0.0), high.unwrap_or(top_hz)))
}
