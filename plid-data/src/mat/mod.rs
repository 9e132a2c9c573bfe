//! MATLAB .mat files of version 5 (`save -v6` or `-v7`) and version 4 (`save -v4`).
//!
//! Only real arrays are read. Everything else in a file is reported to the user, and any fault of a file is an error,
//! so that no variable is lost silently.
mod v4;
mod v5;

use super::DataError;
use super::table::Content;
use super::variables::{Variable, assemble};
use ndarray::ArrayD;
use std::path::Path;

/// A variable of a file.
struct Found {
    name: String,
    /// Unknown and empty for an opaque object.
    shape: Vec<usize>,
    contents: Contents,
}

/// The content of a variable.
enum Contents {
    Real(ArrayD<f64>),
    /// A description of the content.
    Other(&'static str),
}

/// Reads the real arrays of a file.
pub(super) fn read(path: &Path, bytes: &[u8], variable: Option<&str>) -> Result<Content, DataError> {
    let malformed = |what: String| DataError::Malformed { file: path.into(), what };
    // The HDF5 data begin after a header of MATLAB, whose text need not name the version.
    let is_hdf5 = [0, 512].iter().any(|&at| bytes.get(at..).is_some_and(|rest| rest.starts_with(b"\x89HDF")));
    if is_hdf5 || bytes.starts_with(b"MATLAB 7.3") {
        let what = "a MATLAB 7.3 file (HDF5), which is not supported; save it with `save -v7`";
        return Err(malformed(what.into()));
    }
    let found = variables(bytes).map_err(|reason| malformed(format!("not a readable .mat file: {reason}")))?;
    let variables: Vec<Variable> = found.into_iter().map(to_variable).collect();
    assemble(path, variables, variable)
}

fn variables(bytes: &[u8]) -> Result<Vec<Found>, String> {
    if v4::is_likely(bytes) { v4::read(bytes) } else { v5::read(bytes) }
}

fn to_variable(found: Found) -> Variable {
    match found.contents {
        Contents::Real(values) => Variable::new(found.name, values, true),
        Contents::Other(what) => Variable::unusable(found.name, found.shape, what),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    /// Builds an element of version 5 according to the format's specification (MathWorks, MAT-File Format, level 5).
    fn element(kind: u32, data: &[u8]) -> Vec<u8> {
        let mut out = kind.to_le_bytes().to_vec();
        out.extend((data.len() as u32).to_le_bytes());
        out.extend(data);
        out.resize(out.len().next_multiple_of(8), 0);
        out
    }

    /// Returns words as they are stored.
    fn words(words: &[u32]) -> Vec<u8> {
        words.iter().flat_map(|word| word.to_le_bytes()).collect()
    }

    /// Builds a file from the header of version 5 and elements.
    fn file_of(elements: &[Vec<u8>]) -> Vec<u8> {
        let mut file = b"MATLAB 5.0 MAT-file, written by a test".to_vec();
        file.resize(116, b' ');
        file.extend([0; 8]);
        file.extend([0x00, 0x01]);
        file.extend(b"IM");
        file.extend(elements.concat());
        file
    }

    /// Builds a file of uncompressed double arrays: name, rows, columns, values by columns.
    fn mat_file(variables: &[(&str, usize, usize, &[f64])]) -> Vec<u8> {
        let double = |(name, rows, columns, values): &(&str, usize, usize, &[f64])| {
            // Class 6 is double; data types 6, 5, 1 and 9 are u32, i32, i8 and double.
            let size = words(&[*rows as u32, *columns as u32]);
            let data: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
            let parts =
                [element(6, &words(&[6, 0])), element(5, &size), element(1, name.as_bytes()), element(9, &data)];
            element(14, &parts.concat())
        };
        file_of(&variables.iter().map(double).collect::<Vec<_>>())
    }

    fn parse(bytes: &[u8], variable: Option<&str>) -> Result<Content, DataError> {
        read(Path::new("x.mat"), bytes, variable)
    }

    #[test]
    fn a_matrix_has_numbered_columns() {
        let bytes = mat_file(&[("data", 3, 2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])]);
        let content = parse(&bytes, None).unwrap();
        assert_eq!(content.names, ["1", "2"]);
        assert_eq!(content.columns, array![[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]]);
    }

    #[test]
    fn vectors_are_named_columns_whichever_way_they_lie() {
        let bytes =
            mat_file(&[("force", 3, 1, &[1.0, 2.0, 3.0]), ("acc", 1, 3, &[4.0, 5.0, 6.0]), ("Fs", 1, 1, &[100.0])]);
        let content = parse(&bytes, None).unwrap();
        assert_eq!(content.names, ["force", "acc"]);
        assert_eq!(content.columns, array![[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]]);
        assert_eq!(content.scalars["Fs"], 100.0);
    }

    #[test]
    fn matrices_of_unequal_length_ask_for_a_choice() {
        let bytes =
            mat_file(&[("first", 2, 2, &[1.0, 2.0, 3.0, 4.0]), ("second", 3, 2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])]);
        let error = parse(&bytes, None).err().unwrap().to_string();
        assert!(error.contains("`first` (2 x 2), `second` (3 x 2)"), "{error}");
        assert_eq!(parse(&bytes, Some("second")).unwrap().columns.nrows(), 3);
        let error = parse(&bytes, Some("secnod")).err().unwrap().to_string();
        assert!(error.contains("did you mean `second`?"), "{error}");
    }

