//! The survey of an external simulator: the responses of its ports to forces, and the sizes of all signals.
//!
//! For a linear simulation, these follow from the matrices. Here they are measured in a few runs: the motion in the
//! loudest record, and at each port the velocity that a force causes, within a step and over the record.

use nalgebra::{DMatrix, DVector};
use plid_model::{Continuous, Model};
use plid_simulator::{Checked, Description, Motion, SimulatorError};

use crate::case::CaseConfig;
use crate::case::record::{Record, rms};
use crate::effects::{Setting, Units};
use crate::error::GapError;
use crate::in_loop::coupling::Response;
use crate::in_loop::runs::Runs;
use crate::plant::Plant;

/// The result of a survey.
pub(super) struct Survey {
    /// The sizes of the signals, the channels and the ports, as the effects see them.
    pub setting: Setting,
    /// The response of each port to a force.
    pub responses: Vec<Response>,
    /// The motion of each port at rest.
    pub start: Vec<Motion>,
}

/// Ratio of each trial force for the mobility of a port to the previous one. A port that sticks moves only under a
/// large force.
const GROWTH: f64 = 10.0;

/// The smallest and the largest trial force, in the port's unit.
const FORCES: [f64; 2] = [1e-6, 1e9];

/// Relative difference below which two mobilities count as equal, which shows that the port moves freely.
const SAME_MOBILITY: f64 = 0.05;

/// Velocity that the trial force causes, relative to the port's velocity in the loudest record.
const PROBE: f64 = 0.05;

/// Relative difference below which an output counts as a multiple of a port's displacement.
const SAME_SIGNAL: f64 = 1e-6;

/// Surveys a simulator with these records, of which `loudest` is the loudest.
pub(super) fn survey(
    simulator: &mut Checked<'_>,
    config: &CaseConfig,
    records: &[Record],
    loudest: &Record,
) -> Result<Survey, GapError> {
    let description = simulator.description().clone();
    let failed = |error: SimulatorError| GapError::Simulator(error);
    let step = 1.0 / (description.rate_hz * description.steps_per_sample.max(1) as f64);
    let count = description.ports.len();
    let mut mobilities = vec![0.0; count];
    for (port, mobility) in mobilities.iter_mut().enumerate() {
        *mobility = measured_mobility(simulator, port).map_err(failed)?;
    }
    let mut model = stand_in(&description, &mobilities, step);
    config.declare_kinds(&mut model);
    let mut setting = of_model(&description, &model)?;
    setting.units = units(&description, config);
    of_records(&mut setting, records, loudest);
    let (mut responses, mut start) = (Vec::new(), Vec::new());
    if count > 0 {
        let (y, motions) = Runs::watched(simulator, &loudest.u, |_, forces| forces.fill(0.0)).map_err(failed)?;
        start = motions.first().cloned().unwrap_or_default();
        let steps = description.steps_per_sample;
        for port in 0..count {
            let of = |part: fn(&Motion) -> f64| -> Vec<f64> { motions.iter().map(|all| part(&all[port])).collect() };
            let (d, v) = (of(|motion| motion.displacement), of(|motion| motion.velocity));
            responses.push(Response { mobility: mobilities[port], weight: weight(&d, &v, step), step });
            setting.d_rms[port] = spread(&d);
            setting.v_rms[port] = rms(&v);
            let sampled: Vec<f64> = d.iter().step_by(steps).copied().collect();
            if let Some((o, ratio)) = shown_by(&sampled, &y) {
                setting.d_range[port] = measured_range(o, ratio, records);
                // The measured motion of the plant is used, because that of the simulator may differ greatly from it.
                let measured = measured_spread(o, ratio, loudest);
                if measured > 0.0 && setting.d_rms[port] > 0.0 {
                    setting.v_rms[port] *= measured / setting.d_rms[port];
                    setting.d_rms[port] = measured;
                }
            }
        }
        for port in 0..count {
            let size = force(simulator, port, &loudest.u, &motions, &mobilities).map_err(failed)?;
            setting.force[port] = size;
            setting.stiffness[port] = if setting.d_rms[port] > 0.0 { size / setting.d_rms[port] } else { 0.0 };
        }
    }
    Ok(Survey { setting, responses, start })
}

