//! The shape of a law that was found at a port: its force over the displacement or the velocity there. Where records
//! cannot tell the laws of a family apart, the shape is what they do determine.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::answer::schema::NamedEffect;
use crate::effects::{Action, Force, Setting};
use crate::fit::problem::{Fit, Placed, Problem};
use crate::judge::explained::Explained;
use crate::prepare::moving_ports;
use crate::simulate::changed_plant;

/// Number of points of a curve. It is even, so that no point is at rest, where dry friction has no value of its own.
const POINTS: usize = 80;

/// Half the length of a 95 % interval in standard deviations.
const QUANTILE: f64 = 1.96;

/// The motion over which a force is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// The displacement, at rest.
    Displacement,
    /// The velocity, at no displacement.
    Velocity,
}

impl Motion {
    /// Returns its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Displacement => "displacement",
            Self::Velocity => "velocity",
        }
    }

    fn at(self, x: f64) -> [f64; 2] {
        match self {
            Self::Displacement => [x, 0.0],
            Self::Velocity => [0.0, x],
        }
    }
}

/// The force of a law without memory over the motion of its port in the fitted records.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// The effect.
    pub effect: String,
    /// Its location.
    pub location: String,
    /// Its family, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<String>,
    /// The motion over which the force is given.
    pub over: Motion,
    /// The unit of the motion.
    pub unit: String,
    /// The unit of the force.
    pub force_unit: String,
    /// The motion and the force there.
    pub points: Vec<[f64; 2]>,
    /// The 95 % interval of the force at each point, if the fit gives one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ci95: Option<Vec<[f64; 2]>>,
}

/// Returns the shapes of the named laws without memory. A law with a free shape is shown with it.
pub(crate) fn shapes(explained: &Explained, named: &[NamedEffect]) -> Vec<Shape> {
    let (fit, problem) = (explained.fit(), &explained.ready.problem);
    let names = &problem.setting.names;
    let free = explained.free_shape.as_ref().map(|free| free.which);
    let own = &fit.effects[..fit.effects.len() - usize::from(free.is_some())];
    let is_named = |placed: &Placed| {
        let location = placed.place.location(names);
        named.iter().find(|named| named.effect == placed.effect.name() && named.location == location)
    };
    let laws: Vec<(Law, &NamedEffect)> = (own.iter().enumerate())
        .filter_map(|(k, placed)| {
            let parts = if free == Some(k) { vec![k, own.len()] } else { vec![k] };
            Some((Law::new(&problem.setting, fit, parts)?, is_named(placed)?))
        })
        .collect();
    if laws.is_empty() {
        return Vec::new();
    }
    let ranges = ranges(problem, fit);
    laws.into_iter().filter_map(|(law, named)| law.shape(&ranges[law.port], named)).collect()
}

/// Returns the lowest and the highest displacement and velocity at each port in the fitted records, with the effects.
fn ranges(problem: &Problem, fit: &Fit) -> Vec<[[f64; 2]; 2]> {
    let plant = problem.nuisance.apply(&problem.plant, &fit.eta);
    let mut actions = problem.actions(&fit.effects);
    let plant = changed_plant(&plant, &actions).unwrap_or(plant);
    actions.retain(|action| !matches!(action, Action::Plant(_) | Action::Load(..) | Action::Lag(..)));
    let mut ranges = vec![[[0.0_f64; 2]; 2]; plant.ports.len()];
    for record in &problem.records {
        let motion = moving_ports(&plant, &actions, &record.u, record.start_s);
        let ends = ranges.iter_mut().flatten().zip(motion);
        ends.for_each(|(ends, x)| *ends = x.iter().fold(*ends, |[low, high], x| [low.min(*x), high.max(*x)]));
    }
    ranges
}

/// A law at a port: an effect, with its free shape if it needs one.
struct Law<'l> {
    setting: &'l Setting,
    /// The effects that make up the law, and the number of the first parameter of each in the fit.
    parts: Vec<(&'l Placed<'l>, usize)>,
    covariance: &'l DMatrix<f64>,
    port: usize,
}

