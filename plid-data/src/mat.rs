//! MATLAB .mat files, version 5 (`save -v6` or `-v7`).
use super::DataError;
use super::table::Content;
use super::variables::{Variable, assemble};
use matfile::{Array, MatFile, NumericData};
use ndarray::{ArrayD, IxDyn, ShapeBuilder};
use std::path::Path;

/// Bytes before the first variable.
const HEADER: usize = 128;

/// Reads the real arrays of a file.
pub(super) fn read(path: &Path, bytes: &[u8], variable: Option<&str>) -> Result<Content, DataError> {
    let malformed = |what: String| DataError::Malformed { file: path.into(), what };
    if bytes.starts_with(b"MATLAB 7.3") || bytes.starts_with(b"\x89HDF") {
        let what = "a MATLAB 7.3 file (HDF5), which is not read; save it with `save -v7`";
        return Err(malformed(what.into()));
    }
    check_complete(bytes).map_err(|what| malformed(what.into()))?;
    let file = MatFile::parse(bytes).map_err(|e| malformed(format!("not a readable .mat file: {e}")))?;
    let variables: Vec<Variable> = file.arrays().iter().map(to_variable).collect();
    assemble(path, &variables, variable)
}

/// Walks over the variables without reading them. The parser stops silently where a file is
/// cut off; that must not pass for a file with fewer variables.
fn check_complete(bytes: &[u8]) -> Result<(), &'static str> {
    let word = |at: usize, big: bool| {
        let four: [u8; 4] = bytes.get(at..at + 4)?.try_into().ok()?;
        Some(if big { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) } as usize)
    };
    let big = match bytes.get(HEADER - 2..HEADER) {
        Some(b"IM") => false,
        Some(b"MI") => true,
        _ => return Err("not a .mat file of version 5"),
    };
    let mut at = HEADER;
    while at < bytes.len() {
        // Small elements pack size and type into one word; no variable is that small.
        let size = word(at + 4, big).ok_or("the file is cut off within a variable")?;
        at += 8 + size;
        if at > bytes.len() {
            return Err("the file is cut off within a variable");
        }
    }
    Ok(())
}

fn to_variable(array: &Array) -> Variable {
    let name = array.name().to_owned();
    let size = array.size().clone();
    match real(array.data()).and_then(|values| {
        // MATLAB stores columns one after another.
        ArrayD::from_shape_vec(IxDyn(&size).f(), values).ok()
    }) {
        Some(values) => Variable::new(name, values, true),
        None => Variable::unusable(name, size),
    }
}

/// The elements as f64; `None` if they are complex.
fn real(data: &NumericData) -> Option<Vec<f64>> {
    fn all<T: Copy, C>(real: &[T], imaginary: &Option<C>, convert: fn(T) -> f64) -> Option<Vec<f64>> {
        imaginary.is_none().then(|| real.iter().map(|&x| convert(x)).collect())
    }
    match data {
        NumericData::Double { real, imag } => all(real, imag, |x| x),
        NumericData::Single { real, imag } => all(real, imag, f64::from),
        NumericData::Int8 { real, imag } => all(real, imag, f64::from),
        NumericData::UInt8 { real, imag } => all(real, imag, f64::from),
        NumericData::Int16 { real, imag } => all(real, imag, f64::from),
        NumericData::UInt16 { real, imag } => all(real, imag, f64::from),
        NumericData::Int32 { real, imag } => all(real, imag, f64::from),
        NumericData::UInt32 { real, imag } => all(real, imag, f64::from),
        NumericData::Int64 { real, imag } => all(real, imag, |x| x as f64),
        NumericData::UInt64 { real, imag } => all(real, imag, |x| x as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    /// A .mat v5 file of uncompressed double arrays, written by the format's specification
    /// (MathWorks, MAT-File Format, level 5): name, rows, columns, values by columns.
    fn mat_file(variables: &[(&str, usize, usize, &[f64])]) -> Vec<u8> {
        fn element(kind: u32, data: &[u8]) -> Vec<u8> {
            let mut out = kind.to_le_bytes().to_vec();
            out.extend((data.len() as u32).to_le_bytes());
            out.extend(data);
            out.resize(out.len().next_multiple_of(8), 0);
            out
        }
        let mut file = b"MATLAB 5.0 MAT-file, written by a test".to_vec();
        file.resize(124, b' ');
        file.extend([0x00, 0x01]);
        file.extend(b"IM");
        for (name, rows, columns, values) in variables {
            // Class 6 is double; data types 6, 5, 1 and 9 are u32, i32, i8 and double.
            let flags: Vec<u8> = [6_u32, 0].iter().flat_map(|x| x.to_le_bytes()).collect();
            let size: Vec<u8> = [*rows as i32, *columns as i32].iter().flat_map(|x| x.to_le_bytes()).collect();
            let data: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
            let body = [element(6, &flags), element(5, &size), element(1, name.as_bytes()), element(9, &data)].concat();
            file.extend(element(14, &body));
        }
        file
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
        let error = parse(&mat_file(&[]), None).err().unwrap();
        assert!(error.to_string().contains("no variable"));
    }
}
