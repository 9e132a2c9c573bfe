//! Small imperfections everywhere, which every real structure has in addition to any single cause.

use std::ops::Range;

use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

use super::GapError;
use super::effect;
use super::excitation::Planned;
use super::label::{LabelledEffect, labelled};
use super::plant::{BACKGROUND, Drawn};
use super::rig::STRUCTURE_HZ;
use super::spec::{Channels, EffectSpec, GapSpec};
use super::strength::{Bench, Goal, Signals};
use crate::config::TrussConfig;
use crate::effects::structure::MissingMode;
use crate::effects::{self, At, Effect, Kind};
use crate::streams::{Purpose, stream};
use crate::structure::Mode;

/// The imperfections of a case.
#[derive(Default)]
pub(crate) struct Background {
    pub effects: Vec<Effect>,
    pub labels: Vec<LabelledEffect>,
    /// The gap that they make together, without noise.
    pub gap: f64,
}

/// Returns the small imperfections of some kinds of places, in the order of the table.
fn imperfections(at: &[At]) -> Vec<Kind> {
    effects::kinds().into_iter().filter(|kind| kind.imperfection && at.contains(&kind.at)).collect()
}

/// Probabilities of a second effect at a place, of a law other than the effect's own, of a drift of the structure,
/// and of a disturbance.
const SECOND: f64 = 0.5;
const OTHER_LAW: f64 = 0.5;
const DRIFTS: f64 = 0.7;
const DISTURBED: f64 = 0.3;
/// Standard deviation of the logarithm of a size, and the largest share of the joint gap that one effect may have.
const SPREAD: f64 = 0.7;
const LARGEST_SHARE: f64 = 0.5;
/// Number of samples of the held-out record with which one effect is sized. The joint gap is then set on the whole
/// record.
const EXCERPT: usize = 1000;
/// Range from which the frequencies of missing modes are drawn, Hz: above the excited band and below half the sample
/// rate.
const RESIDUAL_HZ: Range<f64> = 420.0..0.475 * STRUCTURE_HZ;

/// The case for which effects are drawn.
pub(crate) struct Scene<'a> {
    pub seed: u64,
    pub spec: &'a GapSpec,
    pub config: &'a TrussConfig,
    pub drawn: &'a Drawn,
    pub held_out: &'a Planned,
    pub signals: &'a Signals,
}

impl Scene<'_> {
    /// Returns the bench on which the strength of the effect of this number in the case's list is tried.
    pub(crate) fn bench(&self, number: usize) -> Bench<'_> {
        let measured = self.spec.channels.outputs;
        Bench { config: self.config, truss: &self.drawn.base, planned: self.held_out, measured, number }
    }
}

/// Draws small effects of random kind, place and size that cause the gap `spec.imperfections` together. None of them
/// has both the kind and the place of a main effect.
pub(crate) fn drawn(scene: &Scene<'_>, main: &[Effect]) -> Result<Background, GapError> {
    let target = scene.spec.imperfections;
    if target == 0.0 {
        return Ok(Background::default());
    }
    let mut rng = stream(scene.seed, Purpose::Draw, BACKGROUND);
    let mut first = Vec::new();
    for (i, wanted) in wanted(scene.spec.channels, &mut rng).iter().enumerate() {
        let index = BACKGROUND + i;
        let effect = effect::drawn(scene.seed, index, wanted, scene.spec, scene.drawn, scene.signals)?;
        first.push(effect);
    }
    first.extend((0..rng.random_range(1..=3)).map(|_| residual_mode(&scene.drawn.base.modes, &mut rng)));
    let same = |a: &Effect, b: &Effect| a.kind() == b.kind() && a.place() == b.place();
    first.retain(|effect| !main.iter().any(|main| same(main, effect)));

    let sizes = sizes(first.len(), &mut rng);
    let excerpt = scene.held_out.excerpt(EXCERPT);
    let mut sized: Vec<(Effect, f64)> = Vec::new();
    for (effect, size) in first.iter().zip(sizes) {
        let bench = Bench { planned: &excerpt, ..scene.bench(main.len() + sized.len()) };
        match bench.roughly(effect, target * size) {
            Ok(found) => sized.push(found),
            // A law may have no strength that makes so small a gap.
            Err(GapError::Unreachable { .. }) => {}
            Err(other) => return Err(other),
        }
    }
    together(scene, main.len(), &sized)
}

