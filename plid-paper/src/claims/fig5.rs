//! Fig. 5: the actuator signal.

use ndarray::Array2;
use plid_model::signal::{WelchOptions, welch_spectra};
use plid_report::{Axis, Chart, Series, chart};
use plid_testbed::TrussConfig;
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};
use crate::truss::{ACTUATOR, truss_of};

pub const CLAIM: Claim = claim!("fig5",
    statement: "The actuator signal is noise through a sixth-order Butterworth low-pass filter at 200 Hz; from about \
        600 Hz it is below the noise floor.",
    limit: "The filter is the paper's and the floors follow from its noise figure (5 mV) and its converter (12 bits \
        over 10 V). Where the real amplifier's floor lay is not known.",
    timed: false,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    segments: usize,
}

/// Order and corner frequency of the paper's filter.
const ORDER: i32 = 6;
const CORNER_HZ: f64 = 200.0;
const SEGMENT: usize = 512;

/// Densities of white noise in V²/Hz.
struct Floors {
    amplifier: f64,
    rounding: f64,
}

impl Floors {
    fn of(truss: &TrussConfig) -> Self {
        // The density of white noise of a given RMS that extends over all frequencies up to half the rate.
        let white = |rms_v: f64| rms_v * rms_v / (truss.sample_rate_hz / 2.0);
        let amplifier = white(truss.noise.amplifier_rms_v);
        let rounding = white(truss.converters.step_v / 12.0_f64.sqrt());
        Self { amplifier, rounding }
    }
}

/// The density in V²/Hz at the output of the paper's filter for white noise of density `level` at its input.
struct Butterworth {
    level: f64,
    /// Sample rate in Hz.
    rate: f64,
}

impl Butterworth {
    fn density(&self, x: f64) -> f64 {
        self.level / (1.0 + x.powi(2 * ORDER))
    }

    /// Returns the density of the program's filter. It is the bilinear transform of the paper's filter, which is
    /// steeper towards half the rate.
    fn sampled(&self, hz: f64) -> f64 {
        let warped =
            (std::f64::consts::PI * hz / self.rate).tan() / (std::f64::consts::PI * CORNER_HZ / self.rate).tan();
        self.density(warped)
    }

    fn analogue(&self, hz: f64) -> f64 {
        self.density(hz / CORNER_HZ)
    }
}

/// Returns frequencies from 20 Hz to 800 Hz.
fn grid() -> impl Iterator<Item = f64> {
    (200..8000).map(|i| f64::from(i) / 10.0)
}

fn density_chart(density: Vec<(f64, f64)>, filter: &Butterworth, floors: &Floors) -> String {
    // Densities far below both floors are not drawn.
    let shown = |density: f64| if density > 1e-2 * floors.rounding { density } else { f64::NAN };
    let line = |of: &dyn Fn(f64) -> f64| grid().map(|hz| (hz, shown(of(hz)))).collect();
    chart(&Chart {
        title: String::new(),
        x: Axis::linear("frequency, Hz").range(0.0, filter.rate / 2.0).step(100.0),
        y: Axis::log("density, V²/Hz"),
        series: vec![
            Series::line("command of actuator 1", density).colour("#8f8f8f").width(2.4),
            Series::line("sixth-order Butterworth, sampled", line(&|hz| filter.sampled(hz))),
            Series::line("the same, analogue", line(&|hz| filter.analogue(hz))).dashed(),
            Series::level("amplifier noise, 5 mV", floors.amplifier),
            Series::level("rounding of the converter", floors.rounding),
            Series::vertical("600 Hz", 600.0).colour("#555555"),
        ],
        height: 260.0,
    })
}

