//! The part of the signal path in which the gap arises, from the residual itself and not from the name of an effect.
//!
//! Each place of the signal path can only leave residuals of a certain form. The error of an actuator is a function
//! of its command, sent through the column of its input. The error of a sensor is in one output, and is a function of
//! that output. The force of a joint is a function of its motion, sent through its port. A wrong mode leaves a
//! residual with the shapes of that mode. The functions are free here: static curves, hysteresis and past values (the
//! free shapes of `effects/flexible.rs`), and factors of the modes' shapes at one input or one output. For each
//! place, the share of the residual that it can explain in addition to the refit is computed by linear least squares.
//! With one function of one channel, this share is a coherence (Bendat and Piersol 2010, 7.3); along the column of an
//! input or of a port, it is the part of rank one.
//!
//! A side is clear if one of its places explains most of the residual and all places of the other sides leave much
//! more of it. If a controller and the plant respond to each other within a sample, these functions cannot be simulated
//! at commands and measurements. Only the other places are compared there, and no side is clear.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::effects::{
    Effect, Flexible, MainsHum, MissingMode, NarrowbandDisturbance, Place, SensorOffset, Setting, Side,
};
use crate::fit::added::Before;
use crate::fit::nuisance::{Nuisance, Part};
use crate::fit::problem::{Placed, Problem, dot, sum_of_squares};
use crate::fit::refit::{self, Refit, refit};
use crate::prepare::{Known, Prepared};
use crate::settings::JudgeSettings;

/// The share of the residual that a place can explain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlaceShare {
    /// The part of the signal path.
    pub side: Side,
    /// The place, as the location of an effect.
    pub place: String,
    /// Share of the misfit beyond noise and limits.
    pub share: f64,
}

/// Largest number of places that are listed.
const LISTED: usize = 8;

/// Largest number of lines that are tried as disturbances.
const MOST_TONES: usize = 4;

/// Value of a free coefficient for a derivative, in the coefficient's own unit: a hundredth of the signal.
const STEP: f64 = 1e-2;

/// Relative addition to the diagonal of the normal matrix, which is needed because some columns are nearly equal.
pub(crate) const RIDGE: f64 = 1e-9;

/// The possible responses of a place: linear parameters without their limits, and runs with small effects.
struct Means {
    side: Side,
    place: String,
    freed: Vec<usize>,
    runs: Vec<Placed<'static>>,
}

impl Means {
    fn new(side: Side, place: &Place, freed: Vec<usize>, runs: Vec<Placed<'static>>, setting: &Setting) -> Self {
        Self { side, place: place.location(&setting.names), freed, runs }
    }
}

/// Returns the share that each place explains, the largest first. `factor` is the ratio of the noise power to that of
/// the noise model.
pub fn places(ready: &Prepared, known: &Known, factor: f64) -> Vec<PlaceShare> {
    let problem = problem(ready, known);
    let refitted = refit(&problem, refit::STEPS);
    let Some(base) = Base::new(&problem, &refitted) else { return Vec::new() };
    let settings = &problem.settings.judge;
    let means = means(&problem);
    let gain = |means: Means| (means.side, base.gain(&means), means.place);
    let gains = means.into_par_iter().map(gain).collect();
    shares(gains, base.cost - factor * problem.values(), settings)
}

/// Returns the share that each place explains, the largest first, from its gain; none if no place gains enough. The
/// whole is the sum of squares beyond the noise.
pub(crate) fn shares(gains: Vec<(Side, f64, String)>, whole: f64, settings: &JudgeSettings) -> Vec<PlaceShare> {
    let most = gains.iter().map(|(_, gain, _)| *gain).fold(0.0, f64::max);
    if most < settings.side_gain {
        return Vec::new();
    }
    let whole = most.max(whole);
    let share = |(side, gain, place)| PlaceShare { side, place, share: f64::max(gain / whole, 0.0) };
    let mut shares: Vec<PlaceShare> = gains.into_iter().map(share).collect();
    shares.sort_by(|a, b| b.share.total_cmp(&a.share));
    shares
}

/// Returns the places that are listed in an answer.
pub(crate) fn listed(places: &[PlaceShare]) -> Vec<PlaceShare> {
    places.iter().take(LISTED).filter(|place| place.share > 0.0).cloned().collect()
}

/// Returns the side that these shares indicate; `None` if no side is clear.
pub fn side(places: &[PlaceShare], settings: &JudgeSettings) -> Option<Side> {
    let most = |which: &dyn Fn(Side) -> bool| {
        places.iter().filter(|place| which(place.side)).max_by(|a, b| a.share.total_cmp(&b.share))
    };
    if !places.iter().any(|place| matches!(place.side, Side::Actuator | Side::Sensor)) {
        return None;
    }
    let ahead =
        |one: f64, other: f64| one - other >= settings.side_lead && 1.0 - other >= settings.side_ratio * (1.0 - one);
    let enough = |place: &&PlaceShare| place.share >= settings.side_share;
    let steady = most(&|side| side != Side::Time)?;
    // A change over time can imitate a steady error, so it must explain more.
    if let Some(time) = most(&|side| side == Side::Time).filter(enough)
        && ahead(time.share, steady.share)
    {
        return Some(Side::Time);
    }
    let best = Some(steady).filter(enough)?;
    let other = most(&|side| side != best.side && side != Side::Time).map_or(0.0, |place| place.share);
    ahead(best.share, other).then_some(best.side)
}

