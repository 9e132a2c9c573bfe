//! The results of the cells in sentences.

use statrs::distribution::{ContinuousCDF, StudentsT};

use super::cell::{DEFAULT, Finished, Score};
use plid_catalogue::ExpectationName;

use super::statistics::{Figure, geometric_mean};
use plid_model::signal::median;

/// A difference matters only if it is at least this large.
const MATTERS: f64 = 0.05;
/// A difference matters only if it would arise by chance, without a true difference, with less than this probability.
const CHANCE: f64 = 0.003;

/// Returns the score of a method in a cell.
pub fn score<'a>(cell: &'a Finished, method: &str) -> Option<&'a Score> {
    cell.scores.iter().find(|score| score.method == method)
}

/// Returns the names of all expectations.
pub fn names() -> Vec<&'static str> {
    ExpectationName::all().into_iter().map(ExpectationName::as_str).collect()
}

/// Whether a ratio over this number of runs differs from one by a sufficient and significant amount.
fn matters(ratio: Option<Figure>, runs: usize) -> bool {
    let Ok(student) = StudentsT::new(0.0, 1.0, (runs.max(2) - 1) as f64) else { return false };
    let errors = student.inverse_cdf(1.0 - CHANCE / 2.0);
    ratio.is_some_and(|r| r.value.ln().abs() >= MATTERS.ln_1p() && (r.value - 1.0).abs() >= errors * r.error)
}

/// Returns the cells with the true Sigma.
fn told_right(cells: &[Finished]) -> impl Iterator<Item = &Finished> {
    cells.iter().filter(|cell| cell.sigma == 1.0 && !cell.plant.starts_with("truss"))
}

/// Returns, for a truss and a signal-to-noise ratio, the cell with the setting of Sigma / R at which `method` has the
/// smallest free-run error.
pub fn best_sigma<'a>(cells: &'a [Finished], plant: &str, signal_to_noise: f64, method: &str) -> Option<&'a Finished> {
    let value = |cell: &Finished| score(cell, method).and_then(|s| s.free_run).map_or(f64::INFINITY, |f| f.value);
    cells
        .iter()
        .filter(|cell| cell.plant == plant && cell.signal_to_noise == signal_to_noise && value(cell).is_finite())
        .min_by(|x, y| value(x).total_cmp(&value(y)))
}

/// The verdict on one expectation.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// Its name.
    pub name: &'static str,
    /// Smallest and largest NEES over the cells with the true Sigma.
    pub nees: Option<(f64, f64)>,
    /// Geometric mean of the factor by which its NEES differs from one in these cells.
    pub miss: Option<f64>,
    /// Smallest and largest RMS error of a relative to that of the reference in these cells.
    pub rmse_a: Option<(f64, f64)>,
    /// Geometric mean over these cells of the free-run error relative to that of the default.
    pub free_run_in_class: Option<f64>,
    /// Geometric mean over the signal-to-noise ratios of the truss of the free-run error relative to that of the
    /// default, each expectation with its best Sigma.
    pub free_run_truss: Option<f64>,
    /// Number of runs that are lost or have a useless model, over all cells.
    pub failed: usize,
}

fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.fold(None, |range, v| Some(range.map_or((v, v), |(low, high): (f64, f64)| (low.min(v), high.max(v)))))
}

fn geometric(values: impl Iterator<Item = f64>) -> Option<f64> {
    geometric_mean(&values.collect::<Vec<f64>>()).map(|f| f.value)
}

fn free_run(cell: &Finished, method: &str) -> Option<f64> {
    score(cell, method)?.free_run.map(|f| f.value)
}

/// Returns each plant with each of its signal-to-noise ratios.
fn places(cells: &[Finished]) -> Vec<(&str, f64)> {
    let mut places: Vec<(&str, f64)> = Vec::new();
    for cell in cells {
        let place = (cell.plant.as_str(), cell.signal_to_noise);
        if !places.contains(&place) {
            places.push(place);
        }
    }
    places
}

/// Returns the verdict on each of the five expectations.
pub fn standings(cells: &[Finished]) -> Vec<Standing> {
    let truss: Vec<(&str, f64)> = places(cells).into_iter().filter(|(plant, _)| plant.starts_with("truss")).collect();
    names()
        .into_iter()
        .map(|name| {
            let right = || told_right(cells).filter_map(|cell| score(cell, name));
            let nees = || right().filter_map(|s| s.nees).map(|f| f.value);
            let at_best =
                |method: &str, (plant, snr): (&str, f64)| free_run(best_sigma(cells, plant, snr, method)?, method);
            Standing {
                name,
                nees: range(nees()),
                miss: geometric(nees().map(|v| v.max(1.0 / v))),
                rmse_a: range(right().filter_map(|s| s.rmse_a_over_reference).map(|f| f.value)),
                free_run_in_class: geometric(right().filter_map(|s| s.free_run_over_default).map(|f| f.value)),
                free_run_truss: geometric(
                    truss.iter().filter_map(|&place| Some(at_best(name, place)? / at_best(DEFAULT.name(), place)?)),
                ),
                failed: cells.iter().filter_map(|cell| score(cell, name)).map(|s| s.lost + s.useless).sum(),
            }
        })
        .collect()
}

