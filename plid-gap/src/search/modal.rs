//! Locations on a single mode, for an effect inside the structure that no input's port explains.

use crate::case::record::Channels;
use crate::effects::Place;
use crate::fit::problem::{Placed, Problem};
use crate::fit::refit::Refit;
use crate::noise::NoiseModel;
use crate::prepare::of_ports;
use crate::search::price::Price;
use crate::search::rules::Scope;
use crate::search::stage::SearchStage;

/// Returns the modes around whose frequencies most of the residual of a linear model lies. `errors` are the errors of
/// each fitted record (p channels).
pub fn dominant(problem: &Problem, errors: &[Channels]) -> Vec<usize> {
    let search = &problem.settings.search;
    let plant = &problem.plant;
    let mut shares = vec![0.0; plant.modes.len()];
    let mut all = 0.0;
    for error in errors.iter().flatten() {
        let bins = plid_fourier::forward(error);
        for (k, bin) in bins.iter().enumerate() {
            let hz = k as f64 * plant.rate / error.len() as f64;
            let power = bin.norm_sqr();
            all += power;
            if let Some(mode) = plant.mode_at(hz)
                && (hz / plant.modes[mode].hz() - 1.0).abs() < search.mode_width
            {
                shares[mode] += power;
            }
        }
    }
    let mut order: Vec<usize> = (0..shares.len()).filter(|&k| shares[k] > search.mode_share * all).collect();
    order.sort_by(|&a, &b| shares[b].total_cmp(&shares[a]));
    order.truncate(search.modes);
    order
}

/// Returns the largest reduction of the refit's price by an effect on a single mode.
pub fn gain_on_modes(problem: &Problem, noise: &NoiseModel, refitted: &Refit, scope: &Scope) -> f64 {
    let quick = problem.head(scope.settings.first_samples, noise);
    let price = Price::new(problem, scope);
    let on_a_mode = |placed: &Placed| matches!(placed.place, Place::Port(k) if problem.setting.is_on_a_mode(k));
    let left_out = |placed: &Placed| !on_a_mode(placed) || !scope.admits(placed);
    let counts = [scope.settings.fitted / 2, scope.settings.polished / 2];
    let bare = refitted.as_fit();
    let stage = SearchStage::new(problem, &quick, &bare, None, &left_out, &price, counts);
    let (_, fits) = stage.without(problem, &quick, &left_out, &price);
    fits.iter().map(|fit| bare.cost - price.of(fit)).fold(0.0, f64::max)
}

impl Problem {
    /// Returns the same problem with ports on these modes.
    pub fn with_modal_places(mut self, modes: &[usize]) -> Self {
        modes.iter().for_each(|&mode| self.plant.add_modal_port(mode));
        self.setting.plant = self.plant.clone();
        of_ports(&mut self.setting, &self.records);
        self
    }
}
