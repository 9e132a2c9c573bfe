//! A guess: one name of the vocabulary or "none", with equal probability. Its expected scores have closed forms.

use crate::vocabulary::{family, on_structures};

/// Returns the number of names from which a guess chooses.
fn names() -> f64 {
    on_structures().len() as f64 + 1.0
}

/// Returns the probability that the right effect is named.
pub fn exact() -> f64 {
    1.0 / names()
}

/// Returns the probability that an effect of the right family is named.
pub fn right_family(effect: &str) -> f64 {
    let alike = on_structures().iter().filter(|kind| Some(kind.family.name()) == family(effect)).count();
    alike as f64 / names()
}

/// Returns the probability that an effect is named although nothing is missing.
pub fn false_alarm() -> f64 {
    1.0 - exact()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_guess_among_thirty_four() {
        assert_eq!(exact(), 1.0 / 34.0);
        // Seven effects act at a port.
        assert_eq!(right_family("clearance"), 7.0 / 34.0);
        assert!((false_alarm() + exact() - 1.0).abs() < 1e-15);
    }
}
