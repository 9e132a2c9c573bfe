use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use plid::fmu::{ChosenParameter, Fmu, Options};
use plid::gap::GapError;
use plid::gap::case::FmuSource;
use plid::simulator::{Command, Description, PortVariables, own_output, refuse, serve};

use super::Failure;

/// Serve an FMU as a simulator.
///
/// Uses the protocol of docs/simulator-protocol.md on standard input and output. Diagnoses, predictions and `plid gap
/// check-simulator` run each FMU in this command, so that a crash or hang affects only the child process. Other
/// programs may use it in the same way.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  plid gap serve-fmu model.fmu --rate 200 --parameter mass \\\n    \
                        --port joint=torque,angle,speed")]
pub struct Arguments {
    /// The FMU, for co-simulation by FMI 2.0 or 3.0.
    #[arg(value_name = "MODEL.fmu")]
    file: PathBuf,
    #[command(flatten)]
    choice: Choice,
}

/// The options for an FMU.
#[derive(clap::Args, Default)]
pub struct Choice {
    /// Samples per second [default: one sample for each step of the FMU's default experiment].
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// A parameter of the FMU that may be wrong. May be repeated.
    #[arg(long, value_name = "NAME")]
    parameter: Vec<String>,
    /// A place that takes a force: an input of the FMU, and the variables that show its displacement and velocity. May
    /// be repeated.
    #[arg(long, value_name = "NAME=FORCE,DISPLACEMENT,VELOCITY")]
    port: Vec<PortVariables>,
    /// FMU steps per sample [default: 1, or with ports the number in the FMU's default experiment].
    #[arg(long, value_name = "N")]
    steps_per_sample: Option<usize>,
    /// An input. May be repeated [default: all real inputs except those that only take the force of a port].
    #[arg(long, value_name = "NAME")]
    input: Vec<String>,
    /// An output. May be repeated [default: all real outputs].
    #[arg(long, value_name = "NAME")]
    output: Vec<String>,
}

impl Choice {
    /// Returns whether no option is given.
    pub fn is_empty(&self) -> bool {
        let Self { rate, parameter, port, steps_per_sample, input, output } = self;
        let lists = [parameter.is_empty(), port.is_empty(), input.is_empty(), output.is_empty()];
        rate.is_none() && steps_per_sample.is_none() && lists.into_iter().all(|empty| empty)
    }

    /// Returns the options of a case.
    pub fn of_case(source: &FmuSource, rate_hz: f64, parameters: &[String], steps: Option<usize>) -> Self {
        Self {
            rate: Some(rate_hz),
            parameter: parameters.to_vec(),
            port: source.ports.clone(),
            steps_per_sample: steps,
            ..Self::default()
        }
    }

    /// Returns the options with these channels.
    pub fn channels<'n>(
        self,
        inputs: impl IntoIterator<Item = &'n String>,
        outputs: impl IntoIterator<Item = &'n String>,
    ) -> Self {
        let named = |names: Vec<&String>| names.into_iter().cloned().collect();
        let (inputs, outputs) = (inputs.into_iter().collect(), outputs.into_iter().collect());
        Self { input: named(inputs), output: named(outputs), ..self }
    }

    /// Returns the options for a diagnosed FMU.
    pub fn again(source: &FmuSource, diagnosed: &Description) -> Self {
        let parameters: Vec<String> = diagnosed.parameters.iter().map(|parameter| parameter.name.clone()).collect();
        let inputs = diagnosed.inputs.iter().map(|input| &input.name);
        let outputs = diagnosed.outputs.iter().map(|output| &output.name);
        Self::of_case(source, diagnosed.rate_hz, &parameters, Some(diagnosed.steps_per_sample))
            .channels(inputs, outputs)
    }

    fn options(&self) -> Options {
        let Self { rate, parameter, port, steps_per_sample, input, output } = self;
        let chosen = |names: &[String]| (!names.is_empty()).then(|| names.to_vec());
        Options {
            rate_hz: *rate,
            steps_per_sample: *steps_per_sample,
            inputs: chosen(input),
            outputs: chosen(output),
            parameters: parameter.iter().map(ChosenParameter::new).collect(),
            ports: port.clone(),
        }
    }

    /// Returns the command that serves an FMU.
    fn command(&self, file: &Path) -> io::Result<Vec<String>> {
        let Self { rate, parameter, port, steps_per_sample, input, output } = self;
        let program = std::env::current_exe()?;
        let mut command: Vec<String> = vec![program.to_string_lossy().into(), "gap".into(), "serve-fmu".into()];
        // A separate value may begin with a dash.
        let mut add = |key: &str, value: String| command.push(format!("--{key}={value}"));
        rate.iter().for_each(|rate| add("rate", rate.to_string()));
        steps_per_sample.iter().for_each(|steps| add("steps-per-sample", steps.to_string()));
        for (key, names) in [("parameter", parameter), ("input", input), ("output", output)] {
            names.iter().for_each(|name| add(key, name.clone()));
        }
        for PortVariables { name, force, displacement, velocity } in port {
            add("port", format!("{name}={force},{displacement},{velocity}"));
        }
        command.extend(["--".into(), file.to_string_lossy().into()]);
        Ok(command)
    }

    /// Starts a child process that serves an FMU.
    pub fn start(&self, file: &Path, folder: &Path, patience: Duration) -> Result<Command, GapError> {
        let source = |source| GapError::Io { file: file.into(), source };
        Ok(Command::start(&self.command(file).map_err(source)?, folder, patience)?)
    }
}

/// Runs the command.
pub fn execute(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { file, choice } = arguments;
    let output = own_output().map_err(Failure::work)?;
    // What an FMU prints goes to standard error.
    #[cfg(unix)]
    rustix::stdio::dup2_stdout(io::stderr()).map_err(|error| Failure::work(io::Error::from(error)))?;
    let mut fmu = match Fmu::open(file, &choice.options()) {
        Ok(fmu) => fmu,
        Err(error) => {
            refuse(output, &error.to_string()).map_err(Failure::work)?;
            return Err(Failure::input(error));
        }
    };
    serve(&mut fmu, io::stdin().lock(), output).map_err(Failure::work)
}