impl<'l> Law<'l> {
    /// Returns the law of these effects of a fit; `None` if it is no force at a port or has a memory.
    fn new(setting: &'l Setting, fit: &'l Fit<'l>, parts: Vec<usize>) -> Option<Self> {
        let first = |k: usize| fit.effects[..k].iter().map(|placed| placed.parameters.len()).sum();
        let parts: Vec<(&Placed, usize)> = parts.into_iter().map(|k| (&fit.effects[k], first(k))).collect();
        let law = |(placed, _): &(&Placed, usize)| forces(setting, placed, &placed.parameters);
        let all: Vec<(usize, Box<dyn Force>)> = parts.iter().flat_map(law).collect();
        let port = all.first()?.0;
        let memoryless = all.iter().all(|(at, law)| *at == port && law.states() == 0);
        memoryless.then_some(Self { setting, parts, covariance: &fit.covariance, port })
    }

    /// Returns the parameters of all parts.
    fn parameters(&self) -> Vec<f64> {
        self.parts.iter().flat_map(|(placed, _)| placed.parameters.iter().copied()).collect()
    }

    /// Returns the force with these parameters at each of some motions.
    fn force(&self, parameters: &[f64], motions: &[[f64; 2]]) -> DVector<f64> {
        let mut left = parameters;
        let mut laws = Vec::new();
        for (placed, _) in &self.parts {
            let (own, others) = left.split_at(placed.parameters.len());
            laws.extend(forces(self.setting, placed, own));
            left = others;
        }
        let at = |[d, v]: &[f64; 2]| laws.iter().map(|(_, law)| law.force(*d, *v, &[])).sum::<f64>();
        DVector::from_iterator(motions.len(), motions.iter().map(at))
    }

    /// Returns half the length of the 95 % interval of the force at each motion, from the covariance of the
    /// parameters; infinite if the records do not bound one of them.
    fn half(&self, motions: &[[f64; 2]]) -> Vec<f64> {
        let parameters = self.parameters();
        let entries = self.parts.iter().flat_map(|(placed, first)| *first..first + placed.parameters.len());
        let entries: Vec<usize> = entries.collect();
        let entry =
            |i: usize, j: usize| self.covariance.get((entries[i], entries[j])).copied().unwrap_or(f64::INFINITY);
        let covariance = DMatrix::from_fn(entries.len(), entries.len(), entry);
        if !covariance.iter().all(|entry| entry.is_finite()) {
            return vec![f64::INFINITY; motions.len()];
        }
        let slopes: Vec<DVector<f64>> = (0..parameters.len())
            .map(|k| {
                let std = covariance[(k, k)].max(0.0).sqrt();
                let step = (1e-4 * parameters[k].abs()).max(1e-2 * std).max(f64::MIN_POSITIVE);
                let moved = |by: f64| {
                    let mut moved = parameters.clone();
                    moved[k] += by;
                    self.force(&moved, motions)
                };
                (moved(step) - moved(-step)) / (2.0 * step)
            })
            .collect();
        let half = |x: usize| {
            let slope = DVector::from_iterator(slopes.len(), slopes.iter().map(|slope| slope[x]));
            QUANTILE * slope.dot(&(&covariance * &slope)).max(0.0).sqrt()
        };
        (0..motions.len()).map(half).collect()
    }

    /// Returns the shape over the motion on which the force depends more; `None` if it vanishes in the whole range.
    fn shape(&self, ranges: &[[f64; 2]; 2], named: &NamedEffect) -> Option<Shape> {
        let parameters = self.parameters();
        let curve = |over: Motion, [low, high]: [f64; 2]| {
            let points: Vec<f64> = grid(low, high);
            let motions: Vec<[f64; 2]> = points.iter().map(|x| over.at(*x)).collect();
            let force = self.force(&parameters, &motions);
            (over, points, motions, force)
        };
        let [by_d, by_v] = [curve(Motion::Displacement, ranges[0]), curve(Motion::Velocity, ranges[1])];
        let (over, points, motions, force) = if by_d.3.amax() >= by_v.3.amax() { by_d } else { by_v };
        if force.amax() == 0.0 || !force.iter().all(|f| f.is_finite()) {
            return None;
        }
        let half = self.half(&motions);
        let interval = || force.iter().zip(&half).map(|(force, half)| [force - half, force + half]).collect();
        let place = &self.parts[0].0.place;
        Some(Shape {
            effect: named.effect.clone(),
            location: named.location.clone(),
            family: named.family.as_ref().map(|family| family.name.clone()),
            over,
            unit: self.setting.unit(over.name(), place),
            force_unit: self.setting.unit("force", place),
            ci95: half.iter().all(|half| half.is_finite()).then(interval),
            points: points.into_iter().zip(&force).map(|(x, force)| [x, *force]).collect(),
        })
    }
}