/// The unit of a channel for which neither the case nor the simulator states one.
const AS_RECORDED: &str = "as recorded";

/// Returns the units that the case declares, or else those of the simulator.
pub(super) fn units(description: &Description, config: &CaseConfig) -> Units {
    let of_case = |name: &String, own: &Option<String>| config.units.get(name).or(own.as_ref()).cloned();
    Units {
        inputs: description.inputs.iter().map(|input| of_case(&input.name, &input.unit)).collect(),
        outputs: description.outputs.iter().map(|output| of_case(&output.name, &output.unit)).collect(),
        ports: description.ports.iter().map(|p| [p.force_unit.clone(), p.displacement_unit.clone()]).collect(),
        unknown: Some(AS_RECORDED),
    }
}

/// Returns the channels, places and parameters of a simulator without the sizes of the signals, for a prediction. The
/// stiffness at a port is not known then, and is one, so that an effect may act where only a held port has a place for
/// it.
pub(super) fn bare(description: &Description, responses: &[Response]) -> Result<Setting, GapError> {
    let mobilities: Vec<f64> = responses.iter().map(|response| response.mobility).collect();
    let step = responses.first().map_or(1.0, |response| response.step);
    let mut setting = of_model(description, &stand_in(description, &mobilities, step))?;
    setting.stiffness.fill(1.0);
    Ok(setting)
}

fn of_model(description: &Description, model: &Model) -> Result<Setting, GapError> {
    let mut setting = Setting::bare(&Plant::new(model)?, model);
    setting.names.ports = description.ports.iter().map(|port| port.name.clone()).collect();
    setting.names.parameters = description.parameters.iter().map(|parameter| parameter.name.clone()).collect();
    Ok(setting)
}

/// Sets the signal sizes that follow from the records.
fn of_records(setting: &mut Setting, records: &[Record], loudest: &Record) {
    let rate = setting.plant.rate;
    let finite = |y: &[f64]| -> Vec<f64> { y.iter().copied().filter(|y| y.is_finite()).collect() };
    setting.u_rms = loudest.u.iter().map(rms).collect();
    let slope = |u: &Vec<f64>| rms(u.windows(2).map(|two| (two[1] - two[0]) * rate).collect::<Vec<f64>>());
    setting.u_slope = loudest.u.iter().map(slope).collect();
    setting.y_rms = loudest.y.iter().map(|y| rms(finite(y))).collect();
    let largest = |o: usize| records.iter().flat_map(|record| finite(&record.y[o])).map(f64::abs).fold(0.0, f64::max);
    setting.y_max = (0..loudest.y.len()).map(largest).collect();
    let end = records.iter().map(|record| record.start_s + record.samples() as f64 / rate).fold(0.0, f64::max);
    setting.duration_s = end;
}

