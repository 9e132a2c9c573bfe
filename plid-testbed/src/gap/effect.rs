//! An effect's place and parameters, before its strength is found.

use std::f64::consts::TAU;
use std::ops::Range;

use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use serde_json::{Map, Value, json};

use super::GapError;
use super::plant::{Drawn, EFFECTS};
use super::spec::{Channels, EffectSpec, GapSpec};
use super::strength::Signals;
use crate::effects::{Effect, own};
use crate::streams::{Purpose, stream};
use crate::{ACTUATOR_POLE_HZ, INPUTS, OUTPUTS};

/// The kind of place that an effect takes.
enum Place {
    Input,
    InputOrAll,
    InputPair,
    Output,
    OutputPair,
    Mode,
    None,
}

/// The effect of a spec; unspecified values are drawn.
pub(crate) fn drawn(
    seed: u64,
    index: usize,
    wanted: &EffectSpec,
    spec: &GapSpec,
    drawn: &Drawn,
    signals: &Signals,
) -> Result<Effect, GapError> {
    let channels = spec.channels;
    let wrong = |reason: String| GapError::Spec { number: index + 1, kind: wanted.kind.clone(), reason };
    if !(wanted.gap > 0.0 && wanted.gap.is_finite()) {
        return Err(wrong(format!("its gap must be positive and finite, not {}", wanted.gap)));
    }
    let mut rng = stream(seed, Purpose::Draw, EFFECTS + index);
    let place = place_of(&wanted.kind).ok_or_else(|| wrong("there is no effect of this kind".to_owned()))?;
    if !spec.plant.takes(&wanted.kind) {
        return Err(wrong("it makes no sense on this kind of plant".to_owned()));
    }
    if let Some(reason) = lacking(&wanted.kind, &place, channels) {
        return Err(wrong(reason.to_owned()));
    }
    let random = random_place(&place, channels, &drawn.dominant, &mut rng);
    let at = wanted.at.clone().or(random);
    if let Some(at) = at.as_deref().filter(|at| !is_there(at, channels)) {
        let Channels { inputs, outputs } = channels;
        return Err(wrong(format!("a case of {inputs} inputs and {outputs} outputs has no `{at}`")));
    }
    let channel = at.as_deref().map_or(0, first_number);
    let (kind, parameters) = match own::find(&wanted.kind) {
        Some(truth) => ("own", json!({ "name": truth.name(), "parameters": truth.start(&signals.at(channel)) })),
        None => (wanted.kind.as_str(), parameters(&wanted.kind, channel, drawn, signals, &mut rng)),
    };
    let Value::Object(mut keys) = parameters else { unreachable!("parameters are made as an object") };
    keys.insert("kind".to_owned(), Value::from(kind));
    let mut also = |key: &str, value: &Option<String>| {
        if let Some(text) = value {
            keys.insert(key.to_owned(), Value::from(text.as_str()));
        }
    };
    also("at", &at);
    also("law", &wanted.law);
    serde_json::from_value(Value::Object(Map::clone(&keys))).map_err(|e| wrong(e.to_string()))
}

/// The channel in `u2`, `y1->y3` or `m4`, from 0; a wrong place is found when the effect is made.
fn first_number(place: &str) -> usize {
    let digit = place.chars().nth(1).and_then(|c| c.to_digit(10)).unwrap_or(1);
    (digit as usize).clamp(1, INPUTS) - 1
}

/// Returns whether an effect is a force at the port of one input, on its strut or its axis, that follows its motion.
pub(super) fn is_at_a_port(kind: &str) -> bool {
    matches!(
        kind,
        "cubic-stiffness"
            | "quadratic-stiffness"
            | "coulomb-friction"
            | "clearance"
            | "iwan-joint"
            | "joint-hysteresis"
            | "quadratic-damping"
            | "stick-friction"
            | "backlash"
            | "end-stop"
            | "one-sided-stop"
            | "gravity-sine"
            | "added-mass"
            | "added-damping"
            | "added-stiffness"
    )
}

