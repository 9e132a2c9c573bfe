//! Instructions of a step, counted by valgrind: a noise-free measure. It needs valgrind, and gungraun's runner of the
//! version in Cargo.lock; without them it prints a message and exits.
//!
//!     cargo install gungraun-runner --version 0.20.0
//!     cargo bench -p plid-bench --bench instructions
//!
//! Valgrind does not support AVX-512, so the kernels' AVX2 code is counted, whatever the CPU has.

// What the macros make has no documentation.
#![allow(missing_docs)]

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

// Gives the recursion back, so that its end is not counted.
#[library_benchmark]
#[bench::direct_moment_matched_12(args = (12, CovarianceName::Direct, ExpectationName::MomentMatched), setup = begun)]
#[bench::direct_moment_matched_64(args = (64, CovarianceName::Direct, ExpectationName::MomentMatched), setup = begun)]
#[bench::direct_joint_ekf_64(args = (64, CovarianceName::Direct, ExpectationName::JointEkf), setup = begun)]
#[bench::joseph_moment_matched_12(args = (12, CovarianceName::Joseph, ExpectationName::MomentMatched), setup = begun)]
#[bench::joseph_moment_matched_64(args = (64, CovarianceName::Joseph, ExpectationName::MomentMatched), setup = begun)]
#[bench::joseph_joint_ekf_64(args = (64, CovarianceName::Joseph, ExpectationName::JointEkf), setup = begun)]
#[bench::bierman_ud_moment_matched_12(args = (12, CovarianceName::BiermanUd, ExpectationName::MomentMatched),
    setup = begun)]
#[bench::bierman_ud_moment_matched_64(args = (64, CovarianceName::BiermanUd, ExpectationName::MomentMatched),
    setup = begun)]
#[bench::bierman_ud_joint_ekf_64(args = (64, CovarianceName::BiermanUd, ExpectationName::JointEkf), setup = begun)]
#[bench::array_sqrt_moment_matched_12(args = (12, CovarianceName::ArraySqrt, ExpectationName::MomentMatched),
    setup = begun)]
#[bench::array_sqrt_moment_matched_64(args = (64, CovarianceName::ArraySqrt, ExpectationName::MomentMatched),
    setup = begun)]
#[bench::array_sqrt_joint_ekf_64(args = (64, CovarianceName::ArraySqrt, ExpectationName::JointEkf), setup = begun)]
fn step(mut steps: Loop<'static>) -> Loop<'static> {
    steps.step().expect("the workload keeps every variant sound");
    steps
}

library_benchmark_group!(name = steps, benchmarks = step);

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
