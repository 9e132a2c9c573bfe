//! Instructions of a step, counted by valgrind: a noise-free measure. It needs valgrind, and gungraun's runner of the
//! version in Cargo.lock; without them it prints a message and exits.
//!
//!     cargo install gungraun-runner --version 0.20.0
//!     cargo bench -p plid-bench --bench instructions
//!
//! Valgrind does not support AVX-512, so the kernels' AVX2 code is counted, whatever the CPU has.

// What the macros make has no documentation, and the names of types.
#![allow(missing_docs, non_snake_case)]

use std::process::{Command, Stdio};

use gungraun::{library_benchmark, library_benchmark_group};
use plid_bench::speed::Cell;
use plid_bench::{Loop, Record, Workload};
use plid_catalogue::{CovarianceName, ExpectationName};

/// A recursion on the truss (3 x 3, f64) that has taken its first steps, after which P is full.
fn begun(states: usize, covariance: CovarianceName, expectations: ExpectationName) -> Loop<'static> {
    let record = Box::leak(Box::new(Record::truss(3, 0.01).expect("the default truss can be simulated")));
    let cell = Cell::plain(states, covariance, expectations);
    let workload = Workload::new(record, states, cell.noise).expect("enough states");
    let mut steps = workload.recursion(cell.variant).expect("a variant that exists");
    for _ in 0..3 {
        steps.step().expect("the workload keeps every variant sound");
    }
    steps
}

/// Benches of every form, each under the form's name. A bench gives the recursion back, so that its end is not counted.
macro_rules! steps {
    ($($(#[$doc:meta])* $word:literal = $form:ident;)*) => {
        $(
            #[library_benchmark]
            #[bench::moment_matched_12(args = (12, CovarianceName::$form, ExpectationName::MomentMatched),
                setup = begun)]
            #[bench::moment_matched_64(args = (64, CovarianceName::$form, ExpectationName::MomentMatched),
                setup = begun)]
            #[bench::joint_ekf_64(args = (64, CovarianceName::$form, ExpectationName::JointEkf), setup = begun)]
            fn $form(mut steps: Loop<'static>) -> Loop<'static> {
                steps.step().expect("the workload keeps every variant sound");
                steps
            }
        )*

        library_benchmark_group!(name = steps, benchmarks = [$($form),*]);
    };
}

plid_variants::every_form!(steps);

/// Whether a program can be started.
fn is_there(program: &str) -> bool {
    let quiet = Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    quiet.is_ok()
}

fn main() {
    // The runner starts this program again, under valgrind.
    let is_counted = std::env::args().any(|argument| argument == "--gungraun-run");
    if !is_counted {
        for (program, help) in
            [("valgrind", "install it"), ("gungraun-runner", "cargo install gungraun-runner --version 0.20.0")]
        {
            if !is_there(program) {
                eprintln!("instructions are not counted: there is no {program} ({help})");
                return;
            }
        }
    }
    gungraun::main!(library_benchmark_groups = steps);
    main();
}
