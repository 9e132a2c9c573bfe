//! Sparse regression as in SINDy: the residual of the simulation is regressed on the traces of monomials of each
//! command, of the motion at each port and of each output, and terms below a threshold are dropped repeatedly (STLSQ).
//! BIC selects the threshold, and weighs the best model against the best models without each of its terms. The residual
//! and the traces are whitened by the noise model of the diagnosis; without whitening, terms would be fitted to noise.

use nalgebra::{DMatrix, DVector};
use plid_gap::case::Channels;
use plid_gap::effects::{Action, Command, Drive, Force, Memory, Sampling, Sensor, Setting};
use plid_gap::research::{Fineness, Plant, Problem, simulate};
use serde::{Deserialize, Serialize};

use super::weights::{at_work, schwarz};
use crate::judge::{Candidate, Claim, Named};

/// The answer, and the terms used for prediction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sparse {
    /// The answer in the form of a diagnosis.
    pub claim: Claim,
    /// The terms kept, largest first.
    pub terms: Vec<Kept>,
}

/// A term with its coefficient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kept {
    /// The monomial.
    pub term: Term,
    /// The coefficient in the units of the channels and ports.
    pub coefficient: f64,
    /// RMS of its whitened trace relative to that of the residual.
    pub share: f64,
}

/// A monomial and the place where it is added. Channels and ports are counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Term {
    /// Force d^i v^j at a port.
    Force {
        /// The port.
        port: usize,
        /// Power of the displacement.
        d: i32,
        /// Power of the velocity.
        v: i32,
    },
    /// A power of one command, added to a command.
    Command {
        /// The channel of the monomial.
        from: usize,
        /// The channel to which it is added.
        to: usize,
        /// Its power.
        power: i32,
    },
    /// The change of a command since the last sample.
    CommandStep {
        /// The command.
        input: usize,
    },
    /// Time times a command.
    CommandTrend {
        /// The command.
        input: usize,
    },
    /// A power of one output, added to an output.
    Output {
        /// The channel of the monomial.
        from: usize,
        /// The channel to which it is added.
        to: usize,
        /// Its power; 0 is a constant.
        power: i32,
    },
    /// The change of an output since the last sample.
    OutputStep {
        /// The output.
        output: usize,
    },
    /// Time.
    OutputTrend {
        /// The output to which it is added.
        output: usize,
    },
}

/// The powers of displacement and velocity at a port, up to the third degree.
const MOTION: [(i32, i32); 9] = [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)];
/// Thresholds as shares of the residual.
const THRESHOLDS: [f64; 6] = [0.01, 0.03, 0.1, 0.2, 0.4, 0.7];
/// Maximum number of rounds of dropping and fitting.
const ROUNDS: usize = 20;
/// Relative size at which traces are computed, so that their own feedback is of second order.
const SMALL: f64 = 1e-3;
/// Ridge on traces of unit length, which is needed because some traces are nearly equal.
const RIDGE: f64 = 1e-8;

fn library(m: usize, p: usize, ports: usize) -> Vec<Term> {
    let mut terms = Vec::new();
    for port in 0..ports {
        terms.extend(MOTION.map(|(d, v)| Term::Force { port, d, v }));
    }
    for to in 0..m {
        terms.extend((0..m).map(|from| Term::Command { from, to, power: 1 }));
        terms.extend([2, 3].map(|power| Term::Command { from: to, to, power }));
        terms.extend([Term::CommandStep { input: to }, Term::CommandTrend { input: to }]);
    }
    for to in 0..p {
        terms.extend((0..p).map(|from| Term::Output { from, to, power: 1 }));
        terms.extend([0, 2, 3].map(|power| Term::Output { from: to, to, power }));
        terms.extend([Term::OutputStep { output: to }, Term::OutputTrend { output: to }]);
    }
    terms
}

