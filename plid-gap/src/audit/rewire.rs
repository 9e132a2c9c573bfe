//! The wiring with which the simulation agrees best: permutations, signs and units of outputs and inputs, and one
//! delay. It is found by cross-correlation and least squares before any fit.

use nalgebra::{DMatrix, DVector};
use plid_model::Model;

use super::responses::{Responses, Simulated};
use super::wiring::{Wire, Wiring};
use crate::case::Case;
use crate::case::split::driven;
use crate::error::GapError;
use crate::settings::AuditSettings;
use plid_report::percent;

/// Number of channels up to which all permutations are tried. With more channels, only exchanges of two are tried, to
/// bound the time.
const ALL_PERMUTATIONS: usize = 5;

/// Number of outputs up to which the search starts from all combinations of signs; with more outputs it does not, to
/// bound the time.
const ALL_SIGNS: usize = 3;

/// Factors between units in use, with the units. Smaller factors (2, the square root of 2) are left to gains, which
/// are fitted.
const UNITS: [(f64, &str); 9] = [
    (1e6, "as between micro-units and units"),
    (1e3, "as between milli-units and units"),
    (100.0, "as between per cent and one"),
    (57.29578, "as between degrees and radians"),
    (25.4, "as between millimetres and inches"),
    (10.0, "as by a factor of ten in a gain setting, or between m/s2 and g"),
    (9.80665, "as between m/s2 and g, or by a factor of ten in a gain setting"),
    (std::f64::consts::TAU, "as between rad/s and Hz"),
    (4.448222, "as between newtons and pounds"),
];

/// A mismatch of the wiring.
#[derive(Debug, Clone, PartialEq)]
pub struct Mismatch {
    /// The wiring.
    pub wiring: Wiring,
    /// The gap with the wiring as given.
    pub before: f64,
    /// The gap with this wiring.
    pub after: f64,
    /// Whether the mismatch is clear enough to be corrected for the following steps.
    pub explains: bool,
    /// The mismatch in words.
    pub sentence: String,
}

impl Mismatch {
    /// Returns the consequences of the correction in words.
    pub(super) fn consequences(&self) -> Vec<String> {
        let mut said = vec!["Everything below refers to the corrected simulation.".to_string()];
        let delay = self.wiring.delay;
        if delay < 0 {
            said.push(format!("A prediction cannot respond before its input, so it is delayed by {} samples.", -delay));
        }
        said
    }
}

/// A wiring replaces the best one only if its price is below this share of the lowest price. Wirings that are
/// equivalent, such as all inputs or all outputs negated, differ by rounding alone, and the first of them is kept.
const LOWER: f64 = 0.999;

/// Looks for a mismatch.
///
/// # Errors
/// Returns [`GapError::Model`] if the simulation cannot be run.
pub fn find(case: &Case, model: &Model) -> Result<Option<Mismatch>, GapError> {
    let settings = &case.config.settings.audit;
    let records = driven(&case.records, &case.config.settings.case);
    let responses = Responses::new(model, &records)?;
    let plain = Wiring::plain(responses.m, responses.p);
    let before = responses.gap(&plain);
    if !(before > settings.least_gap) {
        return Ok(None);
    }
    let outputs = |from: &Wiring| pruned(&responses, with_outputs(&responses, from, settings), settings);
    let inputs = |from: &Wiring| pruned(&responses, with_inputs(&responses, from, settings), settings);
    // Outputs come first: if a change of either side is equivalent (all negated, all in other units), the sensors are
    // the more frequent cause.
    let outer = outputs(&plain);
    let inner = inputs(&plain);
    let both = [inputs(&outer), outputs(&inner)];
    let again = [outputs(&both[0]), inputs(&both[1])];
    let mut best = plain;
    let mut least = price(&responses, &best, settings);
    let mut take = |wiring: Wiring, best: &mut Wiring| {
        let price = price(&responses, &wiring, settings);
        if price < LOWER * least {
            (least, *best) = (price, wiring);
        }
    };
    for wiring in [outer, inner].into_iter().chain(both).chain(again) {
        take(wiring, &mut best);
    }
    if before > settings.several && responses.gap(&best) > settings.several_left {
        for start in starts(&responses) {
            take(outputs(&inputs(&start)), &mut best);
        }
    }
    if before > settings.several {
        for wiring in in_other_units(&best, &Wiring::plain(responses.m, responses.p)) {
            take(wiring, &mut best);
        }
    }
    let after = responses.gap(&best);
    // A simulation that is scaled down to nothing leaves a gap of one.
    let least = before.min(1.0);
    if best.changes(settings.same_factor) == 0 || after > settings.reported * least {
        return Ok(None);
    }
    let sentence = sentence(&best, case, before, after);
    Ok(Some(Mismatch { wiring: best, before, after, explains: after <= settings.corrected * least, sentence }))
}

