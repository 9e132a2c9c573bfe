//! MATLAB .mat files of version 4 (`save -v4`): one matrix after the other, each with a header of five words.

use super::{Contents, Found};
use crate::array::{array, count};
use crate::bytes::{Bytes, Storage};

/// Returns whether the file may be of version 4. Versions from 5 on begin with four characters of text, and version 4
/// begins with a number below 5000.
pub(super) fn is_likely(bytes: &[u8]) -> bool {
    bytes.len() >= 20 && bytes[..4].contains(&0)
}

/// Reads all matrices of a file.
pub(super) fn read(bytes: &[u8]) -> Result<Vec<Found>, String> {
    // The thousands of the first word give the byte order. In the wrong order, the word is far above 5000.
    let big = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) >= 5000;
    let mut file = Bytes { rest: bytes, big };
    let mut found = Vec::new();
    while !file.rest.is_empty() {
        let at = bytes.len() - file.rest.len();
        found.push(variable(&mut file).map_err(|reason| format!("the matrix at byte {at}: {reason}"))?);
    }
    Ok(found)
}

fn variable(file: &mut Bytes) -> Result<Found, String> {
    let [kind, rows, columns, complex, name_length] =
        [file.word()?, file.word()?, file.word()?, file.word()?, file.word()?];
    let [machine, zero, precision, sort] = [kind / 1000, kind / 100 % 10, kind / 10 % 10, kind % 10];
    if machine != u32::from(file.big) || zero != 0 {
        return Err(format!("its type {kind} is not one of MATLAB 4 on machines with IEEE numbers"));
    }
    let storage = match precision {
        0 => Storage::F64,
        1 => Storage::F32,
        2 => Storage::I32,
        3 => Storage::I16,
        4 => Storage::U16,
        5 => Storage::U8,
        _ => return Err(format!("its type {kind} has no known precision")),
    };
    if complex > 1 {
        return Err(format!("its flag for complex numbers is {complex}"));
    }
    let name = String::from_utf8_lossy(file.take(name_length as usize)?).trim_end_matches('\0').to_string();
    let shape = vec![rows as usize, columns as usize];
    let part = count(&shape)?.checked_mul(storage.width()).ok_or("it is too large")?;
    let data = file.take(part)?;
    if complex == 1 {
        file.take(part)?;
    }
    let contents = match (sort, complex) {
        (0, 0) => Contents::Real(array(&shape, storage.numbers(data, file.big)?, true)?),
        (0, _) => Contents::Other("complex"),
        (1, _) => Contents::Other("text"),
        (2, _) => Contents::Other("a sparse matrix"),
        _ => return Err(format!("its type {kind} is not a kind of matrix")),
    };
    Ok(Found { name, shape, contents })
}