/// Regresses the residual of the simulation over the records of a problem.
pub(super) fn regress(problem: &Problem) -> Sparse {
    let setting = &problem.setting;
    let plant = &problem.plant;
    let terms = library(plant.m, plant.p, plant.ports.len());
    let base: Vec<Channels> = problem.records.iter().map(|r| run(plant, &[], &r.u, r.start_s)).collect();
    let whitened = |record: usize, channels: &Channels, to: &mut Vec<f64>| {
        let whitener = &problem.whiteners[record];
        let finite = |x: &f64| if x.is_finite() { *x } else { 0.0 };
        let channels: Channels = channels.iter().map(|channel| channel.iter().map(finite).collect()).collect();
        let first = to.len();
        to.resize(first + whitener.rows(), 0.0);
        whitener.apply(&channels, &mut to[first..]);
    };
    let difference = |a: &Channels, b: &Channels, scale: f64| -> Channels {
        a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b) * scale).collect()).collect()
    };
    let mut left = Vec::new();
    for (k, record) in problem.records.iter().enumerate() {
        whitened(k, &difference(&record.y, &base[k], 1.0), &mut left);
    }
    let left = DVector::from_vec(left);
    let mut traces = DMatrix::zeros(left.len(), terms.len());
    let mut lengths = vec![0.0; terms.len()];
    for (j, term) in terms.iter().enumerate() {
        let size = SMALL * term.size(setting);
        let mut trace = Vec::with_capacity(left.len());
        for (k, record) in problem.records.iter().enumerate() {
            let with = run(plant, &[term.action(size)], &record.u, record.start_s);
            whitened(k, &difference(&with, &base[k], 1.0 / size), &mut trace);
        }
        let trace = DVector::from_vec(trace);
        let length = trace.norm();
        // A term that diverges or does nothing is not a regressor.
        if length.is_finite() && length > 0.0 {
            lengths[j] = length;
            traces.set_column(j, &(trace / length));
        }
    }
    let kept = |model: &Regression| -> Vec<Kept> {
        let lively = model.terms.iter().filter(|(j, _)| lengths[*j] > 0.0);
        let one = |(j, x): &(usize, f64)| Kept {
            term: terms[*j],
            coefficient: x / lengths[*j],
            share: x.abs() / left.norm(),
        };
        let mut kept: Vec<Kept> = lively.map(one).collect();
        kept.sort_by(|a, b| b.share.total_cmp(&a.share));
        kept
    };
    let models = alternatives(&traces, &left);
    let explained = models.iter().map(|model| (model.bic, explanation(&kept(model), setting))).collect();
    let best = models.first().map(kept).unwrap_or_default();
    Sparse { claim: claim(explanation(&best, setting), schwarz(explained)), terms: best }
}

fn run(plant: &Plant, actions: &[Action], u: &[Vec<f64>], t0: f64) -> Channels {
    simulate(plant, actions, u, t0, None, Fineness::COARSE)
}

/// A model of the residual.
#[derive(Debug, Clone, PartialEq)]
struct Regression {
    bic: f64,
    /// The regressors kept, with their coefficients.
    terms: Vec<(usize, f64)>,
}

impl Regression {
    fn has_those_of(&self, other: &Self) -> bool {
        self.terms.len() == other.terms.len() && self.terms.iter().zip(&other.terms).all(|(a, b)| a.0 == b.0)
    }
}

/// Returns the best model, followed by the best models without each of its terms, every model once. A model without
/// terms is followed by the model with the best single term. Thresholds compare terms only with the residual, so they
/// may keep a term that a better model lacks; the better model then takes the place of the best one.
fn alternatives(x: &DMatrix<f64>, y: &DVector<f64>) -> Vec<Regression> {
    let products = Products::new(x, y);
    let mut best = products.stlsq(|_| true);
    loop {
        let without = best.terms.iter().map(|(lacks, _)| products.stlsq(|j| j != *lacks));
        let mut others: Vec<Regression> = without.collect();
        if best.terms.is_empty() {
            others.extend(products.single());
        }
        others.sort_by(|a, b| a.bic.total_cmp(&b.bic));
        match others.first() {
            Some(better) if better.bic < best.bic => best = better.clone(),
            _ => {
                others.insert(0, best);
                others.dedup_by(|a, b| a.has_those_of(b));
                return others;
            }
        }
    }
}

