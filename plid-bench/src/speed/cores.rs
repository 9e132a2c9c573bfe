//! The logical cores in use, and pinning of threads to them.

use core_affinity::{CoreId, get_core_ids, set_for_current};

/// The cores of a study. The first of them measures.
#[derive(Clone, Debug)]
pub struct Cores {
    ids: Vec<usize>,
}

impl Cores {
    /// Returns the cores of the config, or the last `count` that this process may use, because the first ones do most
    /// of the system's own work.
    pub fn choose(given: Option<&[usize]>, count: usize) -> Self {
        let ids = match given {
            Some(ids) => ids.to_vec(),
            None => get_core_ids().unwrap_or_default().iter().rev().take(count).map(|core| core.id).collect(),
        };
        Self { ids }
    }

    /// Returns their numbers in the system. The list is empty if the system does not state them.
    pub fn ids(&self) -> &[usize] {
        &self.ids
    }

    /// Returns whether each of this many threads has its own core.
    pub fn suffice(&self, threads: usize) -> bool {
        threads <= self.ids.len().max(1)
    }

    /// Returns whether threads can be pinned to these cores.
    pub fn can_pin(&self) -> bool {
        !self.ids.is_empty() && (0..self.ids.len()).all(|index| self.on(index, |pinned| pinned))
    }

    /// Pins this thread to core `index` of these, and returns whether the system accepted it.
    pub fn pin_here(&self, index: usize) -> bool {
        self.ids.get(index).is_some_and(|&id| set_for_current(CoreId { id }))
    }

    /// Runs `work` on a thread that is pinned to core `index` of these. The argument of `work` is whether pinning
    /// succeeded.
    pub fn on<T: Send>(&self, index: usize, work: impl FnOnce(bool) -> T + Send) -> T {
        std::thread::scope(|scope| {
            let worker = scope.spawn(|| work(self.pin_here(index)));
            worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_done_on_the_core_that_it_is_given() {
        let cores = Cores::choose(None, 2);
        for index in 0..cores.ids().len() {
            let (pinned, found) = cores.on(index, |pinned| (pinned, get_core_ids().unwrap()));
            if pinned && cfg!(target_os = "linux") {
                assert_eq!(found.iter().map(|core| core.id).collect::<Vec<_>>(), [cores.ids()[index]]);
            }
        }
        assert!(cores.suffice(1) && !cores.suffice(99));
    }

    #[test]
    fn a_core_that_is_not_there_is_found_out() {
        assert!(!Cores::choose(Some(&[1000]), 1).can_pin());
    }
}