/// Returns the squared gap, multiplied by the price of each change.
fn price(responses: &Responses, wiring: &Wiring, settings: &AuditSettings) -> f64 {
    let changes = wiring.changes(settings.same_factor);
    responses.gap(wiring).powi(2) * settings.change_price.powi(changes as i32)
}

/// Removes changes that do not reduce the gap enough.
fn pruned(responses: &Responses, mut wiring: Wiring, settings: &AuditSettings) -> Wiring {
    let mut least = price(responses, &wiring, settings);
    loop {
        let simpler = wiring.simpler().into_iter().map(|w| (price(responses, &w, settings), w));
        match simpler.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((price, simpler)) if price <= least => (least, wiring) = (price, simpler),
            _ => return wiring,
        }
    }
}

/// Returns the wiring with the best outputs and delay for the inputs of `from`.
fn with_outputs(responses: &Responses, from: &Wiring, settings: &AuditSettings) -> Wiring {
    let (p, reach) = (responses.p, responses.reach as i64);
    let simulated = |output: usize| -> Vec<Simulated> {
        let wires = from.inputs.iter().enumerate();
        wires.map(|(input, wire)| Simulated { input, wire: wire.channel, output, factor: wire.gain }).collect()
    };
    let size: Vec<f64> = (0..p)
        .map(|q| {
            let s = simulated(q);
            s.iter().flat_map(|a| s.iter().map(|b| responses.product(*a, *b))).sum::<f64>().max(f64::MIN_POSITIVE)
        })
        .collect();
    let with: Vec<Vec<Vec<f64>>> = (0..p)
        .map(|o| {
            let of = |q| responses.correlation(&simulated(q).into_iter().map(|s| (o, s)).collect::<Vec<_>>());
            (0..p).map(of).collect()
        })
        .collect();
    let explained = |o: usize, q: usize, at: usize| with[o][q][at].powi(2) * responses.weight[o] / size[q];
    let orders = permutations(p);
    let best = |lags: &[usize]| {
        let all = orders.iter().flat_map(|order| {
            lags.iter().map(move |&at| (order, at, (0..p).map(|o| explained(o, order[o], at)).sum::<f64>()))
        });
        all.max_by(|a, b| a.2.total_cmp(&b.2)).map(|(order, at, _)| (order.clone(), at)).expect("an order and a lag")
    };
    let (order, at) = best_or_at_once(best, reach, settings.shortest_delay);
    let outputs = order
        .iter()
        .enumerate()
        // The gain is the ratio of the sizes, because least squares underestimates the factor if the phases differ.
        .map(|(o, &q)| Wire {
            channel: q,
            gain: plausible((responses.weight[o] * size[q]).sqrt().recip().copysign(with[o][q][at]), settings),
        })
        .collect();
    Wiring { outputs, inputs: from.inputs.clone(), delay: at as i64 - reach }
}

