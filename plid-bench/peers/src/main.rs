//! The joint filter of plid in other people's Kalman filters, and in plid itself.
//!
//!     plid-peers export DIRECTORY STATES          the truss's record and what filters start from
//!     plid-peers serve DIRECTORY STATES STEPS NAME
//!
//! `serve` takes STEPS samples, writes NAME.s.npy and NAME.p.npy, answers "ready", and then times as many further
//! samples as each line of standard input says. compare.py drives it.

mod crates;
mod joint;
mod peer;
mod workload;

use std::path::Path;

use adskalman::CovarianceUpdateMethod as Method;
use plid_backends::Plain;
use plid_variants::covariance::{ArraySqrt, BiermanUd, Direct, Joseph};

use crate::crates::{
    Adskalman, BayesCovariance, BayesUd, KalmanFilters, Kalmanfilt, Kfilter, Minikalman, Multicalc, Numeris, Plid,
};
use crate::peer::{Failure, serve};
use crate::workload::Case;

/// Crates with fixed sizes hold and pass matrices by value; 448 x 448 numbers are 1.6 MB.
const STACK: usize = 1 << 30;

fn main() -> Result<(), Failure> {
    let run = || run().map_err(|error| error.to_string());
    let result = std::thread::Builder::new().stack_size(STACK).spawn(run)?.join();
    Ok(result.map_err(|_| "the thread of the filter panicked")??)
}

fn run() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["export", directory, states] => Case::truss(states.parse()?)?.export(Path::new(directory)),
        ["serve", directory, states, steps, name] => {
            let case = Case::truss(states.parse()?)?;
            choose(&case, steps.parse()?, Path::new(directory), name)
        }
        _ => Err("usage: plid-peers export DIRECTORY STATES | serve DIRECTORY STATES STEPS NAME".into()),
    }
}

/// Sizes at run time.
fn choose(case: &Case, steps: usize, directory: &Path, name: &str) -> Result<(), Failure> {
    match name {
        "plid direct" => serve(Plid::<Direct<Plain<f64>>>::new(case)?, case, steps, directory, name),
        "plid joseph" => serve(Plid::<Joseph<Plain<f64>>>::new(case)?, case, steps, directory, name),
        "plid bierman-ud" => serve(Plid::<BiermanUd<Plain<f64>>>::new(case)?, case, steps, directory, name),
        "plid array-sqrt" => serve(Plid::<ArraySqrt<Plain<f64>>>::new(case)?, case, steps, directory, name),
        "bayes_estimate" => serve(BayesCovariance::new(case), case, steps, directory, name),
        "bayes_estimate UD" => serve(BayesUd::new(case), case, steps, directory, name),
        "kalman_filters" => serve(KalmanFilters::new(case)?, case, steps, directory, name),
        // The joint states of 12, 30 and 64 states with 3 inputs and 3 outputs.
        _ => match case.joint {
            84 => choose_fixed::<84>(case, steps, directory, name),
            210 => choose_fixed::<210>(case, steps, directory, name),
            448 => choose_fixed::<448>(case, steps, directory, name),
            joint => Err(format!("{name} is not built for {joint} joint states").into()),
        },
    }
}

/// Sizes fixed when the program was built.
fn choose_fixed<const N: usize>(case: &Case, steps: usize, directory: &Path, name: &str) -> Result<(), Failure> {
    match name {
        "adskalman" => {
            serve(Adskalman::<N>::new(case, Method::OptimalKalmanForcedSymmetric), case, steps, directory, name)
        }
        // P+ = (I - K H) P as it comes out.
        "adskalman plain" => serve(Adskalman::<N>::new(case, Method::OptimalKalman), case, steps, directory, name),
        "kalmanfilt" => serve(Kalmanfilt::<N>::new(case), case, steps, directory, name),
        "kfilter" => serve(Kfilter::<N>::new(case), case, steps, directory, name),
        "minikalman" => serve(Minikalman::<N>::new(case), case, steps, directory, name),
        "multicalc" => serve(Multicalc::<N>::new(case), case, steps, directory, name),
        "numeris" => serve(Numeris::<N>::new(case), case, steps, directory, name),
        _ => Err(format!("there is no filter called \"{name}\"").into()),
    }
}
