//! The plan of a trial's cases before any of them is simulated: arms, effects with places and laws, and nuisances, in
//! a random order.

use rand::RngExt;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};

use plid_testbed::gap::{Channels, GapSpec, PlantKind, Simulator};

use crate::config::{Draw, TrialConfig};
use crate::seal::derived;
use crate::vocabulary::{Kind, Outsiders, find};

/// Numbers of channels of the testbed's plants.
const INPUTS: usize = plid_testbed::INPUTS;
const OUTPUTS: usize = plid_testbed::OUTPUTS;

/// The arm of a trial for which a case is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Arm {
    /// Nothing is missing.
    None,
    /// One effect.
    Single,
    /// Two effects.
    Pair,
    /// Three effects.
    Triple,
    /// One effect that the vocabulary does not have.
    Outsider,
    /// One effect, which is removed from the vocabulary for a second answer.
    LeaveOneOut,
}

/// An effect before its strength is drawn.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Wanted {
    pub kind: Kind,
    pub at: Option<String>,
    pub law: Option<&'static str>,
}

/// A case before it is simulated.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Planned {
    pub arm: Arm,
    pub effects: Vec<Wanted>,
    /// Everything about the case except its effects.
    pub spec: GapSpec,
    pub without: Vec<String>,
}

impl Planned {
    /// Returns the kinds of plants on which the effects make sense, the planned one first.
    pub(crate) fn plants(&self, draw: &Draw) -> Vec<PlantKind> {
        let planned = self.spec.plant;
        let kinds: Vec<Kind> = self.effects.iter().map(|wanted| wanted.kind).collect();
        let others = taking(&draw.plants, &kinds).filter(|plant| *plant != planned);
        std::iter::once(planned).chain(others).collect()
    }

    /// Returns the case on a plant of this kind.
    pub(crate) fn on(&self, plant: PlantKind) -> Self {
        let mut moved = self.clone();
        if plant == self.spec.plant {
            return moved;
        }
        moved.spec.plant = plant;
        moved.spec.channels = if self.effects.iter().any(|wanted| joins_channels(wanted.kind)) {
            plant.channels()
        } else {
            at_most(self.spec.channels, plant)
        };
        // The testbed draws the places.
        moved.effects.iter_mut().for_each(|wanted| wanted.at = None);
        moved
    }
}

/// Returns the cases in the order of their names.
pub(crate) fn plan(config: &TrialConfig, seed: u64) -> Vec<Planned> {
    let mut rng = ChaCha12Rng::from_seed(derived(seed, "plan", 0));
    let kinds: Vec<Kind> = config.effects().iter().filter_map(|name| find(name)).collect();
    let mut turns = Turns::default();
    let mut arms: Vec<(Arm, Vec<Kind>)> = Vec::new();
    let cases = &config.cases;
    arms.extend((0..cases.none).map(|_| (Arm::None, Vec::new())));
    for _ in 0..cases.singles_per_effect {
        arms.extend(kinds.iter().map(|kind| (Arm::Single, vec![*kind])));
    }
    for (arm, count, size) in [(Arm::Pair, cases.pairs, 2), (Arm::Triple, cases.triples, 3)] {
        arms.extend((0..count).map(|_| {
            let mut drawn = kinds.clone();
            drawn.shuffle(&mut rng);
            (arm, together(&drawn, size, &config.draw.plants))
        }));
    }
    // The order of outsiders is drawn even if no outsider is: a trial without outsiders then remains the same as when
    // only half of them existed.
    let half = if cases.outsiders == 0 { Outsiders::Development } else { config.draw.outsiders };
    let outsiders: Vec<Kind> = half.kinds().into_iter().filter(|kind| config.is_taken(kind.name)).collect();
    for (arm, count, from) in
        [(Arm::Outsider, cases.outsiders, &outsiders), (Arm::LeaveOneOut, cases.leave_one_out, &kinds)]
    {
        arms.extend(in_turn(from, count, &mut rng).into_iter().map(|kind| (arm, vec![kind])));
    }

    if cases.singles > 0 {
        arms.extend(in_turn(&kinds, cases.singles, &mut rng).into_iter().map(|kind| (Arm::Single, vec![kind])));
    }

    let specs = specs(&config.draw, &arms, &mut rng);
    let mut planned: Vec<Planned> = arms
        .into_iter()
        .zip(specs)
        .map(|((arm, kinds), mut spec)| {
            if kinds.iter().any(|kind| joins_channels(*kind)) {
                spec.channels = spec.plant.channels();
            }
            let without = if arm == Arm::LeaveOneOut { vec![kinds[0].name.to_owned()] } else { Vec::new() };
            let wanted = |kind| {
                let wanted = turns.next(kind, config.draw.near_misses, &mut rng);
                // If not all channels are present, or the modes are those of another plant, the testbed draws the
                // place.
                let whole = spec.channels == Channels::default() && spec.plant == PlantKind::default();
                Wanted { at: wanted.at.filter(|_| whole), ..wanted }
            };
            let effects = kinds.into_iter().map(wanted).collect();
            Planned { arm, effects, spec, without }
        })
        .collect();
    add_decoys(&mut planned, &kinds, cases.leave_one_out, &mut rng);
    planned.shuffle(&mut rng);
    planned
}

