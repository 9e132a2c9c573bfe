//! Forward simulations with every effect of the vocabulary, compared with solutions that are written here from the
//! table of equations.
//!
//! A disagreement is the RMS of the difference over all outputs, relative to the RMS of the change by the effect. An
//! effect of one per cent that is right to one per cent disagrees by 0.01, although the outputs agree to 1e-4.

mod actuator;
mod describing;
mod disturbance;
mod sensor;
mod stochastic;
pub mod structure;
mod time;

use plid_gap::effects::{Effect, Library, Place, Setting};
use plid_gap::research::{Fineness, Plant, simulate};
use plid_model::Model;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

use crate::truss::Truss;
use crate::truth::{self, Channels};

/// Frequencies in Hz and damping ratios.
pub const MODES: [(f64, f64); 3] = [(58.0, 0.012), (137.0, 0.008), (243.0, 0.006)];

/// Number of samples of a run: 0.4 s, three time constants of the slowest mode.
const SAMPLES: usize = 640;

/// Default start of a run in s: clocks do not begin with a record.
const T0: f64 = 12.5;

/// The check of one effect.
pub struct Check {
    /// Its name.
    pub effect: &'static str,
    /// The largest disagreement that is accepted.
    pub limit: f64,
    /// The disagreement.
    pub measure: fn(&dyn Effect) -> f64,
}

/// A simulation with an input.
pub struct Rig {
    /// The structure in physical form.
    pub truss: Truss,
    /// The structure in a random basis, as in model.json.
    pub model: Model,
    /// The structure as plid-gap decomposes it.
    pub plant: Plant,
    /// The properties of the structure that effects use.
    pub setting: Setting,
    /// White noise of unit RMS.
    pub u: Channels,
    /// Outputs of the model.
    pub linear: Channels,
}

impl Rig {
    /// Three modes.
    pub fn new(seed: u64) -> Self {
        Self::with(seed, |_| {})
    }

    /// Creates three modes with a change before the simulation is made.
    pub fn with(seed: u64, change: impl FnOnce(&mut Truss)) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut truss = Truss::draw(&MODES, &mut rng);
        change(&mut truss);
        let model = truss.model(&mut rng);
        let plant = Plant::new(&model).unwrap();
        let setting = Setting::bare(&plant, &model);
        let u = noise(seed + 1, 2, SAMPLES);
        let linear = truth::linear(&model, &u);
        Self { truss, model, plant, setting, u, linear }
    }

    /// Simulates with an effect, as finely as predictions are.
    pub fn simulated(&self, effect: &dyn Effect, place: &Place, parameters: &[f64], t0: f64) -> Channels {
        self.simulated_at(effect, place, parameters, t0, Fineness::FINE)
    }

    /// Simulates with an effect.
    pub fn simulated_at(
        &self,
        effect: &dyn Effect,
        place: &Place,
        parameters: &[f64],
        t0: f64,
        fineness: Fineness,
    ) -> Channels {
        let kinds = effect.parameters(&self.setting);
        let required = kinds.iter().filter(|parameter| !parameter.optional).count();
        assert!((required..=kinds.len()).contains(&parameters.len()), "{}", effect.name());
        simulate(&self.plant, &effect.act(&self.setting, place, parameters), &self.u, t0, None, fineness)
    }

    /// Returns the disagreement of a simulation with the truth, relative to the change by the effect.
    pub fn disagreement(&self, simulated: &[Vec<f64>], truth: &[Vec<f64>]) -> f64 {
        let changed = truth::size(&truth::minus(truth, &self.linear));
        assert!(changed > 1e-3 * truth::size(&self.linear), "an effect too small to judge: {changed:.1e}");
        truth::size(&truth::minus(simulated, truth)) / changed
    }
}

/// White Gaussian noise of unit RMS.
pub fn noise(seed: u64, channels: usize, samples: usize) -> Channels {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..channels).map(|_| (0..samples).map(|_| rng.sample(StandardNormal)).collect()).collect()
}

fn checks() -> impl Iterator<Item = &'static Check> {
    [actuator::CHECKS, disturbance::CHECKS, sensor::CHECKS, structure::CHECKS, time::CHECKS, stochastic::CHECKS]
        .into_iter()
        .flatten()
}

/// Every effect of the library has a check, and every check an effect. `--nocapture` prints the table.
#[test]
fn every_effect_agrees_with_an_independent_answer() {
    let library = Library::standard();
    for check in checks() {
        assert!(library.get(check.effect).is_some(), "{} is not an effect", check.effect);
    }
    let effects: Vec<&dyn Effect> = library.effects().collect();
    let found: Vec<(&str, Vec<(f64, f64)>)> = effects
        .into_par_iter()
        .map(|effect| {
            let own = checks().filter(|check| check.effect == effect.name());
            (effect.name(), own.map(|check| ((check.measure)(effect), check.limit)).collect())
        })
        .collect();
    let mut wrong = Vec::new();
    for (effect, found) in found {
        if found.is_empty() {
            wrong.push(format!("{effect}: no forward check"));
        }
        for (disagreement, limit) in found {
            println!("{effect:24} {disagreement:8.1e} (limit {limit:.1e})");
            if !(disagreement <= limit) {
                wrong.push(format!("{effect}: {disagreement:.2e} > {limit:.1e}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The effects are compared with the simulation's own linear response: both forms of it agree.
#[test]
fn without_effects_both_answers_are_the_same() {
    let rig = Rig::new(1);
    let simulated = simulate(&rig.plant, &[], &rig.u, T0, None, Fineness::FINE);
    let far = truth::size(&truth::minus(&simulated, &rig.linear)) / truth::size(&rig.linear);
    assert!(far < 1e-8, "{far:.1e}");
}
