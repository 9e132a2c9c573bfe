//! Every kind of plot with made-up data, in one report: `cargo run -p plid-report --example report_gallery -- DIR`.

use std::f64::consts::TAU;
use std::path::PathBuf;

use ndarray::{Array2, ArrayView1, Axis as Dimension, s};
use num_complex::Complex64;
use plid_model::signal::{
    CrossCorrelationOptions, ErrorMeasures, SignalError, WelchFrf, WelchOptions, WhitenessOptions, convergence,
    cross_correlation, error_measures, welch_frf, whiteness,
};
use plid_report::{
    Axis, Bar, Bars, Cell, Chart, ConvergencePlot, FrfCurve, FrfPlot, HeatMap, ModeSet, Report, Scale, Series, Table,
    Trace, bars, chart, convergence_plot, correlation_plot, frf_grid, frf_plot, heat_map, mode_map, trace_plot,
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const RATE: f64 = 1600.0;
const SAMPLES: usize = 20_000;
const CHANNELS: usize = 3;
const NOISE: f64 = 0.004;
const MODES: [(f64, f64); 5] = [(136.0, 0.008), (168.0, 0.006), (186.0, 0.01), (212.0, 0.007), (243.0, 0.009)];

/// Residue of a mode for a pair, by a rule that gives each pair its own mixture.
fn residue(mode: usize, output: usize, input: usize) -> f64 {
    0.004 * ((1 + mode * 3 + output * 2) as f64).sin() * ((2 + mode * 5 + input) as f64).cos()
}

/// Sampled poles: the second-order recursion of a mode, with its frequency scaled by `detune`.
fn pole(mode: usize, detune: f64) -> Complex64 {
    let omega = TAU * MODES[mode].0 * detune / RATE;
    Complex64::from_polar((-MODES[mode].1 * omega).exp(), omega * (1.0 - MODES[mode].1.powi(2)).sqrt())
}

fn response(frequency: f64, output: usize, input: usize, detune: f64) -> Complex64 {
    let z = Complex64::from_polar(1.0, TAU * frequency / RATE);
    (0..MODES.len())
        .map(|mode| residue(mode, output, input) * z / ((z - pole(mode, detune)) * (z - pole(mode, detune).conj())))
        .sum()
}

fn simulate(inputs: &Array2<f64>, detune: f64) -> Array2<f64> {
    let mut outputs = Array2::<f64>::zeros((inputs.nrows(), CHANNELS));
    for mode in 0..MODES.len() {
        let (a1, a2) = (2.0 * pole(mode, detune).re, -pole(mode, detune).norm_sqr());
        for input in 0..CHANNELS {
            let (mut last, mut before) = (0.0, 0.0);
            for k in 0..inputs.nrows() {
                let past = if k > 0 { inputs[[k - 1, input]] } else { 0.0 };
                let now = a1 * last + a2 * before + past;
                (before, last) = (last, now);
                for output in 0..CHANNELS {
                    outputs[[k, output]] += residue(mode, output, input) * now;
                }
            }
        }
    }
    outputs
}

fn noise(seed: u64, samples: usize, channels: usize) -> Array2<f64> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    Array2::from_shape_simple_fn((samples, channels), || StandardNormal.sample(&mut generator))
}

fn pair(frf: &WelchFrf, output: usize, input: usize) -> FrfPlot {
    let fine: Vec<f64> = (0..900).map(|k| 20.0 + 0.4 * k as f64).collect();
    let model = |detune: f64| fine.iter().map(|f| response(*f, output, input, detune)).collect::<Vec<_>>();
    let identified = model(1.0004);
    let std = identified.iter().zip(&fine).map(|(h, f)| 0.03 * h.norm() + 2e-4 * (1.0 + (f / 100.0).sin())).collect();
    FrfPlot {
        title: format!("u{} to y{}", input + 1, output + 1),
        unit: "V/V".into(),
        measured: Some(FrfCurve {
            frequency_hz: frf.frequency_hz.clone(),
            response: frf.response.slice(s![.., output, input]).to_vec(),
            std: None,
        }),
        coherence: Some(frf.multiple_coherence.column(output).to_vec()),
        identified: Some(FrfCurve { frequency_hz: fine.clone(), response: identified, std: Some(std) }),
        truth: Some(FrfCurve { frequency_hz: fine.clone(), response: model(1.0), std: None }),
        frequency_scale: Scale::Linear,
        range_hz: Some((20.0, 380.0)),
        ..FrfPlot::default()
    }
}