/// Returns whether an effect needs more than one channel.
fn joins_channels(kind: Kind) -> bool {
    kind.least_inputs > 1 || kind.least_outputs > 1
}

/// Returns the first of the kinds that make sense together on one plant, up to `size` of them. If every plant takes
/// every kind, these are simply the first kinds.
fn together(kinds: &[Kind], size: usize, plants: &[PlantKind]) -> Vec<Kind> {
    let count = |plant: &PlantKind| kinds.iter().filter(|kind| plant.takes(kind.name)).count();
    let mut plants: Vec<PlantKind> = plants.iter().copied().filter(|plant| count(plant) >= size).collect();
    let mut chosen = Vec::new();
    for kind in kinds {
        if chosen.len() < size && plants.iter().any(|plant| plant.takes(kind.name)) {
            plants.retain(|plant| plant.takes(kind.name));
            chosen.push(*kind);
        }
    }
    chosen
}

/// Draws plants, channels, experiments and nuisances of the cases.
fn specs(draw: &Draw, arms: &[(Arm, Vec<Kind>)], rng: &mut ChaCha12Rng) -> Vec<GapSpec> {
    let count = arms.len();
    let perturbed = shares(draw.perturbed, count, rng);
    let ports = shares(draw.ports, count, rng);
    let outputs_only = shares(draw.outputs_only, count, rng);
    let misjudged = shares(draw.misjudged, count, rng);
    (0..count)
        .map(|k| {
            let simulator = if outputs_only[k] { Simulator::Outputs } else { Simulator::Model };
            let off = if misjudged[k] { rng.random_range(-1.0..1.0) } else { 0.0 };
            let plants: Vec<PlantKind> = taking(&draw.plants, &arms[k].1).collect();
            let plant = one_of(&plants, rng);
            let channels = at_most(one_of(&draw.channels, rng), plant);
            GapSpec {
                effects: Vec::new(),
                perturbed: perturbed[k],
                // Outputs alone do not reveal where forces may act, and declare no noise.
                ports: ports[k] && !outputs_only[k],
                noise_misjudged: if outputs_only[k] { 1.0 } else { 1.5_f64.powf(off) },
                plant,
                channels,
                experiment: one_of(&draw.experiments, rng),
                simulator,
                length: draw.length,
                families: draw.families,
                // Drawn with the strengths of the effects.
                imperfections: 0.0,
                beyond_limits: 0.0,
            }
        })
        .collect()
}

/// Returns those of the plants on which all these effects make sense.
fn taking(plants: &[PlantKind], kinds: &[Kind]) -> impl Iterator<Item = PlantKind> {
    plants.iter().copied().filter(|plant| kinds.iter().all(|kind| plant.takes(kind.name)))
}

/// Returns these numbers of channels, or those of the plant if it has fewer.
fn at_most(channels: Channels, plant: PlantKind) -> Channels {
    let most = plant.channels();
    Channels { inputs: channels.inputs.min(most.inputs), outputs: channels.outputs.min(most.outputs) }
}

/// Draws one of several values. No random number is used if there is no choice.
fn one_of<T: Copy>(from: &[T], rng: &mut ChaCha12Rng) -> T {
    if let [only] = from { *only } else { from[rng.random_range(0..from.len())] }
}

/// Gives `count` single effects a second answer without an effect that does not act; otherwise the list of effects to
/// leave out would reveal the causes.
fn add_decoys(planned: &mut [Planned], kinds: &[Kind], count: usize, rng: &mut ChaCha12Rng) {
    let mut singles: Vec<&mut Planned> = planned.iter_mut().filter(|case| case.arm == Arm::Single).collect();
    singles.shuffle(rng);
    for case in singles.into_iter().take(count) {
        let others: Vec<Kind> = kinds.iter().copied().filter(|kind| *kind != case.effects[0].kind).collect();
        if !others.is_empty() {
            case.without = vec![others[rng.random_range(0..others.len())].name.to_owned()];
        }
    }
}

