//! One step of the recursion on the truss (3 inputs, 3 outputs), by number of states and variant.
//!
//!     cargo bench -p plid-bench
//!     cargo bench -p plid-bench -- --test      # each bench once

use std::time::Duration;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use plid_bench::{Noise, Record, Workload};
use plid_lab::variant::{BackendName, CovarianceName, ExpectationName, ScalarName, Variant};

/// The bench's name and the variant, which differs from direct, moment-matched, plain, f64 as the name says.
fn variants() -> [(&'static str, Variant); 10] {
    use {BackendName as B, CovarianceName as C, ExpectationName as E, ScalarName as S};
    let direct = Variant { covariance: C::Direct, expectations: E::MomentMatched, backend: B::Plain, scalar: S::F64 };
    [
        ("direct", direct),
        ("joseph", Variant { covariance: C::Joseph, ..direct }),
        ("bierman-ud", Variant { covariance: C::BiermanUd, ..direct }),
        ("array-sqrt", Variant { covariance: C::ArraySqrt, ..direct }),
        ("direct, prior", Variant { expectations: E::Prior, ..direct }),
        ("direct, joint-ekf", Variant { expectations: E::JointEkf, ..direct }),
        ("bierman-ud, joint-ekf", Variant { covariance: C::BiermanUd, expectations: E::JointEkf, ..direct }),
        ("bierman-ud, nalgebra", Variant { covariance: C::BiermanUd, backend: B::Nalgebra, ..direct }),
        ("bierman-ud, faer", Variant { covariance: C::BiermanUd, backend: B::Faer, ..direct }),
        ("bierman-ud, f32", Variant { covariance: C::BiermanUd, scalar: S::F32, ..direct }),
    ]
}

fn step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step");
    group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    let record = Record::truss(3, 1.0).expect("the default truss can be simulated");
    for states in [12, 30, 64] {
        let workload = Workload::new(&record, states, Noise::Diagonal).expect("enough states");
        for (name, variant) in variants() {
            let mut steps = workload.recursion(variant).expect("a variant that exists");
            group.bench_function(BenchmarkId::new(name, states), |bench| {
                bench.iter(|| steps.step().expect("the workload keeps every variant sound"));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, step);
criterion_main!(benches);