fn order_scan() -> String {
    let scan: Vec<(f64, f64)> = (1..=24).map(|n| (2.0 * n as f64, 0.35 * (-(n as f64) / 3.0).exp() + 0.011)).collect();
    chart(&Chart {
        title: "Order scan".into(),
        x: Axis::linear("states").range(0.0, 50.0),
        y: Axis::log("free-run error, relative"),
        series: vec![
            Series::line("held-out free run", scan.clone()),
            Series::points("", scan).colour("#0072b2"),
            Series::level("noise floor", 0.0105),
            Series::vertical("recommended", 30.0).colour("#009e73"),
        ],
        height: 220.0,
    })
}

fn bench_times() -> String {
    let power = |factor: f64, exponent: f64| {
        (0..10).map(|k| 4.0 * 1.5f64.powi(k)).map(|n| (n, factor * n.powf(exponent))).collect::<Vec<_>>()
    };
    chart(&Chart {
        title: "Time of one step".into(),
        x: Axis::log("states n"),
        y: Axis::log("time of a step, s"),
        series: vec![
            Series::line("direct", power(3e-9, 2.1)),
            Series::line("joseph", power(5e-9, 2.1)),
            Series::line("bierman", power(4e-9, 2.2)),
            Series::line("square root", power(9e-9, 2.1)),
            Series::line("double-double, plain loops", power(2e-7, 2.0)),
        ],
        height: 240.0,
    })
}

fn drift() -> String {
    chart(&Chart {
        title: "Small numbers".into(),
        x: Axis::linear("step"),
        y: Axis::log("relative difference from double-double"),
        series: vec![
            Series::line("direct", (1..300).map(|k| (k as f64, 1e-16 * (k as f64).powf(1.7))).collect()),
            Series::line("bierman", (1..300).map(|k| (k as f64, 1e-16 * (k as f64).sqrt())).collect()),
        ],
        height: 200.0,
    })
}

fn gap_map() -> String {
    heat_map(&HeatMap {
        rows: (1..=3).map(|i| format!("y{i}")).collect(),
        columns: (0..12).map(|b| format!("{}–{}", 20 * b, 20 * b + 20)).collect(),
        values: Array2::from_shape_fn((3, 12), |(i, b)| {
            if (i, b) == (2, 0) {
                f64::NAN
            } else {
                0.02 + 0.5 * (-((b as f64 - 6.3 - i as f64 * 0.4) / 1.2).powi(2)).exp()
            }
        }),
        column_label: "band, Hz".into(),
        value_label: "gap, relative".into(),
        range: None,
    })
}

fn shrinking_gap() -> String {
    let named = |name: &str, value: f64, strong: bool| Bar {
        name: name.into(),
        value,
        text: format!("{value:.1} %"),
        interval: strong.then_some((0.8 * value, 1.3 * value)),
        strong,
    };
    bars(&Bars {
        bars: vec![named("as given", 42.0, false), named("refitted", 15.3, false), named("with the effect", 3.1, true)],
        label: "gap, %".into(),
        reference: Some(("noise".into(), 1.0)),
    })
}

fn modes(label: &str, detune: f64, std: f64) -> ModeSet {
    ModeSet {
        label: label.into(),
        frequency_hz: MODES.iter().map(|m| m.0 * detune).collect(),
        damping: MODES.iter().map(|m| m.1 * (2.0 * detune - 1.0)).collect(),
        std: MODES.iter().map(|m| (std, std * m.1 / 20.0)).filter(|_| std > 0.0).collect(),
    }
}

