//! The linear parameters with their Gaussian prior: frequency, damping ratio and shapes of every mode, or poles and
//! gains if there are no modes; the offsets of outputs that have any; and the initial states of records that do not
//! start from rest. Changes within the prior do not count as effects.

use nalgebra::DVector;

use crate::case::Limits;
use crate::case::limits::Limit;
use crate::case::record::{Record, rms};
use crate::fit::jacobian::Jacobian;
use crate::plant::{Plant, RestNumber, Spectrum};
use crate::simulate::{State, commands};
use plid_fourier::C;

/// Prior standard deviation of an initial state, relative to the state that the input excites, and of an offset,
/// relative to the output: wide enough for the records alone to determine them.
const FREE_STD: f64 = 3.0;

/// Median of the absolute value of a standard normal variable.
const NORMAL_MEDIAN: f64 = 0.6745;

/// Smallest number of parameters whose median is stated. The standard deviation of the median of four magnitudes of
/// normal variables is about 0.6 of that median (asymptotically, 1 / (2 f sqrt(n)) with the density f there).
const LEAST_OFF: usize = 4;

/// The quantity that a linear parameter of the simulation changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A frequency, a damping ratio or another parameter of a pole, including the size of its contribution.
    Pole,
    /// The response to one input.
    Input(usize),
    /// The response of one output.
    Output(usize),
}

/// The linear parameters and their prior: frequency, damping, input shape (m) and output shape (p) of each mode,
/// followed by poles and gains of a simulation without modes, by offsets of the outputs, and by the initial states.
#[derive(Debug, Clone)]
pub struct Nuisance {
    pub(super) m: usize,
    pub(super) p: usize,
    pub(super) modes: usize,
    pub(super) rest: usize,
    /// States of the controller, if there is one.
    pub(super) controller: usize,
    /// Poles and gains of a simulation without modes.
    spectrum: Option<Spectrum>,
    /// RMS of each output, if the outputs have offsets.
    offsets: Vec<f64>,
    /// The directions of each mode's shapes in the simulation as given.
    nominal: Vec<(C, C)>,
    /// Index of each record's initial state, if it is fitted.
    pub(super) starts: Vec<Option<usize>>,
    /// Size of each mode's state under the records' inputs, followed by those of the other states. The states of the
    /// controller are taken under the records' outputs.
    pub(super) sizes: Vec<f64>,
    /// Standard deviations of the prior.
    pub std: Vec<f64>,
    /// Whether a port follows the shapes of its input. The derivatives of the linear simulation do not include how
    /// this changes a force at the port, so only fits with the derivatives of the simulation with its effects set
    /// this flag.
    pub ports_follow: bool,
}

impl Nuisance {
    /// Lays out the parameters for a simulation and the records that are fitted.
    pub fn new(plant: &Plant, records: &[Record], limits: &Limits) -> Self {
        let (m, p, modes, rest) = (plant.m, plant.p, plant.modes.len(), plant.rest.a.nrows());
        let controller = plant.controller.as_ref().map_or(0, |controller| controller.a.nrows());
        let mut std = Vec::new();
        for _ in 0..modes {
            std.extend((0..2 + m + p).map(|part| limits.std(limit_of_part(part))));
        }
        let spectrum = Spectrum::of(plant);
        std.extend(spectrum.iter().flat_map(|spectrum| &spectrum.numbers).map(|number| limits.std(number.limit())));
        let offsets: Vec<f64> =
            (0..plant.offsets.len()).map(|o| rms(records.iter().flat_map(|record| &record.y[o]))).collect();
        std.extend(offsets.iter().map(|_| FREE_STD));
        let starts = records
            .iter()
            .map(|record| {
                (!record.from_rest).then(|| {
                    let at = std.len();
                    std.extend(std::iter::repeat_n(FREE_STD, 2 * modes + rest + controller));
                    at
                })
            })
            .collect();
        let sizes = state_sizes(plant, records);
        let nominal = plant.modes.iter().map(directions).collect();
        Self { m, p, modes, rest, controller, spectrum, offsets, nominal, starts, sizes, std, ports_follow: false }
    }

    /// Gives initial states and offsets the units that they have in other parameters of the same plant.
    pub(crate) fn measure_as(&mut self, other: &Self) {
        self.sizes.clone_from(&other.sizes);
        self.offsets.clone_from(&other.offsets);
    }

    /// Widens the prior for a simulation that was itself estimated, by the standard deviations of its parameters.
    pub fn with_prior_std(mut self, prior_std: &[f64]) -> Self {
        self.std.iter_mut().zip(prior_std).for_each(|(std, prior)| *std = std.hypot(*prior));
        self
    }

