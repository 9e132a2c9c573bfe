//! The part of the signal path in which the gap arises, from the residual and not from the name of an effect.
//!
//! As in `judge/side.rs`, linear least squares gives the share of the residual that each place could explain by any
//! law. A simulator in the loop cannot be run for each coefficient of a free function. The functions of a measurement
//! need no run, because they act behind the simulator; those of a command and of the motion at a port act on the
//! stand-in. In addition, each place has the traces of its laws in the first screen, which are runs of the simulator
//! itself, and so has each parameter of the simulator.

use nalgebra::{DMatrix, DVector};

use crate::case::record::Channels;
use crate::effects::{Action, Memory, Sampling, Side};
use crate::fit::problem::{Placed, dot, sum_of_squares};
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::runs::Runs;
use crate::in_loop::search::Found;
use crate::in_loop::slopes::difference;
use crate::in_loop::stand_in::StandIn;
use crate::judge::side::{PlaceShare, RIDGE, at_channels, at_joints, shares};
use crate::settings::JudgeSettings;

/// The possible residuals of a place: whitened traces of unit norm.
struct Means {
    side: Side,
    place: String,
    traces: Vec<Vec<f64>>,
}

/// Returns the share of the residual that each place explains, the largest first; none if nothing was screened. The
/// record is that of the first screen, with white weights (p standard deviations of the noise) as there. The stand-in
/// takes a few runs, if the bounds allow them.
pub(super) fn places<'a>(
    problem: &Problem<'a>,
    runs: &mut Runs,
    found: &Found<'a>,
    noise: &[f64],
    settings: &JudgeSettings,
) -> Vec<PlaceShare> {
    let (Some((record, samples)), Some(entries)) = (found.first_head, found.screens.first()) else { return Vec::new() };
    let mut white = problem.by_noise_alone(noise);
    white.weigh_for_search(noise, &found.refit.simulated);
    let quick = white.head(record, samples);
    let start = quick.on_head(&found.refit, record);
    let affordable = runs.bounds().left(runs.spent(), quick.samples()).0 >= StandIn::RUNS;
    let stand_in = if affordable { StandIn::about(&quick, runs, &start) } else { None };
    let mut means: Vec<Means> = Vec::new();
    for (side, place, free) in at_channels(&quick.setting).into_iter().chain(at_joints(&quick.setting)) {
        let changes = free.iter().filter_map(|placed| change(&quick, &start, stand_in.as_ref(), placed));
        let place = place.location(&quick.setting.names);
        means.push(Means { side, place, traces: changes.filter_map(|change| trace(&quick, &[change])).collect() });
    }
    for entry in entries {
        let (side, place) = (entry.placed.effect.side(), entry.placed.place.location(&quick.setting.names));
        let Some(trace) = trace(&quick, &entry.change) else { continue };
        match means.iter_mut().find(|means| means.side == side && means.place == place) {
            Some(means) => means.traces.push(trace),
            None => means.push(Means { side, place, traces: vec![trace] }),
        }
    }
    let residual = quick.beyond_limits(&start.residual[..quick.rows()]);
    let gain = |Means { side, place, traces }: Means| (side, explained(&traces, &residual), place);
    let gains = means.into_iter().map(gain).collect();
    shares(gains, sum_of_squares(&residual) - quick.values(), settings)
}

/// Returns the change of the outputs (p channels) by a small effect without a run of the simulator; `None` if only a
/// run would show it.
fn change(quick: &Problem, start: &Fit, stand_in: Option<&StandIn>, placed: &Placed) -> Option<Channels> {
    let actions = placed.effect.act(&quick.setting, &placed.place, &placed.parameters);
    let (before, record) = (start.simulated.first()?, quick.records.first()?);
    let mut after = before.clone();
    for action in &actions {
        let Action::Sensor(sensor) = action else { return stand_in?.change(quick, placed) };
        let sampling = Sampling { t0: record.start_s, rate: quick.setting.plant.rate, at_rest: false };
        sensor.apply(&mut after, sampling, &mut Memory::default());
    }
    Some(difference(&[after], std::slice::from_ref(before)).remove(0))
}

/// Returns the whitened trace of a change beyond the limits of the parameters, with unit norm; `None` if there is none.
fn trace(quick: &Problem, change: &[Channels]) -> Option<Vec<f64>> {
    let trace = quick.beyond_limits(&quick.whiten(change));
    let size = sum_of_squares(&trace).sqrt();
    (size.is_finite() && size > 0.0).then(|| trace.iter().map(|x| x / size).collect())
}

/// Returns the reduction of a sum of squares by a linear combination of traces of unit norm, less that by chance.
fn explained(traces: &[Vec<f64>], residual: &[f64]) -> f64 {
    let count = traces.len();
    let right = DVector::from_fn(count, |i, _| dot(&traces[i], residual));
    let ridge = |i: usize, j: usize| if i == j { RIDGE } else { 0.0 };
    let normal = DMatrix::from_fn(count, count, |i, j| dot(&traces[i], &traces[j]) + ridge(i, j));
    normal.cholesky().map_or(0.0, |factor| right.dot(&factor.solve(&right)) - count as f64)
}
