//! An effect's place and parameters, before its strength is found.

use std::ops::Range;

use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use serde_json::Value;

use super::GapError;
use super::plant::{Drawn, EFFECTS};
use super::spec::{Channels, EffectSpec, GapSpec};
use super::strength::Signals;
use crate::INPUTS;
use crate::effects::{At, Draw, Effect, Kind, entry};
use crate::streams::{Purpose, stream};

/// Returns the effect of a spec. Values that the spec does not give are drawn.
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
    let entry = entry(&wanted.kind).ok_or_else(|| wrong("there is no effect of this kind".to_owned()))?;
    if !spec.plant.takes(entry.kind.name) {
        return Err(wrong("it makes no sense on this kind of plant".to_owned()));
    }
    if let Some(reason) = lacking(&entry.kind, channels) {
        return Err(wrong(reason));
    }
    let random = random_place(entry.kind.at, channels, &drawn.dominant, &mut rng);
    let at = wanted.at.clone().or(random);
    if let Some(at) = at.as_deref().filter(|at| !is_there(at, channels)) {
        let Channels { inputs, outputs } = channels;
        return Err(wrong(format!("a case of {inputs} inputs and {outputs} outputs has no `{at}`")));
    }
    let channel = at.as_deref().map_or(0, first_number);
    // The sign is drawn for every effect, so that the numbers of a seed do not depend on whether an effect has a
    // sign.
    let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
    let mut keys = entry.start(&mut Draw {
        truss: &drawn.base,
        dominant: drawn.dominant.clone(),
        left_out: drawn.left_out.as_ref(),
        channel,
        level: signals.at(channel),
        sign,
        families: spec.families,
        rng: &mut rng,
    });
    let law = wanted.law.as_deref().map(|law| spec.families.shaped(law, entry.kind.shapes, &mut rng));
    for (key, value) in [("at", at.map(Value::from)), ("law", law)] {
        keys.extend(value.map(|value| (key.to_owned(), value)));
    }
    serde_json::from_value(Value::Object(keys)).map_err(|e| wrong(e.to_string()))
}

/// Returns the channel in `u2`, `y1->y3` or `m4`, from 0. A wrong place is found when the effect is made.
fn first_number(place: &str) -> usize {
    let digit = place.chars().nth(1).and_then(|c| c.to_digit(10)).unwrap_or(1);
    (digit as usize).clamp(1, INPUTS) - 1
}

/// Returns the reason if an effect needs more channels than there are.
fn lacking(kind: &Kind, channels: Channels) -> Option<String> {
    let needed = [(kind.least_inputs, channels.inputs, "inputs"), (kind.least_outputs, channels.outputs, "outputs")];
    let word = |count: usize| ["no", "one", "two", "three"][count];
    let (least, there, what) = needed.into_iter().find(|(least, there, _)| there < least)?;
    Some(format!("it needs {} {what}, and the case has {}", word(least), word(there)))
}

