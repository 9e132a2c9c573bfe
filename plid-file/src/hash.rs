//! SHA-256, as FIPS 180-4 defines it.

use std::io;

use sha2::{Digest, Sha256};

/// Returns the 256 bits of SHA-256.
#[must_use]
pub fn digest(bytes: impl AsRef<[u8]>) -> [u8; 32] {
    Sha256::digest(bytes).into()
}

/// Returns bytes in hexadecimal, two lower-case digits each.
#[must_use]
pub fn hex(bytes: impl AsRef<[u8]>) -> String {
    bytes.as_ref().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns SHA-256 in hexadecimal, 64 digits.
#[must_use]
pub fn sha256(bytes: impl AsRef<[u8]>) -> String {
    hex(digest(bytes))
}

/// Returns SHA-256 of the running executable in hexadecimal. Two builds of one commit differ where their executables
/// do.
///
/// # Errors
/// Returns the error of the file system if the executable cannot be found or read.
pub fn executable_sha256() -> io::Result<String> {
    Ok(sha256(std::fs::read(std::env::current_exe()?)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_the_standard() {
        // FIPS 180-4's example.
        assert_eq!(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }

    #[test]
    fn the_executable_is_the_file_that_runs() {
        let file = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        assert_eq!(executable_sha256().unwrap(), sha256(file));
    }
}
