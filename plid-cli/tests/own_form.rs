//! A covariance form of another crate in the program: `main` of four lines, an experiment and a study that name the form.
//!
//! Started without arguments this is the test, which starts itself again as the program.

// ANCHOR: main
use std::process::ExitCode;

use plid::catalogue::{Entry, forms};

fn program() -> ExitCode {
    forms! { "own" = Own; }.add();
    plid_cli::main()
}
// ANCHOR_END: main

use std::path::Path;
use std::process::{Command, Output};

use plid::covariance::Direct;
use plid::kernels::BadPivot;
use plid::{
    Backend, Checkpointed, CovariancePropagation, Dense, Form, FormFacts, ImplicitModel, InitialCovariance, Inspect,
    NoiseTerms, Scalar, Transition, ViewMut,
};

/// The direct form, from outside.
struct Own<B: Backend>(Direct<B>);

impl<B: Backend> CovariancePropagation for Own<B> {
    type Scalar = B::Scalar;
    type Options = ();

    fn new(model: &dyn ImplicitModel, initial: &InitialCovariance, _: &()) -> Result<Self, BadPivot> {
        Ok(Self(Direct::new(model, initial, &())?))
    }
    fn output_columns(&self, rows: &[usize], out: ViewMut<'_, B::Scalar>) {
        self.0.output_columns(rows, out);
    }
    fn add_parameter_blocks(&mut self, weights: &Dense<B::Scalar>, out: ViewMut<'_, B::Scalar>) {
        self.0.add_parameter_blocks(weights, out);
    }
    fn measurement_update(
        &mut self,
        rows: &[usize],
        noise: &NoiseTerms<B::Scalar>,
        innovation: &[B::Scalar],
        s: &mut [B::Scalar],
    ) -> Result<(), BadPivot> {
        self.0.measurement_update(rows, noise, innovation, s)
    }
    fn time_update(&mut self, model: &dyn ImplicitModel, transition: &Transition<B::Scalar>) -> Result<(), BadPivot> {
        self.0.time_update(model, transition)
    }
}

impl<B: Backend> Inspect for Own<B> {
    fn dense_in<T: Scalar>(&self) -> Dense<T> {
        self.0.dense_in()
    }
}

impl<B: Backend> Checkpointed for Own<B> {
    fn state(&self) -> Vec<B::Scalar> {
        self.0.state()
    }
    fn restore(&mut self, state: &[B::Scalar]) -> bool {
        self.0.restore(state)
    }
}

impl<B: Backend> Form for Own<B> {
    const FACTS: FormFacts = Direct::<B>::FACTS;
}

fn main() -> ExitCode {
    // The test runner passes its own options, and no command.
    if std::env::args().nth(1).is_some_and(|argument| !argument.starts_with('-')) {
        return program();
    }
    let directory = tempfile::tempdir().unwrap();
    an_experiment_names_the_form(directory.path());
    a_study_names_the_form(directory.path());
    println!("test result: ok. An experiment and a study named the form.");
    ExitCode::SUCCESS
}

fn run(at: &Path, arguments: &[&str]) -> Output {
    let program = std::env::current_exe().unwrap();
    Command::new(program).current_dir(at).args(arguments).output().expect("the program starts")
}

fn read(at: &Path, file: &str) -> String {
    std::fs::read_to_string(at.join(file)).unwrap_or_else(|e| panic!("{file}: {e}"))
}

/// The same experiment with this form and with the direct one gives the same model.
fn an_experiment_names_the_form(at: &Path) {
    for form in ["own", "direct", "unknown"] {
        let experiment = format!(
            "[data.testbed.truss]\nduration_s = 2.0\n[structure]\nstates = 12\n[noise]\nfrom = \"paper-squared\"\n\
             [identification]\nrefine = \"off\"\n[variant]\ncovariance = \"{form}\"\n"
        );
        std::fs::write(at.join(format!("{form}.toml")), experiment).unwrap();
        let output = run(at, &["run", &format!("{form}.toml"), "--out", form]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.success(), form != "unknown", "{form}: {said}");
        assert!(form != "unknown" || said.contains("`own`"), "the message lists the form: {said}");
    }
    let matrix_of = |form: &str| {
        let model: serde_json::Value = serde_json::from_str(&read(at, &format!("{form}/model.json"))).unwrap();
        model["A"].to_string()
    };
    assert_eq!(matrix_of("own"), matrix_of("direct"));
    assert!(read(at, "own/manifest.json").contains("\"own\""), "the manifest names the form");
}

/// A speed study of one cell.
fn a_study_names_the_form(at: &Path) {
    let config = "rounds = 1\nvisit_ms = 0.0\nsteps = 10\nwarm_up = 2\n\
                  [[cross]]\nstates = [6]\ncovariance = [\"own\"]\nexpectations = [\"joint-ekf\"]\n";
    std::fs::write(at.join("speed.toml"), config).unwrap();
    let output = run(at, &["bench", "speed", "speed.toml", "--out", "speed"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(read(at, "speed/speed.json").contains("\"own\""), "the study names the form");
}