/// Returns the wiring with the best inputs and delay for the outputs of `from`. Each order of the inputs is tried,
/// with gains by least squares.
fn with_inputs(responses: &Responses, from: &Wiring, settings: &AuditSettings) -> Wiring {
    let (m, reach) = (responses.m, responses.reach as i64);
    // The measured output o corresponds to `gain` times the simulation's output `channel`.
    let simulated = |input: usize, wire: usize| -> Vec<(usize, Simulated)> {
        let outputs = from.outputs.iter().enumerate();
        outputs
            .map(|(o, out)| (o, Simulated { input, wire, output: out.channel, factor: out.gain * responses.weight[o] }))
            .collect()
    };
    let with: Vec<Vec<Vec<f64>>> =
        (0..m).map(|i| (0..m).map(|j| responses.correlation(&simulated(i, j))).collect()).collect();
    let orders: Vec<(Vec<usize>, DMatrix<f64>)> = permutations(m)
        .into_iter()
        .filter_map(|order| {
            let normal = DMatrix::from_fn(m, m, |i, k| {
                let (a, b) = (simulated(i, order[i]), simulated(k, order[k]));
                a.iter().zip(&b).map(|((o, a), (_, b))| responses.product(*a, *b) / responses.weight[*o]).sum()
            });
            let ridge = 1e-9 * normal.trace() / m as f64;
            let inverse = (normal + DMatrix::from_diagonal_element(m, m, ridge)).try_inverse()?;
            Some((order, inverse))
        })
        .collect();
    if orders.is_empty() {
        return from.clone();
    }
    let gains = |which: usize, at: usize| {
        let (order, inverse) = &orders[which];
        let right = DVector::from_fn(m, |i, _| with[i][order[i]][at]);
        let gains = inverse * &right;
        let explained = gains.dot(&right);
        (gains, explained)
    };
    let best = |lags: &[usize]| {
        let all = (0..orders.len()).flat_map(|which| lags.iter().map(move |&at| (which, at, gains(which, at).1)));
        all.max_by(|a, b| a.2.total_cmp(&b.2)).map(|(which, at, _)| (which, at)).expect("an order and a lag")
    };
    let (which, at) = best_or_at_once(best, reach, settings.shortest_delay);
    let (gains, _) = gains(which, at);
    let inputs = orders[which].0.iter().zip(&gains);
    let inputs = inputs.map(|(&channel, &gain)| Wire { channel, gain: plausible(gain, settings) }).collect();
    Wiring { outputs: from.outputs.clone(), inputs, delay: at as i64 - reach }
}

/// Returns the best result over all lags, or the best result without delay if the best delay is shorter than
/// `shortest` samples.
fn best_or_at_once<T>(best: impl Fn(&[usize]) -> (T, usize), reach: i64, shortest: usize) -> (T, usize) {
    let all: Vec<usize> = (0..=2 * reach as usize).collect();
    let found = best(&all);
    if (found.1 as i64 - reach).unsigned_abs() as usize >= shortest { found } else { best(&[reach as usize]) }
}

/// Returns both wirings with one factor between units on all outputs or on all inputs, and no other factor.
fn in_other_units(best: &Wiring, plain: &Wiring) -> Vec<Wiring> {
    let sized = |wires: &[Wire], size: f64| -> Vec<Wire> {
        wires.iter().map(|wire| Wire { gain: size.copysign(wire.gain), ..*wire }).collect()
    };
    let mut all = Vec::new();
    for base in [plain, best] {
        let (outputs, inputs, delay) = (sized(&base.outputs, 1.0), sized(&base.inputs, 1.0), base.delay);
        for size in UNITS.iter().flat_map(|&(factor, _)| [factor, 1.0 / factor]) {
            all.push(Wiring { outputs: sized(&outputs, size), inputs: inputs.clone(), delay });
            all.push(Wiring { outputs: outputs.clone(), inputs: sized(&inputs, size), delay });
        }
    }
    all
}

