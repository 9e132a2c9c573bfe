//! MATLAB .mat files of version 5 (`save -v6` or `-v7`): tagged elements, each either a matrix or a compressed one.
//!
//! The format is described in MathWorks, "MAT-File Level 5 File Format". A matrix itself consists of elements: flags,
//! dimensions, a name, and those that its class requires. They must fill the matrix exactly, even where its contents
//! are not used here. A wrong size would otherwise swallow the matrices that follow.

use std::io::Read;

use flate2::read::ZlibDecoder;

use super::{Contents, Found};
use crate::array::{array, count};
use crate::bytes::{Bytes, Storage};

/// Number of bytes before the first element.
const HEADER: usize = 128;

/// The largest ratio by which deflate can expand its input.
const EXPANSION: usize = 1032;

const INT8: u32 = 1;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Reads all matrices of a file.
pub(super) fn read(bytes: &[u8]) -> Result<Vec<Found>, String> {
    let Some((header, rest)) = bytes.split_at_checked(HEADER) else {
        return Err("it is cut off within its header".into());
    };
    let big = match &header[HEADER - 2..] {
        b"IM" => false,
        b"MI" => true,
        _ => return Err("it lacks the signature of a .mat file of version 5".into()),
    };
    // A matrix without a name follows the objects and contains the data that they share. The header states its
    // location.
    let mut subsystem = Bytes { rest: &header[116..120], big };
    let subsystem = subsystem.word()? as usize;
    let mut file = Bytes { rest, big };
    let mut found = Vec::new();
    while !file.rest.is_empty() {
        let at = bytes.len() - file.rest.len();
        let failed = |reason: String| format!("the element at byte {at}: {reason}");
        let one = top_level(&mut file).map_err(failed)?;
        if !(at == subsystem && one.name.is_empty()) {
            found.push(one);
        }
    }
    Ok(found)
}

/// An element: its type and its data.
struct Element<'a> {
    kind: u32,
    data: &'a [u8],
}

/// Reads the next element.
fn element<'a>(from: &mut Bytes<'a>) -> Result<Element<'a>, String> {
    let first = from.word()?;
    // Up to four bytes are stored in the tag itself, and their number is stored next to the type.
    let small = (first >> 16) as usize;
    if small > 0 {
        let data = from.take(4)?;
        let data = data.get(..small).ok_or_else(|| format!("a small element cannot have {small} bytes"))?;
        return Ok(Element { kind: first & 0xffff, data });
    }
    let size = from.word()? as usize;
    let data = from.take(size)?;
    if first != COMPRESSED {
        let padding = size.next_multiple_of(8) - size;
        from.take(padding.min(from.rest.len()))?;
    }
    Ok(Element { kind: first, data })
}

fn top_level(file: &mut Bytes) -> Result<Found, String> {
    let outer = element(file)?;
    match outer.kind {
        MATRIX => variable(outer.data, file.big),
        COMPRESSED => {
            let whole = inflated(outer.data, file.big)?;
            let mut inside = Bytes { rest: &whole, big: file.big };
            let inner = element(&mut inside)?;
            match inner.kind {
                MATRIX if inside.rest.is_empty() => variable(inner.data, file.big),
                MATRIX => Err(format!("{} bytes are left over", inside.rest.len())),
                kind => Err(format!("type {kind} where a matrix is expected")),
            }
        }
        kind => Err(format!("type {kind} where a matrix is expected")),
    }
}

/// Decompresses an element. The result must be as long as its own tag states.
fn inflated(data: &[u8], big: bool) -> Result<Vec<u8>, String> {
    let corrupt = |e: std::io::Error| format!("its compressed data are corrupt: {e}");
    let mut decoder = ZlibDecoder::new(data);
    let mut whole = vec![0; 8];
    decoder.read_exact(&mut whole).map_err(corrupt)?;
    let mut tag = Bytes { rest: &whole[4..], big };
    let size = (tag.word()? as usize).next_multiple_of(8);
    if size > EXPANSION * data.len() {
        return Err(format!("{size} bytes cannot be the contents of {} compressed ones", data.len()));
    }
    decoder.by_ref().take(size as u64 + 1).read_to_end(&mut whole).map_err(corrupt)?;
    if whole.len() > size + 8 {
        return Err(format!("its compressed data contain more than the announced {size} bytes"));
    }
    if decoder.total_in() != data.len() as u64 {
        return Err("there are bytes after its compressed data".into());
    }
    Ok(whole)
}

