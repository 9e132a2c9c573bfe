//! The derivative of a displacement that each output measures.
//!
//! A mode in physical form is q" + 2 zeta w q' + w^2 q = beta f, and a sensor measures gamma q^(k): a displacement for
//! k = 0, a velocity for k = 1, an acceleration for k = 2. The order k determines how a changed mode changes the
//! outputs. It also determines the motion of the modes at an actuator. An output that is declared as a force or as
//! something else, such as a temperature, measures no motion and has no order.

use std::f64::consts::TAU;

use nalgebra::DMatrix;
use plid_model::OutputKind;
use serde::Serialize;

use super::{Plant, lowest};
use plid_fourier::C;

/// Number of frequencies at which the orders are compared.
const FREQUENCIES: usize = 120;

/// The lowest frequency of the comparison, relative to the lowest mode: there a displacement is constant, and an
/// acceleration vanishes.
const BELOW: f64 = 0.1;

/// The highest frequency of the comparison, relative to the highest mode.
const ABOVE: f64 = 4.0;

/// Frequencies, relative to the sample rate, between which the slope of a response without resonances is computed.
const SLOPE_BETWEEN: [f64; 2] = [0.125, 0.25];

/// The slope halfway between those of a position (-2) and of a velocity (-1).
const POSITION_OR_VELOCITY: f64 = -1.5;

/// The slope halfway between those of a velocity (-1) and of an acceleration (0).
const VELOCITY_OR_ACCELERATION: f64 = -0.5;

/// The source of an output's kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum KindSource {
    /// The simulation or the case declares it.
    Declared,
    /// The kind is inferred from the simulation's responses.
    Inferred,
    /// An acceleration is assumed, because the kind is not declared and cannot be inferred.
    Assumed,
}

/// The quantity that an output measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sensed {
    /// The kind of the quantity.
    pub kind: OutputKind,
    /// The source of the kind.
    pub source: KindSource,
}

impl Sensed {
    /// The default assumption.
    pub(super) const ASSUMED: Self = Self { kind: OutputKind::Acceleration, source: KindSource::Assumed };

    /// Returns the order of the derivative of a displacement that is measured: 0, 1 or 2; `None` if no motion is.
    pub fn order(self) -> Option<i32> {
        match self.kind {
            OutputKind::Position => Some(0),
            OutputKind::Velocity => Some(1),
            OutputKind::Acceleration => Some(2),
            OutputKind::Force | OutputKind::Other => None,
        }
    }

    /// Returns whether a motion is measured.
    pub fn is_motion(self) -> bool {
        self.order().is_some()
    }

    /// Returns the order with which an added mode appears. Where no motion is measured, its displacement appears.
    pub fn order_of_added(self) -> i32 {
        self.order().unwrap_or(0)
    }

    fn inferred(order: i32) -> Self {
        let kind = match order {
            0 => OutputKind::Position,
            1 => OutputKind::Velocity,
            _ => OutputKind::Acceleration,
        };
        Self { kind, source: KindSource::Inferred }
    }
}

/// Returns what all outputs (p) measure, as declared or as inferred from the simulation.
pub(super) fn sensed(plant: &Plant, declared: &[Option<OutputKind>]) -> Vec<Sensed> {
    (0..plant.p)
        .map(|o| match declared.get(o).copied().flatten() {
            Some(kind) => Sensed { kind, source: KindSource::Declared },
            None => inferred(plant, o),
        })
        .collect()
}

fn inferred(plant: &Plant, output: usize) -> Sensed {
    if plant.modes.is_empty() {
        return by_slope(plant, output);
    }
    let free = moves_freely(plant);
    let mut distances: Vec<(f64, i32)> = (0..3).map(|order| (distance(plant, output, order, free), order)).collect();
    distances.sort_by(|a, b| a.0.total_cmp(&b.0));
    let [(nearest, order), (next, _), ..] = distances[..] else { return Sensed::ASSUMED };
    // The distance is NaN if nothing can be compared, and NaN is not below the threshold.
    if nearest < plant.settings.kind_distance && nearest < plant.settings.kind_ratio * next {
        Sensed::inferred(order)
    } else {
        Sensed::ASSUMED
    }
}