fn place_of(kind: &str) -> Option<Place> {
    if let Some(truth) = own::find(kind) {
        return Some(match truth.side() {
            own::Side::Port | own::Side::Actuator => Place::Input,
            own::Side::Sensor => Place::Output,
        });
    }
    Some(match kind {
        "modal-frequency" | "modal-damping" => Place::Mode,
        "missing-mode" | "stiffness-drift" => Place::None,
        "actuator-delay" => Place::InputOrAll,
        "actuator-crosstalk" => Place::InputPair,
        "sensor-crosstalk" => Place::OutputPair,
        "mains-hum" => Place::Output,
        force if is_at_a_port(force) => Place::Input,
        "narrowband-disturbance" | "coloured-disturbance" => Place::Input,
        "actuator-saturation"
        | "actuator-dead-zone"
        | "actuator-hysteresis"
        | "actuator-slew-limit"
        | "actuator-lag"
        | "actuator-gain"
        | "actuator-gain-drift" => Place::Input,
        "sensor-saturation"
        | "sensor-gain"
        | "sensor-delay"
        | "sensor-lag"
        | "sensor-offset"
        | "sensor-drift"
        | "sensor-noise"
        | "sensor-quantisation"
        | "sensor-dropout" => Place::Output,
        outsider => return place_of_outsider(outsider),
    })
}

fn place_of_outsider(kind: &str) -> Option<Place> {
    Some(match kind {
        "x-parametric-stiffness" | "x-varying-damping" | "x-supply-sag" => Place::None,
        "x-command-play" | "x-delay-jitter" | "x-sticking-valve" | "x-thermal-gain" => Place::Input,
        "x-force-factor" | "x-intermittent-contact" => Place::Input,
        "x-foreshortening" => Place::InputPair,
        "x-sensor-rate-limit" | "x-sensor-square" | "x-channel-product" => Place::Output,
        "x-clock-skew" | "x-proportional-noise" => Place::Output,
        "x-resonant-crosstalk" => Place::OutputPair,
        _ => return None,
    })
}

/// Why an effect cannot be where there are so few channels.
fn lacking(kind: &str, place: &Place, channels: Channels) -> Option<&'static str> {
    match place {
        Place::InputPair if channels.inputs < 2 => Some("it needs two inputs, and the case has one"),
        Place::OutputPair if channels.outputs < 2 => Some("it needs two outputs, and the case has one"),
        _ if kind == "x-supply-sag" && channels.inputs < 2 => Some("it needs two inputs, and the case has one"),
        _ if kind == "x-channel-product" && channels.outputs < OUTPUTS => Some("it needs three outputs"),
        _ => None,
    }
}

/// Whether a case has the channels of a place; an invalid place is found when the effect is made.
fn is_there(at: &str, channels: Channels) -> bool {
    at.split("->").all(|part| {
        let most = match part.chars().next() {
            Some('u') => channels.inputs,
            Some('y') => channels.outputs,
            _ => return true,
        };
        part[1..].parse().map_or(true, |number: usize| number <= most)
    })
}

fn random_place(
    place: &Place,
    Channels { inputs, outputs }: Channels,
    dominant: &Range<usize>,
    rng: &mut ChaCha12Rng,
) -> Option<String> {
    let mut pair = |letter: char, count: usize| {
        let from = rng.random_range(0..count);
        let to = (from + rng.random_range(1..count)) % count;
        format!("{letter}{}->{letter}{}", from + 1, to + 1)
    };
    match place {
        Place::Input => Some(format!("u{}", rng.random_range(1..=inputs))),
        // All of one input is that input.
        Place::InputOrAll if inputs == 1 => Some("u1".to_owned()),
        Place::InputOrAll => Some(match rng.random_range(1..=inputs + 1) {
            all if all > inputs => "all".to_owned(),
            one => format!("u{one}"),
        }),
        Place::InputPair => Some(pair('u', inputs)),
        Place::Output => Some(format!("y{}", rng.random_range(1..=outputs))),
        Place::OutputPair => Some(pair('y', outputs)),
        Place::Mode => Some(format!("m{}", rng.random_range(dominant.clone()) + 1)),
        Place::None => None,
    }
}