/// The products of regressors of unit length with each other and with the residual to be explained.
struct Products {
    rows: f64,
    squares: f64,
    normal: DMatrix<f64>,
    cross: DVector<f64>,
}

impl Products {
    fn new(x: &DMatrix<f64>, y: &DVector<f64>) -> Self {
        let across = x.transpose();
        Self { rows: y.len() as f64, squares: y.norm_squared(), normal: &across * x, cross: &across * y }
    }

    /// Returns the products of some regressors with each other, and with the residual to be explained.
    fn of(&self, active: &[usize]) -> (DMatrix<f64>, DVector<f64>) {
        let normal = DMatrix::from_fn(active.len(), active.len(), |i, j| self.normal[(active[i], active[j])]);
        (normal, DVector::from_fn(active.len(), |i, _| self.cross[active[i]]))
    }

    fn solved(&self, active: &[usize]) -> Option<DVector<f64>> {
        let (mut normal, cross) = self.of(active);
        (0..active.len()).for_each(|i| normal[(i, i)] += RIDGE);
        normal.cholesky().map(|factor| factor.solve(&cross))
    }

    fn bic(&self, terms: &[(usize, f64)]) -> f64 {
        let (normal, cross) = self.of(&terms.iter().map(|(j, _)| *j).collect::<Vec<_>>());
        let x = DVector::from_iterator(terms.len(), terms.iter().map(|(_, x)| *x));
        let squares = (self.squares - 2.0 * x.dot(&cross) + x.dot(&(normal * &x))).max(f64::MIN_POSITIVE);
        self.rows * (squares / self.rows).ln() + terms.len() as f64 * self.rows.ln()
    }

    /// Returns the best model over all thresholds, by sequentially thresholded least squares on the allowed regressors.
    fn stlsq(&self, allowed: impl Fn(usize) -> bool) -> Regression {
        let mut best = Regression { bic: self.bic(&[]), terms: Vec::new() };
        for threshold in THRESHOLDS {
            let terms = self.thresholded((0..self.cross.len()).filter(|j| allowed(*j)).collect(), threshold);
            let bic = self.bic(&terms);
            if bic < best.bic {
                best = Regression { bic, terms };
            }
        }
        best
    }

    /// Returns the model with the one term that explains most.
    fn single(&self) -> Option<Regression> {
        let best = (0..self.cross.len()).max_by(|a, b| self.cross[*a].abs().total_cmp(&self.cross[*b].abs()))?;
        let terms = vec![(best, self.cross[best])];
        Some(Regression { bic: self.bic(&terms), terms })
    }

    fn thresholded(&self, mut active: Vec<usize>, threshold: f64) -> Vec<(usize, f64)> {
        let mut found = Vec::new();
        for _ in 0..ROUNDS {
            let Some(coefficients) = self.solved(&active) else { break };
            found = active.iter().copied().zip(coefficients.iter().copied()).collect();
            let large = found.iter().filter(|(_, c)| c.abs() >= threshold * self.squares.sqrt()).map(|(j, _)| *j);
            let large: Vec<usize> = large.collect();
            if large.len() == active.len() {
                break;
            }
            active = large;
            if active.is_empty() {
                found.clear();
                break;
            }
        }
        found
    }
}