    #[test]
    fn matrices_of_one_length_stand_side_by_side() {
        let bytes = mat_file(&[("u", 2, 1, &[1.0, 2.0]), ("y", 2, 2, &[3.0, 4.0, 5.0, 6.0])]);
        let content = parse(&bytes, None).unwrap();
        assert_eq!(content.names, ["u", "y1", "y2"]);
        assert_eq!(content.columns, array![[1.0, 3.0, 5.0], [2.0, 4.0, 6.0]]);
    }

    #[test]
    fn files_that_are_cut_off_or_of_another_version_are_errors() {
        let bytes = mat_file(&[("u", 2, 1, &[1.0, 2.0]), ("y", 2, 2, &[3.0, 4.0, 5.0, 6.0])]);
        for end in [40, 130, bytes.len() - 8] {
            let error = parse(&bytes[..end], None).err().unwrap();
            assert!(matches!(error, DataError::Malformed { .. }), "{error}");
        }
        let error = parse(b"MATLAB 7.3 MAT-file", None).err().unwrap();
        assert!(error.to_string().contains("-v7"));
        let mut hdf5 = mat_file(&[]);
        hdf5.resize(512, 0);
        hdf5.extend(b"\x89HDF\r\n");
        assert!(parse(&hdf5, None).err().unwrap().to_string().contains("-v7"));
        let error = parse(&mat_file(&[]), None).err().unwrap();
        assert!(error.to_string().contains("no variable"));
    }

    const V4: &[u8] = include_bytes!("fixtures/v4.mat");
    const V5: &[u8] = include_bytes!("fixtures/v5.mat");
    const COMPRESSED: &[u8] = include_bytes!("fixtures/v5_compressed.mat");

    /// The files were written by SciPy with fixtures/make.py.
    #[test]
    fn files_of_every_version_hold_the_same() {
        let y = array![[0.5, 10.0], [1.5, 20.0], [2.5, 30.0], [3.5, 40.0], [4.5, 50.0]];
        for (bytes, others) in [
            (V4, &["about", "z"][..]),
            (V5, &["about", "setup", "mixed", "z", "cube"]),
            (COMPRESSED, &["about", "setup", "mixed", "z", "cube"]),
        ] {
            let content = parse(bytes, None).unwrap();
            assert_eq!(content.names, ["u", "y1", "y2", "n"]);
            assert_eq!(content.columns.column(0).to_vec(), [1.0, 2.0, -3.0, 4.5, 1e-3]);
            assert_eq!(content.columns.slice(ndarray::s![.., 1..3]), y);
            assert_eq!(content.columns.column(3).to_vec(), [1.0, -2.0, 300_000.0, 4.0, 5.0]);
            assert_eq!(content.scalars["Fs"], 100.0);
            let said: Vec<String> = content.notes.iter().map(ToString::to_string).collect();
            assert_eq!(said.len(), others.len(), "{said:?}");
            for other in others {
                assert!(said.iter().any(|said| said.contains(&format!("variable `{other}` is"))), "{other}: {said:?}");
            }
        }
        let said = parse(V5, None).unwrap().notes[1].to_string();
        assert_eq!(said, "x.mat: variable `setup` is a struct and is ignored");
        assert!(parse(V5, Some("y")).unwrap().notes.is_empty());
    }

    #[test]
    fn numbers_of_every_class_are_read() {
        let content = parse(include_bytes!("fixtures/v5_numbers.mat"), None).unwrap();
        assert_eq!(content.names.len(), 11);
        assert!(content.columns.columns().into_iter().all(|column| column.to_vec() == [1.0, 0.0, 1.0]));
    }

