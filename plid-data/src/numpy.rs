//! NumPy .npz archives and .npy arrays.
use super::DataError;
use super::table::Content;
use super::variables::{Variable, assemble};
use ndarray::{ArrayD, IxDyn, OwnedRepr};
use ndarray_npy::{NpzReader, ReadNpyError, ReadNpyExt, ReadNpzError, ReadableElement};
use std::io::Cursor;
use std::path::Path;

/// Reads an archive of named arrays.
pub(super) fn read_npz(path: &Path, bytes: &[u8], variable: Option<&str>) -> Result<Content, DataError> {
    let malformed = |what: String| DataError::Malformed { file: path.into(), what };
    let unreadable = |e: ReadNpzError| malformed(format!("not a readable .npz archive: {e}"));
    let mut archive = NpzReader::new(Cursor::new(bytes)).map_err(unreadable)?;
    let names = archive.names().map_err(unreadable)?;
    let mut variables = Vec::new();
    for (index, name) in names.into_iter().enumerate() {
        let member = Member { archive: &mut archive, index };
        let values = real(member).map_err(|e| malformed(format!("array `{name}`: {e}")))?;
        variables.push(match values {
            Some(values) => Variable::new(name, values, false),
            None => Variable::unusable(name, Vec::new(), "not of real numbers"),
        });
    }
    assemble(path, &variables, variable)
}

/// Reads a single array; its columns are numbered.
pub(super) fn read_npy(path: &Path, bytes: &[u8]) -> Result<Content, DataError> {
    let malformed = |what: String| DataError::Malformed { file: path.into(), what };
    let values = real(bytes)
        .map_err(|e| malformed(format!("not a readable .npy array: {e}")))?
        .ok_or_else(|| malformed("the array does not hold real numbers".into()))?;
    assemble(path, &[Variable::new("1".into(), values, false)], None)
}

/// Something that holds one array in the .npy format.
trait Stored {
    fn load<T: ReadableElement>(&mut self) -> Result<ArrayD<T>, ReadNpyError>;
}

impl Stored for &[u8] {
    fn load<T: ReadableElement>(&mut self) -> Result<ArrayD<T>, ReadNpyError> {
        ArrayD::read_npy(*self)
    }
}

struct Member<'a, 'b> {
    archive: &'a mut NpzReader<Cursor<&'b [u8]>>,
    index: usize,
}

impl Stored for Member<'_, '_> {
    fn load<T: ReadableElement>(&mut self) -> Result<ArrayD<T>, ReadNpyError> {
        let array = self.archive.by_index::<OwnedRepr<T>, IxDyn>(self.index);
        array.map_err(|e| match e {
            ReadNpzError::Npy(e) => e,
            ReadNpzError::Zip(e) => ReadNpyError::Io(e.into()),
        })
    }
}

/// The array as f64, whatever real type it has; `None` if it is complex, text or objects.
fn real(mut stored: impl Stored) -> Result<Option<ArrayD<f64>>, ReadNpyError> {
    fn attempt<T: ReadableElement + Copy>(
        stored: &mut impl Stored,
        convert: fn(T) -> f64,
    ) -> Option<Result<ArrayD<f64>, ReadNpyError>> {
        match stored.load::<T>() {
            Err(ReadNpyError::WrongDescriptor(_)) => None,
            other => Some(other.map(|array| array.mapv(convert))),
        }
    }
    let s = &mut stored;
    attempt::<f64>(s, |x| x)
        .or_else(|| attempt::<f32>(s, f64::from))
        .or_else(|| attempt::<i64>(s, |x| x as f64))
        .or_else(|| attempt::<i32>(s, f64::from))
        .or_else(|| attempt::<i16>(s, f64::from))
        .or_else(|| attempt::<i8>(s, f64::from))
        .or_else(|| attempt::<u64>(s, |x| x as f64))
        .or_else(|| attempt::<u32>(s, f64::from))
        .or_else(|| attempt::<u16>(s, f64::from))
        .or_else(|| attempt::<u8>(s, f64::from))
        .transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array3, arr0, array};
    use ndarray_npy::{NpzWriter, WriteNpyExt};

    fn archive(fill: impl FnOnce(&mut NpzWriter<Cursor<Vec<u8>>>)) -> Vec<u8> {
        let mut writer = NpzWriter::new_compressed(Cursor::new(Vec::new()));
        fill(&mut writer);
        writer.finish().unwrap().into_inner()
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
}
