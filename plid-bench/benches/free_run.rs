//! Free runs of the simulation that a diagnosis makes by the thousand: ten modes, three inputs and outputs, 2000
//! samples.
//!
//!     cargo bench -p plid-bench --bench free_run

use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use plid_bench::speed::Cores;
use plid_gap::case::{Case, columns};
use plid_gap::effects::{Action, Force};
use plid_gap::research::{Fineness, Plant, Run, before_sensors, simulate};
use plid_testbed::gap::{GapSpec, draw};

const SAMPLES: usize = 2000;

/// Stiffens.
struct Cubic;

impl Force for Cubic {
    fn force(&self, d: f64, _v: f64, _state: &[f64]) -> f64 {
        -1e3 * d * d * d
    }
}

fn free_run(criterion: &mut Criterion) {
    let cores = Cores::choose(None, 1);
    if !cores.pin_here(0) {
        eprintln!("the thread could not be kept on a core: times scatter more");
    }
    let drawn = draw(1, &GapSpec { ports: true, ..GapSpec::default() }).expect("nothing is to be reached");
    let folder = tempfile::tempdir().expect("a folder");
    drawn.write(&folder.path().join("case"), &folder.path().join("label")).expect("room for a case");
    let case = Case::read(&folder.path().join("case/case.toml")).expect("what was written");
    let plant = Plant::new(case.model.as_ref().expect("a simulation")).expect("a stable simulation");
    let mut u = columns(&drawn.held_out.commands);
    u.iter_mut().for_each(|channel| channel.truncate(SAMPLES));

    let mut group = criterion.benchmark_group("free run");
    group.sample_size(30).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    group.throughput(Throughput::Elements(SAMPLES as u64));
    let runs = [
        ("linear", 0, Fineness::FINE),
        ("a force, coarse", 1, Fineness::COARSE),
        ("a force, fine", 1, Fineness::FINE),
        ("two forces, fine", 2, Fineness::FINE),
    ];
    for (name, forces, fineness) in runs {
        let actions: Vec<Action> = (0..forces).map(|port| Action::Force(port, Box::new(Cubic))).collect();
        group.bench_function(name, |bench| bench.iter(|| simulate(&plant, &actions, &u, 0.0, None, fineness)));
    }
    let cubic: [Action; 1] = [Action::Force(0, Box::new(Cubic))];
    for (name, actions) in [("four linear", &cubic[..0]), ("four with a force, fine", &cubic)] {
        let run = Run { actions, u: &u, t0: 0.0, start: None };
        group.throughput(Throughput::Elements(4 * SAMPLES as u64));
        group.bench_function(name, |bench| bench.iter(|| before_sensors(&plant, &[run; 4], Fineness::FINE)));
    }
    group.finish();
}

criterion_group!(benches, free_run);
criterion_main!(benches);
