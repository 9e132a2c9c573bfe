use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// The file in the folder of a shard whose presence shows that the shard is complete.
pub const SHARD: &str = "shard.json";

/// The folder of all shards in the folder of the whole task.
pub const SHARDS: &str = "shards";

/// A shard of a task that consists of parts, such as cases or runs. It contains every `of`-th part, starting at
/// `number`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Numbers")]
pub struct Shard {
    /// Number of the shard, from 1 to `of`.
    pub number: usize,
    /// Total number of shards.
    pub of: usize,
}

/// A shard as it is stored in a file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Numbers {
    number: usize,
    of: usize,
}

impl TryFrom<Numbers> for Shard {
    type Error = String;

    fn try_from(Numbers { number, of }: Numbers) -> Result<Self, String> {
        let shard = Self { number, of };
        if (1..=of).contains(&number) { Ok(shard) } else { Err(format!("there is no {shard}")) }
    }
}

impl Shard {
    /// Returns whether a part belongs to the shard, by its index from 0.
    #[must_use]
    pub fn has(self, index: usize) -> bool {
        index % self.of == self.number - 1
    }

    /// Returns the shard's own folder in the folder of the whole task.
    #[must_use]
    pub fn folder(self, whole: &Path) -> PathBuf {
        whole.join(SHARDS).join(format!("{}-of-{}", self.number, self.of))
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "shard {} of {}", self.number, self.of)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match numbers {
            Some((number, of)) if (1..=of).contains(&number) => Ok(Self { number, of }),
            _ => Err(format!("`{text}` is not a shard: give i/N, with i from 1 to N")),
        }
    }
}

/// Returns the folders of the shards in the folder of the whole task, sorted by name. There are none if no shard was
/// begun.
///
/// # Errors
/// Returns the error of the file system.
pub fn shard_folders(whole: &Path) -> io::Result<Vec<PathBuf>> {
    let entries = match fs::read_dir(whole.join(SHARDS)) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let mut found = entries.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<PathBuf>>>()?;
    found.retain(|path| path.is_dir());
    found.sort();
    Ok(found)
}

/// Largest number of missing shards that are named, because a file may state any number of shards.
const NAMED: usize = 20;

/// Checks that each shard of a task is among `found` exactly once, and returns their number.
///
/// # Errors
/// Returns a sentence with the number of a shard that is missing, that occurs twice, or that belongs to a division
/// into another number of shards.
pub fn require_whole(found: &[(Shard, PathBuf)]) -> Result<usize, String> {
    let Some((Shard { of, .. }, _)) = found.first() else { return Err("there is no shard to merge".to_owned()) };
    let mut places = BTreeMap::new();
    for (shard, folder) in found {
        if shard.of != *of {
            return Err(format!("shard {} is one of {}, but others are of {of}", shard.number, shard.of));
        }
        if let Some(first) = places.insert(shard.number, folder) {
            return Err(format!("{shard} is given twice: {} and {}", first.display(), folder.display()));
        }
    }
    let all = (1..=*of).filter(|i| !places.contains_key(i)).map(|i| i.to_string());
    let missing: Vec<String> = all.take(NAMED).collect();
    let others = of - places.len() - missing.len();
    match missing.as_slice() {
        [] => Ok(*of),
        [one] => Err(format!("shard {one} of {of} is missing")),
        several if others == 0 => Err(format!("shards {} of {of} are missing", several.join(", "))),
        several => Err(format!("shards {} and {others} others of {of} are missing", several.join(", "))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_share_out_all_parts() {
        assert_eq!("3/4".parse(), Ok(Shard { number: 3, of: 4 }));
        for wrong in ["0/4", "5/4", "3", "a/b", "1/0", "-1/2"] {
            assert!(wrong.parse::<Shard>().unwrap_err().contains("i/N"), "{wrong}");
        }
        for (number, of) in [(0, 4), (5, 4), (1, 0), (0, 0)] {
            assert_eq!(Shard::try_from(Numbers { number, of }), Err(format!("there is no shard {number} of {of}")));
        }
        for index in 0..20 {
            let of: Vec<usize> = (1..=4).filter(|&number| Shard { number, of: 4 }.has(index)).collect();
            assert_eq!(of, [index % 4 + 1]);
        }
    }

    #[test]
    fn each_shard_is_needed_once() {
        let check = |list: &[&str]| {
            let found: Vec<_> = list.iter().map(|text| (text.parse().unwrap(), PathBuf::from(text))).collect();
            require_whole(&found)
        };
        assert_eq!(check(&["2/3", "1/3", "3/3"]), Ok(3));
        let said = |list: &[&str]| check(list).unwrap_err();
        assert_eq!(said(&[]), "there is no shard to merge");
        assert_eq!(said(&["1/3", "3/3"]), "shard 2 of 3 is missing");
        assert_eq!(said(&["2/3"]), "shards 1, 3 of 3 are missing");
        let many = said(&["2/1000000000000"]);
        assert!(many.starts_with("shards 1, 3, 4, "), "{many}");
        assert!(many.ends_with(", 21 and 999999999979 others of 1000000000000 are missing"), "{many}");
        assert_eq!(said(&["1/3", "2/2"]), "shard 2 is one of 2, but others are of 3");
        assert_eq!(said(&["1/2", "2/2", "2/2"]), "shard 2 of 2 is given twice: 2/2 and 2/2");
    }

    #[test]
    fn the_folders_of_shards_are_found_by_name() {
        let folder = tempfile::tempdir().unwrap();
        assert!(shard_folders(folder.path()).unwrap().is_empty());
        let shards = ["2/2", "1/2"].map(|text| text.parse::<Shard>().unwrap().folder(folder.path()));
        shards.iter().for_each(|path| fs::create_dir_all(path).unwrap());
        fs::write(folder.path().join("shards/notes.txt"), "").unwrap();
        assert_eq!(shard_folders(folder.path()).unwrap(), [shards[1].clone(), shards[0].clone()]);
    }
}
