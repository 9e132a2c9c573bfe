//! The refinement of a noise model and its covariance: Fisher scoring of the Whittle likelihood over the logarithms of
//! all variances and of each band's centre, width and slope.
//!
//! With S the density at a bin and y the data there, the gradient of the log likelihood is the sum of y^H S^-1 dS S^-1
//! y - tr(S^-1 dS), and the expected information of two parameters is the sum of tr(S^-1 dS_i S^-1 dS_j).

use nalgebra::{DMatrix, DVector};

use crate::noise::{Band, NoiseModel, Source, Stretch};
use plid_fourier::C;

/// Largest number of steps.
const STEPS: usize = 30;

/// Largest relative change of a parameter in one step. Within it, the expected information changes little.
const LONGEST_STEP: f64 = 0.2;

/// Shortest step in the scoring direction that is tried. A shorter step would change no stated result.
const SHORTEST_STEP: f64 = 1e-4;

/// A step that raises the log likelihood by less than this ends the fit.
const LEAST_GAIN: f64 = 1e-3;

/// Prior information on each logarithm: negligible compared with that of the data, but enough to keep the matrix
/// regular if no bin determines the parameter.
const PRIOR_INFORMATION: f64 = 0.1;

/// Step of the finite differences with respect to a band's slope and to the logarithms of its centre and width.
/// Central differences are then exact to eight digits.
const DIFFERENCE: f64 = 1e-4;

/// The quantity whose logarithm is a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Parameter {
    /// The variance of a source.
    Variance(usize),
    /// The centre of a band.
    Centre(usize),
    /// The width of a band.
    Width(usize),
    /// The slope of a band; the parameter is the slope itself.
    Slope(usize),
}

/// A model at the maximum of its likelihood, with the covariance of the logarithms of its last source's variance,
/// centre and width.
pub struct Scored {
    /// The noise model.
    pub model: NoiseModel,
    /// Covariance of the last source, which is a band: variance, centre, width.
    pub covariance: DMatrix<f64>,
}

impl Scored {
    /// Returns whether the band's centre is still near this frequency and its width is less than its centre.
    pub fn is_near(&self, hz: f64) -> bool {
        let Some((Source::Band(band), _)) = self.model.sources.last() else { return false };
        (band.hz / hz - 1.0).abs() < self.model.settings.band_shift && band.width < 1.0
    }
}

/// Refines a model whose last source is a band. Returns `None` if the stretches do not determine all parameters of
/// the band.
pub fn scored(from: &NoiseModel, stretches: &[Stretch]) -> Option<Scored> {
    let mut model = from.clone();
    let last = model.sources.len().checked_sub(1)?;
    let variances = (0..last).filter(|&j| !matches!(model.sources[j].0, Source::Actuator(_))).map(Parameter::Variance);
    let band = [Parameter::Slope(last), Parameter::Variance(last), Parameter::Centre(last), Parameter::Width(last)];
    let parameters: Vec<Parameter> = variances.chain(band).collect();
    let Source::Band(Band { hz: middle, .. }) = model.sources[last].0 else { return None };
    let range = from.settings.band_range;
    let near = |hz: f64| hz < range * middle && middle < range * hz;
    let tapered: Vec<Stretch> = stretches.iter().map(Stretch::tapered).collect();
    let bins: Vec<(f64, DVector<C>)> =
        tapered.iter().flat_map(|stretch| from.bins(stretch).step_by(2)).filter(|(hz, _)| near(*hz)).collect();
    let mut information = DMatrix::zeros(0, 0);
    let mut reached = misfit(&model, &bins);
    for _ in 0..STEPS {
        let (gradient, now) = score(&model, &bins, &parameters);
        information = now;
        let whole = information.clone().cholesky()?.solve(&gradient);
        // Each parameter moves as far as it may. If that oscillates about a resonance, the step is in the scoring
        // direction, in which the misfit always falls at first.
        let along = |share: f64| &whole * (share / whole.amax().max(share));
        let halved = std::iter::successors(Some(LONGEST_STEP), |share| Some(0.5 * share));
        let halved = halved.take_while(|share| *share > SHORTEST_STEP);
        let steps = std::iter::once(whole.map(|x| x.clamp(-LONGEST_STEP, LONGEST_STEP))).chain(halved.map(along));
        let tried = steps.map(|step| moved(&model, &parameters, &step)).map(|next| (misfit(&next, &bins), next));
        let before = reached;
        let Some(better) = tried.into_iter().find(|(misfit, _)| *misfit < before) else { break };
        (reached, model) = better;
        if before - reached < LEAST_GAIN {
            break;
        }
    }
    let n = parameters.len();
    let covariance = information.cholesky()?.inverse().view((n - 3, n - 3), (3, 3)).into_owned();
    Some(Scored { model, covariance })
}

