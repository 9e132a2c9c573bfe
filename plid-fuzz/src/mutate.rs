//! Mutations of an input: of bits and bytes, of the numbers that formats contain, and of whole parts.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Length above which an input does not grow.
const LONGEST: usize = 1 << 14;

/// Numbers in text that may cause faults in readers.
const NUMBERS: [&str; 20] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "7",
    "0.5",
    "1e-320",
    "1e70",
    "1e300",
    "1e999",
    "-1e999",
    "nan",
    "inf",
    "NaN",
    "4294967296",
    "999999999999",
    "9223372036854775807",
    "18446744073709551615",
    "0.1",
];

/// Numbers in bytes that lie at the ends of a range.
const WORDS: [u64; 14] = [
    0,
    1,
    2,
    0x7f,
    0xff,
    0x7fff,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x7fff_ffff_ffff_ffff,
    0x8000_0000_0000_0000,
    0x7ff0_0000_0000_0000,
    u64::MAX,
];

/// Returns a changed copy of one of the inputs.
pub(crate) fn mutated(inputs: &[Vec<u8>], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut input = choice(inputs, rng).clone();
    // Half of the inputs have one change, a quarter have two, and so on.
    loop {
        change(&mut input, inputs, rng);
        if rng.random() {
            return input;
        }
    }
}

fn choice<'a, T>(list: &'a [T], rng: &mut ChaCha8Rng) -> &'a T {
    &list[rng.random_range(0..list.len())]
}

/// A position in an input, its end included.
fn place(input: &[u8], rng: &mut ChaCha8Rng) -> usize {
    rng.random_range(0..=input.len())
}

/// Two positions in order. They are often near each other.
fn range(input: &[u8], rng: &mut ChaCha8Rng) -> std::ops::Range<usize> {
    let from = place(input, rng);
    let most = if rng.random() { 16 } else { input.len() };
    from..(from + rng.random_range(0..=most)).min(input.len())
}

fn change(input: &mut Vec<u8>, inputs: &[Vec<u8>], rng: &mut ChaCha8Rng) {
    match rng.random_range(0..10) {
        0 => flip(input, rng),
        1 => replace_byte(input, rng),
        2 => {
            let range = range(input, rng);
            input.drain(range);
        }
        3 => repeat(input, rng),
        4 => splice(input, inputs, rng),
        5 => replace_word(input, rng),
        6 | 7 => replace_number(input, rng),
        8 => exchange_lines(input, rng),
        _ => input.truncate(place(input, rng)),
    }
}

fn flip(input: &mut [u8], rng: &mut ChaCha8Rng) {
    if !input.is_empty() {
        input[rng.random_range(0..input.len())] ^= 1 << rng.random_range(0..8);
    }
}

fn replace_byte(input: &mut [u8], rng: &mut ChaCha8Rng) {
    if !input.is_empty() {
        input[rng.random_range(0..input.len())] = rng.random();
    }
}

/// Repeats a part immediately after itself, up to a hundred times.
fn repeat(input: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    let range = range(input, rng);
    let part = input[range.clone()].to_vec();
    let times = if rng.random() { 1 } else { rng.random_range(1..100) };
    if input.len() + times * part.len() <= LONGEST {
        input.splice(range.end..range.end, part.repeat(times));
    }
}

/// Replaces a part by one of another input.
fn splice(input: &mut Vec<u8>, inputs: &[Vec<u8>], rng: &mut ChaCha8Rng) {
    let other = choice(inputs, rng);
    let part = other[range(other, rng)].to_vec();
    let range = range(input, rng);
    if input.len() + part.len() <= LONGEST {
        input.splice(range, part);
    }
}

/// Overwrites a part with a number of one, two, four or eight bytes, in either byte order.
fn replace_word(input: &mut [u8], rng: &mut ChaCha8Rng) {
    let width = 1 << rng.random_range(0..4);
    if input.len() < width {
        return;
    }
    let word = *choice(&WORDS, rng);
    let at = rng.random_range(0..=input.len() - width);
    let bytes =
        if rng.random() { word.to_le_bytes()[..width].to_vec() } else { word.to_be_bytes()[8 - width..].to_vec() };
    input[at..at + width].copy_from_slice(&bytes);
}

/// Replaces a number in text by another one.
fn replace_number(input: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    let is_part = |byte: &u8| byte.is_ascii_digit() || b".-+eE".contains(byte);
    let from = place(input, rng);
    let Some(start) = input[from..].iter().position(u8::is_ascii_digit).map(|found| from + found) else { return };
    let length = input[start..].iter().take_while(|byte| is_part(byte)).count();
    let number = if rng.random() { (*choice(&NUMBERS, rng)).to_owned() } else { rng.random_range(-9..99).to_string() };
    input.splice(start..start + length, number.into_bytes());
}

fn exchange_lines(input: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    let mut lines: Vec<&[u8]> = input.split_inclusive(|&byte| byte == b'\n').collect();
    if lines.len() > 1 {
        let (a, b) = (rng.random_range(0..lines.len()), rng.random_range(0..lines.len()));
        lines.swap(a, b);
        *input = lines.concat();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn equal_seeds_give_equal_inputs_that_differ_and_stay_short() {
        let seeds = [b"a,b\n1.5,2\n3,4\n5e-3,nan\n".to_vec(), b"x;y\n1;2\n".to_vec(), Vec::new()];
        let made = |seed| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            (0..1000).map(|_| mutated(&seeds, &mut rng)).collect::<Vec<_>>()
        };
        let first = made(1);
        assert_eq!(first, made(1));
        assert_ne!(first, made(2));
        let different: std::collections::BTreeSet<_> = first.iter().collect();
        assert!(different.len() > 300 && first.iter().all(|input| input.len() <= LONGEST));
    }
}
