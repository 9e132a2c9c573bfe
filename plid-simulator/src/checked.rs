use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::{Channels, Description, Failure, Instance, Motion, Simulator, SimulatorError};

/// The number of runs of a simulator and their time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Calls {
    /// Number of runs, including those step by step.
    pub runs: usize,
    /// Total time of these runs.
    pub time: Duration,
}

/// A simulator whose answers are checked and whose calls are counted.
pub struct Checked<'a> {
    /// The simulator that was given, and independent instances of it.
    instances: Vec<Instance<'a>>,
    description: Arc<Description>,
    calls: Calls,
}

impl<'a> Checked<'a> {
    /// Wraps a simulator.
    ///
    /// # Errors
    /// Returns [`SimulatorError::Description`] if the simulator's description is inconsistent.
    pub fn new(simulator: &'a mut dyn Simulator) -> Result<Self, SimulatorError> {
        let description = Arc::new(simulator.description().clone());
        description.check()?;
        let instances = vec![Instance::new(Box::new(simulator), Arc::clone(&description))];
        Ok(Self { instances, description, calls: Calls::default() })
    }

    /// Wraps a simulator with up to this number of instances of it, itself included.
    ///
    /// # Errors
    /// Returns the errors of [`Checked::new`] and of [`Simulator::another`].
    pub fn side_by_side(simulator: &'a mut dyn Simulator, instances: usize) -> Result<Self, SimulatorError> {
        let mut checked = Self::new(simulator)?;
        while checked.instances.len() < instances {
            let Some(another) = checked.simulator().another()? else { break };
            checked.instances.push(Instance::new(another, Arc::clone(&checked.description)));
        }
        Ok(checked)
    }

    /// Returns the description of the simulator.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Returns the number of calls so far and their time.
    pub fn calls(&self) -> Calls {
        self.calls
    }

    /// Returns the number of runs that can go side by side.
    pub fn instances(&self) -> usize {
        self.instances.len()
    }

    /// Returns the simulator that was given.
    pub(crate) fn simulator(&mut self) -> &mut (dyn Simulator + 'a) {
        self.instances[0].simulator()
    }

    /// Runs from rest; see [`Simulator::run`].
    ///
    /// # Errors
    /// Returns [`SimulatorError::Call`] with the number of the run and its failure.
    pub fn run(&mut self, parameters: &[f64], u: &[Vec<f64>]) -> Result<Channels, SimulatorError> {
        self.one(|instance| instance.run(parameters, u))
    }

    /// Runs from rest, step by step; see [`Instance::run_with`].
    ///
    /// # Errors
    /// Returns [`SimulatorError::Call`] with the number of the run, the sample and the failure.
    pub fn run_with(
        &mut self,
        parameters: &[f64],
        u: &[Vec<f64>],
        force: impl FnMut(usize, &[Motion], &mut [f64]),
    ) -> Result<Channels, SimulatorError> {
        self.one(|instance| instance.run_with(parameters, u, force))
    }

    /// Carries out runs, side by side if there are several instances. The results are those of the runs in order, and
    /// do not depend on the number of instances.
    pub fn all<R>(&mut self, runs: &[R]) -> Vec<Result<Channels, SimulatorError>>
    where
        R: Fn(&mut Instance<'a>) -> Result<Channels, Failure> + Sync,
    {
        let done = match &mut self.instances[..] {
            [one] => runs.iter().map(|run| timed(run, one)).collect(),
            several => shared_out(several, runs),
        };
        done.into_iter().map(|(result, time)| self.counted(result, time)).collect()
    }

    fn one(
        &mut self,
        run: impl FnOnce(&mut Instance<'a>) -> Result<Channels, Failure>,
    ) -> Result<Channels, SimulatorError> {
        let (result, time) = timed(run, &mut self.instances[0]);
        self.counted(result, time)
    }

    /// Counts a run and names it in its failure.
    fn counted(&mut self, result: Result<Channels, Failure>, time: Duration) -> Result<Channels, SimulatorError> {
        self.calls.runs += 1;
        self.calls.time += time;
        result.map_err(|Failure { sample, source }| {
            let at = sample.map(|sample| format!(", sample {sample}")).unwrap_or_default();
            let call = format!("run {} of simulator {:?}{at}", self.calls.runs, self.description.name);
            SimulatorError::Call { call, source: Box::new(source) }
        })
    }
}

/// The result of a run and its time.
type Timed = (Result<Channels, Failure>, Duration);

fn timed<'a>(run: impl FnOnce(&mut Instance<'a>) -> Result<Channels, Failure>, instance: &mut Instance<'a>) -> Timed {
    let began = Instant::now();
    (run(instance), began.elapsed())
}