fn moved(model: &NoiseModel, parameters: &[Parameter], step: &DVector<f64>) -> NoiseModel {
    let mut next = model.clone();
    parameters.iter().zip(step.iter()).for_each(|(parameter, step)| move_by(&mut next, *parameter, *step));
    next
}

fn move_by(model: &mut NoiseModel, parameter: Parameter, step: f64) {
    let (Parameter::Variance(j) | Parameter::Centre(j) | Parameter::Width(j) | Parameter::Slope(j)) = parameter;
    match (parameter, &mut model.sources[j]) {
        (Parameter::Variance(_), (_, variance)) => *variance *= step.exp(),
        (Parameter::Centre(_), (Source::Band(band), _)) => band.hz *= step.exp(),
        (Parameter::Width(_), (Source::Band(band), _)) => band.width *= step.exp(),
        (Parameter::Slope(_), (Source::Band(band), _)) => band.slope += step,
        // Other sources have no centre, width or slope.
        _ => (),
    }
}

/// Returns the negative log likelihood with the prior of the slopes. The score is its derivative, up to the sign.
fn misfit(model: &NoiseModel, bins: &[(f64, DVector<C>)]) -> f64 {
    let tilts = model.sources.iter().map(|(source, _)| match source {
        Source::Band(band) => 0.5 * (band.slope / model.settings.band_slope_std).powi(2),
        _ => 0.0,
    });
    let one = |(hz, data): &(f64, DVector<C>)| {
        let density = model.density(*hz);
        let determinant = density.determinant().norm().ln();
        density.try_inverse().map(|inverse| determinant + data.dotc(&(inverse * data)).re)
    };
    tilts.sum::<f64>() + bins.iter().filter_map(one).sum::<f64>()
}

/// Returns the gradient of the log likelihood and the expected information.
fn score(model: &NoiseModel, bins: &[(f64, DVector<C>)], parameters: &[Parameter]) -> (DVector<f64>, DMatrix<f64>) {
    let n = parameters.len();
    let (mut gradient, mut information) = (DVector::zeros(n), DMatrix::from_diagonal_element(n, n, PRIOR_INFORMATION));
    for (i, parameter) in parameters.iter().enumerate() {
        if let Parameter::Slope(j) = parameter
            && let Source::Band(band) = model.sources[*j].0
        {
            let variance = model.settings.band_slope_std.powi(2);
            gradient[i] -= band.slope / variance;
            information[(i, i)] = 1.0 / variance;
        }
    }
    for (hz, data) in bins {
        let Some(inverse) = model.density(*hz).try_inverse() else { continue };
        let seen = &inverse * data;
        let changes: Vec<DMatrix<C>> = parameters.iter().map(|&parameter| change(model, parameter, *hz)).collect();
        let weighed: Vec<DMatrix<C>> = changes.iter().map(|change| &inverse * change).collect();
        for i in 0..n {
            gradient[i] += seen.dotc(&(&changes[i] * &seen)).re - weighed[i].trace().re;
            for j in 0..=i {
                let both: f64 = weighed[i].component_mul(&weighed[j].transpose()).sum().re;
                information[(i, j)] += both;
                if i != j {
                    information[(j, i)] += both;
                }
            }
        }
    }
    (gradient, information)
}

