//! SHA-256, as FIPS 180-4 defines it.

use std::io::{self, Read};

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

/// A reader that hashes the bytes that pass through it.
#[derive(Clone, Debug)]
pub struct Hashing<R> {
    inner: R,
    hash: Sha256,
}

impl<R: Read> Hashing<R> {
    /// Wraps a reader.
    pub fn new(inner: R) -> Self {
        Self { inner, hash: Sha256::new() }
    }

    /// Reads the rest and returns the 256 bits of SHA-256 over all bytes.
    ///
    /// # Errors
    /// Returns the error of the reader.
    pub fn digest(mut self) -> io::Result<[u8; 32]> {
        io::copy(&mut self, &mut io::sink())?;
        Ok(self.hash.finalize().into())
    }

    /// Reads the rest and returns SHA-256 over all bytes in hexadecimal.
    ///
    /// # Errors
    /// Returns the error of the reader.
    pub fn sha256(self) -> io::Result<String> {
        self.digest().map(hex)
    }
}

impl<R: Read> Read for Hashing<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.hash.update(&buffer[..count]);
        Ok(count)
    }
}

/// Returns SHA-256 of the running executable in hexadecimal. Two builds of one commit have different hashes if their
/// executables differ.
///
/// # Errors
/// Returns the error of the file system if the executable cannot be found or read.
pub fn executable_sha256() -> io::Result<String> {
    Hashing::new(std::fs::File::open(std::env::current_exe()?)?).sha256()
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
    fn a_reader_hashes_what_is_read_and_the_rest() {
        let mut reader = Hashing::new(&b"abc"[..]);
        reader.read_exact(&mut [0; 2]).unwrap();
        assert_eq!(reader.sha256().unwrap(), sha256("abc"));
    }

    #[test]
    fn the_executable_is_the_file_that_runs() {
        let file = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        assert_eq!(executable_sha256().unwrap(), sha256(file));
    }
}
