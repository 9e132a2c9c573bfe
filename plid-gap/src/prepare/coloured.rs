//! Random forces in a frequency band that no command causes, found in the noise of quiet records.

use crate::noise::whittle::scored;
use crate::noise::{Band, Source};
use crate::prepare::Prepared;
use crate::prepare::wandering::Wandering;

/// Thinning factor of the bins in the search for a band, because bands are wider than the spacing that remains.
const THINNED: usize = 4;

/// Relative widths of the bands that are tried. The last is that of the first search.
const WIDTHS: [f64; 2] = [0.05, 0.2];

/// Ratio of adjacent centre frequencies in the first search. Bands of the larger width overlap.
const COARSE: f64 = 1.12;

/// Number of bands of the first search near which others are tried.
const REFINED: usize = 3;

/// A random force in a frequency band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coloured {
    /// Its port and centre frequency.
    pub band: Band,
    /// Its standard deviation, in the unit of the port's force.
    pub a: f64,
    /// Relative standard deviations of `a` and of the centre.
    pub std: [f64; 2],
    /// Its gain, as twice the log likelihood.
    pub gain: f64,
}

impl Coloured {
    /// Returns the force as a source of noise.
    pub fn source(&self) -> Source {
        Source::Band(self.band)
    }
}

/// Finds a random force in a band. There is one if an equal force on all modes does not explain the quiet records,
/// but one band at one port does.
pub fn coloured(ready: &Prepared) -> Option<Coloured> {
    if ready.quiet.is_empty() {
        return None;
    }
    let plant = &ready.problem.plant;
    let settings = &ready.problem.settings.prepare;
    let least = ready.problem.settings.search.stochastic_gain;
    let plain = ready.declared.fit_with(&ready.quiet, &[Source::Ambient], 40, 1);
    let free = &ready.noise;
    if 2.0 * (plain.misfit - free.misfit) < least {
        return None;
    }
    let scored = |band: Band| {
        let sources = [Source::Ambient, Source::Band(band)];
        (ready.declared.fit_with(&ready.quiet, &sources, 8, THINNED).misfit, band)
    };
    let centres = std::iter::successors(Some(settings.lowest_band_hz), |hz| Some(hz * COARSE));
    let centres = centres.take_while(|hz| *hz < 0.45 * plant.rate);
    let each = |hz: f64| (0..ready.declared.ports()).map(move |port| Band::pass(port, hz, WIDTHS[1]));
    let mut first: Vec<(f64, Band)> = centres.flat_map(each).map(scored).collect();
    first.sort_by(|a, b| a.0.total_cmp(&b.0));
    let step = COARSE.sqrt();
    let next = first.iter().take(REFINED).flat_map(|(_, band)| {
        [1.0 / step, 1.0, step]
            .into_iter()
            .flat_map(|ratio| WIDTHS.map(|width| Band::pass(band.port, ratio * band.hz, width)))
    });
    let (_, band) = next.map(scored).min_by(|a, b| a.0.total_cmp(&b.0))?;
    let hz = band.hz;
    if ready.wandering.iter().any(|line| (line.hz / hz - 1.0).abs() < settings.near_line) {
        return None;
    }
    let rough = ready.declared.fit_with(&ready.quiet, &[Source::Ambient, Source::Band(band)], 40, 1);
    let misfit = rough.misfit;
    let gain = 2.0 * (plain.misfit - misfit);
    // An equal force on all modes is an assumption, and a poor one with few ports. If a larger force on one mode
    // explains as much as the band, there is no band.
    let pushed =
        |mode: usize| ready.declared.fit_with(&ready.quiet, &[Source::Ambient, Source::Mode(mode)], 40, 1).misfit;
    let near = (0..plant.modes.len()).filter(|&k| (plant.modes[k].hz() / hz - 1.0).abs() < 2.0 * WIDTHS[1]);
    let harder = near.map(pushed).fold(plain.misfit, f64::min);
    if 2.0 * (harder - misfit) < least {
        return None;
    }
    // The three parameters of a band must explain most of what a free force on each mode explains.
    let share = gain / (2.0 * (plain.misfit - free.misfit));
    if gain <= least || share <= settings.band_share {
        return None;
    }
    let theta = rough.sources.last()?.1;
    Some(Coloured { band, a: size(theta, band, plant.rate), std: [f64::INFINITY; 2], gain })
}

/// Returns the standard deviation of white noise of density theta in a band. The variance is theta times the band's
/// share of half the sample rate, times pi / 2 for the skirts of the band.
fn size(theta: f64, band: Band, rate: f64) -> f64 {
    (theta * std::f64::consts::FRAC_PI_2 * band.width * band.hz / (0.5 * rate)).sqrt()
}

impl Coloured {
    /// Returns whether quiet records show this force rather than a line whose phase wanders: a lightly damped resonance
    /// in a band looks like a line.
    pub fn rather_than(&self, line: &Wandering, ready: &Prepared) -> bool {
        let misfit = |band| ready.declared.fit_with(&ready.quiet, &[Source::Ambient, Source::Band(band)], 40, 1).misfit;
        misfit(self.band) < misfit(Band::line(line.port, line.hz))
    }

