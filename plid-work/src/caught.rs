use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Carries out one part of a larger task, such as one case of many. If it panics, the error is the message of the
/// panic.
///
/// Data that the part was changing when it panicked must not be used afterwards.
///
/// # Errors
/// Returns the part's own error, or a sentence about its panic.
pub fn caught<T>(part: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(part)).unwrap_or_else(|panic| Err(format!("panicked: {}", words(panic.as_ref()))))
}

fn words(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("without a word")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_with_its_words() {
        let part = |what: &str| {
            let what = what.to_owned();
            caught(move || match what.as_str() {
                "fine" => Ok(1),
                "wrong" => Err("wrong".to_owned()),
                "text" => panic!("a text"),
                other => panic!("{other} words"),
            })
        };
        assert_eq!((part("fine"), part("wrong")), (Ok(1), Err("wrong".to_owned())));
        assert_eq!(part("text"), Err("panicked: a text".to_owned()));
        assert_eq!(part("formatted"), Err("panicked: formatted words".to_owned()));
        assert_eq!(caught::<()>(|| std::panic::panic_any(7)), Err("panicked: without a word".to_owned()));
    }
}
