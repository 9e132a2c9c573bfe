//! All executions of a target.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::finding::{execute, kind, shortened};
use crate::mutate::mutated;
use crate::watch::Watch;

/// Largest number of inputs that are mutated.
const INPUTS: usize = 500;

/// A reader.
pub struct Target {
    /// The name of the folder that holds its corpus.
    pub name: &'static str,
    /// Reads an input, checks that what it accepts is read back the same, and returns a few words about it.
    pub read: fn(&[u8]) -> String,
    /// Number of bytes of memory allowed per byte of the input.
    pub memory: u64,
    /// Number of executions of a run for which no time is set.
    pub executions: u64,
}

/// When a run ends.
enum End {
    Executions(u64),
    Time(Duration),
}

/// Lets a target read the files in `corpus`/NAME and mutations of them. Inputs that reveal a fault are written to
/// `findings`/NAME.
///
/// # Panics
/// Panics with all faults that were found, and if the corpus cannot be read.
pub fn run(target: &Target, corpus: &Path, findings: &Path) {
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse::<u64>().expect("a whole number"));
    let end = match number("PLID_FUZZ_SECONDS") {
        Some(seconds) => End::Time(Duration::from_secs(seconds)),
        None => End::Executions(target.executions),
    };
    let findings = findings.join(target.name);
    fs::create_dir_all(&findings).expect("the folder of the findings");
    let mut inputs = files(&corpus.join(target.name));
    let watch = Watch::new(target.name, &findings.join("hang"));
    let mut rng = ChaCha8Rng::seed_from_u64(number("PLID_FUZZ_SEED").unwrap_or(1));
    let (mut known, mut faults) = (BTreeSet::new(), BTreeMap::new());
    let (began, mut executions, mut first) = (Instant::now(), 0_u64, 0);
    let is_over = |executions: u64| match end {
        End::Executions(most) => executions >= most,
        End::Time(most) => began.elapsed() >= most,
    };
    while first < inputs.len() || !is_over(executions) {
        let is_new = first >= inputs.len();
        let input = if is_new { mutated(&inputs, &mut rng) } else { inputs[first].clone() };
        first += usize::from(!is_new);
        watch.begin(&input);
        let read = execute(target, &input);
        watch.end();
        executions += 1;
        match read {
            Ok(words) => {
                if known.insert(kind(&words)) && is_new && inputs.len() < INPUTS {
                    inputs.push(input);
                    first += 1;
                }
            }
            Err(wrong) => {
                faults.entry(kind(&wrong)).or_insert_with(|| {
                    let short = shortened(target, &input, &wrong);
                    let file = findings.join(format!("fault-{executions}"));
                    fs::write(&file, short).expect("a finding is written");
                    format!("{wrong}\n  {}", file.display())
                });
            }
        }
    }
    let seconds = began.elapsed().as_secs_f64();
    let name = target.name;
    println!("{name}: {executions} executions in {seconds:.1} s, {} outcomes, {} faults", known.len(), faults.len());
    let faults: Vec<String> = faults.into_values().collect();
    assert!(faults.is_empty(), "{name}: {} faults\n{}", faults.len(), faults.join("\n"));
}

/// Lets a target read one input, which another program has made.
///
/// # Panics
/// Panics with the fault, if there is one.
pub fn check(target: &Target, input: &[u8]) {
    if let Err(wrong) = execute(target, input) {
        panic!("{}: {wrong}", target.name);
    }
}

/// Returns the files of a folder in the order of their names.
fn files(folder: &Path) -> Vec<Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut paths: Vec<_> = entries.map(|entry| entry.expect("an entry of the corpus").path()).collect();
    paths.sort();
    assert!(!paths.is_empty(), "{} has no file", folder.display());
    paths.iter().map(|path| fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[should_panic(expected = "a reader: ")]
    fn a_fault_ends_a_check_with_the_name_of_the_reader() {
        let read = |input: &[u8]| input[0].to_string();
        let target = Target { name: "a reader", read, memory: 16, executions: 0 };
        check(&target, b"x");
        check(&target, b"");
    }
}