/// Returns a model with the simulator's channels and a free mass at each port. Effects need these properties of a
/// plant to choose their places and starting values.
fn stand_in(description: &Description, mobilities: &[f64], step: f64) -> Model {
    let (m, p, ports) = (description.inputs.len(), description.outputs.len(), description.ports.len());
    // One state is not driven; a model has at least one state.
    let n = 2 * ports + 1;
    let (mut a, mut discrete) = (DMatrix::zeros(n, n), DMatrix::identity(n, n));
    let last = n - 1;
    (a[(last, last)], discrete[(last, last)]) = (-1.0, (-1.0 / description.rate_hz).exp());
    let unit = |k: usize| DVector::from_fn(n, |i, _| if i == k { 1.0 } else { 0.0 });
    let mut all = Vec::new();
    for (j, port) in description.ports.iter().enumerate() {
        a[(2 * j, 2 * j + 1)] = 1.0;
        discrete[(2 * j, 2 * j + 1)] = 1.0 / description.rate_hz;
        all.push(plid_model::Port {
            name: port.name.clone(),
            input: port.input.clone(),
            force: (unit(2 * j + 1) * (mobilities[j] / step)).as_slice().to_vec(),
            displacement: unit(2 * j).as_slice().to_vec(),
            velocity: unit(2 * j + 1).as_slice().to_vec(),
            output: None,
        });
    }
    Model {
        sample_rate_hz: description.rate_hz,
        inputs: description.inputs.iter().map(|input| input.name.clone()).collect(),
        outputs: description.outputs.iter().map(|output| output.name.clone()).collect(),
        b: DMatrix::zeros(n, m),
        c: DMatrix::zeros(p, n),
        d: DMatrix::zeros(p, m),
        noise: plid_model::Noise::default(),
        predictor_gain: None,
        observability_indices: None,
        parameter_covariance: None,
        initial_state: None,
        provenance: None,
        continuous: Some(Continuous { a, b: DMatrix::zeros(n, m) }),
        ports: all,
        output_kinds: description.outputs.iter().map(|output| output.kind).collect(),
        a: discrete,
    }
}

/// Returns the change of a port's velocity over the first step per unit of force, at a force beyond which this ratio
/// no longer depends on the force. Returns zero if no force moves the port within a step.
fn measured_mobility(simulator: &mut Checked<'_>, port: usize) -> Result<f64, SimulatorError> {
    let (m, steps) = (simulator.description().inputs.len(), simulator.description().steps_per_sample);
    let ports = simulator.description().ports.len();
    let quiet = vec![vec![0.0; 2]; m.max(1)];
    let mut after = |size: f64| -> Result<f64, SimulatorError> {
        let (_, motions) = Runs::watched(simulator, &quiet, |step, forces| {
            forces.fill(0.0);
            if step == 0 {
                forces[port] = size;
            }
        })?;
        assert!(motions.len() == 2 * steps && motions[0].len() == ports);
        Ok(motions[1][port].velocity)
    };
    let still = after(0.0)?;
    let mut size = FORCES[0];
    let mut before = f64::NAN;
    while size <= FORCES[1] {
        let mobility = (after(size)? - still) / size;
        // A difference in the last digits of the velocity at rest is not a motion.
        let clear = (mobility * size).abs() > 1e-9 * still.abs();
        if clear && mobility != 0.0 && (mobility / before - 1.0).abs() < SAME_MOBILITY {
            return Ok(mobility.max(0.0));
        }
        before = mobility;
        size *= GROWTH;
    }
    Ok(0.0)
}

/// Returns the weight of the velocity after a step in the change of the displacement over that step.
fn weight(d: &[f64], v: &[f64], step: f64) -> f64 {
    let (mut up, mut down) = (0.0, 0.0);
    for k in 1..d.len() {
        let (change, rise) = (d[k] - d[k - 1] - step * v[k - 1], step * (v[k] - v[k - 1]));
        up += change * rise;
        down += rise * rise;
    }
    if down > 0.0 { (up / down).clamp(0.0, 1.0) } else { 0.5 }
}

/// Returns the RMS of a displacement relative to its first value.
fn spread(d: &[f64]) -> f64 {
    let start = d.first().copied().unwrap_or(0.0);
    rms(d.iter().map(|d| d - start).collect::<Vec<f64>>())
}

/// Returns the output that measures a displacement, and the ratio of the output to the displacement.
fn shown_by(d: &[f64], y: &[Vec<f64>]) -> Option<(usize, f64)> {
    let square = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
    let ratio = |y: &[f64]| {
        let ratio = d.iter().zip(y).map(|(d, y)| d * y).sum::<f64>() / square(d);
        let apart: f64 = d.iter().zip(y).map(|(d, y)| (y - ratio * d).powi(2)).sum();
        (ratio.is_finite() && ratio != 0.0 && apart <= SAME_SIGNAL.powi(2) * square(y)).then_some(ratio)
    };
    y.iter().enumerate().find_map(|(o, y)| Some((o, ratio(y)?)))
}