/// Carries out runs on several instances. Each instance takes the next run when it is free.
fn shared_out<'a, R>(instances: &mut [Instance<'a>], runs: &[R]) -> Vec<Timed>
where
    R: Fn(&mut Instance<'a>) -> Result<Channels, Failure> + Sync,
{
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<(usize, Timed)>> = Mutex::new(Vec::with_capacity(runs.len()));
    let work = |instance: &mut Instance<'a>| {
        while let Some((at, run)) = Some(next.fetch_add(1, Ordering::Relaxed)).and_then(|at| Some((at, runs.get(at)?)))
        {
            let result = timed(run, instance);
            done.lock().unwrap_or_else(PoisonError::into_inner).push((at, result));
        }
    };
    thread::scope(|scope| {
        for instance in instances.iter_mut().take(runs.len()) {
            scope.spawn(|| work(instance));
        }
    });
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_by_key(|(at, _)| *at);
    done.into_iter().map(|(_, timed)| timed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Function, Input, Output};

    fn description() -> Description {
        Description::new("sim", 10.0, vec![Input::new("u")], vec![Output::new("a"), Output::new("b")])
    }

    /// Returns the message of the second run of a simulator that answers with these outputs.
    fn refused(answer: Channels) -> String {
        let sound = vec![vec![0.0; 3]; 2];
        let mut again = false;
        let mut simulator = Function::new(description(), |_: &[f64], _: &[Vec<f64>]| {
            Ok(if std::mem::replace(&mut again, true) { answer.clone() } else { sound.clone() })
        });
        let mut checked = Checked::new(&mut simulator).unwrap();
        let u = vec![vec![1.0; 3]];
        checked.run(&[], &u).unwrap();
        checked.run(&[], &u).unwrap_err().to_string()
    }

    #[test]
    fn a_wrong_answer_names_the_call() {
        let missing = refused(vec![vec![0.0; 3]]);
        assert_eq!(
            missing,
            "run 2 of simulator \"sim\": the simulator returned 1 outputs, expected 2 outputs of 3 samples"
        );
        let short = refused(vec![vec![0.0; 3], vec![0.0; 2]]);
        assert!(short.contains("2 samples of output \"b\""), "{short}");
        let unsound = refused(vec![vec![0.0; 3], vec![0.0, f64::NAN, 0.0]]);
        assert!(unsound.ends_with("NaN for output \"b\" at sample 1"), "{unsound}");
    }

    /// Runs on three instances give the same numbers in the same order as on one, and a failure names its run.
    #[test]
    fn runs_side_by_side_are_those_of_one_instance() {
        let mut simulator = Function::new(description(), |_: &[f64], u: &[Vec<f64>]| {
            thread::sleep(Duration::from_millis(if u[0][0] == 1.0 { 20 } else { 1 }));
            let y: Vec<f64> = u[0].iter().map(|u| 1.0 / u).collect();
            Ok(vec![y.clone(), y])
        })
        .side_by_side();
        let inputs: Vec<Channels> = (0..7).map(|k| vec![vec![1.0 + f64::from(k) * 0.1, f64::from(3 - k)]]).collect();
        let runs: Vec<_> = inputs.iter().map(|u| |instance: &mut Instance| instance.run(&[], u)).collect();
        let mut answers = [1, 3].map(|instances| {
            let mut checked = Checked::side_by_side(&mut simulator, instances).unwrap();
            assert_eq!(checked.instances(), instances);
            let all = checked.all(&runs);
            assert_eq!(checked.calls().runs, 7);
            all
        });
        let failed = answers[1][3].clone().unwrap_err().to_string();
        assert!(failed.starts_with("run 4 of simulator \"sim\": ") && failed.contains("inf"), "{failed}");
        answers.iter_mut().for_each(|all| drop(all.remove(3)));
        assert_eq!(answers[0], answers[1]);
    }

    #[test]
    fn a_description_that_contradicts_itself_is_refused() {
        let faulty = |change: &dyn Fn(&mut Description)| {
            let mut description = description();
            change(&mut description);
            description.check().unwrap_err().to_string()
        };
        assert!(faulty(&|d| d.rate_hz = 0.0).contains("rate_hz"));
        assert!(faulty(&|d| d.outputs[1].name = "a".into()).contains("\"a\" is not unique"));
        assert!(faulty(&|d| d.ports.push(crate::Port::new("joint"))).contains("steps_per_sample"));
        let outside = crate::Parameter { upper: Some(1.0), ..crate::Parameter::new("k", 2.0) };
        assert!(faulty(&|d| d.parameters.push(outside.clone())).contains("2 is not within -inf to 1"));
    }
}
