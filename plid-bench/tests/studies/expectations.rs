//! A whole study of expectations, small: its files, its figures, and that it resumes and does not depend on threads.

use std::fs;
use std::sync::atomic::{AtomicUsize, Ordering};

use plid_bench::expectations::{Config, Finished, run};
use plid_bench::study::{Progress, Silent, StudyError, from_toml_checked};

const CONFIG: &str = "
seed = 5
signal_to_noise = [0.5, 300.0]
state_noise_share = 0.2
covariance = \"direct\"
[[scalar]]
runs = 200
steps = 100
told_sigma = [1.0, 100.0]
grid_points = 40
[[in_class]]
states = 4
outputs = 2
inputs = 1
runs = 24
steps = 300
told_sigma = [1.0]
initial_std = 0.1
[[truss]]
states = 6
runs = 2
duration_s = 0.5
held_out_s = 0.2
sigma_over_r = [0.01]
batch_at = 0.01
";

fn config() -> Config {
    from_toml_checked(CONFIG, "test", Config::problems).unwrap()
}

fn cell<'a>(cells: &'a [Finished], plant: &str, signal_to_noise: f64, sigma: f64) -> &'a Finished {
    let wanted = |cell: &&Finished| {
        cell.plant.starts_with(plant) && cell.signal_to_noise == signal_to_noise && cell.sigma == sigma
    };
    cells.iter().find(wanted).unwrap()
}

#[test]
fn a_small_study_says_what_is_known() {
    let directory = tempfile::tempdir().unwrap();
    let study = run(&config(), directory.path(), false, &Silent).unwrap();
    assert_eq!(study.cells.len(), 8);
    let nees = |plant, snr, sigma, method: &str| {
        let cell = cell(&study.cells, plant, snr, sigma);
        cell.scores.iter().find(|score| score.method == method).unwrap().nees.unwrap()
    };
    // Exact Bayes is honest whatever the noise; with truths drawn from its prior that is a theorem.
    for snr in [0.5, 300.0] {
        let exact = nees("scalar", snr, 1.0, "exact-bayes");
        assert!((exact.value - 1.0).abs() < 4.0 * exact.error, "{exact:?}");
    }
    // With little signal the prior's expectation is overconfident, and moment matching hardly.
    let (prior, matched) = (nees("scalar", 0.5, 1.0, "prior"), nees("scalar", 0.5, 1.0, "moment-matched"));
    assert!(prior.value > 1.5 && matched.value < 1.4, "{prior:?} {matched:?}");
    // With much they are alike, and honest.
    for method in ["prior", "posterior", "certainty-equivalent", "moment-matched", "joint-ekf"] {
        for plant in ["scalar", "in-class"] {
            let found = nees(plant, 300.0, 1.0, method);
            assert!((found.value - 1.0).abs() < 0.35, "{plant} {method}: {found:?}");
        }
    }
    for name in ["report.html", "expectations.csv", "expectations.json", "machine.json", "config.toml"] {
        assert!(directory.path().join(name).metadata().unwrap().len() > 100, "{name}");
    }
    let csv = fs::read_to_string(directory.path().join("expectations.csv")).unwrap();
    // Scalar: 10 methods with the true Sigma and 7 with another; in class and truss: 7.
    assert_eq!(csv.lines().count(), 1 + 2 * (10 + 7 + 7 + 7));
    let page = fs::read_to_string(directory.path().join("report.html")).unwrap();
    assert!(page.matches("<svg").count() >= 8 && !page.contains("NaN"));
}

/// Asks for an end in the third cell.
struct Impatient(AtomicUsize);

impl Progress for Impatient {
    fn stage(&self, _name: &str) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
    fn advance(&self, _done: usize, _total: usize) {}
    fn interrupted(&self) -> bool {
        self.0.load(Ordering::Relaxed) > 2
    }
}

#[test]
fn it_resumes_and_does_not_depend_on_threads() {
    let mut config = config();
    config.truss.clear();
    config.scalar[0].runs = 20;
    config.in_class[0].runs = 5;
    let [whole, parts] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let expected = pool.install(|| run(&config, whole.path(), false, &Silent)).unwrap();

    let ended = run(&config, parts.path(), false, &Impatient(AtomicUsize::new(0)));
    assert!(matches!(ended, Err(StudyError::Interrupted { .. })));
    assert!(!parts.path().join("report.html").exists());
    let journal = fs::read_to_string(parts.path().join("cells.jsonl")).unwrap();
    assert_eq!(journal.lines().count(), 1 + 2);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let resumed = pool.install(|| run(&config, parts.path(), true, &Silent)).unwrap();
    assert_eq!(resumed, expected);
    let read = |directory: &tempfile::TempDir| fs::read(directory.path().join("expectations.csv")).unwrap();
    assert_eq!(read(&parts), read(&whole));
}