/// Returns `count` kinds in a random order. Each kind occurs equally often, to within one.
fn in_turn(from: &[Kind], count: usize, rng: &mut ChaCha12Rng) -> Vec<Kind> {
    let mut order = from.to_vec();
    order.shuffle(rng);
    order.into_iter().cycle().take(count).collect()
}

/// Returns `count` flags in a random order, a share of which, to the nearest whole number, is true.
fn shares(share: f64, count: usize, rng: &mut ChaCha12Rng) -> Vec<bool> {
    let most = (share * count as f64).round() as usize;
    let mut chosen: Vec<bool> = (0..count).map(|i| i < most).collect();
    chosen.shuffle(rng);
    chosen
}

/// Places and laws of each effect come in turn, from a random start, so that few draws cover many of them.
#[derive(Default)]
struct Turns(Vec<(&'static str, Turn)>);

struct Turn {
    places: Vec<Option<String>>,
    drawn: usize,
    /// The number of near misses, as a fraction from 0 to 1, that should have been drawn but was not.
    owed: f64,
}

impl Turns {
    fn next(&mut self, kind: Kind, near_misses: f64, rng: &mut ChaCha12Rng) -> Wanted {
        let at = self.0.iter().position(|(name, _)| *name == kind.name).unwrap_or_else(|| {
            let mut places = kind.at.places(INPUTS, OUTPUTS);
            places.shuffle(rng);
            self.0.push((kind.name, Turn { places, drawn: 0, owed: rng.random() }));
            self.0.len() - 1
        });
        let turn = &mut self.0[at].1;
        let at = turn.places[turn.drawn % turn.places.len()].clone();
        turn.drawn += 1;
        turn.owed += near_misses;
        let near = turn.owed >= 1.0;
        turn.owed -= f64::from(near);
        let laws = kind.near_misses;
        let law = (near && !laws.is_empty()).then(|| laws[rng.random_range(0..laws.len())]);
        Wanted { kind, at, law }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::config::{Cases, Draw};

    fn config() -> TrialConfig {
        let cases = Cases {
            none: 12,
            singles_per_effect: 4,
            pairs: 5,
            triples: 3,
            outsiders: 19,
            leave_one_out: 6,
            singles: 0,
        };
        TrialConfig { name: "t".to_owned(), cases, draw: Draw::default() }
    }

    #[test]
    fn the_arms_have_what_was_asked_for() {
        let config = config();
        let planned = plan(&config, 7);
        assert_eq!(planned.len(), config.total());
        let of = |arm: Arm| planned.iter().filter(|c| c.arm == arm).collect::<Vec<_>>();
        assert_eq!((of(Arm::None).len(), of(Arm::Single).len()), (12, 132));
        for (arm, count) in [(Arm::Pair, 2), (Arm::Triple, 3)] {
            for case in of(arm) {
                let names: BTreeSet<&str> = case.effects.iter().map(|e| e.kind.name).collect();
                assert_eq!(names.len(), count);
            }
        }
        let outsiders: BTreeSet<&str> = of(Arm::Outsider).iter().map(|c| c.effects[0].kind.name).collect();
        assert_eq!(outsiders.len(), Outsiders::All.kinds().len());
        assert!(of(Arm::LeaveOneOut).iter().all(|c| c.without == [c.effects[0].kind.name]));
        let decoys: Vec<_> = planned.iter().filter(|c| c.arm == Arm::Single && !c.without.is_empty()).collect();
        assert_eq!(decoys.len(), 6);
        assert!(decoys.iter().all(|c| c.without[0] != c.effects[0].kind.name));
        // Shares of all cases, to the nearest one.
        let perturbed = planned.iter().filter(|c| c.spec.perturbed).count();
        assert_eq!(perturbed, (0.5 * planned.len() as f64).round() as usize);
    }

    /// A trial of one half draws no outsiders of the other, and a trial without outsiders does not depend on the half.
    #[test]
    fn outsiders_are_drawn_from_the_half_that_is_named() {
        let of = |outsiders: Outsiders, count: usize| {
            let cases = Cases { outsiders: count, ..config().cases };
            plan(&TrialConfig { cases, draw: Draw { outsiders, ..Draw::default() }, ..config() }, 7)
        };
        for half in [Outsiders::Development, Outsiders::Reported] {
            let planned = of(half, 19);
            let drawn = planned.iter().filter(|case| case.arm == Arm::Outsider).map(|case| case.effects[0].kind.name);
            let expected: BTreeSet<&str> = half.kinds().iter().map(|kind| kind.name).collect();
            assert_eq!(drawn.collect::<BTreeSet<_>>(), expected);
            assert_eq!(of(half, 0), of(Outsiders::All, 0));
        }
    }

    #[test]
    fn an_effect_between_channels_gets_all_of_them() {
        let draw = Draw { channels: vec![Channels { inputs: 1, outputs: 1 }], ..Draw::default() };
        let planned = plan(&TrialConfig { draw, ..config() }, 7);
        let joined = |case: &&Planned| case.effects.iter().any(|effect| joins_channels(effect.kind));
        let kinds: BTreeSet<&str> =
            planned.iter().filter(joined).flat_map(|c| &c.effects).map(|e| e.kind.name).collect();
        assert!(
            ["actuator-crosstalk", "sensor-crosstalk", "x-channel-product", "x-foreshortening", "x-supply-sag"]
                .iter()
                .all(|name| kinds.contains(name))
        );
        for case in &planned {
            let whole = case.spec.channels == Channels::default();
            assert_eq!(whole, joined(&case), "{:?}", case.spec.channels);
        }
    }

    #[test]
    fn places_and_laws_come_in_turn() {
        let planned = plan(&config(), 7);
        let singles = |name: &str| {
            planned.iter().filter(|c| c.arm == Arm::Single && c.effects[0].kind.name == name).collect::<Vec<_>>()
        };
        let places: BTreeSet<_> = singles("clearance").iter().map(|c| c.effects[0].at.clone()).collect();
        assert_eq!(places.len(), 3);
        // Near misses are one half of the draws, to within one.
        let near = singles("clearance").iter().filter(|c| c.effects[0].law.is_some()).count();
        assert_eq!(near, 2);
        assert!(singles("sensor-gain").iter().all(|c| c.effects[0].law.is_none()));
    }

    /// Effects are drawn on plants that take them, several effects on a plant that takes all of them. A plant that
    /// has fewer channels than others keeps all of its own.
    #[test]
    fn every_case_has_a_plant_on_which_its_effects_make_sense() {
        let plants = PlantKind::ALL.to_vec();
        let cases = Cases { none: 9, singles_per_effect: 2, pairs: 40, triples: 40, outsiders: 16, ..Cases::default() };
        let config = TrialConfig { name: "t".to_owned(), cases, draw: Draw { plants, ..Draw::default() } };
        let planned = plan(&config, 7);
        assert_eq!((config.effects().len(), planned.len()), (41, config.total()));
        for case in &planned {
            let plant = case.spec.plant;
            assert!(case.effects.iter().all(|wanted| plant.takes(wanted.kind.name)), "{case:?}");
            assert_eq!(case.spec.channels, plant.channels(), "{case:?}");
            let several = [(Arm::Pair, 2), (Arm::Triple, 3)].into_iter().find(|(arm, _)| *arm == case.arm);
            assert!(several.is_none_or(|(_, count)| case.effects.len() == count), "{case:?}");
        }
        let drawn: BTreeSet<String> = planned.iter().map(|case| format!("{:?}", case.spec.plant)).collect();
        assert_eq!(drawn.len(), PlantKind::ALL.len());
        let axes: Vec<PlantKind> = PlantKind::ALL.into_iter().filter(|plant| plant.has_axes()).collect();
        let config = TrialConfig { draw: Draw { plants: axes, ..Draw::default() }, ..config };
        let effects = config.effects();
        assert!(effects.contains(&"gravity-sine") && !effects.contains(&"missing-mode"), "{effects:?}");
        assert!(plan(&config, 7).iter().all(|case| case.spec.plant.has_axes()));
    }

    #[test]
    fn a_seed_is_an_order_and_another_is_another() {
        assert_eq!(plan(&config(), 1), plan(&config(), 1));
        assert_ne!(plan(&config(), 1), plan(&config(), 2));
        let first: Vec<Arm> = plan(&config(), 3).iter().take(12).map(|c| c.arm).collect();
        assert!(first.iter().any(|arm| *arm != Arm::None), "the order tells the arm");
    }
}
