//! NumPy .npz archives and .npy arrays.
//!
//! The [format](https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html) consists of a header, which is
//! a flat dictionary in Python's notation, and the numbers. Every size in the header is checked against the number of
//! bytes in the file before it is used.
use super::DataError;
use super::array::{array, count};
use super::bytes::Storage;
use super::table::Content;
use super::variables::{Variable, assemble};
use ndarray::ArrayD;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// The largest ratio by which deflate can expand its input.
const EXPANSION: u64 = 1032;

/// A real array, or a description of an array that does not contain real numbers.
type Array = Result<ArrayD<f64>, &'static str>;

/// Reads an archive of named arrays.
pub(super) fn read_npz(path: &Path, bytes: &[u8], variable: Option<&str>) -> Result<Content, DataError> {
    let malformed = |what: String| DataError::Malformed { file: path.into(), what };
    let unreadable = |e: zip::result::ZipError| malformed(format!("not a readable .npz archive: {e}"));
    require_directory(bytes).map_err(malformed)?;
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(unreadable)?;
    let mut variables = Vec::new();
    for index in 0..archive.len() {
        let member = archive.by_index(index).map_err(unreadable)?;
        let file = member.name().to_string();
        let name = file.strip_suffix(".npy").unwrap_or(&file).to_string();
        let failed = |e: String| malformed(format!("array `{name}`: {e}"));
        let most = EXPANSION.saturating_mul(member.compressed_size()).saturating_add(EXPANSION);
        let mut content = Vec::new();
        member.take(most).read_to_end(&mut content).map_err(|e| failed(e.to_string()))?;
        let found = read_array(content.as_slice(), content.len() as u64).map_err(failed)?;
        variables.push(match found {
            Ok(values) => Variable::new(name, values, false),
            Err(what) => Variable::unusable(name, Vec::new(), what),
        });
    }
    assemble(path, variables, variable)
}

/// Checks that the file is long enough for the number of entries that its directory announces, because `zip` first
/// allocates memory for them. The end of the file states this number twice, in 16 bits or, for a large archive, in 64.
///
/// As `zip` does, the search goes backwards from the end of the file to the first sound end of a directory. The data
/// before it may contain the same marks by chance.
fn require_directory(bytes: &[u8]) -> Result<(), String> {
    /// Bytes of an entry without its name.
    const ENTRY: u64 = 46;
    /// Bytes of the record that points to the directory's 64-bit end.
    const LOCATOR: usize = 20;
    let mut before = bytes.len();
    while let Some(at) = bytes[..before].windows(4).rposition(|mark| mark == b"PK\x05\x06") {
        before = at + 3;
        let mut counts = vec![number(bytes, at + 8, 2), number(bytes, at + 10, 2)];
        let mut directory = number(bytes, at + 16, 4);
        let locator = at.checked_sub(LOCATOR).filter(|&locator| bytes[locator..].starts_with(b"PK\x06\x07"));
        let large = locator.and_then(|locator| {
            let from = usize::try_from(number(bytes, locator + 8, 8)).ok()?;
            let found = bytes.get(from..locator)?.windows(4).position(|mark| mark == b"PK\x06\x06")?;
            Some(from + found)
        });
        if let Some(large) = large {
            counts.extend([number(bytes, large + 24, 8), number(bytes, large + 32, 8)]);
            directory = number(bytes, large + 48, 8);
        }
        let entries = counts.into_iter().fold(0, u64::max);
        if entries.saturating_mul(ENTRY) > at as u64 {
            return Err(format!("not a readable .npz archive: {entries} arrays are announced in {at} bytes"));
        }
        let stated = usize::try_from(directory).ok().and_then(|directory| bytes.get(directory..at));
        if stated.is_some_and(|stated| stated.starts_with(b"PK\x01\x02")) {
            break;
        }
    }
    Ok(())
}