/// Returns the free-run error relative to that of the default. Plants in the model class and the truss have equal
/// weight.
fn overall(standing: &Standing) -> Option<f64> {
    geometric([standing.free_run_in_class, standing.free_run_truss].into_iter().flatten())
}

/// Returns the recommended expectation. Those whose mean free-run error is within two per cent of the smallest are
/// equivalent; among them, it is the one whose NEES is closest to one.
pub fn recommended(standings: &[Standing]) -> Option<&Standing> {
    let error = |s: &Standing| overall(s).unwrap_or(f64::INFINITY);
    let least = standings.iter().map(error).fold(f64::INFINITY, f64::min);
    let alike = standings.iter().filter(|s| error(s) <= 1.02 * least);
    alike.min_by(|x, y| x.miss.unwrap_or(f64::INFINITY).total_cmp(&y.miss.unwrap_or(f64::INFINITY)))
}

/// Returns the sentences at the top of the report.
pub fn sentences(cells: &[Finished]) -> Vec<String> {
    let standings = standings(cells);
    let mut all = Vec::new();
    if let Some(best) = recommended(&standings) {
        let default = if best.name == DEFAULT.name() { "stays" } else { "should become" };
        let others: Vec<String> = standings
            .iter()
            .filter_map(|s| Some(format!("{} {:.3}, {:.2}", s.name, overall(s)?, s.miss.unwrap_or(f64::NAN))))
            .collect();
        all.push(format!(
            "{} {default} the default of plid run: of those within two per cent of the least mean free-run error, its \
             P is the most honest. \
             Mean free-run error over the default's, and the factor by which NEES is off one: {}.",
            best.name,
            others.join("; ")
        ));
    }
    let nees: Vec<String> = standings
        .iter()
        .filter_map(|s| s.nees.map(|(low, high)| format!("{} {low:.2} to {high:.2}", s.name)))
        .collect();
    if !nees.is_empty() {
        all.push(format!(
            "NEES over the number of parameters, in all cells with the true Sigma (one for a consistent covariance): \
             {}.",
            nees.join(", ")
        ));
    }
    all.extend(where_it_matters(cells));
    all.extend(against_sigma(cells));
    all
}

/// Returns sentences on the largest signal-to-noise ratio at which any other expectation differs from the default,
/// and on the largest difference.
fn where_it_matters(cells: &[Finished]) -> Vec<String> {
    let mut plants: Vec<&str> = cells.iter().map(|cell| cell.plant.as_str()).collect();
    plants.dedup();
    plants.into_iter().filter_map(|plant| where_it_matters_for(cells, plant)).collect()
}

fn where_it_matters_for(cells: &[Finished], plant: &str) -> Option<String> {
    let is_truss = plant.starts_with("truss");
    let own: Vec<&Finished> = places(cells)
        .into_iter()
        .filter(|place| place.0 == plant)
        .filter_map(|(_, snr)| centre(cells, plant, snr))
        .collect();
    let differs = |cell: &&&Finished| {
        let surely =
            |s: &Score| matters(s.rmse_a_over_default, cell.runs) || matters(s.free_run_over_default, cell.runs);
        names().iter().filter_map(|name| score(cell, name)).any(surely)
    };
    let largest = own.iter().filter(differs).map(|cell| cell.signal_to_noise).reduce(f64::max);
    let (factor, name, snr) = own
        .iter()
        .flat_map(|cell| names().into_iter().map(move |name| (cell, name)))
        .filter_map(|(cell, name)| Some((score(cell, name)?.free_run_over_default?.value, name, cell.signal_to_noise)))
        .max_by(|x, y| x.0.total_cmp(&y.0))?;
    let settings = if is_truss { "with the Sigma that is best for the default" } else { "with the true Sigma" };
    let upto = match largest {
        Some(largest) => format!(
            "the choice changes rmse or free-run error by 5 % or more up to a signal-to-noise ratio of {largest}"
        ),
        None => "no difference of 5 % in rmse or simulation error is significant".into(),
    };
    Some(format!(
        "{plant}, {settings}: {upto}; the largest free-run error is {factor:.2} times the default's ({name} at {snr})."
    ))
}

/// Returns the cell with the true Sigma, or for the truss the cell with the Sigma that is best for the default.
fn centre<'a>(cells: &'a [Finished], plant: &str, signal_to_noise: f64) -> Option<&'a Finished> {
    if plant.starts_with("truss") {
        return best_sigma(cells, plant, signal_to_noise, DEFAULT.name());
    }
    cells.iter().find(|cell| cell.plant == plant && cell.signal_to_noise == signal_to_noise && cell.sigma == 1.0)
}