/// Returns the derivative of the density with respect to a parameter.
fn change(model: &NoiseModel, parameter: Parameter, hz: f64) -> DMatrix<C> {
    let of = |source: Source, variance: f64| {
        let outer = model.columns(source, hz).into_iter().map(|h| &h * h.adjoint());
        outer.reduce(|a, b| a + b).expect("a source has a column") * C::from(variance)
    };
    match parameter {
        Parameter::Variance(j) => of(model.sources[j].0, model.sources[j].1),
        Parameter::Centre(j) | Parameter::Width(j) | Parameter::Slope(j) => {
            let moved = |step: f64| {
                let mut other = model.clone();
                move_by(&mut other, parameter, step);
                of(other.sources[j].0, other.sources[j].1)
            };
            (moved(DIFFERENCE) - moved(-DIFFERENCE)) / C::from(2.0 * DIFFERENCE)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::Plant;
    use crate::testing::{RATE, random_input, truss};

    const LENGTH: usize = 8192;

    /// Draws bins of a model's own noise: a square root of the density at each bin times Gaussian numbers.
    fn drawn(model: &NoiseModel, seed: u64) -> Stretch {
        let p = model.plant().p;
        let numbers = random_input(seed, LENGTH / 2 + 1, 2 * p);
        let mut bins = vec![vec![C::ZERO; LENGTH / 2 + 1]; p];
        for k in 0..=LENGTH / 2 {
            let lower = model.density(k as f64 * RATE / LENGTH as f64).cholesky().unwrap().l();
            let z = DVector::from_fn(p, |o, _| C::new(numbers[2 * o][k], numbers[2 * o + 1][k]) * 0.5f64.sqrt());
            (0..p).for_each(|o| bins[o][k] = (&lower * &z)[o]);
        }
        Stretch { length: LENGTH, bins, freedom: LENGTH as f64 }
    }

    /// The maximum is found from a start near it, and the scatter over draws agrees with the stated covariance.
    #[test]
    fn bands_are_found_as_well_as_is_stated() {
        let plant = Plant::new(&truss(2)).unwrap();
        let (hz, width) = (150.0, 0.1);
        let mut truth = NoiseModel::declared(&plant, &[1e-3; 2], &[0.0; 2]);
        let band = Source::Band(Band { slope: -1.0, ..Band::pass(0, hz, width) });
        let strong = 20.0 * 1e-6 / truth.columns(band, hz)[0].norm_squared();
        truth.sources.push((band, strong));
        let mut off = truth.clone();
        let last = off.sources.len() - 1;
        off.sources[last] = (Source::Band(Band::pass(0, 0.97 * hz, 2.0 * width)), 0.5 * strong);
        let mut squares = [0.0; 3];
        const DRAWS: usize = 12;
        for seed in 0..DRAWS as u64 {
            let found = scored(&off, &[drawn(&truth, 60 + seed)]).unwrap();
            let (Source::Band(found_band), theta) = found.model.sources[last] else { panic!("no band") };
            let ratios = [theta / strong, found_band.hz / hz, found_band.width / width];
            for (j, ratio) in ratios.into_iter().enumerate() {
                squares[j] += ratio.ln().powi(2) / found.covariance[(j, j)];
            }
            assert!(found.is_near(hz) && found.covariance[(1, 1)].sqrt() < 0.02, "{}", found.covariance);
        }
        // The mean of twelve squared normal variables lies within 0.3 and 2.2 in all but one of a thousand draws.
        assert!(squares.iter().all(|s| (0.3..2.2).contains(&(s / DRAWS as f64))), "{squares:?}");
    }
}
