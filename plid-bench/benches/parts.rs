//! The parts of a step of the direct form with the joint EKF at 64 states, three inputs and three outputs, each against
//! its limit, and the downdate of a triangle that is stored in panels of 8 and of 16 columns.
//!
//!     cargo bench -p plid-bench --bench parts
//!
//! The limit of a part is the time of its operations at the peak in registers or that of a pass over a matrix of as
//! many bytes, whichever is longer. Nothing else should run at the same time.

use plid_bench::speed::parts::{Part, in_panels, parts};
use plid_bench::speed::{Cores, peak, time};
use plid_bench::{Noise, Record, Workload};
use plid_catalogue::{CovarianceName, ExpectationName, Variant};

const STATES: usize = 64;
const INPUTS: usize = 3;

fn line(part: &Part, peak: f64) {
    let Part { what, operations, bytes, seconds } = part;
    let limit = part.limit(peak);
    println!(
        "{what:<40} {:>9.1} {:>9.1} {:>8.2} {:>8.2} {:>6.2}",
        operations / 1e3,
        bytes / 1024.0,
        limit * 1e6,
        seconds * 1e6,
        seconds / limit
    );
}

fn main() {
    if !Cores::choose(None, 1).pin_here(0) {
        eprintln!("the thread could not be kept on a core: times scatter more");
    }
    let peak = peak::<f64>();
    println!("peak {:.1} Gflop/s", peak / 1e9);
    println!("{:<40} {:>9} {:>9} {:>8} {:>8} {:>6}", "part", "kflop", "KiB", "limit us", "us", "ratio");
    let parts = parts(STATES, INPUTS).expect("enough states");
    parts.iter().for_each(|part| line(part, peak));

    let record = Record::truss(INPUTS, 1.0).expect("the default truss can be simulated");
    let workload = Workload::new(&record, STATES, Noise::Diagonal).expect("enough states");
    let variant =
        Variant { covariance: CovarianceName::Direct, expectations: ExpectationName::JointEkf, ..Variant::default() };
    let mut steps = workload.recursion(variant).expect("a variant of the catalogue");
    let whole = time(|| steps.step().expect("the noise covariances keep P positive"));
    let named: f64 = parts.iter().map(|part| part.seconds).sum();
    let limits: f64 = parts.iter().map(|part| part.limit(peak)).sum();
    println!("whole step {:.2} us; its parts {:.2}, their limits {:.2}", whole * 1e6, named * 1e6, limits * 1e6);
    println!("copies, scratch and the loop of the identifier: {:.2} us", (whole - named) * 1e6);

    for (width, panels) in [(8, in_panels::<8>(STATES, INPUTS)), (16, in_panels::<16>(STATES, INPUTS))] {
        println!("panels of {width} columns");
        panels.iter().for_each(|part| line(part, peak));
    }
}