fn mode_table() -> Table {
    let mut table = Table::new("Modes of the identified model, with one standard deviation.")
        .column("mode", "")
        .column("frequency", "Hz")
        .column("damping ratio", "%")
        .column("true frequency", "Hz");
    for (index, (frequency, damping)) in MODES.iter().enumerate() {
        table = table.row([
            Cell::from(index + 1),
            Cell::with_std(frequency * 1.0004, 0.012),
            Cell::with_std(100.0 * damping, 0.021),
            Cell::fixed(*frequency, 2),
        ]);
    }
    table
}

fn accuracy_table(one_step: &ErrorMeasures, simulated: &ErrorMeasures) -> Table {
    let mut accuracy = Table::new("Errors on the held-out samples.")
        .column("output", "")
        .column("one step, RMS", "V")
        .column("one step", "% of RMS")
        .column("free run", "% of RMS")
        .column("free-run fit", "%");
    for i in 0..CHANNELS {
        accuracy = accuracy.row([
            Cell::from(format!("y{}", i + 1)),
            Cell::significant(one_step.rms_error[i], 3),
            Cell::fixed(100.0 * one_step.relative[i], 2),
            Cell::fixed(100.0 * simulated.relative[i], 2),
            Cell::fixed(simulated.fit_percent[i], 1),
        ]);
    }
    accuracy
}

/// Charts as in studies, with made-up figures.
fn studies(report: Report) -> Report {
    report
        .heading("Studies")
        .figure(order_scan(), "A scan over the number of states.")
        .figure(bench_times(), "A bench on logarithmic axes.")
        .figure(drift(), "Numbers near rounding.")
        .figure(gap_map(), "A heat map.")
        .figure(shrinking_gap(), "Bars, one with an interval.")
        .figure(
            mode_map(&[modes("identified", 1.0004, 0.9), modes("true", 1.0, 0.0)]),
            "Modes with bars of two standard deviations.",
        )
}

/// Tests of residuals of which one is coloured and one depends on `last_input`, the first input a sample earlier.
fn residual_plots(
    report: Report,
    mut residuals: Array2<f64>,
    inputs: Array2<f64>,
    last_input: ArrayView1<'_, f64>,
) -> Result<Report, SignalError> {
    for k in (1..residuals.nrows()).rev() {
        residuals[[k, 2]] += 0.35 * residuals[[k - 1, 2]];
        residuals[[k, 1]] += 0.002 * last_input[k];
    }
    let white = whiteness(residuals.view(), &WhitenessOptions { lags: 40, ..Default::default() })?;
    let options = CrossCorrelationOptions { first_lag: -10, last_lag: 40, ..Default::default() };
    let crossed = cross_correlation(residuals.view(), inputs.view(), &options)?;
    let autos: Vec<_> = white.iter().enumerate().map(|(i, c)| (format!("e{}", i + 1), c)).collect();
    let crosses: Vec<_> = crossed
        .iter()
        .enumerate()
        .flat_map(|(i, row)| row.iter().enumerate().map(move |(j, c)| (format!("e{} with past u{}", i + 1, j + 1), c)))
        .collect();

    Ok(report
        .heading("Residuals")
        .figure(correlation_plot("autocorrelation", 3, &autos), "Autocorrelation of the residuals.")
        .figure(
            correlation_plot("correlation", 3, &crosses),
            "Correlation of each residual with each past input; negative lags would be feedback.",
        ))
}

/// The largest one-step error over the channels.
fn convergence_figure(errors: &Array2<f64>, error_scale: Scale, time_scale: Scale) -> String {
    let curve = convergence(errors.view(), 120);
    convergence_plot(&ConvergencePlot {
        convergence: &curve,
        sample_rate_hz: RATE,
        unit: "V".into(),
        noise_floor: Some(1.26 * NOISE),
        time_scale,
        error_scale,
    })
}