/// Reads a matrix.
fn variable(data: &[u8], big: bool) -> Result<Found, String> {
    let mut parts = Bytes { rest: data, big };
    let flags = expect(&mut parts, UINT32, "flags")?;
    let flags = Bytes { rest: flags, big }.word()?;
    let (class, is_complex) = (flags & 0xff, flags & 0x800 != 0);
    // Opaque objects have no dimensions.
    let shape = if class == 17 { Vec::new() } else { dimensions(expect(&mut parts, INT32, "dimensions")?, big)? };
    let name = String::from_utf8_lossy(expect(&mut parts, INT8, "name")?).into_owned();
    let contents =
        contents(parts, class, is_complex, &shape).map_err(|reason| format!("variable `{name}`: {reason}"))?;
    Ok(Found { name, shape, contents })
}

fn dimensions(data: &[u8], big: bool) -> Result<Vec<usize>, String> {
    let sizes = Storage::I32.numbers(data, big)?;
    if sizes.len() < 2 || sizes.iter().any(|&size| size < 0.0) {
        return Err(format!("{sizes:?} are not dimensions"));
    }
    Ok(sizes.into_iter().map(|size| size as usize).collect())
}

/// Reads the next element, which must have the given type.
fn expect<'a>(parts: &mut Bytes<'a>, kind: u32, what: &str) -> Result<&'a [u8], String> {
    let part = element(parts).map_err(|reason| format!("its {what}: {reason}"))?;
    // Names may be stored in any text encoding, and some programs write dimensions as unsigned integers.
    let is_it = part.kind == kind || matches!((kind, part.kind), (INT8, 2 | 16) | (INT32, UINT32));
    if is_it { Ok(part.data) } else { Err(format!("type {} where its {what} is expected", part.kind)) }
}

/// Reads the elements that a class requires after the name. `parts` must contain these elements and nothing else.
fn contents(mut parts: Bytes, class: u32, is_complex: bool, shape: &[usize]) -> Result<Contents, String> {
    let numeric = 1 + usize::from(is_complex);
    let (wanted, what) = match class {
        1 => (count(shape)?, "a cell array"),
        2 => (fields(&mut parts, shape)?, "a struct"),
        3 => {
            expect(&mut parts, INT8, "class name")?;
            (fields(&mut parts, shape)?, "an object")
        }
        4 => (1, "text"),
        5 => (2 + numeric, "a sparse matrix"),
        6..=15 if is_complex => (2, "complex"),
        6..=15 => return Ok(Contents::Real(array(shape, numbers(parts)?, true)?)),
        16 => (1, "a function handle"),
        17 => (3, "an object"),
        _ => return Err(format!("there is no class {class}")),
    };
    for _ in 0..wanted {
        element(&mut parts)?;
    }
    if parts.rest.is_empty() { Ok(Contents::Other(what)) } else { Err(left_over(&parts)) }
}

/// Reads the names of the fields of a struct, and returns the number of elements that follow for the fields.
fn fields(parts: &mut Bytes, shape: &[usize]) -> Result<usize, String> {
    let width = Bytes { rest: expect(parts, INT32, "length of a field's name")?, big: parts.big }.word()? as usize;
    let names = expect(parts, INT8, "fields' names")?.len();
    if names > 0 && (width == 0 || !names.is_multiple_of(width)) {
        return Err(format!("{names} bytes are not a list of names of {width} bytes each"));
    }
    let fields = names.checked_div(width).unwrap_or(0);
    count(shape)?.checked_mul(fields).ok_or_else(|| "it is too large".to_string())
}

/// Reads the numbers of a real array, whatever their storage type is.
fn numbers(mut parts: Bytes) -> Result<Vec<f64>, String> {
    let part = element(&mut parts)?;
    if !parts.rest.is_empty() {
        return Err(left_over(&parts));
    }
    let storage = match part.kind {
        1 => Storage::I8,
        2 => Storage::U8,
        3 => Storage::I16,
        4 => Storage::U16,
        5 => Storage::I32,
        6 => Storage::U32,
        7 => Storage::F32,
        9 => Storage::F64,
        12 => Storage::I64,
        13 => Storage::U64,
        kind => return Err(format!("type {kind} where its numbers are expected")),
    };
    storage.numbers(part.data, parts.big)
}

fn left_over(parts: &Bytes) -> String {
    format!("{} bytes are left over", parts.rest.len())
}