/// Returns the explanation by a model: its named terms, or something else if the largest term has no name in the
/// vocabulary.
fn explanation(kept: &[Kept], setting: &Setting) -> Candidate {
    let unknown = kept.first().is_some_and(|first| first.term.name(setting).is_none());
    let named = kept.iter().filter(|_| !unknown).filter_map(|kept| {
        let (effect, location) = kept.term.name(setting)?;
        Some(Named { effect: effect.to_owned(), location, ..Named::default() })
    });
    Candidate { effects: named.collect(), unknown, probability: None }
}

fn claim(best: Candidate, candidates: Vec<Candidate>) -> Claim {
    let verdict = match (best.unknown, best.effects.is_empty()) {
        (true, _) => "unknown",
        (false, true) => "none",
        (false, false) => "effects",
    };
    let sure = |named: Named| Named { confidence: Some(at_work(&candidates, &named)), ..named };
    let effects = best.effects.into_iter().map(sure).collect();
    Claim { verdict: verdict.to_owned(), effects, candidates, ..Claim::default() }
}

impl Sparse {
    pub(super) fn predict(&self, plant: &Plant, u: &[Vec<f64>], t0: f64) -> Channels {
        let actions: Vec<Action> = self.terms.iter().map(|kept| kept.term.action(kept.coefficient)).collect();
        simulate(plant, &actions, u, t0, None, Fineness::FINE)
    }
}

impl Term {
    /// Returns the effect whose expansion begins with this term, and its place.
    fn name(&self, setting: &Setting) -> Option<(&'static str, String)> {
        let names = &setting.names;
        let at_port = |port: usize| match setting.plant.ports[port].input {
            Some(input) => format!("input:{}", names.inputs[input]),
            None => format!("port:{}", names.ports[port]),
        };
        let input = |i: usize| format!("input:{}", names.inputs[i]);
        let output = |o: usize| format!("output:{}", names.outputs[o]);
        Some(match *self {
            Self::Force { port, d: 3, v: 0 } => ("cubic-stiffness", at_port(port)),
            Self::Force { port, d: 2, v: 0 } => ("quadratic-stiffness", at_port(port)),
            Self::Force { port, d: 0, v: 3 } => ("quadratic-damping", at_port(port)),
            Self::Force { .. } => return None,
            Self::Command { from, to, power: 1 } if from == to => ("actuator-gain", input(to)),
            Self::Command { from, to, power: 1 } => {
                ("actuator-crosstalk", format!("input:{}->{}", names.inputs[from], names.inputs[to]))
            }
            Self::Command { to, power: 3, .. } => ("actuator-saturation", input(to)),
            Self::Command { .. } => return None,
            Self::CommandStep { input: i } => ("actuator-delay", input(i)),
            Self::CommandTrend { input: i } => ("actuator-gain-drift", input(i)),
            Self::Output { to, power: 0, .. } => ("sensor-offset", output(to)),
            Self::Output { from, to, power: 1 } if from == to => ("sensor-gain", output(to)),
            Self::Output { from, to, power: 1 } => {
                ("sensor-crosstalk", format!("output:{}->{}", names.outputs[from], names.outputs[to]))
            }
            Self::Output { to, power: 3, .. } => ("sensor-saturation", output(to)),
            Self::Output { .. } => return None,
            Self::OutputStep { output: o } => ("sensor-delay", output(o)),
            Self::OutputTrend { output: o } => ("sensor-drift", output(o)),
        })
    }

    /// Returns a coefficient at which the term is about as large as the command or output itself.
    fn size(&self, setting: &Setting) -> f64 {
        let over = |power: i32, rms: f64| 1.0 / rms.max(f64::MIN_POSITIVE).powi(power);
        let size = match *self {
            Self::Force { port, d, v } => {
                setting.force[port] * over(d, setting.d_rms[port]) * over(v, setting.v_rms[port])
            }
            Self::Command { from, power, .. } => over(power - 1, setting.u_rms[from]),
            Self::Output { from, to, power } => setting.y_rms[to] * over(power, setting.y_rms[from]),
            Self::CommandStep { .. } | Self::OutputStep { .. } => 1.0,
            Self::CommandTrend { .. } => over(1, setting.duration_s),
            Self::OutputTrend { output } => setting.y_rms[output] * over(1, setting.duration_s),
        };
        if size.is_finite() && size > 0.0 { size } else { 1.0 }
    }