/// Parameters of a strength that the search then changes; the others are final.
fn parameters(kind: &str, channel: usize, drawn: &Drawn, signals: &Signals, rng: &mut ChaCha12Rng) -> Value {
    let (d, v, y) = (signals.displacement[channel], signals.velocity[channel], signals.output[channel]);
    let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
    let mut within = |low: f64, high: f64| rng.random_range(low..high);
    match kind {
        "cubic-stiffness" => json!({ "stiffness_per_v2": sign * 0.01 / (d * d), "scale_v": d }),
        "quadratic-stiffness" => json!({ "stiffness_per_v": sign * 0.01 / d }),
        "coulomb-friction" => json!({ "friction_v": 0.01, "transition_v_per_s": within(0.05, 0.15) * v }),
        "clearance" => json!({ "stiffness": sign * 0.01, "gap_v": within(0.6, 1.6) * d }),
        // The simulation lacks the joint, or has it as a spring.
        "iwan-joint" => json!({
            "stiffness": 0.01, "slip_v": within(1.5, 4.0) * d, "exponent": within(-0.8, -0.2), "held": sign.max(0.0),
        }),
        "joint-hysteresis" => json!({ "stiffness": 0.01, "yield_v": within(0.4, 1.2) * d }),
        "quadratic-damping" => json!({ "damping_s2_per_v": 0.01 / (v * v), "scale_v_per_s": v }),
        "modal-frequency" => json!({ "change": sign * 0.005 }),
        "modal-damping" => json!({ "factor": (sign * 0.3_f64).exp() }),
        "missing-mode" => {
            let mode = drawn.left_out.as_ref().expect("the truss was drawn for it");
            json!({
                "frequency_hz": mode.frequency_hz, "damping_ratio": mode.damping_ratio,
                "input_shape": mode.input_shape, "output_shape": mode.output_shape,
            })
        }
        "stiffness-drift" => json!({ "rate_per_s": sign * 1e-4 }),
        "stick-friction" => {
            json!({ "slides_v": 0.05, "holds_v": 0.05 * within(1.1, 1.6), "transition_v_per_s": within(0.05, 0.3) * v })
        }
        "backlash" | "end-stop" | "one-sided-stop" | "gravity-sine" | "added-mass" | "added-damping"
        | "added-stiffness" => of_axis(kind, channel, sign, drawn, signals, rng),
        actuator if actuator.starts_with("actuator-") => of_actuator(actuator, channel, sign, drawn, rng),
        "sensor-saturation" => json!({ "limit_v": 2.0 * y }),
        "sensor-gain" => json!({ "gain": 1.0 + sign * 0.05 }),
        "sensor-delay" => json!({ "delay_samples": 0.3 }),
        "sensor-lag" => json!({ "corner_hz": 600.0 }),
        "sensor-crosstalk" => json!({ "share": sign * 0.05 }),
        "sensor-offset" => json!({ "offset_v": sign * 0.02 }),
        "sensor-drift" => json!({ "rate_v_per_s": sign * 1e-3 }),
        "mains-hum" => {
            let frequency_hz = if sign > 0.0 { 50.0 } else { 60.0 } + within(-0.05, 0.05);
            let mut harmonic = |multiple: u32, share: f64| {
                json!({ "multiple": multiple,
                "amplitude_v": 0.03 * share * within(0.5, 1.5), "phase_rad": within(0.0, TAU) })
            };
            let harmonics = [harmonic(2, 0.1), harmonic(3, 0.3), harmonic(5, 0.15)];
            json!({
                "amplitude_v": 0.03, "frequency_hz": frequency_hz, "phase_rad": within(0.0, TAU),
                    "harmonics": harmonics,
            })
        }
        "sensor-noise" => json!({ "rms_v": 0.02 }),
        "sensor-quantisation" => json!({ "step_v": 0.05 }),
        "sensor-dropout" => json!({ "onsets_per_sample": 1e-3 }),
        "narrowband-disturbance" => {
            json!({ "amplitude_v": 0.1, "frequency_hz": within(80.0, 240.0), "phase_rad": within(0.0, TAU) })
        }
        "coloured-disturbance" => json!({ "rms_v": 0.1, "frequency_hz": within(80.0, 240.0) }),
        outsider if outsider.starts_with("x-") => of_outsider(outsider, channel, sign, drawn, signals, rng),
        other => unreachable!("{other} has a place and no parameters"),
    }
}

/// Parameters of an effect of an axis. A stop begins where few displacements reach, and the search brings it nearer.
fn of_axis(kind: &str, channel: usize, sign: f64, drawn: &Drawn, signals: &Signals, rng: &mut ChaCha12Rng) -> Value {
    let axes = drawn.base.axes.as_ref().expect("no other plant takes it");
    let (own, d) = (axes.own(channel), signals.displacement[channel]);
    let mut stop = |side: f64| {
        // The rate at which the axis would bounce on it, rad/s.
        let w = TAU * rng.random_range(BOUNCE) * drawn.base.sample_rate_hz;
        let damping = 2.0 * rng.random_range(BOUNCE_DAMPING) * w * own.inertia;
        json!({ "stiffness": w * w * own.inertia, "damping_s": damping, "gap_v": side * 1.5 * d })
    };
    match kind {
        "backlash" => json!({ "stiffness": own.stiffness, "gap_v": 0.1 * d }),
        "end-stop" => stop(1.0),
        "one-sided-stop" => stop(sign),
        "gravity-sine" => json!({ "stiffness": 0.3 * own.stiffness, "whole": own.stiffness }),
        "added-mass" => json!({ "mass_s2": 0.1 * own.inertia }),
        "added-damping" if own.damping > 0.0 => json!({ "damping_s": 0.1 * own.damping }),
        "added-stiffness" if own.stiffness > 0.0 => json!({ "stiffness": 0.1 * own.stiffness }),
        // Where the axis has none, one with a time constant, or a period over 2 pi, of a second.
        "added-damping" => json!({ "damping_s": own.inertia }),
        "added-stiffness" => json!({ "stiffness": own.inertia }),
        other => unreachable!("{other} has a place and no parameters"),
    }
}

