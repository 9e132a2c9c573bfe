//! Steps of the recursion on the truss, and a pass over P beside them: sixty cells at most of those that `plid bench
//! speed` measures.
//!
//!     cargo bench -p plid-bench --bench step
//!     cargo bench -p plid-bench --bench step -- --test      # each bench once

use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use plid_bench::speed::{Cell, Cores, OUTPUTS, Pass};
use plid_bench::{Noise, Record, Workload};
use plid_catalogue::{BackendName, CovarianceName, ExpectationName, ScalarName};

const SIZES: [usize; 3] = [12, 30, 64];

/// Forty-eight cells; the passes make it 57.
///
/// Each form under the dearest and the cheapest expectation at each size; at the largest also what else can differ, one
/// at a time.
fn cells() -> Vec<Cell> {
    let mut cells = Vec::new();
    for form in CovarianceName::all() {
        for expectations in [ExpectationName::MomentMatched, ExpectationName::JointEkf] {
            cells.extend(SIZES.map(|states| Cell::plain(states, form, expectations)));
            let mut single = Cell::plain(64, form, expectations);
            single.variant.scalar = ScalarName::F32;
            cells.push(single);
        }
        let largest = Cell::plain(64, form, ExpectationName::MomentMatched);
        for backend in [BackendName::Nalgebra, BackendName::Faer] {
            let mut other = largest;
            other.variant.backend = backend;
            cells.push(other);
        }
        cells.push(Cell { noise: Noise::Full, ..largest });
        cells.push(Cell { inputs: 1, ..largest });
    }
    cells
}

fn step(criterion: &mut Criterion) {
    let cores = Cores::choose(None, 1);
    if !cores.pin_here(0) {
        eprintln!("the thread could not be kept on a core: times scatter more");
    }
    let mut group = criterion.benchmark_group("step");
    group.sample_size(20).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(3));
    let records: Vec<Record> =
        (1..=3).map(|inputs| Record::truss(inputs, 1.0).expect("the default truss can be simulated")).collect();
    for cell in cells() {
        let workload = Workload::new(&records[cell.inputs - 1], cell.states, cell.noise).expect("enough states");
        let begin = || workload.recursion(cell.variant).expect("a variant that exists");
        let mut steps = begin();
        group.bench_function(cell.key(), |bench| {
            bench.iter(|| {
                // A matrix in f32 is lost after tens of thousands of steps even here. To begin anew is as good as free
                // among so many.
                if steps.step().is_err() {
                    steps = begin();
                }
            });
        });
    }
    group.finish();

    let mut group = criterion.benchmark_group("pass");
    group.sample_size(20).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    for states in SIZES {
        let size = (OUTPUTS + 4) * states;
        let (mut double, mut single) = (Pass::<f64>::new(size), Pass::<f32>::new(size));
        group.bench_function(format!("N={size} f64"), |bench| bench.iter(|| double.full()));
        group.bench_function(format!("N={size} f64 lower triangle"), |bench| bench.iter(|| double.triangle()));
        group.bench_function(format!("N={size} f32"), |bench| bench.iter(|| single.full()));
    }
    group.finish();
}

criterion_group!(benches, step);
criterion_main!(benches);