    /// Returns the factor, at least one, by which the parameters of modes, poles and gains exceed their prior. It is
    /// estimated from the median of the parameters that the records determine, which is insensitive to a few that an
    /// effect has moved.
    pub fn needed(&self, eta: &[f64], jacobian: &Jacobian, determined: f64) -> f64 {
        self.typical(eta, self.determined(jacobian, determined)).map_or(1.0, |off| off.max(1.0))
    }

    /// Returns the factor by which the parameters to which a limit applies are off, relative to their prior; `None`
    /// if the records determine too few of them.
    pub fn off(&self, limit: Limit, eta: &[f64], jacobian: &Jacobian, determined: f64) -> Option<f64> {
        let of_limit: Vec<usize> =
            self.determined(jacobian, determined).filter(|&k| self.limit(k) == Some(limit)).collect();
        if of_limit.len() < LEAST_OFF { None } else { self.typical(eta, of_limit.into_iter()) }
    }

    /// Returns the robust standard deviation of some parameters, relative to their prior; `None` if there are none.
    fn typical(&self, eta: &[f64], of: impl Iterator<Item = usize>) -> Option<f64> {
        let mut off: Vec<f64> = of.map(|k| (eta[k] / self.std[k]).abs()).collect();
        off.sort_by(f64::total_cmp);
        off.get(off.len() / 2).map(|median| median / NORMAL_MEDIAN)
    }

    /// Returns the limit that applies to an entry; `None` for offsets and initial states.
    fn limit(&self, index: usize) -> Option<Limit> {
        match self.entry(index) {
            Some((_, part)) => Some(limit_of_part(part)),
            None => self.numbers().get(index - self.of_modes()).map(|number| number.limit()),
        }
    }

    /// Returns twice the negative logarithm of the prior density of the parameters that the records determine, up to
    /// a constant. The prior is widened by the factor that these parameters need.
    pub fn prior_cost(&self, eta: &[f64], jacobian: &Jacobian, determined: f64) -> f64 {
        let scale = self.needed(eta, jacobian, determined);
        let cost = |k: usize| (eta[k] / self.std[k] / scale).powi(2) + 2.0 * scale.ln();
        self.determined(jacobian, determined).map(cost).sum()
    }

    /// Returns the parameters of modes, poles and gains that the records determine: their information, the prior
    /// included, exceeds that of the prior by the factor `determined`.
    pub fn determined(&self, jacobian: &Jacobian, determined: f64) -> impl Iterator<Item = usize> {
        (0..self.first_offset()).filter(move |&k| jacobian.normal[(k, k)] * self.std[k].powi(2) > determined)
    }

    /// Adds initial states for records that are cut into windows, `windows[k]` of record k. The first window of a
    /// record begins as the record does. The existing entries keep their places.
    pub fn with_windows(mut self, windows: &[usize]) -> Self {
        let states = self.states();
        let mut starts = Vec::new();
        for (first, &count) in self.starts.iter().zip(windows) {
            starts.push(*first);
            for _ in 1..count {
                starts.push(Some(self.std.len()));
                self.std.extend(std::iter::repeat_n(FREE_STD, states));
            }
        }
        self.starts = starts;
        self
    }

    /// Removes one of the records. Its initial state remains a parameter without influence.
    pub fn forget(&mut self, record: usize) {
        self.starts.remove(record);
    }

    /// Returns the number of entries of an initial state: those of the modes, of the rest and of the controller.
    pub fn states(&self) -> usize {
        2 * self.modes + self.rest + self.controller
    }

    /// Returns the number of entries that belong to the simulation; the initial states follow.
    pub fn of_simulation(&self) -> usize {
        self.first_offset() + self.offsets.len()
    }

    /// Returns the entry of the first output's offset.
    fn first_offset(&self) -> usize {
        self.of_modes() + self.numbers().len()
    }

    /// Returns the entry of each output's offset and the size of its unit, if the outputs have offsets.
    pub(super) fn offsets(&self) -> impl Iterator<Item = (usize, f64)> {
        self.offsets.iter().enumerate().map(|(o, size)| (self.first_offset() + o, *size))
    }

    /// Returns these parameters for the simulation as given: the parameters of the simulation are zero, and the
    /// initial states are kept.
    pub fn as_given(&self, eta: &[f64]) -> Vec<f64> {
        let mut given = eta.to_vec();
        given[..self.of_simulation()].fill(0.0);
        given
    }