/// Returns the unsigned number in some bytes, the lowest byte first. Bytes beyond the end of the file count as zero.
fn number(bytes: &[u8], at: usize, count: usize) -> u64 {
    let there = bytes.get(at..).unwrap_or_default();
    there.iter().take(count).rev().fold(0, |number, &byte| number << 8 | u64::from(byte))
}

/// Reads a single array from a file of `length` bytes. Its columns are numbered.
pub(super) fn read_npy(path: &Path, file: impl Read, length: u64) -> Result<Content, DataError> {
    let malformed = |what: String| DataError::Malformed { file: path.into(), what };
    let values = read_array(file, length)
        .map_err(|e| malformed(format!("not a readable .npy array: {e}")))?
        .map_err(|what| malformed(format!("the array does not hold real numbers: it is {what}")))?;
    assemble(path, vec![Variable::new("1".into(), values, false)], None)
}

/// Opens a matrix or a vector in a file of `length` bytes, to be read row by row.
pub(super) fn open_npy<R: Read>(path: &Path, file: R, length: u64) -> Result<NpyRows<R>, DataError> {
    let malformed = |what: String| DataError::Malformed { file: path.into(), what };
    let numbers = Numbers::open(file, length)
        .map_err(|e| malformed(format!("not a readable .npy array: {e}")))?
        .map_err(|what| malformed(format!("the array does not hold real numbers: it is {what}")))?;
    let columns = match numbers.shape.as_slice() {
        [_] => 1,
        [_, columns] if *columns > 0 => *columns,
        _ => return Err(malformed("only an array of two dimensions can be read in blocks of rows".into())),
    };
    if numbers.by_columns && columns > 1 {
        return Err(malformed(
            "its numbers are stored by columns (Fortran order), so it cannot be read in blocks of rows; save it with \
             numpy.ascontiguousarray"
                .into(),
        ));
    }
    let rows = numbers.shape[0];
    Ok(NpyRows { numbers, file: path.into(), rows, columns })
}

/// The rows of a matrix in the .npy format, read in blocks.
pub(super) struct NpyRows<R> {
    numbers: Numbers<R>,
    file: PathBuf,
    /// Rows that have not yet been read.
    pub rows: usize,
    pub columns: usize,
}

impl<R: Read> NpyRows<R> {
    /// Reads the next rows, at most `most` of them, into `values`, and returns their number.
    pub fn next(&mut self, most: usize, values: &mut Vec<f64>) -> Result<usize, DataError> {
        let rows = most.min(self.rows);
        self.rows -= rows;
        let read = self.numbers.read(rows * self.columns, values);
        read.map_err(|what| DataError::Malformed { file: self.file.clone(), what })?;
        Ok(rows)
    }
}

/// Number of values that are read at a time.
const CHUNK: usize = 1 << 16;

/// The header of an array in the .npy format, and the numbers after it.
struct Numbers<R> {
    file: R,
    shape: Vec<usize>,
    /// Whether the numbers are stored by columns.
    by_columns: bool,
    storage: Storage,
    /// Whether the most significant byte comes first.
    big: bool,
    bytes: Vec<u8>,
}

