//! The grids of sweeps.

use plid_lab::sweep::Sweep;

use crate::{fuzz, with_folder, words};

/// The experiment whose keys are varied.
const EXPERIMENT: &str = include_str!("../../corpus/experiment/truss.toml");

/// Every value of a grid becomes an experiment.
#[cfg_attr(test, test)]
pub fn sweep() {
    fuzz("sweep", 4000, 2000, |bytes| {
        with_folder(|folder| {
            std::fs::write(folder.join("truss.toml"), EXPERIMENT).unwrap();
            let file = folder.join("sweep.toml");
            std::fs::write(&file, bytes).unwrap();
            let read = Sweep::read(&file);
            if let Ok(sweep) = &read {
                for index in [0, sweep.points().saturating_sub(1)].into_iter().filter(|&k| k < sweep.points()) {
                    assert_eq!(sweep.values(index).len(), sweep.varied.len());
                    let _ = sweep.experiment(index);
                }
            }
            words(read)
        })
    });
}