    /// Returns the number of entries that belong to the modes.
    pub(super) fn of_modes(&self) -> usize {
        self.modes * self.each()
    }

    /// Returns the parameters of the rest, in the order of their entries.
    pub(super) fn numbers(&self) -> &[RestNumber] {
        self.spectrum.as_ref().map_or(&[], |spectrum| &spectrum.numbers)
    }

    /// States the values that the parameters of the rest take for these entries of `eta`.
    pub fn rest_in_words(&self, eta: &[f64], inputs: &[String], outputs: &[String]) -> Vec<String> {
        let Some(spectrum) = &self.spectrum else { return Vec::new() };
        let numbers = spectrum.numbers.iter().zip(&eta[self.of_modes()..]);
        numbers.map(|(number, eta)| spectrum.words(*number, *eta, inputs, outputs)).collect()
    }

    /// Returns the record to whose initial state an entry belongs.
    pub fn record_of(&self, index: usize) -> Option<usize> {
        let states = self.states();
        self.starts.iter().position(|start| start.is_some_and(|at| (at..at + states).contains(&index)))
    }

    /// Returns the number of entries.
    pub fn len(&self) -> usize {
        self.std.len()
    }

    /// Returns whether there are no entries.
    pub fn is_empty(&self) -> bool {
        self.std.is_empty()
    }

    /// Returns the number of entries of each mode.
    pub(super) fn each(&self) -> usize {
        2 + self.m + self.p
    }

    /// Returns the mode of an entry and its part (0 frequency, 1 damping, then inputs, then outputs); `None` for an
    /// entry that belongs to no mode.
    pub fn entry(&self, index: usize) -> Option<(usize, usize)> {
        (index < self.of_modes()).then(|| (index / self.each(), index % self.each()))
    }

    /// Returns the quantity that an entry changes; `None` for offsets and initial states.
    pub fn part(&self, index: usize) -> Option<Part> {
        if let Some((_, part)) = self.entry(index) {
            return Some(match part {
                0 | 1 => Part::Pole,
                part if part < 2 + self.m => Part::Input(part - 2),
                part => Part::Output(part - 2 - self.m),
            });
        }
        self.numbers().get(index - self.of_modes()).map(|number| match *number {
            RestNumber::Rate(_) | RestNumber::Frequency(_) | RestNumber::Damping(_) | RestNumber::Contribution => {
                Part::Pole
            }
            RestNumber::Input(i) => Part::Input(i),
            RestNumber::Output(o) => Part::Output(o),
        })
    }

    /// Returns the first entry of a mode.
    pub fn first_of(&self, mode: usize) -> usize {
        mode * self.each()
    }

    /// Returns the simulation changed by `eta`.
    pub fn apply(&self, plant: &Plant, eta: &[f64]) -> Plant {
        let mut changed = plant.clone();
        for k in 0..self.modes {
            let at = &eta[k * self.each()..(k + 1) * self.each()];
            if at.iter().all(|x| *x == 0.0) {
                continue;
            }
            let (w, zeta) = (plant.modes[k].pole.norm(), plant.modes[k].damping());
            let (w, zeta) = (w * (1.0 + at[0]).max(0.1), (zeta * at[1].clamp(-3.0, 3.0).exp()).min(0.99));
            changed.move_pole(k, C::new(-zeta * w, w * (1.0 - zeta * zeta).sqrt()));
            let (b, c) = self.directions(k, &changed.modes[k]);
            let before = self.ports_follow.then(|| changed.modes[k].clone());
            changed.change(k, |mode| {
                for i in 0..self.m {
                    mode.b[i] += b * at[2 + i];
                }
                for o in 0..self.p {
                    mode.c[o] += c * at[2 + self.m + o];
                }
            });
            if let Some(before) = before {
                changed.ports_follow(k, &before);
            }
        }
        if let Some(spectrum) = &self.spectrum {
            let at = &eta[self.of_modes()..self.first_offset()];
            if at.iter().any(|x| *x != 0.0) {
                spectrum.change(&mut changed, at);
            }
        }
        for (offset, (k, size)) in changed.offsets.iter_mut().zip(self.offsets()) {
            *offset += size * eta[k];
        }
        changed
    }

    /// Returns the directions of a mode's shapes, moved or not, with the signs of the simulation as given. The sign
    /// of half an angle is ambiguous, and may change as the pole moves.
    pub(super) fn directions(&self, k: usize, mode: &crate::plant::Mode) -> (C, C) {
        let towards = |nominal: C, now: C| if (nominal.conj() * now).re < 0.0 { -now } else { now };
        let ((b, c), nominal) = (directions(mode), self.nominal[k]);
        (towards(nominal.0, b), towards(nominal.1, c))
    }

