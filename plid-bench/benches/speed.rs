//! The time of a step with three inputs and outputs, by size, form, expectation, backend and scalar, and the time of a
//! pass over P for comparison.
//!
//!     cargo bench -- speed                                   # all cells
//!     cargo bench -- 'n=30 bierman-ud .* plain f64'          # those whose name matches
//!
//! Times are short: they tell what is twice as fast. `plid bench speed` is the study with quantiles and repetitions.

use std::time::Duration;

use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use plid_bench::speed::{Cell, Cores, Pass, word};
use plid_bench::{Noise, Record, Workload};
use plid_catalogue::{BackendName, CovarianceName, ExpectationName, ScalarName, Variant};

const SIZES: [usize; 5] = [12, 24, 30, 48, 64];
const SCALARS: [ScalarName; 3] = [ScalarName::F32, ScalarName::F64, ScalarName::DoubleDouble];

/// Every form, expectation, backend and scalar of the catalogue; not all of them go together.
fn variants() -> impl Iterator<Item = Variant> {
    let on = |covariance, expectations| {
        let of = move |backend| SCALARS.map(|scalar| Variant { covariance, expectations, backend, scalar });
        BackendName::all().into_iter().flat_map(of)
    };
    let with = move |covariance| ExpectationName::all().into_iter().flat_map(move |e| on(covariance, e));
    CovarianceName::all().into_iter().flat_map(with)
}

fn speed(criterion: &mut Criterion) {
    let cores = Cores::choose(None, 1);
    if !cores.pin_here(0) {
        eprintln!("the thread could not be kept on a core: times scatter more");
    }
    let record = Record::truss(3, 1.0).expect("the default truss can be simulated");
    for states in SIZES {
        let mut group = criterion.benchmark_group("speed");
        group.sample_size(10).nresamples(1000).sampling_mode(SamplingMode::Flat);
        group.warm_up_time(Duration::from_millis(10)).measurement_time(Duration::from_millis(50));
        let workload = Workload::new(&record, states, Noise::Diagonal).expect("enough states");
        for variant in variants() {
            let Variant { covariance, expectations, backend, scalar } = variant;
            let name = format!("n={states} {covariance} {expectations} {backend} {}", word(&scalar));
            if workload.recursion(variant).is_err() {
                continue;
            }
            group.bench_function(name, |bench| {
                let begin = || workload.recursion(variant).expect("it has been built before");
                let mut steps = begin();
                bench.iter(|| {
                    // In f32 a matrix loses its definiteness after tens of thousands of steps even here. A new start
                    // costs next to nothing among so many.
                    if steps.step().is_err() {
                        steps = begin();
                    }
                });
            });
        }
        let size = Cell::plain(states, CovarianceName::default(), ExpectationName::default()).joint_states();
        let (mut double, mut single) = (Pass::<f64>::new(size), Pass::<f32>::new(size));
        group.bench_function(format!("n={states} pass over P f64"), |bench| bench.iter(|| double.full()));
        group.bench_function(format!("n={states} pass over P f32"), |bench| bench.iter(|| single.full()));
        group.finish();
    }
}

criterion_group!(benches, speed);
criterion_main!(benches);