/// Returns the problem on the first samples of the records, with the noise and the limits from before any residual
/// was counted as an error of the simulation.
fn problem(ready: &Prepared, known: &Known) -> Problem {
    let mut noise = ready.noise.clone();
    noise.model_error.clone_from(&known.model_error);
    let mut problem = ready.problem.head(ready.problem.settings.search.first_samples, &noise);
    problem.nuisance = Nuisance::new(&problem.plant, &problem.records, &known.limits).with_prior_std(&known.prior_std);
    problem
}

/// Returns the possible responses of all places.
fn means(problem: &Problem) -> Vec<Means> {
    let setting = &problem.setting;
    let one = |side: Side, place: Place, freed: Vec<usize>, runs| Means::new(side, &place, freed, runs, setting);
    let mut all = if problem.plant.loops_within_sample() { Vec::new() } else { of_channels(problem) };
    all.extend(at_joints(setting).map(|(side, joint, runs)| one(side, joint, Vec::new(), runs)));
    let poles = parts(problem, Part::Pole);
    all.push(one(Side::Structure, Place::Structure, poles, Vec::new()));
    for place in MissingMode.places(setting) {
        let runs = MissingMode.starts(setting, &place).into_iter().map(|start| at(&MissingMode, &place, start));
        all.push(one(Side::Structure, place.clone(), Vec::new(), runs.collect()));
    }
    let course = of_shape(&Flexible::StiffnessCourse, &Place::Structure, setting);
    all.push(one(Side::Time, Place::Structure, Vec::new(), course));
    all.extend(lines(setting).map(|(side, place, runs)| one(side, place, Vec::new(), runs)));
    all
}

/// Returns the indices of the linear parameters of a part.
fn parts(problem: &Problem, part: Part) -> Vec<usize> {
    let of = |index: &usize| problem.nuisance.part(*index) == Some(part);
    (0..problem.nuisance.of_simulation()).filter(of).collect()
}

/// Returns the possible responses of actuators and sensors.
fn of_channels(problem: &Problem) -> Vec<Means> {
    let freed = |side: Side, place: &Place| match (side, place) {
        (Side::Actuator, &Place::Input(i)) => parts(problem, Part::Input(i)),
        (Side::Sensor, &Place::Output(o)) => parts(problem, Part::Output(o)),
        _ => Vec::new(),
    };
    let one = |(side, place, runs)| Means::new(side, &place, freed(side, &place), runs, &problem.setting);
    at_channels(&problem.setting).into_iter().map(one).collect()
}

