//! The grid of a sweep: an experiment, and the values of its varied keys.

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::de::{DeTable, DeValue, ValueDeserializer};
use toml::{Spanned, Table, Value};

use crate::experiment::Experiment;
use plid_data::config::{ConfigError, error_at, from_toml};

/// Largest number of points, so that a typing error does not fill a disk.
const MOST: usize = 1_000_000;

/// A grid of experiments.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// The name of the file without its extension.
    pub name: String,
    /// The experiment whose keys are varied, as it is written in its file.
    pub base: Table,
    /// The folder to which the paths in the experiment are relative.
    pub folder: PathBuf,
    /// The keys that are varied, in the order of the file.
    pub varied: Vec<Varied>,
}

/// A key that is varied.
#[derive(Clone, Debug)]
pub struct Varied {
    /// The dotted key, such as `structure.states`.
    pub key: String,
    /// Its values.
    pub values: Vec<Value>,
    /// Its place in the file.
    place: Range<usize>,
}

/// The contents of the file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    experiment: PathBuf,
    #[serde(rename = "vary")]
    _vary: Table,
}

impl Sweep {
    /// Reads a sweep and its experiment, and checks that every point of the grid can be read as an experiment.
    ///
    /// # Errors
    /// Returns a [`ConfigError`] with the file, the line and the key.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let (text, name) = (contents(path)?, path.display().to_string());
        let file: File = from_toml(&text, &name)?;
        let experiment = path.parent().unwrap_or(Path::new("")).join(&file.experiment);
        let (base, of_base) = (contents(&experiment)?, experiment.display().to_string());
        // An error in the experiment itself is reported with its own line.
        from_toml::<Experiment>(&base, &of_base)?;
        let sweep = Self {
            name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            base: from_toml(&base, &of_base)?,
            folder: experiment.parent().unwrap_or(Path::new("")).into(),
            varied: varied(&text, &name)?,
        };
        match sweep.problem() {
            None => Ok(sweep),
            Some((varied, reason)) => {
                Err(error_at(&text, &name, varied.place.clone(), &format!("vary.{}", varied.key), &reason))
            }
        }
    }

    /// Returns the number of points.
    pub fn points(&self) -> usize {
        self.count().expect("checked when the sweep was read")
    }

    fn count(&self) -> Option<usize> {
        self.varied.iter().try_fold(1_usize, |count, varied| count.checked_mul(varied.values.len()))
    }

    /// Returns the values of the varied keys at a point, by its index from 0. The last key varies fastest.
    pub fn values(&self, index: usize) -> Vec<&Value> {
        let mut rest = index;
        let pick = |varied: &'_ Varied| {
            let digit = rest % varied.values.len();
            rest /= varied.values.len();
            digit
        };
        let mut digits: Vec<usize> = self.varied.iter().rev().map(pick).collect();
        digits.reverse();
        self.varied.iter().zip(digits).map(|(varied, digit)| &varied.values[digit]).collect()
    }

    /// Returns the experiment of a point.
    pub fn experiment(&self, index: usize) -> Experiment {
        self.with(index, self.varied.len()).expect("checked when the sweep was read")
    }

    /// Returns the experiment with the first `count` varied keys set to the values of a point.
    fn with(&self, index: usize, count: usize) -> Result<Experiment, String> {
        let mut table = self.base.clone();
        for (varied, value) in self.varied.iter().zip(self.values(index)).take(count) {
            set(&mut table, &varied.key, value.clone())?;
        }
        table.try_into().map_err(|error: toml::de::Error| error.message().to_owned())
    }

    /// Returns a key that makes the sweep impossible, and the reason.
    fn problem(&self) -> Option<(&Varied, String)> {
        for (number, varied) in self.varied.iter().enumerate() {
            let within =
                |other: &&Varied| varied.key == other.key || varied.key.starts_with(&(other.key.clone() + "."));
            let others = self.varied[..number].iter().chain(&self.varied[number + 1..]);
            if let Some(other) = others.clone().find(within) {
                return Some((varied, format!("it is part of `{}`, which is varied, too", other.key)));
            }
        }
        if self.count().is_none_or(|count| count > MOST) {
            return Some((self.varied.last()?, format!("the grid has more than {MOST} points")));
        }
        let index = (0..self.points()).find(|&index| self.with(index, self.varied.len()).is_err())?;
        // The first key with which the experiment becomes invalid.
        (1..=self.varied.len()).find_map(|count| Some((&self.varied[count - 1], self.with(index, count).err()?)))
    }
}

fn contents(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.into(), source })
}

/// Sets a dotted key, and creates the tables that lead to it.
fn set(table: &mut Table, key: &str, value: Value) -> Result<(), String> {
    let (first, rest) = key.split_once('.').map_or((key, None), |(first, rest)| (first, Some(rest)));
    let Some(rest) = rest else {
        table.insert(first.to_owned(), value);
        return Ok(());
    };
    match table.entry(first).or_insert_with(|| Table::new().into()) {
        Value::Table(inner) => set(inner, rest, value),
        _ => Err(format!("`{first}` of the experiment is not a table")),
    }
}

