//! One execution, and the fault that it reveals.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;
use std::time::{Duration, Instant};

use crate::Target;

/// Longest time that the reading of an input may take. It allows for a machine that is busy with other work.
const LONGEST: Duration = Duration::from_secs(10);

/// Number of bytes that the reading of an input may allocate, whatever its size.
const BASE: u64 = 1 << 20;

thread_local! {
    /// The location and the message of the last panic of this thread.
    static PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Stores the message of a panic in this thread instead of printing it.
fn listen() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let former = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if READING.with(|reading| *reading.borrow()) {
                PANIC.with(|panic| *panic.borrow_mut() = info.to_string());
            } else {
                former(info);
            }
        }));
    });
}

thread_local! {
    /// Whether this thread is reading an input.
    static READING: RefCell<bool> = const { RefCell::new(false) };
}

/// Lets the target read an input. Returns the words of the target, or the fault.
pub(crate) fn execute(target: &Target, input: &[u8]) -> Result<String, String> {
    listen();
    let began = Instant::now();
    let mut read = Ok(String::new());
    READING.with(|reading| *reading.borrow_mut() = true);
    let allocated = allocation_counter::measure(|| {
        read = catch_unwind(AssertUnwindSafe(|| (target.read)(input)));
    });
    READING.with(|reading| *reading.borrow_mut() = false);
    let words = read.map_err(|_| PANIC.with(|panic| panic.borrow().clone()))?;
    let took = began.elapsed();
    if took > LONGEST {
        return Err(format!("a reading of {} bytes takes {took:?}", input.len()));
    }
    let most = BASE + target.memory * input.len() as u64;
    if allocated.bytes_max > most {
        return Err(format!("a reading of {} bytes allocates {} bytes", input.len(), allocated.bytes_max));
    }
    Ok(words)
}

/// Removes parts of an input as long as it reveals the same fault.
pub(crate) fn shortened(target: &Target, input: &[u8], wrong: &str) -> Vec<u8> {
    let same = |input: &[u8]| execute(target, input).is_err_and(|other| kind(&other) == kind(wrong));
    let mut input = input.to_vec();
    let mut part = input.len() / 2;
    while part > 0 {
        let mut at = 0;
        while at < input.len() {
            let mut shorter = input.clone();
            shorter.drain(at..(at + part).min(input.len()));
            if same(&shorter) {
                input = shorter;
            } else {
                at += part;
            }
        }
        part /= 2;
    }
    input
}

/// Returns words without the parts that vary with the input, which are quotations and digits.
pub(crate) fn kind(words: &str) -> String {
    let parts = words.split(['`', '"', '\'']).step_by(2);
    let kept = parts.flat_map(str::chars).filter(|c| !c.is_ascii_digit());
    kept.take(100).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn target(read: fn(&[u8]) -> String) -> Target {
        Target { name: "test", read, memory: 16, executions: 0 }
    }

    #[test]
    fn panics_and_large_allocations_are_found_and_shortened() {
        let panics = target(|input| {
            assert!(!input.contains(&b'x'), "an x at {:?}", input.iter().position(|&byte| byte == b'x'));
            "good".into()
        });
        assert_eq!(execute(&panics, b"abc"), Ok("good".into()));
        let wrong = execute(&panics, b"aaxaa").unwrap_err();
        assert!(wrong.contains("an x at Some(2)"), "{wrong}");
        assert_eq!(shortened(&panics, b"aaxaa", &wrong), b"x");
        let allocates = target(|input| vec![0_u8; input.len() << 20].len().to_string());
        assert!(execute(&allocates, b"aaa").unwrap_err().contains("allocates"));
    }

    #[test]
    fn what_varies_does_not_count() {
        assert_eq!(kind("line 12: `abc` is not a number"), kind("line 7: `d` is not a number"));
        assert_ne!(kind("line 12: ragged"), kind("line 12: empty"));
    }
}
