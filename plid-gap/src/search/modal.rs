//! Places on one mode alone, for an effect inside the structure that no input's strut explains.

use crate::case::record::Channels;
use crate::fit::problem::Problem;
use crate::fourier;
use crate::prepare::of_ports;

/// Modes that are offered.
const MOST: usize = 3;

/// Share of the gap about a mode from which it is one of them.
const SHARE: f64 = 0.1;

/// About a mode: its frequency and as much of it to either side.
const WIDTH: f64 = 0.03;

/// The modes about which most of what a linear model leaves lies: `errors` of each record that is fitted (p channels).
pub fn dominant(problem: &Problem, errors: &[Channels]) -> Vec<usize> {
    let plant = &problem.plant;
    let mut shares = vec![0.0; plant.modes.len()];
    let mut all = 0.0;
    for error in errors.iter().flatten() {
        let bins = fourier::forward(error);
        for (k, bin) in bins.iter().enumerate() {
            let hz = k as f64 * plant.rate / error.len() as f64;
            let power = bin.norm_sqr();
            all += power;
            if let Some(mode) = plant.mode_at(hz)
                && (hz / plant.modes[mode].hz() - 1.0).abs() < WIDTH
            {
                shares[mode] += power;
            }
        }
    }
    let mut order: Vec<usize> = (0..shares.len()).filter(|&k| shares[k] > SHARE * all).collect();
    order.sort_by(|&a, &b| shares[b].total_cmp(&shares[a]));
    order.truncate(MOST);
    order
}

impl Problem {
    /// The same with places on these modes beside the struts.
    pub fn with_modal_places(mut self, modes: &[usize]) -> Self {
        modes.iter().for_each(|&mode| self.plant.add_modal_port(mode));
        self.setting.plant = self.plant.clone();
        if let Some(loudest) = self.records.iter().max_by(|a, b| a.level().total_cmp(&b.level())) {
            of_ports(&mut self.setting, loudest);
        }
        self
    }
}
