//! NumPy's .npz: a ZIP archive of .npy files (NumPy Enhancement Proposal 1).

use std::io::{self, Cursor, Write};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::Variable;

/// The length of a .npy's header is padded to a multiple of this.
const ALIGNED: usize = 64;

/// Returns the contents of a file with these variables.
pub fn file(variables: &[(&str, Variable)]) -> io::Result<Vec<u8>> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    // Without the time of day, equal models give equal files.
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .last_modified_time(DateTime::default());
    for (name, variable) in variables {
        archive.start_file(format!("{name}.npy"), options)?;
        archive.write_all(&array(variable))?;
    }
    Ok(archive.finish()?.into_inner())
}

fn array(variable: &Variable) -> Vec<u8> {
    let numbers = |values: &[f64]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let (of, shape, data) = match variable {
        Variable::Matrix(matrix) => {
            ("<f8".into(), format!("({}, {})", matrix.nrows(), matrix.ncols()), numbers(matrix.transpose().as_slice()))
        }
        Variable::Vector(vector) => ("<f8".into(), format!("({},)", vector.len()), numbers(vector.as_slice())),
        Variable::Number(number) => ("<f8".into(), "()".into(), numbers(&[*number])),
        Variable::Text(text) => {
            let data = text.chars().flat_map(|letter| u32::from(letter).to_le_bytes()).collect();
            (format!("<U{}", text.chars().count()), "()".into(), data)
        }
    };
    let mut header = format!("{{'descr': '{of}', 'fortran_order': False, 'shape': {shape}, }}");
    // Magic string, version and length take ten bytes, and the header ends with a newline.
    let length = (10 + header.len() + 1).next_multiple_of(ALIGNED) - 10;
    header = format!("{header:<width$}\n", width = length - 1);
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(header.into_bytes());
    bytes.extend(data);
    bytes
}
