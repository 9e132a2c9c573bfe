//! A guess: one name of the vocabulary or "none", each as likely as another. What it scores is known without trying.

use crate::vocabulary::{VOCABULARY, family};

/// Names that a guess chooses among.
const NAMES: f64 = VOCABULARY.len() as f64 + 1.0;

/// That the right name is said.
pub fn exact() -> f64 {
    1.0 / NAMES
}

/// That a name of the right family is said.
pub fn right_family(effect: &str) -> f64 {
    let alike = VOCABULARY.iter().filter(|kind| Some(kind.family) == family(effect)).count();
    alike as f64 / NAMES
}

/// That something is said where nothing is missing.
pub fn false_alarm() -> f64 {
    1.0 - exact()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_guess_among_thirty_three() {
        assert_eq!(exact(), 1.0 / 33.0);
        // Six effects of the strut.
        assert_eq!(right_family("clearance"), 6.0 / 33.0);
        assert!((false_alarm() + exact() - 1.0).abs() < 1e-15);
    }
}