    /// Refines the parameters from the grid of the search to the maximum of the likelihood. Separate forces on the
    /// modes absorb deviations of the skirts, so that centre, width and size describe the band alone.
    pub fn sharpened(self, ready: &Prepared) -> Self {
        let rough = ready.declared.fit_beside(&ready.quiet, [self.source()]);
        let Some(scored) = scored(&rough, &ready.quiet).filter(|scored| scored.is_near(self.band.hz)) else {
            return self;
        };
        let Some(&(Source::Band(band), theta)) = scored.model.sources.last() else { return self };
        let c = scored.covariance;
        // The logarithm of a is half the sum of the logarithms of theta, centre and width.
        let std = [0.5 * c.sum().max(0.0).sqrt(), c[(1, 1)].max(0.0).sqrt()];
        Self { band, a: size(theta, band, ready.problem.plant.rate), std, gain: self.gain }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::case::record::Record;
    use crate::effects::Action;
    use crate::plant::Plant;
    use crate::prepare::{Known, prepare};
    use crate::simulate::{Fineness, simulate};
    use crate::testing;

    /// Adds the response to a force at a port to a record.
    fn push(record: &mut Record, plant: &Plant, port: usize, strength: f64, force: Vec<f64>) {
        let rate = plant.rate;
        let of = move |t: f64| strength * force[((t * rate).round() as usize).min(force.len() - 1)];
        let zero = vec![vec![0.0; record.samples()]; plant.m];
        let pushed = simulate(plant, &[Action::Disturbance(port, Box::new(of))], &zero, 0.0, None, Fineness::FINE);
        record.y.iter_mut().zip(&pushed).for_each(|(y, more)| y.iter_mut().zip(more).for_each(|(y, more)| *y += more));
    }

    /// Returns white noise that was filtered by a resonator at 137 Hz, the frequency of a mode.
    fn about_137_hz(seed: u64, samples: usize) -> Vec<f64> {
        let (turn, radius) = (2.0 * (TAU * 137.0 / testing::RATE).cos(), 0.97);
        let (mut force, mut last) = (Vec::new(), [0.0; 2]);
        for e in testing::random_input(seed, samples, 1).remove(0) {
            let now = turn * radius * last[0] - radius * radius * last[1] + e;
            last = [now, last[0]];
            force.push(now);
        }
        force
    }

    /// A mode that ambient forces drive more than the others is not a band.
    #[test]
    fn a_mode_that_is_pushed_harder_is_no_coloured_force() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        let mut plant = Plant::new(&sim).unwrap();
        plant.add_modal_port(1);
        let port = plant.ports.len() - 1;
        let white = testing::random_input(77, case.records[0].samples(), 1).remove(0);
        push(&mut case.records[0], &plant, port, 0.02, white);
        let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let least = ready.problem.settings.search.stochastic_gain;
        let plain = ready.declared.fit_with(&ready.quiet, &[Source::Ambient], 40, 1);
        assert!(2.0 * (plain.misfit - ready.noise.misfit) > 2.0 * least, "it does not show");
        assert_eq!(coloured(&ready), None);
    }

    /// A force in a band at the second port is found there, even if there are ports on single modes.
    #[test]
    fn a_coloured_force_is_looked_for_at_the_struts_alone() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        let plant = Plant::new(&sim).unwrap();
        let force = about_137_hz(77, case.records[0].samples());
        push(&mut case.records[0], &plant, 1, 0.003, force);

        let mut ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let found = coloured(&ready);
        assert!(
            found.is_some_and(|force| force.band.port == 1 && (force.band.hz / 137.0 - 1.0).abs() < 0.1),
            "{found:?}"
        );
        ready.problem = ready.problem.with_modal_places(&[1, 2]);
        assert_eq!(coloured(&ready), found);
    }

    /// If all records are driven, the force is found in the part of the residual that the inputs do not explain,
    /// although the frequencies of the simulation are off.
    #[test]
    fn a_coloured_force_is_found_in_driven_records() {
        let real = testing::truss(1);
        let sim = testing::truss_with(1, |modes, _, _| modes.iter_mut().for_each(|(hz, _)| *hz *= 1.003));
        let mut case = testing::case(&sim, &real);
        case.records.remove(0);
        let plant = Plant::new(&real).unwrap();
        for (k, record) in case.records.iter_mut().enumerate() {
            let force = about_137_hz(77 + k as u64, record.samples());
            push(record, &plant, 1, 0.01, force);
        }
        let mut ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        assert!(ready.quiet.is_empty());
        let given = vec![0.0; ready.problem.nuisance.len()];
        let simulated = crate::fit::free_run::outputs(&ready.problem, &given, &[]);
        ready.take_for_noise(&simulated, true);
        let band = ready.coloured.expect("a force in a band").band;
        assert!(band.port == 1 && (band.hz / 137.0 - 1.0).abs() < 0.1, "{band:?}");
    }
}
