//! Families of laws: the numbers that determine the shapes of laws. Development draws these numbers from one set of
//! values, and reported trials draw them from another.

use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

/// Two disjoint sets of values: one is drawn in development, and the other only in trials whose scores are reported.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Halves<T: 'static> {
    /// The set for development. It contains the value of [`Families::Fixed`], with which the diagnosis was developed.
    pub development: &'static [T],
    /// The set for reported trials.
    pub reported: &'static [T],
}

/// A number on which the shape of a law's curve depends, and not merely its size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// The name of the law.
    pub law: &'static str,
    /// The name of the number.
    pub number: &'static str,
    /// Its value if it is not drawn.
    pub fixed: f64,
    /// The closed intervals from which it is drawn.
    pub ranges: Halves<[f64; 2]>,
}

/// The sets from which the shapes of laws are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Families {
    /// One fixed shape for each law.
    #[default]
    Fixed,
    /// Shapes of the half for development.
    Development,
    /// Shapes of the half for reported trials.
    Reported,
    /// Shapes of both halves.
    All,
}

impl Families {
    /// Returns the values from which a draw is made; none if shapes are fixed.
    #[must_use]
    pub fn of<T: Copy>(self, halves: &Halves<T>) -> Vec<T> {
        match self {
            Self::Fixed => Vec::new(),
            Self::Development => halves.development.to_vec(),
            Self::Reported => halves.reported.to_vec(),
            Self::All => [halves.development, halves.reported].concat(),
        }
    }

    /// Draws a number uniformly from one of the intervals, each of which is equally likely. If shapes are fixed,
    /// there is no number, and nothing is drawn.
    pub(crate) fn number(self, ranges: &Halves<[f64; 2]>, rng: &mut ChaCha12Rng) -> Option<f64> {
        let [low, high] = *self.of(ranges).choose(rng)?;
        Some(rng.random_range(low..=high))
    }

    /// Returns a law in the notation of a config's list, with the numbers that are drawn for its shape.
    pub(crate) fn shaped(self, law: &str, shapes: &[Shape], rng: &mut ChaCha12Rng) -> Value {
        let of_it = shapes.iter().filter(|shape| shape.law == law);
        let drawn = of_it.filter_map(|shape| Some((shape.number.to_owned(), self.number(&shape.ranges, rng)?.into())));
        let numbers: Map<String, Value> = drawn.collect();
        if numbers.is_empty() { law.into() } else { json!({ law: numbers }) }
    }
}