/// Plots the first half second of the command (K x 1) in V.
fn time_chart(command: &Array2<f64>, rate: f64) -> String {
    chart(&Chart {
        title: String::new(),
        x: Axis::linear("time, s"),
        y: Axis::linear("command, V"),
        series: vec![Series::line("", (0..800).map(|k| (k as f64 / rate, command[[k, 0]])).collect()).width(1.0)],
        height: 130.0,
    })
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (mut experiment, vary): (_, Vary) = (context.experiment()?, context.vary()?);
    let truss = truss_of(&mut experiment);
    let rate = truss.sample_rate_hz;
    truss.duration_s = ((vary.segments + 1) * SEGMENT / 2) as f64 / rate;
    let simulation = plid_testbed::simulate(truss)?;
    let command = simulation.commands.select(ndarray::Axis(1), &[ACTUATOR]);
    let spectra = welch_spectra(command.view(), &WelchOptions { sample_rate_hz: rate, segment_length: Some(SEGMENT) })?;
    let density: Vec<(f64, f64)> =
        (1..spectra.frequency_hz.len()).map(|k| (spectra.frequency_hz[k], spectra.density[[k, 0, 0]].re)).collect();
    let passed = density.iter().filter(|(hz, _)| (20.0..=120.0).contains(hz)).map(|p| p.1);
    let level = passed.clone().sum::<f64>() / passed.count() as f64;

    let floors = Floors::of(truss);
    let Floors { amplifier, rounding } = floors;
    let filter = Butterworth { level, rate };
    let crossing = |of: &dyn Fn(f64) -> f64, floor: f64| grid().find(|&hz| of(hz) < floor).unwrap_or(rate / 2.0);
    let measured = density.iter().filter(|p| p.0 > CORNER_HZ).find(|p| p.1 < amplifier).map_or(f64::NAN, |p| p.0);
    let (from, ideal) = (crossing(&|hz| filter.sampled(hz), amplifier), crossing(&|hz| filter.analogue(hz), amplifier));
    let (rounded, ideal_rounded) =
        (crossing(&|hz| filter.sampled(hz), rounding), crossing(&|hz| filter.analogue(hz), rounding));

    let fit = density.iter().filter(|(hz, _)| (20.0..=350.0).contains(hz));
    let off =
        fit.map(|&(hz, d)| 10.0 * (d / filter.sampled(hz)).log10()).fold(0.0, |worst: f64, db| worst.max(db.abs()));
    let psd = density_chart(density, &filter, &floors);
    let time = time_chart(&command, rate);
    Ok(Finding::default()
        .figure("below the amplifier's noise from", from, "Hz")
        .figure("the same, measured", measured, "Hz")
        .figure("the same for an analogue filter", ideal, "Hz")
        .figure("below the converter's rounding from", rounded, "Hz")
        .figure("the same for an analogue filter, rounding", ideal_rounded, "Hz")
        .figure("largest distance of the density from the filter's, 20-350 Hz", off, "dB")
        .part(
            "From 20 to 350 Hz the density is the filter's within 3 dB (so many averages leave 1 dB of scatter a line, \
             and the largest deviation of a hundred lines counts).",
            off < 3.0,
        )
        .part(
            "From 600 Hz on the command is below the amplifier's noise of 5 \
            mV.",
            from <= 600.0 && filter.sampled(700.0) < amplifier,
        )
        .part(
            "It is below it from about 600 Hz, 500 to 700, and not from much lower: for the sampled \
            filter.",
            (500.0..=700.0).contains(&from),
        )
        .part("It is so for an analogue filter.", (500.0..=700.0).contains(&ideal))
        .picture(psd, "Density of the command as the converter gives it, the filter, and the floors.")
        .picture(time, "The first half second.")
        .say(format!(
            "From 600 Hz on the command is below the floor of 5 mV, but that of a sampled filter of this kind already \
             is from {from:.0} Hz on (measured {measured:.0} Hz), and that of an analogue one from {ideal:.0} Hz. The \
             converter's rounding takes over at {rounded:.0} Hz, or {ideal_rounded:.0} Hz. The paper's figure lies \
             between the two floors of an analogue filter."
        )))
}