    /// Returns whether a record starts from rest, so that its initial state is not fitted.
    pub fn starts_at_rest(&self, record: usize) -> bool {
        self.starts[record].is_none()
    }

    /// Returns the initial state of a record, if it is fitted. Entries that `eta` lacks are zero.
    pub fn start(&self, record: usize, eta: &[f64]) -> Option<State> {
        let at = self.starts[record]?;
        let entry = |k: usize| eta.get(at + k).copied().unwrap_or(0.0);
        let modes = (0..self.modes).map(|k| C::new(entry(2 * k), entry(2 * k + 1)) * self.sizes[k]);
        let other = |j: usize| entry(2 * self.modes + j) * self.sizes[self.modes + j];
        let rest = (0..self.rest).map(other).collect();
        let controller = (self.rest..self.rest + self.controller).map(other).collect();
        Some(State { modes: modes.collect(), rest, controller })
    }
}

/// Returns the limit that applies to a part of a mode (0 frequency, 1 damping, then shapes).
fn limit_of_part(part: usize) -> Limit {
    match part {
        0 => Limit::Frequency,
        1 => Limit::Damping,
        _ => Limit::Shape,
    }
}

/// Returns the directions in which real shapes change: the magnitude of the largest entry, times the phase that makes
/// the shape as nearly real as possible, with either sign.
fn directions(mode: &crate::plant::Mode) -> (C, C) {
    let of = |shape: &[C]| {
        let size = shape.iter().map(|x| x.norm()).fold(0.0, f64::max);
        C::from_polar(size, shape.iter().map(|x| x * x).sum::<C>().arg() / 2.0)
    };
    (of(&mode.b), of(&mode.c))
}

/// Returns the size of each state: the RMS for modes and for states that no output depends on under the records'
/// inputs and for the controller under the records' outputs, and the increment in a sample for other states. A state
/// that nothing excites has the size one.
fn state_sizes(plant: &Plant, records: &[Record]) -> Vec<f64> {
    let level = records.iter().map(Record::level).fold(0.0, f64::max);
    let step = 1.0 / plant.rate;
    let modal = plant.modes.iter().map(|mode| {
        let turn = (mode.pole * step).exp();
        let held = ((turn - 1.0) / mode.pole).norm();
        let b: f64 = mode.b.iter().map(|b| b.norm_sqr()).sum();
        held * b.sqrt() * level / (1.0 - turn.norm_sqr()).max(1e-6).sqrt()
    });
    let rest = (0..plant.rest.seen()).map(|j| plant.rest.b.row(j).norm() * level).chain(unseen_sizes(plant, records));
    let outputs: Vec<_> = records.iter().map(|record| &record.y).collect();
    let controller = plant.controller.iter().flat_map(|controller| controller.state_sizes(&outputs));
    modal.chain(rest).chain(controller).map(|size| if size > 0.0 { size } else { 1.0 }).collect()
}