/// Returns the forces of an effect with these parameters, each with its port.
fn forces(setting: &Setting, placed: &Placed, parameters: &[f64]) -> Vec<(usize, Box<dyn Force>)> {
    let force = |action| if let Action::Force(port, law) = action { Some((port, law)) } else { None };
    placed.effect.act(setting, &placed.place, parameters).into_iter().filter_map(force).collect()
}

/// Returns the points of a curve from the lowest to the highest motion. They are closer near rest, where friction
/// changes quickly.
fn grid(low: f64, high: f64) -> Vec<f64> {
    let shares = (0..POINTS).map(|k| (2 * k + 1) as f64 / POINTS as f64 - 1.0);
    // The first and the last point are at the ends of the range.
    let last = 1.0 - 1.0 / POINTS as f64;
    shares.map(|share| (share / last).powi(2) * if share < 0.0 { low } else { high }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Library, Place};
    use crate::plant::Plant;
    use crate::testing::truss;

    fn named(effect: &str) -> NamedEffect {
        NamedEffect {
            effect: effect.into(),
            location: "input:u1".into(),
            confidence: 0.9,
            family: None,
            share: None,
            share_ci95: None,
            parameters: std::collections::BTreeMap::new(),
            change: None,
            shape_differs: false,
        }
    }

    /// Returns the shape of a law at a port that moves by up to 2 with a velocity of up to 30.
    fn shape(effect: &str, parameters: &[f64], std: &[f64]) -> Option<Shape> {
        let (model, library) = (truss(1), Library::standard());
        let plant = Plant::new(&model).unwrap();
        let setting = Setting::bare(&plant, &model);
        let placed =
            Placed { effect: library.get(effect).unwrap(), place: Place::Input(0), parameters: parameters.to_vec() };
        let covariance = DMatrix::from_diagonal(&DVector::from_iterator(std.len(), std.iter().map(|s| s * s)));
        let port = forces(&setting, &placed, parameters).first()?.0;
        let law = Law { setting: &setting, parts: vec![(&placed, 0)], covariance: &covariance, port };
        law.shape(&[[-1.0, 2.0], [-30.0, 10.0]], &named(effect))
    }

    /// The curve of dry friction is over the velocity, from the lowest to the highest, with the force at rest on both
    /// sides of zero; and the interval is that of the force at rest there.
    #[test]
    fn friction_is_a_curve_over_the_velocity() {
        let found = shape("stick-friction", &[0.5, 0.8, 2.0], &[0.01, 0.05, 0.1]).unwrap();
        assert_eq!(
            (found.over, found.unit.as_str(), found.force_unit.as_str()),
            (Motion::Velocity, "velocity", "force")
        );
        let (first, last) = (found.points[0], found.points[POINTS - 1]);
        assert!((first[0] + 30.0).abs() < 1e-12 && (last[0] - 10.0).abs() < 1e-12, "{first:?} {last:?}");
        let law = |v: f64| -(0.5 + 0.3 * (-(v / 2.0).powi(2)).exp()) * v.signum();
        assert!(found.points.iter().all(|[v, f]| (f - law(*v)).abs() < 1e-12));
        let [low, high] = found.ci95.as_ref().unwrap()[POINTS / 2];
        let half = 1.96 * 0.05;
        let [_, rest] = found.points[POINTS / 2];
        assert!((rest + 0.8).abs() < 1e-4 && (rest - low - half).abs() < 1e-4 && (high - rest - half).abs() < 1e-4);
        // Far beyond the transition, it is that of the sliding force.
        let [low, high] = found.ci95.as_ref().unwrap()[0];
        assert!((high - low - 2.0 * 1.96 * 0.01).abs() < 1e-6);
    }

    /// Springs and stops are curves over the displacement. A law with a memory has no curve, and neither has one that
    /// the motion does not reach.
    #[test]
    fn springs_are_curves_over_the_displacement() {
        let spring = shape("cubic-stiffness", &[3.0], &[f64::INFINITY]).unwrap();
        assert_eq!((spring.over, spring.ci95), (Motion::Displacement, None));
        assert!(spring.points.iter().all(|[d, f]| (f + 3.0 * d.powi(3)).abs() < 1e-9));
        let stop = shape("end-stop", &[50.0, 3.0, 0.4], &[1.0, 1.0, 0.01]).unwrap();
        assert_eq!(stop.over, Motion::Displacement);
        assert!((stop.points[POINTS - 1][1] + 50.0 * 1.6).abs() < 1e-9);
        assert_eq!(shape("end-stop", &[50.0, 3.0, 4.0], &[1.0, 1.0, 0.01]), None);
    }
}