/// Returns wirings with all orders of the outputs and, if the outputs are few, all combinations of their signs. One
/// sign is fixed, because a negation of all outputs is equivalent to a negation of all inputs.
fn starts(responses: &Responses) -> Vec<Wiring> {
    let (m, p) = (responses.m, responses.p);
    let signs = if p <= ALL_SIGNS { 1 << (p - 1) } else { 1 };
    let start = |order: &[usize], signs: usize| {
        let sign = |o: usize| if signs >> o & 1 == 1 { -1.0 } else { 1.0 };
        let outputs = order.iter().enumerate().map(|(o, &channel)| Wire { channel, gain: sign(o) }).collect();
        Wiring { outputs, ..Wiring::plain(m, p) }
    };
    permutations(p).iter().flat_map(|order| (0..signs).map(|signs| start(order, signs)).collect::<Vec<_>>()).collect()
}

/// Returns the part of a gain that belongs to the wiring: its sign, times a factor if the gain is close to one between
/// units. A gain that is too large or too small to be fitted is returned as it is.
fn plausible(gain: f64, settings: &AuditSettings) -> f64 {
    let size = gain.abs();
    let sign = if gain < 0.0 { -1.0 } else { 1.0 };
    let any = settings.unknown_factor;
    match unit(size, settings.unit_distance) {
        Some((factor, _)) if factor.max(1.0 / factor) > settings.single_factor => sign * factor,
        _ if (1.0 / any..=any).contains(&size) => sign,
        _ if size > 0.0 && size.is_finite() => gain,
        _ => 1.0,
    }
}

/// Returns the known factor between units that lies within this relative distance of `size`.
fn unit(size: f64, distance: f64) -> Option<(f64, &'static str)> {
    let both = UNITS.iter().flat_map(|&(factor, units)| [(factor, units), (1.0 / factor, units)]);
    both.min_by(|a, b| (size / a.0).ln().abs().total_cmp(&(size / b.0).ln().abs()))
        .filter(|(factor, _)| (size / factor - 1.0).abs() < distance)
}

/// Returns all orders if the channels are few, and otherwise the original order and all exchanges of two.
fn permutations(count: usize) -> Vec<Vec<usize>> {
    let plain: Vec<usize> = (0..count).collect();
    let mut orders = vec![plain.clone()];
    if count > ALL_PERMUTATIONS {
        for i in 0..count {
            for j in 0..i {
                let mut order = plain.clone();
                order.swap(i, j);
                orders.push(order);
            }
        }
        return orders;
    }
    for at in 0..count {
        let mut longer = orders.clone();
        for to in at + 1..count {
            longer.extend(orders.iter().cloned().map(|mut order| {
                order.swap(at, to);
                order
            }));
        }
        orders = longer;
    }
    orders
}

fn sentence(wiring: &Wiring, case: &Case, before: f64, after: f64) -> String {
    let config = &case.config;
    let distance = config.settings.audit.unit_distance;
    let mut parts = side(&wiring.outputs, &config.outputs, ["output", "input"], distance, |name, other| {
        format!("the channel recorded as {name} looks like the simulation's {other}")
    });
    parts.extend(side(&wiring.inputs, &config.inputs, ["input", "output"], distance, |name, other| {
        format!("the simulation's {name} looks driven by the channel recorded as {other}")
    }));
    let seconds = wiring.delay.unsigned_abs() as f64 / config.rate();
    match wiring.delay {
        0 => {}
        late if late > 0 => {
            parts.push(format!("all channels look delayed by {late} samples ({seconds:.4} s) against the simulation"));
        }
        early => {
            parts.push(format!("the simulation looks delayed by {} samples ({seconds:.4} s) in all channels", -early))
        }
    }
    let mut text = parts.join("; ");
    if let Some(first) = text.get(..1) {
        text.replace_range(..1, &first.to_uppercase());
    }
    format!("{text}: with this corrected, the gap falls from {} to {}.", percent(before), percent(after))
}

