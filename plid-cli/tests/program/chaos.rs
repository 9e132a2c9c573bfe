//! Work that is killed at random points and resumed gives the same bytes as work that nobody disturbs.
//!
//! `PLID_CHAOS_KILLS` sets the number of kills of each command, and `PLID_CHAOS_SEED` the seed of their times.

mod commands;
#[cfg(target_os = "linux")]
mod full;
mod shards;

use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::contents::{Files, contents};

/// A command that can be resumed.
struct Work {
    /// Its arguments.
    first: &'static [&'static str],
    /// What is added to them to resume it.
    again: &'static [&'static str],
    /// The folders with its results.
    results: &'static [&'static str],
    /// Writes what the command reads.
    prepare: fn(&Path),
}

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().expect("a whole number"))
}

fn start(at: &Path, work: &Work) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plid"));
    command.current_dir(at).arg("--quiet").args(work.first);
    if work.results.iter().any(|folder| at.join(folder).exists()) {
        command.args(work.again);
    }
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the program starts")
}

/// Waits for the end, or kills the program when the time is over. Returns the status if it ended by itself.
fn wait(mut child: Child, most: Option<Duration>) -> Option<ExitStatus> {
    let began = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            let mut said = String::new();
            std::io::Read::read_to_string(&mut child.stderr.take().unwrap(), &mut said).unwrap();
            assert!(status.success(), "{status}: {said}");
            return Some(status);
        }
        if most.is_some_and(|most| began.elapsed() >= most) {
            child.kill().unwrap();
            child.wait().unwrap();
            return None;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Runs the work undisturbed; returns its results and how long it took.
fn undisturbed(work: &Work) -> (Files, Duration) {
    let directory = tempfile::tempdir().unwrap();
    (work.prepare)(directory.path());
    let began = Instant::now();
    wait(start(directory.path(), work), None);
    (contents(directory.path(), work.results), began.elapsed())
}

/// Waits until a process that has outlived the command that started it removes its temporary folder.
fn settle(folder: &Path) {
    let began = Instant::now();
    while std::fs::read_dir(folder).unwrap().any(|entry| is_temporary(&entry.unwrap().path())) {
        assert!(began.elapsed() < Duration::from_secs(60), "{} holds something temporary", folder.display());
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Whether an entry is temporary or contains something that is.
fn is_temporary(path: &Path) -> bool {
    let inside =
        || std::fs::read_dir(path).is_ok_and(|mut entries| entries.any(|e| e.is_ok_and(|e| is_temporary(&e.path()))));
    path.extension().is_some_and(|extension| extension == "plid-tmp") || inside()
}

/// Kills the work several times, and compares the results of each run that reaches its end.
fn chaos(work: &Work) {
    let (expected, whole) = undisturbed(work);
    let (kills, seed) = (number("PLID_CHAOS_KILLS", 1), number("PLID_CHAOS_SEED", 1));
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut killed, mut ends) = (0, 0);
    while killed < kills {
        let directory = tempfile::tempdir().unwrap();
        (work.prepare)(directory.path());
        // Three kills of one run on average, and then it may end.
        while killed < kills && rng.random_range(0..4) > 0 {
            let most = whole.mul_f64(rng.random_range(0.0..1.1));
            if wait(start(directory.path(), work), Some(most)).is_some() {
                break;
            }
            killed += 1;
        }
        wait(start(directory.path(), work), None);
        work.results.iter().for_each(|folder| settle(&directory.path().join(folder)));
        ends += 1;
        let found = contents(directory.path(), work.results);
        let names = |files: &Files| files.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&found), names(&expected), "{:?} after {killed} kills, seed {seed}", work.first);
        let differs = expected.iter().find(|(name, content)| found[*name] != **content);
        assert!(differs.is_none(), "{:?}: {differs:?} differs after {killed} kills, seed {seed}", work.first);
    }
    println!("{:?}: {killed} kills, {ends} runs to the end, all the same", &work.first[..2]);
}

/// Kills a study several times. The lines of its journal that are whole at a kill must stay as they are, and in the end
/// no key is there twice.
fn kept(work: &Work) {
    let (_, whole) = undisturbed(work);
    let mut rng = ChaCha8Rng::seed_from_u64(number("PLID_CHAOS_SEED", 1));
    let kills = number("PLID_CHAOS_KILLS", 1);
    let mut killed = 0;
    while killed < kills {
        let directory = tempfile::tempdir().unwrap();
        (work.prepare)(directory.path());
        let journal = directory.path().join(work.results[0]).join("cells.jsonl");
        let mut before = String::new();
        let mut is_over = false;
        while !is_over {
            let may_end = killed >= kills || rng.random_range(0..4) == 0;
            let most = (!may_end).then(|| whole.mul_f64(rng.random_range(0.0..1.1)));
            is_over = wait(start(directory.path(), work), most).is_some();
            killed += u64::from(!is_over);
            let after = std::fs::read_to_string(&journal).unwrap_or_default();
            assert!(after.starts_with(&before), "{before} becomes {after}");
            before = after[..after.rfind('\n').map_or(0, |end| end + 1)].to_owned();
        }
        let keys: Vec<&str> = before.lines().skip(1).map(|line| line.split('"').nth(3).unwrap()).collect();
        let different: std::collections::BTreeSet<_> = keys.iter().collect();
        assert!(different.len() == keys.len() && !keys.is_empty(), "{keys:?}");
    }
    println!("{:?}: {killed} kills, every finished cell is kept", &work.first[..2]);
}
