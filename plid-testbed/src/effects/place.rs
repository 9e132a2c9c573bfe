//! The place of an effect, as a user writes it: `u2`, `all`, `y1`, `u1->u3`, `m5`.

use serde::{Deserialize, Serialize};

use crate::{INPUTS, OUTPUTS};

/// A text that does not name a place of the requested kind.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("this effect cannot act at `{text}`: it takes {expected}")]
pub struct BadPlace {
    text: String,
    expected: &'static str,
}

/// Returns the number after the letter, counted from 0; the text counts from 1 to `most`.
fn numbered(text: &str, letter: char, most: usize) -> Option<usize> {
    let number: usize = text.strip_prefix(letter)?.parse().ok()?;
    (1..=most).contains(&number).then(|| number - 1)
}

fn pair(text: &str, letter: char, most: usize) -> Option<(usize, usize)> {
    let (from, to) = text.split_once("->")?;
    let (from, to) = (numbered(from, letter, most)?, numbered(to, letter, most)?);
    (from != to).then_some((from, to))
}

fn bad(text: String, expected: &'static str) -> BadPlace {
    BadPlace { text, expected }
}

/// An input, or the strut of one: `u1`, `u2` or `u3`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Input(pub(crate) usize);

impl TryFrom<String> for Input {
    type Error = BadPlace;

    fn try_from(text: String) -> Result<Self, BadPlace> {
        numbered(&text, 'u', INPUTS).map(Self).ok_or_else(|| bad(text, "an input, u1 to u3"))
    }
}

impl From<Input> for String {
    fn from(Input(j): Input) -> Self {
        format!("u{}", j + 1)
    }
}

/// One input or all of them: `u1`, `u2`, `u3` or `all`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Inputs {
    /// One input, from 0.
    One(usize),
    /// Every input alike.
    All,
}

impl Inputs {
    pub(crate) fn channels(self) -> Vec<usize> {
        match self {
            Inputs::One(j) => vec![j],
            Inputs::All => (0..INPUTS).collect(),
        }
    }
}

impl TryFrom<String> for Inputs {
    type Error = BadPlace;

    fn try_from(text: String) -> Result<Self, BadPlace> {
        if text == "all" {
            return Ok(Inputs::All);
        }
        numbered(&text, 'u', INPUTS).map(Inputs::One).ok_or_else(|| bad(text, "an input, u1 to u3, or all"))
    }
}

impl From<Inputs> for String {
    fn from(inputs: Inputs) -> Self {
        match inputs {
            Inputs::One(j) => format!("u{}", j + 1),
            Inputs::All => "all".to_owned(),
        }
    }
}

/// An output: `y1`, `y2` or `y3`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Output(pub(crate) usize);

impl TryFrom<String> for Output {
    type Error = BadPlace;

    fn try_from(text: String) -> Result<Self, BadPlace> {
        numbered(&text, 'y', OUTPUTS).map(Self).ok_or_else(|| bad(text, "an output, y1 to y3"))
    }
}

impl From<Output> for String {
    fn from(Output(i): Output) -> Self {
        format!("y{}", i + 1)
    }
}

/// From one input into another: `u1->u3`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct InputPair(pub(crate) usize, pub(crate) usize);

impl TryFrom<String> for InputPair {
    type Error = BadPlace;

    fn try_from(text: String) -> Result<Self, BadPlace> {
        let found = pair(&text, 'u', INPUTS).map(|(from, to)| Self(from, to));
        found.ok_or_else(|| bad(text, "two different inputs, as u1->u3"))
    }
}

impl From<InputPair> for String {
    fn from(InputPair(from, to): InputPair) -> Self {
        format!("u{}->u{}", from + 1, to + 1)
    }
}

/// From one output into another: `y1->y3`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct OutputPair(pub(crate) usize, pub(crate) usize);

impl TryFrom<String> for OutputPair {
    type Error = BadPlace;

    fn try_from(text: String) -> Result<Self, BadPlace> {
        let found = pair(&text, 'y', OUTPUTS).map(|(from, to)| Self(from, to));
        found.ok_or_else(|| bad(text, "two different outputs, as y1->y3"))
    }
}

impl From<OutputPair> for String {
    fn from(OutputPair(from, to): OutputPair) -> Self {
        format!("y{}->y{}", from + 1, to + 1)
    }
}

/// A mode by its number in the truss's list, from 1: `m5`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ModeNumber(pub(crate) usize);

impl TryFrom<String> for ModeNumber {
    type Error = BadPlace;

    fn try_from(text: String) -> Result<Self, BadPlace> {
        numbered(&text, 'm', 1000).map(Self).ok_or_else(|| bad(text, "a mode by its number, as m5"))
    }
}

impl From<ModeNumber> for String {
    fn from(ModeNumber(m): ModeNumber) -> Self {
        format!("m{}", m + 1)
    }
}