fn side(
    wires: &[Wire],
    names: &[String],
    [what, opposite]: [&str; 2],
    distance: f64,
    moved: impl Fn(&str, &str) -> String,
) -> Vec<String> {
    let mut parts = Vec::new();
    let off: Vec<usize> = (0..wires.len()).filter(|&k| wires[k].channel != k).collect();
    match off.as_slice() {
        [] => {}
        &[a, b] => parts.push(format!("{what}s {} and {} look swapped", names[a], names[b])),
        _ => parts.extend(off.iter().map(|&k| moved(&names[k], &names[wires[k].channel]))),
    }
    // A change of all outputs is equivalent to one of all inputs.
    let either =
        |parts: &mut Vec<String>, text: &str| parts.push(format!("every {what} looks {text}, or every {opposite}"));
    let negated: Vec<&str> = (0..wires.len()).filter(|&k| wires[k].gain < 0.0).map(|k| names[k].as_str()).collect();
    if negated.len() == wires.len() {
        either(&mut parts, "negated");
    } else if !negated.is_empty() {
        let look = if negated.len() == 1 { "looks" } else { "look" };
        parts.push(format!("{what} {} {look} negated", negated.join(" and ")));
    }
    let scaled: Vec<usize> = (0..wires.len()).filter(|&k| wires[k].gain.abs() != 1.0).collect();
    let sizes: Vec<f64> = scaled.iter().map(|&k| wires[k].gain.abs()).collect();
    let alike = scaled.len() == wires.len() && sizes.iter().all(|size| (size / sizes[0] - 1.0).abs() < distance);
    let text = |size: f64| match unit(size, distance) {
        Some((factor, units)) => format!("in other units, {} times the simulation's ({units})", short(factor)),
        None if size < 1.0 => format!("{} times as large as in the simulation, with almost no response", short(size)),
        None => format!("{} times as large as in the simulation, perhaps in other units", short(size)),
    };
    if alike {
        either(&mut parts, &text(sizes[0]));
    } else {
        parts.extend(scaled.iter().zip(&sizes).map(|(&k, &size)| format!("{what} {} looks {}", names[k], text(size))));
    }
    parts
}