/// Returns a sentence on how much the free-run error depends on the expectation and on Sigma.
fn against_sigma(cells: &[Finished]) -> Option<String> {
    let (mut choices, mut sigmas, mut choices_beyond) = (Vec::new(), Vec::new(), Vec::new());
    for (plant, snr) in places(cells) {
        let here = || cells.iter().filter(|cell| cell.plant == plant && cell.signal_to_noise == snr);
        let Some(centre) = centre(cells, plant, snr) else { continue };
        // Powers of ten are not exact in binary.
        let Some(beyond) = here().find(|cell| (cell.sigma / centre.sigma - 100.0).abs() < 1e-6) else { continue };
        let by_choice =
            |cell| range(names().iter().filter_map(|name| free_run(cell, name))).map(|(low, high)| high / low);
        let by_sigma = free_run(beyond, DEFAULT.name()).zip(free_run(centre, DEFAULT.name())).map(|(x, y)| x / y);
        choices.extend(by_choice(centre));
        choices_beyond.extend(by_choice(beyond));
        sigmas.extend(by_sigma);
    }
    let wins = choices.iter().zip(&sigmas).filter(|(choice, sigma)| sigma > choice).count();
    if [&choices, &sigmas, &choices_beyond].iter().any(|values| values.is_empty()) {
        return None;
    }
    let (choice, sigma, beyond) = (median(&choices), median(&sigmas), median(&choices_beyond));
    Some(format!(
        "Sigma against expectation: a Sigma 100 times too large multiplies the default's free-run error by {sigma:.2} \
         (median), the poorest of the five \
         has {choice:.2} times the error of the best; Sigma matters more in {wins} of {} places. With that Sigma the \
         poorest has {beyond:.2} times the \
         error of the best.",
        choices.len()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(value: f64, error: f64) -> Option<Figure> {
        Some(Figure { value, error })
    }

    /// Returns a cell whose methods have these values of NEES, free-run error and its ratio to that of the default.
    fn cell(plant: &str, signal_to_noise: f64, sigma: f64, scores: [(f64, f64, f64); 5]) -> Finished {
        let score = |(&method, (nees, free_run, ratio)): (&&str, (f64, f64, f64))| Score {
            method: method.into(),
            lost: 0,
            useless: 0,
            nees: figure(nees, 0.1),
            nees_a: None,
            rmse_a: None,
            rmse_b: None,
            rmse_a_over_reference: None,
            rmse_a_over_default: None,
            free_run: figure(free_run, 0.01),
            free_run_over_default: figure(ratio, 0.01),
        };
        let scores = names().iter().zip(scores).map(score).collect();
        Finished { plant: plant.into(), signal_to_noise, sigma, runs: 100, reference: None, scores }
    }

    #[test]
    fn accuracy_comes_first_and_honesty_among_equals() {
        // prior has by far the smallest free-run error; then joint-ekf is equivalent and more consistent.
        let far = [(3.0, 0.08, 0.8), (3.0, 0.1, 1.0), (1.0, 0.1, 1.0), (1.0, 0.1, 1.0), (1.0, 0.1, 1.0)];
        assert_eq!(recommended(&standings(&[cell("scalar", 1.0, 1.0, far)])).unwrap().name, "prior");
        let near = [(3.0, 0.1, 0.99), (3.0, 0.1, 1.0), (2.0, 0.1, 1.0), (2.0, 0.1, 1.0), (0.9, 0.1, 1.0)];
        assert_eq!(recommended(&standings(&[cell("scalar", 1.0, 1.0, near)])).unwrap().name, "joint-ekf");
    }

    #[test]
    fn a_difference_within_chance_is_none() {
        assert!(matters(figure(1.2, 0.05), 100));
        assert!(!matters(figure(1.2, 0.1), 100), "two standard errors");
        assert!(!matters(figure(1.2, 0.02), 3), "ten standard errors of three runs");
        assert!(!matters(figure(1.03, 0.001), 100), "too small to matter");
        assert!(matters(figure(0.9, 0.01), 100));
    }

    #[test]
    fn sigma_is_weighed_against_the_choice() {
        let scores = |poorest: f64, of_default: f64| {
            let one = (1.0, of_default, 1.0);
            [(1.0, poorest * of_default, poorest), one, one, one, one]
        };
        let cells = [cell("truss 24", 3.0, 0.001, scores(1.2, 0.1)), cell("truss 24", 3.0, 0.1, scores(1.5, 0.3))];
        let said = against_sigma(&cells).unwrap();
        assert!(said.contains("by 3.00 (median)") && said.contains("has 1.20 times"), "{said}");
        assert!(said.contains("in 1 of 1 places") && said.contains("poorest has 1.50 times"), "{said}");
        let said = where_it_matters_for(&cells, "truss 24").unwrap();
        assert!(said.contains("ratio of 3;") && said.contains("1.20 times the default's (prior at 3)"), "{said}");
    }
}
