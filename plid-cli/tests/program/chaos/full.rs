//! A full disk and one that cannot be written to: work fails with a message, and is resumed when there is room.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Command;

use super::{Work, commands, contents, start, undisturbed, wait};

/// A file system in memory of 4 MiB, which is unmounted at the end.
struct Small(tempfile::TempDir);

impl Small {
    /// `None` where this user may not mount anything.
    fn mount() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let mounted = mount(&["-t", "tmpfs", "-o", "size=4m", "tmpfs"], folder.path());
        if !mounted {
            println!("SKIPPED: this needs the right to mount a tmpfs");
        }
        mounted.then_some(Self(folder))
    }

    fn remount(&self, options: &str) {
        assert!(mount(&["-o", &format!("remount,{options}")], self.0.path()));
    }
}

impl Drop for Small {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(self.0.path()).status();
    }
}

fn mount(arguments: &[&str], at: &Path) -> bool {
    let output = Command::new("mount").args(arguments).arg(at).output();
    output.is_ok_and(|output| output.status.success())
}

/// Fills the file system, apart from `free` bytes.
fn fill(at: &Path, free: u64) {
    let mut file = fs::File::create(at.join("filler")).unwrap();
    while file.write_all(&[0; 4096]).is_ok() {}
    let length = file.metadata().unwrap().len();
    file.set_len(length.saturating_sub(free)).unwrap();
}

/// The work must fail with a message that says why.
fn fails(at: &Path, work: &Work, why: &str) {
    let output = start(at, work).wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(matches!(output.status.code(), Some(1 | 2)), "{:?}: {}: {said}", work.first, output.status);
    assert!(said.contains(why), "{:?}: {said}", work.first);
}

fn full_and_read_only(work: &Work) {
    let Some(small) = Small::mount() else { return };
    let at = small.0.path();
    let (expected, _) = undisturbed(work);
    (work.prepare)(at);
    small.remount("ro");
    fails(at, work, "Read-only file system");
    small.remount("rw");
    for free in [0, 4096, 16_384] {
        fill(at, free);
        fails(at, work, "No space left on device");
        fs::remove_file(at.join("filler")).unwrap();
    }
    wait(start(at, work), None);
    let found = contents(at, work.results);
    assert!(found.keys().eq(expected.keys()), "{:?} and {:?}", found.keys(), expected.keys());
    assert!(found == expected, "{:?}", work.first);
}

#[test]
fn an_experiment_needs_room() {
    full_and_read_only(&commands::RUN);
}

#[test]
fn a_sweep_needs_room() {
    full_and_read_only(&commands::SWEEP);
}

#[test]
fn a_study_needs_room() {
    full_and_read_only(&commands::BENCH_STABILITY);
}

#[test]
fn a_trial_needs_room() {
    full_and_read_only(&commands::GAP_TRIAL_DIAGNOSE);
}