impl<R: Read> Numbers<R> {
    /// Reads the header and compares it with the `length` of the file. The inner error describes an array that does not
    /// contain real numbers.
    fn open(mut file: R, length: u64) -> Result<Result<Self, &'static str>, String> {
        let mut take = |count: u64| {
            let mut bytes = Vec::new();
            file.by_ref().take(count).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
            let there = bytes.len();
            if there as u64 == count {
                return Ok(bytes);
            }
            Err(format!("{count} bytes are announced, but {there} are present"))
        };
        let [magic, version] = [take(6)?, take(2)?];
        let size = match (magic.as_slice(), version[0]) {
            (b"\x93NUMPY", 1) => 2,
            (b"\x93NUMPY", 2 | 3) => 4,
            _ => return Err("it does not begin like a file of version 1, 2 or 3".into()),
        };
        let header_length = number(&take(size)?, 0, 4);
        let header = String::from_utf8(take(header_length)?).map_err(|_| "its header is not text".to_string())?;
        let field = |name: &str| {
            let value =
                header.split_once(&format!("'{name}'")).and_then(|(_, rest)| rest.trim_start().strip_prefix(':'));
            value.map(str::trim_start).ok_or_else(|| format!("its header has no `{name}`"))
        };
        let (big, storage) = match number_type(field("descr")?)? {
            Ok(found) => found,
            Err(what) => return Ok(Err(what)),
        };
        let by_columns = match field("fortran_order")? {
            order if order.starts_with("True") => true,
            order if order.starts_with("False") => false,
            _ => return Err("`fortran_order` is neither True nor False".into()),
        };
        let shape = shape(field("shape")?)?;
        let wanted = count(&shape)?.checked_mul(storage.width()).ok_or("it is too large")? as u64;
        let there = length.saturating_sub(8 + size + header_length);
        if wanted != there {
            return Err(format!("{wanted} bytes are announced, but {there} are present"));
        }
        Ok(Ok(Self { file, shape, by_columns, storage, big, bytes: Vec::new() }))
    }

    /// Appends the next `count` numbers to `values`.
    fn read(&mut self, mut count: usize, values: &mut Vec<f64>) -> Result<(), String> {
        values.reserve_exact(count);
        while count > 0 {
            let now = count.min(CHUNK);
            self.bytes.resize(now * self.storage.width(), 0);
            self.file.read_exact(&mut self.bytes).map_err(|e| e.to_string())?;
            self.storage.append(&self.bytes, self.big, values)?;
            count -= now;
        }
        Ok(())
    }
}

/// Reads an array in the .npy format from a file of `length` bytes.
fn read_array(file: impl Read, length: u64) -> Result<Array, String> {
    let mut numbers = match Numbers::open(file, length)? {
        Ok(numbers) => numbers,
        Err(what) => return Ok(Err(what)),
    };
    let mut values = Vec::new();
    numbers.read(count(&numbers.shape)?, &mut values)?;
    array(&numbers.shape, values, numbers.by_columns).map(Ok)
}

/// Reads a shape: sizes in parentheses.
fn shape(text: &str) -> Result<Vec<usize>, String> {
    let inside = text.strip_prefix('(').and_then(|text| text.split_once(')')).map(|(inside, _)| inside);
    let sizes = inside.into_iter().flat_map(|inside| inside.split(',')).map(str::trim).filter(|size| !size.is_empty());
    let sizes: Result<Vec<usize>, _> = sizes.map(str::parse).collect();
    match (inside, sizes) {
        (Some(_), Ok(sizes)) => Ok(sizes),
        _ => Err("its shape is not a list of whole numbers".into()),
    }
}

