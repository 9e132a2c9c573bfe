//! Salted hashes of sealed files, against which guesses cannot be tested.

use plid_file::{digest, hex};

/// Returns the SHA-256 of salt, case, name and content. Each part is preceded by its length, so that different parts
/// never give the same bytes.
pub(crate) fn salted(salt: &str, case: &str, file: &str, bytes: &[u8]) -> String {
    hex(of_parts(&[salt.as_bytes(), case.as_bytes(), file.as_bytes(), bytes]))
}

/// Derives 256 bits for one purpose from the seed.
pub(crate) fn derived(seed: u64, purpose: &str, index: usize) -> [u8; 32] {
    of_parts(&[b"plid-trial", &seed.to_le_bytes(), purpose.as_bytes(), &(index as u64).to_le_bytes()])
}

/// Returns the salt of a trial.
pub(crate) fn salt(seed: u64) -> String {
    hex(derived(seed, "salt", 0))
}

fn of_parts(parts: &[&[u8]]) -> [u8; 32] {
    let mut bytes = Vec::new();
    for part in parts {
        bytes.extend((part.len() as u64).to_le_bytes());
        bytes.extend(*part);
    }
    digest(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_counts() {
        let all = [
            salted("s", "case-1", "a", b"x"),
            salted("t", "case-1", "a", b"x"),
            salted("s", "case-2", "a", b"x"),
            salted("s", "case-1", "b", b"x"),
            salted("s", "case-1", "a", b"y"),
            salted("sc", "ase-1", "a", b"x"),
        ];
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| a != b));
        }
        assert_ne!(derived(1, "case", 0), derived(1, "case", 1));
        assert_ne!(derived(1, "case", 0), derived(2, "case", 0));
        assert_ne!(salt(1), salt(2));
    }
}