/// Returns the sum, over all outputs that measure a motion, of the distances of their responses from those of the
/// actuators, modes, filters and sensors together, divided by the number of all outputs; NaN if it is not known.
pub(super) fn misfit(plant: &Plant) -> f64 {
    let of = |o: usize| plant.sensed[o].order().map(|order| distance(plant, o, order, false));
    (0..plant.p).filter_map(of).sum::<f64>() / plant.p as f64
}

/// Infers the order of an output of a plant without modes from the decay of its response at high frequencies. A force
/// causes an acceleration at once; a velocity decays as 1/s, and a position as 1/s^2.
fn by_slope(plant: &Plant, output: usize) -> Sensed {
    let size = |share: f64| {
        let beside = beside_modes(plant, output, C::new(0.0, TAU * share * plant.rate))?;
        let response = beside.iter().enumerate().map(|(i, g)| g + plant.d[(output, i)]);
        Some(response.map(|g| g.norm_sqr()).sum::<f64>().sqrt())
    };
    let [from, to] = SLOPE_BETWEEN;
    let slope = size(from).zip(size(to)).map(|(low, high)| (high / low).ln() / (to / from).ln());
    match slope {
        Some(slope) if slope < POSITION_OR_VELOCITY => Sensed::inferred(0),
        Some(slope) if slope < VELOCITY_OR_ACCELERATION => Sensed::inferred(1),
        _ => Sensed::ASSUMED,
    }
}

/// Returns whether the poles beside the modes belong to the motion of a rigid body, as a motor and its load turn
/// together: whether they are slower than all modes, and no actuator or filter is known.
fn moves_freely(plant: &Plant) -> bool {
    !plant.chain.known() && plant.fastest_beside().is_some_and(|pole| pole < lowest(&plant.modes))
}

/// Returns the mean of |G - G_k|^2 / (|G|^2 + |G_k|^2) over inputs and logarithmic frequencies. G is the simulation's
/// response, and G_k that of its modes, and of a rigid body beside them if it is `free`, if sensors measure the k-th
/// derivative. NaN without modes or if the rest has no continuous form.
fn distance(plant: &Plant, output: usize, order: i32, free: bool) -> f64 {
    let (Some(lowest), Some(highest)) = (plant.modes.first(), plant.modes.last()) else { return f64::NAN };
    let (from, to) = (BELOW * lowest.hz(), (ABOVE * highest.hz()).min(plant.rate / 2.0));
    let mut sum = 0.0;
    for step in 0..FREQUENCIES {
        let hz = from * (to / from).powf(step as f64 / (FREQUENCIES - 1) as f64);
        let s = C::new(0.0, TAU * hz);
        let Some(beside) = beside_modes(plant, output, s) else { return f64::NAN };
        for (i, beside) in beside.into_iter().enumerate() {
            let given = beside + plant.d[(output, i)] + of_modes(plant, output, i, s);
            let through = plant.chain.before(i, s) * plant.chain.behind(output, s);
            let modes = plant.modes.iter();
            let of_order: C = modes
                .map(|mode| plant.product_of(mode, output, i, order) * Plant::derivative(order, mode.pole, s))
                .sum::<C>()
                * through
                + if free { beside } else { C::ZERO };
            let both = given.norm_sqr() + of_order.norm_sqr();
            sum += if both > 0.0 { (given - of_order).norm_sqr() / both } else { 0.0 };
        }
    }
    sum / (FREQUENCIES * plant.m) as f64
}

/// Returns the part of the poles beside the modes in the response of one output to each input (m) at s, in continuous
/// time; `None` if the rest has no continuous form.
fn beside_modes(plant: &Plant, output: usize, s: C) -> Option<Vec<C>> {
    let (a, b) = plant.rest.continuous.as_ref()?;
    if a.is_empty() {
        return Some(vec![C::ZERO; plant.m]);
    }
    let shifted = DMatrix::from_diagonal_element(a.nrows(), a.nrows(), s) - a.map(C::from);
    let states = shifted.lu().solve(&b.map(C::from))?;
    Some((plant.rest.c.row(output).map(C::from) * states).iter().copied().collect())
}

