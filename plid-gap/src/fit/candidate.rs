//! Explanations: fitted effects at locations.

use crate::effects::{Names, Place};
use crate::fit::problem::Placed;

/// A fitted explanation with its price.
#[derive(Clone)]
pub struct Candidate<'a> {
    /// Effects with parameters.
    pub effects: Vec<Placed<'a>>,
    /// Sum of squares, with the linear parameters' penalty.
    pub cost: f64,
    /// The cost with the price of the parameters and of the choice from the library.
    pub priced: f64,
}

/// Relative distance within which two frequencies are one location, because fits of one line from different starts do
/// not end at exactly the same frequency. This constant decides which explanations are the same, wherever they are
/// compared, and not how they are judged.
const SAME_FREQUENCY: f64 = 0.02;

/// Returns whether the two are the same effect at the same location.
pub fn same(a: &Placed, b: &Placed) -> bool {
    a.effect.name() == b.effect.name() && near(&a.place, &b.place)
}

/// Returns whether two explanations name the same effects at the same locations, in any order.
pub fn all_same(a: &[Placed], b: &[Placed]) -> bool {
    a.len() == b.len() && a.iter().all(|a| b.iter().any(|b| same(a, b)))
}

fn near(a: &Place, b: &Place) -> bool {
    let close = |x: f64, y: f64| (x / y - 1.0).abs() < SAME_FREQUENCY;
    match (a, b) {
        (Place::MissingMode(x), Place::MissingMode(y)) => close(*x, *y),
        (Place::Frequency(x, _), Place::Frequency(y, _)) => close(*x, *y),
        _ => a == b,
    }
}

/// Names effects: "cubic-stiffness at input:u2 + sensor-gain at output:y1".
pub(crate) fn in_words(effects: &[Placed], names: &Names) -> String {
    if effects.is_empty() { "nothing".into() } else { joined(effects, names, " at ") }
}

pub(crate) fn joined(effects: &[Placed], names: &Names, at: &str) -> String {
    let one = |p: &Placed| format!("{}{at}{}", p.effect.name(), p.place.location(names));
    effects.iter().map(one).collect::<Vec<_>>().join(" + ")
}
