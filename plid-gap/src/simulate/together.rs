//! Runs that are alike are stepped together: runs of one plant with the same number of steps, whose forces act at the
//! same ports. A step of one run has to wait for its force; meanwhile the processor works on the others.

use rayon::prelude::*;

use super::{Fineness, State, changed_plant, most_in_a_block, on_a_given_motion, parts_at, parts_of};
use crate::case::record::Channels;
use crate::effects::{Action, Drive, Force, Memory};
use crate::plant::Plant;
use crate::simulate::between::Between;
use crate::simulate::runner::{Given, Runner, advance};

/// A run of the simulation.
#[derive(Clone, Copy)]
pub struct Run<'r> {
    /// The actions of the effects.
    pub actions: &'r [Action],
    /// Held inputs: m channels.
    pub u: &'r [Vec<f64>],
    /// Time of the first sample in s.
    pub t0: f64,
    /// The state at the first sample; at rest if there is none.
    pub start: Option<&'r State>,
}

/// Returns the outputs of several runs before the effects on the sensors. Runs that are alike are stepped together. A
/// run whose motion is so large that a law is stiff there is repeated with finer steps.
pub fn before_sensors(plant: &Plant, runs: &[Run<'_>], fineness: Fineness) -> Vec<Channels> {
    let (mut outputs, parts) = stepped(plant, runs, fineness);
    // Coarse runs only rank, so they are repeated only if even the number of parts of fine runs does not suffice.
    let enough = fineness.force.max(Fineness::FINE.force);
    let mut finer: Vec<usize> = (0..runs.len()).filter(|&k| parts[k] > enough).collect();
    finer.sort_by_key(|&k| parts[k]);
    for alike in finer.chunk_by(|&a, &b| parts[a] == parts[b]) {
        let again: Vec<Run> = alike.iter().map(|&k| runs[k]).collect();
        let finer = before_sensors(plant, &again, Fineness { force: parts[alike[0]], ..fineness });
        alike.iter().zip(finer).for_each(|(&k, y)| outputs[k] = y);
    }
    outputs
}

/// Returns the outputs of the runs, and the number of parts of a sample that each needs for its motion.
fn stepped(plant: &Plant, runs: &[Run<'_>], fineness: Fineness) -> (Vec<Channels>, Vec<usize>) {
    let runs: Vec<Applied> = runs.iter().map(|run| Applied::new(plant, run, fineness)).collect();
    let mut order: Vec<usize> = (0..runs.len()).collect();
    order.sort_by(|&a, &b| runs[a].samples().cmp(&runs[b].samples()).then(runs[a].run.t0.total_cmp(&runs[b].run.t0)));
    let ordered: Vec<&Applied> = order.iter().map(|&k| &runs[k]).collect();
    let alike = ordered.chunk_by(|a, b| a.is_like(b)).flat_map(|alike| alike.chunks(MOST_TOGETHER));
    let groups: Vec<&[&Applied]> = alike.collect();
    let advanced = |group: &&[&Applied]| match **group {
        [a, b, c, d] => advanced([a, b, c, d], plant, fineness),
        [a, b, c] => advanced([a, b, c], plant, fineness),
        [a, b] => advanced([a, b], plant, fineness),
        _ => group.iter().flat_map(|one| advanced([*one], plant, fineness)).collect(),
    };
    let advanced: Vec<Vec<(Channels, usize)>> = groups.par_iter().map(advanced).collect();
    let (mut outputs, mut parts) = (vec![Vec::new(); runs.len()], vec![0; runs.len()]);
    order.into_iter().zip(advanced.into_iter().flatten()).for_each(|(k, (y, p))| (outputs[k], parts[k]) = (y, p));
    for (y, offset) in outputs.iter_mut().flat_map(|outputs| outputs.iter_mut().zip(&plant.offsets)) {
        y.iter_mut().for_each(|y| *y += offset);
    }
    (outputs, parts)
}

/// Largest number of runs that are stepped together: with more, the sums no longer fit into the registers.
const MOST_TOGETHER: usize = 4;

/// A run whose effects have been applied to the plant and to the command.
struct Applied<'r> {
    run: Run<'r>,
    /// The changed plant, if effects change it.
    changed: Option<Plant>,
    start: Option<State>,
    given: Given,
    /// Number of parts of each value of the command.
    parts: usize,
    forces: Vec<(usize, &'r dyn Force)>,
    /// Forces at ports whose motion is an input.
    moved: Vec<(usize, &'r dyn Force)>,
    /// The factor on the stiffness for every [`Fineness::drift`] samples; empty if the stiffness does not change.
    factors: Vec<f64>,
}

impl<'r> Applied<'r> {
    fn new(plant: &Plant, &run: &Run<'r>, fineness: Fineness) -> Self {
        let changed = changed_plant(plant, run.actions);
        let start = run.start.map(|start| changed.as_ref().map_or_else(|| start.clone(), |to| start.of(to)));
        let plant = changed.as_ref().unwrap_or(plant);
        let (moved, forces): (Vec<_>, Vec<_>) = (run.actions.iter())
            .filter_map(|action| if let Action::Force(port, law) = action { Some((*port, law.as_ref())) } else { None })
            .partition(|&(port, _): &(usize, &dyn Force)| plant.ports[port].moved_by().is_some());
        let mut drive = Drive::new(run.u, plant.rate, run.t0);
        if plant.controller.is_some() {
            // The effects act on the whole command, to which the controller adds its part at each sample.
            drive.refine(between(plant, &run).parts());
        } else {
            for action in run.actions {
                if let Action::Command(command) = action {
                    command.apply(&mut drive, &mut Memory::default());
                }
            }
        }
        let parts = forces.iter().map(|&(port, law)| parts_of(plant, port, law)).fold(fineness.force, usize::max);
        let mut parts = if forces.is_empty() { 1 } else { (parts / drive.parts).max(1) };
        let most = most_in_a_block(plant);
        if parts > most {
            drive.refine(drive.parts * parts / most);
            parts = most;
        }
        let samples = run.u.first().map_or(0, Vec::len);
        let disturbance = |action: &Action| {
            let Action::Disturbance(_, of) = action else { return None };
            Some((0..samples).map(|k| of(run.t0 + k as f64 / plant.rate)).collect())
        };
        let disturbances = run.actions.iter().filter_map(disturbance).collect();
        let factors = factors(&run, fineness.drift, plant.rate);
        Self { run, start, given: Given { drive, disturbances }, parts, forces, moved, changed, factors }
    }

    fn samples(&self) -> usize {
        self.run.u.first().map_or(0, Vec::len)
    }

    /// Returns the ports on which disturbances act.
    fn pushed(&self) -> impl Iterator<Item = usize> {
        let port = |action: &Action| if let Action::Disturbance(port, _) = action { Some(*port) } else { None };
        self.run.actions.iter().filter_map(port)
    }

    /// Returns whether two runs have the same number of steps, and the same plant at each step.
    fn is_like(&self, other: &Self) -> bool {
        let steps = |run: &Self| (run.samples(), run.given.drive.parts, run.parts);
        let ports = |run: &Self| run.forces.iter().map(|(port, _)| *port).chain(run.pushed()).collect::<Vec<_>>();
        let unchanged = self.changed.is_none() && other.changed.is_none();
        steps(self) == steps(other)
            && ports(self) == ports(other)
            && self.forces.len() == other.forces.len()
            && (unchanged || std::ptr::eq(self.run.actions, other.run.actions))
            && self.factors == other.factors
    }
}

/// Returns the factor on the stiffness for every `drift` samples of a run; empty if the stiffness does not change.
fn factors(run: &Run, drift: usize, rate: f64) -> Vec<f64> {
    let stiffness = || run.actions.iter().filter_map(|a| if let Action::Stiffness(of) = a { Some(of) } else { None });
    if stiffness().next().is_none() {
        return Vec::new();
    }
    let middle = |k: usize| run.t0 + (k as f64 + 0.5) * drift as f64 / rate;
    let factor = |k: usize| stiffness().map(|of| of(middle(k))).product();
    (0..run.u.first().map_or(0, Vec::len).div_ceil(drift)).map(factor).collect()
}

/// Returns the effects of a run that act between a controller and its plant.
fn between<'r>(plant: &Plant, run: &Run<'r>) -> Between<'r> {
    Between::new(run.actions, [plant.m, plant.p], plant.rate, run.t0, run.start.is_none())
}

/// Advances runs that are alike. Returns the outputs of each run, and the number of parts of a sample that it needs
/// for its motion.
fn advanced<const R: usize>(runs: [&Applied<'_>; R], plant: &Plant, fineness: Fineness) -> Vec<(Channels, usize)> {
    let first = runs[0];
    let plant = first.changed.as_ref().unwrap_or(plant);
    let pushed: Vec<usize> = first.pushed().collect();
    let laws = runs.map(|run| run.forces.as_slice());
    let between = runs.map(|run| between(plant, &run.run));
    let mut runner = Runner::new(plant, (first.given.drive.parts, first.parts), laws, &pushed, between);
    for (number, run) in runs.iter().enumerate() {
        if let Some(start) = &run.start {
            runner.start(number, start);
        }
    }
    let mut outputs = runs.map(|run| vec![vec![0.0; run.samples()]; plant.p]);
    advance(&mut runner, plant, &runs.map(|run| &run.given), &first.factors, fineness.drift, &mut outputs);
    for (y, run) in outputs.iter_mut().zip(runs) {
        run.moved.iter().for_each(|&(port, law)| on_a_given_motion(&plant.ports[port], law, &run.given.drive, y));
    }
    let needed = |(number, y): (usize, Channels)| {
        let at_port = |(&(port, law), most): (&(usize, &dyn Force), _)| parts_at(plant, port, law, most);
        (y, runs[number].forces.iter().zip(runner.most(number)).map(at_port).max().unwrap_or(1))
    };
    outputs.into_iter().enumerate().map(needed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Command, CubicStiffness, Effect, Library, Place, Setting};
    use crate::plant::Mode;
    use crate::testing;
    use plid_fourier::C;

    /// Two values of the command that are held for a quarter of a sample each.
    struct Quarters;

    impl Command for Quarters {
        fn apply(&self, drive: &mut Drive, _memory: &mut Memory) {
            drive.refine(4);
            (drive.u[0][9], drive.u[0][11]) = (1.0, -2.0);
        }
    }

    /// A spring without stiffness, whose force requires further parts.
    struct NoSpring;

    impl Force for NoSpring {
        fn force(&self, d: f64, _v: f64, _state: &[f64]) -> f64 {
            0.0 * d
        }
    }

    /// Values within a sample act on each mode for their quarter of the sample, in agreement with the closed form,
    /// with and without the parts of a force, and in one block of a sample and in several.
    #[test]
    fn values_act_for_their_part_of_a_sample() {
        let plant = Plant::new(&testing::truss(1)).unwrap();
        let (a, b) = plant.rest.continuous.as_ref().unwrap();
        let inverse = a.clone().try_inverse().unwrap();
        let u = vec![vec![0.0; 40]; 2];
        let quarter = 0.25 / plant.rate;
        // Returns the output at time t after the end of a unit that was held for a quarter of a sample.
        let after = |o: usize, t: f64| -> f64 {
            let by_mode = |mode: &Mode| {
                let held = ((mode.pole * (t + quarter)).exp() - (mode.pole * t).exp()) / mode.pole;
                2.0 * (mode.c[o] * held * mode.b[0]).re
            };
            let held = plid_model::exponential(&(a * (t + quarter))) - plid_model::exponential(&(a * t));
            let by_rest = plant.rest.c.row(o) * &inverse * held * b.column(0);
            plant.modes.iter().map(by_mode).sum::<f64>() + by_rest[0]
        };
        let expected = |o: usize, sample: usize| {
            let since = |value: f64| (sample as f64 - value / 4.0) / plant.rate;
            after(o, since(10.0)) - 2.0 * after(o, since(12.0))
        };
        for force in [0, 1, 2, 4] {
            let mut actions = vec![Action::Command(Box::new(Quarters))];
            if force > 0 {
                actions.push(Action::Force(0, Box::new(NoSpring)));
            }
            let fineness = Fineness { force: 4 * force.max(1), drift: 16 };
            let y = before_sensors(&plant, &[Run { actions: &actions, u: &u, t0: 0.0, start: None }], fineness);
            let size = (3..40).map(|k| expected(0, k).abs()).fold(0.0, f64::max);
            for (o, k) in (0..2).flat_map(|o| (0..40).map(move |k| (o, k))) {
                let expected = if k < 3 { 0.0 } else { expected(o, k) };
                assert!((y[0][o][k] - expected).abs() < 1e-9 * size, "{force}: {} for {expected}", y[0][o][k]);
            }
        }
    }

    /// For each effect at each of its places, runs with several of its shapes, over records of several lengths that
    /// do not all begin at rest, have bitwise the same outputs together as alone.
    #[test]
    fn together_as_alone() {
        let model = testing::truss(1);
        let plant = Plant::new(&model).unwrap();
        let setting = Setting::bare(&plant, &model);
        let records: Vec<Channels> =
            [40, 60, 60, 60, 60].iter().zip(1..).map(|(&n, k)| testing::random_input(k, n, 2)).collect();
        let mut begun = State::rest(&plant);
        begun.modes.iter_mut().for_each(|z| *z = C::new(1e-3, -2e-3));
        let library = Library::standard();
        let mut forced = 0;
        for effect in library.effects() {
            for place in effect.places(&setting) {
                let starts = effect.starts(&setting, &place);
                let sets: Vec<_> = starts.iter().map(|start| effect.act(&setting, &place, start)).collect();
                let runs: Vec<Run> = (sets.iter())
                    .flat_map(|actions| records.iter().zip(0_u8..).map(move |(u, k)| (actions, u, k)))
                    .map(|(actions, u, k)| Run { actions, u, t0: f64::from(k), start: (k % 2 == 1).then_some(&begun) })
                    .collect();
                forced += sets.iter().flatten().filter(|action| matches!(action, Action::Force(..))).count();
                let bits = |y: Channels| y.into_iter().flatten().map(f64::to_bits).collect::<Vec<u64>>();
                let alone = runs.iter().flat_map(|run| before_sensors(&plant, &[*run], Fineness::FINE)).map(bits);
                let together = before_sensors(&plant, &runs, Fineness::FINE).into_iter().map(bits);
                assert!(together.eq(alone), "{} at {place:?}", effect.name());
            }
        }
        assert!(forced > 20, "{forced} forces");
    }

    /// A run whose motion makes its law stiff is bitwise the run with finer steps; another run is not refined.
    #[test]
    fn a_large_motion_takes_finer_steps() {
        let model = testing::truss(2);
        let plant = Plant::new(&model).unwrap();
        let setting = crate::prepare::tests::setting_of(&plant, &model);
        let u = testing::random_input(5, 300, 2);
        let place = Place::Input(0);
        // A spring on which the port's oscillation would advance by half a radian in a sample, at the motion of the
        // port without the spring.
        let d = crate::case::record::rms(&crate::prepare::port_motion(&plant, &u)[0]);
        let stiff = (0.5 * plant.rate).powi(2) / plant.mobility(0) / d.powi(2);
        let cubic = |k: f64| CubicStiffness.act(&setting, &place, &[k]);
        let run = |actions: &[Action], force: usize| {
            let run = Run { actions, u: &u, t0: 0.0, start: None };
            before_sensors(&plant, &[run], Fineness { force, drift: 16 }).swap_remove(0)
        };
        let (weak, strong) = (cubic(1e-4 * stiff), cubic(10.0 * stiff));
        let parts = |actions: &[Action], force: usize| {
            let run = Run { actions, u: &u, t0: 0.0, start: None };
            stepped(&plant, &[run], Fineness { force, drift: 16 }).1[0]
        };
        assert!(parts(&weak, 8) <= 8, "{}", parts(&weak, 8));
        let needed = parts(&strong, 8);
        assert!(needed > 8, "{needed}");
        assert!(run(&strong, 8) == run(&strong, needed));
        assert!(run(&weak, 8) != run(&weak, needed));
    }
}