/// The traces of outputs measured, predicted one step ahead, and simulated, from a sample on.
fn traces(columns: &[[Vec<f64>; 3]], first: usize) -> Vec<Trace<'_>> {
    columns
        .iter()
        .enumerate()
        .map(|(i, [y, one_step, simulation])| Trace {
            name: format!("y{}", i + 1),
            unit: "V".into(),
            measured: &y[first..],
            predicted: Some(&one_step[first..]),
            free_run: Some(&simulation[first..]),
        })
        .collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let directory = PathBuf::from(std::env::args().nth(1).ok_or("name a directory for the report")?);
    std::fs::create_dir_all(&directory)?;

    let inputs = noise(1, SAMPLES, CHANNELS);
    let clean = simulate(&inputs, 1.0);
    let measured = &clean + &(noise(2, SAMPLES, CHANNELS) * NOISE);
    let free_run = simulate(&inputs, 1.0004);
    // Errors that die away to the noise, as those of a recursion do.
    let mut errors = noise(3, SAMPLES, CHANNELS) * NOISE;
    for (k, mut row) in errors.axis_iter_mut(Dimension(0)).enumerate() {
        row *= 1.0 + 20.0 / (1.0 + k as f64 / 40.0);
    }
    let predicted = &measured - &errors;

    let welch = WelchOptions { sample_rate_hz: RATE, segment_length: Some(1024) };
    let frf = welch_frf(inputs.view(), measured.view(), &welch)?;
    let mut first = pair(&frf, 0, 0);
    first.peaks_hz = MODES.iter().map(|mode| mode.0).collect();
    let all: Vec<FrfPlot> =
        (0..CHANNELS).flat_map(|i| (0..CHANNELS).map(move |j| (i, j))).map(|(i, j)| pair(&frf, i, j)).collect();

    let held_out = 15_000..SAMPLES;
    let tail = |data: &Array2<f64>| data.slice(s![held_out.clone(), ..]).to_owned();
    let one_step = error_measures(tail(&measured).view(), tail(&predicted).view())?;
    let simulated = error_measures(tail(&measured).view(), tail(&free_run).view())?;
    let columns: Vec<[Vec<f64>; 3]> =
        (0..CHANNELS).map(|i| [&measured, &predicted, &free_run].map(|data| data.column(i).to_vec())).collect();

    let mut report = Report::new("Gallery of plots")
        .verdict(format!(
            "The free-run error on held-out data is {:.1} % of the outputs' RMS, the one-step error {:.1} %.",
            100.0 * simulated.overall_relative,
            100.0 * one_step.overall_relative
        ))
        .verdict("All numbers are made up, to show every kind of plot.")
        .figure(frf_plot(&first), "Measured, identified and true response of one pair; above, the coherence.")
        .figure(
            frf_grid(CHANNELS, &all),
            "All pairs: columns are inputs, rows are outputs. The green strip shows the coherence.",
        )
        .figure(
            convergence_figure(&errors, Scale::Log, Scale::Log),
            "Largest one-step error over the sensors, both axes logarithmic.",
        )
        .figure(convergence_figure(&errors, Scale::Linear, Scale::Linear), "The same on linear axes, as in the paper.")
        .table(accuracy_table(&one_step, &simulated))
        .table(mode_table())
        .warnings(["The residual of y3 is not white (Ljung-Box, p < 0.001)."])
        .advice([
            "Raise the number of states from 24 to 30: the free-run error still falls.",
            "Decimate by 2: nothing is excited above 400 Hz.",
        ])
        .heading("Outputs")
        .figure(trace_plot(&traces(&columns, 15_000), RATE, 15_000..15_400), "A window of the held-out record.")
        .figure(trace_plot(&traces(&columns, 0)[..1], RATE, 0..SAMPLES), "A whole record of 20 000 samples.");
    report =
        residual_plots(report, tail(&errors), tail(&inputs), inputs.slice(s![held_out.start - 1..SAMPLES - 1, 0]))?;
    report = studies(report)
        .details("How this was made", |r| r.paragraph("By the example report_gallery of plid-report."))
        .listing("The config that repeats this report:", "[model]\nstates = 30\nname = \"<gallery> & co\"\n")
        .provenance("plid", env!("CARGO_PKG_VERSION"))
        .provenance("data.csv", "sha256:9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08");
    report.write(&directory.join("report.html"))?;
    Ok(())
}