    /// Function handles (class 16) and opaque objects (class 17, without dimensions), which SciPy cannot write, occur
    /// among arrays, followed by the matrix without a name.
    #[test]
    fn handles_and_objects_are_named_and_nothing_else_is_lost() {
        let [u, shared] = [("u", [1.0, 2.0]), ("", [0.0, 0.0])]
            .map(|(name, values)| mat_file(&[(name, 2, 1, &values)])[128..].to_vec());
        let inner = element(
            14,
            &[element(6, &words(&[6, 0])), element(5, &words(&[0, 0])), element(1, b""), element(9, &[])].concat(),
        );
        let handle =
            [element(6, &words(&[16, 0])), element(5, &words(&[1, 1])), element(1, b"f"), inner.clone()].concat();
        let object =
            [element(6, &words(&[17, 0])), element(1, b"o"), element(1, b"MCOS"), element(1, b"string"), inner]
                .concat();
        let before = [element(14, &handle), element(14, &object), u].concat();
        let mut file = file_of(&[before.clone(), shared]);
        assert_eq!(parse(&file, None).unwrap().names, ["u", ""]);
        file[116..120].copy_from_slice(&words(&[128 + before.len() as u32]));
        let content = parse(&file, None).unwrap();
        assert_eq!(content.names, ["u"]);
        let said: Vec<String> = content.notes.iter().map(ToString::to_string).collect();
        assert!(said[0].contains("`f` is a function handle") && said[1].contains("`o` is an object"), "{said:?}");
    }

    /// A file with the other byte order: tags and numbers are reversed in place.
    #[test]
    fn either_order_of_bytes_is_read() {
        let mut file = mat_file(&[("u", 2, 1, &[1.5, -2.0])]);
        // The ranges are those of the mark; tags, flags and dimensions; the name's tag (the name is one byte); the
        // numbers' tag; the numbers.
        for (range, width) in [(126..128, 2), (128..176, 4), (184..192, 4), (192..208, 8)] {
            file[range].chunks_exact_mut(width).for_each(<[u8]>::reverse);
        }
        assert_eq!(parse(&file, None).unwrap().columns, array![[1.5], [-2.0]]);
        let v4 = |words: [u32; 5], value: f64| {
            let mut file: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
            file.extend(b"x\0");
            file.extend([value, 2.0].iter().flat_map(|x| x.to_be_bytes()));
            file
        };
        assert_eq!(parse(&v4([1000, 2, 1, 0, 2], 7.0), None).unwrap().columns, array![[7.0], [2.0]]);
        let vax = parse(&v4([2000, 2, 1, 0, 2], 7.0), None).err().unwrap().to_string();
        assert!(vax.contains("IEEE"), "{vax}");
    }

    /// A wrong size within a variable makes this variable and all that follow unreadable. This is always reported.
    #[test]
    fn a_corrupt_size_within_a_variable_is_an_error() {
        let good = mat_file(&[("u", 2, 1, &[1.0, 2.0]), ("Fs", 1, 1, &[100.0])]);
        // The tag of the numbers of `u`: after its own tag (8), flags (16), dimensions (16) and name (16).
        let size = 128 + 8 + 48 + 4;
        assert_eq!(good[size], 16);
        for wrong in [8, 24, 200] {
            let mut bytes = good.clone();
            bytes[size] = wrong;
            let said = parse(&bytes, None).err().unwrap().to_string();
            assert!(said.contains("the element at byte 128: variable `u`"), "{said}");
        }
    }

    proptest::proptest! {
        /// A damaged file is an error, or all of its variables are accounted for; nothing panics. In version 4, the
        /// size of a matrix follows from its dimensions alone: with other dimensions, it may contain exactly what
        /// follows.
        #[test]
        fn no_variable_of_a_damaged_file_is_lost_without_a_word(
            which in 0..3_usize,
            damage in proptest::collection::vec((proptest::prelude::any::<proptest::sample::Index>(),
                proptest::prelude::any::<u8>()), 1..4),
            end in proptest::option::of(proptest::prelude::any::<proptest::sample::Index>()),
        ) {
            let original = [V4, V5, COMPRESSED][which];
            let mut bytes = original.to_vec();
            for (at, value) in damage {
                // The header of version 5 states the version, the byte order, and the location of the data that objects
                // share.
                let first = if which == 0 { 0 } else { 128 };
                let at = first + at.index(bytes.len() - first);
                bytes[at] = value;
            }
            if let Some(end) = end {
                bytes.truncate(end.index(original.len()));
            }
            let sized = which != 0 && bytes.len() == original.len();
            if let Ok(found) = variables(&bytes) && sized {
                proptest::prop_assert_eq!(found.len(), variables(original).unwrap().len());
            }
        }
    }
}