/// Returns the lowest and the highest displacement in all records.
fn measured_range(o: usize, ratio: f64, records: &[Record]) -> Option<[f64; 2]> {
    let seen = records.iter().flat_map(|record| &record.y[o]).filter(|y| y.is_finite()).map(|y| y / ratio);
    let [low, high] = seen.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], d| [low.min(d), high.max(d)]);
    (low < high).then_some([low, high])
}

/// Returns the RMS of the displacement in a record.
fn measured_spread(o: usize, ratio: f64, record: &Record) -> f64 {
    let seen: Vec<f64> = record.y[o].iter().filter(|y| y.is_finite()).map(|y| y / ratio).collect();
    if seen.is_empty() { 0.0 } else { rms(seen) }
}

/// Returns the force that moves a port about as much as the inputs do. For this purpose, a random force of known size
/// is added in the loudest record and scaled to the motion there.
fn force(
    simulator: &mut Checked<'_>,
    port: usize,
    u: &[Vec<f64>],
    motions: &[Vec<Motion>],
    mobilities: &[f64],
) -> Result<f64, SimulatorError> {
    let velocity = rms(motions.iter().map(|all| all[port].velocity).collect::<Vec<f64>>());
    if !(mobilities[port] > 0.0 && velocity > 0.0) {
        return Ok(0.0);
    }
    // The force is held for the duration of a typical motion: the time between two changes of the velocity's sign.
    let signs = motions.windows(2).filter(|two| two[0][port].velocity * two[1][port].velocity < 0.0).count();
    let hold = (motions.len() / (signs + 1)).clamp(1, motions.len());
    let size = PROBE * velocity / (mobilities[port] * (hold as f64).sqrt());
    let sign = |step: usize| if (step / hold).wrapping_mul(0x9E37_79B9) & 0x8000 == 0 { 1.0 } else { -1.0 };
    let (_, pushed) = Runs::watched(simulator, u, |step, forces| {
        forces.fill(0.0);
        forces[port] = size * sign(step);
    })?;
    let change: Vec<f64> = pushed.iter().zip(motions).map(|(a, b)| a[port].velocity - b[port].velocity).collect();
    let answer = rms(&change) / size;
    Ok(if answer > 0.0 { velocity / answer } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Place;
    use plid_simulator::{Input, Output, Port};

    /// Units are those of the case where it declares them, and otherwise those of the simulator.
    #[test]
    fn units_are_those_of_the_simulator() {
        let input = Input { unit: Some("N m".into()), ..Input::new("u") };
        let mut description = Description::new("s", 100.0, vec![input], vec![Output::new("y")]);
        description.steps_per_sample = 1;
        description.ports = vec![
            Port {
                input: Some("u".into()),
                force_unit: Some("N m".into()),
                displacement_unit: Some("rad".into()),
                ..Port::new("joint")
            },
            Port::new("other"),
        ];
        let mut config = CaseConfig::new(100.0, vec!["u".into()], vec!["y".into()]);
        let response = Response { mobility: 1.0, weight: 0.5, step: 0.01 };
        let mut setting = bare(&description, &[response; 2]).unwrap();
        setting.units = units(&description, &config);
        let of = |unit: &str, place: Place| setting.unit(unit, &place);
        assert_eq!(of("force/displacement^3", Place::Input(0)), "N m/rad^3");
        assert_eq!(of("force/velocity", Place::Input(0)), "N m s/rad");
        assert_eq!(of("velocity", Place::Input(0)), "rad/s");
        assert_eq!(of("force/velocity", Place::Port(1)), "force/velocity");
        assert_eq!(of("V", Place::Input(0)), "N m");
        assert_eq!(of("V/s", Place::Output(0)), "as recorded/s");
        assert_eq!(of("Hz", Place::Input(0)), "Hz");
        config.units.insert("y".into(), "rad".into());
        setting.units = units(&description, &config);
        assert_eq!(setting.unit("V/s", &Place::Output(0)), "rad/s");
    }
}
