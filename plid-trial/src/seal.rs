//! Hashes of answers, and salted hashes of sealed files, against which guesses cannot be tested.

use sha2::{Digest, Sha256};

fn hex(bytes: impl IntoIterator<Item = u8>) -> String {
    bytes.into_iter().map(|byte| format!("{byte:02x}")).collect()
}

/// SHA-256 as text.
pub(crate) fn sha256(bytes: &[u8]) -> String {
    hex(Sha256::digest(bytes))
}

/// Returns SHA-256 of salt, case, name and content. Each part is preceded by its length, so that different parts never
/// give the same bytes.
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
    let mut hash = Sha256::new();
    for part in parts {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    hash.finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_the_standard() {
        // FIPS 180-4's example.
        assert_eq!(sha256(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }

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