/// Returns the RMS of each state that no output depends on, under the commands of the loudest record. No record shows
/// such a state, so its prior must reach as far as it may wander.
fn unseen_sizes(plant: &Plant, records: &[Record]) -> Vec<f64> {
    let rest = &plant.rest;
    let (seen, all) = (rest.seen(), rest.a.nrows());
    let loudest = records.iter().max_by(|a, b| a.level().total_cmp(&b.level()));
    let Some(record) = loudest.filter(|_| seen < all) else { return vec![0.0; all - seen] };
    let sent = commands(plant, &record.u);
    let (mut x, mut squares) = (DVector::zeros(all), DVector::zeros(all));
    for n in 0..record.samples() {
        x = &rest.a * x + &rest.b * DVector::from_fn(plant.m, |i, _| sent[i][n]);
        squares += x.component_mul(&x);
    }
    let rms = |j: usize| (squares[j] / record.samples().max(1) as f64).sqrt();
    (seen..all).map(rms).map(|size| if size.is_finite() { size } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Fineness, simulate};
    use crate::testing;

    /// A shape's parameter keeps its sign however far the pole moves, and in any basis.
    #[test]
    fn directions_follow_the_pole() {
        let plant = Plant::new(&testing::truss(3)).unwrap();
        for turn in 0..64 {
            let turn = C::from_polar(1.0, std::f64::consts::TAU * f64::from(turn) / 64.0);
            let mut turned = plant.clone();
            for mode in &mut turned.modes {
                mode.b.iter_mut().for_each(|b| *b *= turn);
                mode.c.iter_mut().for_each(|c| *c /= turn);
            }
            let nuisance = Nuisance::new(&turned, &[], &Limits::default());
            for (k, mode) in turned.modes.iter().enumerate() {
                let mut moved = turned.clone();
                moved.move_pole(k, mode.pole * 0.8);
                let (b, c) = nuisance.directions(k, &moved.modes[k]);
                let keeps = |shape: &[C], now: C, moved: &[C], then: C| {
                    let sign = |x: C, direction: C| (x * direction.conj()).re.signum();
                    shape.iter().zip(moved).all(|(x, y)| sign(*x, now) == sign(*y, then))
                };
                let (b0, c0) = nuisance.directions(k, mode);
                assert!(keeps(&mode.b, b0, &moved.modes[k].b, b), "mode {k} turned by {turn}");
                assert!(keeps(&mode.c, c0, &moved.modes[k].c, c), "mode {k} turned by {turn}");
            }
        }
    }

    /// Each kind of parameter is compared with its own limit, and one kind that is far off does not count for others.
    #[test]
    fn each_kind_is_off_by_itself() {
        let ready = testing::laws::prepared(&[]);
        let problem = &ready.problem;
        let (nuisance, jacobian) = (&problem.nuisance, problem.jacobian(&problem.plant));
        let times = [(Limit::Frequency, 3.0), (Limit::Damping, 0.5), (Limit::Shape, 2.0)];
        let mut eta = vec![0.0; nuisance.len()];
        for (limit, off) in times {
            let of_limit = (0..nuisance.of_modes()).filter(|&k| nuisance.limit(k) == Some(limit));
            of_limit.for_each(|k| eta[k] = off * nuisance.std[k] * if k % 2 == 0 { 1.0 } else { -1.0 });
        }
        for (limit, off) in times {
            let stated = nuisance.off(limit, &eta, &jacobian, 0.0).unwrap();
            assert!((stated * NORMAL_MEDIAN - off).abs() < 1e-12, "{limit:?}: {stated}");
            assert_eq!(nuisance.off(limit, &eta, &jacobian, f64::INFINITY), None);
        }
    }

    /// A cubic spring acts at a port whose shape differs from the simulation's. Once the input shape is corrected,
    /// the force and the displacement are right.
    #[test]
    fn ports_follow_their_input_shapes() {
        const MODE: usize = 1;
        let (sim, real) = (testing::truss(3), testing::truss_with(3, |_, input, _| input[(MODE, 0)] *= 1.05));
        let [nominal, truth] = [&sim, &real].map(|model| Plant::new(model).unwrap());
        let u = testing::random_input(3, 2000, 2);
        let mut record = testing::case(&sim, &sim).records[1].clone();
        record.u = u.clone();
        let mut nuisance = Nuisance::new(&nominal, std::slice::from_ref(&record), &Limits::default());
        nuisance.ports_follow = true;
        // The entry is in units of the largest entry of the shape.
        let shape = &nominal.modes[MODE].b;
        let mut eta = vec![0.0; nuisance.len()];
        eta[MODE * nuisance.each() + 2] = 0.05 * (shape[0] / directions(&nominal.modes[MODE]).0).re;
        let followed = nuisance.apply(&nominal, &eta);
        let cubic = crate::effects::Library::standard();
        let cubic = cubic.get("cubic-stiffness").unwrap();
        let run = |plant: &Plant, k: f64| {
            let setting = crate::effects::Setting::bare(plant, &sim);
            simulate(plant, &cubic.act(&setting, &crate::effects::Place::Port(0), &[k]), &u, 0.0, None, Fineness::FINE)
        };
        let mut seen = crate::effects::Setting::bare(&truth, &sim);
        crate::prepare::of_ports(&mut seen, std::slice::from_ref(&record));
        let size = 0.3 * seen.stiffness[0] / seen.d_rms[0].powi(2);
        let difference = |a: &[Vec<f64>], b: &[Vec<f64>]| -> f64 {
            a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
        };
        let (expected, without) = (run(&truth, size), run(&truth, 0.0));
        let effect = difference(&expected, &without);
        let still = difference(&run(&followed, 0.0), &without) / effect;
        let off = difference(&run(&followed, size), &expected) / effect;
        assert!(still < 1e-9 && off < 1e-3, "{still} {off}");
        let mut stays = followed.clone();
        stays.ports.clone_from(&nominal.ports);
        assert!(difference(&run(&stays, size), &expected) > 20.0 * off * effect, "nothing was to follow");
    }
}