/// Returns the keys of `[vary]` with their values, in the order of the file.
fn varied(text: &str, name: &str) -> Result<Vec<Varied>, ConfigError> {
    let document = DeTable::parse(text).expect("the text was parsed before");
    let (_, vary) = document.get_ref().iter().find(|(key, _)| key.get_ref() == "vary").expect("required by the file");
    let mut found = Vec::new();
    collect("", vary.span(), vary, &mut found);
    found.sort_by_key(|(_, place, _)| place.start);
    let list = |(key, place, value): (String, Range<usize>, &Spanned<DeValue<'_>>)| {
        let error = |key: &str, reason: &str| error_at(text, name, place.clone(), key, reason);
        if key.is_empty() {
            return Err(error(
                "vary",
                "give at least one key with a list of values, as in `structure.states = [8, 12]`",
            ));
        }
        match value.get_ref() {
            DeValue::Array(items) if !items.is_empty() => {
                let value = Value::deserialize(ValueDeserializer::from(value.clone()));
                let values = match value {
                    Ok(Value::Array(values)) => values,
                    _ => return Err(error(&format!("vary.{key}"), "one of its values cannot be read")),
                };
                Ok(Varied { key, values, place })
            }
            _ => Err(error(&format!("vary.{key}"), "give a list of at least one value")),
        }
    };
    found.into_iter().map(list).collect()
}

/// Collects dotted key, place and value of everything in a table that is not itself a table. Quoted keys with dots are
/// equivalent to keys in tables.
fn collect<'d, 'i>(
    key: &str,
    place: Range<usize>,
    value: &'d Spanned<DeValue<'i>>,
    found: &mut Vec<(String, Range<usize>, &'d Spanned<DeValue<'i>>)>,
) {
    match value.get_ref() {
        DeValue::Table(table) if !table.is_empty() => {
            for (name, value) in table {
                let key = if key.is_empty() { name.get_ref().to_string() } else { format!("{key}.{}", name.get_ref()) };
                collect(&key, name.span(), value, found);
            }
        }
        _ => found.push((key.to_owned(), place, value)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BASE: &str = "name = \"b\"\n[data]\nfiles = [\"r.csv\"]\ninputs = [\"u\"]\noutputs = [\"y\"]\n";

    fn read(base: &str, vary: &str) -> Result<Sweep, String> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("base.toml"), base).unwrap();
        let path = folder.path().join("orders.toml");
        std::fs::write(&path, format!("experiment = \"base.toml\"\n{vary}")).unwrap();
        Sweep::read(&path).map_err(|error| {
            let help = miette::Diagnostic::help(&error).map(|help| format!(" ({help})")).unwrap_or_default();
            format!("{error}{help}").replace(&format!("{}/", folder.path().display()), "")
        })
    }

    #[test]
    fn the_grid_has_every_combination_in_the_order_of_the_file() {
        let vary = "[vary]\nstructure.states = [2, 4]\n\"noise.from\" = [\"tuned\", \"paper-literal\"]\n";
        for vary in [vary, "[vary.structure]\nstates = [2, 4]\n[vary.noise]\nfrom = [\"tuned\", \"paper-literal\"]\n"] {
            let sweep = read(BASE, vary).unwrap();
            assert_eq!((sweep.name.as_str(), sweep.points()), ("orders", 4));
            let shown: Vec<String> = (0..4).map(|index| format!("{:?}", sweep.values(index))).collect();
            assert_eq!(shown[1], "[Integer(2), String(\"paper-literal\")]");
            assert_eq!(shown[2], "[Integer(4), String(\"tuned\")]");
            let experiment = sweep.experiment(2);
            assert_eq!((experiment.structure.states, experiment.name.as_str()), (Some(4), "b"));
        }
        // A list can be a value, too.
        let sweep = read(BASE, "[vary]\nstructure.indices = [[2], [4]]").unwrap();
        assert_eq!(sweep.points(), 2);
    }

    #[test]
    fn what_is_wrong_is_said_with_file_line_and_key() {
        let said = |base: &str, vary: &str| read(base, vary).unwrap_err();
        let is = |vary: &str, expected: &str| {
            let found = said(BASE, vary);
            assert!(found.contains(expected), "{found}");
        };
        is("[vary]\nstructure.sates = [2]", "orders.toml, line 3: vary.structure.sates: unknown field `sates`");
        is("[vary]\nstructure.sates = [2]", "(did you mean `states`?)");
        is("[vary]\nstructure.states = [2]\n[vary.nose]\nfrom = [\"tuned\"]", "line 5: vary.nose.from: unknown field");
        is("[vary]\nstructure.states = [2, \"x\"]", "line 3: vary.structure.states: invalid type: string \"x\"");
        is("[vary]\nstructure.states = []", "line 3: vary.structure.states: give a list of at least one value");
        is("[vary]\nstructure.states = 4", "line 3: vary.structure.states: give a list of at least one value");
        is("[vary]\n", "line 2: vary: give at least one key");
        is("[vary]\nname = [\"a\", nan]", "nan is not a finite number");
        is("[varied]\nname = [\"a\"]", "orders.toml, line 2: unknown field `varied`");
        is("[vary]\n\"noise.from\" = [\"tuned\"]\nnoise = [{}]", "line 3: vary.noise.from: it is part of `noise`");
        let long = format!("[{}]", "1, ".repeat(1001));
        is(&format!("[vary]\nstructure.states = {long}\nvalidation.lags = {long}"), "more than 1000000 points");
        let word = "structure = \"simo-merge\"\n".to_owned() + BASE;
        assert!(said(&word, "[vary]\nstructure.states = [2]").contains("`structure` of the experiment is not a table"));
        assert!(said("nam = 1", "[vary]\nname = [\"a\"]").contains("base.toml, line 1: unknown field `nam`"));
        let missing = Sweep::read(Path::new("no/such.toml")).unwrap_err().to_string();
        assert!(missing.starts_with("no/such.toml: "), "{missing}");
    }
}