/// Reads a type: whether the most significant byte comes first, and how a number is stored. The inner error describes
/// an array that does not contain real numbers.
fn number_type(text: &str) -> Result<Result<(bool, Storage), &'static str>, String> {
    let Some((name, _)) = text.strip_prefix('\'').and_then(|text| text.split_once('\'')) else {
        return Ok(Err("a structured array"));
    };
    let Some((order @ ('<' | '>' | '|'), kind)) =
        name.split_at_checked(1).and_then(|(first, kind)| Some((first.chars().next()?, kind)))
    else {
        return Err(format!("its type `{name}` is unknown"));
    };
    let storage = match kind {
        "f8" => Storage::F64,
        "f4" => Storage::F32,
        "i8" => Storage::I64,
        "i4" => Storage::I32,
        "i2" => Storage::I16,
        "i1" => Storage::I8,
        "u8" => Storage::U64,
        "u4" => Storage::U32,
        "u2" => Storage::U16,
        "u1" => Storage::U8,
        _ => {
            return Ok(Err(match kind.chars().next() {
                Some('b') => "of truth values",
                Some('c') => "complex",
                Some('S' | 'U' | 'a') => "text",
                Some('M' | 'm') => "of dates",
                Some('f') => "of numbers of half or extended precision",
                _ => "of objects",
            }));
        }
    };
    Ok(Ok((order == '>', storage)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array3, arr0, array};
    use ndarray_npy::{NpzWriter, WriteNpyExt};
    use proptest::prelude::any;
    use proptest::sample::Index;

    fn archive(fill: impl FnOnce(&mut NpzWriter<Cursor<Vec<u8>>>)) -> Vec<u8> {
        let mut writer = NpzWriter::new_compressed(Cursor::new(Vec::new()));
        fill(&mut writer);
        writer.finish().unwrap().into_inner()
    }

    fn read_npy(path: &Path, bytes: &[u8]) -> Result<Content, DataError> {
        super::read_npy(path, bytes, bytes.len() as u64)
    }

    fn parse(bytes: &[u8], variable: Option<&str>) -> Result<Content, DataError> {
        read_npz(Path::new("x.npz"), bytes, variable)
    }

    #[test]
    fn vectors_matrices_and_scalars_become_one_table() {
        let bytes = archive(|npz| {
            npz.add_array("Fs", &arr0(400.0)).unwrap();
            npz.add_array("u", &array![1_i32, 2, 3]).unwrap();
            npz.add_array("y", &array![[1.5_f32, 2.5], [3.5, 4.5], [5.5, 6.5]]).unwrap();
        });
        let content = parse(&bytes, None).unwrap();
        assert_eq!(content.names, ["u", "y1", "y2"]);
        assert_eq!(content.scalars["Fs"], 400.0);
        assert_eq!(content.columns, array![[1.0, 1.5, 2.5], [2.0, 3.5, 4.5], [3.0, 5.5, 6.5]]);
    }

    #[test]
    fn unequal_lengths_ask_for_a_choice() {
        let bytes = archive(|npz| {
            npz.add_array("long", &array![1.0, 2.0, 3.0]).unwrap();
            npz.add_array("short", &array![[1.0, 2.0], [3.0, 4.0]]).unwrap();
            npz.add_array("cube", &Array3::<f64>::zeros((2, 2, 2))).unwrap();
            npz.add_array("flags", &array![true, false]).unwrap();
        });
        let error = parse(&bytes, None).err().unwrap().to_string();
        for said in ["`long` (3)", "`short` (2 x 2)", "`cube` (2 x 2 x 2, an array of more than two dimensions)"] {
            assert!(error.contains(said), "{error}");
        }
        assert_eq!(parse(&bytes, Some("short")).unwrap().names, ["1", "2"]);
        assert_eq!(parse(&bytes, Some("long")).unwrap().names, ["long"]);
        let error = parse(&bytes, Some("shorts")).err().unwrap().to_string();
        assert!(error.contains("did you mean `short`?"), "{error}");
    }

    #[test]
    fn a_single_array_has_numbered_columns() {
        let mut bytes = Vec::new();
        array![[1_u8, 2], [3, 4], [5, 6]].write_npy(&mut bytes).unwrap();
        let content = read_npy(Path::new("x.npy"), &bytes).unwrap();
        assert_eq!(content.names, ["1", "2"]);
        assert_eq!(content.columns, array![[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]);
    }

    #[test]
    fn broken_archives_are_errors() {
        let bytes = archive(|npz| npz.add_array("u", &array![1.0, 2.0]).unwrap());
        for broken in [&bytes[..bytes.len() - 30], &b"PK\x03\x04rubbish"[..]] {
            assert!(matches!(parse(broken, None), Err(DataError::Malformed { .. })));
        }
        assert!(matches!(read_npy(Path::new("x.npy"), b"\x93NUMPY\x01\x00"), Err(DataError::Malformed { .. })));
    }

    /// The first case once made the reader allocate 13 MB for 22 bytes.
    #[test]
    fn a_directory_is_checked_against_the_bytes_of_the_file() {
        let ends = |first: u16, second: u16| {
            let counts = [first, second].map(u16::to_le_bytes).concat();
            [&b"PK\x05\x06\0\0\0\0"[..], &counts, &[0; 10]].concat()
        };
        let announced = |bytes: &[u8]| parse(bytes, None).err().unwrap().to_string().contains("arrays are announced");
        assert!(announced(&ends(60_928, 0)) && announced(&ends(0, 60_928)));
        let counts = [1_u64 << 40, 1 << 40, 0, 1 << 42].map(u64::to_le_bytes).concat();
        let large = [&b"PK\x06\x06"[..], &44_u64.to_le_bytes(), &[45, 0, 45, 0], &[0; 8], &counts].concat();
        let locator = [&b"PK\x06\x07"[..], &[0; 12], &1_u32.to_le_bytes()].concat();
        assert!(announced(&[&large[..], &locator, &ends(0, 0)].concat()));
        // The file ends within a mark.
        assert!(parse(b"PK\x03\x04 PK", None).is_err());
    }

    /// The marks of the end of a directory may occur in the numbers of an array.
    #[test]
    fn marks_among_the_data_are_no_directory() {
        let ends = |count: u64| [&b"PK\x06\x06"[..], &[0; 20], &count.to_le_bytes(), b"PK\x05\x06"].concat();
        let mut data = ends(u64::MAX);
        data.extend([0xff; 28]);
        data.resize(8 * data.len().div_ceil(8), 0);
        let array =
            npy(&format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({},), }}", data.len() / 8), &data);
        let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        archive.start_file("y.npy", stored).unwrap();
        std::io::Write::write_all(&mut archive, &array).unwrap();
        let bytes = archive.finish().unwrap().into_inner();
        assert_eq!(parse(&bytes, None).unwrap().columns.nrows(), data.len() / 8);
    }

    fn npy(header: &str, data: &[u8]) -> Vec<u8> {
        [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), data].concat()
    }

    /// The first two cases made an earlier reader hang or abort.
    #[test]
    fn a_header_is_checked_against_the_bytes_of_the_file() {
        let says = |bytes: &[u8]| read_npy(Path::new("x.npy"), bytes).err().unwrap().to_string();
        for shape in ["(999999999999,)", "(4294967296, 4294967296, 4294967296)", "(2,)", "(0, 7)"] {
            let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
            let said = says(&npy(&header, &[0; 8]));
            assert!(said.contains("x.npy") && (said.contains("announced") || said.contains("too large")), "{said}");
        }
        says(&npy(&"(".repeat(60_000), &[]));
        says(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{'descr': '<f8'}");
        says(&npy("{'descr': '<f8', 'fortran_order': False, 'shape': (((((1,),),),),)}", &[0; 8]));
    }

    #[test]
    fn both_orders_of_bytes_and_of_numbers_are_read() {
        let numbers: Vec<u8> = [1.0_f64, 2.0, 3.0, 4.0, 5.0, 6.0].iter().flat_map(|x| x.to_be_bytes()).collect();
        for (order, expected) in [
            ("True", array![[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]]),
            ("False", array![[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]),
        ] {
            let header = format!("{{'descr': '>f8', 'fortran_order': {order}, 'shape': (3, 2), }}");
            assert_eq!(read_npy(Path::new("x.npy"), &npy(&header, &numbers)).unwrap().columns, expected);
        }
        let complex =
            read_npy(Path::new("x.npy"), &npy("{'descr': '<c16', 'fortran_order': False, 'shape': (1,), }", &[0; 16]));
        assert!(complex.err().unwrap().to_string().contains("complex"));
    }

    proptest::proptest! {
        #[test]
        fn a_damaged_archive_is_an_error_or_data(at in any::<Index>(), value: u8, end in any::<Index>()) {
            let mut bytes = archive(|npz| npz.add_array("u", &array![[1.0, 2.0], [3.0, 4.0]]).unwrap());
            let at = at.index(bytes.len());
            bytes[at] = value;
            let _ = parse(&bytes, None);
            let _ = parse(&bytes[..end.index(bytes.len())], None);
        }
    }
}