/// Returns whether a case has the channels of a place. An invalid place is found when the effect is made.
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
    place: At,
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
        At::Port | At::Input | At::Disturbance => Some(format!("u{}", rng.random_range(1..=inputs))),
        // With one input, `all` is that input.
        At::InputOrAll if inputs == 1 => Some("u1".to_owned()),
        At::InputOrAll => Some(match rng.random_range(1..=inputs + 1) {
            all if all > inputs => "all".to_owned(),
            one => format!("u{one}"),
        }),
        At::InputPair => Some(pair('u', inputs)),
        At::Output => Some(format!("y{}", rng.random_range(1..=outputs))),
        At::OutputPair => Some(pair('y', outputs)),
        At::Mode => Some(format!("m{}", rng.random_range(dominant.clone()) + 1)),
        At::NewMode | At::Whole => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Families, Shape, kinds};
    use crate::gap::spec::PlantKind;
    use crate::gap::{config, excitation, plant, plants, with_effects};

    /// Draws an effect in a short case, and checks its values on that plant.
    fn started(seed: u64, plant: PlantKind, kind: &Kind, at: Option<&str>, law: Option<&str>) -> Effect {
        let wanted =
            EffectSpec { kind: kind.name.to_owned(), at: at.map(str::to_owned), law: law.map(str::to_owned), gap: 0.1 };
        of_family(seed, plant, &wanted, Families::Fixed)
    }

    /// Draws an effect with a shape of a family.
    fn of_family(seed: u64, plant: PlantKind, wanted: &EffectSpec, families: Families) -> Effect {
        let effects = vec![wanted.clone()];
        let spec = GapSpec { effects, plant, channels: plant.channels(), length: 0.1, families, ..GapSpec::default() };
        let mut rng = stream(seed, Purpose::Draw, plant::PLANT);
        let layout = plants::layout(plant, &mut rng);
        let config = config(seed, &spec, &layout.rig);
        let schedule = excitation::schedule(seed, &spec, &layout.rig);
        let plant = plant::drawn(&config, &spec, layout, &schedule, &mut rng);
        let held_out = schedule.last().unwrap();
        let signals = Signals::of(&plant.base, held_out.commands.view());
        let effect = drawn(seed, 0, wanted, &spec, &plant, &signals).unwrap();
        let config = with_effects(&config, std::slice::from_ref(&effect));
        config.check_for(plant.base.modes.len(), held_out.end()).unwrap();
        effect
    }

    /// Each effect starts with valid values at each of its places on the first plant that takes it, and on every
    /// other such plant. It has the stated number of parameters, of which the last two may be left out.
    #[test]
    fn what_effects_state_about_themselves_agrees_with_their_laws() {
        for kind in kinds().into_iter().filter(|kind| kind.family.is_built_in()) {
            let plants: Vec<PlantKind> = PlantKind::ALL.into_iter().filter(|plant| plant.takes(kind.name)).collect();
            let first = *plants.first().unwrap_or_else(|| panic!("{}: it makes sense nowhere", kind.name));
            let Channels { inputs, outputs } = first.channels();
            let places = kind.at.places(inputs, outputs);
            let at_places = places.iter().map(|at| started(5, first, &kind, at.as_deref(), None));
            let elsewhere =
                plants.iter().flat_map(|plant| [6, 7, 8].map(|seed| started(seed, *plant, &kind, None, None)));
            let counts: Vec<usize> = at_places
                .chain(elsewhere)
                .inspect(|effect| assert!(effect.kind() == kind.name && effect.own_equation(), "{effect:?}"))
                .map(|effect| effect.parameters().len())
                .collect();
            let most = *counts.iter().max().unwrap();
            assert!(counts.iter().all(|count| *count + 2 >= most), "{}: {counts:?}", kind.name);
            if kind.is_in_vocabulary() {
                assert_eq!(most, kind.parameters.len() + usize::from(kind.at.is_pair()), "{}", kind.name);
            } else {
                assert!(kind.parameters.is_empty() && kind.name.starts_with("x-"), "{}", kind.name);
            }
            for law in kind.near_misses {
                let near = started(5, first, &kind, None, Some(law));
                assert!(!near.own_equation(), "{near:?} is no near miss");
            }
        }
    }

    /// Returns the numbers that some draws give to each shape of a near miss.
    fn numbers(kind: &Kind, law: &str, families: Families) -> Vec<(&'static Shape, f64)> {
        let plant = *PlantKind::ALL.iter().find(|plant| plant.takes(kind.name)).unwrap();
        let (name, law) = (kind.name.to_owned(), law.to_owned());
        let wanted = EffectSpec { kind: name, at: None, law: Some(law.clone()), gap: 0.1 };
        let shapes: Vec<&Shape> = kind.shapes.iter().filter(|shape| shape.law == law).collect();
        assert!(!shapes.is_empty(), "{}: {law} has a fixed shape", kind.name);
        let drawn = (5..9).flat_map(|seed| {
            let effect = of_family(seed, plant, &wanted, families);
            assert!(!effect.own_equation(), "{effect:?} is no near miss");
            let config = serde_json::to_value(&effect).unwrap();
            shapes.iter().map(move |shape| (*shape, config["law"][shape.law][shape.number].as_f64().unwrap()))
        });
        drawn.collect()
    }

    /// Every law other than the vocabulary's own has a shape that is drawn. Development and reported trials draw it
    /// from different intervals, and a label contains it.
    #[test]
    fn shapes_are_drawn_from_the_half_that_is_named() {
        let within =
            |value: f64, intervals: &[[f64; 2]]| intervals.iter().any(|[low, high]| (*low..=*high).contains(&value));
        for kind in kinds().into_iter().filter(|kind| kind.family.is_built_in()) {
            for law in kind.near_misses {
                let mut all: Vec<f64> = Vec::new();
                for families in [Families::Development, Families::Reported, Families::All] {
                    for (shape, value) in numbers(&kind, law, families) {
                        let half = [shape.ranges.development, shape.ranges.reported].map(|half| within(value, half));
                        let expected = match families {
                            Families::Development => half == [true, false],
                            Families::Reported => half == [false, true],
                            _ => half[0] != half[1],
                        };
                        assert!(expected, "{}, {law}: {} is {value} with {families:?}", kind.name, shape.number);
                        all.push(value);
                    }
                }
                all.sort_by(f64::total_cmp);
                all.dedup();
                // The first eight draws all differ; a draw from both halves may equal one of them.
                assert!(all.len() >= 8, "{}, {law}: {all:?}", kind.name);
            }
        }
    }

    /// Two effects without another law have families, too: the multiples of a hum, and the width of a random force.
    #[test]
    fn harmonics_and_widths_are_drawn_from_the_half_that_is_named() {
        let drawn = |kind: &str, key: &str, families: Families| -> Vec<Value> {
            let wanted = EffectSpec { kind: kind.to_owned(), at: None, law: None, gap: 0.1 };
            let of = |seed| of_family(seed, PlantKind::Truss, &wanted, families);
            (5..20).map(|seed| serde_json::to_value(of(seed)).unwrap()[key].take()).collect()
        };
        let multiples = |families: Families| -> Vec<u64> {
            let all = drawn("mains-hum", "harmonics", families);
            all.iter().flat_map(|all| all.as_array().unwrap()).map(|h| h["multiple"].as_u64().unwrap()).collect()
        };
        let (development, reported) = (multiples(Families::Development), multiples(Families::Reported));
        assert!(development.iter().all(|multiple| !reported.contains(multiple)), "{development:?}, {reported:?}");
        assert!(multiples(Families::Fixed).iter().all(|multiple| [2, 3, 5].contains(multiple)));
        let widths = |families: Families| -> Vec<f64> {
            let all = drawn("coloured-disturbance", "relative_width", families);
            all.iter().map(|width| width.as_f64().unwrap()).collect()
        };
        assert!(widths(Families::Fixed).iter().all(|width| *width == 0.1));
        assert!(widths(Families::Development).iter().all(|width| (0.07..=0.15).contains(width)));
        assert!(widths(Families::Reported).iter().all(|width| *width < 0.06 || *width > 0.19));
    }
}