/// A side, a place there, and a small effect for each coefficient of the free functions at that place.
pub(crate) type FreeFunctions = (Side, Place, Vec<Placed<'static>>);

/// Returns the free functions of actuators and sensors.
pub(crate) fn at_channels(setting: &Setting) -> Vec<FreeFunctions> {
    let mut all = Vec::new();
    for input in setting.inputs() {
        let shapes = [&Flexible::Command, &Flexible::Hysteresis, &Flexible::Path];
        let runs = shapes.into_iter().flat_map(|shape| of_shape(shape, &input, setting)).collect();
        all.push((Side::Actuator, input.clone(), runs));
        let course = of_shape(&Flexible::GainCourse, &input, setting);
        all.push((Side::Time, input, course));
    }
    for (o, output) in setting.outputs().into_iter().enumerate() {
        let shapes = [&Flexible::Sensor, &Flexible::SensorPath, &Flexible::ZeroCourse];
        let mut runs: Vec<_> = shapes.into_iter().flat_map(|shape| of_shape(shape, &output, setting)).collect();
        runs.push(at(&SensorOffset, &output, vec![STEP * setting.y_rms[o]]));
        all.push((Side::Sensor, output, runs));
    }
    all
}

/// Returns the free functions of the motion at joints.
pub(crate) fn at_joints(setting: &Setting) -> impl Iterator<Item = FreeFunctions> {
    let joints = setting.joints().into_iter().filter(|joint| !setting.is_on_a_mode(setting.port(joint)));
    joints.map(|joint| {
        let springs: &[&'static Flexible] = &[&Flexible::Stiffness, &Flexible::Joint];
        let springs = if setting.plant.ports[setting.port(&joint)].sees_displacement() { springs } else { &[] };
        let shapes = springs.iter().copied().chain([&Flexible::Damping]);
        let runs = shapes.flat_map(|shape| of_shape(shape, &joint, setting)).collect();
        (Side::Structure, joint, runs)
    })
}

/// Returns each line in the residual, as a force at each port and as hum of each output, with an arbitrary phase.
fn lines(setting: &Setting) -> impl Iterator<Item = (Side, Place, Vec<Placed<'static>>)> {
    let phases = [0.0, std::f64::consts::FRAC_PI_2];
    setting.tones.iter().take(MOST_TONES).flat_map(move |tone| {
        let hz = tone.hz;
        let forces = (0..setting.plant.ports.len()).map(move |port| {
            let place = Place::Frequency(hz, port);
            let run = |phase: f64| at(&NarrowbandDisturbance, &place, vec![STEP * setting.force[port], hz, phase]);
            (Side::Disturbance, place.clone(), phases.map(run).to_vec())
        });
        let hums = setting.outputs().into_iter().enumerate().map(move |(o, place)| {
            let run = |phase: f64| {
                let mut parameters = vec![0.0; MainsHum.parameters(setting).len()];
                parameters[..3].copy_from_slice(&[STEP * setting.y_rms[o], hz, phase]);
                at(&MainsHum, &place, parameters)
            };
            (Side::Sensor, place.clone(), phases.map(run).to_vec())
        });
        let within_sample = setting.plant.loops_within_sample();
        forces.chain(hums.filter(move |_| !within_sample)).collect::<Vec<_>>()
    })
}

fn at(effect: &'static dyn Effect, place: &Place, parameters: Vec<f64>) -> Placed<'static> {
    Placed { effect, place: place.clone(), parameters }
}

/// Returns a run for each coefficient of a free shape.
fn of_shape(shape: &'static Flexible, place: &Place, setting: &Setting) -> Vec<Placed<'static>> {
    let count = shape.parameters(setting).len();
    let run = |k: usize| at(shape, place, (0..count).map(|j| if j == k { STEP } else { 0.0 }).collect());
    (0..count).map(run).collect()
}

/// The bounded refit, from which all places start.
struct Base<'p> {
    problem: &'p Problem,
    refitted: &'p Refit,
    /// The runs of the refit, simulated with the same fineness as the places.
    now: Before<'p, 'static>,
    /// J' r.
    pull: DVector<f64>,
    cost: f64,
}

impl<'p> Base<'p> {
    fn new(problem: &'p Problem, refitted: &'p Refit) -> Option<Self> {
        let now = Before::new(problem, &refitted.plant, &refitted.eta, &[]);
        let pull = problem.cross(&refitted.jacobian, &now.residual).column(0).into_owned();
        let mut base = Self { problem, refitted, now, pull, cost: 0.0 };
        base.cost = base.left(&[], &[])?;
        base.cost.is_finite().then_some(base)
    }

    /// Returns the reduction of the misfit by a place, less the reduction expected by chance with as many parameters.
    fn gain(&self, means: &Means) -> f64 {
        let unit = |trace: Vec<f64>| -> Option<Vec<f64>> {
            let size = sum_of_squares(&trace);
            (size.is_finite() && size > 0.0).then(|| trace.iter().map(|x| x / size.sqrt()).collect())
        };
        let traces: Vec<Vec<f64>> = self.now.added(&means.runs).into_iter().filter_map(unit).collect();
        let chance = (means.freed.len() + traces.len()) as f64;
        self.left(&means.freed, &traces).map_or(0.0, |left| self.cost - left - chance)
    }

    /// Returns the minimum of the misfit with some linear parameters freed from their limits and with further columns.
    /// The misfit is the sum of squares of the residual and of the other linear parameters over their limits.
    fn left(&self, freed: &[usize], traces: &[Vec<f64>]) -> Option<f64> {
        let (Refit { eta, jacobian, .. }, now) = (self.refitted, &self.now.residual);
        let (n, k) = (eta.len(), traces.len());
        let mut normal = DMatrix::zeros(n + k, n + k);
        let mut right = DVector::zeros(n + k);
        normal.view_mut((0, 0), (n, n)).copy_from(&jacobian.normal);
        right.rows_mut(0, n).copy_from(&self.pull);
        let mut misfit = sum_of_squares(now);
        for (j, std) in self.problem.nuisance.std.iter().enumerate() {
            if freed.contains(&j) {
                normal[(j, j)] -= 1.0 / (std * std);
            } else {
                right[j] -= eta[j] / (std * std);
                misfit += (eta[j] / std).powi(2);
            }
        }
        let cross = self.problem.cross_all(jacobian, traces);
        normal.view_mut((0, n), (n, k)).copy_from(&cross);
        normal.view_mut((n, 0), (k, n)).copy_from(&cross.transpose());
        for (j, trace) in traces.iter().enumerate() {
            traces[..=j].iter().enumerate().for_each(|(i, other)| {
                let product = dot(trace, other);
                normal[(n + i, n + j)] = product;
                normal[(n + j, n + i)] = product;
            });
            right[n + j] = dot(trace, now);
        }
        (0..n + k).for_each(|j| normal[(j, j)] *= 1.0 + RIDGE);
        let factor = normal.cholesky()?;
        Some(misfit - right.dot(&factor.solve(&right)))
    }
}