/// Frequency over the sample rate, and damping ratio, with which an axis would bounce on a stop.
const BOUNCE: Range<f64> = 0.03..0.1;
const BOUNCE_DAMPING: Range<f64> = 0.1..0.4;

/// Parameters of an effect of an actuator.
fn of_actuator(kind: &str, channel: usize, sign: f64, drawn: &Drawn, rng: &mut ChaCha12Rng) -> Value {
    match kind {
        "actuator-saturation" => json!({ "limit_v": 4.0 }),
        "actuator-dead-zone" => json!({ "width_v": 0.1 }),
        "actuator-hysteresis" => json!({ "share": 0.3, "yield_v": rng.random_range(0.5..1.2) }),
        "actuator-slew-limit" => json!({ "rate_v_per_s": 1500.0 }),
        "actuator-lag" => {
            let from_hz = drawn.base.actuator_poles_hz[channel];
            if from_hz.is_finite() {
                json!({ "pole_hz": from_hz * (200.0 / ACTUATOR_POLE_HZ), "from_hz": from_hz })
            } else {
                json!({ "pole_hz": 0.25 * drawn.base.sample_rate_hz, "from_hz": null })
            }
        }
        "actuator-gain" => json!({ "gain": 1.0 + sign * 0.2 }),
        "actuator-delay" => json!({ "delay_samples": 0.3 }),
        "actuator-crosstalk" => json!({ "share": sign * 0.2 }),
        "actuator-gain-drift" => json!({ "rate_per_s": sign * 2e-3 }),
        other => unreachable!("{other} has a place and no parameters"),
    }
}

/// Parameters of an effect that is not in the vocabulary.
fn of_outsider(
    kind: &str,
    channel: usize,
    sign: f64,
    drawn: &Drawn,
    signals: &Signals,
    rng: &mut ChaCha12Rng,
) -> Value {
    let (d, y) = (signals.displacement[channel], signals.output[channel]);
    match kind {
        "x-command-play" => json!({ "play_v": 0.1 }),
        "x-delay-jitter" => json!({ "most_samples": 0.3 }),
        "x-sticking-valve" => json!({ "stick_v": 0.1 }),
        "x-sensor-rate-limit" => json!({ "rate_v_per_s": 1000.0 * y }),
        "x-sensor-square" => json!({ "square_per_v": sign * 0.1 / y }),
        "x-channel-product" => json!({ "product_per_v": sign * 0.1 / y }),
        // At twice the frequency of a dominant mode, where stiffness that is pumped does most.
        "x-parametric-stiffness" => {
            let mode = &drawn.base.modes[rng.random_range(drawn.dominant.clone())];
            json!({ "share": 1e-3, "frequency_hz": 2.0 * mode.frequency_hz })
        }
        "x-varying-damping" => json!({ "share": 0.3, "frequency_hz": rng.random_range(0.1..1.0) }),
        "x-clock-skew" => json!({ "fast_share": 1e-4 }),
        "x-force-factor" => json!({ "half_v": 3.0 * d }),
        "x-foreshortening" => json!({ "length_v": 3.0 * d, "stiffness": rng.random_range(0.2..0.6) }),
        "x-intermittent-contact" => json!({ "stiffness": 0.01, "mean_s": rng.random_range(0.02..0.2) }),
        "x-proportional-noise" => json!({ "share": 0.1 }),
        "x-resonant-crosstalk" => json!({
            "share": sign * 0.05,
            "frequency_hz": rng.random_range(80.0..240.0),
            "damping_ratio": rng.random_range(0.02..0.1),
        }),
        "x-supply-sag" => json!({ "sag_per_v": 0.03 }),
        "x-thermal-gain" => json!({ "loss_per_v2": 0.1, "time_s": rng.random_range(0.03..0.3) }),
        other => unreachable!("{other} has a place and no parameters"),
    }
}