    fn action(&self, coefficient: f64) -> Action {
        let term = *self;
        match term {
            Self::Force { port, d, v } => Action::Force(port, Box::new(Power { d, v, coefficient })),
            Self::Command { .. } | Self::CommandStep { .. } | Self::CommandTrend { .. } => {
                Action::Command(Box::new(Added { term, coefficient }))
            }
            _ => Action::Sensor(Box::new(Added { term, coefficient })),
        }
    }
}

struct Power {
    d: i32,
    v: i32,
    coefficient: f64,
}

impl Force for Power {
    fn force(&self, d: f64, v: f64, _state: &[f64]) -> f64 {
        self.coefficient * d.powi(self.d) * v.powi(self.v)
    }
}

struct Added {
    term: Term,
    coefficient: f64,
}

impl Command for Added {
    fn apply(&self, drive: &mut Drive, memory: &mut Memory) {
        let (parts, step, t0) = (drive.parts, drive.step(), drive.t0);
        let (from, to) = match self.term {
            Term::Command { from, to, .. } => (from, to),
            Term::CommandStep { input } | Term::CommandTrend { input } => (input, input),
            _ => return,
        };
        let source = drive.u[from].clone();
        let whole = memory.followed_by(to, &source, parts);
        for (k, value) in drive.u[to].iter_mut().enumerate() {
            let added = match self.term {
                Term::Command { power, .. } => source[k].powi(power),
                Term::CommandStep { .. } => source[k] - whole.back(k, parts as isize).unwrap_or(0.0),
                _ => (t0 + k as f64 * step) * source[k],
            };
            *value += self.coefficient * added;
        }
    }
}