/// Formats a number with four decimals, or as a power of ten if it is small or large.
pub(super) fn short(x: f64) -> String {
    if (1e-3..1e4).contains(&x.abs()) {
        format!("{:.4}", x).trim_end_matches('0').trim_end_matches('.').into()
    } else {
        format!("{x:.2e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::record::{Channels, rms};
    use crate::testing::{case, random_input, truss};

    fn found(change: impl Fn(&mut Channels, &mut Channels)) -> Option<Mismatch> {
        let mut case = case(&truss(3), &truss(3));
        case.records.iter_mut().for_each(|record| change(&mut record.u, &mut record.y));
        let model = case.model.clone().unwrap();
        find(&case, &model).unwrap()
    }

    /// Asserts that the mismatch explains the gap, in exactly these words, and returns its wiring.
    fn says(mismatch: Option<Mismatch>, words: &str) -> Wiring {
        let mismatch = mismatch.expect("a mismatch");
        assert!(mismatch.explains && mismatch.after < 0.05, "{mismatch:?}");
        assert!(mismatch.sentence.starts_with(&format!("{words}: with this corrected")), "{}", mismatch.sentence);
        mismatch.wiring
    }

    fn scaled(x: &mut [f64], gain: f64) {
        x.iter_mut().for_each(|x| *x *= gain);
    }

    fn late(x: &mut Vec<f64>, samples: usize) {
        x.splice(0..0, vec![0.0; samples]);
        x.truncate(x.len() - samples);
    }

    #[test]
    fn a_simulation_that_fits_is_left_alone() {
        assert_eq!(found(|_, _| {}), None);
        // Gains and short delays are effects.
        assert_eq!(found(|_, y| scaled(&mut y[0], 0.5)), None);
        assert_eq!(found(|u, _| scaled(&mut u[1], 2.0)), None);
        assert_eq!(found(|u, _| scaled(&mut u[1], 1.0 / 4.4)), None);
        assert_eq!(found(|_, y| late(&mut y[0], 1)), None);
    }

    #[test]
    fn swapped_channels() {
        says(found(|_, y| y.swap(0, 1)), "Outputs y1 and y2 look swapped");
        says(found(|u, _| u.swap(0, 1)), "Inputs u1 and u2 look swapped");
    }

    #[test]
    fn negated_channels() {
        says(found(|_, y| scaled(&mut y[1], -1.0)), "Output y2 looks negated");
        says(found(|u, _| scaled(&mut u[0], -1.0)), "Input u1 looks negated");
        says(found(|_, y| y.iter_mut().for_each(|y| scaled(y, -1.0))), "Every output looks negated, or every input");
    }

    #[test]
    fn other_units() {
        says(
            found(|_, y| y.iter_mut().for_each(|y| scaled(y, 1000.0))),
            "Every output looks in other units, 1000 times the simulation's (as between milli-units and units), or \
            every input",
        );
        says(
            found(|_, y| scaled(&mut y[0], 1.0 / 9.80665)),
            "Output y1 looks in other units, 0.102 times the simulation's (as between m/s2 and g, or by a factor of \
            ten in a gain setting)",
        );
        says(
            found(|_, y| y.iter_mut().for_each(|y| scaled(y, 4.448222))),
            "Every output looks in other units, 4.4482 times the simulation's (as between newtons and pounds), or \
            every input",
        );
        // An input recorded in millivolts drives the simulation with a thousandth of its numbers.
        says(
            found(|u, _| scaled(&mut u[1], 1000.0)),
            "Input u2 looks in other units, 0.001 times the simulation's (as between milli-units and units)",
        );
    }

    /// Any simulation agrees better with records that it does not explain if it is scaled down.
    #[test]
    fn a_simulation_is_not_scaled_down_to_nothing() {
        let other = random_input(77, 4096, 2);
        let unrelated = found(|_, y| {
            for (y, other) in y.iter_mut().zip(&other) {
                let size = rms(&*y) / 25.4;
                y.iter_mut().zip(other).for_each(|(y, other)| *y = size * other);
            }
        });
        assert_eq!(unrelated, None);
    }

    #[test]
    fn delays_by_a_block() {
        let wiring = says(
            found(|_, y| y.iter_mut().for_each(|y| late(y, 32))),
            "All channels look delayed by 32 samples (0.0200 s) against the simulation",
        );
        assert_eq!(wiring.delay, 32);
        let wiring = says(
            found(|u, _| u.iter_mut().for_each(|u| late(u, 64))),
            "The simulation looks delayed by 64 samples (0.0400 s) in all channels",
        );
        assert_eq!(wiring.delay, -64);
    }

    #[test]
    fn several_at_once() {
        let wiring = says(
            found(|u, y| {
                y.swap(0, 1);
                scaled(&mut u[0], -1.0);
                y.iter_mut().for_each(|y| late(y, 16));
            }),
            "Outputs y1 and y2 look swapped; input u1 looks negated; all channels look delayed by 16 samples (0.0100 \
            s) against the simulation",
        );
        assert_eq!(wiring.changes(AuditSettings::default().same_factor), 3);
    }

    #[test]
    fn one_input_and_one_output() {
        let one = |model: Model| {
            let mut model = Model::new(
                model.sample_rate_hz,
                model.a.clone(),
                model.b.columns(0, 1).into_owned(),
                model.c.rows(0, 1).into_owned(),
                DMatrix::zeros(1, 1),
            )
            .unwrap();
            model.noise.sensor_std = Some(vec![0.005]);
            model
        };
        let mut case = case(&one(truss(3)), &one(truss(3)));
        case.records.iter_mut().for_each(|record| scaled(&mut record.y[0], -1.0));
        let model = case.model.clone().unwrap();
        let words = find(&case, &model).unwrap();
        says(words, "Every output looks negated, or every input");
    }

    #[test]
    fn orders_are_all_there() {
        assert_eq!(permutations(1).len(), 1);
        let four: std::collections::BTreeSet<Vec<usize>> = permutations(4).into_iter().collect();
        assert_eq!(four.len(), 24);
        assert_eq!(permutations(7).len(), 1 + 21);
    }
}