/// Returns the part of the modes in the response of one output to one input at s.
fn of_modes(plant: &Plant, output: usize, input: usize, s: C) -> C {
    let part = |mode: &super::Mode| {
        let residue = mode.c[output] * mode.b[input];
        residue / (s - mode.pole) + residue.conj() / (s - mode.pole.conj())
    };
    plant.modes.iter().map(part).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::drive::{MOTOR, matrix};
    use crate::testing::{self, Sensor};

    /// The kind of each sensor is inferred for the same truss, with actuators and filters.
    #[test]
    fn each_sensor_is_told_from_the_simulation() {
        for seed in 0..4 {
            for (sensor, kind) in [
                (Sensor::Position, OutputKind::Position),
                (Sensor::Velocity, OutputKind::Velocity),
                (Sensor::Acceleration, OutputKind::Acceleration),
            ] {
                let plant = Plant::new(&testing::truss_sensed(seed, sensor, |_| {})).unwrap();
                for sensed in &plant.sensed {
                    assert_eq!((sensed.kind, sensed.source), (kind, KindSource::Inferred), "{seed}");
                }
            }
        }
    }

    /// A slow pole in a plant with a mode is not taken for an actuator, although one input drives all poles. The
    /// plant resembles a model that was identified from records of a position, and its slow pole contributes half of
    /// the static response.
    #[test]
    fn a_slow_pole_next_to_a_mode_is_not_a_lag() {
        let (w, slow, rate) = (250.0, 19.0, 750.0);
        let a = nalgebra::dmatrix![0.0, 1.0, 0.0; -w * w, -0.1 * w, 0.0; 0.0, 0.0, -slow];
        let (a, b) = testing::held(&a, &nalgebra::dmatrix![0.0; 1.0; slow / (w * w)], 1.0 / rate);
        let c = nalgebra::dmatrix![1.0, 0.0, 1.0];
        let model = plid_model::Model::new(rate, a, b, c, DMatrix::zeros(1, 1)).unwrap();
        let plant = Plant::new(&model).unwrap();
        assert_eq!(plant.sensed[0], Sensed::inferred(0));
        assert!(!plant.chain.known());
    }

    /// A motor turns a load through an elastic shaft, and its position, its velocity or its acceleration is measured.
    /// Both inertias turn together beside the mode.
    #[test]
    fn the_motion_of_a_drive_is_told_from_its_mode_and_its_rigid_body() {
        let a = matrix(400.0, 0.3, [2.1, 1.2]);
        let (held, b) = testing::held(&a, &nalgebra::dmatrix![0.0; 1.0 / MOTOR; 0.0; 0.0], 1.0 / 500.0);
        for (row, d, kind) in [
            (nalgebra::dmatrix![1.0, 0.0, 0.0, 0.0], 0.0, OutputKind::Position),
            (nalgebra::dmatrix![0.0, 1.0, 0.0, 0.0], 0.0, OutputKind::Velocity),
            (a.rows(1, 1).into_owned(), 1.0 / MOTOR, OutputKind::Acceleration),
        ] {
            let d = DMatrix::from_element(1, 1, d);
            let plant = Plant::new(&plid_model::Model::new(500.0, held.clone(), b.clone(), row, d).unwrap()).unwrap();
            assert_eq!((plant.modes.len(), plant.sensed[0].kind), (1, kind));
            let source = plant.sensed[0].source;
            assert!(source == KindSource::Inferred || kind == OutputKind::Acceleration, "{kind:?} {source:?}");
        }
    }

    /// Two equal poles of a filter cannot be assigned to it. They are no motion of a rigid body, and the accelerometer
    /// in front of them is no position sensor.
    #[test]
    fn an_accelerometer_behind_equal_poles_remains_one() {
        let (w, filter, rate) = (TAU * 50.0, TAU * 600.0, 4000.0);
        let a = nalgebra::dmatrix![
            0.0, 1.0, 0.0, 0.0;
            -w * w, -0.02 * w, 0.0, 0.0;
            -w * w * filter, -0.02 * w * filter, -filter, 0.0;
            0.0, 0.0, filter, -filter
        ];
        let (a, b) = testing::held(&a, &nalgebra::dmatrix![0.0; 1.0; filter; 0.0], 1.0 / rate);
        let c = nalgebra::dmatrix![0.0, 0.0, 0.0, 1.0];
        let plant = Plant::new(&plid_model::Model::new(rate, a, b, c, DMatrix::zeros(1, 1)).unwrap()).unwrap();
        assert!(!plant.chain.known());
        assert_eq!(plant.sensed[0].kind, OutputKind::Acceleration);
    }

    #[test]
    fn a_declaration_comes_first() {
        let mut model = testing::truss(1);
        model.output_kinds[0] = Some(OutputKind::Velocity);
        model.output_kinds[1] = Some(OutputKind::Other);
        let plant = Plant::new(&model).unwrap();
        assert_eq!(plant.sensed[0], Sensed { kind: OutputKind::Velocity, source: KindSource::Declared });
        assert_eq!(plant.sensed[1], Sensed { kind: OutputKind::Other, source: KindSource::Declared });
    }

    /// A structure whose outputs are all declared to measure no motion has no ports, not even on single modes. Its
    /// modes can still be moved, and then its outputs show the same states.
    #[test]
    fn without_a_motion_there_is_no_port() {
        for kind in [OutputKind::Force, OutputKind::Other] {
            let mut model = testing::truss(1);
            model.ports.clear();
            assert_eq!(Plant::new(&model).unwrap().ports.len(), 2);
            model.output_kinds = vec![Some(kind); 2];
            let mut plant = Plant::new(&model).unwrap();
            plant.add_modal_port(0);
            assert!(plant.ports.is_empty(), "{kind:?}");
            let (shown, rest) = (plant.modes[0].c.clone(), plant.rest.clone());
            plant.move_pole(0, plant.modes[0].pole * 1.01);
            let behind = |pole: C| plant.chain.behind(0, pole);
            let ratio = behind(plant.modes[0].pole) / behind(plant.modes[0].pole / 1.01);
            assert!((plant.modes[0].c[0] - shown[0] * ratio).norm() < 1e-9 * shown[0].norm());
            assert_eq!(plant.rest, rest);
        }
    }

    /// Beside a force sensor and a temperature, the port of an accelerometer is that of the accelerometer alone.
    #[test]
    fn an_output_without_motion_does_not_scale_a_port() {
        use crate::testing::accelerometers::model;
        let alone = model(0.0, 0.0);
        let mut beside = alone.clone();
        beside.c = beside.c.insert_row(2, 0.7);
        beside.d = beside.d.insert_row(2, 0.3);
        beside.outputs.push("y3".into());
        let ports = |model: &plid_model::Model| Plant::new(model).unwrap().ports;
        let expected = ports(&alone);
        for kind in [OutputKind::Force, OutputKind::Other] {
            beside.output_kinds = alone.output_kinds.iter().copied().chain([Some(kind)]).collect();
            let found = ports(&beside);
            assert_eq!(found.len(), expected.len());
            for (found, expected) in found.iter().zip(&expected) {
                assert_eq!((&found.name, found.input), (&expected.name, expected.input));
                let compliance = |port: &crate::plant::Port| -> Vec<C> {
                    port.force.iter().zip(&port.displacement).map(|(force, row)| force * row).collect()
                };
                for (found, expected) in compliance(found).into_iter().zip(compliance(expected)) {
                    assert!((found - expected).norm() < 1e-9 * expected.norm(), "{found} {expected}");
                }
                assert_eq!(found.output[2], 0.0);
            }
        }
    }
}
