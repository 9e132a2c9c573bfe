//! Units as products of powers: "N m/rad^3" is N, m and rad with the exponents 1, 1 and -3.

use std::fmt;

/// A product of powers of symbols, in the order in which they first appeared.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Unit(Vec<(String, i32)>);

impl Unit {
    /// Reads a unit such as "m/s^2", "N*m", "N m/(rad/s)" or "m/s2". A slash divides by the next factor only. A text
    /// that is not such a product counts as one symbol.
    pub fn read(text: &str) -> Self {
        let letters: Vec<char> = text.trim().chars().collect();
        let mut reader = Reader { letters: &letters, at: 0 };
        match reader.product() {
            Some(unit) if reader.at == letters.len() => unit,
            _ => Self::one(text.trim()),
        }
    }

    /// Returns a symbol as a unit.
    pub fn one(symbol: &str) -> Self {
        Self(vec![(symbol.to_string(), 1)])
    }

    /// Returns the product with a power of another unit.
    pub fn times(&self, other: &Self, power: i32) -> Self {
        let mut product = self.clone();
        for (symbol, exponent) in &other.0 {
            match product.0.iter_mut().find(|(known, _)| known == symbol) {
                Some((_, known)) => *known += exponent * power,
                None => product.0.push((symbol.clone(), exponent * power)),
            }
        }
        product.0.retain(|(_, exponent)| *exponent != 0);
        product
    }

    /// Returns the unit in which each symbol is replaced by a unit.
    pub fn with(&self, in_place_of: impl Fn(&str) -> Self) -> Self {
        self.0.iter().fold(Self::default(), |whole, (symbol, power)| whole.times(&in_place_of(symbol), *power))
    }

    /// Returns whether a symbol occurs in it.
    pub fn has(&self, symbol: &str) -> bool {
        self.0.iter().any(|(own, _)| own == symbol)
    }
}

/// Writes a unit such as "N m/rad^3", "1/(m s)" or "1".
impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let part = |of: i32| -> Vec<String> {
            let own = self.0.iter().filter(|(_, exponent)| exponent.signum() == of);
            let power = |(symbol, exponent): &(String, i32)| match exponent.abs() {
                1 => symbol.clone(),
                exponent => format!("{symbol}^{exponent}"),
            };
            own.map(power).collect()
        };
        let (above, below) = (part(1).join(" "), part(-1));
        f.write_str(if above.is_empty() { "1" } else { &above })?;
        match below.as_slice() {
            [] => Ok(()),
            [one] => write!(f, "/{one}"),
            several => write!(f, "/({})", several.join(" ")),
        }
    }
}

struct Reader<'t> {
    letters: &'t [char],
    at: usize,
}

impl Reader<'_> {
    fn next(&self) -> Option<char> {
        self.letters.get(self.at).copied()
    }

    fn product(&mut self) -> Option<Unit> {
        let mut unit = self.factor()?;
        loop {
            let before = self.at;
            while self.next() == Some(' ') {
                self.at += 1;
            }
            let power = match self.next() {
                None | Some(')') => return Some(unit),
                Some('/') => -1,
                Some('*' | '·' | '.') => 1,
                Some(_) if self.at > before => {
                    unit = unit.times(&self.factor()?, 1);
                    continue;
                }
                Some(_) => return None,
            };
            self.at += 1;
            while self.next() == Some(' ') {
                self.at += 1;
            }
            unit = unit.times(&self.factor()?, power);
        }
    }

    fn factor(&mut self) -> Option<Unit> {
        let base = match self.next()? {
            '(' => {
                self.at += 1;
                let inside = self.product()?;
                (self.next() == Some(')')).then(|| self.at += 1)?;
                inside
            }
            '1' => {
                self.at += 1;
                Unit::default()
            }
            _ => {
                let start = self.at;
                while self.next().is_some_and(|c| c.is_alphabetic() || matches!(c, '%' | '°' | '_' | '\'')) {
                    self.at += 1;
                }
                if self.at == start {
                    return None;
                }
                Unit(vec![(self.letters[start..self.at].iter().collect(), 1)])
            }
        };
        Some(Unit::default().times(&base, self.exponent()?))
    }

    /// Reads an exponent such as "^2", "^-1", "2" or a raised digit (² or ³). It is 1 if the text has none.
    fn exponent(&mut self) -> Option<i32> {
        let raised = match self.next() {
            Some('²') => Some(2),
            Some('³') => Some(3),
            _ => None,
        };
        if let Some(power) = raised {
            self.at += 1;
            return Some(power);
        }
        let marked = self.next() == Some('^');
        self.at += usize::from(marked);
        let start = self.at;
        self.at += usize::from(self.next() == Some('-'));
        while self.next().is_some_and(|c| c.is_ascii_digit()) {
            self.at += 1;
        }
        let text: String = self.letters[start..self.at].iter().collect();
        if text.is_empty() && !marked { Some(1) } else { text.parse().ok() }
    }
}

#[cfg(test)]
mod tests {
    use super::Unit;

    #[test]
    fn units_are_read_and_written_as_products() {
        for (text, written) in [
            ("m/s^2", "m/s^2"),
            ("m/s2", "m/s^2"),
            ("m s^-2", "m/s^2"),
            ("m/s²", "m/s^2"),
            ("N*m", "N m"),
            ("N m/(rad/s)", "N m s/rad"),
            ("kg/m/s", "kg/(m s)"),
            ("1/s", "1/s"),
            ("1", "1"),
            ("m/m", "1"),
            ("as recorded", "as recorded"),
            // Not a product: one symbol.
            ("9.81 m/s^2", "9.81 m/s^2"),
            ("m/", "m/"),
        ] {
            assert_eq!(Unit::read(text).to_string(), written, "{text}");
        }
        let (force, displacement) = (Unit::read("N m"), Unit::read("m"));
        assert_eq!(force.times(&displacement, -3).to_string(), "N/m^2");
    }
}
