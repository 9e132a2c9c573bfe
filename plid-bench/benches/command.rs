//! A step of a simulator in the process, and of the same simulator as a program: what the pipe costs. The limit is two
//! switches between processes.
//!
//!     cargo bench -p plid-bench --bench command

use std::io;
use std::path::Path;

use criterion::Criterion;
use plid_simulator::{Command, Description, Input, Motion, Output, Port, Simulator, SimulatorError, serve};

/// The argument that makes this program the simulator.
const SERVE: &str = "serve-the-oscillator";

/// A mass on a spring, by the symplectic method of Euler.
struct Oscillator {
    description: Description,
    x: f64,
    v: f64,
}

impl Oscillator {
    fn new() -> Self {
        let mut description = Description::new("oscillator", 100.0, vec![Input::new("u")], vec![Output::new("y")]);
        description.steps_per_sample = 10;
        description.ports = vec![Port::new("spring")];
        Self { description, x: 0.0, v: 0.0 }
    }
}

impl Simulator for Oscillator {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, _parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
        (self.x, self.v) = (0.0, 0.0);
        Ok(vec![Motion::default()])
    }

    fn step(&mut self, u: &[f64], forces: &[f64], y: &mut [f64], at: &mut [Motion]) -> Result<(), SimulatorError> {
        y[0] = self.x;
        self.v += 1e-3 * (u[0] + forces[0] - 4.0 * self.v - 800.0 * self.x) / 2.0;
        self.x += 1e-3 * self.v;
        at[0] = Motion { displacement: self.x, velocity: self.v };
        Ok(())
    }
}

fn steps(criterion: &mut Criterion, name: &str, simulator: &mut dyn Simulator) {
    let (mut y, mut motions) = ([0.0], [Motion::default()]);
    simulator.start(&[]).expect("it starts");
    criterion.benchmark_group("step").bench_function(name, |bench| {
        bench.iter(|| simulator.step(&[1.0], &[0.5], &mut y, &mut motions).expect("it steps"));
    });
}

fn main() {
    if std::env::args().any(|argument| argument == SERVE) {
        serve(&mut Oscillator::new(), io::stdin().lock(), io::stdout().lock()).expect("plid listens");
        return;
    }
    let mut criterion = Criterion::default().configure_from_args();
    steps(&mut criterion, "in the process", &mut Oscillator::new());
    let program = std::env::current_exe().expect("a program").to_string_lossy().into_owned();
    let command = [program, SERVE.to_string()];
    let mut program = Command::start(&command, Path::new("."), Command::PATIENCE).expect("it starts");
    steps(&mut criterion, "a program", &mut program);
    criterion.final_summary();
}