/// Strengthens all effects by one factor, so that they cause the requested gap together.
fn together(scene: &Scene<'_>, before: usize, sized: &[(Effect, f64)]) -> Result<Background, GapError> {
    let at = |factor: f64| sized.iter().map(|(effect, _)| effect.strengthened(factor)).collect::<Vec<_>>();
    let bench = scene.bench(before);
    let target = scene.spec.imperfections;
    let (factor, gap) = bench.search(target, Goal::TOGETHER, &at)?;
    if (gap / target - 1.0).abs() > Goal::TOGETHER.accepted {
        return Err(GapError::Unreachable { kind: "imperfections".to_owned(), target, nearest: gap });
    }
    let effects = at(factor);
    let (base, nominal) = (&scene.drawn.base, &scene.drawn.nominal);
    // To first order, each gap grows with the factor. The gap of each effect alone is that on the excerpt.
    let label =
        |(effect, (_, alone)): (&Effect, &(Effect, f64))| labelled(effect, *alone, factor * alone, base, nominal);
    let labels = effects.iter().zip(sized).map(label).collect();
    Ok(Background { effects, labels, gap })
}

/// Draws one or two effects at each strut, actuator and sensor, and possibly a drift of the structure and a
/// disturbance.
fn wanted(channels: Channels, rng: &mut ChaCha12Rng) -> Vec<EffectSpec> {
    let mut wanted = Vec::new();
    for (places, letter, count) in [
        (&[At::Port][..], 'u', channels.inputs),
        (&[At::Input, At::InputOrAll, At::InputPair], 'u', channels.inputs),
        (&[At::Output, At::OutputPair], 'y', channels.outputs),
    ] {
        let mut possible = imperfections(places);
        possible.retain(|kind| count > 1 || !kind.at.is_pair());
        for channel in 0..count {
            possible.shuffle(rng);
            for kind in possible.iter().take(1 + usize::from(rng.random_bool(SECOND))) {
                let to = (channel + rng.random_range(1..count.max(2))) % count;
                let from = format!("{letter}{}", channel + 1);
                let at = if kind.at.is_pair() { format!("{from}->{letter}{}", to + 1) } else { from };
                wanted.push(of_kind(kind, Some(at), rng));
            }
        }
    }
    for kind in &imperfections(&[At::Whole]) {
        if rng.random_bool(DRIFTS) {
            wanted.push(of_kind(kind, None, rng));
        }
    }
    if rng.random_bool(DISTURBED) {
        let disturbances = imperfections(&[At::Disturbance]);
        wanted.push(of_kind(&disturbances[rng.random_range(0..disturbances.len())], None, rng));
    }
    wanted
}

fn of_kind(kind: &Kind, at: Option<String>, rng: &mut ChaCha12Rng) -> EffectSpec {
    let laws = kind.near_misses;
    let other = !laws.is_empty() && rng.random_bool(OTHER_LAW);
    let law = other.then(|| laws[rng.random_range(0..laws.len())].to_owned());
    // Its size is set afterwards.
    EffectSpec { kind: kind.name.to_owned(), at, law, gap: 1.0 }
}

/// Draws a mode above the band, with shapes of the same size as those of the other modes.
fn residual_mode(modes: &[Mode], rng: &mut ChaCha12Rng) -> Effect {
    let mean = |entries: &dyn Fn(&Mode) -> [f64; 3]| -> f64 {
        let squares: f64 = modes.iter().flat_map(entries).map(|entry| entry * entry).sum();
        (squares / (3 * modes.len()) as f64).sqrt()
    };
    let (input, output) = (mean(&|mode| mode.input_shape), mean(&|mode| mode.output_shape));
    let highest_hz = modes.iter().map(|mode| mode.frequency_hz).fold(0.0, f64::max);
    let least_hz = RESIDUAL_HZ.start.max(1.1 * highest_hz).min(0.95 * RESIDUAL_HZ.end);
    Effect::MissingMode(MissingMode {
        frequency_hz: rng.random_range(least_hz..RESIDUAL_HZ.end),
        damping_ratio: rng.random_range(0.005..0.02),
        input_shape: [0.0; 3].map(|_| input * normal(rng)),
        output_shape: [0.0; 3].map(|_| output * normal(rng)),
    })
}

fn normal(rng: &mut ChaCha12Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Draws shares of the joint gap, whose squares add up to about one.
fn sizes(count: usize, rng: &mut ChaCha12Rng) -> Vec<f64> {
    let sizes: Vec<f64> = (0..count).map(|_| (SPREAD * normal(rng)).exp()).collect();
    let all = sizes.iter().map(|size| size * size).sum::<f64>().sqrt();
    sizes.into_iter().map(|size| (size / all).min(LARGEST_SHARE)).collect()
}