impl Sensor for Added {
    fn apply(&self, y: &mut [Vec<f64>], sampling: Sampling, memory: &mut Memory) {
        let (from, to) = match self.term {
            Term::Output { from, to, .. } => (from, to),
            Term::OutputStep { output } | Term::OutputTrend { output } => (output, output),
            _ => return,
        };
        let source = y[from].clone();
        let whole = memory.followed_by(to, &source, 1);
        for (k, value) in y[to].iter_mut().enumerate() {
            let added = match self.term {
                Term::Output { power, .. } => source[k].powi(power),
                Term::OutputStep { .. } => source[k] - whole.back(k, 1).unwrap_or(0.0),
                _ => sampling.time(k),
            };
            *value += self.coefficient * added;
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha12Rng;

    use super::*;

    /// Two of thirty regressors make up the data, together with noise.
    #[test]
    fn the_terms_that_made_the_data_are_kept() {
        let mut rng = ChaCha12Rng::seed_from_u64(1);
        let mut x = DMatrix::from_fn(4000, 30, |_, _| rng.random_range(-1.0..1.0));
        for mut column in x.column_iter_mut() {
            let length = column.norm();
            column /= length;
        }
        let y = x.column(4) * 3.0 - x.column(17) * 1.0 + DVector::from_fn(4000, |_, _| rng.random_range(-0.01..0.01));
        let kept = Products::new(&x, &y).stlsq(|_| true).terms;
        assert_eq!(kept.iter().map(|(j, _)| *j).collect::<Vec<_>>(), [4, 17]);
        assert!((kept[0].1 - 3.0).abs() < 0.1 && (kept[1].1 + 1.0).abs() < 0.1, "{kept:?}");
        // No regressor is kept if the data are noise alone.
        let noise = DVector::from_fn(4000, |_, _| rng.random_range(-1.0..1.0));
        assert_eq!(Products::new(&x, &noise).stlsq(|_| true).terms, []);
    }

    /// If two regressors nearly coincide, either of them may be the right one. A regressor without a twin is beyond
    /// doubt.
    #[test]
    fn a_term_with_a_twin_is_in_doubt() {
        let mut rng = ChaCha12Rng::seed_from_u64(2);
        let mut x = DMatrix::from_fn(4000, 10, |_, _| rng.random_range(-1.0..1.0));
        let twin = x.column(3) + DVector::from_fn(4000, |_, _| rng.random_range(-1e-3..1e-3));
        x.set_column(8, &twin);
        for mut column in x.column_iter_mut() {
            let length = column.norm();
            column /= length;
        }
        let noise = DVector::from_fn(4000, |_, _| rng.random_range(-0.5..0.5));
        let y = (x.column(3) + x.column(5)) * 60.0 + noise;
        let models = alternatives(&x, &y);
        let weighed = schwarz(models.iter().map(|m| (m.bic, as_candidate(m))).collect());
        let probability = |j: usize| at_work(&weighed, &Named { effect: j.to_string(), ..Named::default() });
        assert!(probability(5) > 0.999, "{weighed:?}");
        assert!((0.05..0.95).contains(&probability(3)) && (0.05..0.95).contains(&probability(8)), "{weighed:?}");
    }

    /// The best single regressor of a thousand rows of noise explains less than the price of a term.
    #[test]
    fn nothing_is_no_certainty() {
        let mut rng = ChaCha12Rng::seed_from_u64(3);
        let mut x = DMatrix::from_fn(1000, 30, |_, _| rng.random_range(-1.0..1.0));
        for mut column in x.column_iter_mut() {
            let length = column.norm();
            column /= length;
        }
        let noise = DVector::from_fn(1000, |_, _| rng.random_range(-1.0..1.0));
        let models = alternatives(&x, &noise);
        assert_eq!(models.iter().map(|model| model.terms.len()).collect::<Vec<_>>(), [0, 1]);
        let weighed = schwarz(models.iter().map(|m| (m.bic, as_candidate(m))).collect());
        assert!(weighed[0].probability.is_some_and(|p| (0.5..0.98).contains(&p)), "{weighed:?}");
    }

    fn as_candidate(model: &Regression) -> Candidate {
        let named = |(j, _): &(usize, f64)| Named { effect: j.to_string(), ..Named::default() };
        Candidate { effects: model.terms.iter().map(named).collect(), ..Candidate::default() }
    }

    #[test]
    fn what_a_term_adds_is_its_monomial() {
        let mut y = vec![vec![1.0, 2.0, 3.0], vec![10.0, 20.0, 30.0]];
        let sampling = Sampling { t0: 5.0, rate: 10.0, at_rest: true };
        let apply = |term: Term, y: &mut Vec<Vec<f64>>| {
            Sensor::apply(&Added { term, coefficient: 2.0 }, y, sampling, &mut Memory::default())
        };
        apply(Term::Output { from: 0, to: 1, power: 2 }, &mut y);
        assert_eq!(y[1], [12.0, 28.0, 48.0]);
        apply(Term::OutputStep { output: 0 }, &mut y);
        assert_eq!(y[0], [3.0, 4.0, 5.0]);
        apply(Term::OutputTrend { output: 0 }, &mut y);
        assert_eq!(y[0], [13.0, 14.2, 15.4]);
        let mut drive = Drive { parts: 2, u: vec![vec![1.0, 2.0, 4.0, 8.0]], rate: 1.0, t0: 0.0 };
        Command::apply(
            &Added { term: Term::CommandStep { input: 0 }, coefficient: 1.0 },
            &mut drive,
            &mut Memory::default(),
        );
        assert_eq!(drive.u[0], [2.0, 4.0, 7.0, 14.0]);
        assert_eq!(Power { d: 2, v: 1, coefficient: 3.0 }.force(2.0, 5.0, &[]), 60.0);
    }
}
